"""The same cut on a rail, on a positioner and without either: the same plan and part, the values in the program."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from counterflex.app.coarse_bodies import coarse_bodies
from counterflex.app.compensation.compensate import compensate
from counterflex.app.inputs import read_job
from counterflex.app.proof import simulate
from counterflex.app.proof.truth import truth_of
from counterflex.core.errors import ReachError
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.geometry import pose, rotation
from counterflex.twin.truth.family import FAMILIES

SOURCE = Path(__file__).parents[1] / "data" / "cells" / "small.toml"
SHORT = "G21 G17 G90\nM6 T1\nM3 S13000\nG0 X-12 Y15 Z42\nG0 Z38\nG1 X8 F1500\nG0 Z42\nM5\nM2\n"
RAIL = '[[external_axes]]\nname = "E1"\nkind = "linear"\ncarries = "robot"\ndirection = [0, 1, 0]\n'
TABLE = (
    '[[external_axes]]\nname = "E2"\nkind = "turning"\ncarries = "part"\ndirection = [0, 0, 1]\n'
    "origin_mm = [1500, 200, 0]\n"
)
FENCE = '\n[[cell.body]]\nname = "fence"\nshape = "box"\nx_mm = -1500\nsize_mm = [20, 4000, 2000]\n'


def arranged(folder: Path, name: str, axes: str, T_zero_base: np.ndarray) -> Cell:
    """The cell with external axes, its part given where it stands at their zeros."""
    still = read_cell(SOURCE).part
    T = T_zero_base @ still.matrix()
    z, y, x = np.degrees(rotation.to_zyx(T[:3, :3]))
    text = SOURCE.read_text(encoding="utf-8")
    values = dict(zip(("x_mm", "y_mm", "z_mm", "a_deg", "b_deg", "c_deg"), [*(T[:3, 3] * 1e3), z, y, x], strict=True))
    head, part = text.split("[part]\n", 1)
    own, rest = part.split("\n\n", 1)
    kept = [line for line in own.splitlines() if line.split(" ")[0] not in values]
    lines = [f"{key} = {value:.9f}" for key, value in values.items()]
    file = folder / f"{name}.toml"
    file.write_text(head + "[part]\n" + "\n".join([*lines, *kept]) + "\n\n" + rest + "\n" + axes, encoding="utf-8")
    return read_cell(file)


def arrangements(folder: Path) -> dict[str, Cell]:
    rail = RAIL + "at_mm = 700\nmin_mm = 0\nmax_mm = 3000\n"
    table = TABLE + "at_deg = 40\nmin_deg = -180\nmax_deg = 180\n"
    centre = np.array([1.5, 0.2, 0.0])
    R = rotation.about_z(np.radians(40.0))
    return {
        "alone": read_cell(SOURCE),
        "rail": arranged(folder, "rail", rail, pose.make(None, np.array([0.0, 0.7, 0.0]))),
        "table": arranged(folder, "table", table, pose.inverse(pose.make(R, centre - R @ centre))),
    }


def test_the_same_cut_gives_the_same_part(tmp_path: Path) -> None:
    (tmp_path / "part.ngc").write_text(SHORT, encoding="ascii")
    cells = arrangements(tmp_path)
    assert np.linalg.norm(cells["rail"].part.matrix() - cells["alone"].part.matrix()) > 0.1
    made = {}
    for name, cell in cells.items():
        done = compensate(tmp_path / "part.ngc", cell, predict=False)
        (tmp_path / f"{name}.ngc").write_text(next(iter(done.files.values())), encoding="utf-8")
        record = simulate.machine(read_job(tmp_path / f"{name}.ngc", cell), cell, truth_of(cell, 7, FAMILIES["wide"]))
        made[name] = (done.plan.correction_part, record.stock.z)
    for name in ("rail", "table"):
        np.testing.assert_allclose(made[name][0], made["alone"][0], atol=1e-8)
        assert np.abs(made[name][1] - made["alone"][1]).max() < 2e-6
    assert np.abs(made["alone"][0]).max() > 1e-4


@pytest.mark.parametrize(
    ("name", "krl", "rapid"), [("rail", "E1 700", "[700.00000,9E9,"), ("table", "E2 40", "[9E9,40.00000,")]
)
def test_values_stand_in_the_program(tmp_path: Path, name: str, krl: str, rapid: str) -> None:
    (tmp_path / "part.ngc").write_text(SHORT, encoding="ascii")
    cell = arrangements(tmp_path)[name]
    files = compensate(tmp_path / "part.ngc", cell, predict=False, language="krl").files
    start = next(line for text in files.values() for line in text.splitlines() if "XSTART={" in line)
    assert krl in start
    text = "".join(compensate(tmp_path / "part.ngc", cell, predict=False, language="rapid").files.values())
    moves = [line for line in text.splitlines() if "Move" in line and "[[" in line]
    assert moves
    assert all(rapid in line for line in moves)


def test_what_stands_on_the_floor_stays_there_when_the_robot_rides_away(tmp_path: Path) -> None:
    (tmp_path / "part.ngc").write_text(SHORT, encoding="ascii")
    still = read_cell(SOURCE)
    ridden = arranged(
        tmp_path,
        "rail",
        RAIL + "at_mm = 700\nmin_mm = 0\nmax_mm = 3000\n" + FENCE,
        pose.make(None, np.array([0, 0.7, 0])),
    )
    bodies = {body.name: body for body in coarse_bodies(read_job(tmp_path / "part.ngc", still), ridden, still.stock())}
    np.testing.assert_allclose(bodies["fence"].T_frame_body[:3, 3], [-1.5, -0.7, 0.0], atol=1e-12)
    assert np.abs(bodies["foot"].T_frame_body[:2, 3]).max() < 0.5


def test_a_value_out_of_reach_is_named(tmp_path: Path) -> None:
    (tmp_path / "part.ngc").write_text(SHORT, encoding="ascii")
    far = arranged(tmp_path, "far", RAIL + "at_mm = 2900\nmin_mm = 0\nmax_mm = 3000\n", np.eye(4))
    with pytest.raises(ReachError):
        compensate(tmp_path / "part.ngc", far, predict=False)
