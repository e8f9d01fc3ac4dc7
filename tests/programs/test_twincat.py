"""The TwinCAT dialect: read beside LinuxCNC's interpreter where the words agree, written back with targets replaced."""

from __future__ import annotations

import importlib.util
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.errors import ProgramError
from counterflex.core.units import INCH, MM, MM_PER_MIN, UM
from counterflex.integrations.beckhoff.language.reader import read_twincat
from counterflex.programs.gcode.write.writer import write_gcode
from robot_corrections import corrected

CORPUS = Path(__file__).resolve().parents[1] / "data" / "gcode" / "corpus"
AGREEING = ("straight", "arcs_radius")
"""Programs that test_gcode_rs274.py holds to LinuxCNC's own interpreter, made of words that TwinCAT has too."""
_SPEC = importlib.util.spec_from_file_location("rs274_of_twincat", Path(__file__).with_name("test_gcode_rs274.py"))
assert _SPEC is not None
assert _SPEC.loader is not None
RS274 = importlib.util.module_from_spec(_SPEC)
sys.modules[_SPEC.name] = RS274  # its dataclasses look themselves up
_SPEC.loader.exec_module(RS274)


def translated(text: str) -> str:
    """A LinuxCNC program in the words of TwinCAT; F is in mm/min there, also under G70."""
    out = []
    for line in text.splitlines():
        line = re.sub(r"G94|G64[^(]*|G80|G49", "", line).replace("G20", "G70").replace("G21", "G71")
        if re.search(r"\bG0?4\b", line):
            line = re.sub(r"P([\d.]+)", r"X\1", line)
        out.append(re.sub(r"(?<![A-Z])R(-?[\d.]+)", r"U\1", line))
    return "\n".join(out) + "\n"


@pytest.mark.parametrize("name", AGREEING)
def test_words_that_agree_against_the_calls_of_linuxcnc_itself(name: str) -> None:
    """Against the golden files that LinuxCNC's interpreter wrote, without our reader between."""
    text = (CORPUS / f"{name}.ngc").read_text(encoding="ascii")
    calls = (CORPUS / f"{name}.canon").read_text(encoding="ascii").splitlines()
    RS274.compare(read_twincat(translated(text)), RS274.canonical_motions(calls))


def test_words_of_the_dialect() -> None:
    made = read_twincat(
        "%PART\nN10 G71 G90 G17 G54 (metric; really)\nT2 M6\n#set paramVertexSmoothing(2; 1; 0.5)#\nR1=12.5 R2=-3\n"
        "G0 X-12 Y15 Z60\n@714\nS9000 M3\nG1 Z34 F3000 G9\nG1 X=R1 Y=-R2 FLIN\nG2 X32.5 Y3 U10\nG04 X0.5\n#MSG(ok)#\n"
        "G70 G1 X1 F600\nM30\nthis is not looked at\n"
    )
    assert [motion.kind for motion in made.motions] == ["rapid", "feed", "feed", "arc", "dwell", "feed"]
    np.testing.assert_allclose(made.motions[2].p_end / MM, [12.5, 3.0, 34.0])
    assert abs(made.motions[3].turn_rad) == pytest.approx(np.pi)
    assert made.motions[4].duration_s == 0.5
    np.testing.assert_allclose(made.motions[5].p_end[0], INCH)
    assert made.motions[5].feed_m_s == pytest.approx(600.0 * MM_PER_MIN)
    assert made.motions[1].tool == 2


BAD = {
    "G41": "cutter radius", "G1 X5 B3 F9": "radius B", "CIP X1 Y2 I3": "arc through a point", "L10": "subprograms",
    "#set paramZeroShift(G58;1;2;3)#": "statement of the channel", "!x=5": "statement of the channel",
    "$IF a": "statement of the channel", "@100": "statement of the channel", "(open": "comments stand in brackets",
    "; old": "comments stand in brackets", "G74": "reference point", "G1 X1 Q5 F9": "unknown word",
    "G99": "unknown G code",
    "X=R7": "nothing in the program gives R7", "R1=R2+1\nX=R1": "nothing in the program gives R2",
    "G58 X1": "second programmable offset", "FOO": "unknown word",
    "G54\nG0 X1\nG55": "how far G55 lies from G54", "G42 X1": "cutter radius", "G1 X1": "without a feed",
}  # fmt: skip


@pytest.mark.parametrize("line", BAD)
def test_what_is_not_known_is_refused_with_its_line(line: str) -> None:
    with pytest.raises(ProgramError, match=rf"part.nc:[234]:\d+.*{BAD[line]}") as caught:
        read_twincat(f"G71 G90\n{line}\nM30\n", name="part.nc", complete=True)
    assert "\n" not in str(caught.value)


OTHERS = ("(remark G1 X5)", "", "#set paramAutoAccurateStop(30)#", "@714", "M8", "R5=2.25")


@settings(max_examples=40, deadline=None)
@given(
    st.lists(st.tuples(st.sampled_from(["G1", "G1 F900", "G2", "G3"]), st.integers(-20, 20), st.integers(-20, 20)),
             min_size=1, max_size=6),
    st.lists(st.sampled_from(OTHERS), min_size=6, max_size=6), st.floats(0.0, 500.0), st.sampled_from(["\n", "\r\n"]),
)  # fmt: skip
def test_only_targets_change(
    moves: list[tuple[str, int, int]], others: list[str], size_um: float, newline: str
) -> None:
    """Lines stay in order but for the words of targets, and what is written is read back."""
    lines = ["%P", "G71 G90 G17 G54", "G0 X0 Y0 Z5", "G1 Z0 F600"]
    x = y = 0
    for (word, dx, dy), other in zip(moves, others, strict=False):
        if dx or dy:
            x, y = x + dx, y + dy
            radius = f" U{np.hypot(dx, dy):.3f}" if word in ("G2", "G3") else ""
            lines += [other, f"{word} X{x} Y{y}{radius}"]
    text = newline.join([*lines, "M30", ""])
    program = read_twincat(text, complete=True)
    compensated = corrected(program, size_um * UM, 5.0)
    after = write_gcode(program, compensated, tolerance_m=5.0 * UM).text
    if not compensated.moved.any():
        assert after == text
        return
    words = re.compile(r"\s*[XYZUIJKF]-?[\d.]+|G[0123]\b")
    rest = iter([words.sub("", line).strip() for line in after.split(newline)])
    for line in text.split(newline):
        assert any(words.sub("", line).strip() == other for other in rest), line
    back = read_twincat(after, complete=True)
    np.testing.assert_allclose(back.motions[-1].p_end, compensated.p_part_command[-1], atol=0.2 * UM)
