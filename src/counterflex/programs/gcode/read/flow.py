"""O words of a source: which line closes what, and where subroutines begin.

Jumps and loops of Fanuc macros: IF GOTO, IF THEN, GOTO, WHILE DO and END.

Source: Fanuc, Operator's Manual, "Custom macro", "Branch and repetition".
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Final

from counterflex.core.errors import ProgramError
from counterflex.programs.gcode.read.expression import Cursor, Expression
from counterflex.programs.gcode.read.scanner import FlowWord, ScannedLine, error_at, strip_comments

_BEGIN: Final = re.compile(r"/?(?:n\d+)?(if\[|while\[|goto|do\d|end\d|popen|pclos|dprnt|bprnt)")
_OUTPUTS: Final = ("popen", "pclos", "dprnt", "bprnt")


@dataclass(frozen=True)
class MacroFlow:
    """A line of the flow of a macro."""

    keyword: str  # ``if``, ``goto``, ``while``, ``do``, ``end``, or ``text`` for an output of text
    condition: Expression | None = None  # Of IF and WHILE
    target: Expression | None = None  # Block number that IF and GOTO go to
    then: ScannedLine | None = None  # Rest of the line behind THEN
    loop: int = 0  # Number of DO and END

    @classmethod
    def read(cls, cursor: Cursor, text: str, name: str, line: int) -> MacroFlow:
        """Read a statement of macro flow at the cursor; the text names it in errors."""
        if cursor.take("goto"):
            return cls("goto", target=cursor.value())
        for keyword in ("do", "end"):
            if cursor.take(keyword):
                return cls(keyword, loop=int(_digit(cursor)))
        keyword = "if" if cursor.take("if") else "while"
        cursor.take("while")
        condition = cursor.value()
        if keyword == "while":
            if not cursor.take("do"):
                raise cursor.error("DO is expected behind WHILE [...]", repr(cursor.peek(8)))
            return cls("while", condition, loop=int(_digit(cursor)))
        if cursor.take("goto"):
            return cls("if", condition, cursor.value())
        if not cursor.take("then"):
            raise cursor.error("GOTO or THEN is expected behind IF [...]", repr(cursor.peek(8)))
        then = ScannedLine.scan(" " * cursor.column + text[cursor.column :], name, line)
        cursor.place = len(cursor.text)
        return cls("if", condition, then=then)


def scan_macro(text: str, name: str, line: int) -> MacroFlow | None:
    """Return what a line of the flow of a macro says; None for any other line.

    Raises:
        ProgramError: It begins as one, and is none.
    """
    clean, columns, _ = strip_comments(text, name, line)
    begin = _BEGIN.match(clean)
    if begin is None:
        return None
    cursor = Cursor(clean, columns, lambda what, column, value, hint: error_at(name, line, what, column, value, hint))
    if begin[1] in _OUTPUTS:
        return MacroFlow("text")
    cursor.place = begin.start(1)
    flow = MacroFlow.read(cursor, text, name, line)
    if cursor.peek():
        raise cursor.error("nothing may follow a jump or loop of a macro", repr(cursor.peek(12)))
    return flow


def _digit(cursor: Cursor) -> str:
    digit = cursor.peek()
    if digit not in ("1", "2", "3"):
        raise cursor.error("the number of a loop is 1, 2 or 3", repr(digit))
    cursor.place += 1
    return digit


_FLOW_LINE: Final = re.compile(r"[ \t]*/?[ \t]*(?:[Nn][ \t0-9.]*)?[Oo]|[ \t]*:[ \t]*[0-9]")
_NUMBERED: Final = re.compile(r"[ \t]*/?[ \t]*[Nn][ \t]*(\d+)(?![.\d])")
_MACRO_LINE: Final = re.compile(r"(if|while)\s*\[|goto|do\s*[1-9]|end\s*[1-9]|popen|pclos|[db]prnt", re.IGNORECASE)
_CLOSERS: Final = {"endsub": "sub", "endwhile": "while", "endif": "if", "endrepeat": "repeat"}
LOOPS: Final = ("while", "do", "repeat")


def line_end(text: str) -> str:
    """Line end of a text: CRLF, LF, or CR where there is no other."""
    if "\n" not in text and "\r" in text:
        return "\r"
    return "\r\n" if "\r\n" in text else "\n"


def split_lines(text: str) -> tuple[str, ...]:
    """Split at line feeds, with or without a carriage return, or at carriage returns where there are no line feeds.

    The empty rest behind the last one is no line.
    """
    if line_end(text) == "\r":
        text = text.replace("\r", "\n")
    lines = text.replace("\r\n", "\n").split("\n")
    if lines[-1] == "":
        lines.pop()
    return tuple(lines)


@dataclass
class Construct:
    """A subroutine, loop or condition."""

    keyword: str  # ``sub``, ``while``, ``do``, ``repeat`` or ``if``
    label: str  # Its label
    start: int  # Index of its first line
    end: int = -1  # Index of its last line
    # Indices of its ``elseif``, ``else`` and ``endif`` lines, in order
    branches: list[int] = field(default_factory=list)


class GcodeSource:
    """A program or an included file: its lines and the structure of its O words.

    Raises:
        ProgramError: A loop, condition or subroutine that is not closed, closed twice, or nested into another halfway.
    """

    def __init__(self, name: str, lines: tuple[str, ...]) -> None:
        self.name = name
        self.lines = lines
        self.scanned: dict[int, ScannedLine] = {}
        self.at: dict[int, Construct] = {}
        self.subs: dict[str, Construct] = {}
        self.labels: dict[str, int] = {}
        self.numbered: dict[int, list[int]] = {}
        self.macro: dict[int, MacroFlow] = {}
        self.loops: dict[int, int] = {}
        self._loop_starts: dict[int, int] = {}
        self._open: list[Construct] = []
        for index, line in enumerate(lines):
            if (numbered := _NUMBERED.match(line)) is not None:
                self.numbered.setdefault(int(numbered[1]), []).append(index)
            if _MACRO_LINE.search(line) and (macro := scan_macro(line, name, index + 1)) is not None:
                self._place_macro(index, macro)
                continue
            if _FLOW_LINE.match(line):
                flow = self.scan(index).flow
                if flow is not None:
                    self._place(index, flow)
        if self._open:
            remaining = self._open[-1]
            what = f"O{remaining.label} {remaining.keyword} is never closed"
            raise self._fault(remaining.start, what, 0, lines[remaining.start].strip())

    def _place_macro(self, index: int, macro: MacroFlow) -> None:
        """Note a line of the flow of a macro; a loop and its END find each other."""
        self.macro[index] = macro
        if macro.keyword in ("while", "do"):
            self._loop_starts[macro.loop] = index
        elif macro.keyword == "end":
            if macro.loop not in self._loop_starts:
                raise self._fault(index, f"END{macro.loop} closes no loop", 0, self.lines[index].strip())
            start = self._loop_starts.pop(macro.loop)
            self.loops[start], self.loops[index] = index, start

    def jump(self, number: int, index: int) -> int | None:
        """Return the index of a block number: the next one behind a line, else the first one of all."""
        places = self.numbered.get(number, [])
        return next((place for place in places if place > index), places[0] if places else None)

    def scan(self, index: int) -> ScannedLine:
        """Return the line as scanned; each line is scanned once."""
        line = self.scanned.get(index)
        if line is None:
            line = ScannedLine.scan(self.lines[index], self.name, index + 1)
            self.scanned[index] = line
        return line

    def _place(self, index: int, flow: FlowWord) -> None:
        keyword = flow.keyword
        if keyword in ("call", "return", "break", "continue"):
            return
        if not isinstance(flow.label, str):
            raise self._fault(index, "this O word needs a plain label", flow.column, self.lines[index].strip())
        label, column = flow.label, flow.column
        top = self._open[-1] if self._open else None
        if keyword == "":
            if label in self.labels:
                raise self._fault(index, "the O number is used twice", column, f"O{label}")
            self.labels[label] = index
        elif keyword == "while" and top is not None and (top.keyword, top.label) == ("do", label):
            self._close(index)
        elif keyword in ("sub", "while", "do", "if", "repeat"):
            self._begin(index, Construct(keyword, label, index), column)
        elif top is None or (top.keyword, top.label) != (_CLOSERS.get(keyword, "if"), label):
            opened = f"O{top.label} {top.keyword} (line {top.start + 1})" if top else "nothing"
            raise self._fault(index, f"O{label} {keyword} closes nothing of its own", column, f"{opened} open")
        elif keyword in ("else", "elseif"):
            self._branch(index, top, flow)
        else:
            self._close(index)

    def _fault(self, index: int, what: str, column: int, value: object = None) -> ProgramError:
        return error_at(self.name, index + 1, what, column, value)

    def _begin(self, index: int, construct: Construct, column: int) -> None:
        """Note the first line of a construct."""
        if construct.keyword == "sub":
            if construct.label in self.subs:
                raise self._fault(index, "the subroutine is defined twice", column, f"O{construct.label}")
            if self._open:
                raise self._fault(index, "a subroutine opens inside another O word", column, f"O{construct.label}")
            self.subs[construct.label] = construct
        self._open.append(construct)
        self.at[index] = construct

    def _branch(self, index: int, top: Construct, flow: FlowWord) -> None:
        """Note an else or elseif of a construct."""
        last = self.scan(top.branches[-1]).flow if top.branches else None
        if last is not None and last.keyword == "else":
            raise self._fault(index, f"O{top.label} {flow.keyword} follows its else", flow.column)
        top.branches.append(index)
        self.at[index] = top

    def _close(self, index: int) -> None:
        construct = self._open.pop()
        construct.end = index
        if construct.keyword == "if":
            construct.branches.append(index)
        self.at[index] = construct

    def loop_around(self, index: int, label: str) -> Construct | None:
        """Return the innermost loop of that label around a line."""
        around = [
            construct
            for construct in self.at.values()
            if construct.keyword in LOOPS and construct.label == label and construct.start < index < construct.end
        ]
        return max(around, key=lambda construct: construct.start, default=None)
