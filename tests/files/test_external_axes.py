"""External axes of a cell file: where they take part and bodies, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.geometry import pose, rotation

CELL = (Path(__file__).parents[1] / "data" / "cells" / "small.toml").read_text(encoding="utf-8")
RAIL = """
[[external_axes]]
name = "E1"
kind = "linear"
carries = "robot"
direction = [0, 1, 0]
at_mm = 700
min_mm = 0
max_mm = 3000
"""
TABLE = """
[[external_axes]]
name = "E2"
kind = "turning"
carries = "part"
direction = [0, 0, 1]
origin_mm = [1500, 200, 0]
at_deg = 90
min_deg = -180
max_deg = 180
"""


def cell_with(folder: Path, text: str) -> Cell:
    (folder / "cell.toml").write_text(CELL + text, encoding="utf-8")
    return read_cell(folder / "cell.toml")


def part_in(folder: Path, text: str) -> Float:
    return cell_with(folder, text).T_base_part


def test_a_rail_takes_the_base_away_from_the_part(tmp_path: Path) -> None:
    still = part_in(tmp_path, "")
    np.testing.assert_allclose(part_in(tmp_path, RAIL), pose.make(None, np.array([0.0, -0.7, 0.0])) @ still, atol=1e-15)


def test_a_table_turns_the_part_about_its_own_axis(tmp_path: Path) -> None:
    still, turned = part_in(tmp_path, ""), part_in(tmp_path, TABLE)
    np.testing.assert_allclose(turned[:3, :3], rotation.about_z(0.5 * np.pi) @ still[:3, :3], atol=1e-15)
    centre = np.array([1.5, 0.2, 0.0])
    away, before = turned[:3, 3] - centre, still[:3, 3] - centre
    np.testing.assert_allclose(away, [-before[1], before[0], before[2]], atol=1e-15)


def test_axes_on_either_side_do_not_depend_on_their_order(tmp_path: Path) -> None:
    np.testing.assert_allclose(part_in(tmp_path, RAIL + TABLE), part_in(tmp_path, TABLE + RAIL), atol=1e-15)


def test_a_table_on_a_rail_is_carried_by_it(tmp_path: Path) -> None:
    slide = RAIL.replace('"E1"', '"E3"').replace('"robot"', '"part"')
    carried = pose.make(None, np.array([0.0, 0.7, 0.0])) @ part_in(tmp_path, TABLE)
    np.testing.assert_allclose(part_in(tmp_path, slide + TABLE), carried, atol=1e-15)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (RAIL.replace("at_mm = 700", "at_mm = 3700"), r"E1 cannot stand there: at_mm = 3700; limits 0 to 3000 mm"),
        (RAIL.replace("at_mm", "at_deg"), "E1 is linear: at_deg has no meaning; give at_mm"),
        (TABLE.replace("max_deg = 180\n", ""), "E2 is turning: max_deg is missing"),
        (RAIL.replace("[0, 1, 0]", "[0, 2, 0]"), "direction of E1 is no unit vector"),
        (TABLE.replace('"part"', '"robot"').replace("[0, 0, 1]", "[1, 0, 0]"), "E2 would tilt the robot"),
        (RAIL + RAIL, "two external axes are named E1"),
        (RAIL.replace('"E1"', '"E7"'), "name"),
        (RAIL.replace('"linear"', '"circular"'), "kind"),
        (RAIL.replace('"robot"', '"tool"'), "carries"),
        (RAIL + "speed = 3\n", "speed"),
    ],
)
def test_what_does_not_fit_is_refused(tmp_path: Path, text: str, told: str) -> None:
    with pytest.raises(FileFormatError, match=told):
        cell_with(tmp_path, text)
