"""Expressions of Sinumerik: R parameters, variables of the program, arithmetic and functions.

Source: SINUMERIK 840D sl, Programming Manual Job Planning, "Arithmetic functions", "Comparison and logic operations",
"Priority of the operations".
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Final

from counterflex.core.units import DEG
from counterflex.programs.expression import Grammar, evaluate, parse
from counterflex.programs.unknown import Unknown, first_unknown

_EQUAL: Final = 1e-12
_ORDINARY_RUN: Final = ("$P_SEARCH", "$P_SEARCHL", "$P_SIM", "$P_DRYRUN", "$P_ISTEST")
"""System variables that are 0 in an ordinary run: no block search, simulation, dry run or program test."""


def number(value: object) -> float:
    """Return a value as a number; truth values are 0 and 1. Raises TypeError: it is a string or a frame."""
    if isinstance(value, int | float):
        return float(value)
    raise TypeError("no number")


def _of_numbers(operation: Callable[..., object]) -> Callable[..., object]:
    return lambda *values: operation(*map(number, values))


def _same(a: object, b: object) -> bool:
    if isinstance(a, str) and isinstance(b, str):
        return a == b
    return math.isclose(number(a), number(b), rel_tol=_EQUAL, abs_tol=_EQUAL)


def _bits(operation: Callable[[int, int], int]) -> Callable[..., object]:
    return lambda a, b: float(operation(int(number(a)), int(number(b))))


GRAMMAR: Final = Grammar(
    binary={
        "*": (10, _of_numbers(lambda a, b: a * b)),
        "/": (10, _of_numbers(lambda a, b: a / b)),
        "DIV": (10, _of_numbers(lambda a, b: float(math.trunc(a / b)))),
        "MOD": (10, _of_numbers(math.fmod)),
        "+": (9, _of_numbers(lambda a, b: a + b)),
        "-": (9, _of_numbers(lambda a, b: a - b)),
        "B_AND": (8, _bits(lambda a, b: a & b)),
        "B_XOR": (7, _bits(lambda a, b: a ^ b)),
        "B_OR": (6, _bits(lambda a, b: a | b)),
        "AND": (5, _of_numbers(lambda a, b: bool(a) and bool(b))),
        "XOR": (4, _of_numbers(lambda a, b: bool(a) != bool(b))),
        "OR": (3, _of_numbers(lambda a, b: bool(a) or bool(b))),
        "<<": (2, lambda a, b: f"{_text(a)}{_text(b)}"),
        "==": (1, _same),
        "<>": (1, lambda a, b: not _same(a, b)),
        ">=": (1, _of_numbers(lambda a, b: a >= b)),
        "<=": (1, _of_numbers(lambda a, b: a <= b)),
        ">": (1, _of_numbers(lambda a, b: a > b)),
        "<": (1, _of_numbers(lambda a, b: a < b)),
    },
    unary={
        "-": (11, _of_numbers(lambda a: -a)),
        "+": (11, _of_numbers(lambda a: a)),
        "NOT": (11, _of_numbers(lambda a: not a)),
    },
    constants={"TRUE": True, "FALSE": False, "$PI": math.pi} | dict.fromkeys(_ORDINARY_RUN, 0.0),
    name=r"\$?[A-Za-z_]\w*",
    number=r"(?:\d+\.?\d*|\.\d+)",
)


def _text(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


_FUNCTIONS: Final[Mapping[str, Callable[..., float]]] = {
    "SIN": lambda a: math.sin(a * DEG),
    "COS": lambda a: math.cos(a * DEG),
    "TAN": lambda a: math.tan(a * DEG),
    "ASIN": lambda a: math.asin(a) / DEG,
    "ACOS": lambda a: math.acos(a) / DEG,
    "ATAN2": lambda y, x: math.atan2(y, x) / DEG,
    "SQRT": math.sqrt,
    "ABS": abs,
    "POT": lambda a: a * a,
    "TRUNC": lambda a: float(math.trunc(a)),
    "ROUND": lambda a: math.floor(a + 0.5),
    "ROUNDUP": math.ceil,
    "LN": math.log,
    "EXP": math.exp,
    "MINVAL": min,
    "MAXVAL": max,
    "BOUND": lambda least, most, a: min(max(a, least), most),
}


_CONVERSIONS: Final[Mapping[str, Callable[[float], object]]] = {
    "INT": lambda a: float(math.floor(a + 0.5)),
    "CHAR": lambda a: float(math.floor(a + 0.5)),
    "BOOL": bool,
}
"""What a number becomes in a variable of a type (Job Planning, "Type conversion": from 0.5 upwards, INT rounds up)."""


class ArrayCells(dict[tuple[int, ...], object]):
    """Values of a variable by index; ``()`` is that of every element without one of its own.

    Args:
        kind: Type in capitals: REAL, INT, BOOL, CHAR, STRING, AXIS or FRAME.
        value: Initial value; a tuple (SET) gives the first elements of an array their values.
    """

    def __init__(self, kind: str, value: object) -> None:
        super().__init__()
        self.kind = kind
        if isinstance(value, tuple):
            for index, item in enumerate(value):
                self.put((index,), item)
            return
        self.put((), value)

    def put(self, key: tuple[int, ...], value: object) -> None:
        """Set an element to a value, converted to the type of the variable."""
        convert = _CONVERSIONS.get(self.kind)
        self[key] = convert(float(value)) if convert is not None and isinstance(value, int | float) else value


class Variables:
    """R parameters and variables of the programs that run."""

    def __init__(self) -> None:
        self.where = ""  # ``file:line`` of the statement that is executed
        self._shared: dict[tuple[str, tuple[int, ...]], object] = {}
        # Variables of the main program and of each subprogram that runs, innermost last, by name in capitals
        self.levels: list[dict[str, ArrayCells]] = [{}]

    def defines(self, name: str) -> bool:
        """Return whether DEF or PROC of the running program declares a variable."""
        return name.upper() in self.levels[-1]

    def define(self, name: str, kind: str, value: object) -> None:
        """Declare a variable of the running program; ``kind`` is its type in capitals."""
        self.levels[-1][name.upper()] = ArrayCells(kind, value)

    def assign(self, name: str, index: Sequence[object], value: object) -> None:
        """Set a variable; an index that is not known makes all its elements unknown."""
        if isinstance(value, tuple) and len(index) == 1 and isinstance(index[0], int | float):
            for place, item in enumerate(value, start=round(index[0])):
                self.assign(name, (place,), item)
            return
        if isinstance(value, tuple):
            index, value = (), Unknown("SET fills elements, and which is not known", self.where)
        key = self._index(index)
        cells = self.levels[-1].get(name.upper())
        if isinstance(value, Unknown) and not index and cells is not None:
            cells.clear()
        if isinstance(key, Unknown):
            if cells is not None:
                cells.clear()
                cells[()] = key
            else:
                for shared in [item for item in self._shared if item[0] == name.upper()]:
                    self._shared[shared] = key
                self._shared[name.upper(), ()] = key
        elif cells is not None:
            cells.put(key, value)
        else:
            self._shared[self._parameter(name, key)] = value

    @staticmethod
    def _parameter(name: str, index: tuple[int, ...]) -> tuple[str, tuple[int, ...]]:
        """R7 and R[7] are the same."""
        match = re.fullmatch(r"R(\d+)", name.upper())
        return ("R", (int(match[1]),)) if match and not index else (name.upper(), index)

    @staticmethod
    def _index(index: Sequence[object]) -> tuple[int, ...] | Unknown:
        return first_unknown(list(index)) or tuple(round(number(item)) for item in index)

    def value_of(self, name: str, path: Sequence[object]) -> object:
        """Return the value of a name; unknown where nothing in the program gives it one."""
        index: list[object] = [item for step in path if isinstance(step, tuple) for item in step]
        if name.startswith("$"):
            stored = self._shared.get((name.upper(), tuple(i for i in index if isinstance(i, int))))
            return stored if stored is not None else Unknown(f"the control has it ({name})", self.where)
        key = self._index(index)
        if isinstance(key, Unknown):
            return key
        cells = self.levels[-1].get(name.upper())
        if cells is not None:
            value = cells.get(key, cells.get(()))
        else:
            value = self._shared.get(self._parameter(name, key), self._shared.get((name.upper(), ())))
        if value is None:
            return Unknown(f"nothing in the program gives {name.upper()} a value")
        return value

    def call(self, name: str, arguments: Sequence[object], options: Mapping[str, object]) -> object:  # noqa: ARG002
        """Return the value of a function."""
        if name.upper() == "SET" and arguments:
            return tuple(arguments)
        function = _FUNCTIONS.get(name.upper())
        if function is None:
            return Unknown(f"the control computes it ({name.upper()})", self.where)
        return first_unknown(list(arguments)) or float(function(*map(number, arguments)))

    def memory(self) -> object:
        """Return all values."""
        return [
            {str(key): value for key, value in self._shared.items()},
            [list(level.items()) for level in self.levels],
        ]

    def evaluate(self, text: str, start: int = 0) -> tuple[object, int]:
        """Return the value of the expression that begins at an index, and the index behind it.

        Raises:
            ExpressionError: No expression begins there, or an operator does not fit its operands.
        """
        node, end = parse(text, GRAMMAR, start)
        return evaluate(node, GRAMMAR, self), end
