"""Forms that post processors and simulators write, against the manual of their control."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from counterflex.core.errors import ProgramError
from counterflex.core.units import MM, UM
from counterflex.integrations.fanuc.language.read.reader import read_fanuc
from counterflex.integrations.heidenhain.language.in_place import write_heidenhain
from counterflex.integrations.heidenhain.language.reader import read_heidenhain
from counterflex.integrations.kuka.language.read.reader import read_krl
from counterflex.integrations.siemens.language.reader import read_sinumerik
from counterflex.integrations.yaskawa.language.reader import read_inform
from counterflex.programs.apt.reader import read_apt
from counterflex.programs.compensated import tool_path
from counterflex.programs.gcode.read.parameter_file import MillingMachine
from counterflex.programs.gcode.read.reader import read_gcode
from counterflex.programs.listing import listing
from counterflex.programs.program import Program
from robot_corrections import corrected, gap_to_polyline


def ends(program: Program) -> np.ndarray:
    """End points of the motions, mm."""
    return np.array([motion.p_end for motion in program.motions]) / MM


# ---- the list: G17, G18, G19 and the sign of G3, as LinuxCNC, "G2, G3 Arc Move", defines them ------------------------


@pytest.mark.parametrize(
    ("through", "end", "plane", "turns"),
    [
        ("X 5,Y 5,Z 0", "X 10,Y 0,Z 0", "G17", -0.5),  # Seen from +Z clockwise
        ("X 5,Y -5,Z 0", "X 10,Y 0,Z 0", "G17", 0.5),
        ("X 5,Y 0,Z 5", "X 10,Y 0,Z 0", "G18", 0.5),  # From -X over +Z to +X: about +Y
        ("X 0,Y 5,Z 5", "X 0,Y 10,Z 0", "G19", -0.5),  # From -Y over +Z to +Y: about -X
    ],
)
def test_a_circle_of_a_robot_is_listed_with_the_sign_of_its_plane(
    through: str, end: str, plane: str, turns: float
) -> None:
    text = (
        "DEF P( )\nBAS(#TOOL,1)\nBAS(#BASE,1)\n$VEL.CP=0.03\nPTP {X 0,Y 0,Z 0,A 0,B 0,C 180}\n"
        f"CIRC {{{through}}},{{{end}}}\nEND\n"
    )
    row = listing(read_krl(text, name="p.src")).row(1, named=True)
    assert (row["plane"], row["turns"]) == (plane, turns)


def test_a_circle_in_no_plane_of_g_code_is_listed_with_its_normal() -> None:
    text = (
        "DEF P( )\nBAS(#TOOL,1)\nBAS(#BASE,1)\n$VEL.CP=0.03\nPTP {X 0,Y 0,Z 0,A 0,B 0,C 180}\n"
        "CIRC {X 5,Y 5,Z 5},{X 10,Y 0,Z 0}\nEND\n"
    )
    row = listing(read_krl(text, name="p.src")).row(1, named=True)
    normal = np.array([float(value) for value in row["plane"].split()])
    np.testing.assert_allclose(math.copysign(1.0, row["turns"]) * normal, np.array([0.0, 1.0, -1.0]) / math.sqrt(2.0),
                               atol=1e-5)  # fmt: skip


# ---- Klartext: arcs in other planes (iTNC 530, "Polar coordinates": angles from +X, +Y in Y/Z, +Z in Z/X) ------------

_HEAD = ("BEGIN PGM T MM", "TOOL CALL 1 Z S1000 F400", "L X+0 Y+0 Z+5 R0 FMAX M3", "L Z+0 F600")
_TAIL = ("L Z+50 FMAX", "M30", "END PGM T MM", "")


def klartext(*lines: str) -> Program:
    """A program that begins at the zero of the part."""
    return read_heidenhain("\n".join([*_HEAD, *lines, *_TAIL]), complete=True)


@pytest.mark.parametrize(
    ("lines", "end", "normal", "turn_deg"),
    [
        (("CC Y-2 Z+0", "CP IPA-90 DR-"), (0.0, -2.0, -2.0), (1.0, 0.0, 0.0), -90.0),
        (("CC Y+2 Z+0", "CP IPA+90 DR+"), (0.0, 2.0, -2.0), (1.0, 0.0, 0.0), 90.0),
        (("CC X+0 Z-2", "CP PA+90 DR+"), (2.0, 0.0, -2.0), (0.0, 1.0, 0.0), 90.0),
        (("CC X+3 Z+0", "C X+6 Z+0 DR-"), (6.0, 0.0, 0.0), (0.0, 1.0, 0.0), -180.0),
        (("CC IY+2 IZ+0", "CP IPA+360 IX+3 DR+"), (3.0, 0.0, 0.0), (1.0, 0.0, 0.0), 360.0),
    ],
)
def test_vertical_arcs(
    lines: tuple[str, ...], end: tuple[float, ...], normal: tuple[float, ...], turn_deg: float
) -> None:
    made = klartext(*lines)
    arc = made.motions[2]
    np.testing.assert_allclose(np.asarray(arc.p_end) / MM, end, atol=1e-9)
    assert arc.normal is not None
    assert tuple(arc.normal) == pytest.approx(normal)
    assert math.degrees(arc.turn_rad) == pytest.approx(turn_deg)
    # The next CC is one of X and Y again.
    back = klartext(*lines, f"CC X{end[0] + 2:+} Y{end[1]:+}", "CP IPA+90 DR+").motions[3]
    np.testing.assert_allclose(np.asarray(back.p_end) / MM, (end[0] + 2.0, end[1] - 2.0, end[2]), atol=1e-9)


@pytest.mark.parametrize("line", ["CC Z+1", "CC X+1 Y+1 Z+1", "CC Y+1 Z+1\nCC X+2", "CC Y+1 Z+1\nCTP PR+1 PA+9"])
def test_a_plane_that_is_not_clear_is_refused(line: str) -> None:
    with pytest.raises(ProgramError, match="plane"):
        klartext("L X+1 F100", *line.split("\n"))


@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_vertical_arcs_are_written_back(newline: str) -> None:
    lines = [*_HEAD, "CC Y-2 Z+0", "CP IPA-90 DR-", "L Y-5", "CC X+3 Y-5 ;flat", "C X+6 Y-5 DR+", "CC X+9 Z-2",
             "C X+12 Z-2 DR- F300", "CC IX+0 IZ+2", "CP IPA+720 IY+4 DR+", *_TAIL]  # fmt: skip
    program = read_heidenhain(newline.join(lines), complete=True)
    same = write_heidenhain(program, corrected(program, 0.0, 5.0), header=False).text
    assert same == newline.join(lines)
    compensated = corrected(program, 80.0 * UM, 5.0)
    back = read_heidenhain(write_heidenhain(program, compensated, tolerance_m=5.0 * UM).text, complete=True)
    feed = compensated.path.kind == 1
    made = tool_path(back, step_m=0.2 * MM, chord_m=0.5 * UM).p_part_tcp
    assert gap_to_polyline(compensated.p_part_command[feed], made) <= 7.0 * UM


def test_milling_mode_is_neutral_and_turning_mode_refused() -> None:
    assert len(klartext("FUNCTION MODE MILL").motions) == 3
    with pytest.raises(ProgramError, match="FUNCTION"):
        klartext("FUNCTION MODE TURN")


def test_a_cycle_cut_off_behind_its_number_is_refused() -> None:
    with pytest.raises(ProgramError):
        klartext("CYCL DEF 10")


# ---- FANUC, INFORM ---------------------------------------------------------------------------------------------------


def test_frames_of_group_1_are_those_of_the_arm() -> None:
    """As ROBOGUIDE writes them; group 1 is the arm (R-30iA Operator's Manual, "Multi-motion group")."""
    text = (
        "/PROG P\n/ATTR\nDEFAULT_GROUP = 1,*,*,*,*;\n/MN\n 1:UTOOL_NUM[GP1]= 1 ;\n 2:UFRAME_NUM[GP1]= 2 ;\n"
        " 3:L P[ 1] 200mm/sec FINE ;\n/POS\nP[1]{\n GP1:\n UF : 2, UT : 1, CONFIG : 'N U T, 0, 0, 0',\n"
        " X = 1.0 mm, Y = 2.0 mm, Z = 3.0 mm,\n W = 180.0 deg, P = 0.0 deg, R = 0.0 deg\n};\n/END\n"
    )
    made = read_fanuc(text)
    np.testing.assert_allclose(ends(made), [[1.0, 2.0, 3.0]])
    with pytest.raises(ProgramError, match="unknown statement"):
        read_fanuc(text.replace("UTOOL_NUM[GP1]", "UTOOL_NUM[GP2]"))


def test_a_folder_and_a_remark_before_the_job() -> None:
    text = (
        "'post 1.0\n/JOB\n//NAME P\n///FOLDERNAME MILLING\n//POS\n///NPOS 1,0,0,0,0,0\n///USER 1\n///TOOL 1\n"
        "///POSTYPE USER\n///RECTAN\n///RCONF 0,0,0,0,0,0,0,0\nC00000=1.0,2.0,3.0,180.0,0.0,0.0\n//INST\n"
        "///DATE 2020/01/01 12:00\n///ATTR SC,RW,RJ\n////FRAME USER 1\n///GROUP1 RB1\nNOP\nMOVL C00000 V=10.0\nEND\n"
    )
    np.testing.assert_allclose(ends(read_inform(text)), [[1.0, 2.0, 3.0]])
    with pytest.raises(ProgramError, match="not understood"):
        read_inform(text.replace("FOLDERNAME", "FOLDER"))


# ---- APT -------------------------------------------------------------------------------------------------------------


def test_godlta_by_a_distance_goes_along_the_tool_axis() -> None:
    """ISO 4343, GODLTA/d; LOADTL with the words of the magazine."""
    flat = read_apt("UNITS/MM\nLOADTL/1,IN,3,LENGTH,90\nFEDRAT/100,MMPM\nGOTO/1,2,3\nGODLTA/-2.5\nFINI\n")
    np.testing.assert_allclose(ends(flat)[-1], [1.0, 2.0, 0.5])
    tilted = read_apt(
        "UNITS/MM\nMULTAX/ON\nLOADTL/1\nFEDRAT/100,MMPM\nGOTO/1,2,3,0.6,0,0.8\nGODLTA/10\nGOTO/0,0,0,0,0,1\nFINI\n"
    )
    np.testing.assert_allclose(ends(tilted)[1], [7.0, 2.0, 11.0])


# ---- G-code ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("arc", ["G17 G2 X10 Y0 I5 J0 K0", "G18 G3 X10 Z0 I5 K0 J0.0", "G19 G2 Y10 Z0 J5 K0 I0"])
def test_a_centre_of_zero_out_of_the_plane_changes_nothing(arc: str) -> None:
    """Posts write I, J and K of every arc; only one that is not zero has a meaning that controls do not share."""
    text = "G21 G90 G54\nT1 M6\nG0 X0 Y0 Z0\n{} F100\nM30\n"
    whole, third = read_gcode(text.format(arc)), arc.split()[-1]
    bare = read_gcode(text.format(arc.removesuffix(third)))
    np.testing.assert_allclose(ends(whole), ends(bare))
    assert whole.motions[-1].turn_rad == bare.motions[-1].turn_rad
    with pytest.raises(ProgramError, match="no place in an arc"):
        read_gcode(text.format(arc.replace(third, third[0] + "1")))


def test_d_of_fanuc_selects_an_offset_that_nothing_uses() -> None:
    """30i Operator's Manual, "Tool compensation values, number of compensation values": D acts with G41 and G42."""
    text = "O0001\nG21 G17 G90 G54\nT4 D04 M6\nG0 X0. Y0.\nG43 H4 D4 Z5.\nG1 Z-1. F100.\nM30\n"
    np.testing.assert_allclose(ends(read_gcode(text))[-1], [0.0, 0.0, -1.0])
    with pytest.raises(ProgramError, match="nothing in this block uses"):
        read_gcode(text.replace("O0001\n", ""))


def test_g53_of_fanuc_is_a_rapid_under_any_motion_code() -> None:
    """30i Operator's Manual, "Machine coordinate system": (G90) G53 moves at the rapid traverse rate."""
    text = "O0001\nG21 G17 G90 G54\nT1 M6\nG80\nG53 Z10.\nG0 X1. Y2.\nZ3.\nM30\n"
    made = read_gcode(text)
    assert [motion.kind for motion in made.motions] == ["rapid", "rapid", "rapid"]
    with pytest.raises(ProgramError, match="no motion code"):
        read_gcode(text.replace("O0001\n", ""))


# ---- tools by name ---------------------------------------------------------------------------------------------------

_OPEN = MillingMachine(known=False, listed=True)


@pytest.mark.parametrize(
    ("read", "text"),
    [
        (read_sinumerik, 'G17 G54 G71 G90\nT="MILL_10" D1\nM6\nG0 X1 Y2 Z3\nM30\n'),
        (read_heidenhain, 'BEGIN PGM T MM\nTOOL CALL "MILL_10" Z S1000\nL X+1 Y+2 Z+3 FMAX\nM30\nEND PGM T MM\n'),
    ],
)
def test_a_list_without_names_leaves_the_number_of_a_named_tool_open(read: Callable[..., Program], text: str) -> None:
    made = read(text, machine=_OPEN)
    assert [motion.tool for motion in made.motions] == [0]
    np.testing.assert_allclose(ends(made), [[1.0, 2.0, 3.0]])
    for machine in (MillingMachine(known=False), MillingMachine(listed=True, tool_names={"OTHER": 1})):
        with pytest.raises(ProgramError, match="name"):
            read(text, machine=machine)
