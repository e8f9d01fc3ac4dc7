"""What a program leaves unsaid, or says in words that controllers read in two ways, is named."""

from __future__ import annotations

import numpy as np
import pytest

from counterflex.core.errors import ProgramError
from counterflex.core.units import MM
from counterflex.integrations.beckhoff.language.reader import read_twincat
from counterflex.integrations.siemens.language.reader import read_sinumerik
from counterflex.programs.apt.reader import read_apt
from counterflex.programs.gcode.read.parameter_file import MillingMachine
from counterflex.programs.gcode.read.reader import read_gcode
from counterflex.programs.program import Program
from counterflex.programs.stated.offsets import offset_reader
from counterflex.programs.stated.remarks import diameters_of
from counterflex.programs.stated.two_readings import doubtful_readings

UNKNOWN_MACHINE = MillingMachine(known=False)
FANUC = "%\nO1234 (PART)\nG21 G90 G17\nT1 M6\nG43 H1\nS8000 M3\n"
PLAIN = "G21 G90 G17\nT1 M6\nG43 H1\nS8000 M3\n"
CL = "PARTNO/X\nUNITS/MM\nLOADTL/1\nSPINDL/8000,CLW\nRAPID\nGOTO/0,0,10\nFEDRAT/300,MMPM\n"


def gcode(text: str) -> Program:
    return read_gcode(text, name="part.nc", machine=UNKNOWN_MACHINE)


@pytest.mark.parametrize(
    ("program", "line"),
    [
        (gcode("G90 G17\nG0 X0 Y0 Z10\nG1 Z0 F100\nM2\n"), 2),
        (gcode("G90 G17\nG0 X0 Y0 Z10\nG21 G1 Z0 F100\nM2\n"), 2),
        (read_sinumerik("G90 G17 G54\nG0 X0 Y0 Z10\nG1 Z0 F100\nM30\n", name="part.mpf"), 2),
        (read_apt("RAPID\nGOTO/0,0,1\nFEDRAT/10.0\nGOTO/0,0,0\nFINI\n", name="part.apt"), 2),
    ],
)
def test_lengths_before_the_unit_is_said_are_named(program: Program, line: int) -> None:
    (said,) = doubtful_readings(program)
    assert f"line {line}" in said
    assert "as mm" in said


@pytest.mark.parametrize(
    "program",
    [
        gcode("G90 G17\nG21 G0 X0 Y0 Z10\nG1 Z0 F100\nM2\n"),
        read_sinumerik("G90 G17 G54 G710\nG0 X0 Y0 Z10\nG1 Z0 F100\nM30\n", name="part.mpf"),
        read_apt(f"{CL}GOTO/0,0,0\nFINI\n", name="part.apt"),
        read_apt("$$ X\n MM\nRAPID\nGOTO/0,0,1\nFEDRAT/10.0\nGOTO/0,0,0\nFINI\n", name="part.apt"),
        read_twincat("G90 G17\nG0 X0 Y0 Z10\nG1 Z0 F100\nM30\n", name="part.nc"),
    ],
)
def test_a_unit_at_the_head_is_no_doubt(program: Program) -> None:
    assert doubtful_readings(program) == []


@pytest.mark.parametrize("head", [FANUC, PLAIN + "#1=1\nIF[#1EQ2]GOTO9\nN9\n", PLAIN + "G187 P1\n"])
def test_numbers_without_a_point_are_named_in_programs_for_fanuc_and_haas(head: str) -> None:
    text = head + "G0 X0 Y0 Z10.\nG1 Z-1. F300\nX100\nY25\nM30\n%\n"
    (said,) = doubtful_readings(gcode(text if head == FANUC else text[:-2]))
    assert "X100 in line" in said
    assert "and 1 more" in said
    assert "100 times 0.001 mm" in said


def test_least_increments_of_inches() -> None:
    (said,) = doubtful_readings(gcode(FANUC.replace("G21", "G20") + "G0 X0. Y0. Z1.\nG1 Z5 F3.\nM30\n%\n"))
    assert "5 times 0.0001 inch" in said


@pytest.mark.parametrize(
    "text", [FANUC + "G0 X0 Y0 Z10.\nG1 X100. F300\nM30\n%", PLAIN + "G0 X0 Y0 Z10\nG1 X100 F300\nM30"]
)
def test_points_and_linuxcnc_programs_are_no_doubt(text: str) -> None:
    assert doubtful_readings(gcode(text)) == []


def test_a_short_dwell_of_fanuc_may_be_in_milliseconds() -> None:
    body = "G0 X0. Y0. Z10.\nG1 Z0. F300\nG4 P50\nM30\n"
    (said,) = doubtful_readings(gcode(FANUC + body + "%"))
    assert "waits 50 s" in said
    assert "write P0.05" in said
    assert doubtful_readings(gcode(PLAIN + body)) == []


