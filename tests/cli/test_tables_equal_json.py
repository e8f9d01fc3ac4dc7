"""Tables that a person reads hold the numbers of the JSON of the same command, row by row."""

from __future__ import annotations

import json
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from counterflex.app.questions import CellCheck
from counterflex.app.run.log_summary import LogSummary, process_parts
from counterflex.cli.commands.log import INCOMPLETE
from counterflex.cli.output import keep_folders, keep_inputs
from counterflex.core.errors import InputError
from counterflex.report.glossary import expected_text

ROBOT = "kuka_kr300_r2500_ultra"
JOINTS = "5,-95,110,20,-35,40"


def answers(counterflex: Any, *words: Any) -> tuple[dict[str, Any], list[str]]:
    """JSON and lines of the table of one command."""
    made, shown = counterflex(*words, "--json"), counterflex(*words)
    assert (made.status, shown.status) == (0, 0)
    found: dict[str, Any] = json.loads(made.out)
    return found, shown.out.splitlines()


def row_of(lines: list[str], first: str) -> list[str]:
    """Cells behind the first one of a row of a table."""
    rows = [[cell.strip() for cell in line.split("│")] for line in lines]
    (found,) = [row for row in rows if len(row) > 1 and row[0] == first]
    return found[1:]


@pytest.mark.parametrize("force", ["9000,-6000,3000", "-9000,6000,-3000"])
def test_the_table_of_a_deflection(counterflex: Any, force: str) -> None:
    """Each row is its own: linear, nonlinear and sag; shares in per cent; signs as in the JSON."""
    answer, lines = answers(counterflex, "deflection", ROBOT, "--joints-deg", JOINTS, "--force-n", force)
    for name, key in (("linear", "linear"), ("nonlinear", "nonlinear"), ("own weight (sag)", "gravity_sag")):
        one = answer[key]
        expected = [*one["dx_dy_dz_um"], one["length_um"], *one["rx_ry_rz_urad"]]
        assert [float(word) for word in row_of(lines, name)] == pytest.approx(expected, abs=5.1e-3)
    assert answer["linear"]["length_um"] != pytest.approx(answer["nonlinear"]["length_um"], abs=0.011)
    for row in answer["shares"]:
        words = row_of(lines, row["segment"])
        assert [float(word) for word in words[:3]] == pytest.approx(row["dx_dy_dz_um"], abs=0.051)
        assert words[3] == f"{100.0 * row['share']:.1f}%"
    assert f"Linear and nonlinear differ by {answer['gap_um']:.3f} um." in "\n".join(lines)


def test_the_table_of_postures_names_the_smallest_margin(counterflex: Any) -> None:
    answer, _ = answers(counterflex, "pose", ROBOT, "--joints-deg", JOINTS)
    tcp = answer["tcp_in_base"]
    xyz, abc = (",".join(str(v) for v in list(tcp.values())[k : k + 3]) for k in (0, 3))
    answer, lines = answers(counterflex, "pose", ROBOT, f"--xyz-mm={xyz}", f"--abc-deg={abc}")
    assert len(answer["solutions"]) > 1
    rows = [[cell.strip() for cell in line.split("│")] for line in lines if line.count("│") == 8]
    for one, (branch, *words) in zip(answer["solutions"], rows, strict=True):
        assert branch == one["branch"]
        assert [float(word) for word in words[:6]] == pytest.approx(one["joints_deg"], abs=1e-4)
        assert float(words[6]) == pytest.approx(min(one["margins"].values()), abs=0.006)
        assert float(words[7]) == pytest.approx(one["wrist_deg"], abs=0.006)


BEFORE = "G21 G90 F600 M3 S1000\nG0 X0 Y0 Z0\n" + "".join(f"G1 X{k} Y{k % 2}\n" for k in range(1, 31)) + "M2\n"
MOVED = {4: 0.3, 9: 0.05, 17: 0.9, 23: 0.2}
AFTER = re.sub(r"G1 X(\d+) Y(\d)", lambda m: f"G1 X{m[1]} Y{int(m[2]) + MOVED.get(int(m[1]), 0.001):.3f}", BEFORE)


