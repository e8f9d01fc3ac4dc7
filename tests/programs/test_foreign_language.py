"""Files of other controls and robots are named, with the line that tells it; G-code with a mistake is not accused."""

from __future__ import annotations

from pathlib import Path

import pytest

from counterflex.core.errors import ProgramError
from counterflex.programs.foreign_language import foreign_language
from counterflex.programs.gcode.read.reader import read_gcode

DATA = Path(__file__).resolve().parents[1] / "data"
CORPUS = sorted([*(DATA / "gcode").rglob("*.ngc"), *(DATA / "writer").rglob("*.ngc")])
KRL_SRC = "&ACCESS RVP\n&REL 1\nDEF mill( )\n;FOLD INI\nBAS (#INITMOV,0 )\n;ENDFOLD\nPTP HOME\nLIN {X 1,Y 2,Z 3}\nEND\n"
RAPID_MOD = "%%%\n  VERSION:1\n%%%\nMODULE mill\n  PROC main()\n    MoveL p10,v100,z0,tool0;\n  ENDPROC\nENDMODULE\n"
SAMPLES = {
    "KUKA KRL": (
        KRL_SRC,
        "DEF part()\n$VEL.CP=0.2\nLIN XP1 C_DIS\nEND",
        "; milling\n\nGLOBAL DEF m(A:IN)\nPTP_REL {A1 3}\nEND",
        "&COMMENT x\nDEFDAT mill PUBLIC\nDECL E6POS XP1={X 1}\nENDDAT",
        ";FOLD PTP P1 Vel=100 %\nPTP XP1\n;ENDFOLD",
    ),
    "ABB RAPID": (
        RAPID_MOD,
        "MODULE part_m\nCONST robtarget p1:=[[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];\nENDMODULE",
        "! a comment\nLOCAL PROC cut()\nMoveAbsJ [[0,0,0,0,0,0]],v5,fine,tool0;\nENDPROC",
        "PERS tooldata t:=[TRUE,[[0,0,0],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];",
    ),
    "a FANUC robot program (LS)": (
        "/PROG  MILL\n/ATTR\nOWNER = MNEDITOR;\n/MN\n   1:L P[1] 100mm/sec FINE ;\n/POS\n/END",
    ),
    "Yaskawa INFORM": ("/JOB\n//NAME MILL\n//POS\n///NPOS 1,0,0,0,0,0\nNOP\nMOVL C00000 V=50.0\nEND",),
    "Staubli VAL 3": (
        '<?xml version="1.0" encoding="utf-8"?>\n<programs xmlns="http://www.staubli.com/robotics/VAL3/Program/2">\n',
        "begin\n  movel(pStart,tTool,mNom)\n  waitEndMove()\nend",
        "  movel(pStart,tTool,mNom)",
    ),
    "Universal Robots script": ("def mill():\n  movel(p[0.1,0.2,0.3,0,3.14,0], a=1.2, v=0.25)\nend",),
    "Kawasaki AS or Adept V+": (".PROGRAM mill()\n  LMOVE p1\n.END",),
    "Comau PDL2": ("PROGRAM mill PROG_ARM=1\nBEGIN\n  MOVE LINEAR TO p1\nEND mill",),
    "Mitsubishi MELFA BASIC": ("1 Servo On\n2 Ovrd 30\n3 Mvs P1\n4 End",),
    "Heidenhain conversational": (
        "0 BEGIN PGM MILL MM\n1 BLK FORM 0.1 Z X+0 Y+0 Z-20\n3 TOOL CALL 1 Z S13000\n4 L Z+50 R0 FMAX M3\n",
        "L X+10 Y+20 R0 FMAX M3\nL Z-5 F500",
        "BEGIN PGM 4711 MM\nL X+10 Y+20 R0 FMAX\nEND PGM 4711 MM",
        "12 L X+10 Y+20 R0 F500\n13 CC X+0 Y+0\n14 C X-10 Y+0 DR+",
    ),
    "Heidenhain ISO": ("%MILL G71 *\nN10 G30 G17 X+0 Y+0 Z-20 *\nN20 T1 G17 S5000 *\nN99999999 %MILL G71 *",),
    "Sinumerik": (
        "%_N_MILL_MPF\n;$PATH=/_N_WKS_DIR/_N_PART_WPD\nN10 G54 G17\nN20 G0 X10\nM30",
        'N10 T="END_MILL_16"\nN20 M6\nN30 G0 X=R1+5\nM30',
        "G17 G54 G64 G90\nCYCLE832(0.01,1,1)\nG0 X0 Y0\nM30",
        'G0 X0\nMSG("roughing")\nTRANS X10 Y5\nG1 X10 F500\nM30',
        "DEF REAL DEPTH\nR1=5 R2=7\nG1 X=R1 F500",
        "N5 G0 SUPA Z0 D0\nN6 M30",
        "G2 X10 Y10 CR=5 F100",
        'WORKPIECE(,"",,"BOX",112,0,-20,-80,0,0,100,100)',
    ),
    "Okuma OSP": (
        "$MILL.MIN%\nO1000\nN1 G15 H1\nG0 X0 Y0\nM2",
        "O100\nVC1=10\nG0 X=VC1\nM2",
        "G15 H5\nG116 T3\nG56 H3 Z50\nM30",
    ),
    "Fagor": ("%MILL,MX--,\nG0 X0\nM30", "#TSAFE ON\nG0 X0"),
    "an APT or CL file of a CAM system": (
        "PARTNO MILL\nUNITS/MM\nLOADTL/1\nFEDRAT/500,MMPM\nGOTO/10,20,30\nFINI",
        "$$ made by a CAM system\nRAPID\nGOTO / 1.0, 2.0, 3.0",
        "TOOL PATH/CAVITY_MILL,TOOL,MILL16\nTLDATA/MILL,16.0\nEND-OF-PATH",
    ),
    "STEP (ISO 10303-21)": ("ISO-10303-21;\nHEADER;\n",),
    "a mesh (STL)": ("solid part\nfacet normal 0 0 1\nouter loop\n",),
    "a drawing (DXF)": ("0\nSECTION\n2\nHEADER\n",),
    "HPGL": ("IN;SP1;PU0,0;PD100,100;",),
    "a web page or XML": ("<!DOCTYPE html>\n<html>",),
    "a cell file of counterflex": ('format = "counterflex-cell"\nversion = 1\n',),
}
MISTAKES = (
    *(
        "G1 X10 Q5",
        "G1 X1 X2",
        "G41 D1 X5",
        "G0 X[1+",
        "G38.2 Z-5 F10",
        "M66 P1",
        "G43 H77 Z",
        "O1 call",
        "#1=",
        "G999",
    ),
    *("(open comment", "G1 X10F", "T M6", "G5 X1", "G84 Z-1 R1", "REMARK", "N10 X10 X10", "o100 endsub", "G1 X#7", "%"),
)


