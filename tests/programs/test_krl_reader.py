"""KRL as CAM posts write it: targets, frames, speeds, process words, and what is refused."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.errors import ProgramError
from counterflex.core.units import RPM
from counterflex.geometry import pose
from counterflex.integrations.kuka.language.program import KrlProgram
from counterflex.integrations.kuka.language.read.frames import KrlCell
from counterflex.integrations.kuka.language.read.reader import read_krl, read_krl_file
from counterflex.integrations.kuka.language.writer import KrlSettings, KrlWriter
from counterflex.path.toolpath import tool_orientation
from counterflex.programs.compensated import tool_path
from counterflex.programs.gcode.read.reader import read_gcode
from counterflex.programs.robot_writer.machine_functions import MachineFunctions

EXAMPLES = Path(__file__).parents[2] / "examples" / "programs"
FRAMES = "$TOOL=TOOL_DATA[1]\n$BASE=BASE_DATA[1]\n"
DOWN = "A 0.0,B 0.0,C 180.0"
TABLE = MachineFunctions(
    "krl",
    {3: ["$ANOUT[1]={s}/24000.0", "$OUT[17]=TRUE"], 5: ["$OUT[17]=FALSE"], 6: ["CHANGE({t})"], 8: ["$OUT[18] = TRUE"]},
    ready="$IN[3]",
)


def cell(**changes: object) -> KrlCell:
    """A cell with one tool, all frames the identity."""
    about = {
        "where": "cell.toml", "tool_number": 1, "base_number": 1, "tools": [1], "tool_of_data": {},
        "T_flange_tcp": np.eye(4), "T_base_part": np.eye(4), "functions": TABLE,
    }  # fmt: skip
    return KrlCell(**(about | changes))  # type: ignore[arg-type]


def program(body: str, data: str | None = None, *, frames: str = FRAMES, **options: object) -> KrlProgram:
    """A program with its frames and speed set."""
    text = f"DEF part ( )\n{frames}$VEL.CP=0.02\n{body}\nEND\n"
    listed = None if data is None else f"DEFDAT part\n{data}\nENDDAT\n"
    return read_krl(text, name="part.src", data=listed, data_name="part.dat", cell=cell(), **options)  # type: ignore[arg-type]


def test_lines_of_a_path() -> None:
    made = program(f"PTP {{X 10,Y 20,Z 30,{DOWN},S 2,T 35}}\nLIN {{X 11.5}} C_DIS\n$VEL.CP = 0.05\nslin {{Z -1e1}}")
    assert [motion.kind for motion in made.motions] == ["rapid", "feed", "feed"]
    np.testing.assert_allclose(
        [m.p_end for m in made.motions], [[0.01, 0.02, 0.03], [0.0115, 0.02, 0.03], [0.0115, 0.02, -0.01]]
    )
    assert [motion.feed_m_s for motion in made.motions] == [0.0, 0.02, 0.05]
    assert all(motion.abc_end == (0.0, 0.0, 0.0) and motion.tool == 1 for motion in made.motions)


def test_targets_by_name_and_frame_data_of_inline_forms() -> None:
    body = (
        ";FOLD LIN P1 Vel=0.03 m/s CPDAT1 Tool[1] Base[1];%{PE}\nFDAT_ACT=FP1\nLDAT_ACT=LCPDAT1\nBAS(#CP_PARAMS,0.03)\n"
        "LIN XP1 C_DIS\n;ENDFOLD\nBAS(#CP_DAT)\nLIN P[2]"
    )
    data = (
        f"DECL E6POS XP1={{X 1.0,Y 2.0,Z 3.0,{DOWN},S 6,T 18,E1 0.0}}\nDECL FDAT FP1={{TOOL_NO 1,BASE_NO 1}}\n"
        f"DECL LDAT LCPDAT1={{VEL 0.04,ACC 100.0}}\nDECL FRAME P[3]\nP[2]={{X 5,Y 2,Z 3,{DOWN}}}"
    )
    made = program(body, data, frames="")
    np.testing.assert_allclose(made.motions[1].p_end, [0.005, 0.002, 0.003])
    assert made.motions[1].feed_m_s == 0.04
    target = made.moves[0].target
    assert target is not None
    assert (target.in_data, target.line) == (True, 2)


@pytest.mark.parametrize(("ca", "turn"), [("", 90.0), (",CA 180.0", 180.0), (",CA -270", -270.0), (",CA 360", 360.0)])
def test_circles(ca: str, turn: float) -> None:
    """Quarter of a circle about (0, 0), from (10, 0) via (cos 45, sin 45) 10 to (0, 10); CA goes on, or back."""
    s = 10.0 * math.sqrt(0.5)
    made = program(f"LIN {{X 10,Y 0,Z 0,{DOWN}}}\nCIRC {{X {s:.9f},Y {s:.9f}}},{{X 0,Y 10}}{ca} C_DIS")
    arc = made.motions[1]
    assert arc.kind == "arc"
    assert arc.p_centre is not None
    assert arc.normal is not None
    np.testing.assert_allclose(arc.p_centre, 0.0, atol=1e-9)
    assert float(arc.normal[2]) * arc.turn_rad == pytest.approx(math.radians(turn), abs=1e-8)
    end = [0.01 * math.cos(math.radians(turn)), 0.01 * math.sin(math.radians(turn)), 0.0]
    np.testing.assert_allclose(tool_path(made).p_part_tcp[-1], end, atol=1e-9)


def test_spline_blocks_of_straight_segments_and_circles() -> None:
    """Speeds of the block, of a segment, and behind the block; segments are where they are written."""
    made = program(
        f"{GOOD}\nSPLINE WITH $VEL.CP=0.05, $ACC.CP=1.0\nSLIN {{X 10}}\n  SLIN {{X 20}} WITH $VEL.CP = 0.03\n"
        "SCIRC {X 25,Y 5},{X 20,Y 10}\nTRIGGER WHEN PATH=0 DELAY=0 DO $OUT[1]=TRUE\nENDSPLINE C_SPL\nSLIN {X 0}"
    )
    assert [motion.feed_m_s for motion in made.motions] == [0.0, 0.05, 0.03, 0.05, 0.02]
    assert [motion.kind for motion in made.motions] == ["rapid", "feed", "feed", "arc", "feed"]
    assert [move.in_spline for move in made.moves] == [False, True, True, True, False]


INLINE = (
    "$TOOL = STOOL2( FP2), $BASE = SBASE( FP2.BASE_NO), $IPO_MODE = SIPO_MODE( FP2.IPO_FRAME), "
    "$LOAD = SLOAD( FP2.TOOL_NO), $ACC = SACC_CP( LCPDAT1), $ORI_TYPE = SORI_TYP( LCPDAT1), $APO = SAPO( LCPDAT1), "
    "$JERK = SJERK( LCPDAT1), $COLLMON_TOL_PRO[1] = USE_CM_PRO_VALUES( 0)"
)


def test_inline_forms_of_spline_motions() -> None:
    """As KSS 8.3 and later write them: speed, tool and base of a motion behind its WITH, approximation at the end."""
    body = (
        "SPTP XHOME WITH $VEL_AXIS[1] = SVEL_JOINT( 100.0), $TOOL = STOOL2( FHOME), $GEAR_JERK[1] = SGEAR_JERK( PDEF)\n"
        f"SLIN XP1 WITH $VEL = SVEL_CP( 0.1, , LCPDAT1), {INLINE} C_SPL\n"
        f"SLIN XP2 WITH $VEL = SVEL_CP( 0.05, , LCPDAT1), {INLINE}\nSLIN {{X 9}} WITH $VEL.CP=0.03 C_SPL\n"
        "SLIN {X 12} C_SPL WITH $VEL={ORI1 200, CP 0.04}\nSLIN {X 15}"
    )
    data = (
        f"DECL E6POS XP1={{X 1.0,Y 2.0,Z 3.0,{DOWN},S 6,T 18}}\nDECL E6POS XP2={{X 5,Y 2,Z 3,{DOWN}}}\n"
        "DECL FDAT FP2={TOOL_NO 1,BASE_NO 1,IPO_FRAME #BASE}\nDECL LDAT LCPDAT1={VEL 0.1,ORI_TYP #VAR}\n"
    )
    body = f"{FRAMES}{body}"
    made = program(body, data, frames="")
    assert [motion.feed_m_s for motion in made.motions] == [0.0, 0.05, 0.03, 0.04, 0.02]
    assert [move.approximation for move in made.moves] == ["C_SPL", "", "C_SPL", "C_SPL", ""]
    with pytest.raises(ProgramError, match=r"TOOL_DATA\[3\]"):
        program(body, data.replace("TOOL_NO 1", "TOOL_NO 3"), frames="")


@pytest.mark.parametrize(
    ("clause", "match"),
    [
        ("$VEL=SLOW", "the path speed is no number"),
        ("$VEL = SVEL_CP( V, , L)", "the path speed is not known: V is not declared"),
        ("$VEL.CP=0.1+X", "the path speed is not known: X is not declared"),
        ("$TOOL=MILL", r"\$TOOL is not known: MILL is not declared"),
        ("$TOOL=STOOL2(F1), $BASE=SBASE(F2.BASE_NO)", r"\$TOOL is not known: F1 is not declared"),
        ("$IPO_MODE=#TCP", "the robot holds the part"),
        ("$FOO=1", r"WITH \$FOO is not read"),
        ("$ACC=SACC_CP( L", "a bracket is not closed"),
        ("$ACC=1 C_SPL, $VEL.CP=1", "not understood behind a target"),
        ("fast", "WITH needs a system variable"),
    ],
)
def test_clauses_that_are_not_understood(clause: str, match: str) -> None:
    with pytest.raises(ProgramError, match=match):
        program(f"{GOOD}\nSLIN {{X 10}} WITH {clause}")


def test_a_wrist_that_runs_by_axes_is_refused() -> None:
    """$ORI_TYPE=#JOINT: orientations between the ends are those of the wrist's axes."""
    with pytest.raises(ProgramError, match=r"wrist runs by axes .*#JOINT"):
        program(f"{GOOD}\n$ORI_TYPE=#JOINT\nLIN {{X 10}}")
    made = program(f"{GOOD}\n$ORI_TYPE=#JOINT\nPTP {{X 10}}\n$ORI_TYPE=#VAR\nLIN {{X 20}}")
    assert [motion.kind for motion in made.motions[-2:]] == ["rapid", "feed"]


