"""``WITH`` behind a spline motion: system variables that hold for that motion alone.

``SLIN XP2 WITH $VEL.CP=0.05 C_SPL`` as programs write it, and as the inline forms of KSS 8.3 and later do:
``SLIN XP2 WITH $VEL = SVEL_CP( 0.05, , LCPDAT1), $TOOL = STOOL2( FP2), $BASE = SBASE( FP2.BASE_NO), ... C_SPL``.

Source: KUKA, KSS 8.3 Operating and Programming Instructions for System Integrators, spline motions.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

from counterflex.programs.robot_text.process_words import NUMBER

_I: Final = re.IGNORECASE
_BEGINS: Final = re.compile(r"\s*(WITH)\b", _I)
_VARIABLE: Final = re.compile(r"\s*\$(\w+)((?:\.\w+)?)(?:\s*\[\s*\d+\s*\])?\s*=\s*", _I)
_ENDS: Final = re.compile(r"\s*(?:C_(?:DIS|PTP|VEL|ORI|SPL)\b|$)", _I)
_SPEED: Final = re.compile(rf"(?:SVEL_CP\s*\(\s*|\{{(?:[^{{}}]*,)?\s*CP\s+)({NUMBER})\s*[,)}}]", _I)
_PLAIN: Final = re.compile(rf"({NUMBER})", _I)
_FRAME_DATA: Final = {
    "TOOL": re.compile(r"STOOL2?\s*\(\s*([A-Z]\w*)(?:\.TOOL_NO)?\s*\)", _I),
    "BASE": re.compile(r"SBASE2?\s*\(\s*([A-Z]\w*)(?:\.BASE_NO)?\s*\)", _I),
}
_CARRIED: Final = frozenset(
    ("LOAD", "ACC", "ORI_TYPE", "CIRC_TYPE", "APO", "JERK", "GEAR_JERK", "VEL_AXIS", "ACC_AXIS", "VEL_EXTAX",
     "ACC_EXTAX", "COLLMON_TOL_PRO", "EX_AX_IGNORE", "ECO_LEVEL")
)  # fmt: skip
"""Variables that move no target and set no speed along the path."""


class WithFault(ValueError):
    """A clause that is not understood; ``at`` is where in the line.

    Args:
        what: The fault.
        at: Index in the line.
        hint: What to do.
    """

    def __init__(self, what: str, at: int, hint: str) -> None:
        super().__init__(what)
        self.what, self.at, self.hint = what, at, hint


@dataclass(frozen=True, slots=True)
class WithClause:
    """A clause as read.

    Attributes:
        start: Index of ``WITH`` in its line.
        end: Index behind it.
        speed: Where the number of the path speed stands, m/s; None where none is given.
        frame_data: Name of the FDAT variable that gives tool and base; empty where none is named.
    """

    start: int
    end: int
    speed: tuple[int, int] | None = None
    frame_data: str = ""


def with_clause(code: str, at: int) -> WithClause | None:
    """The clause that begins at a place of a line; None where there is none.

    Args:
        code: The line without its comment.
        at: Index behind targets and approximation.

    Raises:
        WithFault: A variable or a value is not understood.
    """
    begins = _BEGINS.match(code, at)
    if begins is None:
        return None
    speed, frames, at = None, set(), begins.end()
    while True:
        variable = _VARIABLE.match(code, at)
        if variable is None:
            raise WithFault("WITH needs a system variable and its value", at, "WITH $VEL.CP=0.02")
        name, part, first = variable[1].upper(), variable[2].upper(), variable.end()
        end = _end_of_value(code, first)
        value = code[first:end].rstrip()
        if name == "VEL" and part in ("", ".CP"):
            speed = _speed(code, first, end, whole=not part)
        elif name in _FRAME_DATA:
            frames.add(_frame_data(name, value, first))
        elif name == "IPO_MODE":
            if value.upper() == "#TCP":
                raise WithFault("the robot holds the part against a tool that stands ($IPO_MODE=#TCP)", first,
                                "Give the G-code that it was made from")  # fmt: skip
        elif name not in _CARRIED and name != "VEL":
            raise WithFault(f"WITH ${name} is not read", variable.start(1) - 1, "Set it by a statement of its own")
        at = end
        if code[at : at + 1] != ",":
            break
        at += 1
    if _ENDS.match(code, at) is None:
        raise WithFault("this is not understood behind WITH", at, "C_SPL ends the statement")
    if len(frames) > 1:
        raise WithFault("tool and base come from different frame data", begins.start(1), "Post the program again")
    last = begins.start(1) + len(code[begins.start(1) : at].rstrip())
    return WithClause(begins.start(1), last, speed, frames.pop() if frames else "")


def _end_of_value(code: str, at: int) -> int:
    """Index of the comma behind a value, of the approximation, or of the end of the line."""
    depth = 0
    while at < len(code):
        character = code[at]
        if character in "({[":
            depth += 1
        elif character in ")}]":
            depth -= 1
        elif depth == 0 and (character == "," or (character.isspace() and _ENDS.match(code, at))):
            break
        at += 1
    if depth:
        raise WithFault("a bracket is not closed: the line may be cut off", at, "Post the program again")
    return at


def _speed(code: str, first: int, end: int, *, whole: bool) -> tuple[int, int]:
    match = (_SPEED if whole else _PLAIN).match(code, first, end)
    if match is None or (not whole and code[match.end() : end].strip()):
        raise WithFault("the path speed is no number", first, "Write the number itself, in m/s")
    return match.span(1)


def _frame_data(name: str, value: str, first: int) -> str:
    match = _FRAME_DATA[name].fullmatch(value)
    if match is None:
        raise WithFault(f"which frame ${name} gets is not known", first, f"Set ${name} by a statement of its own")
    return match[1]
