"""Modal groups of the codes and words of Sinumerik, and why others are refused: the table as the reader asks for it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from counterflex.programs.gcode.sinumerik.cycles import NAMES
from counterflex.programs.gcode.sinumerik.word_table import CARRIED, CARRIED_VALUES, CODES, FURTHER_OFFSETS
from counterflex.programs.statement_table import Treatment


@dataclass(frozen=True)
class WordTable:
    """Words of a dialect that is read as Sinumerik is."""

    dialect: str  # Its name, for errors
    group: Mapping[str, str]  # Modal group of each code or word that is read
    carried: frozenset[str]  # Words that change no target
    carried_values: frozenset[str]  # The same with a value
    refused: Mapping[str, tuple[str, str]]  # Words that are known and not taken, with the reason and what to do
    m_codes: frozenset[int]  # M codes that are read
    cycles: tuple[str, ...]  # Beginnings of the names of machining cycles
    drilling: tuple[str, ...] = ()  # Names of cycles that are read
    subprograms: bool = False  # Other names call subprograms


GROUP: Final = {code.word: code.group for code in CODES if code.group} | dict.fromkeys(FURTHER_OFFSETS, "work offset")
"""Modal group of each code or word that is read."""
REFUSED: Final = {code.word: (code.reason, code.remedy) for code in CODES if code.treatment is Treatment.REFUSED}
"""Words that the reader knows and does not take, with the reason and what to do."""
_MOVES: Final = "Let the CAM system write the moves of the cycle"
_UNROLLED: Final = "Post the program without subprograms, jumps and calculations"
REFUSED_CYCLE: Final = ("machining cycles are not read", _MOVES)
REFUSED_CALL: Final = ("a subprogram is called, and subprograms are not read", _UNROLLED)
AXES: Final = "XYZ"
ROTARY: Final = "ABC"
VECTOR: Final = ("A3", "B3", "C3")
M_CODES: Final = frozenset((0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 17, 19, 30, *range(40, 46)))
M_END: Final = frozenset((2, 17, 30))
SINUMERIK: Final = WordTable(
    "Sinumerik", GROUP, CARRIED, CARRIED_VALUES, REFUSED, M_CODES,
    ("CYCLE", "HOLES", "SLOT", "POCKET", "LONGHOLE", "ORI"), NAMES, subprograms=True,
)  # fmt: skip
