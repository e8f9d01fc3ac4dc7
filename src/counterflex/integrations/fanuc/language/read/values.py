"""Registers, position registers, flags and frames of a FANUC program, and the expressions over them."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, cast

from counterflex.integrations.fanuc.language.program import LETTERS, FanucPosition
from counterflex.programs.expression import ExpressionError, Grammar, Node, Value, evaluate, is_number, parse
from counterflex.programs.unknown import Unknown

CONFIG: Final = "CONFIG"
"""Component of a position: its CONFIG as written."""
_COMMENT: Final = re.compile(r":[^\[\]]*\]")
_STRING: Final = re.compile(r"'([^'\"]*)'")
_EXTERNAL: Final = ("E1", "E2", "E3")
_CONTROLLER: Final = "the program does not set it, the controller has its value"


def _numbers(*values: Value) -> None:
    if not all(is_number(value) for value in values):
        raise TypeError


def _both(operation: str, a: Value, b: Value) -> Value:
    """A sum or difference of numbers, or of positions component by component."""
    # Source: PR[a]=PR[b]+PR[c] adds X Y Z W P R each (measured in ROBOGUIDE, R-2000iC, by others).
    if isinstance(a, Mapping) and isinstance(b, Mapping):
        if "J1" in a or "J1" in b:
            raise TypeError
        sign = 1.0 if operation == "+" else -1.0
        return {**a, **{key: a[key] + sign * b[key] for key in (*LETTERS, *_EXTERNAL) if key in a and key in b}}
    if operation == "+" and isinstance(a, str) and isinstance(b, str):
        return a + b
    _numbers(a, b)
    x, y = cast("float", a), cast("float", b)
    return x + y if operation == "+" else x - y


def _whole(operation: str, a: Value, b: Value) -> Value:
    """DIV and MOD of whole numbers that are not negative; the manual does not say what they do with others."""
    _numbers(a, b)
    if not (float(a) >= 0.0 and float(b) >= 0.0 and float(a).is_integer() and float(b).is_integer()):  # type: ignore[arg-type]
        return Unknown(f"{operation} of numbers that are negative or not whole: the manual does not say its value")
    return int(a) // int(b) if operation == "DIV" else int(a) % int(b)  # type: ignore[call-overload]


def _arithmetic(a: Value, b: Value, operation: str) -> Value:
    _numbers(a, b)
    return float(a) * float(b) if operation == "*" else float(a) / float(b)  # type: ignore[arg-type]


def _equal(a: Value, b: Value) -> bool:
    if isinstance(a, bool) != isinstance(b, bool) or isinstance(a, str) != isinstance(b, str):
        raise TypeError
    return a == b


def _order(word: str, a: Value, b: Value) -> bool:
    _numbers(a, b)
    x, y = cast("float", a), cast("float", b)
    return {"<": x < y, "<=": x <= y, ">": x > y, ">=": x >= y}[word]


def _truths(a: Value, b: Value, decide: bool) -> bool:
    if not (isinstance(a, bool) and isinstance(b, bool)):
        raise TypeError
    return a or b if decide else a and b


def _not(a: Value) -> bool:
    if not isinstance(a, bool):
        raise TypeError
    return not a


def _minus(a: Value) -> Value:
    _numbers(a)
    return -a  # type: ignore[operator]


_REAL: Final[dict[str, Callable[[float], float]]] = {
    "SIN": lambda x: math.sin(math.radians(x)), "COS": lambda x: math.cos(math.radians(x)),
    "TAN": lambda x: math.tan(math.radians(x)), "ASIN": lambda x: math.degrees(math.asin(x)),
    "ACOS": lambda x: math.degrees(math.acos(x)), "ATAN": lambda x: math.degrees(math.atan(x)),
    "SQRT": math.sqrt, "EXP": math.exp, "LN": math.log, "ABS": abs, "TRUNC": math.trunc,
}  # fmt: skip
_FUNCTIONS: Final = frozenset((*_REAL, "ROUND"))


def _function(name: str, value: Value) -> Value:
    if name not in _REAL or not is_number(value):
        return Unknown(f"the value of {name} is the controller's")
    try:
        return _REAL[name](float(cast("float", value)))
    except ValueError as error:
        raise ExpressionError(f"{name} has no value here") from error


GRAMMAR: Final = Grammar(
    binary={
        "OR": (1, lambda a, b: _truths(a, b, True)), "AND": (2, lambda a, b: _truths(a, b, False)),
        "=": (3, _equal), "<>": (3, lambda a, b: not _equal(a, b)),
        "<=": (4, lambda a, b: _order("<=", a, b)), ">=": (4, lambda a, b: _order(">=", a, b)),
        "<": (4, lambda a, b: _order("<", a, b)), ">": (4, lambda a, b: _order(">", a, b)),
        "+": (5, lambda a, b: _both("+", a, b)), "-": (5, lambda a, b: _both("-", a, b)),
        "*": (6, lambda a, b: _arithmetic(a, b, "*")), "/": (6, lambda a, b: _arithmetic(a, b, "/")),
        "DIV": (6, lambda a, b: _whole("DIV", a, b)), "MOD": (6, lambda a, b: _whole("MOD", a, b)),
    },
    unary={"!": (7, _not), "-": (7, _minus), "+": (7, lambda a: a)},
    constants={"ON": True, "OFF": False, "TRUE": True, "FALSE": False},
    name=r"\$\w+(?:\[[^\]]*\])?(?:\.\$\w+(?:\[[^\]]*\])?)*|[A-Za-z_]\w*",
)  # fmt: skip


def plain_code(code: str) -> str:
    """A statement without the comments of its registers: ``R[1:speed]`` is ``R[1]``."""
    return str(_STRING.sub(r'"\1"', _COMMENT.sub("]", code)))


def position_value(position: FanucPosition) -> dict[str, Value]:
    """Components of an entry of /POS."""
    external = {f"E{number}": value for number, value in position.external.items()}
    if not position.numbers:
        return {**position.axes, **external}
    return {**position.values, **external, CONFIG: position.config}


def element_key(value: Mapping[str, Value], index: int) -> str:
    """Name of an element of a position register: 1 to 6 are X Y Z W P R, or the axes of one by axes.

    Raises:
        ExpressionError: There is no such element.
    """
    if not 1 <= index <= 9:
        raise ExpressionError(f"a position register has no element {index}")
    if "J1" in value:
        return f"J{index}"
    names: tuple[str, ...] = (*LETTERS, *_EXTERNAL)
    return names[index - 1]


@dataclass
class TpValues:
    """Values of the registers."""

    where: str = ""  # ``file:line`` of the statement that runs
    # By their kind and number: R, PR, SR, F, M, P
    registers: dict[tuple[str, int], Value] = field(default_factory=dict)
    arguments: Sequence[Value] = ()  # AR of the program that runs
    # UFRAME and UTOOL by kind and number, as positions
    frames: dict[tuple[str, int], Value] = field(default_factory=dict)
    # Where the robot stands in the active frames, or why that is not known
    here: Value = field(default_factory=lambda: Unknown("the robot has not moved yet"))
    positions: Mapping[int, FanucPosition] = field(default_factory=dict)  # /POS of the program that runs
    version: int = 0  # Number of changes so far

    # ---- read ----------------------------------------------------------------------------------------------

    def evaluate(self, text: str) -> Value:
        """Return the value of an expression. Raises ExpressionError: it is none."""
        node, end = parse(text, GRAMMAR)
        if text[end:].strip():
            raise ExpressionError(f"{text[end:].strip()[:20]} is not understood", end)
        return self.of(node)

    def of(self, node: Node) -> Value:
        """Return the value of a parsed expression."""
        return evaluate(node, GRAMMAR, self)

    def value_of(self, name: str, path: Sequence[object]) -> Value:
        """Return the value of a register, position or input."""
        word = name.upper()
        if word in ("LPOS", "JPOS") and not path:
            return self.here if word == "LPOS" else Unknown("the axes of the robot (JPOS)", self.where)
        if name.startswith("$") or not path:
            return Unknown(f"{name} is the controller's", self.where)
        indices = path[0]
        if len(path) > 1 or not isinstance(indices, tuple):
            raise ExpressionError(f"{name} is not understood")
        unknown = next((index for index in indices if isinstance(index, Unknown)), None)
        if unknown is not None:
            return unknown
        if not all(is_number(index) for index in indices):
            if word in _FUNCTIONS:
                raise ExpressionError(f"{name} has no such argument")
            return Unknown(f"{name}[...] is the controller's", self.where)
        if word in _FUNCTIONS:
            return _function(word, indices[0])
        return self._register(word, list(map(int, indices)))

    def call(self, name: str, arguments: Sequence[Value], options: Mapping[str, Value]) -> Value:
        """Return the value of a function."""
        if name.upper() in _FUNCTIONS and len(arguments) == 1 and not options:
            return arguments[0] if isinstance(arguments[0], Unknown) else _function(name.upper(), arguments[0])
        return Unknown(f"the value of {name} is the controller's", self.where)

    def _register(self, word: str, indices: Sequence[int]) -> Value:
        number = indices[0]
        if word == "AR":
            if 0 < number <= len(self.arguments):
                return self.arguments[number - 1]
            return Unknown(f"AR[{number}]: the program is not called with so many arguments", self.where)
        if word in ("UFRAME", "UTOOL"):
            return self.frames.get((word, number), Unknown(f"{word}[{number}]: {_CONTROLLER}"))
        value = self.registers.get((word, number))
        if value is None and word == "P" and number in self.positions:
            value = position_value(self.positions[number])
        if value is None and word in _REGISTERS:
            return Unknown(f"{word}[{number}]: {_CONTROLLER}")
        if value is None:
            return Unknown(f"{word}[{number}] is a signal", self.where)
        if len(indices) == 2 and isinstance(value, Mapping):
            key = element_key(value, indices[1])
            return value.get(key, Unknown(f"{word}[{number},{indices[1]}]: {_CONTROLLER}"))
        return value

    # ---- assign --------------------------------------------------------------------------------------------

    def assign(self, word: str, indices: Sequence[Value], value: Value) -> None:
        """Set a register.

        Args:
            word: R, PR, P, SR, F, M, UFRAME, UTOOL; others are outputs, which are not kept.
            indices: One, or two of an element.
            value: What it is set to.
        """
        word = word.upper()
        if any(not is_number(index) for index in indices):
            why = next((index for index in indices if isinstance(index, Unknown)), None)
            cause = "" if why is None else f" ({why})"
            self._forget(word, Unknown(f"a register whose number is not known is set{cause}", self.where))
            return
        number = int(indices[0])  # type: ignore[call-overload]
        value = Unknown(value.why, value.where or self.where) if isinstance(value, Unknown) else value
        target = self.frames if word in ("UFRAME", "UTOOL") else self.registers
        if len(indices) == 2:
            value = self._with_element(word, number, int(indices[1]), value)  # type: ignore[call-overload]
        if target.get((word, number)) != value:
            self.version += 1
            target[(word, number)] = value

    def _with_element(self, word: str, number: int, index: int, value: Value) -> Value:
        old = self._register(word, [number])
        if isinstance(old, Unknown):
            old = dict.fromkeys(LETTERS, old)
        if not isinstance(old, Mapping):
            raise ExpressionError(f"{word}[{number}] is no position")
        return {**old, element_key(old, index): value}

    def _forget(self, word: str, why: Unknown) -> None:
        """All registers of a kind become unknown."""
        self.version += 1
        self.registers = {key: why if key[0] == word else value for key, value in self.registers.items()}

    def forget_all(self, why: Unknown) -> None:
        """All registers become unknown."""
        for word in _REGISTERS:
            self._forget(word, why)


_REGISTERS: Final = ("R", "PR", "SR", "F", "M")
