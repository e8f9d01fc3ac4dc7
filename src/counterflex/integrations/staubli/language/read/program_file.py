"""A program file of VAL3: its parameters, local variables and lines, in the forms of s6 and s7."""

from __future__ import annotations

import html
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

from counterflex.core.errors import ProgramError
from counterflex.programs.gcode.read.flow import split_lines

_HINT: Final = "Give the program (.pgx) that holds the path, not the project"
_ATTRIBUTE: Final = re.compile(r"([A-Za-z:]\w*)\s*=\s*\"([^\"<>]*)\"")
_PARAMETER: Final = re.compile(r"<[Pp]aram(?:eter)?\b([^<>]*?)/?>")
_LOCAL: Final = re.compile(r"<[Ll]ocal\b([^<>]*?)/?>")
_BEGIN: Final = re.compile(r"(?:.*(?:CDATA\[|<code>))?\s*begin")
_END: Final = re.compile(r"end\s*(?:\]\]>\s*)?(?:</[Cc]ode>.*)?")
_OPENS: Final = re.compile(r"(if|while|for|switch|do)\b")
_CLOSES: Final = re.compile(r"(endIf|endWhile|endFor|endSwitch|until)\b")
_BETWEEN: Final = re.compile(r"(elseIf|else|case|default)\b")
CLOSED_BY: Final = {"if": "endIf", "while": "endWhile", "for": "endFor", "switch": "endSwitch", "do": "until"}


@dataclass(frozen=True, slots=True)
class Val3Variable:
    """A parameter or local variable."""

    name: str  # Its name
    kind: str  # num, pointRx, ..
    size: int = 1  # Number of elements
    reference: bool = False  # A parameter that stands for the variable of the caller

    @classmethod
    def of(cls, attributes: str) -> Val3Variable:
        """Read a declared variable."""
        about = {part[1]: part[2] for part in _ATTRIBUTE.finditer(attributes)}
        size = about.get("size", "1")
        reference = about.get("use", "") == "reference" or about.get("byReference", "") == "true"
        return cls(about.get("name", ""), about.get("type", ""), int(size) if size.isdecimal() else 1, reference)


