"""Forms of KRL statements, and the word of the table that each one stands under."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final

from counterflex.core.errors import ProgramError
from counterflex.programs.robot_text.process_words import NUMBER

_I: Final = re.IGNORECASE
NAME: Final = r"[A-Za-z$]\w*(?:\s*\[\s*\d+\s*\])?"
HEADER: Final = re.compile(r"\s*&")
ROUTINE: Final = re.compile(r"\s*(?:GLOBAL\s+)?DEF\s+(\w+)\s*(?:\(.*\))?\s*", _I)
MOTION: Final = re.compile(r"\s*(S?PTP|S?LIN|S?CIRC)(_REL)?(?=[\s{$]|$)", _I)
SPLINE_BEGINS: Final = re.compile(r"\s*SPLINE\b(.*)", _I)
SPLINE_ENDS: Final = re.compile(r"\s*ENDSPLINE\b\s*((?:C_(?:DIS|PTP|VEL|ORI|SPL)\s*)*)", _I)
IN_SPLINE: Final = frozenset(
    ("PTP", "LIN", "CIRC", "SPTP", "SLIN", "SCIRC", "SPL", "SPLINE", "PTP_SPLINE", "ENDSPLINE", "SLIN_REL", "SCIRC_REL",
     "SPL_REL", "TIME_BLOCK START", "TIME_BLOCK PART", "TIME_BLOCK END", "CONST_VEL START", "CONST_VEL END",
     "TRIGGER WHEN DISTANCE", "TRIGGER WHEN PATH", "STOP WHEN PATH")
)  # fmt: skip
WITH_OTHERS: Final = re.compile(r"\s*(?:WITH\s+(\$(?:VEL|ACC|ORI_TYPE|GEAR_JERK|JERK|VEL_AXIS|ACC_AXIS)\b.*))?", _I)
APPROXIMATION: Final = re.compile(r"\s*((?:C_(?:DIS|PTP|VEL|ORI|SPL)\s*)*)", _I)
CIRCLE_ANGLE: Final = re.compile(r"\s*,\s*CA\s+(.+?)\s*(?=C_(?:DIS|PTP|VEL|ORI|SPL)\b|\bWITH\b|$)", _I)
CIRCLE_NUMBER: Final = re.compile(NUMBER)
IN_TOOL: Final = re.compile(r"\s*#\s*(BASE|TOOL)\b", _I)
ASSIGNMENT: Final = re.compile(
    r"\s*(?P<name>[A-Za-z_$]\w*)(?P<path>(?:\s*\.\s*\w+|\s*\[[^\]=]*(?:\[[^\]]*\][^\]]*)*\])*)\s*=(?!=)\s*(?P<value>.*)",
    _I,
)
CALL: Final = re.compile(r"\s*(\w+)\s*\((.*)\)\s*", _I)
BASIC: Final = re.compile(r"\s*BAS\s*\(\s*#\s*(\w+)\s*(?:,\s*(.*?)\s*)?\)\s*", _I)
WAIT_TIME: Final = re.compile(r"\s*WAIT\s+SEC\b\s*(.+?)\s*", _I)
TRIGGER: Final = re.compile(r"\s*TRIGGER\s+WHEN\s+(.*?)\s+DO\s+(.*?)(?:\s+PRIO\s*=.*)?\s*", _I)
AT_START: Final = re.compile(r"DISTANCE\s*=\s*0(\.0*)?\s+DELAY.*|PATH\s*=.*\bONSTART\b.*", _I)
INTERRUPT: Final = re.compile(r"\s*(?:GLOBAL\s+)?INTERRUPT\s+(?:WITH\s+.*?\s+)?DECL\s+.*?\bDO\s+(.*)", _I)
STANDARD: Final = re.compile(r"\s*(?:GLOBAL\s+INTERRUPT\s+DECL\s+3\s+WHEN\s+\$STOPMESS\b|INTERRUPT\s+ON\s+3\s*$)", _I)
"""The stop interrupt that every KUKA program sets up."""
FOR: Final = re.compile(r"\s*FOR\s+(\w+)\s*=\s*(.+?)\s+TO\s+(.+?)(?:\s+STEP\s+(.+?))?\s*", _I)
CONDITION: Final = re.compile(r"\s*(?:IF\s*(.*?)\s*\bTHEN|(?:WHILE|UNTIL|SWITCH)\b\s*(.*))\s*", _I)
CASE: Final = re.compile(r"\s*CASE\b\s*(.*)", _I)
JUMP: Final = re.compile(r"\s*GOTO\s+(\w+)\s*", _I)
LABEL: Final = re.compile(r"\s*(\w+)\s*:\s*", _I)
RETURN: Final = re.compile(r"\s*RETURN\b\s*(.*?)\s*", _I)
OPENS: Final = {
    "IF": "ENDIF", "FOR": "ENDFOR", "WHILE": "ENDWHILE", "LOOP": "ENDLOOP", "REPEAT": "UNTIL", "SWITCH": "ENDSWITCH",
}  # fmt: skip
"""Word that closes each block."""
LOOPS: Final = ("FOR", "WHILE", "LOOP", "REPEAT")

_FIRST: Final = re.compile(r"\s*([A-Za-z_$]\w*)")
_SECOND: Final = {
    "WAIT": re.compile(r"\s*WAIT\s*(SEC|FOR|\()", _I),
    "INTERRUPT": re.compile(r"\s*INTERRUPT\s+(?:WITH\s+.*?\s+)?(DECL|ON|OFF|ENABLE|DISABLE)\b", _I),
    "TRIGGER": re.compile(r"\s*TRIGGER\s+(WHEN\s+(?:DISTANCE|PATH))\b", _I),
    "SYN": re.compile(r"\s*SYN\s+(OUT|PULSE)\b", _I),
    "TIME_BLOCK": re.compile(r"\s*TIME_BLOCK\s+(START|PART|END)\b", _I),
    "CONST_VEL": re.compile(r"\s*CONST_VEL\s+(START|END)\b", _I),
    "ANOUT": re.compile(r"\s*ANOUT\s+(ON|OFF)\b", _I),
    "ANIN": re.compile(r"\s*ANIN\s+(ON|OFF)\b", _I),
    "STOP": re.compile(r"\s*STOP\s+(WHEN\s+PATH)\b", _I),
    "BAS": re.compile(r"\s*BAS\s*\(\s*(#\s*\w+)", _I),
}  # fmt: skip
_GLOBAL: Final = re.compile(r"\s*GLOBAL\b", _I)
_DECLARES: Final = re.compile(
    r"\s*(?:DECL\b|GLOBAL\b|CONST\b|[A-Za-z]\w*(?:\s*\[[\s\d,]*\])?\s+[A-Za-z$]\w*\s*(?:\[[\s\d,]*\])?\s*(?:,|=(?!=)|$))",
    _I,
)
ASSIGNS: Final = "NAME ="
DECLARES: Final = "DECL"
LABELS: Final = "LABEL:"
CALLS: Final = "NAME( )"
_TYPES: Final = frozenset(
    ("INT", "REAL", "BOOL", "CHAR", "FRAME", "POS", "E6POS", "AXIS", "E6AXIS", "FDAT", "LDAT", "PDAT")
)


def word_of(code: str, words: frozenset[str]) -> str:
    """Return the word under which the table has a statement.

    Args:
        code: The statement without its comment.
        words: All words of the table, in capitals.

    Returns:
        A word; empty where the statement has no known form. It need not be in the table.
    """
    match = _FIRST.match(code)
    if match is None:
        return ""
    first = match[1].upper()
    behind = code[match.end() :].lstrip()[:1]
    if behind not in ("=", ".", "[") or first in ("IF", "WHILE", "UNTIL", "CASE"):
        keyword = _keyword(code, first, words)
        if keyword:
            return keyword
    if ASSIGNMENT.match(code) is not None and not (behind.isalpha() or behind == "$"):
        return first if first.startswith("$") else ASSIGNS
    if first in _TYPES or _DECLARES.match(code) is not None:
        return DECLARES
    if LABEL.fullmatch(code) is not None:
        return LABELS
    return CALLS if CALL.fullmatch(code) is not None else ""


def _keyword(code: str, first: str, words: frozenset[str]) -> str:
    """Word of a statement that begins with a word of the language, with a second one where it has two."""
    if first == "GLOBAL":
        inner = _GLOBAL.sub("", code)
        return DECLARES if _FIRST.match(inner) is None else word_of(inner, words)
    second = _SECOND[first].match(code) if first in _SECOND else None
    if second is not None:
        return f"{first} {' '.join(second[1].split()).upper()}".replace(" (", " FOR").replace("# ", "#")
    return first if first in words and not first.startswith("$") and first not in _TYPES else ""


_CLOSES: Final = {closing: opening for opening, closing in OPENS.items()}
_BRANCHES: Final = {"ELSE": "IF", "CASE": "SWITCH", "DEFAULT": "SWITCH"}
Fault = Callable[[str, int, str], ProgramError]
"""Makes the error of a message, a line and a hint."""


@dataclass
class StatementBlock:
    """A block."""

    word: str  # ``IF`` and so on
    start: int  # Its line
    end: int = 0  # Line of ENDIF and so on
    branches: list[int] = field(default_factory=list)  # Lines of ELSE, CASE and DEFAULT


@dataclass
class Blocks:
    """The blocks of a routine."""

    # The block of each line that begins, divides or ends one, and of EXIT the loop that it leaves
    of: dict[int, StatementBlock] = field(default_factory=dict)
    labels: dict[str, int] = field(default_factory=dict)  # Line of each label, in capitals
    # Lines of the loops that an EXIT, RETURN or GOTO within them may leave
    leaves: set[int] = field(default_factory=set)


def blocks_of(words: Sequence[str], codes: Sequence[str], first: int, end: int, fault: Fault) -> Blocks:
    """Read the blocks of lines ``first`` to ``end - 1`` (1-based).

    Args:
        words: Word of each line of the file.
        codes: Lines without comments.
        first: Behind DEF.
        end: Line of END.
        fault: Makes an error.

    Raises:
        ProgramError: Blocks are not closed, or closed by another word.
    """
    out = Blocks()
    open_: list[StatementBlock] = []
    for line in range(first, end):
        word = words[line - 1]
        if word in OPENS:
            block = out.of[line] = StatementBlock(word, line)
            open_.append(block)
        elif word in _CLOSES:
            if _innermost(open_) != _CLOSES[word]:
                raise fault(f"{word} closes nothing", line, "The file may be damaged: post it again")
            open_[-1].end = line
            out.of[line] = open_.pop()
        elif word in _BRANCHES:
            if _innermost(open_) != _BRANCHES[word]:
                raise fault("this belongs into IF or SWITCH", line, "Post the program again")
            open_[-1].branches.append(line)
            out.of[line] = open_[-1]
        elif word in ("EXIT", "RETURN", "GOTO"):
            left = _left_loops(word, line, open_, fault)
            if word == "EXIT":
                out.of[line] = left[0]
            out.leaves.update(block.start for block in left)
        elif word == LABELS and (match := LABEL.fullmatch(codes[line - 1])) is not None:
            out.labels[match[1].upper()] = line
    if open_:
        raise fault(f"{open_[-1].word} is not closed", open_[-1].start, "The file may be cut off")
    return out


def _innermost(blocks: Sequence[StatementBlock]) -> str:
    return blocks[-1].word if blocks else ""


def _left_loops(word: str, line: int, blocks: Sequence[StatementBlock], fault: Fault) -> list[StatementBlock]:
    """Loops that EXIT, RETURN or GOTO may leave: EXIT the innermost one, the others all."""
    loops = [block for block in blocks if block.word in LOOPS]
    if word != "EXIT":
        return loops
    if not loops:
        raise fault("EXIT belongs into a loop", line, "Post the program again")
    return loops[-1:]