@pytest.mark.parametrize(
    "program",
    [
        gcode(PLAIN + "G0 X0 Y0 Z10\nG1 Z0 F100\nG49\nG1 X5\nM2\n"),
        gcode(PLAIN + "G0 X0 Y0 Z10\nG43 H0\nG1 Z0 F100\nM2\n"),
        read_sinumerik("G71 G90 G17 G54\nG0 X0 Y0 Z10\nD0\nG1 Z0 F100\nM30\n", name="part.mpf"),
        read_twincat("G71 G90 G17\nD1\nG0 X0 Y0 Z10\nD0\nG1 Z0 F100\nM30\n", name="part.nc"),
    ],
)
def test_a_cut_without_a_length_offset_is_named(program: Program) -> None:
    (said,) = doubtful_readings(program)
    assert "no tool length offset" in said
    assert "tool tip" in said


def test_a_program_for_the_tool_tip_with_a_safe_start_is_no_doubt() -> None:
    assert doubtful_readings(gcode("G21 G90 G17 G49\nT1 M6\nS8000 M3\nG0 X0 Y0 Z10\nG1 Z0 F100\nM2\n")) == []


def test_a_cancelled_offset_at_the_end_is_no_doubt() -> None:
    assert doubtful_readings(gcode("G21 G90 G17 G49\nT1 M6\nG0 X0 Y0\nG43 H1 Z20\nG1 Z0 F100\nG0 Z20\nG49\nM2\n")) == []


@pytest.mark.parametrize(
    ("body", "what"),
    [
        ("G54\nG92.3\nG0 X0 Y0 Z10\n", "an earlier program"),
        ("G54\nG0 X#5211 Y0 Z10\n", "an earlier program"),
        ("G10 L2 P1 X1 Y1 Z1\nG54\nG0 X0 Y0 Z10\nG91 G10 L2 P1 X5\n", "LinuxCNC sets the offset"),
        ("G54\nG0 X0 Y0 Z10\nM99 P50\nN50 G1 X5 F100\n", "M99 P jumps"),
    ],
)
def test_offsets_that_an_earlier_program_left_are_not_known(body: str, what: str) -> None:
    with pytest.raises(ProgramError, match=what):
        gcode(PLAIN + body + "M2\n")


@pytest.mark.parametrize(("words", "name"), [("G54 P7", "G54.1 P7"), ("G154 P5", "G54.1 P5"), ("G115", "G54.1 P6")])
def test_further_offsets_are_followed_by_name(words: str, name: str) -> None:
    program = read_gcode(f"G21 G90\n{words}\nG0 X0 Y0 Z1\nM2\n", machine=MillingMachine(known=False))
    reader = offset_reader("linuxcnc")
    for block in program.blocks:
        reader.take(block)
    assert reader.offset == name


@pytest.mark.parametrize(
    ("body", "x_mm"),
    [
        ("DEF INT I=7/2\nG1 X=I\n", 4.0),
        ("DEF INT I\nI=2.4\nG1 X=I\n", 2.0),
        ("DEF BOOL B=5\nG1 X=B+1\n", 2.0),
        ("DEF REAL D[3]=SET(1,2,3)\nG1 X=D[2]\n", 3.0),
        ("DEF REAL D[3]\nD[1]=SET(5,6)\nG1 X=D[2]\n", 6.0),
        ("DEF REAL D[3]\nD[1]=SET(5,6)\nG1 X=D[0]+9\n", 9.0),
    ],
)
def test_variables_of_sinumerik_convert_to_their_type(body: str, x_mm: float) -> None:
    program = read_sinumerik(f"G71 G90 G17 G54\nG0 X0 Y0 Z10\nF300\n{body}M30\n", name="part.mpf")
    assert program.motions[-1].p_end[0] == pytest.approx(x_mm * MM, abs=1e-12)


@pytest.mark.parametrize("body", ["SETMS(2)\n", "FL[X]=5\n", "DEF REAL D[2,2]=SET(1,2,3,4)\nG1 X=D[1,1]\n"])
def test_another_spindle_axis_limits_and_unknown_elements_are_refused(body: str) -> None:
    with pytest.raises(ProgramError):
        read_sinumerik(f"G71 G90 G17 G54\nG0 X0 Y0 Z10\nF300\n{body}M30\n", name="part.mpf")


def test_gears_of_apt_are_no_speed() -> None:
    program = read_apt(CL + "SPINDL/RPM,4000,CLW,RANGE,2\nGOTO/1,0,0\nFINI\n", name="part.apt")
    assert program.motions[-1].spindle_rad_s == pytest.approx(4000 * 2 * np.pi / 60)


