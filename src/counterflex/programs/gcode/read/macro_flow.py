"""Jumps and loops of Fanuc macros: IF GOTO, IF THEN, GOTO, WHILE DO and END.

Source: Fanuc, Operator's Manual, "Custom macro", "Branch and repetition".
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

from counterflex.programs.gcode.read.expression import Cursor, Expression
from counterflex.programs.gcode.read.scanner import ScannedLine, error_at, scan_line, strip_comments

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
    flow = _read(cursor, text, name, line)
    if cursor.peek():
        raise cursor.error("nothing may follow a jump or loop of a macro", repr(cursor.peek(12)))
    return flow


def _read(cursor: Cursor, text: str, name: str, line: int) -> MacroFlow:
    if cursor.take("goto"):
        return MacroFlow("goto", target=cursor.value())
    for keyword in ("do", "end"):
        if cursor.take(keyword):
            return MacroFlow(keyword, loop=int(_digit(cursor)))
    keyword = "if" if cursor.take("if") else "while"
    cursor.take("while")
    condition = cursor.value()
    if keyword == "while":
        if not cursor.take("do"):
            raise cursor.error("DO is expected behind WHILE [...]", repr(cursor.peek(8)))
        return MacroFlow("while", condition, loop=int(_digit(cursor)))
    if cursor.take("goto"):
        return MacroFlow("if", condition, cursor.value())
    if not cursor.take("then"):
        raise cursor.error("GOTO or THEN is expected behind IF [...]", repr(cursor.peek(8)))
    then = scan_line(" " * cursor.column + text[cursor.column :], name, line)
    cursor.place = len(cursor.text)
    return MacroFlow("if", condition, then=then)


def _digit(cursor: Cursor) -> str:
    digit = cursor.peek()
    if digit not in ("1", "2", "3"):
        raise cursor.error("the number of a loop is 1, 2 or 3", repr(digit))
    cursor.place += 1
    return digit
