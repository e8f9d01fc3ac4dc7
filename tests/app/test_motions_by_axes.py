"""Motions by axes between cuts, as controllers make them: a second model swings the arm, planted faults are found."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import controller_arms as arms
from counterflex.app import conversion, preflight as checking
from counterflex.app.compensation.compensate import compensate
from counterflex.app.robot_axes import axes_in
from counterflex.core.errors import ReachError
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.robot.kinematics.inverse import inverse_all
from counterflex.robot.model import catalog

EXAMPLES = Path(__file__).parents[2] / "examples"
SOURCE = EXAMPLES / "cells" / "kr300_d16_small.toml"
PROGRAM = (
    "G17 G21 G90 G94\nM6 T1\nM3 S13000\nG0 Z60\nG0 X-12 Y15\nG0 Z42\nG1 Z36 F3000\nG1 X20 F1500\nG0 Z60\nG0 X-12 Y45\n"
    "G0 Z42\nG1 Z36 F3000\nG1 X20 F1500\nG0 Z60\nM5\nM30\n"
)
POST = (
    '\n[[cell.body]]\nname = "post"\nshape = "box"\nframe = "base"\nx_mm = 1630\ny_mm = 0\nz_mm = 1100\n'
    "size_mm = [40, 40, 1400]\n"
)
HOME = (0.0, -90.0, 90.0, 0.0, 0.0, 0.0)
ENDINGS = {"krl": "src", "rapid": "mod", "fanuc": "ls"}
POSE = "A 180.00000,B 0.00000,C -180.00000"


def cell_of(folder: Path, more: str = "") -> Cell:
    text = SOURCE.read_text(encoding="utf-8").replace("../", f"{EXAMPLES.as_posix()}/")
    (folder / "cell.toml").write_text(text.replace("cell_mm = 0.2", "cell_mm = 0.5") + more, encoding="utf-8")
    return read_cell(folder / "cell.toml")


def program_of(folder: Path, cell: Cell, language: str, edit: Callable[[list[str]], list[str]]) -> Path:
    """The two cuts in a language, edited at the way between them."""
    (folder / "part.ngc").write_text(PROGRAM, encoding="ascii")
    conversion.run(folder / "part.ngc", cell.path, folder / language, language)
    file = folder / language / f"part.{ENDINGS[language]}"
    file.write_text("\n".join(edit(file.read_text().splitlines())) + "\n")
    return file


def between(*lines: str) -> Callable[[list[str]], list[str]]:
    """Put lines before the way to the second cut in KRL."""

    def edit(text: list[str]) -> list[str]:
        at = next(i for i, line in enumerate(text) if line.startswith("LIN {X -12.0000,Y 45.0000,Z 60"))
        return [*text[:at], *lines, *text[at:]]

    return edit


def rows_of(program: Path, cell: Cell) -> dict[str, dict[str, Any]]:
    return rows_in(checking.check(program, cell))


def rows_in(done: checking.Checked) -> dict[str, dict[str, Any]]:
    return {row["check"]: row for row in done.summary["checks"]}


def test_the_arm_swings_as_a_second_model_says(tmp_path: Path) -> None:
    """The tool centre is where a model of the maker's arm has it when all axes have gone the same share."""
    cell = cell_of(tmp_path)
    there = (35.0, -80.0, 110.0, 20.0, 30.0, -40.0)
    words = ",".join(f"A{i} {value}" for i, value in enumerate(there, start=1))
    file = program_of(tmp_path, cell, "krl", between(f"PTP {{{words}}}", f"PTP {{X -12.0,Y 45.0,Z 60.0,{POSE}}}"))
    found = checking.check(file, cell).result
    g = catalog.entry(cell.robot.name).geometry
    arm = arms.Arm(g.c1_mm, g.a1_mm, g.b_mm, g.c2_mm, -g.a2_mm, g.c3_mm, g.c4_mm)

    def pose_of(table: Any) -> arms.Matrix:
        return arms.shift(table.x_mm, table.y_mm, table.z_mm) @ arms.zyx(table.a_deg, table.b_deg, table.c_deg)

    T_flange_tcp = pose_of(cell.tables.tcp)
    for body in reversed(cell.tables.end_effector):
        T_flange_tcp = pose_of(body) @ T_flange_tcp
    T_part_base = np.linalg.inv(pose_of(cell.tables.part))
    shown = np.degrees(axes_in(cell, "krl")[0].shown(found.q))
    motions = found.path.motion
    swung = next(m for m in np.unique(motions) if np.allclose(shown[motions == m][-1], there, atol=1e-6))
    for motion in (swung, swung + 1):
        rows = np.flatnonzero(motions == motion)
        begin, end = shown[rows[0] - 1], shown[rows[-1]]
        assert len(rows) > 50
        for row in rows[::40]:
            share = (row - rows[0] + 1) / len(rows)
            axes = begin + share * (end - begin)
            T = T_part_base @ arms.kuka(arm, axes) @ T_flange_tcp
            np.testing.assert_allclose(found.path.p_part_tcp[row] * 1e3, T[:3, 3], atol=2e-3)
    straight = found.path.p_part_tcp[motions == swung]
    line = straight[0] + np.linspace(0, 1, len(straight))[:, None] * (straight[-1] - straight[0])
    assert np.linalg.norm(straight - line, axis=1).max() > 0.05