@pytest.mark.parametrize("given", ["$VEL={CP 0.05,ORI1 200.0,ORI2 200.0}", "$ACC.CP=1.0, $VEL = {ORI1 9, CP 0.05}"])
def test_speed_of_a_spline_block_as_a_whole(given: str) -> None:
    made = program(f"{GOOD}\nSPLINE WITH {given}\nSLIN {{X 10}}\nENDSPLINE\nSLIN {{X 0}}")
    assert [motion.feed_m_s for motion in made.motions] == [0.0, 0.05, 0.02]


@pytest.mark.parametrize("given", ["$VEL=SLOW", "$VEL.CP=V+0.1", "$VEL={CP V}"])
def test_a_speed_of_a_spline_block_that_is_not_known_is_refused(given: str) -> None:
    with pytest.raises(ProgramError, match="path speed of a spline block is no"):
        program(f"{GOOD}\nSPLINE WITH {given}\nSLIN {{X 10}}\nENDSPLINE")


def test_axis_angles_that_the_program_gives_a_name() -> None:
    """A place that is not known, as axis angles in the motion itself; a path cannot go there."""
    home = "DECL AXIS HOME\nHOME = {AXIS: A1 0,A2 -90,A3 90,A4 0,A5 0,A6 0}\nPTP HOME\n"
    made = program(f"{home}{GOOD}\nLIN {{X 5}}\nPTP HOME")
    assert [motion.kind for motion in made.motions] == ["rapid", "feed"]
    with pytest.raises(ProgramError, match="axis angles are no target of a path"):
        program(f"{home}{GOOD}\nLIN HOME")
    with pytest.raises(ProgramError, match=r"comes from a place that is not known.*\$AXIS_ACT"):
        program(f"{home}{GOOD}\nHOME.A1=5\nHOME=$AXIS_ACT\nPTP HOME\nLIN {{X 5}}")


