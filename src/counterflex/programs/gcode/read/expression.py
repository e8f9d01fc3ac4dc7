"""Values of RS274/NGC: numbers, parameters and bracketed expressions, parsed once and evaluated at each execution.

Precedence, from tight to loose: ``**``; ``* / MOD``; ``+ -``; ``EQ NE GT GE LT LE``; ``AND OR XOR``; all of them
left-associative. Angles of functions are in degrees. Source: LinuxCNC, G-code overview, "Expressions"; Haas, Mill
Operator's Manual, "Macros", and FANUC Series 30i, Operator's Manual, "Arithmetic and logic operation", for theirs.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Protocol

from counterflex.core.errors import ProgramError
from counterflex.core.units import DEG

# Comparisons count two numbers as equal within this, as LinuxCNC does.
EQUAL_TOLERANCE: Final = 1e-4
_DEEPEST: Final = 60


class ParameterSource(Protocol):
    """Source of parameters in expressions."""

    @property
    def of_fanuc(self) -> bool:
        """Return whether Fanuc or Haas calculates: FIX and FUP go by size, AND, OR and XOR work on bits."""

    def numbered(self, index: float, column: int) -> float:
        """Value of ``#index``."""

    def named(self, name: str, column: int) -> float:
        """Value of ``#<name>``."""

    def exists(self, name: str) -> bool:
        """Return whether ``#<name>`` has a value."""

    def vacant(self, index: float, column: int) -> bool:
        """Return whether ``#index`` has no value."""

    def fault(self, what: str, column: int, value: object = None, hint: str | None = None) -> ProgramError:
        """Make an error at a column (0-based) of the line being executed."""


class Expression(Protocol):
    """A parsed value."""

    def evaluate(self, source: ParameterSource) -> float:
        """Return the value now."""


@dataclass(frozen=True)
class Number:
    """A literal."""

    value: float

    def evaluate(self, source: ParameterSource) -> float:  # noqa: ARG002
        """Return the literal."""
        return self.value


@dataclass(frozen=True)
class NumberedParameter:
    """``#5``, ``##2`` or ``#[...]``."""

    index: Expression
    column: int

    def evaluate(self, source: ParameterSource) -> float:
        """Return the parameter's value."""
        return source.numbered(self.index.evaluate(source), self.column)


@dataclass(frozen=True)
class NamedParameter:
    """``#<name>``; global where the name starts with an underscore."""

    name: str
    column: int

    def evaluate(self, source: ParameterSource) -> float:
        """Return the parameter's value."""
        return source.named(self.name, self.column)


@dataclass(frozen=True)
class Exists:
    """``EXISTS[#<name>]``."""

    name: str

    def evaluate(self, source: ParameterSource) -> float:
        """Return 1 or 0."""
        return 1.0 if source.exists(self.name) else 0.0


@dataclass(frozen=True)
class Negative:
    """Minus before a parameter, a function or a bracket."""

    operand: Expression

    def evaluate(self, source: ParameterSource) -> float:
        """Return the operand's value with the other sign."""
        return -self.operand.evaluate(source)


@dataclass(frozen=True)
class FunctionCall:
    """A function of one bracket, ``SIN[...]``."""

    name: str
    argument: Expression
    column: int

    def evaluate(self, source: ParameterSource) -> float:
        """Return the function's value."""
        value = self.argument.evaluate(source)
        if value < 0.0 and source.of_fanuc and self.name in ("fix", "fup"):
            return -_FUNCTIONS[self.name](-value)
        try:
            return _FUNCTIONS[self.name](value)
        except (ValueError, OverflowError) as fault:
            what = f"{self.name.upper()} has no value for this argument"
            raise source.fault(what, self.column, f"{value:g}") from fault


@dataclass(frozen=True)
class Arctangent:
    """``ATAN[y]/[x]``."""

    y: Expression
    x: Expression

    def evaluate(self, source: ParameterSource) -> float:
        """Return the angle in degrees, -180 to 180."""
        return math.atan2(self.y.evaluate(source), self.x.evaluate(source)) / DEG


