"""Offsets, coolant and end that a program states: what a controller takes from its own memory, by number or name.

Sources: LinuxCNC, G-codes (G43, G43.1, G49, G54 to G59.3, G10 L2 and L20); SINUMERIK 840D sl, Programming Manual
Fundamentals (D0 cancels the tool offset; D1 is active after a tool change, MD20270; G54 to G57, G505 to G599); TwinCAT
NC I (D, G54 to G57). Robot programs name their tool and base by frames, which their readers compare with the cell.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Int
from counterflex.programs.comment_diameters import diameters_of
from counterflex.programs.gcode.read.reader import doubtful_readings
from counterflex.programs.program import ROBOT_DIALECTS, Block, Program

NONE: Final = -1
"""No tool length offset is active."""
OWN: Final = -2
"""The offset belongs to the tool itself: another tool's cannot be meant."""
UNSAID: Final = -3
"""The language has no word for it."""
_LINUXCNC: Final = "linuxcnc"
_SINUMERIK: Final = "sinumerik"
_OF_TOOL: Final = (43.0, 43.4, 43.5, 44.0)
_GIVEN: Final = 43.1
_CANCEL: Final = 49.0
_OFFSETS: Final = (*range(54, 60), 59.1, 59.2, 59.3)
_ENDS: Final = (2.0, 30.0, 99.0)
_COOLANT: Final = {7.0: 1, 8.0: 1, 9.0: 0}
_STOPS: Final = frozenset({0.0, 1.0, 60.0, 66.0})
_WAITS: Final = {
    "krl": re.compile(r"\s*WAIT\s+FOR\b(?!\s*\(?\s*TRUE\s*\)?\s*(?:;|$))", re.IGNORECASE),
    "rapid": re.compile(
        r"\s*(?:\w+\s*:\s*)?Wait(?:DI|DO|GI|GO|AI|AO|Until|SyncTask|Sensor|TestAndSet|Load)\b", re.IGNORECASE
    ),
    "fanuc": re.compile(r"[\s\d:]*(?:WAIT\b(?!\s*[\d.]+\s*\(\s*sec)|PAUSE\b)", re.IGNORECASE),
    "val3": re.compile(r"\s*(?:wait|watch|get|popUpMsg)\s*\(", re.IGNORECASE),
}
"""Statements that wait for a person or a signal, for a time that nobody knows, by dialect; ``WAIT FOR TRUE`` only stops
the advance run of KRL."""


@dataclass(frozen=True, eq=False)
class Stated:
    """Statements of a program beside its motions.

    Attributes:
        length_offset: (motions,) number of the tool length offset, or :data:`NONE`, :data:`OWN`, :data:`UNSAID`.
        work_offset: (motions,) index into ``offsets``.
        offsets: Names of the work offsets in use, in the order in which they appear; ``""`` where none is named.
        defined: Of these, those whose place in the part is known.
        coolant: (motions,) 1 on, 0 off, :data:`UNSAID` where the program has no word of coolant.
        spindle_on_at_end: The program ends without stopping the spindle, by M5 or by its end.
        robot: In a language of robots.
        stops: (motions,) a person or a signal is waited for at the end of the motion (M0, M1, M60, M66; HALT, Stop,
            PAUSE; WAIT FOR, WaitDI, WAIT DI).
        diameters_m: By tool number, the diameter that a comment of the program names, with its line.
        doubts: Readings of words that controllers read in two ways, one sentence each.
    """

    length_offset: Int
    work_offset: Int
    offsets: tuple[str, ...]
    defined: frozenset[str]
    coolant: Int
    spindle_on_at_end: bool
    robot: bool
    stops: Bool
    diameters_m: Mapping[int, tuple[float, int]]
    doubts: tuple[str, ...] = ()


