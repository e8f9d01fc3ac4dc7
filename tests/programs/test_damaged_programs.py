"""Programs of every language, damaged: read, or refused by one line that names the file; nothing else may happen."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.errors import CounterflexError
from counterflex.integrations.abb.language.read.reader import read_rapid
from counterflex.integrations.beckhoff.language.reader import read_twincat
from counterflex.integrations.fanuc.language.read.reader import read_fanuc
from counterflex.integrations.kuka.language.read.reader import read_krl
from counterflex.integrations.siemens.language.reader import read_sinumerik
from counterflex.integrations.staubli.language.read.reader import read_val3
from counterflex.programs.apt.reader import read_apt
from counterflex.programs.gcode.read.reader import read_gcode
from counterflex.programs.program import Program

SAMPLES = Path(__file__).parents[2] / "examples" / "programs"
TWINCAT = (
    "%GROOVE\nN10 G71 G90 G17 G54 (metric)\nN20 T1 M6\nS13000 M3\n#set paramVertexSmoothing(2; 1; 0.5)#\nR1=25\n"
    "G0 X-12 Y15 Z60\nG1 Z34 F3000 G9\nG1 X=R1 F1500\nG2 X45 Y35 U20\nG4 X0.5\nG0 Z60\nM5\nM30\n"
)


def text(name: str) -> str:
    return (SAMPLES / name).read_text(encoding="latin-1")


Read = Callable[[str, str], Program]
READERS: dict[str, tuple[str, str, Read]] = {
    "linuxcnc": (text("groove.ngc"), "", lambda one, _: read_gcode(one, name="damaged")),
    "sinumerik": (text("tilted_groove.mpf"), "", lambda one, _: read_sinumerik(one, name="damaged", complete=True)),
    "twincat": (TWINCAT, "", lambda one, _: read_twincat(one, name="damaged", complete=True)),
    "apt": (text("groove.apt"), "", lambda one, _: read_apt(one, name="damaged")),
    "krl": (text("groove.src"), text("groove.dat"), lambda one, two: read_krl(one, data=two, name="damaged",
                                                                              data_name="damaged.dat")),
    "rapid": (text("groove.mod"), "", lambda one, _: read_rapid(one, name="damaged")),
    "fanuc": (text("groove.ls"), "", lambda one, _: read_fanuc(one, name="damaged")),
    "val3": (text("groove.pgx"), text("groove.dtx"), lambda one, two: read_val3(one, data=two, name="damaged",
                                                                                data_name="damaged.dtx")),
}  # fmt: skip
PIECES = (
    "", ";", "{", "}", "[", "]", "(", ")", '"', "'", ",", "=", "#", "%", "!", "/", "\\", ":", "\n", "\r\n", "\0",
    "9" * 400,
    "-", "1e999", "nan", ".", "é", "<", "</Data>", "P[1]", "END", "ENDPROC", "IF", "é\n", "0x10", "--5", "1.2.3",
    "$", "@", "*",
)  # fmt: skip


def damaged(draw: Any, original: str) -> str:
    """A text with up to four parts replaced, doubled or left out."""
    out = original
    for _ in range(draw(st.integers(1, 4))):
        a = draw(st.integers(0, len(out)))
        b = min(len(out), a + draw(st.sampled_from([0, 0, 1, 1, 2, 7, 40, 400])))
        piece = draw(st.sampled_from([*PIECES, out[a:b] * 2, out[a:b][::-1]]))
        out = out[:a] + piece + out[b:]
    return out


@pytest.mark.by_turn
@pytest.mark.parametrize("language", READERS)
@settings(max_examples=150, deadline=None)
@given(st.data())
def test_damage_is_read_or_refused(language: str, data: st.DataObject) -> None:
    one, two, read = READERS[language]
    one = damaged(data.draw, one)
    two = damaged(data.draw, two) if two and data.draw(st.booleans()) else two
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            read(one, two)
        except CounterflexError as fault:
            said = str(fault)
            assert said.startswith("damaged"), said
            assert "\n" not in said


FREECAD = """
&ACCESS  RVP
&REL 1
&PARAM TEMPLATE = C:\\KRC\\Roboter\\Template\\ExpertVorgabe
&PARAM EDITMASK = *

DEF Trajectory( )

;------------- definitions ------------
EXT BAS (BAS_COMMAND  :IN,REAL  :IN ) ;set base to World
BAS (#INITMOV,0 ) ;Initialicing the defaults for Vel and so on

;------------- main part ------------
{}
;------------- end ------------
END

"""
"""A subprogram as FreeCAD's robot workbench exports it for KUKA; made in its form, FreeCAD was not run."""


@settings(max_examples=30, deadline=None)
@given(
    st.lists(
        st.tuples(*(st.integers(-500_000, 500_000) for _ in range(3)), st.integers(1, 2000)), min_size=2, max_size=8
    )
)
def test_a_trajectory_of_freecad_is_read(points: list[tuple[int, int, int, int]]) -> None:
    """Way points with their speeds: positions and feeds come back as they are written."""
    lines = [
        f"$VEL.CP = {speed / 1000:f} ; m/s\nLIN {{X {x / 1000:.3f},Y {y / 1000:.3f},Z {z / 1000:.3f},"
        "A 180.000,B 0.000,C 180.000} ; Pt"
        for x, y, z, speed in points
    ]
    made = read_krl(FREECAD.format("\n".join(lines)), name="freecad.src")
    assert len(made.motions) == len(points)
    for motion, (x, y, z, speed) in zip(made.motions[1:], points[1:], strict=True):
        assert motion.p_end == pytest.approx([x * 1e-6, y * 1e-6, z * 1e-6], abs=1e-12)
        assert motion.feed_m_s == pytest.approx(speed * 1e-3)
