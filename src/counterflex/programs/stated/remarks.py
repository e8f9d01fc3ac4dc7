"""Offsets, coolant and end that a program states: what a controller takes from its own memory, by number or name.

Robot programs name their tool and base by frames, which their readers compare with the cell.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Int
from counterflex.core.units import MM
from counterflex.programs.language import LANGUAGES, object_at
from counterflex.programs.program import Block, Program
from counterflex.programs.robot_text.program import RobotProgram
from counterflex.programs.stated.offsets import UNSAID, codes_of, offset_reader
from counterflex.programs.stated.two_readings import doubtful_readings

# Diameters of the tools that a program names in comments or statements: those that its post-processor was given.
# Forms: ``(T1 D=16. CR=0. - flat end mill)`` of Fusion and its relatives, ``(Compensated Tool Path. Diameter: 16.0
# mm)``
# of FreeCAD, ``(TOOL - 1 DIA. OFF. - 1 LEN. - 1 DIA. - 16.)`` of Mastercam, ``(T1: end mill D16, 3 flutes)`` of people;
# ``CUTTER/16`` and ``TLDATA/MILL,16`` of APT.

_NUMBER: Final = r"(\d+(?:\.\d*)?|\.\d+)"
_COMMENT: Final = re.compile(r"\(([^()]*)\)|(?:;|!|\$\$|//)\s?(.*)$")
_TOOL: Final = re.compile(r"\bT(?:OOL)?\s*[-:#=]?\s*(\d+)\b", re.IGNORECASE)
_DIAMETER: Final = re.compile(
    rf"(?:\bDIA(?:M(?:ETER)?)?\b\.?\s*[-:=]?\s*|\bD\s*=\s*|\b(?:MILL|CUTTER|DRILL|BALL|FLAT)\s+D\s?|[\u00d8\u2300]\s?)"
    rf"{_NUMBER}\s*(MM|IN(?:CH)?\b|\")?",
    re.IGNORECASE,
)
_OF_A_TOOL: Final = re.compile(r"\bTOOL\b", re.IGNORECASE)
_FEATURE: Final = re.compile(
    r"POCKET|HOLE|BORE|BORING|BOSS|GROOVE|CIRC|RING|HUB|THREAD|SHAFT|PART|BLANK", re.IGNORECASE
)
"""Words of what is cut: a diameter behind them is not that of a tool."""
_INCH_M: Final = 25.4 * MM


def diameters_of(program: Program) -> dict[int, tuple[float, int]]:
    """Return the diameter of each tool that a comment or a statement of APT names, m, and its line.

    A comment that names no tool is about the one in the spindle. Without a unit, lengths are in that of the program.
    """
    unit = program.blocks[-1].modal.unit_m if program.blocks else MM
    out: dict[int, tuple[float, int]] = {}
    place = LANGUAGES[program.dialect].diameters
    for tool, diameter, line in object_at(place)(program) if place is not None else ():
        if tool != 0 and diameter > 0.0:
            out.setdefault(tool, (diameter * unit, line))
    for line, text, tool in _comments(program):
        starts = [match.start() for match in _TOOL.finditer(text)]
        for begin, end in itertools.pairwise([0, *starts, len(text)]):
            named, match = _TOOL.match(text, begin), _DIAMETER.search(text, begin, end)
            number = int(named[1]) if named is not None else tool if _OF_A_TOOL.search(text) else 0
            if match is None or number == 0 or _FEATURE.search(text, begin, match.start()):
                continue
            of_text = {"": unit, "MM": MM}.get((match[2] or "").upper(), _INCH_M)
            out.setdefault(number, (float(match[1]) * of_text, line))
    return out


def _comments(program: Program) -> Iterator[tuple[int, str, int]]:
    """Line, text, and number of the tool in the spindle of each comment, those before the first block included."""
    tool_of_line = {block.line: block.modal.tool for block in program.blocks if not block.file}
    tool = 0
    for number, text in enumerate(program.lines, start=1):
        tool = tool_of_line.get(number, tool)
        for match in _COMMENT.finditer(text):
            yield number, match[1] or match[2] or "", tool


_ENDS: Final = (2.0, 30.0, 99.0)
_COOLANT: Final = {7.0: 1, 8.0: 1, 9.0: 0}
_STOPS: Final = frozenset({0.0, 1.0, 60.0, 66.0})


@dataclass(frozen=True, eq=False)
class Stated:
    """Statements of a program beside its motions."""

    # (motions,) number of the tool length offset, or NONE, OWN or UNSAID of :mod:`~counterflex.programs.stated.offsets`
    length_offset: Int
    work_offset: Int  # (motions,) index into ``offsets``
    # Names of the work offsets in use, in the order in which they appear; ``""`` where none is named
    offsets: tuple[str, ...]
    defined: frozenset[str]  # Of these, those whose place in the part is known
    coolant: Int  # (motions,) 1 on, 0 off, UNSAID where the program has no word of coolant
    spindle_on_at_end: bool  # The program ends without stopping the spindle, by M5 or by its end
    robot: bool  # In a language of robots
    # (motions,) a person or a signal is waited for at the end of the motion (M0, M1, M60, M66; HALT, Stop, PAUSE; WAIT
    # FOR, WaitDI, WAIT DI)
    stops: Bool
    # By tool number, the diameter that a comment of the program names, with its line
    diameters_m: Mapping[int, tuple[float, int]]
    doubts: tuple[str, ...] = ()  # Readings of words that controllers read in two ways, one sentence each
    waits_first: bool = False  # The same before the first motion

    @classmethod
    def of(cls, program: Program, known_offsets: bool = False) -> Stated:
        """Return what a program states of offsets, coolant and its end.

        Args:
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
            behind = block.motions.stop - 1
            if _waits(block, waits):
                waits_first = waits_first or behind < 0
                stops[behind : behind + 1] = True  # nothing before the first motion
            coolant = next((_COOLANT[code] for code in codes_of(block, "M") if code in _COOLANT), coolant)
            if not block.motion_count:
                continue
            rows = slice(block.motions.start, block.motions.stop)
            if reader.offset not in names:
                names.append(reader.offset)
            lengths[rows], works[rows] = reader.length, names.index(reader.offset)
            coolants[rows] = coolant if cools else UNSAID
        defined = frozenset(names) if known_offsets else frozenset(names) & {"", "G54", *reader.defined}
        last = program.blocks[-1].modal.spindle_rpm if program.blocks else 0.0
        ended = any(codes_of(block, "M") & set(_ENDS) for block in program.blocks)
        return cls(lengths, works, tuple(names), defined, coolants, last != 0.0 and not ended,
                      isinstance(program, RobotProgram), stops, diameters_of(program),
                      tuple(doubtful_readings(program)), waits_first)  # fmt: skip


def _waits(block: Block, form: re.Pattern[str] | None) -> bool:
    """A person or a signal is waited for."""
    if codes_of(block, "M") & _STOPS:
        return True
    return form is not None and form.match(block.text) is not None