def test_frame_data_as_a_controller_writes_them() -> None:
    """Names, truth values and texts beside the numbers of FDAT and LDAT; a target has numbers alone."""
    body = "FDAT_ACT=FP1\nLDAT_ACT=LCPDAT1\nBAS(#CP_PARAMS,0.03)\nLIN XP1\nBAS(#CP_DAT)\nLIN P"
    data = (
        f"DECL E6POS XP1={{X 1.0,Y 2.0,Z 3.0,{DOWN},S 6,T 18}}\nDECL E6POS P={{X 5,Y 2,Z 3,{DOWN}}}\n"
        'DECL FDAT FP1={TOOL_NO 1,BASE_NO 1,IPO_FRAME #BASE,POINT2[] " ",TQ_STATE FALSE}\n'
        "DECL LDAT LCPDAT1={VEL 0.04,ACC 100.0,ORI_TYP #VAR,CIRC_TYP #BASE,EXAX_IGN 0}\n"
    )
    assert [motion.feed_m_s for motion in program(body, data, frames="").motions] == [0.0, 0.04]
    with pytest.raises(ProgramError, match="this is no target"):
        program(body, data.replace("Y 2.0", "Y #BASE"), frames="")
    with pytest.raises(ProgramError, match="TOOL_NO of FDAT_ACT is not given"):
        program(body, data.replace("TOOL_NO 1", "TOOL_NO #ONE"), frames="")


