"""Variables, jumps, loops, subprograms and frames of Sinumerik, and what a program does not determine."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.errors import ProgramError
from counterflex.core.units import MM
from counterflex.integrations.siemens.language.reader import read_sinumerik, read_sinumerik_file
from counterflex.programs.compensated import CompensatedPath, tool_path
from counterflex.programs.gcode.read.parameter_file import MillingMachine
from counterflex.programs.gcode.write.writer import write_gcode
from counterflex.programs.listing import listing
from counterflex.programs.program import Program

HEAD = "G54 G17 G90 G71 G94\nT1\nM6\nS1000 M3 F600\nG0 X0 Y0 Z10\n"


def read(text: str, **machine: object) -> Program:
    return read_sinumerik(text, name="part.mpf", machine=MillingMachine(known=False, **machine))  # type: ignore[arg-type]


def ends(program: Program, first: int = 1) -> list[list[float]]:
    return [[round(float(x) / MM, 9) + 0.0 for x in motion.p_end] for motion in program.motions[first:]]


def last(text: str) -> list[float]:
    return ends(read(f"{HEAD}{text}M30\n"))[-1]


# A displacement after a change of the zero --------------------------------------------------------------------------

CHANGES = {
    "TRANS X10": (10.0, 0),
    "ATRANS X10": (10.0, 0),
    "G0 X5 Y0\nTRANS X10": (10.0, 0),
    "ROT Z90\nG90 G0 X5 Y7 Z10\nROT": (-12.0, 0),
    "MIRROR X0\nG90 G0 X5 Y0\nMIRROR": (-10.0, 0),
}


@pytest.mark.parametrize("word", ["G91 G1 X5", "G1 X=IC(5)"])
@pytest.mark.parametrize("change", sorted(CHANGES))
def test_a_displacement_after_a_change_of_the_zero_depends_on_a_setting(change: str, word: str) -> None:
    """SD42440: 1 (standard) travels the change as well, 0 the displacement alone."""
    with pytest.raises(ProgramError, match="SD42440") as caught:
        read(f"{HEAD}{change}\n{word}\nM30\n")
    line = HEAD.count("\n") + change.count("\n") + 1
    assert f"after its zero changed in line {line}" in str(caught.value)
    x = last(f"$SC_FRAME_OFFSET_INCR_PROG=0\n{change}\nG4 F0\n")[0]
    assert last(f"$SC_FRAME_OFFSET_INCR_PROG=0\n{change}\n{word}\n")[0] == pytest.approx(x + 5.0)
    program = read(f"{HEAD}$SC_FRAME_OFFSET_INCR_PROG=1\n{change}\n{word}\nM30\n")
    if "TRANS" in change:
        assert ends(program)[-1][0] == pytest.approx(x + 5.0 + CHANGES[change][0])


def test_an_axis_that_the_change_leaves_alone_is_displaced() -> None:
    assert last("TRANS X10\nG91 G1 Y5\n") == [0, 5, 10]
    assert last("TRANS X10\nG0 X0\nG91 G1 X5\n") == [15, 0, 10]


# Values -------------------------------------------------------------------------------------------------------------

EXPRESSIONS = {
    "1+2*3": 7.0, "(1+2)*3": 9.0, "7 DIV 2": 3.0, "7/2": 3.5, "-7 MOD 4": math.fmod(-7, 4), "SIN(30)*2": 1.0,
    "ATAN2(1,1)": 45.0, "SQRT(POT(3)+POT(4))": 5.0, "ABS(-2)": 2.0, "ROUND(2.5)": 3.0, "TRUNC(2.9)": 2.0,
    "MINVAL(3,2)": 2.0, "BOUND(0,5,9)": 5.0, "R1": 4.0, "R[1]": 4.0, "R[R2-1]": 4.0, "-R1+10": 6.0, "A*R1": 8.0,
    "(R1==4)*7": 7.0, "(R1<>4 OR R2==2)*7": 7.0, "5-2-1": 2.0, "1.5EX1": 15.0,
}  # fmt: skip


@pytest.mark.parametrize("expression", sorted(EXPRESSIONS))
@pytest.mark.parametrize("form", ["G1 X={}", "R9={}\nG1 X=R9", "G1 X=AC({})", "DEF REAL B={}\nG1 X=B"])
def test_expressions(expression: str, form: str) -> None:
    begin = "R1=4 R2=2\nDEF REAL A=2\n"
    if "OR R2" in expression:  # comparisons bind less than OR: brackets are needed, as on the control
        expression = "((R1<>4) OR (R2==2))*7"
        assert last(f"{begin}{form.format(expression)}\n")[0] == pytest.approx(7.0)
        return
    assert last(f"{begin}{form.format(expression)}\n")[0] == pytest.approx(EXPRESSIONS[expression])


@settings(max_examples=40, deadline=None)
@given(
    st.lists(st.integers(-9, 9), min_size=1, max_size=5), st.sampled_from(["FOR", "WHILE", "REPEAT", "LOOP", "GOTOB"])
)
def test_loops_give_the_points_of_python(values: list[int], kind: str) -> None:
    array = "".join(f"R[{10 + index}]={value}\n" for index, value in enumerate(values))
    count, body = len(values), "G1 X=R[10+R1] Y=R1\n"
    loop = {
        "FOR": f"FOR R1=0 TO {count - 1}\n{body}ENDFOR\n",
        "WHILE": f"R1=0\nWHILE R1<{count}\n{body}R1=R1+1\nENDWHILE\n",
        "REPEAT": f"R1=0\nREPEAT\n{body}R1=R1+1\nUNTIL R1=={count}\n",
        "LOOP": f"R1=0\nLOOP\n{body}R1=R1+1\nIF R1=={count} GOTOF ENDE\nENDLOOP\nENDE:\n",
        "GOTOB": f"R1=0\nN70 {body}R1=R1+1\nIF R1<{count} GOTOB N70\n",
    }[kind]
    found = ends(read(f"{HEAD}{array}{loop}M30\n"))
    assert found == [[value, index, 10] for index, value in enumerate(values)]


@pytest.mark.parametrize(
    ("text", "x"),
    [
        ("R1=2\nIF R1==2\nG1 X1\nELSE\nG1 X2\nENDIF\n", 1),
        ("R1=3\nIF R1==2\nG1 X1\nELSE\nG1 X2\nENDIF\n", 2),
        ("R1=3\nIF R1==2\nG1 X1\nENDIF\nG1 Y1\n", 0),
        ("GOTOF ENDE\nG1 X1\nENDE: G1 Y1\n", 0),
        ("R1=2\nCASE(R1) OF 1 GOTOF A 2 GOTOF B DEFAULT GOTOF C\nA: G1 X1\nB: G1 X=IC(2)\nC: G1 Y1\n", 2),
        ("IF NOT 0\nIF 1==2\nG1 X1\nELSE\nG1 X5\nENDIF\nENDIF\n", 5),
    ],
)
def test_conditions_and_jumps(text: str, x: float) -> None:
    assert last(text)[0] == x


@pytest.mark.parametrize(
    ("text", "x"),
    [
        ("G91\nA: G1 X1\nREPEAT A\n", 2),
        ("G91\nA: G1 X1\nG1 X2\nREPEAT A P=2\n", 9),
        ("G91\nA: G1 X1\nG1 X2\nB: G1 X3\nG1 X4\nREPEAT A B P=2\n", 22),
        ("G91\nA: G1 X1\nG1 X2\nREPEATB A P=3\n", 6),
        ("G91\nA: G1 X1\nC: G1 X2\nREPEATB C\nREPEAT A P2\n", 15),
        ("EXTERN HOLE(REAL)\nG1 X1\n", 1),
    ],
)
def test_parts_of_the_program_that_run_again(text: str, x: float) -> None:
    assert last(text)[0] == x


UNKNOWN = {
    "$AA_IM[X]": r"the control has it \(\$AA_IM\)",
    "$A_IN[3]": r"the control has it \(\$A_IN\)",
    "$AC_TIME": r"the control has it \(\$AC_TIME\)",
    "$A_YEAR": r"the control has it \(\$A_YEAR\)",
    'GETT("A",1)': r"the control computes it \(GETT\)",
    "R77": r"nothing in the program gives R77 a value",
}
USES = (
    "G1 X=R2", "TRANS X=R2", "ROT Z=R2", "G1 X5 F=R2", "S=R2", "T=R2", "G4 F=R2", "IF R2>0\nENDIF",
    "FOR R5=0 TO R2\nENDFOR", "IF R2==1 GOTOF A\nA:", "G2 X5 Y0 CR=R2",
)  # fmt: skip


@pytest.mark.parametrize("use", USES)
@pytest.mark.parametrize("source", sorted(UNKNOWN))
def test_what_the_control_knows_is_carried_until_it_is_used(source: str, use: str) -> None:
    begin = f"{HEAD}R1={source}\nR2=R1*2+1\n"
    assert len(read(f"{begin}G1 X1\nM30\n").motions) == 2
    with pytest.raises(ProgramError, match=UNKNOWN[source]) as caught:
        read(f"{begin}{use}\nM30\n")
    assert str(caught.value.where).startswith("part.mpf:8:")
    if source != "R77":
        assert "in part.mpf:6" in str(caught.value)


def test_a_block_sets_its_variables_from_left_to_right() -> None:
    assert last("R1=5.5 R2=R1+.5\nG1 X=R2\n")[0] == 6.0
    assert last("IF $P_SEARCH==1 GOTOF A\nG1 X4\nA: G4 F0\n")[0] == 4.0
    with pytest.raises(ProgramError, match="R1 is set and used in one block"):
        read(f"{HEAD}R1=1\nR1=5 G1 X=R1\nM30\n")


@pytest.mark.parametrize("line", ["$P_UIFR[1]=CTRANS(X,10)", "$P_PFRAME=CTRANS(X,10)", "$TC_DP3[1,1]=100", "$MC_X=1"])
def test_data_of_the_control_are_not_set(line: str) -> None:
    with pytest.raises(ProgramError, match="data of the control are set"):
        read(f"{HEAD}{line}\nG1 X1\nM30\n")


# Subprograms --------------------------------------------------------------------------------------------------------

HOLE = "PROC HOLE(REAL D, VAR REAL N)\nDEF REAL TOP=10\nN=N+1\nG1 Z=-D\nG0 Z=TOP\nM17\n"


def test_subprograms_are_files_of_the_folder_and_have_variables_of_their_own(tmp_path: Path) -> None:
    (tmp_path / "hole.SPF").write_text(HOLE)
    (tmp_path / "L10.spf").write_text("G91 G1 X1\nG90\nRET\n")
    main = tmp_path / "main.mpf"
    main.write_text(f"{HEAD}DEF REAL TOP=3, K=0\nHOLE(TOP+1,K)\nHOLE(2,K)\nL10 P3\nG1 Y=K\nM30\n")
    program = read_sinumerik_file(main, machine=MillingMachine(known=False))
    assert ends(program) == [
        [0, 0, -4],
        [0, 0, 10],
        [0, 0, -2],
        [0, 0, 10],
        [1, 0, 10],
        [2, 0, 10],
        [3, 0, 10],
        [3, 2, 10],
    ]
    assert not program.straight


def test_subprograms_stand_in_the_archive_of_the_program() -> None:
    archive = f"%_N_MAIN_MPF\n;$PATH=/_N_MPF_DIR\n{HEAD}SHIFT\nM30\n%_N_SHIFT_SPF\nG1 X8\nM17\n"
    assert ends(read(archive))[-1] == [8, 0, 10]


@pytest.mark.parametrize(
    "call", ["HOLE(3)", "MCALL HOLE(3)\nG0 X0\nMCALL", 'CALL "HOLE"', "EXTCALL HOLE", "PCALL /_N_SPF_DIR/_N_HOLE_SPF"]
)
def test_ways_to_call(tmp_path: Path, call: str) -> None:
    (tmp_path / "HOLE.spf").write_text("PROC HOLE(REAL D)\nG1 Z=-D\nG0 Z10\nM17\n")
    text = f"{HEAD}{call}\nM30\n"
    program = read_sinumerik(text, machine=MillingMachine(known=False), folder=tmp_path)
    depth = -3 if "(3)" in call else 0
    assert [0, 0, depth] in ends(program)


def test_mcall_acts_behind_each_motion_until_it_ends(tmp_path: Path) -> None:
    (tmp_path / "DIP.spf").write_text("G1 Z1\nG0 Z10\nM17\n")
    text = f"{HEAD}MCALL DIP\nG0 X1\nX2\nM8\nMCALL\nX3\nM30\n"
    program = read_sinumerik(text, machine=MillingMachine(known=False), folder=tmp_path)
    assert [end[0] for end in ends(program) if end[2] == 1] == [1, 2]


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("NOTHERE(1)\n", "a subprogram is called that is neither in the program's file nor in its folder"),
        ("IF R1==1\n", "IF is never closed"),
        ("ENDFOR\n", "ENDFOR closes nothing"),
        ("GOTOF X1Y\n", "the label of a jump is not there; got X1Y"),
        ("GOTOS\n", "a jump without a label"),
        ("REPEAT A B\n", "the labels of a repetition are not there"),
        ("LOOP\nG4 F0\nENDLOOP\n", "the program never ends"),
        ("R1=0\nLOOP\nR1=R1+1\nENDLOOP\n", "the program does not end"),
        ("R1=$AA_IM[X]\nA: R2=1\nGOTOB A\n", "the program never ends"),
    ],
)
def test_flow_that_is_wrong(text: str, match: str) -> None:
    with pytest.raises(ProgramError, match=match) as caught:
        read(f"{HEAD}{text}M30\n")
    assert str(caught.value.where).startswith("part.mpf:")


# Offsets, frames, places --------------------------------------------------------------------------------------------


def test_settable_offsets_as_the_cell_gives_them() -> None:
    zeros = {"G54": (0.0, 0.0, 0.0), "G55": (0.1, 0.02, 0.0), "G505": (0.0, 0.0, -0.01)}
    text = f"{HEAD}TRANS X1\nG0 X0 Y0\nG55\nG0 X0 Y0\nTRANS\nG0 X0\nG505\nG0 X0 Y0 Z0\nM30\n"
    assert ends(read(text, part_offsets=zeros)) == [[1, 0, 10], [101, 20, 10], [100, 20, 10], [0, 0, -10]]
    with pytest.raises(ProgramError, match="how far G55 lies from G54 .line 1. is not known"):
        read(text)
    assert read("G54\nG56\nG0 X0 Y0 Z0\nG56 X1\nM30\n").part_zero == ("G56", 2)


def test_a_mirror_image_turns_arcs_round_and_is_not_written_back() -> None:
    body = "G0 X5 Y0\nG2 X10 Y5 I0 J5\nCIP X12 Y7 I1=11.5 J1=6\nG0 Z10\n"
    plain, mirrored = read(f"{HEAD}{body}M30\n"), read(f"{HEAD}MIRROR X0\n{body}M30\n")
    assert np.array(ends(mirrored)) == pytest.approx(np.array(ends(plain)) * [-1, 1, 1])
    for one, other in zip(plain.motions, mirrored.motions, strict=True):
        if one.kind == "arc" and one.normal is not None and other.normal is not None:
            assert other.turn_rad * other.normal[2] == pytest.approx(-one.turn_rad * one.normal[2])
    path = tool_path(mirrored, step_m=1e-3)
    shift = np.where((path.feed_m_s > 0.0)[:, None], [0.0, 1e-4, 0.0], 0.0)
    with pytest.raises(ProgramError, match="a mirror image .MIRROR. is not written back"):
        write_gcode(mirrored, CompensatedPath.from_correction(path, shift))


def test_loops_are_not_written_back_in_sinumerik() -> None:
    program = read(f"{HEAD}FOR R1=1 TO 2\nG1 X=R1\nENDFOR\nM30\n")
    path = tool_path(program, step_m=1e-3)
    shift = np.where((path.feed_m_s > 0.0)[:, None], [0.0, 1e-4, 0.0], 0.0)
    with pytest.raises(ProgramError, match="loops or subprograms is not written back.*write another language"):
        write_gcode(program, CompensatedPath.from_correction(path, shift))


def test_places_of_the_machine_have_no_number() -> None:
    for way in ("SUPA G0 Z0", "G53 G0 Z0", "G75 Z1=0", "G74 Z1=0", "G75 FP=2 Z1=0"):
        rows = listing(read(f"{HEAD}{way}\nG0 X5\nZ3\nM30\n", listed=True))
        assert rows["z_mm"].to_list() == [10.0, None, None, 3.0]
        assert len(read(f"{HEAD}{way}\nM30\n").motions) == 1
    with pytest.raises(ProgramError, match="a feed motion while it is not known where the tool is along Z"):
        read("G54 G0 X0 Y0\nG1 X5 F100\nM30\n")
    with pytest.raises(ProgramError, match="a displacement along X from a place that is not known"):
        read("G54 G91 G0 X5\nM30\n")
