"""Control flow of Sinumerik programs: jumps, loops, conditions, subprograms, and the variables that they need."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Final

from counterflex.core.errors import ProgramError
from counterflex.programs.gcode.read.scanner import error_at
from counterflex.programs.gcode.sinumerik.expressions import ArrayCells, Variables, number
from counterflex.programs.gcode.sinumerik.scanner import value_at
from counterflex.programs.gcode.sinumerik.source import (
    Library,
    SinumerikConstruct,
    SinumerikHead,
    SinumerikSource,
    code_of,
)
from counterflex.programs.unknown import Unknown, known

_DEEPEST: Final = 16
_JUMP: Final = re.compile(r"\b(GOTO[FBCS]?)\s+(\"?)(\w+)\2", re.IGNORECASE)
_DECLARED: Final = re.compile(r"\s*([A-Z_]\w*)\s*(\[[^\]]*\])?\s*(=\s*)?", re.IGNORECASE)
_TYPE: Final = re.compile(
    r"\s*(?:CHAN\s+|NCK\s+)?(REAL|INT|BOOL|CHAR|STRING\s*\[[^\]]*\]|AXIS|FRAME)\s+", re.IGNORECASE
)
_ZERO: Final = {"STRING": "", "CHAR": 0.0, "REAL": 0.0, "INT": 0.0, "BOOL": False}
_FOR: Final = re.compile(r"\s*((?:INT\s+)?[A-Z_]\w*)\s*(\[[^\]]*\])?\s*=\s*", re.IGNORECASE)
_SECTION: Final = re.compile(
    r"\s*([A-Z_]\w*)(?:\s+(?!P\s*=?\s*[\d(R])([A-Z_]\w*))?(?:\s+P\s*=?\s*(\S+))?\s*$", re.IGNORECASE
)
_PARAMETERS: Final = re.compile(
    r"(VAR\s+)?(REAL|INT|BOOL|CHAR|STRING\s*\[[^\]]*\]|AXIS|FRAME)\s+([A-Z_]\w*)", re.IGNORECASE
)


@dataclass
class ProgramSection:
    """A part of a program that runs again: from ``first`` to before ``end``, then on at ``back``."""

    depth: int
    first: int
    end: int
    times: int
    back: int


@dataclass
class SubprogramCall:
    """A subprogram that runs."""

    source: SinumerikSource  # Its caller
    back: int  # Index of the caller's line to go on at
    entry: int  # Its own first line
    repeats: int  # How often it still begins again
    # Variables of the caller that its parameters with VAR go back to, by parameter
    returns: dict[str, str] = field(default_factory=dict)
    loops: dict[int, float] = field(default_factory=dict)  # Loops of the caller


class SinumerikFlow:
    """Place of a running program."""

    def __init__(self, source: SinumerikSource, library: Library) -> None:
        self.source, self.index = source, source.first
        self.variables = Variables()
        self.frames: list[SubprogramCall] = []
        self._library = library
        self._loops: dict[int, float] = {}
        self._sections: list[ProgramSection] = []

    def fault(self, what: str, column: int = 0, value: object = None, hint: str | None = None) -> ProgramError:
        """Make an error on the line that is executed."""
        return error_at(self.source.name, self.index + 1, what, column, value, hint)

    def memory(self) -> object:
        """Return all values that decide how the program goes on."""
        return [self.variables.memory(), self._loops, self._sections, [frame.repeats for frame in self.frames]]

    # Values ---------------------------------------------------------------------------------------------------------

    def value(self, text: str, at: int) -> tuple[object, int]:
        """Return the value of an expression of the line, and the index behind it."""
        self.variables.where = f"{self.source.name}:{self.index + 1}"
        return value_at(text, at, self.source.name, self.index + 1, self.variables)

    def _needed(self, text: str, at: int, use: str) -> tuple[float, int]:
        value, end = self.value(text, at)
        where = f"{self.source.name}:{self.index + 1}:{at + 1}"
        return number(known(value, use, where, text=text, hint="Write the value itself")), end

    # Flow -----------------------------------------------------------------------------------------------------------

    def control(self, text: str, head: SinumerikHead) -> None:
        """Execute a line of the flow of the program; :attr:`index` is where it goes on.

        Raises:
            ProgramError: A condition or count that is not known, a target that is not there.
        """
        code = code_of(text)
        word, at = head.keyword, head.rest
        construct = self.source.at.get(self.index)
        if word in ("DEF", "PROC", "EXTERN"):
            if word == "DEF":
                self._declare(code, at)
            self.index += 1
        elif word.startswith("GOTO") or word == "CASE":
            self._jump(code, at, word)
        elif construct is None and word == "IF":
            condition, _ = self._needed(code, at, "a condition")
            if condition:
                self._jump(code, at, "GOTO")
            else:
                self.index += 1
        elif construct is None:
            self._section(code, at, word)
        else:
            self.index = self._enter(code, at, word, construct)

    def _section(self, code: str, at: int, word: str) -> None:
        """REPEAT and REPEATB with labels: run a part of the program again."""
        match = _SECTION.match(code, at)
        if match is None:
            raise self.fault(f"{word} without a label that is read", at, code.strip()[:40], "REPEAT LABEL P=2")
        first = self.source.target("GOTOC", match[1], self.index)
        last = first if match[2] is None else self.source.target("GOTOC", match[2], self.index)
        if first is None or last is None or last < first:
            raise self.fault(
                "the labels of a repetition are not there", match.start(1), match[0].strip(), "Write LABEL:"
            )
        times = 1.0
        if match[3] is not None:
            times, _ = self._needed(code, match.start(3), "the number of repetitions")
        end = first + 1 if word == "REPEATB" else self.index if match[2] is None else last + 1
        if times < 1.0:
            self.index += 1
            return
        self._sections.append(ProgramSection(len(self.frames), first, end, round(times), self.index + 1))
        self.index = first

    def settle(self) -> None:
        """At the end of a part that runs again, go back to its beginning or behind its REPEAT."""
        while self._sections:
            section = self._sections[-1]
            if section.depth != len(self.frames) or self.index != section.end:
                return
            section.times -= 1
            self.index = section.first if section.times > 0 else section.back
            if section.times > 0:
                return
            self._sections.pop()

    def _enter(self, code: str, at: int, word: str, construct: SinumerikConstruct) -> int:
        """Index of the line behind a line of a loop or condition."""
        on = self.index + 1
        if word in ("ELSE", "ENDIF", "LOOP", "REPEAT"):
            return construct.end + 1 if word == "ELSE" else on
        if word in ("ENDLOOP", "ENDWHILE"):
            return construct.start
        if word == "ENDFOR":
            self._loops[construct.start] = self._loops.get(construct.start, 0.0) + 1.0
            return construct.start
        if word == "FOR":
            return on if self._counts(code, at, construct) else construct.end + 1
        condition, _ = self._needed(code, at, "a condition")
        if word == "UNTIL":
            return on if condition else construct.start + 1
        if condition:
            return on
        return construct.middle + 1 if word == "IF" and construct.middle >= 0 else construct.end + 1

    def _counts(self, code: str, at: int, construct: SinumerikConstruct) -> bool:
        match = _FOR.match(code, at)
        if match is None:
            raise self.fault("FOR needs a variable and its limits", at, code.strip()[:40], "FOR R1=1 TO 5")
        name = match[1].split()[-1]
        first, end = self._needed(code, match.end(), "the start of a count")
        to = re.compile(r"\s*TO\b", re.IGNORECASE).match(code, end)
        if to is None:
            raise self.fault("FOR needs TO", at, code.strip()[:40], "FOR R1=1 TO 5")
        last, _ = self._needed(code, to.end(), "the end of a count")
        if construct.start in self._loops:
            now = (
                number(known(self.variables.value_of(name, ()), "a count", f"{self.source.name}:{self.index + 1}")) + 1
            )
        else:
            self._loops[construct.start], now = 0.0, first
        self.variables.assign(name, (), now)
        if now > last:
            del self._loops[construct.start]
        return now <= last

    def _jump(self, code: str, at: int, word: str) -> None:
        if word == "CASE":
            at = self._case(code, at)
        elif word != "GOTO" or not _JUMP.search(code, at):
            at = code.upper().index("GOTO", 0)
        match = _JUMP.search(code, at)
        if match is None or match[1].upper() == "GOTOS":
            raise self.fault("a jump without a label that is read", at, code.strip()[:40], "Write GOTOF LABEL")
        target = self.source.target(match[1].upper(), match[3], self.index)
        if target is None:
            raise self.fault("the label of a jump is not there", match.start(3), match[3], "Write it as LABEL:")
        self._loops = {start: n for start, n in self._loops.items() if start < target <= self.source.at[start].end}
        self.index = target

    def _case(self, code: str, at: int) -> int:
        """Index of the jump that a CASE takes."""
        value, end = self._needed(code, at, "the value of CASE")
        for match in re.compile(r"(?:(-?\d+)|DEFAULT)\s+(?=GOTO)", re.IGNORECASE).finditer(code, end):
            if match[1] is None or float(match[1]) == value:
                return match.end()
        raise self.fault("no branch of CASE fits its value", at, f"{value:g}", "Write DEFAULT GOTOF LABEL")

    def _declare(self, code: str, at: int) -> None:
        """DEF: variables with their values."""
        kind = _TYPE.match(code, at)
        if kind is None:
            raise self.fault("a declaration that is not read", at, code.strip()[:40], "DEF REAL NAME=1")
        at = kind.end()
        while (match := _DECLARED.match(code, at)) is not None:
            name = kind[1].upper().split("[")[0].strip()
            value: object = _ZERO.get(name)
            at = match.end()
            if match[3] is not None:
                value, at = self.value(code, at)
            if isinstance(value, tuple) and (match[2] or "").count(",") + 1 != 1:
                value = Unknown("SET fills an array of several dimensions", self.variables.where)
            self.variables.define(match[1], name, value)
            comma = re.compile(r"\s*,").match(code, at)
            if comma is None:
                break
            at = comma.end()

    # Subprograms ----------------------------------------------------------------------------------------------------

    def call(self, name: str, arguments: str, repeats: int = 1) -> bool:
        """Enter a subprogram; whether there is one of that name.

        Raises:
            ProgramError: Programs call each other too deeply, or an argument cannot be read.
        """
        source = self._library(name)
        if source is None:
            return False
        if len(self.frames) >= _DEEPEST:
            raise self.fault("subprograms call each other too deeply", 0, f"more than {_DEEPEST} levels",
                             "Look for a subprogram that calls itself")  # fmt: skip
        level, returns = self._bound(source, arguments)
        self.frames.append(SubprogramCall(self.source, self.index + 1, source.first, repeats, returns, self._loops))
        self.variables.levels.append(level)
        self.source, self.index, self._loops = source, source.first, {}
        return True

    def _bound(self, source: SinumerikSource, arguments: str) -> tuple[dict[str, ArrayCells], dict[str, str]]:
        """Values of the parameters of a subprogram."""
        head = next((code_of(line) for line in source.lines[source.first : source.last] if re.match(
            r"\s*(N\d+\s*)?PROC\b", line, re.IGNORECASE)), "")  # fmt: skip
        level: dict[str, ArrayCells] = {}
        returns: dict[str, str] = {}
        texts, at = [], 0
        while at < len(arguments):
            match = re.compile(r'(?:"[^"]*"|[^",()\[\]]|\([^()]*\)|\[[^\]]*\])*').match(arguments, at)
            end = at if match is None else match.end()
            texts.append(arguments[at:end].strip())
            at = end + 1
        parameters = list(_PARAMETERS.finditer(head))
        if len(texts) > len(parameters):
            raise self.fault("a subprogram is called with more arguments than it has parameters", 0, arguments[:40],
                             "Declare them: PROC NAME(REAL A)")  # fmt: skip
        for index, parameter in enumerate(parameters):
            text = texts[index] if index < len(texts) else ""
            kind = parameter[2].upper().split("[")[0].strip()
            value: object = _ZERO.get(kind)
            if text:
                value, _ = self.value(text, 0)
            level[parameter[3].upper()] = ArrayCells(kind, value)
            if parameter[1] and text:
                returns[parameter[3].upper()] = text
        return level, returns

    def leave(self) -> None:
        """Leave a subprogram, or run it again."""
        frame = self.frames[-1]
        if frame.repeats > 1:
            frame.repeats -= 1
            self.index, self._loops = frame.entry, {}
            return
        self.frames.pop()
        level = self.variables.levels.pop()
        for name, variable in frame.returns.items():
            self.variables.assign(variable, (), level[name].get(()))
        self.source, self.index, self._loops = frame.source, frame.back, frame.loops
