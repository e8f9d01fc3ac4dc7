"""The OpenMetrics text of a run: held to the grammar of the standard, and to hand-made snapshots."""

from __future__ import annotations

import re
import subprocess
import sys
import urllib.error
import urllib.request
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from counterflex.app.panel.metrics import RunMetrics, exposition
from counterflex.core.records import Records
from counterflex.protocols.processes.control_array import Kept, Tally
from counterflex.protocols.processes.snapshot_layout import SNAPSHOT
from counterflex.runtime.state.states import Cause, State

ABOUT: dict[str, Any] = {"limits": {"correction_m": 2e-3, "correction_rad": 5e-3}}
SEEN = ("waiting", "running")
_NAME = r"[a-zA-Z_:][a-zA-Z0-9_:]*"
_LABEL = r'([a-zA-Z_][a-zA-Z0-9_]*)="((?:[^"\\\n]|\\["\\n])*)"'
_SAMPLE = re.compile(rf"({_NAME})(?:\{{((?:{_LABEL})(?:,{_LABEL})*)\}})? (-?[0-9.]+(?:e[-+]?[0-9]+)?)")
_SUFFIXES = {"counter": ("_total",), "gauge": ("",), "stateset": ("",), "summary": ("", "_count", "_sum")}
_UNITS = ("seconds", "meters", "radians", "newtons")


def parsed(text: str) -> dict[tuple[str, tuple[tuple[str, str], ...]], float]:
    """Samples by name and labels, by the rules of OpenMetrics 1.0.0, section 5 (exposition in text)."""
    *lines, mark, rest = text.split("\n")
    assert (mark, rest) == ("# EOF", "")
    samples: dict[tuple[str, tuple[tuple[str, str], ...]], float] = {}
    known: dict[str, str] = {}
    family = unit = ""
    for line in lines:
        if line.startswith("# "):
            word, name, value = line[2:].split(" ", 2)
            if name != family:  # the metadata of a family come first, and all of it stands together
                assert word == "TYPE"
                assert value in _SUFFIXES
                assert name not in known
                family, unit, known[name] = name, "", value
            elif word == "UNIT":
                assert name.endswith(f"_{value}")
                unit = value
            else:
                assert word == "HELP"
                assert "\\" not in value
            continue
        match = _SAMPLE.fullmatch(line)
        assert match is not None, line
        name, labels = match[1], tuple(re.findall(_LABEL, match[2] or ""))
        kind = known[family]
        assert name.removeprefix(family) in _SUFFIXES[kind]
        assert name.startswith(family)
        assert len(dict(labels)) == len(labels)
        assert bool(unit) == family.endswith(_UNITS)
        value_of = float(match[match.lastindex or 0])
        if kind == "stateset":
            assert family in dict(labels)
            assert value_of in (0.0, 1.0)
        if kind == "counter" or name.endswith("_count"):
            assert value_of >= 0.0
        if kind == "summary" and name == family:
            assert 0.0 <= float(dict(labels)["quantile"]) <= 1.0
        assert (name, labels) not in samples
        samples[name, labels] = value_of
    return samples


def shots(count: int) -> Records:
    """Snapshots of a loop that corrects."""
    made = np.zeros(count, SNAPSHOT)
    made["state"], made["cycle"] = State.ACTIVE, np.arange(count)
    return made.view(np.dtype((np.record, SNAPSHOT)))


def read(metrics: RunMetrics) -> dict[Any, float]:
    return parsed(exposition("running", SEEN, 0.25, metrics))