def stated(program: Program, known_offsets: bool = False) -> Stated:
    """Return what a program states of offsets, coolant and its end.

    Args:
        program: As read.
        known_offsets: All work offsets are known, from a parameter file of the machine.
    """
    n = len(program.motions)
    lengths, works, coolants = (np.full(n, UNSAID, dtype=np.int64) for _ in range(3))
    reader = _OffsetReader(program.dialect)
    coolant, cools = 0, any(_codes(block, "M") & set(_COOLANT) for block in program.blocks)
    names: list[str] = []
    stops = np.zeros(n, dtype=np.bool_)
    for block in program.blocks:
        reader.take(block)
        behind = block.first_motion + block.motion_count - 1
        if behind >= 0 and _waits(block, program.dialect):
            stops[behind] = True
        coolant = next((_COOLANT[code] for code in _codes(block, "M") if code in _COOLANT), coolant)
        if not block.motion_count:
            continue
        rows = slice(block.first_motion, block.first_motion + block.motion_count)
        if reader.offset not in names:
            names.append(reader.offset)
        lengths[rows], works[rows] = reader.length, names.index(reader.offset)
        coolants[rows] = coolant if cools else UNSAID
    defined = frozenset(names) if known_offsets else frozenset(names) & {"", "G54", *reader.defined}
    last = program.blocks[-1].modal.spindle_rpm if program.blocks else 0.0
    ended = any(_codes(block, "M") & set(_ENDS) for block in program.blocks)
    return Stated(lengths, works, tuple(names), defined, coolants, last != 0.0 and not ended,
                  program.dialect in ROBOT_DIALECTS, stops, diameters_of(program),
                  tuple(doubtful_readings(program)))  # fmt: skip


def _waits(block: Block, dialect: str) -> bool:
    """A person or a signal is waited for."""
    if _codes(block, "M") & _STOPS:
        return True
    form = _WAITS.get(dialect)
    return form is not None and form.match(block.text) is not None


def _codes(block: Block, letter: str) -> set[float]:
    return {round(word.value, 1) for word in block.words if word.letter == letter}


def _value(block: Block, letter: str) -> int | None:
    return next((round(word.value) for word in block.words if word.letter == letter), None)


class _OffsetReader:
    """Follows the active offsets from block to block."""

    def __init__(self, dialect: str) -> None:
        self.length, self.offset, self.defined = UNSAID, "", set[str]()
        self._step: Callable[[Block], None] = {
            _LINUXCNC: self._iso, _SINUMERIK: self._sinumerik, "twincat": self._twincat,
        }.get(dialect, self._nothing)  # fmt: skip
        if dialect in (_LINUXCNC, "twincat"):
            self.length = NONE
        elif dialect == _SINUMERIK:
            self.length = OWN
        if dialect == _LINUXCNC:
            self.offset = "G54"

    def take(self, block: Block) -> None:
        self._step(block)

    def _nothing(self, block: Block) -> None:
        """The language has no offsets of numbers."""

    def _iso(self, block: Block) -> None:
        codes = _codes(block, "G")
        if codes & set(_OF_TOOL):
            number = _value(block, "H")
            self.length = OWN if number is None else number or NONE
        elif _GIVEN in codes:
            self.length = OWN
        elif _CANCEL in codes:
            self.length = NONE
        elif self.length > 0 and (number := _value(block, "H")) is not None:
            self.length = number or NONE
        if 10.0 in codes and _value(block, "L") in (2, 20):
            number = _value(block, "P")
            self.defined |= {self.offset} if not number else {_named(_OFFSETS[number - 1])} if number <= 9 else set()
        for code in codes & set(_OFFSETS):
            self.offset = _named(code)
        if 54.1 in codes:
            self.offset = f"G54.1 P{_value(block, 'P')}"

    def _sinumerik(self, block: Block) -> None:
        number = _value(block, "D")
        if number is not None:
            self.length = OWN if number else NONE
        self._settable(block)

    def _twincat(self, block: Block) -> None:
        number = _value(block, "D")
        if number is not None:
            self.length = OWN if number else NONE
        self._settable(block)

    def _settable(self, block: Block) -> None:
        for code in _codes(block, "G"):
            if 54 <= code <= 57 or 505 <= code <= 599:
                self.offset = _named(code)


def _named(code: float) -> str:
    return f"G{code:g}"