def test_subprograms_of_the_same_file() -> None:
    """Executed where they are called, with the speed that is active there; one of another file is refused."""
    text = (
        f"DEF part( )\n{FRAMES}$VEL.CP=0.02\n{GOOD}\nCUT( )\nLIN {{X 5}}\ncut()\nEND\n"
        "DEF CUT( )\nLIN {X 10} C_DIS\n$VEL.CP=0.03\nDEEP( )\nEND\nDEF DEEP( )\nLIN {X 20}\nEND\n"
    )
    made = read_krl(text, name="part.src", cell=cell())
    assert [round(float(m.p_end[0]) * 1e3) for m in made.motions] == [0, 10, 20, 5, 10, 20]
    assert [m.feed_m_s for m in made.motions] == [0.0, 0.02, 0.03, 0.03, 0.03, 0.03]
    assert [m.line for m in made.moves] == [5, 11, 16, 7, 11, 16]
    assert all(
        made.blocks[motion.block].line == move.line for motion, move in zip(made.motions, made.moves, strict=True)
    )
    for wrong, says in (("DEEP( )", "calls itself"), ("CUT(3)", "more arguments than it has parameters")):
        with pytest.raises(ProgramError, match=says):
            read_krl(text.replace("LIN {X 20}", wrong), name="part.src", cell=cell())


