"""One line of Sinumerik text into words with values, words without, and a comment."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

from counterflex.core.errors import ProgramError
from counterflex.programs.gcode.read.scanner import error_at
from counterflex.programs.gcode.sinumerik.words import REFUSED
from counterflex.programs.limits import SINUMERIK

_NUMBER: Final = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:EX[+-]?\d+)?"
_SKIP: Final = re.compile(r"\s*/\d?")
_WORD: Final = re.compile(rf"([A-Z])\s*({_NUMBER})(?![\d.])(?!\s*=)", re.IGNORECASE)
_SET: Final = re.compile(r"([A-Z_]\w*)\s*=\s*", re.IGNORECASE)
_VALUE: Final = re.compile(
    rf"(?:(?P<mode>AC|IC)\s*\(\s*(?P<inner>{_NUMBER}|[+-]?R\d+)\s*\))|(?P<plain>{_NUMBER}|[+-]?R\d+)(?![\w.(\[])"
    r'|(?P<string>"[^"]*")',
    re.IGNORECASE,
)
_NAME: Final = re.compile(r"[A-Z_]\w*", re.IGNORECASE)
_LARGEST: Final = 1e9
_CONSTANTS: Final = "R parameters are read as constants only (R1=10.5, then X=R1); post plain numbers"


@dataclass(frozen=True, slots=True)
class Address:
    """A word with a value: ``X10.5``, ``CR=5``, ``X=IC(2)``, ``T="NAME"``.

    Attributes:
        name: Upper case.
        value: Number; None where it is a string.
        string: Between the quotes, or None.
        mode: ``AC``, ``IC`` or empty.
        start: Index of its first character.
        end: Index behind its last one.
        literal: False where the value came from an R parameter.
    """

    name: str
    value: float | None
    string: str | None
    mode: str
    start: int
    end: int
    literal: bool = True


@dataclass(frozen=True, slots=True)
class Name:
    """A word without a value, perhaps with arguments in brackets: ``TRAORI``, ``MSG("...")``; ``called`` with them."""

    name: str
    called: bool
    start: int
    end: int


@dataclass(frozen=True, slots=True)
class Line:
    """What a line says: addresses and names in order of appearance."""

    addresses: tuple[Address, ...] = ()
    names: tuple[Name, ...] = ()


def scan(text: str, name: str, line: int, constants: dict[int, float]) -> Line:
    """Read a line.

    Args:
        text: Without its end.
        name: Name of the program, for errors.
        line: 1-based number, for errors.
        constants: Values of R parameters so far.

    Raises:
        ProgramError: With file, line and column of the first thing that is none of the dialect.
    """
    if len(text) > SINUMERIK.line_characters:
        raise error_at(
            name, line, "the block is longer than Sinumerik takes", SINUMERIK.line_characters, f"{len(text)} characters"
        )
    addresses: list[Address] = []
    names: list[Name] = []
    skip = _SKIP.match(text)
    at = skip.end() if skip else 0
    while at < len(text):
        if text[at] in " \t\r":
            at += 1
        elif text[at] == ";":
            break
        elif word := _WORD.match(text, at):
            value = _number(word[2], word.start(2), name, line)
            addresses.append(Address(word[1].upper(), value, None, "", word.start(), word.end()))
            at = word.end()
        elif given := _SET.match(text, at):
            address = _assigned(text, given, name, line, constants)
            addresses.append(address)
            at = address.end
        elif called := _NAME.match(text, at):
            at = _arguments_end(text, called.end(), name, line)
            if text[at : at + 1] == ":":
                raise error_at(name, line, "labels are not read", called.start(), text[called.start() : at + 1])
            names.append(Name(called[0].upper(), at > called.end(), called.start(), at))
            if names[-1].name in REFUSED:  # what follows is not of this subset either
                break
        else:
            raise error_at(
                name, line, "a character that the Sinumerik dialect has no use for here", at, repr(text[at]),
                "Comments begin with ;",
            )  # fmt: skip
    return Line(tuple(addresses), tuple(names))


def _number(text: str, column: int, name: str, line: int) -> float:
    value = float(text.upper().replace("EX", "E"))
    if not abs(value) <= _LARGEST:
        raise error_at(name, line, "a number is out of range", column, text, f"At most {_LARGEST:g}")
    return value


def _assigned(text: str, given: re.Match[str], name: str, line: int, constants: dict[int, float]) -> Address:
    """An address with ``=``."""
    match = _VALUE.match(text, given.end())
    if match is None:
        raise error_at(name, line, f"the value of {given[1].upper()} is no plain number", given.start(),
                       repr(text[given.start() : given.start() + 30]), _CONSTANTS)  # fmt: skip
    address = given[1].upper()
    if match["string"] is not None:
        return Address(address, None, match["string"][1:-1], "", given.start(), match.end())
    number = match["inner"] or match["plain"]
    mode = (match["mode"] or "").upper()
    parameter = re.fullmatch(r"([+-]?)R(\d+)", number, re.IGNORECASE)
    if parameter is None:
        return Address(address, _number(number, given.start(), name, line), None, mode, given.start(), match.end())
    if int(parameter[2]) not in constants:
        raise error_at(name, line, "the R parameter has no value", match.start(), f"R{parameter[2]}", _CONSTANTS)
    value = constants[int(parameter[2])] * (-1.0 if parameter[1] == "-" else 1.0)
    return Address(address, value, None, mode, given.start(), match.end(), literal=False)


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
