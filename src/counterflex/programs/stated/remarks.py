"""Offsets, coolant and end that a program states: what a controller takes from its own memory, by number or name.

Robot programs name their tool and base by frames, which their readers compare with the cell.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Int
from counterflex.programs.language import LANGUAGES
from counterflex.programs.program import Block, Program
from counterflex.programs.robot_text.program import RobotProgram
from counterflex.programs.stated.diameters import diameters_of
from counterflex.programs.stated.offsets import UNSAID, codes_of, offset_reader
from counterflex.programs.stated.two_readings import doubtful_readings

_ENDS: Final = (2.0, 30.0, 99.0)
_COOLANT: Final = {7.0: 1, 8.0: 1, 9.0: 0}
_STOPS: Final = frozenset({0.0, 1.0, 60.0, 66.0})


@dataclass(frozen=True, eq=False)
class Stated:
    """Statements of a program beside its motions.

    Attributes:
        length_offset: (motions,) number of the tool length offset, or NONE, OWN or UNSAID of
            :mod:`~counterflex.programs.stated.offsets`.
        work_offset: (motions,) index into ``offsets``.
        offsets: Names of the work offsets in use, in the order in which they appear; ``""`` where none is named.
        defined: Of these, those whose place in the part is known.
        coolant: (motions,) 1 on, 0 off, UNSAID where the program has no word of coolant.
        spindle_on_at_end: The program ends without stopping the spindle, by M5 or by its end.
        robot: In a language of robots.
        stops: (motions,) a person or a signal is waited for at the end of the motion (M0, M1, M60, M66; HALT, Stop,
            PAUSE; WAIT FOR, WaitDI, WAIT DI).
        waits_first: The same before the first motion.
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
    waits_first: bool = False


def stated(program: Program, known_offsets: bool = False) -> Stated:
    """Return what a program states of offsets, coolant and its end.

    Args:
        program: As read.
        known_offsets: All work offsets are known, from a parameter file of the machine.
    """
    n = len(program.motions)
    lengths, works, coolants = (np.full(n, UNSAID, dtype=np.int64) for _ in range(3))
    waits = LANGUAGES[program.dialect].waits
    reader = offset_reader(program.dialect)
    coolant, cools = 0, any(codes_of(block, "M") & set(_COOLANT) for block in program.blocks)
    names: list[str] = []
    stops, waits_first = np.zeros(n, dtype=np.bool_), False
    for block in program.blocks:
        reader.take(block)
        behind = block.first_motion + block.motion_count - 1
        if _waits(block, waits):
            waits_first = waits_first or behind < 0
            stops[behind : behind + 1] = True  # nothing before the first motion
        coolant = next((_COOLANT[code] for code in codes_of(block, "M") if code in _COOLANT), coolant)
        if not block.motion_count:
            continue
        rows = slice(block.first_motion, block.first_motion + block.motion_count)
        if reader.offset not in names:
            names.append(reader.offset)
        lengths[rows], works[rows] = reader.length, names.index(reader.offset)
        coolants[rows] = coolant if cools else UNSAID
    defined = frozenset(names) if known_offsets else frozenset(names) & {"", "G54", *reader.defined}
    last = program.blocks[-1].modal.spindle_rpm if program.blocks else 0.0
    ended = any(codes_of(block, "M") & set(_ENDS) for block in program.blocks)
    return Stated(lengths, works, tuple(names), defined, coolants, last != 0.0 and not ended,
                  isinstance(program, RobotProgram), stops, diameters_of(program),
                  tuple(doubtful_readings(program)), waits_first)  # fmt: skip


def _waits(block: Block, form: re.Pattern[str] | None) -> bool:
    """A person or a signal is waited for."""
    if codes_of(block, "M") & _STOPS:
        return True
    return form is not None and form.match(block.text) is not None
