"""Q parameters of Klartext: their values, formulas and the functions FN 0 to FN 13.

A parameter that the control, a table or a person sets is unknown; it may be copied and calculated with.

Source: HEIDENHAIN TNC 640 (34059x-05), User's Manual Conversational Programming, "Programming: Q Parameters": FN 0 to
FN 13, "Entering formulas directly", calculation rules, preassigned Q parameters (Q100 to Q199).
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Final

from counterflex.core.units import DEG
from counterflex.programs.expression import ExpressionError, Grammar, Value, evaluate, parse_whole
from counterflex.programs.unknown import Unknown, known

_NAME: Final = r"Q[LRS]?\d+"
_NUMBER: Final = r"(?:\d+(?:[.,]\d*)?|[.,]\d+)"
VALUE: Final = rf"[+-]?\s*(?:{_NUMBER}|Q[LR]?\d+)"
"""Pattern of a number or parameter behind an address."""
ASSIGNMENT: Final = re.compile(rf"\s*(?:FN\s*(\d+)\s*:\s*)?({_NAME})\s*=\s*(.*\S)\s*", re.IGNORECASE | re.DOTALL)
_POWER: Final = re.compile(
    r"(?:\b(?:SIN|COS|TAN|ASIN|ACOS|ATAN|SQ|SQRT|LN|LOG|EXP|NEG|INT|ABS|FRAC|SGN)|(?:^|[-+*/(%])\s*-)\s*[+-]?\s*"
    rf"(?:{_NAME}|{_NUMBER})\s*\^",
    re.IGNORECASE,
)
_LARGEST: Final = 1e12
_FN_MOST: Final = frozenset((0, 1, 2, 3, 4, 5, 6, 7, 8, 13))
TILT_ANGLES: Final = ("Q120", "Q121", "Q122")
"""Angles of A, B and C that PLANE has found for the machine."""


def _sum_of_squares(a: float, b: float) -> float:
    return math.hypot(a, b)


def _angle(a: float, b: float) -> float:
    """Angle of FN 13, deg, 0 to 360: of the point (b, a)."""
    return math.degrees(math.atan2(a, b)) % 360.0


_GRAMMAR: Final = Grammar(
    binary={
        "+": (1, lambda a, b: a + b), "-": (1, lambda a, b: a - b),
        "*": (2, lambda a, b: a * b), "/": (2, lambda a, b: a / b), "DIV": (2, lambda a, b: a / b),
        "%": (2, math.fmod), "LEN": (2, _sum_of_squares), "ANG": (2, _angle), "^": (3, lambda a, b: a**b),
    },
    unary={
        "+": (4, lambda a: +a), "-": (4, lambda a: -a), "NEG": (4, lambda a: -a),
        "SIN": (4, lambda a: math.sin(a * DEG)), "COS": (4, lambda a: math.cos(a * DEG)),
        "TAN": (4, lambda a: math.tan(a * DEG)), "ASIN": (4, lambda a: math.asin(a) / DEG),
        "ACOS": (4, lambda a: math.acos(a) / DEG), "ATAN": (4, lambda a: math.atan(a) / DEG),
        "SQ": (4, lambda a: a * a), "SQRT": (4, math.sqrt), "LN": (4, math.log), "LOG": (4, math.log10),
        "EXP": (4, math.exp), "INT": (4, lambda a: float(math.trunc(a))), "ABS": (4, abs),
        "FRAC": (4, lambda a: a - math.trunc(a)), "SGN": (4, lambda a: float((a > 0.0) - (a < 0.0))),
    },
    constants={"PI": math.pi},
    name=_NAME,
    number=_NUMBER,
    numeral=lambda text: float(text.replace(",", ".")),
)  # fmt: skip


class KlartextValues:
    """Parameters by name, in capitals; QL belong to the program that sets them."""

    def __init__(self) -> None:
        self._known: dict[str, Value] = {}
        self._local: list[dict[str, Value]] = [{}]

    def enter(self) -> None:
        """Begin another program."""
        self._local.append({})

    def leave(self) -> None:
        """Go back to the program that called."""
        self._local.pop()

    def memory(self) -> object:
        """Return all values."""
        return [self._known, self._local]

    def set(self, name: str, value: Value) -> None:
        """Give a parameter a value."""
        key = _key(name)
        (self._local[-1] if key.startswith("QL") else self._known)[key] = value

    def value_of(self, name: str, path: Sequence[object] = ()) -> Value:
        """Return the value of a parameter; unknown where the program sets none."""
        assert not path
        key = _key(name)
        if key in TILT_ANGLES:
            return Unknown(f"{key} holds an angle of the machine")
        stored = (self._local[-1] if key.startswith("QL") else self._known).get(key)
        return Unknown(f"nothing in the program gives {key}") if stored is None else stored

    def call(self, name: str, arguments: Sequence[Value], options: Mapping[str, Value]) -> Value:  # noqa: ARG002
        """Refuse a function: Klartext has only words before a value."""
        raise ExpressionError(f"{name} is no function of Klartext")

    def number(self, text: str) -> Value:
        """Return a number, or the value of a parameter, with its sign."""
        plain = "".join(text.split()).replace(",", ".")
        sign = -1.0 if plain.startswith("-") else 1.0
        plain = plain.lstrip("+-")
        value = self.value_of(plain) if plain[:1] in "Qq" else float(plain)
        return value if isinstance(value, Unknown) else sign * float(value)  # type: ignore[arg-type]

    def formula(self, text: str) -> Value:
        """Return the value of a formula, or of the right side of FN 0 to FN 8 and FN 13.

        Raises:
            ExpressionError: It is none, or has no value.
        """
        match = _POWER.search(text)
        if match is not None:
            raise ExpressionError("which of a function or sign and ^ comes first is not said: write brackets",
                                  match.start())  # fmt: skip
        value = evaluate(parse_whole(text, _GRAMMAR), _GRAMMAR, self)
        if isinstance(value, Unknown):
            return value
        if isinstance(value, bool | complex) or not isinstance(value, int | float) or not abs(value) <= _LARGEST:
            raise ExpressionError("the formula has no number as its value", 0)
        return float(value)


def is_arithmetic(function: int) -> bool:
    """Return whether FN of that number calculates a value from what stands behind it."""
    return function in _FN_MOST


def _key(name: str) -> str:
    match = re.fullmatch(r"(Q[LRS]?)(\d+)", name.strip().upper())
    assert match is not None, name
    return f"{match[1]}{int(match[2])}"


def required(value: Value, use: str, where: str, text: str) -> float:
    """Return a number that a statement needs. Raises ProgramError: it is unknown."""
    out = known(value, use, where, text=text)
    assert isinstance(out, float | int)
    return float(out)