def test_process_words_of_the_table() -> None:
    """The table read backwards, the wait for the spindle included; what it does not name stays a statement."""
    wait = "\n".join(TABLE.templates()[3][1])
    body = (
        f"CHANGE ( 4 )\nPTP {{X 0,Y 0,Z 50,{DOWN}}}\n$ANOUT[1] = 12000/24000.0\n$OUT[17]=true ; on\n{wait}\n"
        "TRIGGER WHEN DISTANCE=0 DELAY=0 DO $OUT[18]=TRUE\nLIN {Z 10}\n"
        "PULSE($OUT[5],TRUE,0.1)\n$OUT[17]=FALSE\nLIN {Z 60}"
    )
    made = program(body)
    assert [motion.tool for motion in made.motions] == [4, 4, 4]
    np.testing.assert_allclose([m.spindle_rad_s for m in made.motions], [0.0, 12000 * RPM, 0.0])
    words = [(word.letter, word.value) for block in made.blocks for word in block.words if word.letter in "MST"]
    assert words == [("M", 6.0), ("T", 4.0), ("M", 3.0), ("S", 12000.0), ("M", 8.0), ("M", 5.0)]


def test_a_tool_frame_whose_axes_are_named_otherwise() -> None:
    """$TOOL with x along the tool: the tip is that of the cell, and the tool still points down."""
    at_tip = cell(T_flange_tcp=pose.make(None, np.array([0.0, 0.0, 0.1])))
    text = "DEF a( )\n$TOOL={FRAME: X 0,Y 0,Z 100,A 0,B -90,C 0}\n$BASE={X 0,Y 0,Z 0,A 0,B 0,C 0}\n"
    made = read_krl(text + "PTP {X 1,Y 2,Z 3,A 0,B 90,C 0}\nEND\n", cell=at_tip)
    assert made.Rs_part_tcp is not None
    np.testing.assert_allclose(made.Rs_part_tcp[0] @ [0, 0, 1], [0, 0, -1], atol=1e-12)
    assert made.motions[0].abc_end == (0.0, 0.0, 0.0)


def test_a_tilted_tool_gives_its_axis() -> None:
    made = program("PTP {X 0,Y 0,Z 0,A 0,B 0,C 180}\nLIN {X 10,C 170}")
    np.testing.assert_allclose(
        made.motions[1].abc_end, [0.0, math.sin(math.radians(10)), math.cos(math.radians(10))], atol=1e-12
    )


def test_statements_that_act_are_known() -> None:
    """Outputs and waits that no table names, by line; stops, the standard interrupt and the table's are none."""
    trigger = "TRIGGER WHEN PATH=0 DELAY=0 DO $OUT[18]=TRUE"
    body = f"INTERRUPT ON 3\n$OUT[5]=TRUE\n$OUT[18]=TRUE\n{trigger}\nWAIT FOR $IN[2]\nHALT"
    assert program(body).acting == (6, 9)


GOOD = f"PTP {{X 0,Y 0,Z 0,{DOWN}}}"


