"""One line of RS274/NGC text into words, assignments, flow words and comments.

Blanks count for nothing outside comments, even inside numbers; letters count in either case. A plain line (letters
and numbers only) is read by one regular expression; every other line by the full scanner. Both give the same.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

from counterflex.core.errors import ProgramError
from counterflex.programs.gcode.read.expression import Cursor, Expression, NamedParameter, Number, NumberedParameter
from counterflex.programs.limits import LINUXCNC
from counterflex.programs.program import Word

_NUMBER: Final = r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)"
_PLAIN_LINE: Final = re.compile(rf"[ \t]*(?:[A-NP-Za-np-z][ \t]*{_NUMBER}[ \t]*)+")
_PLAIN_WORD: Final = re.compile(rf"([A-Za-z])[ \t]*({_NUMBER})")
_LEVEL: Final = re.compile(r"/[1-9][a-z#]")
"""Begin of a line with the number of a switch for block delete."""
_FILE_NAME: Final = re.compile(r"<[A-Za-z0-9+_.-]{1,32}>")
"""Name of a program that stands alone in its line (Fanuc 30i: letters, digits, + - _ and a point, 32 at most)."""
_PROGRAM_SIGN: Final = re.compile(r"%(?!_n_)[a-z0-9_.-]*")
"""Sign before the program and behind it, with its number or name (DIN 66025); ``%_N_`` begins a Sinumerik program."""
_BLANK: Final = " \t\r"
_LONGEST_LINE: Final = LINUXCNC.line_characters  # it also bounds how deep an expression can become
FLOW_KEYWORDS: Final = (
    "endsub", "endwhile", "endif", "endrepeat", "elseif", "else", "sub", "call", "return", "while", "do", "if",
    "repeat", "break", "continue",
)  # fmt: skip


@dataclass(frozen=True)
class ScannedWord:
    """A letter and what follows it; ``value`` is None where ``expression`` must be evaluated first."""

    letter: str
    value: float | None
    expression: Expression | None
    start: int
    end: int

    @classmethod
    def of(cls, cursor: Cursor) -> ScannedWord:
        """Read a letter and its value; the cursor stands on the letter."""
        letter, start = cursor.peek().upper(), cursor.column
        cursor.place += 1
        value = cursor.value()
        end = cursor.columns[cursor.place - 1] + 1
        number = value.value if isinstance(value, Number) else None
        return cls(letter, number, value if number is None else None, start, end)


@dataclass(frozen=True)
class Assignment:
    """``#target = value``; takes effect when the whole line has been read."""

    target: NumberedParameter | NamedParameter
    value: Expression
    column: int

    @classmethod
    def of(cls, cursor: Cursor) -> Assignment:
        """Read ``#1=...``; the cursor stands on the sign."""
        column = cursor.column
        target = cursor.parameter()
        if not cursor.take("="):
            raise cursor.error("= is expected after a parameter", repr(cursor.peek(8) or "end of line"))
        return cls(target, cursor.assigned(), column)


@dataclass(frozen=True)
class FlowWord:
    """``O label keyword [arguments]``; ``keyword`` is empty for a bare ``O100`` that opens an M98 subprogram."""

    label: str | Expression
    keyword: str
    arguments: tuple[Expression, ...]
    column: int

    @classmethod
    def of(cls, cursor: Cursor) -> FlowWord:
        """Read an O word; the cursor stands on the letter."""
        column = cursor.column
        cursor.place += 1
        label: str | Expression
        if cursor.peek() == "<":
            label = cursor.name()
        else:
            number = cursor.value()
            label = f"{number.value:g}" if isinstance(number, Number) and number.value == int(number.value) else number
            if isinstance(number, Number) and number.value < 0.0:
                raise cursor.fault("an O word's number is negative", column, f"{number.value:g}", None)
        for keyword in FLOW_KEYWORDS:
            if cursor.take(keyword):
                break
        else:
            if cursor.peek():
                raise cursor.error(
                    "an unknown O word", repr(cursor.peek(12)), "One of: " + " ".join(sorted(FLOW_KEYWORDS))
                )
            keyword = ""
        arguments: list[Expression] = []
        while cursor.peek() == "[":
            arguments.append(cursor.value())
        most = {"call": 30, "while": 1, "if": 1, "elseif": 1, "repeat": 1, "return": 1, "endsub": 1}.get(keyword, 0)
        least = 1 if keyword in ("if", "elseif", "repeat", "while") else 0
        if not least <= len(arguments) <= most:
            raise cursor.fault(
                f"O... {keyword} has the wrong number of values", column, len(arguments), f"Write {least} to {most}"
            )
        return cls(label, keyword, tuple(arguments), column)


