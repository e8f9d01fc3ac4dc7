"""First motion of every program that is written, run by a second model of the maker's controller."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import controller_arms as judge
from controller_arms import Arm, Matrix
from counterflex.app.compensation.compensate import compensate
from counterflex.core.errors import ReachError
from counterflex.files.cell.cell import read_cell
from counterflex.robot.model import catalog

PROGRAM = "G21 G90 G17\nT1 M6\nM3 S8000\nG0 X3 Y2 Z20\nG0 X5 Y4 Z16\nG1 X10 Y6 Z15 F1200\nG1 X14\nM5\nM30\n"
CELLS = 200
TIP_MM = 1e-3
"""What arrives: 1 um. Axes have five decimals of a degree, which is 0.3 um at 3 m."""

MAKERS: dict[str, tuple[str, str, Callable[[Arm, Matrix], Matrix], Callable[[Any], judge.Start]]] = {
    "kuka": ("krl", "base", judge.kuka, judge.krl_start),
    "abb": ("rapid", "base", judge.abb, judge.rapid_start),
    "abb_rod": ("rapid", "base", partial(judge.abb, rod=True), judge.rapid_start),
    "fanuc": ("fanuc", "axis 2", judge.fanuc, judge.fanuc_start),
    "staubli": ("val3", "axis 2", judge.staubli, judge.val3_start),
}
GEOMETRY = {
    "kuka": ("[0, -90, 0, 0, 0, 0]", "[-1, 1, 1, -1, 1, -1]"),
    "abb": ("[0, 0, -90, 0, 0, 0]", "[1, 1, 1, 1, 1, 1]"),
    "fanuc": ("[0, 0, -90, 0, 0, -180]", "[1, 1, -1, -1, -1, -1]"),
    "staubli": ("[0, 0, 0, 0, 0, 0]", "[1, 1, 1, 1, 1, 1]"),
}


def random_arm(draw: np.random.Generator) -> Arm:
    """An arm of the size of milling robots."""
    return Arm(
        *np.round(draw.uniform([400, 100, -60, 800, -60, 800, 100], [1000, 450, 60, 1300, 240, 1400, 300]), 1).tolist()
    )


def catalogue_arm(name: str) -> Arm:
    """Dimensions of a robot of the catalogue, as its data sheet has them."""
    g = catalog.entry(name).geometry
    return Arm(g.c1_mm, g.a1_mm, g.b_mm, g.c2_mm, -g.a2_mm, g.c3_mm, g.c4_mm)


def robot_text(arm: Arm, maker: str) -> str:
    """An own robot in a cell file, in the maker's signs and zeros."""
    offsets, signs = GEOMETRY[maker.removesuffix("_rod")]
    rod = '[robot.controller_axes]\naxis_3_from = "horizontal"\n' if maker == "abb_rod" else ""
    return (
        f"[robot.geometry]\na1_mm = {arm.reach}\na2_mm = {-arm.rise}\nb_mm = {arm.side}\nc1_mm = {arm.base}\n"
        f"c2_mm = {arm.upper}\nc3_mm = {arm.fore}\nc4_mm = {arm.hand}\noffsets_deg = {offsets}\nsigns = {signs}\n"
        f"limits_deg = [{', '.join(['[-358, 358]'] * 6)}]\n{rod}"
    )


