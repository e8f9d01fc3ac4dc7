"""One line of Sinumerik text into words with values, words without, and a comment."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

from counterflex.core.errors import ProgramError
from counterflex.programs.expression import ExpressionError
from counterflex.programs.gcode.read.scanner import error_at
from counterflex.programs.gcode.sinumerik import LIMITS
from counterflex.programs.gcode.sinumerik.expressions import Variables
from counterflex.programs.gcode.sinumerik.words import AXES, REFUSED, ROTARY
from counterflex.programs.unknown import Unknown, known

_NUMBER: Final = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:EX[+-]?\d+)?"
_SKIP: Final = re.compile(r"\s*/\d?")
_WORD: Final = re.compile(rf"([A-Z])\s*({_NUMBER})(?![\d.])(?!\s*=)", re.IGNORECASE)
_SET: Final = re.compile(r"([$A-Z_]\w*)\s*(\[[^=]*?\])?\s*=(?!=)\s*", re.IGNORECASE)
_MODE: Final = re.compile(r"(AC|IC)\s*\(", re.IGNORECASE)
_PLAIN: Final = re.compile(rf"{_NUMBER}(?=[\s;,)\]]|$|[A-Z])", re.IGNORECASE)
_OPERATOR: Final = re.compile(r"\s*([-+*/<>=]|DIV\b|MOD\b|AND\b|OR\b|XOR\b|B_\w+\b)", re.IGNORECASE)
_WITH_NAME: Final = ("CALL", "PCALL", "EXTCALL")
_NAME: Final = re.compile(r"[A-Z_]\w*", re.IGNORECASE)
_LEAVES: Final = re.compile(r"\b(?:SUPA|G153|G0*53|G0*7[45])\b", re.IGNORECASE)
"""Words that lead to a place of the machine, whose coordinates are not those of the part."""
_LARGEST: Final = 1e9


@dataclass(frozen=True, slots=True)
class Address:
    """A word with a value: ``X10.5``, ``CR=5``, ``X=IC(2)``, ``T="NAME"``."""

    name: str  # Upper case
    value: float | None  # Number; None where it is a string
    string: str | None  # Between the quotes, or None
    mode: str  # ``AC``, ``IC`` or empty
    start: int  # Index of its first character
    end: int  # Index behind its last one
    literal: bool = True  # False where the value came from an R parameter

    @classmethod
    def assigned(cls, text: str, given: re.Match[str], name: str, line: int, variables: Variables) -> Address:
        """An address with ``=``."""
        address, at, mode = given[1].upper(), given.end(), _MODE.match(text, given.end())
        at = mode.end() if mode is not None else at
        literal = _PLAIN.match(text, at) is not None or mode is not None
        value, end = value_at(text, at, name, line, variables)
        if mode is not None:
            close = re.compile(r"\s*\)").match(text, end)
            if close is None:
                raise _open(text, mode.start(), name, line)
            literal, end = re.fullmatch(rf"\s*{_NUMBER}\s*", text[at:end], re.IGNORECASE) is not None, close.end()
        if isinstance(value, Unknown) and address in (*AXES, *ROTARY) and _LEAVES.search(code_part(text, 0)):
            value = 0.0  # a place of the machine is not known, whatever its number
        value = known(value, address, f"{name}:{line}:{given.start() + 1}", text=text[given.start() : end])
        if isinstance(value, str):
            return cls(address, None, value, "", given.start(), end)
        if not isinstance(value, int | float):
            raise error_at(name, line, f"the value of {address} is no number", given.start(), text[given.start() : end])
        if not abs(value) <= _LARGEST:
            raise error_at(name, line, "a number is out of range", given.start(), f"{value:g}", f"At most {_LARGEST:g}")
        return cls(address, float(value), None, mode[1].upper() if mode else "", given.start(), end, literal)


@dataclass(frozen=True, slots=True)
class ScannedName:
    """A word without a value, perhaps with arguments in brackets: ``TRAORI``, ``MSG("...")``; ``called`` with them."""

    name: str
    called: bool
    start: int
    end: int
    text: str = ""

    @property
    def arguments(self) -> str:
        """Text between the brackets."""
        return self.text.strip()[1:-1] if self.called else ""


@dataclass(frozen=True, slots=True)
class Assigned:
    """A variable, R parameter or system variable that gets a value: ``R1=5``, ``DEPTH[2]=R1*2``."""

    name: str
    index: tuple[object, ...]
    value: object
    start: int


@dataclass(frozen=True, slots=True)
class Line:
    """Words of a line, each in order of appearance."""

    addresses: tuple[Address, ...] = ()
    names: tuple[ScannedName, ...] = ()
    assigned: tuple[Assigned, ...] = ()


def scan(text: str, name: str, line: int, variables: Variables) -> Line:
    """Read a line.

    Args:
        text: Without its end.
        line: 1-based number, for errors.
        variables: Values so far.

    Raises:
        ProgramError: With file, line and column of the first thing that is none of the dialect, or is not known.
    """
    if len(text) > LIMITS.line_characters:
        raise error_at(
            name, line, "the block is longer than Sinumerik takes", LIMITS.line_characters, f"{len(text)} characters"
        )
    addresses: list[Address] = []
    names: list[ScannedName] = []
    assigned: list[Assigned] = []
    variables.where = f"{name}:{line}"
    skip = _SKIP.match(text)
    at = skip.end() if skip else 0
    while at < len(text):
        if text[at] in " \t\r":
            at += 1
        elif text[at] == ";":
            break
        elif plain := _WORD.match(text, at):
            value = _number(plain[2], plain.start(2), name, line)
            addresses.append(Address(plain[1].upper(), value, None, "", plain.start(), plain.end()))
            at = plain.end()
        elif given := _SET.match(text, at):
            if _is_variable(given[1], variables):
                content, at = value_at(text, given.end(), name, line, variables)
                index = _indices(given, text, name, line, variables)
                assigned.append(Assigned(given[1].upper(), index, content, given.start()))
                if not given[1].startswith("$"):
                    variables.assign(given[1], index, content)  # what follows in the block sees it
            else:
                address = Address.assigned(text, given, name, line, variables)
                _refuse_set_here(assigned, text[given.end() : address.end], name, line, given.start())
                addresses.append(address)
                at = address.end
        elif called := _NAME.match(text, at):
            at = _arguments_end(text, called.end(), name, line)
            bracket = at > called.end()
            word = called[0].upper()
            if word in _WITH_NAME and not bracket:
                at = len(code_part(text, at))
            names.append(ScannedName(word, bracket, called.start(), at, text[called.end() : at]))
            if names[-1].name in REFUSED:  # what follows is not of this subset either
                break
        else:
            raise error_at(
                name, line, "a character that has no use here", at, repr(text[at]),
                "Comments begin with ; in Sinumerik, and stand in brackets in TwinCAT",
            )  # fmt: skip
    return Line(tuple(addresses), tuple(names), tuple(assigned))


def _refuse_set_here(assigned: list[Assigned], text: str, name: str, line: int, column: int) -> None:
    """Refuse a word that uses a variable which its own block sets: when that takes effect is not certain."""
    for item in assigned:
        if re.search(rf"(?<!\w){re.escape(item.name)}(?!\w)", text, re.IGNORECASE):
            raise error_at(name, line, f"{item.name} is set and used in one block", column, text.strip()[:30],
                           "Set it in a block before")  # fmt: skip


def _is_variable(name: str, variables: Variables) -> bool:
    return name.startswith("$") or re.fullmatch(r"R\d*", name.upper()) is not None or variables.defines(name)


def _indices(given: re.Match[str], text: str, name: str, line: int, variables: Variables) -> tuple[object, ...]:
    """Values of the indices in square brackets behind the name of a variable."""
    if given[2] is None:
        return ()
    values, at = [], given.start(2) + 1
    while at < given.end(2):
        value, at = value_at(text, at, name, line, variables)
        values.append(value)
        while text[at : at + 1] in (" ", ",", "]", "\t") and at < given.end(2):
            at += 1
    return tuple(values)


def value_at(text: str, at: int, name: str, line: int, variables: Variables) -> tuple[object, int]:
    """Return the value of the expression at an index, known or not, and the index behind it.

    Raises:
        ProgramError: There is none.
    """
    if (plain := _PLAIN.match(text, at)) is not None and not _OPERATOR.match(text, plain.end()):
        return _number(plain[0], at, name, line), plain.end()
    try:
        return variables.evaluate(text, at)
    except (ValueError, TypeError, ArithmeticError) as fault:
        what = str(fault) if isinstance(fault, ExpressionError) else "an operation has no value for its numbers"
        raise error_at(name, line, what, at, text[at : at + 30].strip(), "Write the value itself") from fault


def _number(text: str, column: int, name: str, line: int) -> float:
    value = float(text.upper().replace("EX", "E"))
    if not abs(value) <= _LARGEST:
        raise error_at(name, line, "a number is out of range", column, text, f"At most {_LARGEST:g}")
    return value


def code_part(text: str, at: int) -> str:
    """Return the text up to the comment that begins behind an index."""
    end = text.find(";", at)
    return text if end < 0 else text[:end]


def _arguments_end(text: str, at: int, name: str, line: int) -> int:
    """Index behind the bracketed arguments that begin at ``at``, or ``at`` where there are none."""
    place = at
    while text[place : place + 1] in (" ", "\t"):
        place += 1
    if text[place : place + 1] != "(":
        return at
    depth, quoted = 0, False
    for index in range(place, len(text)):
        character = text[index]
        quoted = quoted != (character == '"')
        if not quoted:
            depth += (character == "(") - (character == ")")
            if depth == 0:
                return index + 1
    raise _open(text, place, name, line)


def _open(text: str, place: int, name: str, line: int) -> ProgramError:
    return error_at(name, line, "a bracket is not closed", place, repr(text[place : place + 30]))
