"""RAPID as posts write it: targets, routines, frames, speeds, process words, and what is refused."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.errors import ProgramError
from counterflex.core.units import MM, MM_PER_S, RPM
from counterflex.geometry import pose, rotation
from counterflex.integrations.abb.language.program import RapidProgram
from counterflex.integrations.abb.language.read.frames import RapidCell
from counterflex.integrations.abb.language.read.reader import read_rapid, read_rapid_file
from counterflex.integrations.abb.language.writer import RapidSettings, RapidWriter
from counterflex.path.toolpath import tool_orientation
from counterflex.programs.compensated import tool_path
from counterflex.programs.gcode.read.reader import read_gcode
from counterflex.programs.robot_writer.machine_functions import MachineFunctions
from rapid_points import rapid_points

EXAMPLES = Path(__file__).parents[2] / "examples" / "programs"
REST = "[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]"
DOWN = f"[0,0,1,0],{REST}"
FRAMES = (
    "PERS tooldata t1:=[TRUE,[[0,0,100],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];\n"
    'PERS wobjdata w1:=[FALSE,TRUE,"",[[500,0,0],[1,0,0,0]],[[0,0,20],[1,0,0,0]]];\n'
)
TABLE = MachineFunctions(
    "rapid",
    {
        3: ["SetAO aoSpeed,{s};", "SetDO doSpindle,1;"], 5: ["Reset doSpindle;"], 6: ["ToolTo {t};"],
        8: ["SetDO doMist, 1;"],
    },
    ready="diAtSpeed=1",
)  # fmt: skip
MOVE = "t1\\WObj:=w1;"


def cell(**changes: object) -> RapidCell:
    """A cell with one tool 100 mm in front of the flange and the part 500 mm in front of the robot."""
    about = {
        "where": "cell.toml", "tools": [1], "tool_of_data": {"TNAMED": 1}, "work_object": "wNamed",
        "T_flange_tcp": pose.make(None, np.array([0.0, 0.0, 0.1])),
        "T_base_part": pose.make(None, np.array([0.5, 0.0, 0.02])), "T_base_tcp": None, "functions": TABLE,
    }  # fmt: skip
    return RapidCell(**(about | changes))  # type: ignore[arg-type]


def program(body: str, declared: str = "", *, of: RapidCell | None = None) -> RapidProgram:
    """A module with one routine."""
    text = f"MODULE part_m\n{FRAMES}{declared}\nPROC main()\n{body}\nENDPROC\nENDMODULE\n"
    return read_rapid(text, name="part.mod", cell=of or cell())


def at(x: float, y: float, z: float) -> str:
    """A robtarget with the tool down."""
    return f"[[{x},{y},{z}],{DOWN}]"


def test_lines_of_a_path() -> None:
    made = program(
        f"MoveJ {at(10, 20, 30)},v1000,z50,{MOVE}\nmovel {at(11.5, 20, 30)}, v20, z1\\Z:=2, t1 \\WObj := w1 ;\n"
        f"MoveL {at(11.5, 20, -1)},[50,500,5000,1000],fine,{MOVE} MoveL Offs(p,0,0,h),vOwn\\V:=12.5,fine,{MOVE}",
        f"CONST robtarget p:={at(1, 2, 3)};\nCONST num h:=4.5;\nCONST speeddata vOwn:=[7,500,5000,1000];",
    )
    assert [motion.kind for motion in made.motions] == ["rapid", "feed", "feed", "feed"]
    assert [motion.feed_m_s for motion in made.motions] == [0.0, 0.02, 0.05, 0.0125]
    np.testing.assert_allclose(made.motions[3].p_end, [0.001, 0.002, 0.0075])
    assert [move.line for move in made.moves] == [8, 9, 10, 10]
    assert all(motion.abc_end == (0.0, 0.0, 0.0) and motion.tool == 1 for motion in made.motions)


def test_a_circle_goes_through_its_point() -> None:
    """Three quarters of a circle about (0, 0), from (10, 0) via (-10, 0) to (0, -10)."""
    made = program(f"MoveL {at(10, 0, 0)},v20,z1,{MOVE}\nMoveC {at(-10, 0, 0)},{at(0, -10, 0)},v20,z1,{MOVE}")
    arc = made.motions[1]
    assert arc.kind == "arc"
    assert arc.p_centre is not None
    assert arc.normal is not None
    np.testing.assert_allclose(arc.p_centre, 0.0, atol=1e-12)
    assert float(arc.normal[2]) * arc.turn_rad == pytest.approx(math.radians(270))


def test_routines_are_executed_where_they_are_called() -> None:
    made = read_rapid(
        f"MODULE m\nPROC cut()\nMoveL {at(2, 0, 0)},v20,z1,tool0;\nENDPROC\nFUNC num f(num a)\nRETURN a;\nENDFUNC\n"
        f"TRAP stopped\nStop;\nENDTRAP\nPROC main()\nMoveJ {at(1, 0, 0)},v20,z1,tool0;\ncut;\n"
        f"MoveL {at(3, 0, 0)},v20,z1,tool0;\nCUT ;\nERROR\nRETRY;\nENDPROC\nENDMODULE\n"
    )
    assert [round(float(motion.p_end[0]) / MM) for motion in made.motions] == [1, 2, 3, 2]
    assert [call.routine for call in made.calls] == ["main", "cut", "cut"]
    assert [call.repeated for call in made.calls] == [False, True, True]
    assert not made.straight


def test_process_words_of_the_table() -> None:
    """The table read backwards, the wait for the spindle included; what it does not name stays a statement."""
    wait = "\n".join(TABLE.templates()[3][1])
    made = program(
        f"ToolTo 4;\nMoveJ {at(0, 0, 50)},v500,z1,{MOVE}\nSETAO aoSpeed , 12000;\nSetDO doSpindle,1;! on\n{wait}\n"
        f"SetDO doMist,1;\nMoveL {at(0, 0, 10)},v20,z1,{MOVE}\nSetDO doOther,1;\nreset doSpindle;\n"
        f"MoveL {at(0, 0, 60)},v20,z1,{MOVE}\nStop;"
    )
    assert [motion.tool for motion in made.motions] == [4, 4, 4]
    np.testing.assert_allclose([m.spindle_rad_s for m in made.motions], [0.0, 12000 * RPM, 0.0])
    words = [(word.letter, word.value) for block in made.blocks for word in block.words if word.letter in "MST"]
    assert words == [("M", 6.0), ("T", 4.0), ("M", 3.0), ("S", 12000.0), ("M", 8.0), ("M", 5.0), ("M", 0.0)]
    assert made.acting == (13,)


def test_frames_by_name_and_axes_named_otherwise() -> None:
    """Frames of the controller that the cell file names; one with x along the tool points down too."""
    made = program(f"MoveJ {at(1, 2, 3)},v100,fine,tNamed\\WObj:=wNamed;")
    assert made.motions[0].tool == 1
    named = "PERS tooldata tx:=[TRUE,[[0,0,100],[0.70710678,0,-0.70710678,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];"
    made = program(f"MoveJ [[1,2,3],[0.70710678,0,0.70710678,0],{REST}],v100,fine,tx\\WObj:=w1;", named)
    assert made.Rs_part_tcp is not None
    np.testing.assert_allclose(made.Rs_part_tcp[0] @ [0, 0, 1], [0, 0, -1], atol=1e-8)
    assert made.motions[0].abc_end == (0.0, 0.0, 0.0)


def test_a_part_on_the_robot() -> None:
    """The tool stands (robhold FALSE), the work object is on the flange (robhold TRUE): as in the cell, or refused."""
    T_flange_part = pose.make(rotation.about_z(0.3), np.array([0.0, 0.01, 0.2]))
    T_base_tcp = pose.make(rotation.about_x(0.1), np.array([1.5, 0.0, 0.9]))
    holding = cell(T_flange_tcp=T_flange_part, T_base_part=np.eye(4), T_base_tcp=T_base_tcp)

    def words(T: np.ndarray) -> str:
        p, q = T[:3, 3] / MM, rotation.quat_wxyz(T[:3, :3])
        return f"[[{','.join(f'{v:.6f}' for v in p)}],[{','.join(f'{v:.9f}' for v in q)}]]"

    declared = (
        f"PERS tooldata tFix:=[FALSE,{words(T_base_tcp)},[1,[0,0,1],[1,0,0,0],0,0,0]];\n"
        f'PERS wobjdata wHeld:=[TRUE,TRUE,"",[[0,0,0],[1,0,0,0]],{words(T_flange_part)}];'
    )
    body = f"MoveJ {at(1, 2, 3)},v100,fine,tFix\\WObj:=wHeld;"
    assert len(program(body, declared, of=holding).motions) == 1
    with pytest.raises(ProgramError, match=r"work object is on the robot, in the cell file it is not so"):
        program(body, declared)
    with pytest.raises(ProgramError, match=r"the work object is not on the robot"):
        program(f"MoveJ {at(1, 2, 3)},v100,fine,{MOVE}", of=holding)


GOOD = f"MoveJ {at(0, 0, 0)},v100,fine,{MOVE}"


@pytest.mark.parametrize(
    ("body", "says", "where"),
    [
        (f"FOR i FROM 1 TO b DO\n{GOOD}\nENDFOR", "a motion inside FOR (part.mod:6)", ":7:1"),
        (f"IF a=1 {GOOD}", "a motion inside IF", ":6:8"),
        ("IF a=1 THEN", "IF is not closed", ":6"),
        ("ENDWHILE", "closes nothing", ":6:1"),
        ("GOTO away;", "the label away is not", ":6:1"),
        ("main;", "calls itself", ":6:1"),
        ("Mill 3;", "not known, which may move the robot", ":6:1"),
        ("%\"part\"%;", "the routine part is not in the files", ":6:1"),
        ("SearchL di1,p,p,v10,t1;", "ends where a sensor says", ":6:1"),
        ("PDispSet 5;", "needs a pose", ":6:1"),
        ("VelSet 0,1000;", "VelSet is out of range", ":6:1"),
        (f"MoveL nowhere,v100,fine,{MOVE}", "where nowhere is, is not known", ":6:7"),
        (f"MoveL *,v100,fine,{MOVE}", "stored in the instruction", ":6:7"),
        (f"MoveL CRobT(),v100,fine,{MOVE}", "the target is not known: CRobT() asks", ":6:7"),
        (f"p:=CRobT();\nMoveL p,v100,fine,{MOVE}", "CRobT() asks the controller in part.mod:6", ":7:7"),
        (f"MoveL Offs(p,0,0,reg1),v100,fine,{MOVE}", "displacement of Offs", ":6:18"),
        (f"MoveL [[0,0,0],[0,0,0.9,0],{REST}],v100,fine,{MOVE}", "no rotation; got [0,0,0.9,0] of length 0.9000",
         ":6:7"),
        (f"MoveL [[0,0,1e9],[0,0,1,0],{REST}],v100,fine,{MOVE}", "out of reach of every robot", ":6:7"),
        (f"MoveL p,vmax,fine,{MOVE}", "the speed is not known: the largest speed", ":6:9"),
        (f"MoveL p,v20\\T:=0,fine,{MOVE}", "speed is out of range", ":6:9"),
        (f"MoveL p,[0,500,5000,1000],fine,{MOVE}", "speed is out of range", ":6:9"),
        (f"MoveL p,v20,zOwn,{MOVE}", "the zone is not known: zOwn is declared nowhere", ":6:13"),
        ("MoveL p,v20,fine,t1\\Corr\\WObj:=w1;", "\\CORR is not read", ""),
        ("MoveL p,v20,fine;", "has 4 arguments", ":6:1"),
        ("MoveL p,v20,fine,tOther\\WObj:=w1;", "where the tip of the tool is", ":6:18"),
        ("MoveL p,v20,fine,tool0\\WObj:=w1;", "tip of tool0 is not where", ":6:18"),
        ("MoveL p,v20,fine,t1\\WObj:=wOther;", "which frame the targets", ":6:18"),
        ("MoveL p,v20,fine,t1;", "wobj0 is not the part frame", ":6:18"),
        (f"w1.uframe.trans.z:=5;\n{GOOD}", "the work object w1 is not the part frame of the cell; got 5.000 mm", ":7"),
        (f"{GOOD}\nMoveAbsJ j,v100,fine,t1;\nMoveL p,v20,fine,{MOVE}", "a place that is not known", ":8:1"),
        (f"{GOOD}\nMoveC {at(1, 0, 0)},{at(2, 0, 0)},v20,z1,{MOVE}", "on a line", ":7:1"),
        ("WaitTime t_wait;", "the time of a wait", ":6:1"),
        ("MoveL p,v20,fine,t1\\WObj:=w1", "without its semicolon", ":6:1"),
    ],
)  # fmt: skip
def test_what_is_refused_names_its_place(body: str, says: str, where: str) -> None:
    with pytest.raises(ProgramError) as fault:
        program(body, f"CONST robtarget p:={at(0, 0, 0)};")
    assert says in str(fault.value)
    assert f"part.mod{where}" in str(fault.value)
    assert "\n" not in str(fault.value)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "empty"),
        ("PROC main()\nENDPROC\n", "does not begin with MODULE"),
        ("MODULE m\nPROC main()\nENDPROC\n", "without ENDMODULE"),
        ("MODULE m\nPROC main()\nENDMODULE\n", "ENDPROC is missing"),
        ("MODULE m\nMoveL p;\nENDMODULE\n", "outside of every routine"),
        ("MODULE m\nENDMODULE\n", "which routine is the program"),
        ("MODULE m\nPROC a()\nENDPROC\nPROC b()\nENDPROC\nENDMODULE\n", "which routine is the program"),
        ("MODULE m\nPROC a()\nENDPROC\nPROC A()\nENDPROC\nENDMODULE\n", "is there twice"),
        ("MODULE m\nCONST num a:=1;\nCONST num A:=1;\nPROC a()\nENDPROC\nENDMODULE\n", "declared twice"),
        ("MODULE m\nPROC a(num x)\nENDPROC\nPROC main()\na;\nENDPROC\nENDMODULE\n", "a needs the argument x"),
        ("MODULE m\nPROC main()\nENDPROC\nENDMODULE\nMODULE n\nENDMODULE\n", "has ended before this"),
    ],
)
def test_whole_files_that_are_refused(text: str, says: str) -> None:
    with pytest.raises(ProgramError) as fault:
        read_rapid(text, cell=cell())
    assert says in str(fault.value)
    assert "\n" not in str(fault.value)


@settings(max_examples=150, deadline=None)
@given(change=st.integers(0, 2200), character=st.characters(max_codepoint=255), cut=st.integers(0, 2200))
def test_damaged_programs_are_read_or_refused_in_one_line(change: int, character: str, cut: int) -> None:
    """The example, cut off or with one other character: no other outcome than these two."""
    source = (EXAMPLES / "groove.mod").read_text()
    for text in (source[:change] + character + source[change + 1 :], source[:cut]):
        refused = ""
        try:
            read_rapid(text)
        except ProgramError as fault:
            refused = str(fault)
        assert "\n" not in refused


def test_the_example() -> None:
    made = read_rapid_file(EXAMPLES / "groove.mod")
    assert [move.line for move in made.moves] == [33, 34, 38, 40, 41]
    assert made.acting == (39,)


COORDINATE = st.integers(-30_000, 30_000).map(lambda value: value / 1000.0)
FORMS = ("lit", "name", "offs", "rel", "array", "arc")


@st.composite
def modules(draw: st.DrawFn) -> str:
    """Motions of all forms in two routines, one of them called twice."""
    declared, bodies, elements = [], {"main": [f"MoveJ {at(0, 0, 100)},v500,fine,tool0;"], "sub": []}, []
    for number in range(draw(st.integers(1, 6))):
        x, y, z = (draw(COORDINATE) for _ in range(3))
        form, speed = draw(st.sampled_from(FORMS)), draw(st.sampled_from(["v20", "v50\\V:=33.5", "vOwn"]))
        target = f"[[{x},{y},{z}],[0,0.6,0.8,0],{REST}]"
        if form in ("name", "offs", "rel"):
            declared.append(f"CONST robtarget p{number}:={target};")
            extra = {"name": "", "offs": ",1.5,-2,h", "rel": ",1,2,-3\\Rx:=5\\Rz:=20"}[form]
            target = f"p{number}" if form == "name" else f"{'Offs' if form == 'offs' else 'RelTool'}(p{number}{extra})"
        elif form == "array":
            elements.append(target)
            target = f"q{{{len(elements)}}}"
        word = "MoveL"
        if form == "arc":
            word, target = "MoveC", f"[[{x + 5.5},{y + 40},{z}],{DOWN}],{target}"
        line = f"{word} {target},{speed},{draw(st.sampled_from(['fine', 'z0', 'z10']))},tool0\\WObj:=wobj0;"
        bodies[draw(st.sampled_from(["main", "sub"]))].append(line)
    where = draw(st.integers(1, len(bodies["main"])))
    bodies["main"].insert(where, "sub;")
    if draw(st.booleans()):
        bodies["main"] += [f"MoveL {at(1, 1, 90)},v50,z5,tool0;", "SUB ;"]
    if elements:
        declared.append(f"PERS robtarget q{{{len(elements)}}}:=[{', '.join(elements)}];")
    routines = "".join(
        f"  PROC {name}()\n    " + "\n    ".join(body) + "\n  ENDPROC\n" for name, body in bodies.items()
    )
    head = "CONST num h:=2.25;\n  CONST speeddata vOwn:=[17.5,500,5000,1000];\n  "
    return f"MODULE part_m\n  {head}" + "\n  ".join(declared) + f"\n{routines}ENDMODULE\n"


@settings(max_examples=60, deadline=None)
@given(modules())
def test_another_reader_finds_the_same_motions(text: str) -> None:
    made, other = read_rapid(text), rapid_points(text)
    assert len(made.motions) == len(other)
    assert made.Rs_part_tcp is not None
    for motion, R, point in zip(made.motions, made.Rs_part_tcp, other, strict=True):
        np.testing.assert_allclose(motion.p_end / MM, point.points[-1], atol=1e-9)
        np.testing.assert_allclose(R, point.R, atol=1e-9)
        assert motion.kind == "rapid" or motion.feed_m_s == pytest.approx(point.speed * MM_PER_S)
        if motion.kind == "arc" and motion.p_centre is not None:
            radii = [np.linalg.norm(p - motion.p_centre / MM) for p in (*point.points, motion.p_start / MM)]
            assert max(radii) - min(radii) < 1e-6 * max(radii)


def test_the_output_of_the_writer_is_read_back_as_the_same_path() -> None:
    """G-code written as RAPID for a cell, read back: the same points within half a last decimal, and speeds."""
    gcode = read_gcode(
        "G21 G90 G17\nT1 M6\nM3 S9000\nG0 X0 Y0 Z20\nG1 Z-2 F600\nG1 X40 F1200\nG3 X50 Y10 J10\nG0 Z20\nM5\nM30\n"
    )
    path = tool_path(gcode)
    Ts = pose.make(tool_orientation(path.axis_part, 0.5), path.p_part_tcp)
    table = MachineFunctions("rapid", {3: ["SetGO goRpm,{s};", "Set doOn;"], 5: ["Reset doOn;"], 6: []})
    here = cell(functions=table)
    options = RapidSettings(
        name="part", start_axes_rad=[0.0] * 6, T_flange_tcp=here.T_flange_tcp, T_base_part=here.T_base_part
    )
    text = RapidWriter(gcode, path, Ts, options, block_lines=table.lines).text()
    back = read_rapid(text.files["part.mod"], cell=here)
    cut = [m for m in back.motions if m.feed_m_s in (0.01, 0.02)]
    assert len(cut) > 5
    assert {round(m.spindle_rad_s / RPM) for m in cut} == {9000}
    read, wanted = tool_path(back, step_m=1e-4).p_part_tcp, path.p_part_tcp[path.kind == 1]
    gap = np.linalg.norm(read[:, None] - wanted[None], axis=2).min(axis=0)
    assert float(gap.max()) < 1e-5 + 0.6e-4  # tolerance of the writer, half a step of the samples
    np.testing.assert_allclose(back.motions[-1].p_end, path.p_part_tcp[-1], atol=1e-7)
