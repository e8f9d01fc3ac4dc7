"""Cycles that change coordinates: 7, 8, 10, 11, 19 and 26."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable
from typing import Final

import numpy as np

from counterflex.integrations.heidenhain.language.frames import FrameFault, spatial
from counterflex.integrations.heidenhain.language.source import KlartextStatement
from counterflex.integrations.heidenhain.language.state import KlartextState
from counterflex.integrations.heidenhain.language.values import VALUE, KlartextValues, required
from counterflex.programs.gcode.read.motion import FARTHEST_M

_LINE: Final = re.compile(r"CYCL\s+DEF\s+\d+\.(\d+)", re.IGNORECASE)
_WORD: Final = re.compile(
    rf"\s*(?:(I?ROT|SCL|ABST|DIST|CC[XYZ]|I?[XYZ]|[ABC]|F\s*MAX|F)\s*({VALUE})?|(#)\s*(\d+))", re.IGNORECASE
)
_SMALLEST, _LARGEST = 1e-6, 100.0


def _words(part: KlartextStatement, values: KlartextValues, name: str) -> dict[str, tuple[float | None, int]]:
    """Words of the lines behind the first, with their values and places."""
    out: dict[str, tuple[float | None, int]] = {}
    lines = list(_LINE.finditer(part.code))
    for match, after in itertools.zip_longest(lines, lines[1:]):
        at, end = match.end(), len(part.code) if after is None else after.start()
        while int(match[1]) > 0 and part.code[at:end].strip():
            word = _WORD.match(part.code, at, end)
            column = at + len(part.code[at:end]) - len(part.code[at:end].lstrip())
            if word is None or word.end() == at:
                raise part.fault(name, "an unknown word of the cycle", column, part.code[column:end].split()[0][:20])
            key = "#" if word[3] else "".join(word[1].upper().split())
            if key in out:
                raise part.fault(name, "the word appears twice in the cycle", column, word[0].strip())
            text = word[4] if word[3] else word[2]
            value = None if text is None else required(values.number(text), f"{key} of the cycle",
                                                       part.place(name, column), part.code)  # fmt: skip
            out[key], at = (value, column), word.end()
    return out


def define_frame(part: KlartextStatement, number: int, state: KlartextState, values: KlartextValues, name: str) -> bool:
    """Execute a cycle that changes coordinates; whether it tilts the working plane.

    Raises:
        ProgramError: It cannot be executed exactly.
    """
    words = _words(part, values, name)
    allowed = {
        7: ("X", "Y", "Z", "IX", "IY", "IZ", "#"), 8: ("X", "Y", "Z"), 10: ("ROT", "IROT"), 11: ("SCL",),
        19: ("A", "B", "C", "F", "FMAX", "ABST", "DIST"), 26: ("X", "Y", "Z", "CCX", "CCY", "CCZ"),
    }[number]  # fmt: skip
    for word, (value, column) in words.items():
        bare = number == 8 or word == "FMAX"
        if word not in allowed or (value is None) != bare:
            raise part.fault(name, f"cycle {number} does not take this word", column, word, " ".join(allowed))
    numbers = {word: (0.0 if value is None else value) for word, (value, _) in words.items()}
    try:
        return _define(part, number, state, numbers, name)
    except FrameFault as fault:
        raise part.fault(name, fault.what, None, None, fault.hint) from fault


def _define(part: KlartextStatement, number: int, state: KlartextState, numbers: dict[str, float], name: str) -> bool:
    before = state.frames.A
    wrong, hint = _CYCLES[number](state, numbers)
    if wrong:
        raise part.fault(name, wrong, None, None, hint)
    return number == 19 and bool(np.any(before != state.frames.A))


def _shift(state: KlartextState, numbers: dict[str, float]) -> tuple[str, str]:
    if "#" in numbers:
        hint = "Write the shift itself: CYCL DEF 7.1 X+10"
        return "a datum of the datum table of the control is not known", hint
    given = {"XYZ".index(word[-1]): (value * state.unit_m, word.startswith("I")) for word, value in numbers.items()}
    if any(not abs(value) <= FARTHEST_M for value, _ in given.values()):
        return "the datum shift is beyond any machine", "At most 1000 m"
    state.frames.set_shift(given)
    return _DONE


def _mirror(state: KlartextState, numbers: dict[str, float]) -> tuple[str, str]:
    state.frames.set_mirror(frozenset("XYZ".index(word) for word in numbers))
    return _DONE


def _rotate(state: KlartextState, numbers: dict[str, float]) -> tuple[str, str]:
    if len(numbers) != 1:
        return "cycle 10 needs one angle", "CYCL DEF 10.1 ROT+30"
    ((word, angle),) = numbers.items()
    state.frames.set_rotation(angle, word == "IROT")
    return _DONE


def _scale(_: KlartextState, numbers: dict[str, float]) -> tuple[str, str]:
    if numbers.get("SCL") == 1.0:
        return _DONE
    return "whether cycle 11 scales the tool axis depends on a machine parameter", "Write cycle 26 with X, Y and Z"


def _tilt(state: KlartextState, numbers: dict[str, float]) -> tuple[str, str]:
    angles = [numbers.get(axis, 0.0) for axis in "ABC"]
    if sum(angle != 0.0 for angle in angles) > 1:
        what = "a machine parameter decides whether the angles of cycle 19 are spatial or those of axes"
        return what, "Write PLANE SPATIAL"
    state.frames.set_plane(spatial(*angles))
    return _DONE


def _scale_axes(state: KlartextState, numbers: dict[str, float]) -> tuple[str, str]:
    factors = np.array([numbers.get(axis, 1.0) for axis in "XYZ"])
    if not np.all((factors >= _SMALLEST) & (factors < _LARGEST)):
        return "a scale is out of range", "0.000001 to 99.999999"
    state.frames.set_scale(factors, np.array([numbers.get(f"CC{axis}", 0.0) for axis in "XYZ"]) * state.unit_m)
    return _DONE


_DONE: Final = "", ""
_CYCLES: Final[dict[int, Callable[[KlartextState, dict[str, float]], tuple[str, str]]]] = {
    7: _shift, 8: _mirror, 10: _rotate, 11: _scale, 19: _tilt, 26: _scale_axes,
}  # fmt: skip
"""By number: executes a cycle; what is wrong with it and what to do, empty where it is done."""