def rest(language: str) -> Callable[[list[str]], list[str]]:
    """The rest posture, in which axes 4 and 6 lie in line, by axes between the cuts."""

    def rapid(text: list[str]) -> list[str]:
        at = next(i for i, line in enumerate(text) if "[[-12.0000,45.0000,60.0000]" in line)
        move = text[at].strip()
        axes = "[[0,0,0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"  # upper arm upright, forearm level
        moves = [f"    MoveAbsJ {axes},v1000,fine,t_part\\WObj:=w_part;", f"    {move.replace('MoveL', 'MoveJ')}"]
        return [*text[:at], *moves, *text[at:]]

    def fanuc(text: list[str]) -> list[str]:
        at = next(i for i, line in enumerate(text) if "P[6]" in line and ":L" in line)
        joints = ",\n".join(f"\tJ{i} = {value} deg" for i, value in enumerate((0, 0, 0, 0, 0, 0), start=1))
        entry = f"P[99]{{\n   GP1:\n\tUF : 1, UT : 1,\n{joints}\n}};"
        end = text.index("/END")
        return [*text[:at], "   0:J P[99] 10% FINE ;", "   0:J P[6] 10% FINE ;", *text[at:end], entry, *text[end:]]

    words = ",".join(f"A{i} {value}" for i, value in enumerate(HOME, start=1))
    krl = between(f"PTP {{{words}}}", f"PTP {{X -12.0,Y 45.0,Z 60.0,{POSE}}}")
    return {"krl": krl, "rapid": rapid, "fanuc": fanuc}[language]


@pytest.mark.by_turn
@pytest.mark.parametrize("language", ENDINGS)
def test_a_rest_posture_between_cuts_is_no_singularity(tmp_path: Path, language: str) -> None:
    """Every controller goes through it by axes; and the program is compensated, whose plan keeps it."""
    cell = cell_of(tmp_path)
    file = program_of(tmp_path, cell, language, rest(language))
    rows = rows_of(file, cell)
    assert rows["motions by axes"]["verdict"] in ("ok", "not looked at")
    for check in ("wrist singularity", "joint limits", "joint speed in rapids", "reach", "joint speed at feed"):
        assert rows[check]["verdict"] == "ok", (check, rows[check])
    compensate(file, cell, predict=False)


def test_a_line_through_the_rest_posture_is_one(tmp_path: Path) -> None:
    """The same places by lines: the wrist passes its singularity, and the program is refused."""
    cell = cell_of(tmp_path)
    words = ",".join(f"A{i} {value}" for i, value in enumerate(HOME, start=1))
    to_rest = between(f"PTP {{{words}}}", f"LIN {{X -12.0,Y 45.0,Z 60.0,{POSE}}}")
    file = program_of(tmp_path, cell, "krl", to_rest)
    rows = rows_of(file, cell)
    assert "fail" in (rows["wrist singularity"]["verdict"], rows["reach"]["verdict"])
    with pytest.raises(ReachError):
        compensate(file, cell, predict=False)


