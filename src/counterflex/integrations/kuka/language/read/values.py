"""Values of KRL: numbers, records such as frames, frames that the controller stores, operators and functions.

A record is a dictionary by component in capitals; a literal of an enumeration is its text, ``#VAR``. A frame that the
program takes from the controller (``BASE_DATA[1]``) is a :class:`StoredFrame`: the geometric operator shifts it by a
known amount even where its numbers are not known.

Source: KUKA, KSS 8.3 Operating and Programming Instructions for System Integrators, chapter "Programming for user group
Expert (KRL syntax)": operators and their priority, standard functions.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import DEG, MM
from counterflex.geometry import pose, rotation
from counterflex.integrations.kuka.language.program import LETTERS
from counterflex.programs.expression import ExpressionError, Grammar, Node, Value as Value, is_number, parse_whole
from counterflex.programs.unknown import Unknown

_LONGEST_INTEGER: Final = 15  # Digits of an integer that a float holds exactly
Record = dict[str, Value]
AXES: Final = tuple(f"A{i}" for i in range(1, 7))
_NUMERAL: Final = r"(?:(?:\d+\.?\d*|\.\d+)(?:[Ee][-+]?\d+)?|'\s*(?:[Bb]\s*[01]+|[Hh]\s*[0-9A-Fa-f]+|\d+)\s*')"


@dataclass(frozen=True, eq=False)
class StoredFrame:
    """A frame that the controller stores, and where a program shifts it to."""

    name: str  # ``BASE_DATA`` or ``TOOL_DATA``
    number: int  # Of the entry
    T_stored: Float | None = None  # (4, 4) m, its value; None where it is not known
    # (4, 4) m, what the geometric operator composed behind it
    T_shift: Float = field(default_factory=lambda: np.eye(4))

    @property
    def shifted(self) -> bool:
        """True where it is not the stored frame itself."""
        return not np.array_equal(self.T_shift, np.eye(4))

    @property
    def T(self) -> Float | None:
        """(4, 4) m, its value with the shift; None where it is not known."""
        return None if self.T_stored is None else self.T_stored @ self.T_shift

    def record(self) -> Record | Unknown:
        """Its components, mm and deg."""
        if self.T is None:
            return Unknown(f"{self.name}[{self.number}] is stored on the controller")
        return record_of(self.T)

    def with_components(self, record: Record) -> StoredFrame | Unknown:
        """Return the frame with other components."""
        if self.T_stored is None:
            return Unknown(f"{self.name}[{self.number}] is stored on the controller")
        return replace(self, T_shift=pose.inverse(self.T_stored) @ matrix_of(record))


def matrix_of(record: Mapping[str, Value]) -> Float:
    """(4, 4) m of a frame in mm and deg; components that are not written are 0. ``R = Rz(A) Ry(B) Rx(C)``."""
    values = [float(record.get(letter, 0.0)) for letter in LETTERS]  # type: ignore[arg-type]
    return pose.make(rotation.from_zyx(np.array(values[3:]) * DEG), np.array(values[:3]) * MM)


def record_of(T: Float) -> Record:
    """Components of a frame, mm and deg."""
    values = [*(T[:3, 3] / MM), *(rotation.to_zyx(T[:3, :3]) / DEG)]
    return {letter: float(value) for letter, value in zip(LETTERS, values, strict=True)}


def is_frame(value: Value) -> bool:
    """Return whether a value is a record of a position, with components of LETTERS and numbers."""
    return isinstance(value, Mapping) and bool(value) and all(is_number(part) for part in value.values()) and any(
        letter in value for letter in LETTERS
    )  # fmt: skip


def is_axes(value: Value) -> bool:
    """Return whether a value is a record of axis angles."""
    return isinstance(value, Mapping) and any(name in value for name in AXES)


def assigned_number(kind: str, value: Value) -> Value:
    """Return a value as a variable of a type holds it: INT rounds (``C=10.0/4.0`` gives 3)."""
    if kind == "INT" and isinstance(value, float) and math.isfinite(value):
        return math.floor(abs(value) + 0.5) * (1 if value >= 0 else -1)
    if kind == "REAL" and is_number(value):
        return float(value)  # type: ignore[arg-type]
    return value


# ---- operators -----------------------------------------------------------------------------------------------


def _composed(left: Value, right: Value) -> Value:
    """``left : right``, right in left; the result has status, turn and external axes of the right operand."""
    behind = right.record() if isinstance(right, StoredFrame) else right
    if isinstance(behind, Unknown):
        return behind
    if not is_frame(behind) or not isinstance(behind, Mapping):
        raise ExpressionError("the right operand of ':' is no frame")
    T_right = matrix_of(behind)
    if isinstance(left, StoredFrame):
        return replace(left, T_shift=left.T_shift @ T_right)
    if not is_frame(left):
        raise ExpressionError("the left operand of ':' is no frame")
    rest = {key: value for key, value in behind.items() if key not in LETTERS}
    return record_of(matrix_of(left) @ T_right) | rest  # type: ignore[arg-type]


def _divided(left: Value, right: Value) -> Value:
    if isinstance(left, int) and isinstance(right, int):
        return int(left / right)  # toward zero
    return _real(left) / _real(right)


def _real(value: Value) -> float:
    if not is_number(value):
        raise TypeError(value)
    return value  # type: ignore[return-value]


def _truth(value: Value) -> bool:
    if not isinstance(value, bool):
        raise TypeError(value)
    return value


def _same(left: Value, right: Value) -> bool:
    return left == right


GRAMMAR: Final = Grammar(
    binary={
        ":": (8, _composed),
        "*": (6, lambda a, b: _real(a) * _real(b)), "/": (6, _divided),
        "+": (5, lambda a, b: _real(a) + _real(b)), "-": (5, lambda a, b: _real(a) - _real(b)),
        "AND": (4, lambda a, b: _truth(a) and _truth(b)), "B_AND": (4, lambda a, b: int(a) & int(b)),
        "EXOR": (3, lambda a, b: _truth(a) != _truth(b)), "B_EXOR": (3, lambda a, b: int(a) ^ int(b)),
        "OR": (2, lambda a, b: _truth(a) or _truth(b)), "B_OR": (2, lambda a, b: int(a) | int(b)),
        "==": (1, _same), "<>": (1, lambda a, b: not _same(a, b)),
        "<=": (1, lambda a, b: _real(a) <= _real(b)), ">=": (1, lambda a, b: _real(a) >= _real(b)),
        "<": (1, lambda a, b: _real(a) < _real(b)), ">": (1, lambda a, b: _real(a) > _real(b)),
    },
    unary={
        "-": (7, lambda a: -_real(a)), "+": (7, _real), "NOT": (7, lambda a: not _truth(a)),
        "B_NOT": (7, lambda a: ~int(a)),
    },
    constants={
        "TRUE": True, "FALSE": False, "$NULLFRAME": dict.fromkeys(LETTERS, 0.0), "$WORLD": dict.fromkeys(LETTERS, 0.0),
        "WORLD": dict.fromkeys(LETTERS, 0.0), "NULLFRAME": dict.fromkeys(LETTERS, 0.0),
    },
    name=r"[A-Za-z_$]\w*",
    number=_NUMERAL,
    aggregate="{}",
    labelled=True,
    enumeration=r"#\s*\w+",
    numeral=lambda text: numeral(text),
)  # fmt: skip
"""Priority as in the manual: comparisons bind least, also less than AND and OR."""


def numeral(text: str) -> int | float:
    """Value of a number: decimal, ``'B101'`` or ``'H1F'``."""
    if text.startswith("'"):
        digits = text.strip("'").strip()
        base = {"B": 2, "H": 16}.get(digits[0].upper(), 10)
        return int(digits[1:] if base != 10 else digits, base)
    return int(text) if text.isdigit() and len(text) <= _LONGEST_INTEGER else float(text)


def tree(text: str) -> Node:
    """Parse a text that is one expression. Raises ExpressionError: it is none."""
    try:
        return parse_whole(text, GRAMMAR)
    except RecursionError:
        raise ExpressionError("brackets within each other are too deep") from None


# ---- functions -----------------------------------------------------------------------------------------------


def _inverse(value: Value) -> Value:
    if isinstance(value, StoredFrame):
        value = value.record()
    if isinstance(value, Unknown):
        return value
    if not is_frame(value):
        raise TypeError(value)
    return record_of(pose.inverse(matrix_of(value)))  # type: ignore[arg-type]


FUNCTIONS: Final[dict[str, Callable[..., Value]]] = {
    "ABS": lambda x: abs(_real(x)),
    "SQRT": lambda x: math.sqrt(_real(x)),
    "SIN": lambda x: math.sin(_real(x) * DEG),
    "COS": lambda x: math.cos(_real(x) * DEG),
    "TAN": lambda x: math.tan(_real(x) * DEG),
    "ACOS": lambda x: math.acos(_real(x)) / DEG,
    "ATAN2": lambda y, x: (math.atan2(_real(y), _real(x)) / DEG) % 360.0,
    "INV_POS": _inverse,
}
"""Standard functions, angles in deg; ATAN2 gives 0 to 360."""
