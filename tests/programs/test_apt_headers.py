"""Cutter location files as Creo, SolidWorks CAM, CATIA and NX write them around their points."""

from __future__ import annotations

from pathlib import Path

import pytest

from counterflex.core.errors import ProgramError
from counterflex.core.units import MM
from counterflex.programs.apt.reader import read_apt
from counterflex.programs.listing import listing
from counterflex.programs.program import Program
from counterflex.programs.reading import dialect_of, read_program_file

CSYS = (
    "$$-> CSYS / 1.0000000000, 0.0000000000, 0.0000000000, 0.0000000000,  $\n"
    "            0.0000000000, 1.0000000000, 0.0000000000, 0.0000000000,  $\n"
    "            0.0000000000, 0.0000000000, 1.0000000000, 0.0000000000\n"
)
CUT = "RAPID\nGOTO / 0.0, 0.0, 50.0\nFEDRAT / 300.0,  MMPM\nGOTO / 0.0, 0.0, 0.0\nGOTO / 10.0, 0.0, 0.0\n"
HEADERS = {
    "Creo": f"$$*         Pro/CLfile  Version Creo Parametric\n$$-> MFGNO / PART\nPARTNO / PART\n$$-> FEATNO / 13\n"
            f"MACHIN / UNCX01, 1\n$$-> CUTCOM_GEOMETRY_TYPE / OUTPUT_ON_CENTER\nUNITS / MM\nLOADTL / 1\n"
            f"$$-> CUTTER / 16.000000\n{CSYS}SPINDL / RPM, 3000.000000,  CLW\n",
    "SolidWorks CAM": "PARTNO/ PART\nUNIT/ MM\nCSI_PART/ 1, 2\nCSI_TOOL/ 16.0, $\n 0.0\nCUTTER/ 16.0\nLOADTL/ 1\n"
                      "SPINDL/ 3000.0, RPM, CLW\n",
    "CATIA": "$$ ----------------------------------------------\n$$     Generated on Monday $\n$$*CATIA0\n"
             "$$  1.0 0.0 0.0 0.0 $\nPARTNO PART TO BE MACHINED\nCOOLNT/ON\nCUTCOM/OFF\nPPRINT OPERATION NAME\n"
             "$$ TOOLCHANGEBEGINNING\nCUTTER/ 16.0, 0.0, 8.0, 0.0,$\n0.0, 0.0, 50.0\nTOOLNO/1, MILL, 1, 0,$\n 100.0\n"
             "TPRINT/T1 End Mill D16\nLOADTL/1\n$$ End of generation of : Tool change\nMULTAX\n"
             "SPINDL/ 3000.0000,RPM,CLW\n",
    "NX": "TOOL PATH/CAVITY_MILL,TOOL,MILL\nTLDATA/MILL,16.0,0.0,75.0,0.0,0.0\n"
          "MSYS/0.0,0.0,0.0,1.0,0.0,0.0,0.0,1.0,0.0\n$$ centerline data\nPAINT/PATH\nPAINT/SPEED,10\nLOAD/TOOL,1\n"
          "SPINDL/RPM,3000,CLW\nPAINT/COLOR,186\n",
}  # fmt: skip


def ends(program: Program) -> list[list[float]]:
    return [[round(float(x) / MM, 9) + 0.0 for x in motion.p_end] for motion in program.motions]


@pytest.mark.parametrize("system", sorted(HEADERS))
def test_a_header_leaves_the_points_alone(system: str) -> None:
    program = read_apt(f"{HEADERS[system]}{CUT}FINI\n", complete=True)
    assert ends(program) == [[0, 0, 50], [0, 0, 0], [10, 0, 0]]
    assert [motion.tool for motion in program.motions] == [1, 1, 1]
    assert program.motions[1].feed_m_s == pytest.approx(5e-3)
    assert program.motions[1].spindle_rad_s == pytest.approx(3000 * 2 * 3.141592653589793 / 60)


