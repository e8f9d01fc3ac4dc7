"""First motion of every program that is written, run by a second model of the maker's controller."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import controller_arms as judge
from controller_arms import Arm, Matrix
from counterflex.app.compensation.compensate import compensate
from counterflex.app.robot_axes import tcp_of_axes
from counterflex.app.robot_programs import robot_cell
from counterflex.core.errors import ProgramError, ReachError
from counterflex.core.units import DEG
from counterflex.files.cell.cell import read_cell
from counterflex.programs.reading import read_program_file
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


def check(folder: Path, robot: str, arm: Arm, maker: str, draw: np.random.Generator, of: str = "") -> bool:
    """Write a program for a random cell and run its first motion; False where the cell is out of reach.

    ``of`` is the maker of the robot, where it is not that of the controller: then frames are given from the plate
    unless both makers have their world at axis 2.
    """
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
        np.testing.assert_allclose(start.T_flange_tool, T_flange_tcp, atol=6e-4)
    if start.T_world_part is not None:
        high = world == "axis 2" and MAKERS[of or maker][1] == "axis 2"
        lift = judge.shift(z=arm.base if high else 0.0)
        np.testing.assert_allclose(lift @ start.T_world_part, T_plate_part, atol=6e-4)
    reached = T_plate_world @ forward(arm, start.axes) @ T_flange_tcp
    commanded = T_plate_part @ start.T_part_tcp
    off = float(np.linalg.norm(reached[:3, 3] - commanded[:3, 3]))
    assert off < TIP_MM, f"{maker}: the tip is {off:.6f} mm from the commanded start"
    np.testing.assert_allclose(reached[:3, :3], commanded[:3, :3], atol=2e-6)
    read_back = tcp_of_axes(cell, language, start.axes * DEG)  # what a reader makes of the axes
    np.testing.assert_allclose(read_back[:3, 3] * 1e3, reached[:3, 3], atol=1e-6)
    np.testing.assert_allclose(read_back[:3, :3], reached[:3, :3], atol=1e-9)
    if start.points is not None:
        assert np.all(np.sum(start.points[1:] * start.points[:-1], axis=1) > 0.0)
    return True


@pytest.mark.long
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


@pytest.mark.long
@pytest.mark.parametrize("name", [name for name in catalog.names() if name.split("_")[0] in GEOMETRY])
def test_the_first_motion_of_every_catalogue_robot_arrives(name: str, tmp_path: Path) -> None:
    draw = np.random.default_rng(sum(name.encode()))
    arm = catalogue_arm(name)
    done = sum(check(tmp_path, f'[robot]\ncatalog = "{name}"', arm, name.split("_")[0], draw) for _ in range(12))
    assert done >= 3


# ---- frames that programs say ---------------------------------------------------------------------------------------


def words(maker: str, T: Matrix) -> str:
    """A frame (4, 4) mm in the words of a maker; angles by another library."""
    x, y, z = T[:3, 3]
    R = Rotation.from_matrix(T[:3, :3])
    if maker == "kuka":
        a, b, c = R.as_euler("ZYX", degrees=True)
        return f"{{X {x:.6f},Y {y:.6f},Z {z:.6f},A {a:.7f},B {b:.7f},C {c:.7f}}}"
    if maker == "abb":
        q = R.as_quat()
        return f"[[{x:.6f},{y:.6f},{z:.6f}],[{q[3]:.10f},{q[0]:.10f},{q[1]:.10f},{q[2]:.10f}]]"
    rx, ry, rz = R.as_euler("XYZ", degrees=True)
    return f'x="{x:.6f}" y="{y:.6f}" z="{z:.6f}" rx="{rx:.7f}" ry="{ry:.7f}" rz="{rz:.7f}"'


def with_frames(maker: str, files: dict[str, str], T_world_part: Matrix, T_flange_tcp: Matrix) -> dict[str, str]:
    """The program that was written, its frames said by this file instead."""
    part, tool = words(maker, T_world_part), words(maker, T_flange_tcp)
    pairs = {
        "kuka": ((r"\$BASE=BASE_DATA\[1\]", f"$BASE={part}"), (r"\$TOOL=TOOL_DATA\[1\]", f"$TOOL={tool}")),
        "abb": (
            (r'(wobjdata \w+:=\[FALSE,TRUE,"",)\[\[[^\]]*\],\[[^\]]*\]\]', rf"\g<1>{part}"),
            (r"(tooldata \w+:=\[TRUE,)\[\[[^\]]*\],\[[^\]]*\]\]", rf"\g<1>{tool}"),
        ),
        "staubli": (
            (r'(name="fPart".*?<Value key="0" ).*?(?= fatherId)', rf"\g<1>{part}"),
            (r'(name="tPath".*?<Value key="0" ).*?(?= fatherId)', rf"\g<1>{tool}"),
        ),
    }[maker]
    out = {}
    for name, text in files.items():
        for pattern, new in pairs:
            text = re.sub(pattern, new, text, flags=re.DOTALL)
        out[name] = text
    return out


@pytest.mark.parametrize("maker", ["kuka", "abb", "staubli"])
def test_frames_in_the_words_of_the_maker_are_the_cells(maker: str, tmp_path: Path) -> None:
    language, world, _, _ = MAKERS[maker]
    draw = np.random.default_rng(6)
    done = 0
    while done < 8:
        arm, file, program = random_arm(draw), tmp_path / "cell.toml", tmp_path / "job.ngc"
        file.write_text(cell_text(robot_text(arm, maker), arm, language, draw), encoding="utf-8")
        program.write_text(PROGRAM, encoding="ascii")
        cell = read_cell(file)
        try:
            files = compensate(program, cell, language=language, predict=False).files
        except ReachError:
            continue
        done += 1
        T_world_plate = judge.shift(z=-arm.base if world == "axis 2" else 0.0)
        T_part, T_tool = T_world_plate @ frame_of(cell.tables.part), frame_of(cell.tables.tcp)
        held = robot_cell(cell, language)
        for off, good in ((0.0, True), (0.5, False)):
            for name, text in with_frames(maker, files, T_part @ judge.shift(x=off), T_tool).items():
                (tmp_path / name).write_text(text, encoding="ascii")
            main = tmp_path / next(iter(files))
            if good:
                assert read_program_file(main, cell=held).motions
                continue
            with pytest.raises(ProgramError, match=r"is not the part frame of the cell.*0\.500 mm"):
                read_program_file(main, cell=held)


def test_the_world_of_a_fanuc_lies_at_axis_2(tmp_path: Path) -> None:
    """UFRAME_NUM=0 is the world: a part frame at the height of axis 2 is it, one on the plate is not."""
    draw = np.random.default_rng(7)
    arm = random_arm(draw)
    text = cell_text(robot_text(arm, "fanuc"), arm, "fanuc", draw)
    head, part = text.split("[part]\n")
    _, rest = part.split('measured_with = "external"')
    listing = (
        "/PROG JOB\n/MN\n   1:  UFRAME_NUM=0 ;\n   2:  UTOOL_NUM=1 ;\n   3:J P[1] 10% FINE ;\n"
        "   4:L P[2] 20mm/sec FINE ;\n/POS\n"
        + "".join(
            f"P[{n}]{{\n   GP1:\n\tUF : 0, UT : 1,\t\tCONFIG : 'N U T, 0, 0, 0',\n\tX = {x} mm, Y = 0 mm, Z = 5 mm,\n"
            "\tW = 180 deg, P = 0 deg, R = 0 deg\n};\n"
            for n, x in ((1, 0), (2, 10))
        )
        + "/END\n"
    )
    (tmp_path / "job.ls").write_text(listing, encoding="ascii")
    for z, good in ((arm.base, True), (0.0, False)):
        file = tmp_path / "cell.toml"
        file.write_text(f'{head}[part]\nz_mm = {z}\nmeasured_with = "external"{rest}', encoding="utf-8")
        held = robot_cell(read_cell(file), "fanuc")
        if good:
            assert len(read_program_file(tmp_path / "job.ls", cell=held).motions) == 2
        else:
            with pytest.raises(ProgramError, match=rf"{arm.base:.3f} mm"):
                read_program_file(tmp_path / "job.ls", cell=held)


def test_where_the_robot_stands_in_its_world_enters_the_frames(tmp_path: Path) -> None:
    draw = np.random.default_rng(8)
    arm = Arm(650, 320, 0, 1100, 100, 1200, 200)
    text = cell_text(robot_text(arm, "abb"), arm, "rapid", draw)
    text += "[controller.robot_in_world]\nx_mm = 500\ny_mm = -20\nz_mm = 300\na_deg = 90\n"
    (tmp_path / "cell.toml").write_text(text, encoding="utf-8")
    (tmp_path / "job.ngc").write_text(PROGRAM, encoding="ascii")
    cell = read_cell(tmp_path / "cell.toml")
    done = compensate(tmp_path / "job.ngc", cell, language="rapid", predict=False)
    start = judge.rapid_start(done.files)
    T_world_root = judge.shift(500, -20, 300) @ judge.zyx(90, 0, 0)
    assert start.T_world_part is not None
    np.testing.assert_allclose(start.T_world_part, T_world_root @ frame_of(cell.tables.part), atol=6e-5)


def test_the_work_object_of_the_controller_is_named(tmp_path: Path) -> None:
    draw = np.random.default_rng(8)
    arm = Arm(650, 320, 0, 1100, 100, 1200, 200)
    text = cell_text(robot_text(arm, "abb"), arm, "rapid", draw) + '[controller]\nwork_object = "wVice"\n'
    head, spindle = text.split("[controller.spindle.rapid]")
    (tmp_path / "cell.toml").write_text(
        head + '[controller]\nwork_object = "wVice"\n[controller.spindle.rapid]' + spindle.split("[controller]")[0],
        encoding="utf-8",
    )
    (tmp_path / "job.ngc").write_text(PROGRAM, encoding="ascii")
    module = compensate(tmp_path / "job.ngc", read_cell(tmp_path / "cell.toml"), language="rapid", predict=False)
    lines = module.files["job.mod"].splitlines()
    moves = [line for line in lines if "Move" in line]
    assert moves
    assert all(r"\WObj:=wVice;" in line for line in moves)
    assert not any("wobjdata" in line for line in lines)
    assert [line.strip() for line in lines if "Conf" in line] == [
        r"ConfJ \Off;", r"ConfL \Off;", r"ConfJ \On;", r"ConfL \On;"
    ]  # fmt: skip


@pytest.mark.by_turn
@pytest.mark.parametrize("of", ["kuka", "abb", "fanuc", "staubli"])
@pytest.mark.parametrize("maker", ["kuka", "abb", "fanuc", "staubli"])
def test_an_arm_of_one_maker_on_the_controller_of_another_arrives(of: str, maker: str, tmp_path: Path) -> None:
    draw = np.random.default_rng(9)
    done = 0
    for _ in range(8):
        arm = random_arm(draw)
        done += check(tmp_path, robot_text(arm, of), arm, maker, draw, of)
    assert done >= 3


def test_a_coupled_limit_bars_postures(tmp_path: Path) -> None:
    """A posture that leaves too little between the arms of a FANUC is refused, one that leaves enough is not."""
    draw = np.random.default_rng(10)
    arm = Arm(670, 312, 0, 1075, 225, 1280, 215)
    text = cell_text(robot_text(arm, "fanuc"), arm, "fanuc", draw)
    (tmp_path / "job.ngc").write_text(PROGRAM, encoding="ascii")
    file = tmp_path / "cell.toml"
    file.write_text(text, encoding="utf-8")
    start = judge.fanuc_start(compensate(tmp_path / "job.ngc", read_cell(file), language="fanuc", predict=False).files)
    between = start.axes[1] + start.axes[2]
    for margin, good in ((5.0, True), (-5.0, False)):
        key = f"[robot.controller_axes]\naxis_3_to_upper_arm_deg = [{between - margin:.3f}, 200]\n"
        file.write_text(text.replace("[[robot.elastic]]", f"{key}[[robot.elastic]]", 1), encoding="utf-8")
        cell = read_cell(file)
        if good:
            compensate(tmp_path / "job.ngc", cell, language="fanuc", predict=False)
        else:
            with pytest.raises(ReachError, match="not reached in branch"):
                compensate(tmp_path / "job.ngc", cell, language="fanuc", predict=False)


@pytest.mark.parametrize("branch", ["front up noflip", "front up flip", "back up noflip", "back up flip"])
def test_configurations_are_those_of_the_start_posture(branch: str, tmp_path: Path) -> None:
    """FANUC's CONFIG follows the branch, VAL3's words the signs of the axes that the program itself starts with."""
    draw = np.random.default_rng(11)
    (tmp_path / "job.ngc").write_text(PROGRAM, encoding="ascii")
    for maker, language in (("fanuc", "fanuc"), ("staubli", "val3")):
        for _ in range(20):
            arm = random_arm(draw)
            text = cell_text(robot_text(arm, maker), arm, language, draw)
            keys = zip(("shoulder", "elbow", "wrist"), branch.split(), strict=True)
            lines = "\n".join(f'{key} = "{value}"' for key, value in keys)
            text = text.replace("[posture]", f"[posture]\n{lines}")
            (tmp_path / "cell.toml").write_text(text, encoding="utf-8")
            try:
                files = compensate(
                    tmp_path / "job.ngc", read_cell(tmp_path / "cell.toml"), language=language, predict=False
                ).files
                break
            except ReachError:
                continue
        else:
            pytest.fail("no cell is within reach")
        if language == "fanuc":
            letters = f"{'N' if 'noflip' in branch else 'F'} U {'T' if 'front' in branch else 'B'}"
            assert f"CONFIG : '{letters}," in files["job.ls"]
            continue
        axes = judge.val3_start(files).axes
        words = re.search(r'shoulder="(\w+)" elbow="(\w+)" wrist="(\w+)"', files["job.dtx"])
        assert words is not None
        assert words[1] == ("righty" if "front" in branch else "lefty")
        assert words[2] == ("epositive" if axes[2] > 0.0 else "enegative")
        assert words[3] == ("wpositive" if axes[4] > 0.0 else "wnegative")


def test_j3_of_a_fanuc_counts_from_the_horizontal(tmp_path: Path) -> None:
    """The case that was 592 mm off: J3 = -57.52 is the angle to the upper arm, -36.35 the one that a pendant shows."""
    text = Path("examples/cells/fanuc_r2000ic.toml").read_text(encoding="utf-8")
    for old, new in (
        ("x_mm = 6.9\ny_mm = 245.3\nz_mm = 319.3", "x_mm = 0\ny_mm = 0\nz_mm = 320"),
        ("x_mm = 1500\nz_mm = 700", "x_mm = 1100\nz_mm = 500"),
        ("[100, 100, 20]", "[60, 60, 40]"),
    ):
        assert old in text
        text = text.replace(old, new)
    text += "[controller.spindle.fanuc]\nclockwise = []\noff = []\ntool_change = []\n"
    (tmp_path / "cell.toml").write_text(text, encoding="utf-8")
    (tmp_path / "groove.ngc").write_text(
        "G17 G54 G40 G49 G80 G90\nG21\nM6 T1\nG43 H1\nM3 S13000\nG0 Z60\nG0 X-12 Y15\nG0 Z42\n"
        "G1 Z41 F3000\nG0 Z60\nM5\nM30\n",
        encoding="ascii",
    )
    cell = read_cell(tmp_path / "cell.toml")
    done = compensate(tmp_path / "groove.ngc", cell, language="fanuc", predict=False)
    start = judge.fanuc_start(done.files)
    assert start.axes[2] == pytest.approx(-36.35041, abs=1e-5)
    arm = Arm(670, 312, 0, 1075, 225, 1280, 215)
    tip = judge.shift(z=670) @ judge.fanuc(arm, start.axes) @ judge.shift(z=320)
    np.testing.assert_allclose(tip[:3, 3], [1100 - 12, 15, 500 + 60], atol=1e-3)
    wrong = start.axes + np.array([0.0, 0.0, start.axes[1], 0.0, 0.0, 0.0])  # as it was written
    off = judge.shift(z=670) @ judge.fanuc(arm, wrong) @ judge.shift(z=320)
    assert np.linalg.norm(off[:3, 3] - tip[:3, 3]) == pytest.approx(592.0, abs=1.0)
