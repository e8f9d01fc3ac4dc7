"""Full turns of the axes that a robot program asks for at the end of a motion by axes, by the words of its language.

A pose is reached with axes 1, 4 and 6 a full turn apart. Words: ``T`` of KRL (bit i: axis i + 1 is negative), ``cf1``,
``cf4`` and ``cf6`` of RAPID while ConfJ is on (quarter of a turn in which the axis stands, 0 from 0 to 90 deg), the
numbers behind CONFIG of FANUC (turns of J1, J4 and J6, 0 from -180 to 180 deg).

Sources: as :mod:`counterflex.programs.stated.posture`; KUKA "Turn", ABB ``confdata``, FANUC "Position data".
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.programs.fanuc.program import FanucMotion, FanucProgram
from counterflex.programs.krl.program import KrlMotion, KrlProgram
from counterflex.programs.program import Program
from counterflex.programs.rapid.program import RapidMotion, RapidProgram
from counterflex.programs.stated.posture import supervised_words

TURNING: Final = (0, 3, 5)
"""Axes that reach more than a full turn."""
_FANUC: Final = re.compile(r"[NF]\s*[UD]\s*[TB]\s*,\s*(-?\d)\s*,\s*(-?\d)\s*,\s*(-?\d)", re.IGNORECASE)
_QUARTER_DEG: Final = 90.0


@dataclass(frozen=True, slots=True)
class StatedTurns:
    """Ranges of axes 1, 4 and 6 as the controller shows them.

    Attributes:
        low_deg: Lower ends.
        high_deg: Upper ends.
        words: That state them.
    """

    low_deg: tuple[float, ...]
    high_deg: tuple[float, ...]
    words: str


def stated_turns(program: Program) -> dict[int, StatedTurns]:
    """Return the turns that motions by axes ask for, by index of the motion.

    Args:
        program: As read; of a language without such words nothing is stated.
    """
    given: dict[int, StatedTurns | None] = {}
    if isinstance(program, KrlProgram):
        given = {index: _krl(move) for index, move in enumerate(program.moves)}
    elif isinstance(program, RapidProgram) and "J" in supervised_words(program):
        given = {index: _rapid(move) for index, move in enumerate(program.moves)}
    elif isinstance(program, FanucProgram):
        given = {index: _fanuc(move) for index, move in enumerate(program.moves)}
    return {index: one for index, one in given.items() if one is not None}


def _krl(move: KrlMotion) -> StatedTurns | None:
    """T of a PTP; in other motions the controller ignores it."""
    turn = None if move.target is None else move.target.components.get("T")
    if turn is None or move.word not in ("PTP", "SPTP"):
        return None
    bits = round(turn.value)
    negative = [bool(bits >> axis & 1) for axis in TURNING]
    low, high = ([end if one else other for one in negative] for end, other in ((-np.inf, 0.0), (0.0, np.inf)))
    return StatedTurns(tuple(low), tuple(high), f"T {bits}")


def _rapid(move: RapidMotion) -> StatedTurns | None:
    quarters = None if move.target is None or move.word.upper() != "MOVEJ" else move.target.quarters
    if quarters is None:
        return None
    return _ranges(quarters, _QUARTER_DEG, 0.0, f"cf1, cf4, cf6 {', '.join(map(str, quarters))}")


def _fanuc(move: FanucMotion) -> StatedTurns | None:
    match = _FANUC.search(move.config) if move.word == "J" else None
    if match is None:
        return None
    turns = [int(number) for number in match.groups()]
    return _ranges(turns, 360.0, -180.0, f"CONFIG turns {', '.join(map(str, turns))}")


def _ranges(numbers: Sequence[int], size_deg: float, first_deg: float, words: str) -> StatedTurns:
    low = tuple(first_deg + size_deg * number for number in numbers)
    return StatedTurns(low, tuple(value + size_deg for value in low), words)
