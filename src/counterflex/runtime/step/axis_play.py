"""Play compensation of axis-specific output: arrays and parameters of :mod:`.axis_play_kernel`."""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float, Int, as_float
from counterflex.core.errors import InputError
from counterflex.core.records import Record, Records, as_words, records
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.runtime.step import axis_play_kernel as ak

SMOOTHING_S = 0.02
"""Time over which half the play of an axis is taken up."""
_WIDTH = 0.25  # half width of the play operator by half the play
_LEAST_RAD = 1e-7


class PlayCompensation:
    """Adds half the play of each gear to the axis correction, in the direction of program and correction together.

    Args:
        chain: Of the cell, with identified ``play``; axes without an entry are left out.
        period_s: Cycle.
        contained: The program contains the correction of the play on its own path: that part is left out.
        own_rad: (6,) half the play that the controller itself adds in the direction of the programmed motion.

    Attributes:
        plays: (6,) PLAY of the kernel.
        memory: (6,) PLAYED of the kernel.
        begun: (1,) 1: not the first cycle.

    Raises:
        InputError: The chain has no play, or ``own_rad`` is negative.
    """

    def __init__(self, chain: ElasticChain, period_s: float, *, contained: bool, own_rad: Float | None = None) -> None:
        if chain.play is None:
            raise InputError("the cell knows no play of its axes", hint="Identify reversals, or leave axis_play out")
        own = np.zeros(6) if own_rad is None else as_float("own_rad", own_rad, (6,))
        if np.any(own < 0.0):
            raise InputError("half the play that the controller adds", value=float(own.min()), limit=">= 0")
        band = np.array([0.0 if entry is None else entry.half_band_rad for entry in chain.play])
        self.plays = records(ak.PLAY, 6)
        self.plays["band"] = band
        self.plays["program"] = program = band if contained else own
        self.plays["width"] = np.maximum(_WIDTH * band, _LEAST_RAD)
        self.plays["step"] = (band + program) * period_s / SMOOTHING_S
        self.memory = records(ak.PLAYED, 6)
        self.begun: Int = np.zeros(1, dtype=np.int64)

    def reset(self) -> None:
        """Begin anew."""
        as_words(self.memory)[:] = 0
        self.begun[0] = 0

    @property
    def value(self) -> Float:
        """(6,) rad, view: what is added now."""
        return self.memory["added"]

    def after(self, given: Record, result: Record) -> None:
        """After the step of a cycle, see :func:`counterflex.runtime.step.axis_play_kernel.play_after`."""
        ak.play_after(given, result, self.plays, self.memory, self.begun)

    def arrays(self) -> tuple[Records, Records, Int]:
        """Constants, memory and whether it has begun, as the kernel of a cycle takes them."""
        return self.plays, self.memory, self.begun
