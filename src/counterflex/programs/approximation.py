"""Rounding of corners as a program states it itself: exact stops, and distances in mm.

Sources: KUKA system software manual (``$APO.CDIS``, distance before the point at which the rounding begins at the
earliest); ABB RAPID reference, zonedata (``pzone_tcp``; ``z0`` is 0.3 mm, the others are called by their mm); FANUC
operator's manual (``CD`` and ``CR`` in mm; what ``CNT`` makes depends on speed and acceleration and has no distance);
Staubli VAL3 reference (``leave`` and ``reach`` of an mdesc in mm).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.programs.program import Program
from counterflex.programs.robot_text.program import RobotProgram

_EXACT_MODES: Final = frozenset((60.0, 61.0, 61.1))
_CONTINUOUS_MODES: Final = frozenset((64.0, 641.0, 642.0, 643.0, 644.0, 645.0))
_EXACT_ONCE: Final = 9.0


def approximation_m(program: Program) -> Float:
    """Distance from its end at which the rounding of each motion begins, as far as the program says it.

    Returns:
        (motions,) m; 0 is an exact stop, NaN where the program leaves it to the controller or names no distance.
    """
    values = program.roundings_m() if isinstance(program, RobotProgram) else _machine(program)
    return np.array(values, dtype=np.float64)


def _machine(program: Program) -> list[float]:
    """Exact stop modes of G-code, and cycles, which stop at every corner."""
    out = [float("nan")] * len(program.motions)
    exact = False
    for block in program.blocks:
        codes = {word.value for word in block.words if word.letter == "G"}
        exact = (exact or bool(codes & _EXACT_MODES)) and not codes & _CONTINUOUS_MODES
        if exact or _EXACT_ONCE in codes or block.cycle:
            _stop(out, block.motions)
    return out


def _stop(out: list[float], motions: Sequence[int]) -> None:
    for index in motions:
        out[index] = 0.0