@pytest.mark.long
def test_a_body_in_the_swung_arc_is_found(tmp_path: Path) -> None:
    """The line between the ends is free of it, the arc is not."""
    cell = cell_of(tmp_path, POST)
    ends = [f"LIN {{X 20.0,Y -900.0,Z 60.0,{POSE}}}", f"{{X 0.0,Y 900.0,Z 60.0,{POSE}}}"]
    check = "robot and spindle to surroundings"
    straight = rows_of(program_of(tmp_path, cell, "krl", between(ends[0], f"LIN {ends[1]}")), cell)[check]
    swung = rows_of(program_of(tmp_path, cell, "krl", between(ends[0], f"PTP {ends[1]}")), cell)[check]
    assert (straight["verdict"], swung["verdict"]) == ("ok", "fail")
    assert "post" in swung["what"]


@pytest.mark.long
def test_the_arc_is_what_the_stock_meets(tmp_path: Path) -> None:
    """By axes the tool bulges away from the robot, beyond the line between the ends."""
    cell = cell_of(tmp_path)
    low = [f"LIN {{X 20.0,Y -900.0,Z 45.0,{POSE}}}", f"{{X 0.0,Y 900.0,Z 45.0,{POSE}}}"]
    paths = {}
    for word in ("LIN", "PTP"):
        file = program_of(tmp_path, cell, "krl", between(low[0], f"{word} {low[1]}"))
        found = checking.check(file, cell).result
        paths[word] = found.path.p_part_tcp[:, 0].max()
    assert paths["PTP"] > paths["LIN"] + 0.2


def test_another_branch_that_the_program_states_is_named(tmp_path: Path) -> None:
    cell = cell_of(tmp_path)
    q = axes_in(cell, "krl")[0]
    T = cell.T_base_part @ np.block([[np.diag([-1.0, 1.0, -1.0]), np.array([[-0.012], [0.045], [0.06]])], [0, 0, 0, 1]])
    other = next(one for one in inverse_all(cell.controller_chain, T) if one.branch == "front up flip")
    shown = np.degrees(q.shown(other.q))
    words = ",".join(f"A{i} {value:.6f}" for i, value in enumerate(shown, start=1))
    row = rows_of(program_of(tmp_path, cell, "krl", between(f"PTP {{{words}}}")), cell)["motions by axes"]
    assert row["verdict"] == "warning"
    assert "front up flip, [posture] is front up noflip" in row["what"]


def two_turns(cell: Cell) -> dict[bool, np.ndarray]:
    """A pose of the second cut that axis 6 reaches a full turn apart, and its axes by whether axis 6 is negative."""
    T = cell.T_base_part @ np.block([[np.diag([-1.0, 1.0, -1.0]), np.array([[-0.012], [0.045], [0.06]])], [0, 0, 0, 1]])
    shown = [
        np.degrees(axes_in(cell, "krl")[0].shown(one.q))
        for one in inverse_all(cell.controller_chain, T)
        if one.branch == "front up noflip"
    ]
    return {bool(axes[5] < 0): axes for axes in shown if abs(axes[3]) < 180.0}


@pytest.mark.by_turn
@pytest.mark.parametrize("negative", [True, False])
@pytest.mark.parametrize("language", ["krl", "rapid", "fanuc"])
def test_the_stated_turn_is_reached(tmp_path: Path, language: str, negative: bool) -> None:
    """T, cf6 and the turns of CONFIG choose between angles of axis 6 that are a full turn apart."""
    cell = cell_of(tmp_path)
    axes_of_maker = axes_in(cell, language)[0]
    apart = two_turns(cell)
    assert len(apart) == 2
    assert abs(apart[True][5] - apart[False][5]) == pytest.approx(360.0)
    krl = axes_in(cell, "krl")[0]
    there = np.degrees(axes_of_maker.shown(krl.model(np.radians(apart[negative]))))
    file = program_of(tmp_path, cell, language, turned(language, there))
    done = checking.check(file, cell)
    found = done.result
    reached = np.degrees(axes_of_maker.shown(found.q))
    assert np.abs(reached - there).max(axis=1).min() < 1e-3
    other = np.degrees(axes_of_maker.shown(krl.model(np.radians(apart[not negative]))))
    assert np.abs(reached - other).max(axis=1).min() > 1.0
    row = rows_in(done)["motions by axes"]
    assert row["verdict"] != "warning", row