def cell_text(robot: str, arm: Arm, language: str, draw: np.random.Generator) -> str:
    """A cell around a robot: part, tool and posture at random, within reach."""
    reach = draw.uniform(0.45, 0.7) * (arm.upper + arm.fore)
    angle = np.radians(draw.uniform(-70, 70))
    x, y = (arm.reach + reach) * np.array([np.cos(angle), np.sin(angle)])
    part = np.round([x, y, draw.uniform(0.2, 0.8) * arm.base, *draw.uniform([-180, -8, -8], [180, 8, 8])], 3)
    tcp = np.round(draw.uniform([-80, -80, 100, -30, -20, -20], [80, 80, 250, 30, 20, 20]), 3)
    lines = [
        'format = "counterflex-cell"', "version = 1", 'name = "judged"', robot,
        *(f'[[robot.elastic]]\nsegment = "axis{i}"\nrz_urad_per_knm = 500\nsource = "test"' for i in range(1, 7)),
        "[tcp]", *(f"{key} = {value}" for key, value in zip(KEYS, tcp, strict=True)),
        "[part]", *(f"{key} = {value}" for key, value in zip(KEYS, part, strict=True)), 'measured_with = "external"',
        "[part.stock]\nbox_min_mm = [0, 0, 0]\nbox_max_mm = [20, 20, 10]\ncell_mm = 1",
        f"[posture]\nrotation_about_tool_deg = {draw.uniform(-20, 20):.3f}",
        '[[tools]]\nnumber = 1\nname = "mill"\ndiameter_mm = 8\nflutes = 2\nflute_length_mm = 20',
        '[material]\nname = "EN AW-7075"\nlaw = "kienzle"\nkc11_n_mm2 = 780\nmc = 0.25\nkr_over_kc = 0.35\nmr = 0.25\n'
        'ka_over_kc = 0.15\nma = 0.25\nsource = "test"',
        f"[controller.spindle.{language}]\nclockwise = []\noff = []\ntool_change = []",
    ]  # fmt: skip
    return "\n".join([*lines, ""])


KEYS = ("x_mm", "y_mm", "z_mm", "a_deg", "b_deg", "c_deg")


def frame_of(table: Any) -> Matrix:
    """(4, 4) mm of a table of the cell file: intrinsic z-y'-x''."""
    return judge.shift(table.x_mm, table.y_mm, table.z_mm) @ judge.zyx(table.a_deg, table.b_deg, table.c_deg)


def check(folder: Path, robot: str, arm: Arm, maker: str, draw: np.random.Generator) -> bool:
    """Write a program for a random cell and run its first motion; False where the cell is out of reach."""
    language, world, forward, read = MAKERS[maker]
    file, program = folder / "cell.toml", folder / "job.ngc"
    file.write_text(cell_text(robot, arm, language, draw), encoding="utf-8")
    program.write_text(PROGRAM, encoding="ascii")
    cell = read_cell(file)
    try:
        done = compensate(program, cell, language=language, predict=False)
    except ReachError:
        return False
    start = read(done.files)
    T_plate_world = judge.shift(z=arm.base if world == "axis 2" else 0.0)
    T_plate_part, T_flange_tcp = frame_of(cell.tables.part), frame_of(cell.tables.tcp)
    if start.T_flange_tool is not None:
        np.testing.assert_allclose(start.T_flange_tool, T_flange_tcp, atol=6e-5)
    if start.T_world_part is not None:
        np.testing.assert_allclose(T_plate_world @ start.T_world_part, T_plate_part, atol=6e-5)
    reached = T_plate_world @ forward(arm, start.axes) @ T_flange_tcp
    commanded = T_plate_part @ start.T_part_tcp
    off = float(np.linalg.norm(reached[:3, 3] - commanded[:3, 3]))
    assert off < TIP_MM, f"{maker}: the tip is {off:.6f} mm from the commanded start"
    np.testing.assert_allclose(reached[:3, :3], commanded[:3, :3], atol=2e-6)
    if start.points is not None:
        assert np.all(np.sum(start.points[1:] * start.points[:-1], axis=1) > 0.0)
    return True


@pytest.mark.parametrize("maker", MAKERS)
def test_the_first_motion_of_own_robots_arrives(maker: str, tmp_path: Path) -> None:
    draw = np.random.default_rng(20)
    done = 0
    for _ in range(4 * CELLS):
        arm = random_arm(draw)
        done += check(tmp_path, robot_text(arm, maker), arm, maker, draw)
        if done == CELLS:
            break
    assert done == CELLS


@pytest.mark.parametrize("name", [name for name in catalog.names() if name.split("_")[0] in GEOMETRY])
def test_the_first_motion_of_every_catalogue_robot_arrives(name: str, tmp_path: Path) -> None:
    draw = np.random.default_rng(sum(name.encode()))
    arm = catalogue_arm(name)
    done = sum(check(tmp_path, f'[robot]\ncatalog = "{name}"', arm, name.split("_")[0], draw) for _ in range(25))
    assert done >= 5
