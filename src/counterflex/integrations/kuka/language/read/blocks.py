"""Blocks of a routine: which lines IF, SWITCH and loops, their branches and their ends belong to; labels."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final

from counterflex.core.errors import ProgramError
from counterflex.integrations.kuka.language.read import statements as form

_CLOSES: Final = {closing: opening for opening, closing in form.OPENS.items()}
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
        if word in form.OPENS:
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
        elif word == form.LABELS and (match := form.LABEL.fullmatch(codes[line - 1])) is not None:
            out.labels[match[1].upper()] = line
    if open_:
        raise fault(f"{open_[-1].word} is not closed", open_[-1].start, "The file may be cut off")
    return out


def _innermost(blocks: Sequence[StatementBlock]) -> str:
    return blocks[-1].word if blocks else ""


def _left_loops(word: str, line: int, blocks: Sequence[StatementBlock], fault: Fault) -> list[StatementBlock]:
    """Loops that EXIT, RETURN or GOTO may leave: EXIT the innermost one, the others all."""
    loops = [block for block in blocks if block.word in form.LOOPS]
    if word != "EXIT":
        return loops
    if not loops:
        raise fault("EXIT belongs into a loop", line, "Post the program again")
    return loops[-1:]