def test_a_run_says_what_its_snapshots_say() -> None:
    one, metrics = shots(1000), RunMetrics(ABOUT)
    one["compute_ns"] = 1000 * np.arange(1, 1001)
    one["correction"][:, 0], one["correction"][500, 0], one["correction"][:, 4] = 1e-4, -3e-4, -2e-3
    one["state"][100:110], one["cause"][100:110] = State.HOLD, Cause.FORCE_STALE
    one["state"][110:120], one["cause"][110:120] = State.FAULT, Cause.FORCE_STALE
    one["state"][300:310], one["cause"][300:310] = State.HOLD, Cause.FORCE_STALE
    one["incidents"], one["force"] = 2, (100.0, -20.0, 3.0)
    one["tally"][:, Tally.LATE - Tally.FOREIGN], one["kept"][:, Kept.LOST - Kept.TAKEN] = 7, 5
    metrics.add(one[:105], 0)  # in the midst of a hold
    metrics.add(one[105:], 3)
    found = read(metrics)
    assert found["counterflex_state", (("counterflex_state", "active"),)] == 1.0
    assert sum(v for (name, _), v in found.items() if name == "counterflex_state") == 1.0
    for quantile, seconds in (("0.5", 500.5e-6), ("0.99", 990.01e-6), ("1", 1e-3)):
        assert found["counterflex_answer_seconds", (("quantile", quantile),)] == pytest.approx(seconds, rel=1e-12)
    assert found["counterflex_answer_seconds_count", ()] == 1000
    assert found["counterflex_answer_seconds_sum", ()] == pytest.approx(0.5005)
    assert found["counterflex_correction_meters", (("axis", "x"),)] == 1e-4
    assert found["counterflex_correction_largest_meters", (("axis", "x"),)] == 3e-4
    assert found["counterflex_correction_largest_radians", (("axis", "y"),)] == 2e-3
    assert found["counterflex_force_newtons", (("direction", "across"),)] == -20.0
    stops = {labels: v for (name, labels), v in found.items() if name == "counterflex_stops_total"}
    cause = ("cause", "force stale")
    assert stops == {(("state", "hold"), cause): 2.0, (("state", "fault"), cause): 1.0}
    for name, value in (
        ("cycles", 999), ("answers_late", 7), ("log_records_lost", 5), ("incidents", 2), ("snapshots_missed", 3),
    ):  # fmt: skip
        assert found[f"counterflex_{name}_total", ()] == value


def test_what_is_not_known_is_left_out() -> None:
    one, metrics = shots(1), RunMetrics(ABOUT)
    one["force_ns"], one["tally"][:, Tally.LATE - Tally.FOREIGN], one["cause"] = -1, -1, 999
    one["correction"], one["state"] = np.nan, State.FAULT
    metrics.add(one, 0)
    found = read(metrics)
    names = {name for name, _ in found}
    assert not names & {"counterflex_force_newtons", "counterflex_answers_late_total", "counterflex_correction_meters"}
    assert found["counterflex_stops_total", (("state", "fault"), ("cause", "cause 999"))] == 1.0


def test_without_a_run_only_that_is_said() -> None:
    assert parsed(exposition("waiting", SEEN, None, None)) == {
        ("counterflex_run", (("counterflex_run", "waiting"),)): 1.0,
        ("counterflex_run", (("counterflex_run", "running"),)): 0.0,
    }


def test_an_answer_stays_small_whatever_the_run_does() -> None:
    """Each cause of each stop, and more cycles than are kept."""
    metrics = RunMetrics(ABOUT)
    for cause in Cause:
        one = shots(6)
        one["state"], one["cause"] = [State.HOLD, State.RAMP_OUT, State.FAULT] * 2, cause
        metrics.add(one, 0)
    for _ in range(20):
        metrics.add(shots(1000), 0)
    text = exposition("running", SEEN, 0.0, metrics)
    assert parsed(text)["counterflex_answer_seconds_count", ()] == 20_000 + 6 * len(Cause)
    assert len(text) < 20_000
    assert len(metrics._answers_ns) == 15_000


def test_a_server_of_metrics_reads_them_by_its_key(tmp_path: Path) -> None:
    """A real panel: the key reads the text, and neither pages nor what strangers get."""
    pytest.importorskip("nicegui", reason="the extra panel is not installed")
    (tmp_path / "key").write_text("k" * 24, encoding="ascii")
    command = [sys.executable, "-m", "counterflex", "panel", "log", "--port", "0", "--metrics-key", "key"]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, text=True) as panel:
        try:
            assert panel.stdout is not None
            base = panel.stdout.readline().strip().partition(": ")[2].partition("?")[0]
            asked = urllib.request.Request(f"{base}metrics", headers={"Authorization": f"Bearer {'k' * 24}"})
            with urllib.request.urlopen(asked, timeout=60.0) as answer:
                kind, text = answer.headers["content-type"], answer.read().decode("utf-8")
            with pytest.raises(urllib.error.HTTPError, match="401") as refused:
                urllib.request.urlopen(f"{base}metrics", timeout=60.0)
            refused.value.close()
        finally:
            panel.terminate()
    assert kind == "application/openmetrics-text; version=1.0.0; charset=utf-8"
    assert parsed(text)["counterflex_run", (("counterflex_run", "waiting"),)] == 1.0