def test_versions_of_creo_are_read_by_their_ending(tmp_path: Path) -> None:
    assert [dialect_of(name) for name in ("a.ncl.1", "a.NCL.12", "a.cl.3", "a.mpf.2", "a.1", "a.nc.1")] == [
        "apt", "apt", "apt", "sinumerik", "linuxcnc", "linuxcnc",
    ]  # fmt: skip
    (tmp_path / "part.ncl.3").write_text(f"{HEADERS['Creo']}{CUT}FINI\n")
    assert len(read_program_file(tmp_path / "part.ncl.3").motions) == 3


def test_a_second_coordinate_system_is_refused_with_both_lines() -> None:
    other = CSYS.replace("0.0000000000, 1.0000000000, 0.0000000000, 0.0000000000,", "0.0, 1.0, 0.0, 25.0,", 1)
    assert len(read_apt(f"{CSYS}UNITS/MM\n{CUT}{CSYS}{CUT}FINI\n").motions) == 6
    with pytest.raises(ProgramError, match=r"a second coordinate system \$\$-> CSYS, other than in line 1"):
        read_apt(f"{CSYS}UNITS/MM\n{CUT}{other}{CUT}FINI\n")


@pytest.mark.parametrize("comment", ["$$ price in $", "$$ one $", "$$-> NOTE / 1, $"])
def test_a_comment_that_ends_in_a_dollar_sign_does_not_swallow_a_statement(comment: str) -> None:
    assert ends(read_apt(f"UNITS/MM\nFEDRAT/300\nGOTO/0,0,5\n{comment}\nGOTO/1,0,5\nFINI\n")) == [[0, 0, 5], [1, 0, 5]]


@pytest.mark.parametrize(
    ("line", "match"),
    [
        ("ORIGIN/0,0,25", "motions and frames of the machine are not read: ORIGIN"),
        ("TRANS/1,0,0", "motions and frames of the machine are not read: TRANS"),
        ("TRACUT/1,0,0,0,0,1,0,0,0,0,1,0", "motions and frames of the machine are not read: TRACUT"),
        ("COPY/1,TRANSL,10,0,0,2", "motions and frames of the machine are not read: COPY"),
        ("ROTABL/90", "motions and frames of the machine are not read"),
        ("LOOPST", "macros and jumps are not read"),
        ("CSI_WORK_OFFSET/55", "may change frames or feeds: CSI_WORK_OFFSET"),
        ("CSI_TRANSFORM/1,2,3", "may change frames or feeds: CSI_TRANSFORM"),
        ("INSERT G55", "text for the control with codes"),
        ("INSERT X10.", "text for the control with codes"),
        ("PREFUN/68", "a G code of the control"),
        ("AUXFUN/77", "a function of the machine that is not read"),
        ("CUTCOM/LEFT", "cutter radius compensation is not read: CUTCOM"),
        ("CYCLE/DRILL,10,MMPM,100", "machining cycles are not read: CYCLE"),
        ("SET/MODE,INCR", "a setting of the post processor"),
        ("GOHOME\nGOTO/1,2,3", "the file moves on after GOHOME in line"),
    ],
)
def test_what_moves_frames_or_the_machine_is_refused(line: str, match: str) -> None:
    with pytest.raises(ProgramError, match=match) as caught:
        read_apt(f"UNITS/MM\n{CUT}{line}\nGOTO/1,0,0\nFINI\n")
    assert caught.value.hint


def test_the_way_home_has_no_number() -> None:
    text = f"UNITS/MM\n{CUT}GOHOME\nFINI\n"
    assert len(read_apt(text).motions) == 3
    rows = listing(read_apt(text, listed=True))
    assert rows["x_mm"].to_list() == [0.0, 0.0, 10.0, None]


def test_a_tool_with_arguments_left_out_is_carried() -> None:
    """CATIA leaves out what the tool does not have, and continues the statement over several lines."""
    tool = "TOOLNO/1,MILL,1,0,   14.106000,$\n  100.0,   15.0,,   40.0,$\n 1000.0,MMPM,RPM,CLW,$\nON,,NOTE\n"
    motion = "LOADTL/1,1,1\nFEDRAT/  500.0,MMPM\nGOTO  /  0,0,10\nGOTO  /  10,0,10\nFINI\n"
    made, plain = read_apt("PARTNO P\n" + tool + motion), read_apt("PARTNO P\n" + motion)
    assert [tuple(m.p_end) for m in made.motions] == [tuple(m.p_end) for m in plain.motions]
