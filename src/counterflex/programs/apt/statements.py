"""The statements of an APT or CL file: major word, arguments with their places, comments and continued lines."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from counterflex.core.errors import ProgramError
from counterflex.programs.apt.word_table import TABLE
from counterflex.programs.statement_table import Treatment

LARGEST: Final = 1e9
"""Largest number of a file; nothing that is measured needs one as large."""
_AXIS_OFF: Final = 1e-9
_MAJOR: Final = re.compile(r"\s*([A-Z][A-Z0-9_\-. ]*?)\s*(/|$)", re.IGNORECASE)
_TEXT: Final = re.compile(r"\s*(PARTNO|PPRINT|REMARK|INSERT|TOOL PATH|MACHIN|PLABEL|PAINT|TPRINT)\b", re.IGNORECASE)
_ARGUMENT: Final = re.compile(r"\s*([^,\s]+)\s*(,|$)")
_DEFINITION: Final = re.compile(r"\s*[A-Z]\w*\s*=", re.IGNORECASE)
_TOOL_ON: Final = re.compile(r"\s*(TLON|TLLFT|TLRGT)\b\s*,?", re.IGNORECASE)
_TOOL_ON_CIRCLE: Final = re.compile(
    r"\s*TLON\s*,\s*GOFWD\s*/\s*\(?\s*CIRCLE\s*/([^()A-Z]*?)(?:\)\s*|\s*),\s*ON\s*,\s*(2\s*,\s*(?:INTOF\s*,\s*)?)?"
    r"\(?\s*LINE\s*/([^()A-Z]*?)\)?\s*",
    re.IGNORECASE,
)
SYSTEM: Final = "$$-> CSYS"
"""Major word of the coordinate system that Creo writes as a comment."""
_SYSTEM: Final = re.compile(r"\s*\$\$->\s*CSYS\s*/", re.IGNORECASE)
_KNOWN: Final = frozenset(row.word.split("/")[0].split(" ")[0] for row in TABLE.rows)
TOOL_ON_CIRCLE: Final = "TLON,GOFWD"
"""Major word of the circular motion that CATIA writes; its arguments: centre, radius, both points of the line, and the
word INTOF where the second intersection with the line is meant."""
_NUMBER: Final = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[ED][+-]?\d+)?", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class Argument:
    """A word or number behind the slash; ``start`` and ``end`` are places in the statement's text."""

    text: str
    value: float | None
    start: int
    end: int


_CARRIED: Final = frozenset(row.word for row in TABLE.of(Treatment.NEUTRAL) if "/" not in row.word)
"""Words whose arguments nothing reads."""


@dataclass(frozen=True)
class AptLine:
    """One statement, perhaps over several lines."""

    line: int  # 1-based first line
    text: str  # Its lines, joined by line feeds
    major: str  # Major word, upper case; empty for blank lines and comments
    arguments: tuple[Argument, ...] = ()  # Behind the slash; none for words with free text

    def words(self) -> list[str]:
        """Arguments that are no numbers, upper case."""
        return [argument.text for argument in self.arguments if argument.value is None]

    def numbers(self) -> list[Argument]:
        """Arguments that are numbers."""
        return [argument for argument in self.arguments if argument.value is not None]


def place(name: str, line: int, text: str, column: int) -> str:
    """``name:line:column`` of a place in a statement's text, 1-based."""
    before = text[:column]
    return f"{name}:{line + before.count(chr(10))}:{column - before.rfind(chr(10))}"


def statements(lines: Sequence[str], name: str) -> Iterator[AptLine]:
    """Yield the statements of a file.

    ``$$`` begins a comment; a single ``$`` says that the statement goes on in the next line, what follows it is no part
    of it. A comment that ends in ``$`` goes on in the next line, unless that is a statement; ``$$-> CSYS / ...`` is how
    Creo writes its coordinate system.

    Raises:
        ProgramError: A line that is no statement, or a file that ends within one.
    """
    index = 0
    while index < len(lines):
        first, code = index, []
        while True:
            line, goes_on = _code(lines[index])
            code.append(line)
            index += 1
            if not goes_on and lines[first].lstrip().startswith("$$") and _comment_goes_on(lines, first, index):
                goes_on, code[-1] = True, " " * len(lines[index - 1])
            if not goes_on:
                break
            if index == len(lines):
                raise ProgramError("the file ends within a statement", where=f"{name}:{index}:1", value=lines[-1][:40])
        text = "\n".join(lines[first:index])
        if (system := _SYSTEM.match(text)) is not None:
            flat = text.replace("\n", " ").replace("$", " ")
            whole = AptLine(first + 1, text, SYSTEM)
            arguments = _arguments(flat, system.end(), len(flat.rstrip()), whole, name)
            yield AptLine(first + 1, text, SYSTEM, tuple(arguments))
        elif lines[first].lstrip().startswith("$$"):
            yield AptLine(first + 1, text, "")
        else:
            yield _statement("\n".join(code), text, first + 1, name)


