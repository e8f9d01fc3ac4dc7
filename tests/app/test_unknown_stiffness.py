"""A robot without stiffness says so, in `cell check` and in a compensated program, instead of passing for rigid."""

from __future__ import annotations

from pathlib import Path

import pytest

from counterflex.app.compensation.compensate import compensate
from counterflex.app.questions import check_cell
from counterflex.app.unknown_stiffness import rigid_axes
from counterflex.files.cell.cell import read_cell

EXAMPLES = Path(__file__).parents[2] / "examples"
KNOWN = "kuka_kr300_r2500_ultra"


@pytest.fixture
def unknown(tmp_path: Path) -> Path:
    """The small cell with a robot of the same geometry family of which no stiffness is published."""
    text = (EXAMPLES / "cells" / "kr300_d16_small.toml").read_text(encoding="utf-8")
    file = tmp_path / "cell.toml"
    file.write_text(text.replace(KNOWN, "kuka_kr270_r2700_ultra"), encoding="utf-8")
    return file


def said(warnings: list[str]) -> list[str]:
    return [one for one in warnings if "no stiffness is known of A1, A2, A3, A4, A5, A6" in one]


def test_every_axis_of_a_robot_with_published_stiffness_is_elastic() -> None:
    cell = EXAMPLES / "cells" / "kr300_d16_small.toml"
    assert rigid_axes(read_cell(cell).chain) == []
    assert not any("no stiffness" in one for one in check_cell(str(cell))["warnings"])


def test_cell_check_and_program_say_what_is_missing(unknown: Path) -> None:
    found = said(check_cell(str(unknown))["warnings"])
    assert len(found) == 1
    assert "counterflex identify stiffness" in found[0]
    summary = compensate(EXAMPLES / "programs" / "groove.ngc", read_cell(unknown), predict=False).summary
    assert said(summary["written"]["warnings"]) == found
