"""What programs say of the rounding of their corners, in each language."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from counterflex.core.units import MM
from counterflex.programs.approximation import approximation_m
from counterflex.programs.program import Program
from counterflex.programs.reading import read_program_file


def read(folder: Path, name: str, text: str, **more: str) -> Program:
    for other, content in more.items():
        (folder / other.replace("__", ".")).write_text(content)
    (folder / name).write_text(text)
    return read_program_file(folder / name)


def mm(program: Program) -> list[float | None]:
    return [None if np.isnan(value) else round(float(value) / MM, 6) for value in approximation_m(program)]


def test_krl_names_the_distance_above_the_motion(tmp_path: Path) -> None:
    text = """DEF PART( )
$BASE=BASE_DATA[1]
$TOOL=TOOL_DATA[1]
$VEL.CP=0.02
PTP {X 0,Y 0,Z 50,A 0,B 0,C 180}
LIN {X 10,Y 0,Z 50,A 0,B 0,C 180} C_DIS
$APO.CDIS=1.5
LIN {X 20,Y 0,Z 50,A 0,B 0,C 180} C_DIS
LIN {X 20,Y 10,Z 50,A 0,B 0,C 180}
$APO.CDIS=.25
LIN {X 30,Y 10,Z 50,A 0,B 0,C 180} C_DIS
LIN {X 30,Y 20,Z 50,A 0,B 0,C 180} C_VEL
END
"""
    assert mm(read(tmp_path, "part.src", text)) == [0.0, None, 1.5, 0.0, 0.25, None]


def test_rapid_zones_are_those_of_abb_or_of_the_module(tmp_path: Path) -> None:
    target = "[[{x},0,50],[0,0,1,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"
    zones = ("fine", "z0", "z5", "zOwn", "[FALSE,0.7,0.7,0.7,0.03,0.7,0.03]")
    moves = "".join(f"    MoveL {target.format(x=10 * k)},v20,{zone},tool0;\n" for k, zone in enumerate(zones))
    text = (
        "MODULE part\n  CONST zonedata zOwn:=[FALSE,2.5,2.5,2.5,0.1,2.5,0.1];\n  PROC main()\n"
        f"{moves}  ENDPROC\nENDMODULE\n"
    )
    assert mm(read(tmp_path, "part.mod", text)) == [0.0, 0.3, 5.0, 2.5, 0.7]


def test_gcode_has_exact_stops_only(tmp_path: Path) -> None:
    """G61 until G64, a canned cycle; distances are the controller's."""
    text = """G21 G17 G90 G94
G0 X0 Y0 Z10
G1 X10 F600
G61 X20
X30
G64 X40
G81 X50 Z-5 R2 F100
G80
M2
"""
    values = mm(read(tmp_path, "part.ngc", text))
    assert values[:5] == [None, None, 0.0, 0.0, None]
    assert values[5:]
    assert set(values[5:]) == {0.0}


@pytest.mark.parametrize(("word", "expected"), [("FINE", 0.0), ("CNT0", 0.0), ("CNT50", None), ("CR2.5", 2.5)])
def test_fanuc_has_distances_where_it_names_them(tmp_path: Path, word: str, expected: float | None) -> None:
    position = (
        "P[{n}]{{\n   GP1:\n    UF : 1, UT : 1,  CONFIG : 'N U T, 0, 0, 0',\n"
        "    X = {x} mm, Y = 0 mm, Z = 50 mm,\n    W = 180 deg, P = 0 deg, R = 0 deg\n}};\n"
    )
    text = (
        "/PROG  PART\n/ATTR\n/MN\n   1:  UFRAME_NUM=1 ;\n   2:  UTOOL_NUM=1 ;\n   3:L P[1] 20mm/sec FINE ;\n"
        f"   4:L P[2] 20mm/sec {word} ;\n/POS\n" + "".join(position.format(n=n, x=10 * n) for n in (1, 2)) + "/END\n"
    )
    assert mm(read(tmp_path, "part.ls", text))[-1] == expected
