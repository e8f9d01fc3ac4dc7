"""The circular motion that CATIA writes, INDIRV and TLON,GOFWD: read as the arc it is, and written back."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st

from counterflex.core.errors import ProgramError
from counterflex.core.units import MM
from counterflex.programs.apt.reader import read_apt
from counterflex.programs.apt.writer import write_apt
from counterflex.programs.compensated import CompensatedPath, tool_path
from counterflex.programs.gcode.read.reader import read_gcode
from counterflex.programs.program import Motion, Program
from counterflex.programs.reading import read_program_file

HEAD = "FEDRAT/ 1500.0000,MMPM\nRAPID\nGOTO  /   50.00000,   20.00000,   34.00000\n"
QUARTER = """INDIRV/ 0.00000, 1.00000, 0.00000
TLON,GOFWD/ (CIRCLE/   40.00000,   20.00000,   34.00000,$
   10.00000),ON,(LINE/   40.00000,   20.00000,   34.00000,$
   40.00000,   30.00000,   34.00000)
"""
LONG = """INDIRV/ 0.0,-1.0, 0.0
TLON,GOFWD/ (CIRCLE/ 40.0,20.0,34.0,10.0),ON,2,INTOF,(LINE/ 40.0,20.0,34.0, 40.0,30.0,34.0)
"""


def arc(text: str) -> Motion:
    (motion,) = (m for m in read_apt(HEAD + text).motions if m.kind == "arc")
    return motion


@pytest.mark.parametrize(
    ("text", "gcode"),
    [(QUARTER, "G3 X40 Y30 I-10 J0"), (LONG, "G2 X40 Y30 I-10 J0"),
     (QUARTER.replace("(", "").replace(")", ""), "G3 X40 Y30 I-10 J0")],
)  # fmt: skip
def test_it_is_the_arc_of_g_code(text: str, gcode: str) -> None:
    ours, reference = arc(text), read_gcode(f"G21 G90 G0 X50 Y20 Z34\nF1500 {gcode}\nM2").motions[-1]
    assert ours.p_end == pytest.approx(reference.p_end, abs=1e-12)
    assert ours.turn_rad == pytest.approx(reference.turn_rad, abs=1e-12)
    assert ours.p_centre == pytest.approx(reference.p_centre, abs=1e-12)
    assert ours.feed_m_s == pytest.approx(reference.feed_m_s)


@given(st.floats(0.1, 6.1), st.booleans(), st.floats(-math.pi, math.pi))
def test_any_arc_of_less_than_a_turn(turn: float, clockwise: bool, start: float) -> None:
    sense = -1.0 if clockwise else 1.0
    first, last = ((40 + 10 * math.cos(a), 20 + 10 * math.sin(a)) for a in (start, start + sense * turn))
    along = -sense * math.sin(start), sense * math.cos(start)
    second = "2,INTOF," if turn > math.pi else ""
    text = (
        f"FEDRAT/9,MMPM\nRAPID\nGOTO/{first[0]:.5f},{first[1]:.5f},1\nINDIRV/{along[0]:.5f},{along[1]:.5f},0\n"
        f"TLON,GOFWD/(CIRCLE/40,20,1,10),ON,{second}(LINE/40,20,1,{last[0]:.5f},{last[1]:.5f},1)\n"
    )
    motion = read_apt(text).motions[-1]
    assert motion.turn_rad == pytest.approx(sense * turn, abs=1e-5)


@pytest.mark.parametrize(
    ("text", "match"),
    [
        (QUARTER.split("\n", 1)[1], "part:4:1: TLON,GOFWD without INDIRV before it"),
        (QUARTER.replace("TLON", "GOTO/50,20,34\nTLON"), "TLON,GOFWD without INDIRV before it"),
        ("RAPID\n" + QUARTER, "a rapid on an arc"),
        (QUARTER.replace("10.00000)", "11.00000)"), "the start of the motion is 1.000 mm beside the circle"),
        (QUARTER.replace("   30.00000,   34", "   31.00000,   34"), "the end of the motion is 1.000 mm beside"),
        (QUARTER.replace("34.00000)", "35.00000)"), "the circle leaves its height by 1.000 mm"),
        (QUARTER.replace("(LINE/   40.00000", "(LINE/   41.00000"), "the line does not begin at the centre"),
        (QUARTER.replace("0.00000, 1.00000, 0", "1.00000, 0.00000, 0"), "INDIRV does not point along the circle"),
        (QUARTER.replace("ON,(", "ON,2,INTOF,("), "the end is not the first point of the line"),
        (LONG.replace("2,INTOF,", ""), "the end is not the first point of the line"),
        (QUARTER.replace("10.00000)", "10.0,1.0)"), "the circle needs 4 numbers and the line 6"),
    ],
)
def test_refusals(text: str, match: str) -> None:
    with pytest.raises(ProgramError, match=match):
        read_apt(HEAD + text, name="part")


def shifted(program: Program, rising: float) -> tuple[CompensatedPath, str]:
    path = tool_path(program, step_m=5e-4)
    shift = np.tile([1e-4, -2e-4, 0.0], (len(path), 1))
    shift[:, 2] = 3e-4 + rising * np.arange(len(path)) / len(path)
    shift[0] = 0.0
    wanted = CompensatedPath.from_correction(path, shift)
    return wanted, write_apt(program, wanted, header=False).text


@pytest.mark.parametrize("text", [QUARTER, LONG])
def test_a_shifted_circle_stays_one_and_a_rising_one_becomes_points(text: str) -> None:
    source = HEAD + text + "FINI\n"
    program = read_apt(source)
    assert write_apt(program, CompensatedPath.nominal(tool_path(program, step_m=5e-4))).text == source
    _, level = shifted(program, 0.0)
    back = read_apt(level).motions[-1]
    assert back.kind == "arc"
    assert back.turn_rad == pytest.approx(program.motions[-1].turn_rad, abs=1e-6)
    assert np.asarray(back.p_centre)[:2] / MM == pytest.approx([40.1, 19.8], abs=1e-4)
    wanted, rising = shifted(program, 2e-4)
    again = read_apt(rising)
    assert {m.kind for m in again.motions[1:]} == {"feed"}
    p = tool_path(again, step_m=5e-5).p_part_tcp
    away = np.linalg.norm(wanted.p_part_command[1:, None] - p[None], axis=2).min(axis=1)
    assert away.max() < 5e-6 + 2.5e-5  # tolerance, and half of the distance of the points compared with


def test_the_ending_of_catia_is_known(tmp_path: Path) -> None:
    file = tmp_path / "part.CATProcess_1.aptsource"
    file.write_text("$$*CATIA0\nPARTNO A\nMULTAX\nAUTOPS\n" + HEAD + QUARTER + "FINI\n")
    program = read_program_file(file)
    assert program.dialect == "apt"
    assert [m.kind for m in program.motions] == ["rapid", "arc"]
