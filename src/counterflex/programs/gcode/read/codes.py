"""Modal groups of the G and M codes that are read, and why the others are refused: the table as the reader asks for it.

Codes are kept as tenths: G43.1 is 431.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from counterflex.programs.gcode.read.code_table import G_CODES, M_CODES, Code
from counterflex.programs.statement_table import Treatment


def _tenths(word: str) -> int:
    whole, _, tenth = word[1:].partition(".")
    return 10 * int(whole) + int(tenth or 0)


def _plain(codes: Iterable[Code]) -> list[Code]:
    return [code for code in codes if " " not in code.word]


HAAS_OFFSETS: Final = {10 * number: number - 109 for number in range(110, 130) if number not in (112, 113)}
"""Number P of the further work offset that G110 to G129 select; G112 and G113 are Fanuc's polar interpolation."""
G_GROUP: Final = {_tenths(code.word): code.group for code in _plain(G_CODES) if code.group} | dict.fromkeys(
    HAAS_OFFSETS, "work offset"
)
"""Modal group of each G code that is read."""
M_GROUP: Final = {_tenths(code.word): code.group for code in _plain(M_CODES) if code.group}
"""Modal group of each M code that is read."""
REFUSED_G: Final = {
    _tenths(code.word): (code.reason, code.remedy) for code in G_CODES if code.treatment is Treatment.REFUSED
}
"""Reason and remedy of each G code that is refused."""
REFUSED_M: Final = {
    _tenths(code.word): (code.reason, code.remedy) for code in M_CODES if code.treatment is Treatment.REFUSED
}
"""Reason and remedy of each M code that is refused."""
NEUTRAL_BY_WORD: Final = {
    (_tenths(code.word.split()[0]), code.word.split()[1]): code.group for code in G_CODES if " " in code.word
}
"""Modal group of codes that are neutral with a word (``G5.1 Q1``), by code and letter."""
TAKEN_BY_G: Final = {
    _tenths(code.word.split()[0]): code.takes for code in G_CODES if code.treatment is Treatment.NEUTRAL and code.takes
}
"""Letters of the words that belong to a neutral G code."""

AXES: Final = "XYZABC"
CYCLES: Final = frozenset((730, 810, 820, 830, 850, 860, 890))
TAKES_AXES: Final = frozenset((100, 280, 300, 520, 920))


def code_name(letter: str, code: int) -> str:
    """Return the usual spelling of a code kept as tenths, ``G43.1`` or ``M3``."""
    whole, tenth = divmod(code, 10)
    return f"{letter}{whole}.{tenth}" if tenth else f"{letter}{whole}"
