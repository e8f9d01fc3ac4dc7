r"""Expressions of program languages: parsed by a grammar of operators, evaluated with values that may be unknown.

KRL, RAPID, VAL3 and Sinumerik differ in the spelling of operators, of aggregates (``{X 1, Y 2}``, ``[1, [2, 3]]``) and
of options (``\Tool:=t``), not in structure. :func:`parse` makes a tree by precedence climbing; :func:`evaluate`
computes it with the names and functions of a reader. A value is a number, truth value, string, mapping (record), list
(array or aggregate) or :class:`~counterflex.programs.unknown.Unknown`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final, Protocol

from counterflex.programs.unknown import first_unknown

Value = object
Operation = Callable[..., Value]


class ExpressionError(ValueError):
    """A text is no expression of the language, or an operator does not fit its operands."""

    def __init__(self, what: str, at: int = 0) -> None:
        super().__init__(what)
        self.at = at  # Index of the character at which it was found


@dataclass(frozen=True)
class Grammar:
    """Spelling of a language's expressions."""

    # Precedence and operation of each operator between two values; the larger precedence binds closer, equal ones group
    # from the left. Upper case.
    binary: Mapping[str, tuple[int, Operation]]
    unary: Mapping[str, tuple[int, Operation]]  # Precedence and operation of each operator before a value; upper case
    constants: Mapping[str, Value] = field(default_factory=dict)  # Values of words such as TRUE; upper case
    name: str = r"[A-Za-z_]\w*"  # Pattern of a name
    number: str = r"(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"  # Pattern of an unsigned number
    aggregate: str = "[]"  # Opening and closing bracket of an aggregate
    index: str = "[]"  # Opening and closing bracket of indices behind a name
    labelled: bool = False  # Items of an aggregate have a component's name before the value, ``{X 1.0}``
    # Pattern of a literal of an enumeration; its value is its text in capitals without blanks
    enumeration: str | None = None
    # Returns the value of a number by its text; None where ``number`` is a decimal number
    numeral: Callable[[str], Value] | None = None

    @cached_property
    def operator(self) -> re.Pattern[str]:
        """Pattern of an operator, the longer ones first."""
        words = sorted({*self.binary, *self.unary}, key=len, reverse=True)
        return re.compile("|".join(re.escape(w) + (r"\b" if w[-1].isalnum() else "") for w in words), re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class Literal:
    """A constant and its place in the text."""

    value: Value
    start: int
    end: int


@dataclass(frozen=True, slots=True)
class Name:
    """A name, with indices and components behind it: ``a[2].pose.x`` has the path ``((2,), "pose", "x")``."""

    text: str
    path: tuple[tuple[Node, ...] | str, ...]
    start: int
    end: int


@dataclass(frozen=True, slots=True)
class Call:
    r"""A call of a function; options are the arguments that have a name (``\Tool:=t``), in capitals."""

    name: str
    arguments: tuple[Node, ...]
    options: Mapping[str, Node | None]
    start: int
    end: int

    def value(self, grammar: Grammar, scope: Scope) -> Value:
        """Value of the function for its evaluated arguments."""
        by_reference = getattr(scope, "call_node", None)
        if by_reference is not None:
            return by_reference(self)
        options = {key: None if item is None else evaluate(item, grammar, scope) for key, item in self.options.items()}
        return scope.call(self.name, [evaluate(item, grammar, scope) for item in self.arguments], options)


@dataclass(frozen=True, slots=True)
class Aggregate:
    """Values in brackets; each has the name of its component, or None."""

    items: tuple[tuple[str | None, Node], ...]
    start: int
    end: int


@dataclass(frozen=True, slots=True)
class Operator:
    """An operator with its operands, one or two."""

    word: str
    operands: tuple[Node, ...]
    start: int
    end: int

    def value(self, grammar: Grammar, scope: Scope) -> Value:
        """Value of the operator for its evaluated operands."""
        values = [evaluate(operand, grammar, scope) for operand in self.operands]
        decides = {"AND": False, "&&": False, "OR": True, "||": True}.get(self.word)
        if decides is not None and any(value is decides for value in values):
            return decides  # whatever an unknown operand is
        unknown = first_unknown(values)
        if unknown is not None:
            return unknown
        try:
            if len(values) == 1:
                return grammar.unary[self.word][1](values[0])
            return grammar.binary[self.word][1](*values)
        except ZeroDivisionError:
            raise ExpressionError("a division by zero", self.start) from None
        except (TypeError, ValueError, OverflowError, ArithmeticError) as error:
            raise ExpressionError(f"{self.word} does not fit what it stands between", self.start) from error


Node = Literal | Name | Call | Aggregate | Operator


class Scope(Protocol):
    """Names and functions of the place where an expression stands."""

    def value_of(self, name: str, path: Sequence[object]) -> Value:
        """Return the value of a name; of its path the indices are tuples of values, the components strings."""

    def call(self, name: str, arguments: Sequence[Value], options: Mapping[str, Value]) -> Value:
        """Return the value of a function."""


class ScopeOfReferences(Scope, Protocol):
    """A scope whose functions may change their arguments."""

    def call_node(self, node: Call) -> Value:
        """Return the value of a function from its arguments as they are written."""


_STRING: Final = r'"(?:[^"]|"")*"'
_EXACT_DIGITS: Final = 15
"""A whole number of more digits is read as a floating one: infinite where it is too large, and refused as that."""


def parse(text: str, grammar: Grammar, start: int = 0) -> tuple[Node, int]:
    """Parse the expression that begins at an index.

    Args:
        text: It and what follows.
        start: Index of its first character; blanks may stand before it.

    Returns:
        The tree and the index behind the expression.

    Raises:
        ExpressionError: No expression begins there.
    """
    parser = _Parser(text, grammar, start)
    node = parser.expression(0)
    return node, parser.end


def parse_whole(text: str, grammar: Grammar) -> Node:
    """Parse a text that is one expression. Raises ExpressionError: it is not, or something follows."""
    node, end = parse(text, grammar)
    if text[end:].strip():
        raise ExpressionError(f"{text[end:].strip()[:20]} follows the expression", end)
    return node


def evaluate(node: Node, grammar: Grammar, scope: Scope) -> Value:
    """Return the value of an expression; an operator with an unknown operand gives that unknown value.

    Raises:
        ExpressionError: An operator does not fit its operands.
    """
    if isinstance(node, Literal):
        return node.value
    if isinstance(node, Name):
        path = [
            step if isinstance(step, str) else tuple(evaluate(index, grammar, scope) for index in step)
            for step in node.path
        ]
        return scope.value_of(node.text, path)
    if isinstance(node, Call):
        return node.value(grammar, scope)
    if isinstance(node, Aggregate):
        if any(label is not None for label, _ in node.items):
            return {label: evaluate(item, grammar, scope) for label, item in node.items}
        return [evaluate(item, grammar, scope) for _, item in node.items]
    return node.value(grammar, scope)


class _Parser:
    """Precedence climbing over a text."""

    def __init__(self, text: str, grammar: Grammar, start: int) -> None:
        self.text, self.grammar, self.end = text, grammar, start
        self._operator = grammar.operator
        self._name, self._number = re.compile(grammar.name), re.compile(grammar.number)
        self._enumeration = None if grammar.enumeration is None else re.compile(grammar.enumeration)

    def expression(self, least: int) -> Node:
        left = self._operand()
        while True:
            behind = self.end
            self._blanks()
            match = self._operator.match(self.text, self.end)
            entry = None if match is None else self.grammar.binary.get(match[0].upper())
            if match is None or entry is None or entry[0] < least:
                self.end = behind
                return left
            self.end = match.end()
            right = self.expression(entry[0] + 1)
            left = Operator(match[0].upper(), (left, right), left.start, right.end)

    def _blanks(self) -> None:
        while self.end < len(self.text) and self.text[self.end].isspace():
            self.end += 1

    def _accepts(self, token: str) -> bool:
        self._blanks()
        matches = self.text.startswith(token, self.end)
        self.end += len(token) if matches else 0
        return matches

    def _require(self, token: str) -> None:
        if not self._accepts(token):
            raise ExpressionError(f"{token} is missing", self.end)

    def _operand(self) -> Node:
        self._blanks()
        start = self.end
        match = self._operator.match(self.text, start)
        if match is not None and (unary := self.grammar.unary.get(match[0].upper())) is not None:
            self.end = match.end()
            operand = self.expression(unary[0])
            return Operator(match[0].upper(), (operand,), start, operand.end)
        if self._accepts("("):
            node = self.expression(0)
            self._require(")")
            return node
        if self._accepts(self.grammar.aggregate[0]):
            return self._aggregate(start)
        return self._constant(start) or self._named(start)

    def _constant(self, start: int) -> Literal | None:
        if (match := re.compile(_STRING).match(self.text, start)) is not None:
            value: Value = match[0][1:-1].replace('""', '"')
        elif (match := self._number.match(self.text, start)) is not None:
            value = (self.grammar.numeral or _decimal)(match[0])
        elif self._enumeration is not None and (match := self._enumeration.match(self.text, start)) is not None:
            value = "".join(match[0].split()).upper()
        else:
            return None
        self.end = match.end()
        return Literal(value, start, self.end)

    def _named(self, start: int) -> Node:
        match = self._name.match(self.text, start)
        if match is None:
            raise ExpressionError("a value is missing", start)
        self.end = match.end()
        word = match[0].upper()
        if word in self.grammar.constants:
            return Literal(self.grammar.constants[word], start, self.end)
        if self._accepts("("):
            return self._call(match[0], start)
        path: list[tuple[Node, ...] | str] = []
        behind = self.end = match.end()
        while True:
            if self._accepts(self.grammar.index[0]):
                path.append(self._indices())
            elif (component := re.compile(rf"\s*\.\s*({self.grammar.name})").match(self.text, behind)) is not None:
                self.end = component.end()
                path.append(component[1])
            else:
                self.end = behind
                return Name(match[0], tuple(path), start, behind)
            behind = self.end

    def _indices(self) -> tuple[Node, ...]:
        if self._accepts(self.grammar.index[1]):
            return ()
        items = [self.expression(0)]
        while self._accepts(","):
            items.append(self.expression(0))
        self._require(self.grammar.index[1])
        return tuple(items)

    def _call(self, name: str, start: int) -> Call:
        arguments: list[Node] = []
        options: dict[str, Node | None] = {}
        while not self._accepts(")"):
            if arguments or options:
                self._accepts(",")
            if self._accepts("\\"):
                match = self._name.match(self.text, self.end)
                if match is None:
                    raise ExpressionError("the name of an option is missing", self.end)
                self.end = match.end()
                given = self._accepts(":=") or self._accepts("?")
                options[match[0].upper()] = self.expression(0) if given else None
            else:
                arguments.append(self.expression(0))
        return Call(name, tuple(arguments), options, start, self.end)

    def _aggregate(self, start: int) -> Aggregate:
        closing = self.grammar.aggregate[1]
        items: list[tuple[str | None, Node]] = []
        self._tag()
        while not self._accepts(closing):
            if items:
                self._require(",")
            label = None
            if self.grammar.labelled:
                self._blanks()
                labels = re.compile(rf"({self.grammar.name})(?![\w$])\s*(?:\[\s*\])?(?=\s*[^\s,}}:])")
                match = labels.match(self.text, self.end)
                if match is not None:
                    label, self.end = match[1].upper(), match.end()
            items.append((label, self.expression(0)))
        return Aggregate(tuple(items), start, self.end)

    def _tag(self) -> None:
        """Pass the type before the components, ``{E6POS: X 1}``."""
        if self.grammar.labelled:
            match = re.compile(rf"\s*{self.grammar.name}\s*:(?!=)").match(self.text, self.end)
            self.end = self.end if match is None else match.end()


def _decimal(text: str) -> int | float:
    return int(text) if text.isdigit() and len(text) <= _EXACT_DIGITS else float(text)


def is_number(value: object) -> bool:
    """Return whether a value is a number; a truth value is none."""
    return isinstance(value, int | float) and not isinstance(value, bool)