@dataclass(frozen=True)
class BinaryOperation:
    """Two values and the operator between them."""

    operator: str
    left: Expression
    right: Expression
    column: int

    def evaluate(self, source: ParameterSource) -> float:
        """Return the result."""
        for one, other in ((self.left, self.right), (self.right, self.left)):
            if self.operator in ("eq", "ne") and _is_null(one) and isinstance(other, NumberedParameter):
                vacant = source.vacant(other.index.evaluate(source), other.column)
                return float(vacant == (self.operator == "eq"))
        left, right = self.left.evaluate(source), self.right.evaluate(source)
        if self.operator in ("and", "or", "xor") and source.of_fanuc and not {left, right} <= {0.0, 1.0}:
            what = "Fanuc and Haas combine the bits of these numbers, LinuxCNC asks whether they are 0"
            hint = "Compare each number: [#1 NE 0] AND [#2 NE 0]"
            raise source.fault(what, self.column, f"{left:g} {self.operator.upper()} {right:g}", hint)
        try:
            value = _OPERATORS[self.operator](left, right)
        except ZeroDivisionError as fault:
            raise source.fault("division by zero", self.column, f"{left:g} {self.operator} {right:g}") from fault
        except (ValueError, OverflowError) as fault:
            what = f"{self.operator.upper()} has no value for these numbers"
            raise source.fault(what, self.column, f"{left:g} and {right:g}") from fault
        if not math.isfinite(value):
            raise source.fault("the result is not a finite number", self.column, f"{left:g} {self.operator} {right:g}")
        return value


def _is_null(expression: Expression) -> bool:
    """Return whether it is ``#0``, which has no value on Fanuc's controls."""
    return isinstance(expression, NumberedParameter) and expression.index == Number(0.0)


def _power(left: float, right: float) -> float:
    if left < 0.0 and right != math.floor(right):
        raise ValueError("negative base with a fractional exponent")
    return math.pow(left, right)


def _modulo(left: float, right: float) -> float:
    if right == 0.0:
        raise ZeroDivisionError
    rest = math.fmod(left, right)
    return rest + abs(right) if rest < 0.0 else rest


def _logic(test: Callable[[bool, bool], bool]) -> Callable[[float, float], float]:
    return lambda left, right: 1.0 if test(left != 0.0, right != 0.0) else 0.0


def _compare(test: Callable[[float, float], bool]) -> Callable[[float, float], float]:
    return lambda left, right: 1.0 if test(left, right) else 0.0


_OPERATORS: Final[dict[str, Callable[[float, float], float]]] = {
    "**": _power,
    "*": lambda left, right: left * right,
    "/": lambda left, right: left / right,
    "mod": _modulo,
    "+": lambda left, right: left + right,
    "-": lambda left, right: left - right,
    "eq": _compare(lambda left, right: abs(left - right) < EQUAL_TOLERANCE),
    "ne": _compare(lambda left, right: abs(left - right) >= EQUAL_TOLERANCE),
    "gt": _compare(lambda left, right: left > right),
    "ge": _compare(lambda left, right: left >= right),
    "lt": _compare(lambda left, right: left < right),
    "le": _compare(lambda left, right: left <= right),
    "and": _logic(lambda left, right: left and right),
    "or": _logic(lambda left, right: left or right),
    "xor": _logic(lambda left, right: left != right),
}
_PRECEDENCE: Final = {
    "**": 5, "*": 4, "/": 4, "mod": 4, "+": 3, "-": 3,
    "eq": 2, "ne": 2, "gt": 2, "ge": 2, "lt": 2, "le": 2, "and": 1, "or": 1, "xor": 1,
}  # fmt: skip
_FUNCTIONS: Final[dict[str, Callable[[float], float]]] = {
    "abs": abs,
    "acos": lambda value: math.acos(value) / DEG,
    "asin": lambda value: math.asin(value) / DEG,
    "cos": lambda value: math.cos(value * DEG),
    "exp": math.exp,
    "fix": lambda value: float(math.floor(value)),
    "fup": lambda value: float(math.ceil(value)),
    "ln": math.log,
    "round": lambda value: float(math.trunc(value + math.copysign(0.5, value))),
    "sin": lambda value: math.sin(value * DEG),
    "sqrt": math.sqrt,
    "tan": lambda value: math.tan(value * DEG),
}