def _comment_goes_on(lines: Sequence[str], first: int, index: int) -> bool:
    """Return whether the comment that begins in line ``first`` goes on in the line ``index``."""
    last = lines[index - 1].rstrip()
    if not last.endswith("$") or last.endswith("$$") or index == len(lines):
        return False
    if _SYSTEM.match(lines[first]) is not None:
        return True
    major = _MAJOR.match(lines[index])
    return major is None or major[1].split()[0].upper() not in _KNOWN


def _code(line: str) -> tuple[str, bool]:
    """The line with comment and continuation sign blanked, in its own length, and whether the statement goes on."""
    if _TEXT.match(line):
        return line, False
    at = line.find("$")
    if at < 0:
        return line, False
    return line[:at].ljust(len(line)), line[at : at + 2] != "$$"


def _statement(code: str, text: str, line: int, name: str) -> AptLine:
    if not code.strip():
        return AptLine(line, text, "")
    free = _TEXT.match(code)
    if free is not None:
        return AptLine(line, text, free[1].upper())
    flat = code.replace("\n", " ").rstrip()
    if _TOOL_ON.match(flat):
        return _tool_on(flat, text, line, name)
    major = _MAJOR.match(flat)
    if major is None:
        where = place(name, line, text, len(code) - len(code.lstrip()))
        if _DEFINITION.match(flat):
            raise ProgramError(
                "definitions of APT are not evaluated: variables, matrices, geometry, macros", where=where,
                value=code.strip()[:40], hint="Let the CAM system write a cutter location file: GOTO with numbers",
            )  # fmt: skip
        raise ProgramError("this is no statement of APT", where=where, value=code.strip()[:40])
    if major[1].upper() in _CARRIED:  # CATIA leaves arguments out: TOOLNO/1,MILL,1,0,14.106,,40.0
        return AptLine(line, text, major[1].upper())
    arguments = _arguments(flat, major.end(), len(flat), AptLine(line, text, ""), name)
    return AptLine(line, text, major[1].upper(), tuple(arguments))


def _tool_on(flat: str, text: str, line: int, name: str) -> AptLine:
    """A tool that follows a shape; read is the circle to a line."""
    match = _TOOL_ON_CIRCLE.fullmatch(flat)
    if match is None:
        return AptLine(line, text, flat.split(",")[0].strip().upper())
    whole = AptLine(line, text, TOOL_ON_CIRCLE)
    arguments = [a for part in (1, 3) for a in _arguments(flat, match.start(part), match.end(part), whole, name)]
    if match[2] is not None:
        arguments.append(Argument("INTOF", None, match.start(2), match.end(2)))
    return AptLine(line, text, TOOL_ON_CIRCLE, tuple(arguments))


def _arguments(flat: str, at: int, end: int, part: AptLine, name: str) -> list[Argument]:
    """Words and numbers between two places of a statement without line feeds."""
    arguments: list[Argument] = []
    while at < end:
        match = _ARGUMENT.match(flat, at, end)
        if match is None:
            raise ProgramError(
                "an argument is missing or stands without a comma", where=place(name, part.line, part.text, at),
                value=flat[at : at + 30].strip(),
            )  # fmt: skip
        number = _NUMBER.fullmatch(match[1])
        value = float(match[1].upper().replace("D", "E")) if number else None
        if value is not None and not abs(value) <= LARGEST:
            raise ProgramError(
                "a number is out of range", where=place(name, part.line, part.text, match.start(1)), value=match[1],
                limit=f"<= {LARGEST:g}",
            )  # fmt: skip
        arguments.append(Argument(match[1].upper(), value, match.start(1), match.end(1)))
        at = match.end()
    return arguments


def tilts(part: AptLine) -> bool:
    """Return whether a statement gives a tool axis other than z."""
    values = [argument.value or 0.0 for argument in part.numbers()]
    axis = values[3:6] if part.major in ("GOTO", "FROM") else values[:3] if part.major == "TLAXIS" else []
    if len(axis) != 3:
        return False
    return axis[2] < 0.0 or math.hypot(axis[0], axis[1]) > _AXIS_OFF * abs(axis[2])