@pytest.mark.parametrize("name", sorted(SAMPLES))
def test_each_language_is_named(name: str) -> None:
    for text in SAMPLES[name]:
        with pytest.raises(ProgramError) as caught:
            read_gcode(text, name="part.txt")
        assert f"this is {name}; G-code as LinuxCNC reads it is required" in str(caught.value)
        assert caught.value.hint
        line = int(str(caught.value.where).split(":")[1])
        assert str(caught.value.value).split()[0][:4] in text.splitlines()[line - 1]


def test_what_counterflex_wrote_is_no_source() -> None:
    with pytest.raises(ProgramError, match="give the original program"):
        read_gcode(KRL_SRC.replace(";FOLD INI", "; made by counterflex 0.1.0 from part.ngc"), name="part.src")


@pytest.mark.by_turn
@pytest.mark.parametrize("file", CORPUS, ids=[file.stem for file in CORPUS])
def test_gcode_is_never_accused(file: Path) -> None:
    """Nothing tells another language in any program that can be read, whole or with a mistake put into it."""
    lines = file.read_text(encoding="latin-1").splitlines()
    assert foreign_language(lines) is None
    for mistake in MISTAKES:
        for at in {0, len(lines) // 2, len(lines)}:
            assert foreign_language([*lines[:at], mistake, *lines[at:]]) is None, mistake


def test_a_fault_in_gcode_stays_what_it_was() -> None:
    with pytest.raises(ProgramError, match=r"part.ngc:3:8: .*Q"):
        read_gcode("G21 G90\n(MODULE 5, PROC main, DEF mill)\nG1 X20 Q5 F100\nM2\n", name="part.ngc")


def test_remarks_tell_nothing() -> None:
    text = "(PTP HOME)\n; MoveL p1\n(BEGIN PGM X MM) G0 X5 ; CYCLE832\nG1 X1 Q3 F5\nM2\n"
    with pytest.raises(ProgramError, match="part.ngc:4"):
        read_gcode(text, name="part.ngc")
