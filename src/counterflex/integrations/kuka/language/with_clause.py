"""``WITH`` behind a spline motion: system variables that hold for that motion alone.

``SLIN XP2 WITH $VEL.CP=0.05 C_SPL`` as programs write it, and as the inline forms of KSS 8.3 and later do:
``SLIN XP2 WITH $VEL = SVEL_CP( 0.05, , LCPDAT1), $TOOL = STOOL2( FP2), $BASE = SBASE( FP2.BASE_NO), ... C_SPL``.

Source: KUKA, KSS 8.3 Operating and Programming Instructions for System Integrators, spline motions.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

_I: Final = re.IGNORECASE
_BEGINS: Final = re.compile(r"\s*(WITH)\b", _I)
_VARIABLE: Final = re.compile(r"\s*\$(\w+)((?:\.\w+)?)(?:\s*\[\s*\d+\s*\])?\s*=\s*", _I)
_ENDS: Final = re.compile(r"\s*(?:C_(?:DIS|PTP|VEL|ORI|SPL)\b|$)", _I)
_SPEED: Final = re.compile(r"(?:SVEL_CP\s*\(\s*([^,()]+?)\s*[,)]|\{(?:[^{}]*,)?\s*CP\s+([^,{}]+?)\s*[,}])", _I)
_EVALUATED: Final = frozenset(("TOOL", "BASE", "IPO_MODE", "ORI_TYPE"))
_CARRIED: Final = frozenset(
    ("LOAD", "ACC", "CIRC_TYPE", "APO", "JERK", "GEAR_JERK", "VEL_AXIS", "ACC_AXIS", "VEL_EXTAX",
     "ACC_EXTAX", "COLLMON_TOL_PRO", "EX_AX_IGNORE", "ECO_LEVEL")
)  # fmt: skip
"""Variables that move no target and set no speed along the path."""


class WithFault(ValueError):
    """A clause that is not understood; ``at`` is where in the line.

    Args:
        at: Index in the line.
        hint: What to do.
    """

    def __init__(self, what: str, at: int, hint: str) -> None:
        super().__init__(what)
        self.what, self.at, self.hint = what, at, hint


@dataclass(frozen=True, slots=True)
class WithClause:
    """A clause as read."""

    start: int  # Index of ``WITH`` in its line
    end: int  # Index behind it
    speed: tuple[int, int] | None = None  # Where the path speed stands, m/s; None where none is given
    # Where the value of TOOL, BASE, IPO_MODE and ORI_TYPE stands, of those that are given
    values: Mapping[str, tuple[int, int]] = field(default_factory=dict)


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
    speed, at = None, begins.end()
    values: dict[str, tuple[int, int]] = {}
    while True:
        variable = _VARIABLE.match(code, at)
        if variable is None:
            raise WithFault("WITH needs a system variable and its value", at, "WITH $VEL.CP=0.02")
        name, part, first = variable[1].upper(), variable[2].upper(), variable.end()
        end = _end_of_value(code, first)
        if name == "VEL" and part in ("", ".CP"):
            speed = _speed(code, first, end, whole=not part)
        elif name in _EVALUATED and not part:
            values[name] = first, first + len(code[first:end].rstrip())
        elif name not in _CARRIED and name != "VEL":
            raise WithFault(f"WITH ${name} is not read", variable.start(1) - 1, "Set it by a statement of its own")
        at = end
        if code[at : at + 1] != ",":
            break
        at += 1
    if _ENDS.match(code, at) is None:
        raise WithFault("this is not understood behind WITH", at, "C_SPL ends the statement")
    last = begins.start(1) + len(code[begins.start(1) : at].rstrip())
    return WithClause(begins.start(1), last, speed, values)


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
    if not whole:
        return first, first + len(code[first:end].rstrip())
    match = _SPEED.match(code, first, end)
    if match is None:
        raise WithFault("the path speed is no number", first, "Write $VEL.CP=, in m/s")
    return match.span(1 if match[1] is not None else 2)