@pytest.mark.parametrize("by", ["change", "line"])
def test_the_table_of_changes(counterflex: Any, tmp_path: Path, by: str) -> None:
    """Largest first, or by line; what is left out is counted."""
    old, new = tmp_path / "old.ngc", tmp_path / "new.ngc"
    old.write_text(BEFORE)
    new.write_text(AFTER)
    made = json.loads(counterflex("diff", str(old), str(new), "--by", by, "--json").out)
    off = [np.linalg.norm([row[f"{axis}_um"] for axis in "xyz"]) for row in made["changes"]]
    lines = [row["line_before"] for row in made["changes"]]
    if by == "change":
        assert off == sorted(off, reverse=True)
        assert lines != sorted(lines)
        assert lines[0] == 17 + 2
    else:
        assert lines == sorted(lines)
    shown = counterflex("diff", str(old), str(new), "--by", by, "--most", "7").out
    table = [line.split() for line in shown.splitlines() if re.match(r"\s*\d+ │\s+\d+ │", line)]
    assert [int(row[0]) for row in table] == lines[:7]
    assert f"{made['changed']} of {made['motions_before']} motions changed, {len(off) - 7} not shown (--most)" in shown
    assert f"largest {made['largest_um']} um in line {made['largest_line']}" in shown


@pytest.mark.parametrize(("share", "least"), [(0.031, 0.62), (0.5, 0.4)])
def test_slowed_cycles_are_shown_in_per_cent(share: float, least: float) -> None:
    found: dict[str, Any] = {
        "events": [],
        "event_counts": {},
        "wear": None,
        "slowed_share": share,
        "least_speed": least,
    }
    (line,) = process_parts(found)
    assert f"slowed in {100 * share:.1f} % of the cycles, down to {100 * least:.0f} %" in str(line)


@pytest.mark.parametrize("incomplete", [True, False])
@pytest.mark.parametrize("words", [(), ("--json",)])
def test_a_log_with_something_missing_ends_otherwise_than_a_whole_one(
    counterflex: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, incomplete: bool, words: tuple[str, ...]
) -> None:
    """As tables and as JSON; what is said of it is printed either way."""
    answer = {
        "incomplete": incomplete,
        "runs": [],
        "segments": [],
        "lines": ["a line"],
        "cut": [],
        "damage": [],
        "unread": [],
    }
    monkeypatch.setattr("counterflex.app.run.log.show", lambda *_, **__: LogSummary("log", answer))
    ended = counterflex("log", "show", str(tmp_path), *words)
    assert ended.status == (INCOMPLETE if incomplete else 0)
    assert ("a line" in ended.out) == (not words)


def logged_run(changes: int, incidents: int, actions: int) -> dict[str, Any]:
    """Figures of a run, each another number; more rows than a table shows are in all lists but that of incidents."""

    def listed(count: int, **more: Any) -> list[dict[str, Any]]:
        return [{"cycle": 100 + k, "time_s": 0.5 * k, **more} for k in range(count)]

    return {
        "run": 3, "answered": 11, "waited": 12, "telegrams_lost": 13, "records_lost": 14, "seconds": 15.0,
        "largest_correction_um": 16.0, "largest_step_um": 17.0,
        "reply_us": {"p50": 21.0, "p99": 22.0, "p99.9": 23.0, "max": None},
        "states": {"idle": {"cycles": 31, "seconds": 32.0}, "on_hold": {"cycles": 33, "seconds": 34.0}},
        "sources": {"plan": 41, "tracker": 42}, "force_sensors_changes": [], "sources_changes": [],
        "changes": listed(changes, **{"from": "not_armed", "to": "on_hold", "cause": "force_stale"}),
        "incidents": [{**one, "number": k + 1, "state": "on_hold", "cause": "force_stale", "before": "not_armed"}
                      for k, one in enumerate(listed(min(incidents, 25)))],
        "incidents_total": incidents,
        "operator_actions": [{"time_s": None if k else 2.0, "who": "anna", "from": "::1", "action": "stop",
                              "done": k == 0, "refused": "not armed"} for k in range(actions)],
        "events": [], "event_counts": {}, "wear": None, "slowed_share": 0.0, "least_speed": 1.0,
        "causes": {"force_stale": 51, "plan_left": 52}, "not_closed": None,
    }  # fmt: skip