class Cursor:
    """A line without blanks and comments, in lower case, read from left to right.

    Args:
        text: The line in lower case without blanks and comments.
        columns: 0-based column in the source line of each character, and one more for the end.
        fault: Makes an error from what, column, value and hint.
    """

    __slots__ = ("_depth", "columns", "fault", "place", "text")

    def __init__(
        self, text: str, columns: list[int], fault: Callable[[str, int, object, str | None], ProgramError]
    ) -> None:
        self.text = text
        self.columns = columns
        self.place = 0
        self.fault = fault
        self._depth = 0

    @property
    def column(self) -> int:
        """Column of the next character in the source line, 0-based."""
        return self.columns[self.place]

    def peek(self, length: int = 1) -> str:
        """Return the next characters without taking them; shorter or empty at the end."""
        return self.text[self.place : self.place + length]

    def take(self, expected: str) -> bool:
        """Take ``expected`` if it comes next."""
        if self.text.startswith(expected, self.place):
            self.place += len(expected)
            return True
        return False

    def error(self, what: str, value: object = None, hint: str | None = None) -> ProgramError:
        """Make an error at the next character."""
        return self.fault(what, self.column, value, hint)

    def value(self) -> Expression:
        """Read a value: a number, a parameter, a function or a bracket, with a sign or none.

        Raises:
            ProgramError: What comes next is no value.
        """
        self._depth += 1
        if self._depth > _DEEPEST:
            raise self.error("brackets, signs and functions are nested too deeply", f"more than {_DEEPEST} levels")
        try:
            return self._value()
        finally:
            self._depth -= 1

    def _value(self) -> Expression:
        character = self.peek()
        if character == "[":
            return self._bracket()
        if character == "#":
            return self.parameter()
        follower = self.text[self.place + 1 : self.place + 2]
        if character in ("+", "-") and follower and follower not in "0123456789.":
            self.place += 1
            operand = self.value()
            return Negative(operand) if character == "-" else operand
        if "a" <= character <= "z":
            return self._function()
        return self._number()

    def _number(self) -> Number:
        start = self.place
        text = self.text
        end = start + (text[start : start + 1] in ("+", "-"))
        points = digits = 0
        while end < len(text) and text[end] in "0123456789.":
            if text[end] == ".":
                points += 1
                if points > 1:
                    break
            else:
                digits += 1
            end += 1
        if digits == 0 or points > 1:
            result = repr(text[start : max(end, start + 8)]) if text[start:] else "nothing"
            raise self.error("a number is expected", result)
        self.place = end
        number = float(text[start:end])
        if not math.isfinite(number):
            self.place = start
            raise self.error("the number is too large", text[start : start + 20] + "...")
        return Number(number)

    def parameter(self) -> NumberedParameter | NamedParameter:
        """Read ``#...``; the cursor stands on the ``#``."""
        column = self.column
        self.place += 1
        if self.peek() == "<":
            return NamedParameter(self.name(), column)
        return NumberedParameter(self.value(), column)

    def name(self) -> str:
        """Read ``<name>``; the cursor stands on the ``<``."""
        end = self.text.find(">", self.place)
        if end < 0:
            raise self.error("the name has no closing >", repr(self.text[self.place : self.place + 20]))
        name = self.text[self.place + 1 : end]
        if not name:
            raise self.error("the name is empty", "<>")
        self.place = end + 1
        return name

    def _function(self) -> Expression:
        column = self.column
        for name in ("atan", "exists", *_FUNCTIONS):
            if self.text.startswith(name + "[", self.place):
                self.place += len(name)
                break
        else:
            raise self.error(
                "an unknown function or a missing number", repr(self.text[self.place : self.place + 8]),
                "Functions: " + " ".join(sorted(("ATAN", "EXISTS", *(key.upper() for key in _FUNCTIONS)))),
            )  # fmt: skip
        if name == "exists":
            self.place += 1
            if not self.take("#") or self.peek() != "<":
                raise self.error("EXISTS needs a named parameter", repr(self.peek(8)), "Write EXISTS[#<name>]")
            known = Exists(self.name())
            if not self.take("]"):
                raise self.error("the bracket is not closed", repr(self.peek(8)))
            return known
        argument = self._bracket()
        if name == "atan":
            if not self.take("/"):
                raise self.error("ATAN needs two brackets", repr(self.peek(8)), "Write ATAN[y]/[x]")
            return Arctangent(argument, self._bracket())
        return FunctionCall(name, argument, column)

    def _bracket(self) -> Expression:
        if not self.take("["):
            raise self.error("a bracket [ is expected", repr(self.peek(8)) if self.peek() else "nothing")
        inner = self._operation(1)
        if not self.take("]"):
            value = repr(self.peek(8)) if self.peek() else "the end of the line"
            raise self.error("an operator or ] is expected", value)
        return inner

    def assigned(self) -> Expression:
        """Read what a parameter is set to: a value, or operations without brackets as Fanuc writes them."""
        return self._operation(1)

    def _operation(self, least: int) -> Expression:
        """Read operators of precedence ``least`` or tighter, left to right."""
        left = self.value()
        while True:
            operator = self._operator()
            if operator is None or _PRECEDENCE[operator] < least:
                return left
            column = self.column
            self.place += len(operator)
            left = BinaryOperation(operator, left, self._operation(_PRECEDENCE[operator] + 1), column)

    def _operator(self) -> str | None:
        words = (self.peek(length) for length in (3, 2, 1))
        return next((word for word in words if word in _PRECEDENCE), None)
