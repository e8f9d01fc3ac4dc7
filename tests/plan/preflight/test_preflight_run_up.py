"""Time that a spindle has to come to its speed, in closed form; waits for a person are long enough."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from counterflex.app import preflight as job
from counterflex.files.cell.cell import read_cell

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
HEAD = "G17 G54 G90 G94\nG21\nM6 T1\nG43 H1\nM3 S9000\nG4 P30\nG0 X20 Y15 Z60\nG0 Z40\n"
CUT = "G1 Z38 F60\nG0 Z60\nM5\nM30\n"


def row_of(file: Path) -> dict[str, Any]:
    checks = job.check(file, read_cell(EXAMPLES / "cells" / "kr300_d16_small.toml")).summary["checks"]
    found: dict[str, Any] = next(row for row in checks if row["check"] == "spindle run-up")
    return found


@pytest.mark.parametrize(("between", "ms"), [("S13000\nG4 P1.5\n", 1500.0), ("S13000\nG1 Z41 F60\nG1 Z40\n", 2000.0)])
def test_the_time_to_the_cut(between: str, ms: float, tmp_path: Path) -> None:
    file = tmp_path / "part.ngc"
    file.write_text(HEAD + between + CUT)
    row = row_of(file)
    assert (row["verdict"], row["missing"]) == ("not looked at", "process_limits.spindle_run_up_s")
    assert row["value"] == pytest.approx(ms, abs=1.0)


@pytest.mark.parametrize("between", ["S13000\nM0\n", "M5\nM3 S13000\nM1\nG4 P0.1\n"])
def test_a_wait_for_a_person_is_long_enough(between: str, tmp_path: Path) -> None:
    file = tmp_path / "part.ngc"
    file.write_text(HEAD.replace("G4 P30\n", "M0\n") + between + CUT)
    assert row_of(file)["verdict"] == "ok"


@pytest.mark.parametrize("name", ["groove.src", "groove.mod"])
def test_robot_programs_wait_for_the_person_who_starts_the_spindle(name: str) -> None:
    assert row_of(EXAMPLES / "programs" / name)["verdict"] == "ok"