@pytest.mark.parametrize(("changes", "incidents", "actions"), [(1, 1, 2), (23, 45, 21)])
def test_the_tables_of_a_log_hold_each_figure_in_its_column(
    counterflex: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, changes: int, incidents: int, actions: int
) -> None:
    """Of long lists the first twenty are shown, and what is left out is counted from the whole."""
    answer = {"incomplete": False, "runs": [logged_run(changes, incidents, actions)], "segments": [1, 2], "lines": [],
              "cut": [], "damage": [], "unread": []}  # fmt: skip
    monkeypatch.setattr("counterflex.app.run.log.show", lambda *_, **__: LogSummary("log", answer))
    out = counterflex("log", "show", str(tmp_path)).out
    rows = [[cell.strip() for cell in line.split("│")] for line in out.splitlines()]
    for row in (
        ["11", "12", "13", "14", "15", "16", "17"], ["21", "22", "23", "-"], ["idle", "31", "32"],
        ["on hold", "33", "34"], ["plan", "41"], ["tracker", "42"],
        ["100", "0.000", "not armed", "on hold", "force stale"],
        ["1", "100", "0.000", "on hold", "force stale", "not armed"], ["2.000", "anna", "::1", "stop", "done"],
        ["-", "anna", "::1", "stop", "not armed"],
    ):  # fmt: skip
        assert row in rows, row
    left = [int(word) for word in re.findall(r"and (\d+) more; --json lists them", out)]
    assert left == [count - 20 for count in (changes, incidents, actions) if count > 20]
    assert "segments: 2" in out
    assert "cycles with a cause: force stale 51, plan left 52" in out


@pytest.mark.parametrize(("missing", "skipped"), [(0, 0), (30, 12)])
def test_a_replay_says_how_many_of_all_cycles_were_compared(
    counterflex: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, missing: int, skipped: int
) -> None:
    """Of the recorded and the missing ones together; what was not computed is said apart."""
    lost = SimpleNamespace(shown=dict, damage=(), empty=(), cut=(), incomplete=False)
    replayed = SimpleNamespace(
        records=200, compared=200 - skipped, skipped=skipped, missing=missing, proved=not missing, difference=None,
        run=0, begun=[], lost=lost, gaps=[SimpleNamespace(after=70, missing=missing)] if missing else [], notes=[],
    )  # fmt: skip
    monkeypatch.setattr("counterflex.app.run.log.replay", lambda *_, **__: replayed)
    (tmp_path / "cell.toml").write_text("")
    ended = counterflex("log", "replay", str(tmp_path), "--cell", str(tmp_path / "cell.toml"))
    assert f"{200 - skipped} of {200 + missing} cycles bit for bit the same" in ended.out
    assert ended.status == (INCOMPLETE if missing else 0)
    if missing:
        assert "30 cycles missing after cycle 70" in ended.out
        assert ended.out.rstrip().endswith("30 cycles missing, 12 not computed: after a gap")


def test_an_expected_length_is_its_median_with_the_range_behind_it() -> None:
    assert expected_text({"expected_um": [950.0, 610.4, 1480.0]}) == "950 (610 to 1480)"
    assert expected_text({"expected_um": None}) == "not counted"


@pytest.mark.parametrize("which", [0, 1, 2])
def test_results_go_into_no_folder_that_is_read(tmp_path: Path, which: int) -> None:
    folders = [tmp_path / name for name in ("a", "b", "c")]
    for folder in folders:
        folder.mkdir()
    keep_folders(tmp_path / "d", *folders)
    with pytest.raises(InputError, match="would replace the summary"):
        keep_folders(folders[which] / ".." / folders[which].name, *folders)


def test_values_of_an_identification_are_counted_by_what_saw_them(
    counterflex: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Determined and not determined make all of them."""
    seen = ["determined"] * 4 + ["partly"] * 2 + ["prior"] * 3
    entries = [
        {"recipe": name, "date": "-", "data": [], "holdout": "-", "values": [{"seen": word} for word in some]}
        for name, some in (("some", seen), ("none", seen[:6]), ("all", seen[6:]))
    ]
    answer = {
        "cell": "x", "mass_kg": 1.0, "segments": [], "at_corner": None, "identified": entries, "unknowns": None,
        "assumptions": [], "warnings": [],
    }  # fmt: skip
    monkeypatch.setattr("counterflex.app.questions.check_cell", lambda *_: CellCheck(answer))
    (tmp_path / "cell.toml").write_text("")
    lines = counterflex("cell", "check", str(tmp_path / "cell.toml")).out.splitlines()
    assert [row_of(lines, name)[-2:] for name in ("some", "none", "all")] == [["6", "3"], ["6", "0"], ["0", "3"]]


@pytest.mark.parametrize("kind", ["same", "link", "hard"])
def test_an_output_never_replaces_an_input_by_whatever_name(tmp_path: Path, kind: str) -> None:
    program, out = tmp_path / "part.ngc", tmp_path / "other.ngc"
    program.write_text(BEFORE)
    keep_inputs(out, program)
    if kind == "same":
        (tmp_path / "x").mkdir()
        out = tmp_path / "x" / ".." / "part.ngc"
    elif kind == "link":
        out.symlink_to(program)
    else:
        out.hardlink_to(program)
    with pytest.raises(InputError, match=r"would replace part\.ngc"):
        keep_inputs(out, program)
