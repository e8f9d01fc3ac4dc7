"""The angle of the spindle as a choice: what is read, what turns with it, the best of several, what is refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from counterflex.app.placement import placement
from counterflex.app.placement.region import Mounting, Wish
from counterflex.cli.arguments import body_angles
from counterflex.core.errors import InputError
from counterflex.core.units import DEG
from counterflex.files.cell.cell import read_cell

CELL = Path(__file__).resolve().parents[3] / "examples" / "cells" / "kr300_d16_small.toml"
SMALL = Path(__file__).parents[2] / "data" / "cells" / "small.toml"
SHORT = "G21 G17 G90\nM6 T1\nM3 S13000\nG0 X-12 Y15 Z42\nG0 Z38\nG1 X8 F1500\nG0 Z42\nM5\nM2\n"
HERE = Wish((1300.0, 1440.0, -80.0, 80.0, 960.0, 1040.0), (-30.0, 30.0))
"""About the present place: in all of it the program can be run."""


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


@pytest.mark.long
def test_the_best_angle_is_that_of_a_search_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("counterflex.plan.placement.search.POPULATION", 8)
    program, made = tmp_path / "part.ngc", Mounting("tcp", "b_deg", (75.0,))
    program.write_text(SHORT, encoding="ascii")
    few: dict[str, Any] = {"count": 8, "wish": HERE}
    both = placement.run(program, SMALL, tmp_path / "both", mounting=made, **few)
    rows = {row["angle_deg"]: row["error_um"] for row in both["mountings"]}
    assert list(rows) == [90.0, 75.0]
    (tmp_path / "cell.toml").write_text(SMALL.read_text().replace("\nb_deg = 90", "\nb_deg = 75"), encoding="utf-8")
    alone = {
        90.0: placement.run(program, SMALL, tmp_path / "own", **few),
        75.0: placement.run(program, tmp_path / "cell.toml", tmp_path / "turned", **few),
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