@pytest.mark.parametrize(
    ("text", "what"),
    [
        (CL + "MSYS/10,0,0,1,0,0,0,1,0\nGOTO/1,0,0\nFINI\n", "behind the first motion"),
        ("FEDRAT/500,MMPM\nUNITS/INCHES\nRAPID\nGOTO/1,0,0\nFINI\n", "the unit changes after FEDRAT in line 1"),
        ("FROM/0,0,10\nUNITS/INCHES\nRAPID\nGOTO/1,0,0\nFINI\n", "the unit changes after FROM in line 1"),
        (CL + "M1=MATRIX/TRANSL,10,0,0\nFINI\n", "definitions of APT"),
        (CL + "GOTO/1,0,0,0,0.5,1\nFINI\n", "has 1.118"),
    ],
)
def test_what_apt_says_too_late_or_in_general_is_refused(text: str, what: str) -> None:
    with pytest.raises(ProgramError, match=what):
        read_apt(text, name="part.apt")


def test_block_delete_of_apt_is_named() -> None:
    (said,) = doubtful_readings(read_apt(CL + "OPSKIP/ON\nGOTO/1,0,0\nFINI\n", name="part.apt"))
    assert "OPSKIP in line 8" in said


@pytest.mark.parametrize("statement", ["CUTTER/20.0,0.0,10.0", "TLDATA/MILL,20.0,0.0,100.0,0.0,0.0"])
def test_diameters_of_apt(statement: str) -> None:
    text = f"UNITS/MM\n{statement}\nLOADTL/3\nRAPID\nGOTO/0,0,10\nFINI\n"
    assert diameters_of(read_apt(text, name="part.apt")) == {3: (pytest.approx(20.0 * MM), 2)}  # type: ignore[comparison-overlap]


def test_a_tool_change_of_sinumerik_brings_its_own_offset() -> None:
    text = "G71 G90 G17 G54\nSUPA G0 Z0 D0\nT1\nM6\nS8000 M3\nG0 X0 Y0 Z10\nG1 Z0 F300\nM30\n"
    assert doubtful_readings(read_sinumerik(text, name="part.mpf")) == []


@pytest.mark.parametrize("last", ["END", "FINI"])
def test_both_ends_of_apt(last: str) -> None:
    assert len(read_apt(f"{CL}GOTO/0,0,0\nREWIND/0\n{last}\n", name="part.apt").motions) == 2


def test_a_place_of_the_machine_needs_no_number() -> None:
    text = "G71 G90 G17 G54\nSUPA G0 Z=_Z_HOME D0\nT1\nM6\nG0 X0 Y0 Z10\nG1 Z0 F300\nSUPA G0 Z=$MA_POS[AX3]\nM30\n"
    assert [m.kind for m in read_sinumerik(text, name="part.mpf").motions][:2] == ["rapid", "feed"]
    with pytest.raises(ProgramError, match="_Z_HOME"):
        read_sinumerik("G71 G90 G17 G54\nG0 X0 Y0 Z=_Z_HOME\nM30\n", name="part.mpf")


@pytest.mark.parametrize(
    ("arguments", "read"),
    [
        ('0,"TC1",0,57,0,0.0,-0,0,0,0,0,0,0,1', True),
        ('0,"TC1",0,57,0,0,0,0,30,0,0,0,0,1', False),
        ('0,"TC1",0,57,5,0,0,0,0,0,0,0,0,1', False),
        ('1,"TC1",0,57,0,0,0,0,0,0,0,0,0,1', False),
        ('0,"TC1",0,57,0,0,0,R1,0,0,0,0,0,1', False),
        ('0,"TC1",0,57,0,0,0', False),
    ],
)
def test_swivelling_by_nothing_is_neutral(arguments: str, read: bool) -> None:
    text = f"G71 G90 G17 G54\nG0 X0 Y0 Z10\nCYCLE800({arguments})\nG1 Z0 F300\nM30\n"
    if read:
        assert len(read_sinumerik(text, name="part.mpf").motions) == 2
        return
    with pytest.raises(ProgramError, match="swivelled plane"):
        read_sinumerik(text, name="part.mpf")


@pytest.mark.parametrize(
    "body",
    [
        "o1 while [#1 LT 2]\n G1 X5\n #1 = [#1 + 1]\no1 endwhile\n",
        "o2 repeat [2]\n G1 X5\no2 endrepeat\n",
        "o3 if [#1 EQ 0]\n G1 X5\no3 elseif [#1 EQ 1]\n G1 X6\no3 endif\n",
        "(not a program of O1234: no M98, no G187)\nG1 X5\n",
        "G1 X5 ; G65 of the other control\n",
    ],
)
def test_words_of_linuxcnc_are_none_of_fanuc(body: str) -> None:
    """Numbered ends of loops and comments: whole numbers are mm, P is in seconds."""
    program = gcode(f"G21 G90 G17\nT1 M6\nG43 H1\nS8000 M3\n#1 = 0\nG0 X0 Y0 Z10\nF100\n{body}G4 P2\nG0 Z10\nM2\n")
    assert doubtful_readings(program) == []
