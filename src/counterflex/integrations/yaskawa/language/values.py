"""Variables of INFORM and the expressions over them.

Kinds: ``B`` 0 to 255, ``I`` 16 bits, ``D`` 32 bits, ``R`` real, ``S`` text, ``P BP EX`` positions; with ``L`` before
them they belong to one job. Elements of a position are in 0.001 mm; those of its angles are in 0.01 or 0.0001 deg, by
the controller, so their numbers are not known. Source: INFORM language manual, SETE and GETE; range of the kinds there.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, cast

from counterflex.integrations.yaskawa.language.program import AXES, PULSE, Header, Position
from counterflex.programs.expression import ExpressionError, Grammar, Value, evaluate, is_number, parse_whole
from counterflex.programs.unknown import Unknown, first_unknown

VARIABLE: Final = r"L?(?:BP|EX|PX|[BIDRSP])(?:\d{1,5}|\s*\[[^\]]*\])"
_I: Final = re.IGNORECASE
_NAME: Final = re.compile(r"(L?)(BP|EX|PX|[BIDRSP])(\d*)", _I)
_RANGES: Final = {"B": (0, 255), "I": (-32768, 32767), "D": (-(2**31), 2**31 - 1)}
_PER_MM: Final = 1000
_CONTROLLER: Final = "the job does not set it, the controller has its value"
_ANGLE: Final = "the unit of an element of an angle is 0.01 or 0.0001 deg, by the controller"


def _numbers(*values: Value) -> list[float]:
    if not all(is_number(value) for value in values):
        raise TypeError
    return [cast("float", value) for value in values]


def _compared(operation: Callable[[float, float], bool]) -> Callable[[Value, Value], Value]:
    def compare(a: Value, b: Value) -> Value:
        return operation(*_numbers(a, b))

    return compare


def _arithmetic(operation: Callable[[float, float], float]) -> Callable[[Value, Value], Value]:
    def combine(a: Value, b: Value) -> Value:
        return operation(*_numbers(a, b))

    return combine


def _equal(a: Value, b: Value) -> Value:
    if type(a) is not type(b) and not (is_number(a) and is_number(b)):
        raise TypeError
    return a == b


def _divided(a: Value, b: Value) -> Value:
    x, y = _numbers(a, b)
    if isinstance(a, int) and isinstance(b, int):
        return a // b if a % b == 0 else Unknown("how the controller rounds a quotient")
    return x / y


def _truths(decide: bool) -> Callable[[Value, Value], Value]:
    def combine(a: Value, b: Value) -> Value:
        if not (isinstance(a, bool) and isinstance(b, bool)):
            raise TypeError
        return (a or b) if decide else (a and b)

    return combine


def _minus(a: Value) -> Value:
    return -_numbers(a)[0]


GRAMMAR: Final = Grammar(
    binary={
        "OR": (1, _truths(True)), "AND": (2, _truths(False)),
        "=": (3, _equal), "<>": (3, lambda a, b: not _equal(a, b)),
        "<=": (3, _compared(lambda a, b: a <= b)), ">=": (3, _compared(lambda a, b: a >= b)),
        "<": (3, _compared(lambda a, b: a < b)), ">": (3, _compared(lambda a, b: a > b)),
        "+": (5, _arithmetic(lambda a, b: a + b)), "-": (5, _arithmetic(lambda a, b: a - b)),
        "*": (6, _arithmetic(lambda a, b: a * b)), "/": (6, _divided),
    },
    unary={"-": (7, _minus)},
    constants={"ON": True, "OFF": False},
    name=r"\$?[A-Za-z_]\w*#?",
)  # fmt: skip
_FUNCTIONS: Final[Mapping[str, Callable[[float], float]]] = {
    "SIN": lambda x: math.sin(math.radians(x)), "COS": lambda x: math.cos(math.radians(x)),
    "ATAN": lambda x: math.degrees(math.atan(x)), "SQRT": math.sqrt,
}  # fmt: skip
_BITS: Final[Mapping[str, Callable[[int, int], int]]] = {
    "AND": lambda a, b: a & b, "OR": lambda a, b: a | b, "XOR": lambda a, b: a ^ b, "NOT": lambda _a, b: ~b & 255,
}  # fmt: skip


@dataclass(frozen=True)
class PositionValue:
    """Value of a position variable."""

    values: tuple[Value, ...]  # X Y Z in mm and Rx Ry Rz in deg, or six pulses
    header: Header  # What its numbers are

    @property
    def unknown(self) -> Unknown | None:
        """Return why a component is not known; None where all are."""
        return first_unknown(self.values)

    def with_element(self, index: int, value: Value) -> PositionValue:
        """Return it with another element, 0 to 5."""
        values = (*self.values[:index], value, *self.values[index + 1 :])
        return PositionValue(values, self.header)


Key = tuple[str, int]


@dataclass
class InformValues:
    """Values of variables."""

    where: str = ""  # ``file:line`` of the instruction that runs
    own: dict[Key, Value] = field(default_factory=dict)  # Variables of the job that runs (``L``)
    all: dict[Key, Value] = field(default_factory=dict)  # Those of all jobs
    version: int = 0  # Number of changes so far
    loaded: set[int] = field(default_factory=set)  # Numbers of the position variables that have the value of //POS

    # ---- read ----------------------------------------------------------------------------------------------

    def take(self, positions: Mapping[tuple[str, int], Position], name: str) -> None:
        """Take the position variables of a job: they are loaded with it."""
        for (kind, number), position in positions.items():
            if kind != "P":
                continue
            value = PositionValue(position.values[:AXES], position.header)
            before = self.all.get(("P", number))
            if isinstance(before, PositionValue) and before != value:
                self.all["P", number] = Unknown(f"P{number:03d} is in several jobs with other values", name)
            elif before is None:
                self.all["P", number] = value
                self.loaded.add(number)

    def evaluate(self, text: str) -> Value:
        """Return the value of an expression. Raises ExpressionError: it is none."""
        return evaluate(parse_whole(text, GRAMMAR), GRAMMAR, self)

    def key_of(self, text: str) -> tuple[bool, Key | Unknown]:
        """Return whether a variable belongs to its job, and its kind and number.

        Raises:
            ExpressionError: It is no variable.
        """
        match = _NAME.match(text.strip())
        rest = "" if match is None else text.strip()[match.end() :].strip()
        if match is None or (match[3] and rest) or (not match[3] and not re.fullmatch(r"\[[^\]]*\]", rest)):
            raise ExpressionError(f"{text.strip()[:20]} is no variable")
        kind = "P" if match[2].upper() == "PX" else match[2].upper()
        if match[3]:
            return bool(match[1]), (kind, int(match[3]))
        number = self.evaluate(rest[1:-1])
        if isinstance(number, Unknown):
            return bool(match[1]), number
        if not isinstance(number, int) or isinstance(number, bool):
            raise ExpressionError("the number of a variable is not whole")
        return bool(match[1]), (kind, number)

    def get(self, text: str) -> Value:
        """Return the value of a variable. Raises ExpressionError: it is none."""
        own, key = self.key_of(text)
        if isinstance(key, Unknown):
            return key
        name = f"{'L' if own else ''}{key[0]}{key[1]:03d}"
        return (self.own if own else self.all).get(key, Unknown(f"{name}: {_CONTROLLER}"))

    def is_loaded(self, text: str) -> bool:
        """Return whether a variable has the value of //POS, which other jobs may change."""
        own, key = self.key_of(text)
        return not own and not isinstance(key, Unknown) and key[0] == "P" and key[1] in self.loaded

    def value_of(self, name: str, path: Sequence[object]) -> Value:
        """Return the value of a name in an expression."""
        indices = "" if not path else f"[{', '.join(map(str, cast('tuple[object, ...]', path[0])))}]"
        if _NAME.match(name) is None or name.startswith("$") or not re.fullmatch(VARIABLE, name + indices, _I):
            return Unknown(f"{name} is the controller's", self.where)
        return self.get(name + indices)

    def call(self, name: str, arguments: Sequence[Value], options: Mapping[str, Value]) -> Value:
        """Return the value of a signal, register or function: the controller's."""
        del arguments, options
        return Unknown(f"{name}() is the controller's", self.where)

    # ---- assign --------------------------------------------------------------------------------------------

    def assign(self, text: str, value: Value) -> None:
        """Set a variable. Raises ExpressionError: it is none, or the value is out of its range."""
        own, key = self.key_of(text)
        target = self.own if own else self.all
        if isinstance(key, Unknown):
            kind = _NAME.match(text.strip())[2].upper()  # type: ignore[index]
            for other in [one for one in target if one[0] == kind]:
                target[other] = Unknown(f"a variable whose number is not known is set ({key.why})", self.where)
            self.version += 1
            return
        if key[0] == "P" and not own:
            self.loaded.discard(key[1])
        value = self._fitting(key[0], value)
        if isinstance(value, Unknown) and not value.where:
            value = Unknown(value.why, self.where)
        if key not in target or target[key] != value:
            target[key] = value
            self.version += 1

    @staticmethod
    def _fitting(kind: str, value: Value) -> Value:
        if isinstance(value, Unknown):
            return value
        if kind in ("P", "BP", "EX"):
            if not isinstance(value, PositionValue):
                raise ExpressionError("this is no position")
            return value
        if kind == "S":
            return value if isinstance(value, str) else Unknown("text of a number")
        number = float(int(value)) if isinstance(value, bool) else _numbers(value)[0]
        if kind == "R":
            return float(number)
        low, high = _RANGES[kind]
        if not low <= number <= high:
            raise ExpressionError(f"{number:g} is beyond {kind} variables, {low} to {high}: the controller stops")
        if not float(number).is_integer():
            return Unknown("how the controller rounds a number")
        return int(number)

    def forget_all(self, why: Unknown) -> None:
        """Make all variables unknown."""
        self.version += 1
        self.all = dict.fromkeys(self.all, why)
        self.own = dict.fromkeys(self.own, why)

    # ---- instructions --------------------------------------------------------------------------------------

    def operate(self, word: str, target: str, operands: Sequence[str], element: str) -> None:
        """Execute ADD, SUB, MUL, DIV, SET, INC, DEC, CLEAR, functions and bits.

        Args:
            operands: Texts behind it.
            element: Number of the element of a position that the target names; empty where it names none.

        Raises:
            ExpressionError: It does not fit.
        """
        if word in ("INC", "DEC"):
            operands = ["1"]
        if word == "CLEAR":
            self._clear(target, operands[0] if operands else "1")
            return
        if len(operands) != 1:
            raise ExpressionError(f"{word} takes a variable and a value")
        value = self._operand(operands[0])
        old = self.get(target)
        if element:
            self.assign(target, self._element_changed(word, old, element, value))
        elif word == "SET":
            self.assign(target, value)
        elif word in _FUNCTIONS or word in _BITS:
            self.assign(target, self._function(word, old, value))
        else:
            operator = {"ADD": "+", "INC": "+", "SUB": "-", "DEC": "-", "MUL": "*", "DIV": "/"}[word]
            self.assign(target, self._combined(operator, old, value))

    def _operand(self, text: str) -> Value:
        match = re.fullmatch(VARIABLE, text.strip(), re.IGNORECASE)
        return self.get(text) if match is not None else self.evaluate(text)

    def _clear(self, target: str, count: str) -> None:
        own, key = self.key_of(target)
        if isinstance(key, Unknown) or not count.isdecimal() or key[0] not in "BIDR":
            self.forget_all(Unknown("CLEAR sets variables that are not known", self.where))
            return
        for number in range(key[1], key[1] + min(int(count), 1000)):
            self.assign(f"{'L' if own else ''}{key[0]}{number}", 0)

    def _function(self, word: str, old: Value, value: Value) -> Value:
        unknown = first_unknown([value] if word in _FUNCTIONS or word == "NOT" else [old, value])
        if unknown is not None:
            return unknown
        if word in _FUNCTIONS:
            return _FUNCTIONS[word](_numbers(value)[0])
        if not isinstance(value, int) or (word != "NOT" and not isinstance(old, int)):
            raise ExpressionError(f"{word} takes whole numbers")
        return _BITS[word](old if isinstance(old, int) else 0, value)

    @staticmethod
    def _combined(operator: str, a: Value, b: Value) -> Value:
        unknown = first_unknown([a, b])
        if unknown is not None:
            return unknown
        if isinstance(a, PositionValue) and isinstance(b, PositionValue):
            return _added(a, b, operator)
        try:
            result: Value = GRAMMAR.binary[operator][1](a, b)
        except ZeroDivisionError:
            raise ExpressionError("a division by zero") from None
        except (TypeError, ValueError, OverflowError) as error:
            raise ExpressionError(f"{operator} does not fit what it stands between") from error
        return result

    def _element_changed(self, word: str, old: Value, element: str, value: Value) -> Value:
        """A position with one element set, or multiplied."""
        index = self.evaluate(element)
        if not isinstance(index, int) or not 1 <= index <= AXES:
            return Unknown("an element of a position whose number is not known is set")
        if isinstance(old, Unknown):
            old = PositionValue((old,) * AXES, Header())
        if not isinstance(old, PositionValue):
            raise ExpressionError("this is no position")
        if word in ("SETE", "SET"):
            return old.with_element(index - 1, self._element_value(old, index, value))
        if word not in ("MUL", "DIV"):
            return Unknown(f"{word} of an element")
        return old.with_element(index - 1, self._combined("*" if word == "MUL" else "/", old.values[index - 1], value))

    @staticmethod
    def _element_value(position: PositionValue, index: int, value: Value) -> Value:
        if isinstance(value, Unknown):
            return value
        number = _numbers(value)[0]
        if position.header.postype == PULSE or number == 0.0:
            return float(number)
        return number / _PER_MM if index <= 3 else Unknown(_ANGLE)

    def element(self, text: str, element: str) -> Value:
        """Return an element of a position variable, as GETE does: in 0.001 mm, or pulses.

        Raises:
            ExpressionError: It is no element.
        """
        position, index = self.get(text), self.evaluate(element)
        if isinstance(position, Unknown):
            return position
        if not isinstance(position, PositionValue) or not isinstance(index, int) or not 1 <= index <= AXES:
            raise ExpressionError(f"{text.strip()} has no element {element.strip()}")
        value = position.values[index - 1]
        if isinstance(value, Unknown) or position.header.postype == PULSE or value == 0.0:
            return value
        return round(_numbers(value)[0] * _PER_MM) if index <= 3 else Unknown(_ANGLE)


def _added(a: PositionValue, b: PositionValue, operator: str) -> Value:
    """Sum or difference of positions, element by element; of angles only where the second has none."""
    if operator not in "+-" or (a.header.postype == PULSE) != (b.header.postype == PULSE):
        return Unknown("the sum of positions of several types")
    unknown = a.unknown or b.unknown
    if unknown is not None:
        return unknown
    sign = 1.0 if operator == "+" else -1.0
    if a.header.postype != PULSE and any(value != 0.0 for value in b.values[3:]):
        return Unknown("the sum of angles of positions")
    pairs = zip(a.values, b.values, strict=True)
    return PositionValue(tuple(cast("float", x) + sign * cast("float", y) for x, y in pairs), a.header)
