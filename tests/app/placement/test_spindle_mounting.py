"""The angle of the spindle as a choice: what is read, what turns with it, the best of several, what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from counterflex.app.placement import placement
from counterflex.app.placement.spindle_mounting import Mounting
from counterflex.cli.arguments import body_angles
from counterflex.core.errors import InputError
from counterflex.core.units import DEG
from counterflex.files.cell.cell import read_cell

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
CELL, GROOVE = EXAMPLES / "cells" / "kr300_d16_small.toml", EXAMPLES / "programs" / "groove.ngc"


def test_the_spindle_turns_with_all_beyond_it() -> None:
    """About y of the flange by -35 deg: the tool, square to the flange's axis before, is at 55 deg to it."""
    cell = read_cell(CELL)
    made = Mounting("spindle", "b_deg", (-35.0,))
    assert made.present_deg(cell) == 0.0
    turned = made.cell(cell, -35.0).chain.T_flange_tcp
    before = cell.chain.T_flange_tcp
    assert before[2, 2] == pytest.approx(np.cos(90.0 * DEG), abs=1e-12)
    assert turned[2, 2] == pytest.approx(np.cos(55.0 * DEG))
    spindle = np.array([0.0, 0.0, 0.08])  # its body: 30 and 50 mm from the flange
    arms = [np.linalg.norm(T[:3, 3] - spindle) for T in (before, turned)]
    assert arms[0] == pytest.approx(arms[1])


def test_the_best_angle_is_that_of_a_search_of_its_own(tmp_path: Path) -> None:
    made = Mounting("tcp", "b_deg", (75.0,))
    both = placement.run(GROOVE, CELL, tmp_path / "both", count=64, mounting=made)
    rows = {row["angle_deg"]: row["error_um"] for row in both["mountings"]}
    assert list(rows) == [90.0, 75.0]
    (tmp_path / "cell.toml").write_text(CELL.read_text().replace("\nb_deg = 90", "\nb_deg = 75"), encoding="utf-8")
    alone = {
        90.0: placement.run(GROOVE, CELL, tmp_path / "own", count=64),
        75.0: placement.run(GROOVE, tmp_path / "cell.toml", tmp_path / "turned", count=64),
    }
    for angle, summary in alone.items():
        assert rows[angle] == summary["chosen"]["error_um"]
    best = min(rows, key=lambda angle: rows[angle])
    assert both["mounting"]["chosen_deg"] == best
    assert both["present"] == alone[90.0]["present"]
    assert read_cell(tmp_path / "both" / "cell.toml").tables.tcp.b_deg == best
    assert json.loads((tmp_path / "both" / "summary.json").read_text())["mountings"] == both["mountings"]


@pytest.mark.parametrize("text", ["", "spindle", "spindle.b_deg", "spindle.b_deg=", "spindle.x_mm=3", "spindle.b_deg=a",
                                  "spindle.b_deg=400", "spindle.b_deg=nan"])  # fmt: skip
def test_what_says_no_angle_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="no angles of a body") as caught:
        body_angles(text, "--mounting")
    assert "--mounting" in str(caught.value)


def test_angles_are_read() -> None:
    assert body_angles("spindle.b_deg=0,-35", "--mounting") == ("spindle", "b_deg", (0.0, -35.0))


def test_a_body_that_is_not_there_is_refused_with_those_that_are() -> None:
    with pytest.raises(InputError, match="no such body") as caught:
        Mounting("spindel", "b_deg", (3.0,)).present_deg(read_cell(CELL))
    assert "spindle" in str(caught.value)