@pytest.mark.parametrize("negative", [True, False])
def test_the_turn_stated_at_the_start_is_taken(tmp_path: Path, negative: bool) -> None:
    """T of the first target: the arm goes through the whole program a full turn of axis 6 away otherwise."""
    cell = cell_of(tmp_path)
    there = two_turns(cell)[negative]
    bits = sum(1 << axis for axis in range(6) if there[axis] < 0)
    text = (
        f"DEF p( )\nHALT ; change to tool T1, then press start\nBAS(#TOOL,1)\nBAS(#BASE,1)\n"
        f"$VEL.CP=0.025\nPTP {{X -12.0,Y 45.0,Z 60.0,{POSE},S 2,T {bits}}}\n"
        f"LIN {{X 72.0,Y 45.0,Z 60.0,{POSE}}}\nEND\n"
    )
    file = tmp_path / "p.src"
    file.write_text(text)
    shown = np.degrees(axes_in(cell, "krl")[0].shown(checking.check(file, cell).result.q))
    assert (shown[0] - there) == pytest.approx(0.0, abs=1e-3)
    assert all((axis < 0) == negative for axis in shown[:, 5])
    far = text.replace(f"Y 45.0,Z 60.0,{POSE},S 2,T {bits}", f"Y 300.0,Z 60.0,{POSE},S 2,T 0")
    file.write_text(far)  # needs A1 below 0
    row = rows_of(file, cell)["motions by axes"]
    assert row["verdict"] == "warning"
    assert "ask for other turns of the axes (T 0)" in row["what"]


def turned(language: str, there: np.ndarray) -> Callable[[list[str]], list[str]]:
    """A motion by axes to the begin of the second cut, in the turns of some axes."""
    bits = sum(1 << axis for axis in range(6) if there[axis] < 0)
    quarters = ",".join(str(int(np.floor(there[axis] / 90.0))) for axis in (0, 3, 5))
    turns = ", ".join(str(round(there[axis] / 360.0)) for axis in (0, 3, 5))

    def rapid(text: list[str]) -> list[str]:
        at = next(i for i, line in enumerate(text) if "[[-12.0000,45.0000,60.0000]" in line)
        move = text[at].replace("MoveL", "MoveJ").replace("[0,0,0,0]", f"[{quarters},0]")
        begin = [line.replace("MoveJ", "MoveL") for line in text[:at]]  # its configuration is a place holder
        return [line for line in [*begin, move, *text[at:]] if "Off" not in line]

    def fanuc(text: list[str]) -> list[str]:
        at = next(i for i, line in enumerate(text) if "P[6]" in line and ":L" in line)
        begin = text.index("P[6]{")
        entry = [line.replace("P[6]", "P[99]").replace("0, 0, 0", turns) for line in text[begin : begin + 6]]
        end = text.index("/END")
        return [*text[:at], "   0:J P[99] 10% FINE ;", *text[at:end], *entry, *text[end:]]

    krl = between(f"PTP {{X -12.0,Y 45.0,Z 60.0,{POSE},S 2,T {bits}}}")
    return {"krl": krl, "rapid": rapid, "fanuc": fanuc}[language]


def test_a_turn_that_is_not_reached_is_named(tmp_path: Path) -> None:
    cell = cell_of(tmp_path)
    # -300 needs A1 below 0: T 0 asks for a full turn more than the axis goes
    edit = between(f"PTP {{X -12.0,Y 300.0,Z 60.0,{POSE}}}", f"PTP {{X -12.0,Y 300.0,Z 60.0,{POSE},S 2,T 0}}",
                   f"PTP {{X -12.0,Y -300.0,Z 60.0,{POSE},S 2,T 0}}")  # fmt: skip
    row = rows_of(program_of(tmp_path, cell, "krl", edit), cell)["motions by axes"]
    assert row["verdict"] == "warning"
    assert "ask for other turns of the axes (T 0)" in row["what"]