@dataclass
class Val3Routine:
    """A program file.

    Attributes:
        first: Index of the line behind ``begin``.
        last: Index of the line ``end``.

    Raises:
        ProgramError: It is no program, or is cut off.
    """

    text: str
    name: str
    complete: bool = True
    encoding: str = "utf-8"
    # Index of the closing line by that of the opening one, and the other way round
    ends: dict[int, int] = field(default_factory=dict)
    # Lines ``else``, ``elseIf``, ``case`` and ``default`` of an opening line
    branches: dict[int, list[int]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Divide it."""
        text, name = self.text, self.name
        self.lines = split_lines(text)  # Of the text
        # Index of each line in the text
        self.starts = [0, *(match.end() for match in re.finditer(r"\r\n|\n|\r", text))]
        if not text.strip():
            raise ProgramError("the program is empty", where=f"{name}:1:1", hint="Post it again")
        if len(re.findall(r"<[Pp]rogram\s", text)) != 1 or not re.search(r"<[Cc]ode>", text):
            raise ProgramError("this is no program file of VAL3", where=f"{name}:1:1", value=text.strip()[:60],
                               limit='<Program name="..."> ... <Code>', hint=_HINT)  # fmt: skip
        self.first, self.last = self._body()
        escaped = "<![CDATA[" not in text
        # Code of each line without its comment and blanks; empty outside of the program
        self.codes = [""] * len(self.lines)
        for at in range(self.first, self.last):
            line = html.unescape(self.lines[at]) if escaped and "&" in self.lines[at] else self.lines[at]
            self.codes[at] = code_of(line).strip()
        head = text[: self.starts[self.first]] if self.first < len(self.starts) else text
        self.parameters = [Val3Variable.of(match[1]) for match in _PARAMETER.finditer(head)]  # In order
        self.locals = [Val3Variable.of(match[1]) for match in _LOCAL.finditer(head)]  # Local variables
        self._match_blocks()

    @property
    def program(self) -> str:
        """Name of the program: that of its file."""
        return self.name.rpartition(".")[0]

    def place(self, at: int) -> str:
        """``name:line:column`` of the code of a line."""
        column = self.lines[at].find(self.codes[at]) + 1 if self.codes[at] else 1
        return f"{self.name}:{at + 1}:{max(column, 1)}"

    def fault(self, at: int, what: str, *, limit: str | None = None, hint: str | None = None) -> ProgramError:
        """Return the error of a line."""
        return ProgramError(what, where=self.place(at), value=self.codes[at][:60], limit=limit, hint=hint)

    def _body(self) -> tuple[int, int]:
        codes = [code_of(line).strip() for line in self.lines]
        begin = _first(codes, _BEGIN, 0)
        end = _first(codes, _END, begin + 1)
        if begin < 0 or (end < 0 and self.complete):
            raise ProgramError(
                f"the program has no {'begin' if begin < 0 else 'end'}: it may be cut off",
                where=f"{self.name}:{1 if begin < 0 else len(self.lines)}",
                limit="begin ... end, each on a line of its own",
                hint="Post it again" + ("" if begin < 0 else ", or say --without-end if it is complete"),
            )
        if end < 0:
            return begin + 1, len(self.lines)
        head, tail = "".join(self.lines[:begin]), "".join(self.lines[end:])
        required = ("Program", "Programs") if re.search(r"<programs\b", head, re.IGNORECASE) else ("Program",)
        missing = next((one for one in required if not re.search(f"</{one}>", tail, re.IGNORECASE)), None)
        if self.complete and missing is not None:
            raise ProgramError(f"the file stops before </{missing}>: it may be cut off",
                               where=f"{self.name}:{len(self.lines)}",
                               hint="Post it again, or say --without-end if it is complete")  # fmt: skip
        return begin + 1, end

    def _match_blocks(self) -> None:
        open_blocks: list[tuple[str, int]] = []
        for at in range(self.first, self.last):
            code = self.codes[at]
            if not code:
                continue
            if (match := _CLOSES.match(code)) is not None:
                if not open_blocks or CLOSED_BY[open_blocks[-1][0]] != match[1]:
                    raise self.fault(at, f"{match[1]} closes nothing", hint="The file may be damaged")
                begin = open_blocks.pop()[1]
                self.ends[begin], self.ends[at] = at, begin
            elif (match := _BETWEEN.match(code)) is not None:
                if not open_blocks or open_blocks[-1][0] not in ("if", "switch"):
                    raise self.fault(at, "this belongs into if or switch", hint="The file may be damaged")
                self.branches.setdefault(open_blocks[-1][1], []).append(at)
                self.ends[at] = open_blocks[-1][1]
            elif (match := _OPENS.match(code)) is not None:
                open_blocks.append((match[1], at))
        if open_blocks:
            word, at = open_blocks[-1]
            raise ProgramError(f"{word} is not closed", where=f"{self.name}:{at + 1}", hint="The file may be cut off")


def code_of(line: str) -> str:
    """The part of a line before its comment; ``//`` within quotes begins none."""
    if "//" not in line:
        return line
    quoted = False
    for index, character in enumerate(line):
        if character == '"':
            quoted = not quoted
        elif character == "/" and not quoted and line[index : index + 2] == "//":
            return line[:index]
    return line


def arguments(code: str, start: int, end: int) -> list[tuple[int, int]]:
    """Places of arguments: divided by commas outside of brackets, without blanks around them."""
    out, depth, begin, quoted = [], 0, start, False
    for at in range(start, max(end, start)):
        quoted ^= code[at] == '"'
        depth += 0 if quoted else (code[at] in "([{") - (code[at] in ")]}")
        if code[at] == "," and depth == 0 and not quoted:
            out.append((begin, at))
            begin = at + 1
    out.append((begin, max(end, start)))
    return [
        (a + len(code[a:b]) - len(code[a:b].lstrip()), b - len(code[a:b]) + len(code[a:b].rstrip())) for a, b in out
    ]


def _first(codes: Sequence[str], pattern: re.Pattern[str], begin: int) -> int:
    """Index of the first line from one on that is a word; -1 where none is."""
    return next((at for at in range(begin, len(codes)) if pattern.fullmatch(codes[at])), -1)