@dataclass(frozen=True)
class ScannedLine:
    """Words of a line, before anything is evaluated."""

    words: tuple[ScannedWord, ...] = ()
    assignments: tuple[Assignment, ...] = ()
    flow: FlowWord | None = None
    comments: tuple[str, ...] = ()
    block_delete: bool = False
    percent: bool = False

    @classmethod
    def scan(cls, text: str, name: str, line: int) -> ScannedLine:
        """Read any line with the full scanner.

        Args:
            text: The line without its end.
            line: 1-based number of the line, for errors.

        Raises:
            ProgramError: With file, line and column of the first thing that is not RS274/NGC.
        """
        clean, columns, comments = strip_comments(text, name, line)
        if len(clean) > _LONGEST_LINE:
            raise error_at(name, line, "the line is too long", columns[_LONGEST_LINE], f"{len(clean)} characters")
        cursor = Cursor(
            clean, columns, lambda what, column, value, hint: error_at(name, line, what, column, value, hint)
        )
        block_delete = cursor.take("/")
        if block_delete and _LEVEL.match(clean):  # Fanuc: one of nine switches
            cursor.place += 1
        if _PROGRAM_SIGN.fullmatch(clean):
            return cls(comments=tuple(comments), percent=True)
        if _FILE_NAME.fullmatch(text.strip()):
            return cls(comments=(text.strip(),))
        words, assignments, flow = _parts(cursor, text)
        return cls(tuple(words), tuple(assignments), flow, tuple(comments), block_delete)


def error_at(
    name: str, line: int, what: str, column: int, value: object = None, hint: str | None = None
) -> ProgramError:
    """Make an error at ``name:line:column``; ``column`` is 0-based and printed 1-based."""
    return ProgramError(what, where=f"{name}:{line}:{column + 1}", value=value, hint=hint)


def scan_plain(text: str) -> tuple[Word, ...] | None:
    """Read a line that holds nothing but letters and literal numbers.

    Returns:
        Its words; None where the line needs the full scanner.
    """
    if _PLAIN_LINE.fullmatch(text) is None or len(text) > _LONGEST_LINE:
        return None
    return tuple(
        [Word(match[1].upper(), float(match[2]), match.start(), match.end()) for match in _PLAIN_WORD.finditer(text)]
    )


def strip_comments(text: str, name: str, line: int) -> tuple[str, list[int], list[str]]:
    """Return the line in lower case without comments and blanks, the column of each character, and the comments.

    Raises:
        ProgramError: A comment is not closed, or holds another opening bracket.
    """
    selected: list[str] = []
    columns: list[int] = []
    comments: list[str] = []
    place, end = 0, len(text)
    while place < end:
        character = text[place]
        if character == ";":
            comments.append(text[place + 1 :].strip())
            break
        if character == "(":
            close = text.find(")", place)
            inner = text.find("(", place + 1)
            if close < 0:
                raise error_at(name, line, "the comment is not closed", place, repr(text[place : place + 20]))
            if 0 <= inner < close:
                raise error_at(
                    name, line, "a comment opens inside a comment", inner, repr(text[place : close + 1][:40]),
                    "Use other brackets inside comments",
                )  # fmt: skip
            comments.append(text[place + 1 : close])
            place = close + 1
            continue
        if character not in _BLANK:
            if not " " < character < "\x7f":
                raise error_at(name, line, "a character that G-code does not know", place, repr(character))
            selected.append(character.lower())
            columns.append(place)
        place += 1
    columns.append(place)
    return "".join(selected), columns, comments


def _parts(cursor: Cursor, text: str) -> tuple[list[ScannedWord], list[Assignment], FlowWord | None]:
    """Read words, assignments and an O word to the end of the line."""
    words: list[ScannedWord] = []
    assignments: list[Assignment] = []
    flow: FlowWord | None = None
    while character := cursor.peek():
        if character == "#":
            assignments.append(Assignment.of(cursor))
        elif character == "o" or (character == ":" and cursor.place == 0):
            if flow is not None or assignments or any(word.letter != "N" for word in words):
                raise cursor.error("an O word must come first on its line", repr(text.strip()[:30]))
            flow = FlowWord.of(cursor)
        elif not "a" <= character <= "z":
            raise _no_letter(cursor)
        elif flow is not None:
            raise cursor.error("nothing may follow an O word's own arguments", repr(cursor.peek(12)))
        else:
            words.append(ScannedWord.of(cursor))
    return words, assignments, flow


def _no_letter(cursor: Cursor) -> ProgramError:
    """Name what stands where a letter must be."""
    if cursor.peek() == "," and cursor.peek(2)[1:].isdigit():
        return cursor.error("a decimal comma", repr(cursor.peek(8)), "Write numbers with a point, X1.5")
    if cursor.peek(2) in (",c", ",r", ",a"):
        return cursor.error(
            "chamfers ,C, rounded corners ,R and angles ,A of one control are not read",
            repr(cursor.peek(8)),
            "Let the CAM system write the moves",
        )
    if cursor.peek() == "$":
        return cursor.error("a command of GRBL or a name of another control", repr(cursor.peek(8)), "Take it out")
    return cursor.error("a letter is expected", repr(cursor.peek()))