@pytest.mark.parametrize(
    ("body", "says", "where"),
    [
        ("LIN_REL {X 1}", "relative targets", ":5:1"),
        (f"FOR I=1 TO $IN[1]\n{GOOD}\nENDFOR", "FOR in line 5 depends on a value that is not known: $IN", ":6:1"),
        (f"{GOOD}\nIF $IN[1] THEN\n$VEL.CP=0.1\nENDIF\nLIN {{X 1}}", "IF in line 6 depends on", ":9:1"),
        ("IF $IN[1] THEN", "IF is not closed", ":5"),
        ("ENDLOOP", "closes nothing", ":5:1"),
        ("GOTO AWAY", "a label that the routine does not have", ":5:1"),
        ("MILL_POCKET(3)", "a subprogram is called", ":5:1"),
        ("FROBNICATE 3", "an unknown statement", ":5:1"),
        ("SPL XP1", "controller's own", ":5:1"),
        (f"{GOOD}\nSPLINE", "SPLINE is not closed", ":7"),
        ("ENDSPLINE", "closes nothing", ":5:1"),
        (f"{GOOD}\nSPLINE\nLIN {{X 1}}", "LIN has no place in a spline block", ":7:1"),
        (f"{GOOD}\nSPLINE\n$VEL.CP=0.1", "this has no place in a spline block", ":7:1"),
        (f"{GOOD}\nSPLINE WITH $IPO_MODE=#TCP", "not understood", ":6:1"),
        (f"{GOOD}\nSLIN {{X 1}} WITH $VEL.CP=99", "no number in range", ":6:1"),
        ("LIN XP9", "where XP9 is, is not known", ":5:5"),
        ("P1.X=P1.X+1\nLIN P1", "P1 is not declared in the files of the job in part.src:5", ":6:5"),
        (f"{GOOD}\nLIN {{X SQRT(N)}}", "N is not declared", ":6:5"),
        (f"{GOOD}\nLIN {{X 1,Y 2", "not closed", ":6:5"),
        (f"{GOOD}\nLIN {{X 1,X 2}}", "twice", ":6:10"),
        (f"{GOOD}\nLIN {{X 1,Q 2}}", "Q is no component", ":6:5"),
        (f"{GOOD}\nLIN {{X 1e9}}", "beyond every robot", ":6:5"),
        (f"{GOOD}\nLIN", "without a target", ":6:4"),
        (f"{GOOD}\nLIN {{X 1}} WITH $VEL.CP=0.1", "not understood", ":6:11"),
        (f"{GOOD}\nLIN {{X 1}}:N", "N is not declared", ":6:5"),
        (f"{GOOD}\nLIN {{A1 1,A2 2}}", "axis angles", ":6:5"),
        (f"{GOOD}\nPTP XHOME\nLIN {{X 1}}", "a place that is not known", ":7:1"),
        (f"{GOOD}\nCIRC {{X 1}},{{X 2}}", "on a line", ":6"),
        (f"{GOOD}\nLIN {{X 1,E1 5}}\nLIN {{X 2,E1 6}}", "external axis E1 moves", ":7"),
        (f"{GOOD}\n$VEL.CP=30\nLIN {{X 1}}", "no number in range", ":7:1"),
        (f"$TOOL=TOOL_DATA[7]\n{GOOD}", "another tool frame", ":5:7"),
        (f"$BASE=BASE_DATA[2]\n{GOOD}", "another frame", ":5:7"),
        (f"$BASE={{X 1,Y 0,Z 0,A 0,B 0,C 0}}\n{GOOD}", "not the part frame", ":5:7"),
        (f"$TOOL={{X 0,Y 0.1,Z 0,A 0,B 0,C 0}}\n{GOOD}", "tip of $TOOL", ":5:7"),
        (f"$TOOL=MYTOOL\n{GOOD}", "$TOOL is not known: MYTOOL is not declared", ":6:1"),
        (f"$IPO_MODE=#TCP\n{GOOD}", "holds the part", ":6:1"),
        ("BAS(#EX_BASE,3)", "#EX_BASE is not read", ":5:1"),
        ("WAIT SEC T_WAIT", "the time of a wait is not known: T_WAIT", ":5:1"),
        ("LIN {X 1}", "without Y", ":5:9"),
    ],
)  # fmt: skip
def test_what_is_refused_names_its_place(body: str, says: str, where: str) -> None:
    with pytest.raises(ProgramError) as fault:
        program(body)
    assert says in str(fault.value)
    assert f"part.src{where}" in str(fault.value)
    assert "\n" not in str(fault.value)


@pytest.mark.parametrize(
    ("text", "data", "says"),
    [
        ("", None, "empty"),
        ("G1 X10\n", None, "does not begin with DEF"),
        ("DEF a( )\nHALT\n", None, "without END"),
        ("DEF a( )\r\nHALT\nEND\n", None, "mixes line ends"),
        (f"DEF a( )\n{GOOD}\nEND\n", None, "which $TOOL"),
        (f"DEF a( )\n$TOOL=TOOL_DATA[1]\n{GOOD}\nEND\n", None, "which $BASE"),
        (f"DEF a( )\n{FRAMES}{GOOD}\nLIN {{X 1}}\nEND\n", None, "before $VEL.CP"),
        ("DEF a( )\nEND\n", "DEFDAT a\nE6POS P={X 1}\n", "no ENDDAT"),
        ("DEF a( )\nEND\n", "DEFDAT a\nE6POS P={X 1}\nE6POS P={X 2}\nENDDAT\n", "given twice"),
        (f"DEF a( )\n{FRAMES}LIN P\nEND\n", "DEFDAT a\nE6POS P={X 1}\nENDDAT\n", "without Y"),
    ],
)
def test_whole_files_that_are_refused(text: str, data: str | None, says: str) -> None:
    with pytest.raises(ProgramError) as fault:
        read_krl(text, data=data, cell=cell())
    assert says in str(fault.value)


