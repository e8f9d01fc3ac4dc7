"""Laws of the reader: no exception but its own, short and full scanner agree, and programs that mean the same are."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
import pytest
from hypothesis import assume, example, given, settings, strategies as st

from counterflex.core.errors import ProgramError
from counterflex.core.units import INCH, MM
from counterflex.programs.gcode.read.parameter_file import MillingMachine
from counterflex.programs.gcode.read.reader import read_gcode
from counterflex.programs.gcode.read.scanner import ScannedLine, scan_plain
from counterflex.programs.program import Program

QUICK = settings(max_examples=120, deadline=None)

number = st.one_of(
    st.integers(-60, 60).map(str),
    st.floats(-90.0, 90.0).map(lambda value: f"{value:.4f}"),
    st.sampled_from(["-.5", "+3.", "0", "1 0", "- 2", "..", "", "-", "1e3", "#1", "#<a>", "##1", "[1+2]", "[#1*2]",
                     "SIN[30]", "ATAN[1]/[2]", "[1/0]", "[[[1]]]", "-[2]", "[1 EQ 1]", "[2**3]", "99999999999999999"]),
)  # fmt: skip
code = st.sampled_from(
    ["G0", "G1", "G2", "G3", "G4", "G10", "G17", "G18", "G19", "G20", "G21", "G28", "G30", "G40", "G41", "G43", "G43.1",
     "G49", "G52", "G53", "G54", "G55", "G59.3", "G61", "G64", "G73", "G76", "G80", "G81", "G82", "G83", "G85", "G86",
     "G89", "G90", "G90.1", "G91", "G91.1", "G92", "G92.1", "G92.2", "G92.3", "G93", "G94", "G95", "G96", "G97", "G98",
     "G99", "G5", "G33", "G38.2", "G7", "M0", "M1", "M2", "M3", "M4", "M5", "M6", "M7", "M8", "M9", "M19", "M30", "M48",
     "M60", "M61", "M66", "M98", "M99", "M101", "G1.5", "G28.1"]
)  # fmt: skip
word = st.tuples(st.sampled_from("XYZXYZABCIJKRPQLFSTHDNEUW$"), number).map("".join)
flow = st.sampled_from(
    ["o1 sub", "o1 endsub", "o1 call [1]", "o1 return", "o2 while [#1 LT 3]", "o2 endwhile", "o2 do", "o2 while [0]",
     "o3 if [1]", "o3 elseif [0]", "o3 else", "o3 endif", "o4 repeat [2]", "o4 endrepeat", "o4 break", "o4 continue",
     "O100", "M98 P100 L2", "o<x> call", "o[1] call", "o#1 call", "o", "o1", "o1 if", "o-1 sub"]
)  # fmt: skip
odd = st.one_of(
    st.sampled_from(
        ["%", "/", "(a)", "(a", ";b", "#1=5", "#<a>=2", "#<_b>=[1+1]", "#5220=1", "#[0]=1", "#1", "(a(b))"]
    ),
    st.text(alphabet="GXYM0123456789.+-#[]<>=();/%o* \t", max_size=16),
    st.text(max_size=6),
)
line = st.one_of(st.lists(st.one_of(code, word), max_size=6).map(" ".join), flow, odd)


MACHINE = MillingMachine({5161: 0.0, 5162: 0.0, 5163: 9.0}, tool_lengths={1: 0.05})


@pytest.mark.long
@settings(max_examples=600, deadline=None)
@example(["&REL"])  # another language: refused at its line, which has no column
@example(["&REL", "&ACCESS RVP", "DEF p( )"])
@given(st.lists(line, max_size=14))
def test_any_text_is_read_or_refused_in_one_line(lines: list[str]) -> None:
    text = "\n".join(["F100 S100 M3", *lines])
    program: Program | None = None
    refusal: ProgramError | None = None
    try:
        program = read_gcode(text, step_limit=300, machine=MACHINE)
    except ProgramError as fault:
        refusal = fault
    if refusal is not None:
        assert "\n" not in str(refusal)
        assert refusal.where is not None
        name, row, *column = refusal.where.split(":")
        assert name == "program"
        assert 1 <= int(row) <= len(lines) + 20
        assert all(int(number) >= 1 for number in column)  # a text in another language has none
    if program is not None:
        assert sum(block.motion_count for block in program.blocks) == len(program.motions)
        for motion in program.motions:
            assert np.all(np.isfinite(motion.p_end))
            assert math.isfinite(motion.feed_m_s)
            assert motion.kind in ("rapid", "dwell") or motion.feed_m_s + motion.feed_rad_s >= 0.0


plain_word = st.tuples(
    st.sampled_from("gGxXYyzZfFiIJkRMnS"), st.sampled_from(["", " ", "\t"]),
    st.one_of(st.integers(-999, 999).map(str), st.floats(-1e3, 1e3).map(lambda v: f"{v:.5f}"),
              st.sampled_from(["+.5", "-0", "3.", "-.25", "007"])),
    st.sampled_from(["", " ", "  "]),
).map("".join)  # fmt: skip


@QUICK
@given(st.lists(plain_word, min_size=1, max_size=8).map("".join))
def test_short_and_full_scanner_agree(text: str) -> None:
    short = scan_plain(text)
    # Where the short scanner declines, blanks inside a number had to be joined.
    if short is not None:
        full = ScannedLine.scan(text, "p", 1)
        assert full.flow is None
        assert [(w.letter, w.value, w.start, w.end) for w in full.words] == [
            (w.letter, w.value, w.start, w.end) for w in short
        ]
        for w in short:
            assert text[w.start].upper() == w.letter
            assert float(text[w.start + 1 : w.end]) == w.value


@QUICK
@given(st.lists(st.one_of(plain_word, code), min_size=1, max_size=8).map(" ".join), st.booleans())
def test_short_and_long_way_give_the_same_program(text: str, metric: bool) -> None:
    lines = ["G21" if metric else "G20", "F100", "G0 X1 Y2", "G1 Z3", text, "X5", "G0 Z7"]
    results: list[Program | str] = []
    for plain in (True, False):
        try:
            results.append(read_gcode("\n".join(lines), plain_lines=plain))
        except ProgramError as fault:
            results.append(str(fault))
    short, full = results
    assert repr(short) == repr(full)


coordinate = st.integers(-4000, 4000).map(lambda value: value / 100.0)
point = st.tuples(coordinate, coordinate, coordinate)
points = st.lists(point, min_size=1, max_size=8)


def text_of(
    rows: Sequence[tuple[float, ...]], show: Callable[[float], str] = lambda value: f"{value:.4f}"
) -> list[str]:
    return ["G1 " + " ".join(axis + show(value) for axis, value in zip("XYZ", row, strict=True)) for row in rows]


def ends(program: Program) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    return np.array([motion.p_end for motion in program.motions if motion.kind != "dwell"])


@QUICK
@given(points)
def test_inches_and_millimetres_are_one_program(rows: list[tuple[float, float, float]]) -> None:
    metric = read_gcode("\n".join(["G21 G90", "F254", *text_of(rows)]))
    inch = [tuple(value * MM / INCH for value in row) for row in rows]
    imperial = read_gcode("\n".join(["G20 G90", "F10", *text_of(inch, lambda value: f"{value:.12f}")]))
    assert ends(imperial) == pytest.approx(ends(metric), abs=1e-12)
    assert [m.feed_m_s for m in imperial.motions] == pytest.approx([m.feed_m_s for m in metric.motions], rel=1e-12)


@QUICK
@given(points)
def test_absolute_and_incremental_are_one_program(rows: list[tuple[float, float, float]]) -> None:
    absolute = read_gcode("\n".join(["G21 G90 F100", *text_of(rows)]))
    steps = [
        tuple(b - a for a, b in zip(p, q, strict=True)) for p, q in zip([(0.0, 0.0, 0.0), *rows], rows, strict=False)
    ]
    incremental = read_gcode("\n".join(["G21 G91 F100", *text_of(steps)]))
    assert ends(incremental) == pytest.approx(ends(absolute), abs=1e-12)


@QUICK
@given(points, point, st.sampled_from(["G92", "G52", "G10", "given"]))
def test_a_shifted_program_is_shifted(
    rows: list[tuple[float, float, float]], shift: tuple[float, float, float], how: str
) -> None:
    plain = read_gcode("\n".join(["G21 G90 F100", *text_of(rows)]))
    x, y, z = shift
    head = {
        "G92": f"G92 X{-x:.4f} Y{-y:.4f} Z{-z:.4f}",
        "G52": f"G52 X{x:.4f} Y{y:.4f} Z{z:.4f}",
        "G10": f"G10 L2 P3 X{x:.4f} Y{y:.4f} Z{z:.4f}\nG56",
        "given": "G57",
    }[how]
    offsets = {"G57": (x * MM, y * MM, z * MM)}
    shifted = read_gcode(
        "\n".join(["G21 G90 F100", head, *text_of(rows)]), machine=MillingMachine(work_offsets=offsets)
    )
    assert ends(shifted) == pytest.approx(ends(plain) + np.array(shift) * MM, abs=1e-12)


@QUICK
@given(
    st.floats(1.0, 50.0), st.floats(-180.0, 180.0), st.floats(5.0, 355.0), st.booleans(),
    st.sampled_from([("17", 0, 1), ("18", 2, 0), ("19", 1, 2)]), st.floats(-5.0, 5.0),
)  # fmt: skip
def test_radius_and_centre_are_one_arc(
    radius: float, start: float, turn: float, clockwise: bool, plane: tuple[str, int, int], rise: float
) -> None:
    assume(abs(turn - 180.0) > 2.0)
    code, first, second = plane
    third = 3 - first - second

    def at(angle: float) -> tuple[float, float]:
        return radius * math.cos(math.radians(angle)), radius * math.sin(math.radians(angle))

    a, b = at(start), at(start + (-turn if clockwise else turn))
    word = "G2" if clockwise else "G3"
    where = f"{'XYZ'[first]}{b[0]:.9f} {'XYZ'[second]}{b[1]:.9f} {'XYZ'[third]}{rise:.9f}"
    head = f"G21 G90 G{code} F100\nG0 {'XYZ'[first]}{a[0]:.9f} {'XYZ'[second]}{a[1]:.9f}\n"
    centre = f"{'IJK'[first]}{-a[0]:.9f} {'IJK'[second]}{-a[1]:.9f}"
    signed = radius if turn < 180.0 else -radius
    by_centre = read_gcode(f"{head}{word} {where} {centre}").motions[-1]
    by_radius = read_gcode(f"{head}{word} {where} R{signed:.9f}").motions[-1]
    absolute = read_gcode(f"{head}G90.1 {word} {where} {'IJK'[first]}0 {'IJK'[second]}0").motions[-1]
    for motion in (by_centre, by_radius, absolute):
        assert motion.p_centre is not None
        assert motion.normal is not None
        assert motion.normal[third] == 1.0
        assert motion.turn_rad == pytest.approx(math.radians(-turn if clockwise else turn), abs=2e-6)
        assert np.delete(motion.p_centre, third) == pytest.approx([0.0, 0.0], abs=2e-7)
        assert motion.p_centre[third] == 0.0


@QUICK
@given(st.lists(st.tuples(st.sampled_from(["X", "Y", "Z", "I", "J", "F", "S"]), coordinate), min_size=1, max_size=6))
def test_formatting_round_trip(words: list[tuple[str, float]]) -> None:
    """However a number is written, with blanks or in either case, the same words come back."""
    plain = " ".join(f"{letter}{value:.4f}" for letter, value in words)
    spaced = " ".join(f"{letter.lower()} {' '.join(f'{value:.4f}')}" for letter, value in words)
    bracket = "".join(f"{letter}[{value:.4f}+0]" for letter, value in words)
    letters = [letter for letter, _ in words]
    for text in (plain, spaced):
        scanned = ScannedLine.scan(text, "p", 1).words
        assert [word.letter for word in scanned] == letters
        assert [word.value for word in scanned] == pytest.approx([value for _, value in words], abs=1e-9)
    assert [word.letter for word in ScannedLine.scan(bracket, "p", 1).words] == letters


@QUICK
@given(st.lists(st.sampled_from(["+", "-", "*"]), max_size=6), st.lists(st.integers(1, 20), min_size=7, max_size=7))
def test_expressions_agree_with_python(operators: list[str], operands: list[int]) -> None:
    expression = str(operands[0]) + "".join(f" {o} {n}" for o, n in zip(operators, operands[1:], strict=False))
    program = read_gcode(f"G21\nG0 X[[{expression}] / 1000]")
    # RS274 gives + and - one precedence, * a tighter one, left to right: as Python does.
    assert program.motions[0].p_end[0] / MM == pytest.approx(eval(expression) / 1000.0, abs=1e-9)
