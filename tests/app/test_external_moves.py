"""External axes that move between operations: written, read back, judged by a second model, checked by preflight."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import controller_arms as arms
import external_axes as judge
from controller_arms import Arm, Matrix
from counterflex.app import conversion, preflight as checking
from counterflex.app.compensation.compensate import compensate, run as compensate_job
from counterflex.app.compensation.next_steps import to_load
from counterflex.app.cut_points import points_of_plan
from counterflex.app.inputs import read_job
from counterflex.app.plan_of_cell import require_of_cell
from counterflex.app.robot_axes import axes_in
from counterflex.app.run.job_check import cell_of_run
from counterflex.core.errors import CounterflexError, FileFormatError, InputError, ProgramError
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.plan_file import read_plan
from counterflex.path.toolpath import tool_orientation
from counterflex.programs.difference import differences
from counterflex.programs.reading import read_program_file
from counterflex.programs.robot_text.program import RobotProgram
from counterflex.programs.stated.two_readings import doubtful_readings
from counterflex.robot.elasticity.chain import forward
from counterflex.robot.model import catalog

EXAMPLES = Path(__file__).parents[2] / "examples"
SOURCE = EXAMPLES / "cells" / "kr300_d16_small.toml"
CUT = "G0 X-12 Y{y}\nG0 Z42\nG1 Z36 F3000\nG1 X{x} F1500\nG0 Z60\n"
HEAD, END = "G17 G21 G90 G94\nM6 T1\nM3 S13000\nG0 Z60\n", "M5\nM30\n"
PROGRAM = HEAD + CUT.format(y=15, x=20) + CUT.format(y=45, x=20) + END
RAIL = (
    '\n[[external_axes]]\nname = "E1"\nkind = "linear"\ncarries = "robot"\ndirection = [0, 1, 0]\nat_mm = -50\n'
    "min_mm = -400\nmax_mm = 500\ncoupled = true\n"
)
TABLE = (
    '\n[[external_axes]]\nname = "E2"\nkind = "turning"\ncarries = "part"\ndirection = [0, 0, 1]\n'
    "origin_mm = [1380, 0, 1000]\nat_deg = 10\nmin_deg = -90\nmax_deg = 90\ncoupled = true\n"
)
ALONG = "moves_mm = [[80, 142.681, 300]]\nmoves_at_mm = [[-12, 45, 60]]\n"
STANDING = "moves_mm = [[80, 80, 300]]\nmoves_at_mm = [[20, 15, 60]]\n"
TURNED = "moves_deg = [[80, 80, -25]]\nmoves_at_mm = [[20, 15, 60]]\n"
FENCE = (
    '\n[[cell.body]]\nname = "post"\nshape = "box"\nframe = "base"\nx_mm = 200\ny_mm = 50\nz_mm = 100\n'
    "size_mm = [60, 20, 200]\n"
)
ENDINGS = {"krl": "src", "rapid": "mod", "fanuc": "ls"}
READERS: dict[str, Callable[..., list[tuple[Matrix, float]]]] = {
    "krl": judge.krl_points, "rapid": judge.rapid_points, "fanuc": judge.fanuc_points,
}  # fmt: skip


def written(folder: Path, axes: str, program: str = PROGRAM, **changes: str) -> tuple[Path, Cell]:
    folder.mkdir(exist_ok=True)
    text = SOURCE.read_text(encoding="utf-8").replace("../", f"{EXAMPLES.as_posix()}/")
    text = text.replace("cell_mm = 0.2", "cell_mm = 0.5")
    for old, new in changes.items():
        text = text.replace(old, new)
    (folder / "cell.toml").write_text(text + axes, encoding="utf-8")
    (folder / "part.ngc").write_text(program, encoding="ascii")
    return folder / "part.ngc", read_cell(folder / "cell.toml")


def rows_of(program: Path, cell: Cell) -> dict[str, dict[str, Any]]:
    return {row["check"]: row for row in checking.check(program, cell).summary["checks"]}


def stored(folder: Path, files: dict[str, str]) -> Path:
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
    return next(folder / name for name in files if name.split(".")[-1] in ENDINGS.values())


def catalogue_arm(cell: Cell) -> Arm:
    g = catalog.entry(cell.robot.name).geometry
    return Arm(g.c1_mm, g.a1_mm, g.b_mm, g.c2_mm, -g.a2_mm, g.c3_mm, g.c4_mm)


def pose_of(table: Any) -> Matrix:
    return arms.shift(table.x_mm, table.y_mm, table.z_mm) @ arms.zyx(table.a_deg, table.b_deg, table.c_deg)


@pytest.mark.by_turn
@pytest.mark.parametrize("moves", [ALONG, STANDING])
@pytest.mark.parametrize("language", ENDINGS)
def test_a_rail_moves_between_operations(tmp_path: Path, language: str, moves: str) -> None:
    """Each row of the plan stands at its own place: a second model of arm and rail puts the tool on its point.

    The program has these values, reads back as the same motions, and passes preflight.
    """
    file, cell = written(tmp_path, RAIL + moves)
    done = compensate(file, cell, predict=False, language=language)
    path, arm = done.plan.path, catalogue_arm(cell)
    shown = np.degrees(axes_in(cell, "krl")[0].shown(done.plan.q))
    T_zero_part, T_flange_tcp = pose_of(cell.tables.part), pose_of(cell.tables.tcp)
    for body in reversed(cell.tables.end_effector):
        T_flange_tcp = pose_of(body) @ T_flange_tcp
    values = -50.0 + np.clip(path.place, 0.0, 1.0) * 350.0
    for row in range(0, len(path), 7):
        T_world_tcp = judge.along((0, 1, 0), values[row]) @ arms.kuka(arm, shown[row]) @ T_flange_tcp
        there = T_zero_part @ np.append(path.p_part_tcp[row] * 1e3, 1.0)
        assert np.linalg.norm(T_world_tcp[:3, 3] - there[:3]) < 2e-3
    assert {-50.0, 300.0} < set(np.round(values, 6))
    points = READERS[language](done.files)
    assert [value for _, value in points] == sorted(value for _, value in points)
    changed = next(k for k, (_, value) in enumerate(points) if value == pytest.approx(300.0))
    arrives = [-12.0, 45.0, 60.0] if moves == ALONG else [20.0, 15.0, 60.0]
    np.testing.assert_allclose(points[changed - 1][0][:3, 3], [20, 15, 60], atol=1e-3)
    np.testing.assert_allclose(points[changed][0][:3, 3], arrives, atol=1e-3)
    again = read_job(stored(tmp_path, done.files), cell, may_move=True)
    assert again.places is not None
    np.testing.assert_allclose(again.places.values, [[-0.05], [0.3]], atol=1e-6)
    rows = rows_of(stored(tmp_path, done.files), cell)
    assert "fail" not in {row["verdict"] for row in rows.values()}
    assert "1 moves" in rows["external axes"]["what"]
    assert rows_of(file, cell)["reach"]["value"] == pytest.approx(rows["reach"]["value"], abs=2.0)


def test_a_table_turns_the_part_between_operations(tmp_path: Path) -> None:
    """Only RAPID names a work object that goes with the table; the cut of each side is planned at its own angle."""
    named = {"[controller]\n": '[controller]\nwork_object = "wPart"\n'}
    file, cell = written(tmp_path, TABLE + TURNED, **named)
    done = compensate(file, cell, predict=False, language="rapid")
    path, arm = done.plan.path, catalogue_arm(cell)
    shown = np.degrees(axes_in(cell, "krl")[0].shown(done.plan.q))
    T_flange_tcp = pose_of(cell.tables.tcp)
    for body in reversed(cell.tables.end_effector):
        T_flange_tcp = pose_of(body) @ T_flange_tcp
    for row in range(0, len(path), 7):
        value = 10.0 - 35.0 * float(np.clip(path.place[row], 0.0, 1.0))
        turned = judge.about((0, 0, 1), (1380, 0, 1000), value) @ pose_of(cell.tables.part)
        there = (turned @ np.append(path.p_part_tcp[row] * 1e3, 1.0))[:3]
        assert np.linalg.norm((arms.kuka(arm, shown[row]) @ T_flange_tcp)[:3, 3] - there) < 2e-3
    assert [value for _, value in judge.rapid_points(done.files, 2)][-1] == -25.0
    assert rows_of(stored(tmp_path, done.files), cell)["external axes"]["verdict"] == "ok"
    for language in ("krl", "fanuc"):
        with pytest.raises(InputError, match="E2 carries the part"):
            compensate(file, cell, predict=False, language=language)


def test_the_correction_of_an_operation_is_that_of_a_cell_that_stands_there(tmp_path: Path) -> None:
    """Stiffness, sag and swing are those of the place of each operation: as in two cells that stand."""
    file, cell = written(tmp_path, RAIL + STANDING)
    both = compensate(file, cell, predict=False, programmed_feed=True).plan
    for place, at in ((0, -50), (1, 300)):
        _, there = written(tmp_path / str(at), RAIL.replace("at_mm = -50", f"at_mm = {at}"))
        alone = compensate(file, there, predict=False, programmed_feed=True).plan
        rows = np.flatnonzero((both.path.place == place) & (both.volume_m3 > 0.0))
        same = np.array(
            [np.argmin(np.linalg.norm(alone.path.p_part_tcp - p, axis=1)) for p in both.path.p_part_tcp[rows]]
        )
        np.testing.assert_allclose(both.deflection_part[rows], alone.deflection_part[same], rtol=1e-6, atol=1e-9)
    apart = np.abs(both.deflection_part[:, :3]).max(axis=0)
    assert apart.max() > 1e-4


@pytest.mark.parametrize(
    ("axes", "program", "told"),
    [
        (RAIL.replace("coupled = true\n", "") + STANDING, PROGRAM, "coupled.*got missing"),
        (RAIL.replace("coupled = true", "coupled = false") + STANDING, PROGRAM, "coupled.*got false"),
        (RAIL + STANDING, PROGRAM.replace("Y15", "Y25"), "moves along another program"),
    ],
)
def test_what_is_not_known_of_an_axis_is_refused(tmp_path: Path, axes: str, program: str, told: str) -> None:
    file, cell = written(tmp_path, axes, program)
    with pytest.raises(CounterflexError, match=told):
        compensate(file, cell, predict=False, language="krl")


def test_the_way_of_a_move_is_that_of_one_rapid(tmp_path: Path) -> None:
    """The cell file says where a move begins, too: not where the rapid before it began, nor behind its own begin."""
    for begins in (38.0, 110.0):
        file, cell = written(tmp_path, RAIL + ALONG.replace("[[80,", f"[[{begins},"))
        with pytest.raises(FileFormatError, match=rf"no rapid of part.ngc begins after {begins:.0f} mm and ends"):
            compensate(file, cell, predict=False)


def test_of_two_rapids_that_end_in_one_point_the_nearer_along_the_path_is_taken(tmp_path: Path) -> None:
    twice = PROGRAM.replace("G0 Z60\nG0 X-12 Y45", "G0 Z60\nG0 Z54\nG0 Z60\nG0 X-12 Y45")
    for behind, line in ((80, 9), (92, 11)):
        moves = f"moves_mm = [[{behind}, {behind}, 300]]\nmoves_at_mm = [[20, 15, 60]]\n"
        file, cell = written(tmp_path, RAIL + moves, twice)
        job = read_job(file, cell, may_move=True)
        assert job.line_of_motion[job.changes[0].motion] == line


def test_moves_in_the_slot_are_refused_before_anything_is_planned(tmp_path: Path) -> None:
    """Nothing is removed while the axis moves, and the tool stands in the slot that it has cut."""
    deep = PROGRAM.replace("G1 X20 F1500\nG0 Z60\nG0 X-12 Y45", "G1 X20 F1500\nG0 X10\nG0 Z60\nG0 X-12 Y45")
    moves = "moves_mm = [[66, 66, 300]]\nmoves_at_mm = [[10, 15, 36]]\n"
    file, cell = written(tmp_path, RAIL + moves, deep)
    with pytest.raises(InputError, match="moves while the tool is in the blank"):
        compensate(file, cell, predict=False, language="krl")


def test_gcode_says_that_it_does_not_move_the_axes(tmp_path: Path) -> None:
    file, cell = written(tmp_path, RAIL + STANDING)
    told = compensate(file, cell, predict=False).written["warnings"]
    assert any("planned with E1 at 2 places" in one and "does not move them" in one for one in told)
    told = compensate(file, cell, predict=False, language="krl").written["warnings"]
    assert not any("does not move them" in one for one in told)


def test_a_plan_with_moves_is_refused_by_all_that_read_a_plan(tmp_path: Path) -> None:
    """A rail that moves 20 mm is within what a part frame may be measured off: the plan itself says that it moves."""
    file, cell = written(tmp_path, RAIL + STANDING.replace("300", "-30"))
    compensate_job(file, cell.path, tmp_path / "out", predict=False, report=False)
    plan, about = read_plan(tmp_path / "out" / "plan.parquet")
    _, still = written(tmp_path / "still", RAIL)
    for where in (cell, still):
        with pytest.raises(InputError, match="external axes move between the operations.*got 2 places"):
            require_of_cell(plan, about, where, "plan.parquet")
    with pytest.raises(InputError, match="external axes move between the operations"):
        cell_of_run(cell.path, None)
    cell_of_run(still.path, None)


def test_forces_of_a_turned_part_are_turned_with_it(tmp_path: Path) -> None:
    """What the intervals of the prediction are drawn from: the force in the base, by the posture of the arm alone."""
    file, cell = written(tmp_path, TABLE + TURNED)
    done = compensate(file, cell, predict=False)
    points = points_of_plan(done.plan, cell, "part", done.places)
    assert points is not None
    path = done.plan.path
    assert len(np.unique(path.place[points.row])) == 2
    R_part_tcp = tool_orientation(path.axis_part, cell.tables.posture.rotations_rad(path.p_part_tcp))[points.row]
    R_base_part = forward(cell.controller_chain, points.q)[:, :3, :3] @ np.swapaxes(R_part_tcp, 1, 2)
    force = np.einsum("nij,nj->ni", R_base_part, done.plan.w_tcp_part[points.row, :3])
    np.testing.assert_allclose(points.w_tcp_base[:, :3], force, atol=1e-6 * np.abs(force).max())


def test_what_is_to_be_set_on_the_controller_is_what_the_program_names(tmp_path: Path) -> None:
    """A coupled axis carries no frame away: the base is that of the part with the axis at zero."""
    file, cell = written(tmp_path, RAIL + STANDING)
    part = cell.tables.part
    assert part is not None
    for language, key in (("krl", "BASE_DATA[1]"), ("fanuc", "UFRAME[1]")):
        done = compensate(file, cell, predict=False, language=language)
        value = next(fact.value for fact in to_load(done.summary, cell, [1]) if fact.name == key)
        x, y, z = (float(number) for number in re.findall(r"[XYZ] =? ?(-?[\d.]+)", value)[:3])
        assert (x, y) == pytest.approx((part.x_mm, part.y_mm), abs=1e-3)
        if language == "fanuc":
            remark = re.search(r"UFRAME 1 in.*\n.*X (\S+) Y (\S+).*\n.*Z (\S+)", done.files["part.ls"])
            assert remark is not None
            assert (x, y, z) == pytest.approx([float(one) for one in remark.groups()], abs=1e-3)
        else:
            assert z == pytest.approx(part.z_mm, abs=1e-3)


def test_val3_and_commands_that_look_at_one_place_refuse(tmp_path: Path) -> None:
    file, cell = written(tmp_path, RAIL + STANDING)
    with pytest.raises(InputError, match="points of VAL3 have no external axes"):
        compensate(file, cell, predict=False, language="val3")
    with pytest.raises(InputError, match="external axes move between the operations"):
        read_job(file, cell)


@pytest.mark.parametrize(
    ("keys", "told"),
    [
        ("moves_mm = [[80, 80, 900]]\nmoves_at_mm = [[20, 15, 60]]\n", "E1 cannot go to 900"),
        ("moves_mm = [[80, 80, 300]]\n", "one point for each"),
        ("moves_mm = [[80, 70, 300]]\nmoves_at_mm = [[20, 15, 60]]\n", "do not rise"),
        ("moves_deg = [[80, 80, 30]]\nmoves_at_mm = [[20, 15, 60]]\n", "moves_deg has no meaning"),
    ],
)
def test_moves_of_a_cell_file_are_checked(tmp_path: Path, keys: str, told: str) -> None:
    with pytest.raises(FileFormatError, match=told):
        written(tmp_path, RAIL + keys)


def krl_of(folder: Path, edit: Callable[[list[str]], list[str]]) -> Path:
    """The program in KRL with the rail at 0 all along, and edited."""
    file, cell = written(folder, RAIL.replace("at_mm = -50", "at_mm = 0"))
    conversion.run(file, cell.path, folder / "out", "krl")
    source = folder / "out" / "part.src"
    source.write_text("\n".join(edit(source.read_text().splitlines())) + "\n")
    return source


def changed(lines: list[str], find: str, old: str, new: str) -> list[str]:
    assert any(find in line for line in lines)
    return [line.replace(old, new) if find in line else line for line in lines]


FAULTS: dict[str, tuple[Callable[[list[str]], list[str]], str, str]] = {
    # in the cut, along the feed
    "cut": (lambda t: changed(t, "X 20.0000,Y 15.0000,Z 36", "C -180.00000}", "C -180.00000,E1 100}"),
            "external axes", "in the blank"),
    # standing, in the slot
    "slot": (lambda t: changed(t, "X 20.0000,Y 15.0000,Z 60", "Z 60.0000", "Z 36.0000")[:0] or [
        line for one in t for line in ([one, one.replace("C -180.00000}", "C -180.00000,E1 100}")]
                                       if "X 20.0000,Y 15.0000,Z 36" in one else [one])],
             "external axes", "in the blank"),
    # beyond the travel
    "travel": (lambda t: changed(t, "X -12.0000,Y 45.0000,Z 60", "C -180.00000}", "C -180.00000,E1 900}"),
               "external axes", "E1 goes to 900 mm, limits -400 to 500 mm"),
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_faults_of_external_axes_are_found(tmp_path: Path, fault: str) -> None:
    edit, check, told = FAULTS[fault]
    source = krl_of(tmp_path, edit)
    row = rows_of(source, read_cell(tmp_path / "cell.toml"))[check]
    assert row["verdict"] == "fail"
    assert told in row["what"]


def test_a_body_in_the_way_of_the_rail_is_found(tmp_path: Path) -> None:
    """Both places are free; between them the robot passes a post beside the robot."""
    verdicts = {}
    rail = RAIL.replace("-400", "-1000").replace("500", "1000")
    still, there = (rail.replace("at_mm = -50", f"at_mm = {value}") for value in (-700, 800))
    moves = STANDING.replace("300", "800")
    for name, axes in (("still", still), ("there", there), ("moves", still + moves)):
        file, cell = written(tmp_path / name, axes + FENCE)
        verdicts[name] = rows_of(file, cell)["robot and spindle to surroundings"]
    assert (verdicts["still"]["verdict"], verdicts["there"]["verdict"]) == ("ok", "ok")
    assert verdicts["moves"]["verdict"] == "fail"
    assert "post" in verdicts["moves"]["what"]


def test_a_program_that_moves_otherwise_than_the_cell_file_is_refused(tmp_path: Path) -> None:
    source = krl_of(tmp_path, lambda t: changed(t, "Y 45.0000,Z 60", "C -180.00000}", "C -180.00000,E1 200}"))
    cell = read_cell(tmp_path / "cell.toml")
    assert read_job(source, cell, may_move=True).places is not None
    text = cell.path.read_text().replace("at_mm = 0", "at_mm = 0\n" + STANDING.strip())
    cell.path.write_text(text)
    with pytest.raises(ProgramError, match=r"moves E1 otherwise than the cell file says.*got 200; expected 300"):
        read_job(source, read_cell(cell.path), may_move=True)


@pytest.mark.by_turn
@pytest.mark.parametrize("language", ENDINGS)
def test_programs_that_move_axes_are_compared_without_a_cell(tmp_path: Path, language: str) -> None:
    """The correction of one is what differs; one that goes elsewhere is no version of it."""
    file, cell = written(tmp_path, RAIL + STANDING)
    done = compensate(file, cell, predict=False, language=language)
    source = stored(tmp_path, done.files)
    program = read_program_file(source)
    assert isinstance(program, RobotProgram)
    assert [dict(values) for values in program.external.values()] == [{1: 300.0}]
    (tmp_path / "other").mkdir()
    moved = {name: re.sub(r"\b300(\.0+)?\b", "301", text) for name, text in done.files.items()}
    other = read_program_file(stored(tmp_path / "other", moved))
    assert not any(change.changed for change in differences(program, program))
    with pytest.raises(InputError, match="external axes go elsewhere; got E1 301; expected E1 300"):
        differences(program, other)


@pytest.mark.parametrize(
    ("start", "moves", "first", "told"),
    [
        ("PTP XSTART", "", "", r"part.src:\d+: external axis E1 .*got 100; expected -50"),
        ("PTP {A1 0,A2 -90,A3 90,A4 0,A5 0,A6 0,E1 100}", "", "", r"external axis E1 .*got 100; expected -50"),
        ("PTP {A1 0,E1 100}", "", "", r"external axis E1 .*got 100; expected -50"),
        ("PTP XSTART", "", ",E1 -50", None),
        ("PTP XSTART", STANDING, "", None),
    ],
)
def test_axes_that_targets_do_not_name_stand_where_the_start_has_sent_them(
    tmp_path: Path, start: str, moves: str, first: str, told: str | None
) -> None:
    """KRL keeps the value of the motion by axes before the first target, unless that target states its own."""
    file, cell = written(tmp_path, RAIL + moves)
    done = compensate(file, cell, predict=False, language="krl")
    source, data = done.files["part.src"], done.files["part.dat"]
    begin = source.index("LIN {")
    end = source.index("}", begin)
    source = (source[:end] + first + source[end:]).replace("PTP XSTART", start)
    at = stored(tmp_path, {"part.src": source, "part.dat": data.replace("E1 -50.0000", "E1 100")})
    if told is None:
        read_job(at, cell, may_move=True)
        return
    with pytest.raises(ProgramError, match=told):
        read_job(at, cell, may_move=True)


def test_further_groups_of_fanuc_that_stand_are_named(tmp_path: Path) -> None:
    """Nothing says which axis of the cell a second group is: the program is read, and its place not compared."""
    file, cell = written(tmp_path, RAIL)
    done = compensate(file, cell, predict=False, language="fanuc")
    second = re.sub(
        r",\n\tE1 = -50.0000 mm\n\};", "\n   GP2:\n\tUF : 1, UT : 1,\n\tJ1 = 300.0 mm\n};", done.files["part.ls"]
    )
    messages = doubtful_readings(read_job(stored(tmp_path, {"part.ls": second}), cell).program)
    assert any("positions state group 2, too" in one and "not compared" in one for one in messages)
    assert doubtful_readings(read_job(stored(tmp_path, done.files), cell).program) == []


def rapid_of(lines: list[str], find: str, value: float) -> list[str]:
    """The rail in every target from one on."""
    at = next(i for i, line in enumerate(lines) if find in line)
    none, there = "[9E9,9E9,9E9,9E9,9E9,9E9]]", f"[{value:g},9E9,9E9,9E9,9E9,9E9]]"
    zero = "[0,9E9,9E9,9E9,9E9,9E9]]"
    return [
        line.replace(none, zero if i < at else there).replace("[0.00000,9E9", "[0,9E9" if i < at else f"[{value:g},9E9")
        for i, line in enumerate(lines)
    ]


def fanuc_of(lines: list[str], number: int, value: float) -> list[str]:
    """The rail in every position from one on."""
    out, at = [], 0
    for line in lines:
        at = int(line[2 : line.index("]")]) if line.startswith("P[") else at
        moved = line.replace("E1 = 0.0000 mm", f"E1 = {value:g} mm") if at >= number else line
        out.append(moved)
    return out


PLACES: dict[str, tuple[Callable[[list[str]], list[str]], Callable[[list[str]], list[str]]]] = {
    # language: edit of the program at the first target of the second cut, and at the first cut itself
    "rapid": (lambda t: rapid_of(t, "[[-12.0000,45.0000,60", 300), lambda t: rapid_of(t, "[[20.0000,15.0000,36", 300)),
    "fanuc": (lambda t: fanuc_of(t, 6, 300), lambda t: fanuc_of(t, 4, 300)),
}  # fmt: skip


@pytest.mark.by_turn
@pytest.mark.parametrize("language", PLACES)
def test_rails_in_rapid_and_fanuc(tmp_path: Path, language: str) -> None:
    """A clean program that rides between its cuts, one that rides in a cut, and one beyond the travel of the rail."""
    file, cell = written(tmp_path, RAIL.replace("at_mm = -50", "at_mm = 0"))
    conversion.run(file, cell.path, tmp_path / "out", language)
    source = tmp_path / "out" / f"part.{ENDINGS[language]}"
    text = source.read_text().splitlines()
    clean, in_cut = PLACES[language]
    verdicts = {}
    for name, lines in (("clean", clean(text)), ("cut", in_cut(text)),
                        ("travel", [line.replace("300", "900") for line in clean(text)])):  # fmt: skip
        source.write_text("\n".join(lines) + "\n")
        rows = rows_of(source, cell)
        verdicts[name] = rows["external axes"]["verdict"]
        if name == "clean":
            assert "fail" not in {row["verdict"] for row in rows.values()}
            assert "1 moves" in rows["external axes"]["what"]
    assert verdicts == {"clean": "ok", "cut": "fail", "travel": "fail"}


def test_a_place_out_of_reach_is_found(tmp_path: Path) -> None:
    """The second place takes the robot 4 m away along its rail: reach fails in the rows of that place."""
    rail = RAIL.replace("max_mm = 500", "max_mm = 5000")
    file, cell = written(tmp_path, rail + STANDING.replace("300", "4000"))
    row = rows_of(file, cell)["reach"]
    assert row["verdict"] == "fail"
    assert row["line"] is not None


def test_a_table_that_turns_is_looked_at_in_both_places(tmp_path: Path) -> None:
    """A program on a table at rest is clean; the joints of one that turns it are others."""
    free, cell = written(tmp_path / "free", TABLE)
    assert "fail" not in [row["verdict"] for row in rows_of(free, cell).values()]
    file, turned = written(tmp_path / "turned", TABLE + TURNED.replace("-25", "-85"))
    rows = rows_of(file, turned)
    assert "1 moves" in rows["external axes"]["what"]
    assert rows["joint limits"]["value"] != rows_of(free, cell)["joint limits"]["value"]