@settings(max_examples=150, deadline=None)
@given(
    cut=st.integers(0, 2000),
    change=st.integers(0, 2000),
    character=st.characters(max_codepoint=255),
    whole=st.booleans(),
)
def test_damaged_programs_are_read_or_refused_in_one_line(cut: int, change: int, character: str, whole: bool) -> None:
    """The example, cut off or with one other character, in either of its files: no other outcome than these two."""
    source, data = ((EXAMPLES / f"groove.{suffix}").read_text() for suffix in ("src", "dat"))
    if whole:
        source = source[:change] + character + source[change + 1 :]
    else:
        data = data[:cut] + character + data[change:]
    refused = ""
    try:
        read_krl(source if whole else source[: 300 + cut], data=data, cell=cell(functions=MachineFunctions("krl")))
    except ProgramError as fault:
        refused = str(fault)
    assert "\n" not in refused


def test_the_example(tmp_path: Path) -> None:
    """Both files, found beside each other; the words of the operator's table; the robot waits outside of the path."""
    by_hand = MachineFunctions("krl", {3: [], 5: [], 6: []})
    made = read_krl_file(EXAMPLES / "groove.src", cell=cell(functions=by_hand))
    assert [move.line for move in made.moves] == [23, 25, 28, 31, 33]
    assert made.motions[3].spindle_rad_s == pytest.approx(13000 * RPM)
    (tmp_path / "part.src").write_bytes((EXAMPLES / "groove.src").read_bytes())
    with pytest.raises(ProgramError, match="there is none beside it"):
        read_krl_file(tmp_path / "part.src")


def test_the_output_of_the_writer_is_read_back_as_the_same_path() -> None:
    """G-code written as KRL for a cell, read back: the same points within half a last decimal, and speeds."""
    gcode = read_gcode(
        "G21 G90 G17\nT1 M6\nM3 S9000\nG0 X0 Y0 Z20\nG1 Z-2 F600\nG1 X40 F1200\nG3 X50 Y10 J10\nG0 Z20\nM5\nM30\n"
    )
    path = tool_path(gcode)
    Ts = pose.make(tool_orientation(path.axis_part, 0.5), path.p_part_tcp)
    table = MachineFunctions("krl", {3: ["$OUT[1]=TRUE", "RPM={s}"], 5: ["$OUT[1]=FALSE"], 6: []})
    settings_ = KrlSettings(name="part", start_axes_rad=[0.0] * 6)
    text = KrlWriter(gcode, path, Ts, settings_, block_lines=table.lines).text()
    back = read_krl(text.files["part.src"], data=text.files["part.dat"], cell=cell(functions=table))
    cut = [m for m in back.motions if m.feed_m_s in (0.01, 0.02)]
    assert len(cut) > 5
    assert {round(m.spindle_rad_s / RPM) for m in cut} == {9000}
    read, wanted = tool_path(back, step_m=1e-4).p_part_tcp, path.p_part_tcp[path.kind == 1]
    gap = np.linalg.norm(read[:, None] - wanted[None], axis=2).min(axis=0)
    assert float(gap.max()) < 1e-5 + 0.6e-4  # tolerance of the writer, half a step of the samples
    np.testing.assert_allclose(back.motions[-1].p_end, path.p_part_tcp[-1], atol=1e-7)
