"""Logs of older code are shown and exported by the names of their columns; what needs more is refused in one line."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest

from counterflex.app.run import log as job
from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError
from counterflex.files.logs import segment as run_log_segment
from counterflex.files.logs.run_log import LAYOUT, RunLogWriter
from counterflex.files.logs.segments import read_log, read_segment
from counterflex.runtime.record_ring import COLUMNS, WIDTH
from counterflex.runtime.state.states import Cause, State

CYCLES = 30
NEWER = ("wear_trend", "wear_trend_sigma", "fast_samples", "slowed", "surprise_tracker")
"""What is left out here, as older code did not record it."""


def rows() -> Float:
    out = np.random.default_rng(1).standard_normal((CYCLES, WIDTH))
    for name in COLUMNS:
        counts = ("elapsed", "w_good", "pair_used", "slowed")
        if name.startswith(("out_", "flag_", "event_", "fast_")) or name in counts:
            out[:, COLUMNS.index(name)] = 0.0
    k = np.arange(CYCLES)
    out[:, COLUMNS.index("counter_ms")] = 4 * k
    out[:, COLUMNS.index("received_ns")] = 1e9 + 4e6 * k
    out[:, COLUMNS.index("sent_ns")] = 1e9 + 4e6 * k + 3e4
    out[:, COLUMNS.index("elapsed")] = 1
    out[:, COLUMNS.index("cut_m")] = 1e-3 * k
    out[:, COLUMNS.index("cycle")] = k + 1
    out[:, COLUMNS.index("out_state")] = State.IDLE
    out[10:, COLUMNS.index("out_state")] = State.HOLD
    out[10:, COLUMNS.index("out_cause")] = Cause.FORCE_STALE
    return out


def write(folder: Path, columns: tuple[str, ...], monkeypatch: pytest.MonkeyPatch, *, cut: bool = False) -> Path:
    places = [COLUMNS.index(name) if name in COLUMNS else 0 for name in columns]
    with monkeypatch.context() as patched:
        patched.setattr(run_log_segment, "COLUMNS", columns)
        log = RunLogWriter(folder / "log", {"counterflex": "0.0.7", "compensated": True})
        log.add(rows()[:, places], 1.0)
        log.close()
    file = folder / "log" / "run-000.mcap"
    if cut:
        file.write_bytes(file.read_bytes()[:-200])
        os.utime(file, (1e9, 1e9))
    return file


OLDER = tuple(name for name in COLUMNS if name not in NEWER)


def test_columns_are_placed_by_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # In another order besides: a name stands for the same number wherever it is.
    found = read_segment(write(tmp_path, (*OLDER[:5], *OLDER[5:][::-1]), monkeypatch))
    assert set(found.absent) == set(NEWER)
    there = [COLUMNS.index(name) for name in OLDER]
    np.testing.assert_array_equal(found.rows[:, there], rows()[:, there])
    assert np.all(found.rows[:, COLUMNS.index("slowed")] == 0.0)
    assert np.all(np.isnan(found.rows[:, COLUMNS.index("wear_trend")]))


def test_an_older_log_is_shown_and_exported_and_says_so(
    folder: Path, monkeypatch: pytest.MonkeyPatch, counterflex: Any
) -> None:
    write(folder, OLDER, monkeypatch)
    shown = counterflex("log", "show", "log")
    assert (shown.status, shown.err) == (0, "")
    assert "written by older code (counterflex 0.0.7): 5 of" in shown.out
    assert "force stale" in shown.out
    found = json.loads(counterflex("log", "show", "log", "--json").out)
    assert found["runs"][0]["answered"] == CYCLES
    assert counterflex("log", "export", "log", "--csv", "run.csv").status == 0
    table = polars.read_csv(folder / "run.csv", infer_schema_length=None)
    assert table.columns == ["run", *COLUMNS]
    assert all(table[name].null_count() == CYCLES for name in NEWER)


def test_what_needs_all_columns_is_refused_with_the_version(
    folder: Path, monkeypatch: pytest.MonkeyPatch, refused: Any
) -> None:
    file = write(folder, OLDER, monkeypatch, cut=True)
    before = file.read_bytes()
    with (folder / "cell.toml").open("a", encoding="utf-8") as stream:
        stream.write('\n[online]\nforce = "measured"\nalong_feed = true\n')
    for words in (("replay", "log", "--cell", "cell.toml"), ("repair", "log")):
        said = refused("log", *words)
        for part in ("older code", f"{len(OLDER)} columns of counterflex 0.0.7", "log export", "use the version"):
            assert part in said
    assert file.read_bytes() == before
    with pytest.raises(FileFormatError, match="older code"):
        read_log(folder / "log")


@pytest.mark.parametrize(
    "columns", [(*COLUMNS, "of_tomorrow"), tuple(c for c in COLUMNS if c != "cycle")], ids=["newer", "first"]
)
def test_columns_that_mean_something_else_are_refused_in_one_line(
    folder: Path, columns: tuple[str, ...], monkeypatch: pytest.MonkeyPatch, refused: Any
) -> None:
    write(folder, columns, monkeypatch)
    said = refused("log", "show", "log")
    assert "another version" in said
    assert "counterflex 0.0.7" in said
    assert "'of_tomorrow'" in said or "'cycle'" in said


def test_the_hash_of_an_older_loop_is_not_taken_for_other_numbers() -> None:
    """Logs that say no layout of their states were written by a loop that was hashed in another order."""
    (older,) = job._notes({"loop_sha256": "0" * 64}, {}, "1" * 64, compensated=True)
    assert "not known beforehand" in older
    (other,) = job._notes({"loop_sha256": "0" * 64, LAYOUT: [["state", "f8", 3]]}, {}, "1" * 64, compensated=True)
    assert "other numbers" in other
