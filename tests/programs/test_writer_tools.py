"""Tools, spindle and coolant in robot programs: a frame for each tool, nothing turns on, nothing is a mere comment."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.integrations.abb.language.writer import RapidSettings, RapidWriter
from counterflex.integrations.kuka.language.writer import KrlSettings, KrlWriter
from counterflex.path.toolpath import ToolPath
from counterflex.programs.compensated import CompensatedPath, tool_path
from counterflex.programs.gcode.read.reader import read_gcode
from counterflex.programs.program import Program
from counterflex.programs.robot_writer.machine_functions import MachineFunctions
from counterflex.programs.robot_writer.points import RobotText

START = (0.0, -1.5, 1.6, 0.1, 0.5, -0.2)
KRL = {
    3: ("SPINDLE_ON({s})",),
    4: ("SPINDLE_BACK({s})",),
    5: ("SPINDLE_OFF( )",),
    6: ("CHANGE({t})",),
    7: ("MIST( )",),
    8: ("FLOOD( )",),
    9: ("DRY( )",),
}
RAPID = {code: tuple(re.sub(r"\(.*\)", f" {code};", line) for line in lines) for code, lines in KRL.items()}
TWO_TOOLS = """G21 G90
T1 M6
M3 S8000 M8
G0 X0 Y0 Z20
G1 Z-1 F600
G1 X40 F1500
G0 Z20
T2 M6
M3 S12000
G0 X0 Y10
G1 Z-1 F600
G1 X40 F1500
G0 Z20
M30
"""


def job(text: str) -> tuple[Program, ToolPath, Float]:
    program = read_gcode(text, name="part.ngc")
    path = tool_path(program, step_m=1e-3)
    down = np.broadcast_to(np.diag([1.0, -1.0, -1.0]), (len(path), 3, 3))
    return program, path, CompensatedPath.nominal(path).poses(down)


def written(language: str, text: str = TWO_TOOLS, mapped: dict[int, tuple[str, ...]] | None = None) -> RobotText:
    program, path, poses = job(text)
    statements = mapped if mapped is not None else KRL if language == "krl" else RAPID
    lines = MachineFunctions(language, statements).lines
    if language == "krl":
        settings = KrlSettings(name="part", start_axes_rad=START, tool_data={1: 5, 2: 6})
        return KrlWriter(program, path, poses, settings, block_lines=lines).text()
    names = RapidSettings(name="part", start_axes_rad=START, T_flange_tcp=np.eye(4), T_base_part=np.eye(4))
    return RapidWriter(program, path, poses, replace(names, tool_data={1: "tOne", 2: "tTwo"}), block_lines=lines).text()


def in_order(result: RobotText, suffix: str) -> list[str]:
    """Lines of the program as they are executed, calls of parts replaced by what they hold."""
    out: list[str] = []
    for line in map(str.strip, result.files[f"part.{suffix}"].splitlines()):
        called = re.fullmatch(r"(part_\d{3})(?:\( \)|;)", line)
        out += map(str.strip, result.files[f"{called[1]}.{suffix}"].splitlines()) if called else [line]
    return out


def test_each_tool_runs_in_its_own_krl_frame() -> None:
    result = written("krl")
    assert sorted(result.files) == sorted(
        f"part{number}.{end}" for number in ("", "_001", "_002") for end in ("src", "dat")
    )
    lines = in_order(result, "src")
    marks = [line for line in lines if re.match(r"CHANGE|\$TOOL|SPINDLE|FLOOD|DRY|PTP", line)]
    assert marks == [
        *("CHANGE(1)", "$TOOL=TOOL_DATA[5]", "PTP XSTART", "SPINDLE_ON(8000)", "FLOOD( )"),
        *("SPINDLE_OFF( )", "CHANGE(2)", "$TOOL=TOOL_DATA[6]", "SPINDLE_ON(12000)"),
        *("DRY( )", "SPINDLE_OFF( )"),
    ]
    assert "split into 2 parts of at most 5000 points, 1 of them for a change of tool" in result.warnings


def test_each_tool_runs_with_its_own_tooldata() -> None:
    result = written("rapid")
    assert sorted(result.files) == ["part.mod", "part_001.mod", "part_002.mod"]
    lines = in_order(result, "mod")
    change = lines.index("CHANGE 6;", lines.index("CHANGE 6;") + 1)
    moves = [(i, line) for i, line in enumerate(lines) if line.startswith(("MoveL", "MoveAbsJ"))]
    assert {re.findall(r"(\w+)\\WObj", line)[0] for i, line in moves if i < change} == {"tOne"}
    assert {re.findall(r"(\w+)\\WObj", line)[0] for i, line in moves if i > change} == {"tTwo"}
    assert not any("PERS tooldata" in line for line in lines)
    assert lines.index("CHANGE 6;") < moves[0][0]  # the robot goes to the start with the tool it works with
    assert lines.index("SPINDLE_OFF 5;") < change


@pytest.mark.parametrize(("language", "suffix"), [("krl", "src"), ("rapid", "mod")])
def test_behind_a_change_the_tip_goes_back_to_where_it_was(language: str, suffix: str) -> None:
    """A routine that changes the tool may leave the robot anywhere; the next point is not approached from there."""
    lines = in_order(written(language), suffix)
    starts = ("LIN", "MoveL")
    change = [i for i, line in enumerate(lines) if line.startswith("CHANGE")][-1]
    before = [line for line in lines[:change] if line.startswith(starts)][-1]
    after = next(line for line in lines[change:] if line.startswith(starts))
    place = re.compile(r"-?\d+\.\d{4}")
    assert place.findall(after)[:3] == place.findall(before)[:3] == ["40.0000", "0.0000", "20.0000"]
    assert not after.endswith("C_DIS")
    assert "z0" not in after


@pytest.mark.parametrize(("language", "suffix"), [("krl", "src"), ("rapid", "mod")])
def test_one_tool_stays_one_file(language: str, suffix: str) -> None:
    text = TWO_TOOLS.replace("T2 M6\nM3 S12000\n", "")
    result = written(language, text)
    assert [name for name in result.files if name.endswith(suffix)] == [f"part.{suffix}"]


@pytest.mark.parametrize("end", ["M30", "M2", "%"])
def test_the_end_stops_spindle_and_coolant(end: str) -> None:
    """A milling machine does that at M2 and M30 by itself; a robot would go on turning."""
    start = "%\n" if end == "%" else ""
    lines = in_order(written("krl", f"{start}G21 G90\nM3 S800 M7\nG0 X0 Y0 Z5\nG1 X5 F100\n{end}\n"), "src")
    assert [line for line in lines if re.match(r"[A-Z_]+\(", line)] == [
        *("SPINDLE_ON(800)", "MIST( )", "DRY( )", "SPINDLE_OFF( )")
    ]
    last = max(i for i, line in enumerate(lines) if line.startswith("LIN"))
    assert not lines[last].endswith("C_DIS")
    assert lines.index("SPINDLE_OFF( )") > last


def test_nothing_is_stopped_twice() -> None:
    lines = in_order(written("krl", "G21 G90\nM3 S800 M8\nG0 X0 Y0 Z5\nG1 X5 F100\nM5 M9\nM30\n"), "src")
    assert [line for line in lines if re.match(r"[A-Z_]+\(", line)] == [
        *("SPINDLE_ON(800)", "FLOOD( )", "DRY( )", "SPINDLE_OFF( )")
    ]


@pytest.mark.parametrize(("language", "suffix"), [("krl", "src"), ("rapid", "mod")])
@pytest.mark.parametrize("last", ["G0 Z20 M9 M5", "G0 Z20 M5 M9", "G0 Z20\nM30", "G0 Z20\nM5 M9"])
def test_coolant_goes_before_a_person_is_asked_to_stop_the_spindle(language: str, suffix: str, last: str) -> None:
    """And the tool is out of the cut by then: what a block stops, it stops behind its motion (DIN 66025-2)."""
    mapped: dict[int, tuple[str, ...]] = {3: (), 5: (), 8: ("FLOOD( )",), 9: ("DRY( )",)}
    text = f"G21 G90\nM3 S800 M8\nG0 X0 Y0 Z20\nG1 Z-1 F600\nG1 X40\n{last}\n"
    lines = in_order(written(language, text, mapped), suffix)
    out = max(i for i, line in enumerate(lines) if line.startswith(("LIN", "MoveL")))
    stops = [i for i, line in enumerate(lines) if re.match(r"HALT|Stop;", line)]
    assert len(stops) == 2
    assert stops[0] < lines.index("FLOOD( )") < out < lines.index("DRY( )") < stops[1]


@pytest.mark.parametrize("code", ["M0", "M1", "M60"])
def test_a_stop_comes_behind_the_motion_of_its_block(code: str) -> None:
    text = f"G21 G90\nG0 X0 Y0 Z20\nG1 Z-1 F600\nG1 X40\nG0 Z20 {code}\nG0 X0\nM2\n"
    lines = [line for line in in_order(written("krl", text, {}), "src") if line.startswith(("LIN", "HALT"))]
    assert lines.index("HALT") == len(lines) - 2
    assert lines[-3].endswith("}")  # it stands there


def test_the_main_file_of_a_long_program_holds_what_comes_before_and_behind_its_path() -> None:
    """Nothing moves there, and a person may be asked for something: no part of the path may stop for that."""
    mapped: dict[int, tuple[str, ...]] = {3: (), 5: (), 8: ("FLOOD( )",), 9: ("DRY( )",)}
    text = "G21 G90\nM3 S800 M8\nG0 X0 Y0 Z20\nG1 Z-1 F600\nG1 X40\nG1 Y9\nG0 Z20\nM9\nM5\nM30\n"
    program, path, poses = job(text)
    settings = KrlSettings(name="part", start_axes_rad=START, points_per_file=2)
    result = KrlWriter(program, path, poses, settings, block_lines=MachineFunctions("krl", mapped).lines).text()
    main = [line for line in result.files["part.src"].splitlines() if re.match(r"HALT|PTP|DRY|FLOOD|part_", line)]
    calls = [line for line in main if line.startswith("part_")]
    first, last = "HALT ; start the spindle, 800 rpm, then press start", "HALT ; stop the spindle, then press start"
    assert len(calls) > 1
    assert main == ["PTP XSTART", first, "FLOOD( )", *calls, "DRY( )", last]
    assert not any("HALT" in text for name, text in result.files.items() if name != "part.src")


def test_a_boring_cycle_backs_out_with_the_spindle_stopped() -> None:
    text = "G21 G90\nM3 S800\nG0 X0 Y0 Z5\nG86 X5 Y5 Z-3 R1 P0.2 F100\nX10\nG80\nM5\nM2\n"
    lines = in_order(written("krl", text), "src")
    seen = [line for line in lines if re.match(r"SPINDLE|LIN|WAIT SEC 0.200", line)]
    for hole in (1, 2):
        dwell = [i for i, line in enumerate(seen) if line.startswith("WAIT")][hole - 1]
        assert seen[dwell + 1] == "SPINDLE_OFF( )"
        assert re.search(r"Z [1-5]\.0000", seen[dwell + 2])  # out
        assert seen[dwell + 3] == "SPINDLE_ON(800)"
    assert seen.count("SPINDLE_ON(800)") == 3
    assert seen.count("SPINDLE_OFF( )") == 3


@pytest.mark.parametrize("language", ["krl", "rapid"])
@pytest.mark.parametrize(
    ("line", "key"),
    [
        *(("M3 S100", "clockwise"), ("M4 S100", "counter_clockwise"), ("M5", "off"), ("M7", "mist"), ("M8", "flood")),
        *(("M9", "coolant_off"), ("T1 M6", "tool_change"), ("M61 Q1", r"m_codes\.M61"), ("M62 P1", r"m_codes\.M62")),
    ],
)
def test_what_is_not_mapped_is_no_comment(language: str, line: str, key: str) -> None:
    with pytest.raises(ProgramError, match=rf"controller\.spindle\.{language}\.{key}") as caught:
        written(language, f"G21 G90\nG0 X0 Y0 Z5\n{line}\nG1 X5 F100\nM2\n", {})
    assert caught.value.where == "line 3"


def test_calls_and_ends_need_no_mapping() -> None:
    text = "G21 G90\nG0 X0 Y0 Z5\nM98 P7\nG1 X5 F100\nM48\nM0\nM2\nO7\nG1 X9 F50\nM99\n"
    lines = in_order(written("krl", text, {}), "src")
    assert lines.count("HALT") == 1
