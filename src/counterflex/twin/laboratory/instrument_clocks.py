"""True delay of each channel of the simulated laboratory, and its clocks.

Drawn from the laboratory's seed by a stream of its own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import MS
from counterflex.twin.laboratory.laboratory import Laboratory

_PPM = 1e-6


@dataclass(frozen=True)
class OtherClock:
    """A clock that is off: at the instant t of the controller's it shows ``t + offset_s + drift t``."""

    offset_s: float
    drift: float

    def stamps(self, time_s: Float) -> Float:
        """Stamps at instants (n,) s of the controller's clock."""
        out: Float = time_s * (1.0 + self.drift) + self.offset_s
        return out


@dataclass(frozen=True)
class ClockedChannel:
    """Delay of one channel."""

    dead_time_s: float  # between what happens and what the channel shows at that stamp
    lag_s: float  # time constant of its low-pass of first order, 0 for none
    jitter_s: float  # standard deviation of its stamps
    lost: float  # share of samples that never arrive


@dataclass(frozen=True)
class InstrumentClocks:
    """Times of the laboratory."""

    feedback: ClockedChannel  # position that the controller shows (its own clock)
    tracker: ClockedChannel
    tracker_clock: OtherClock  # against the controller's
    correction: ClockedChannel  # sensor interface: from the correction given to the reference of the drives
    link_dead_time_s: float  # of the encoders on the links (the controller's clock)

    @classmethod
    def of(cls, laboratory: Laboratory) -> InstrumentClocks:
        """The times of a laboratory's instruments."""
        rng = laboratory.standing("clocks.setup")
        about = partial(_about, rng)
        feedback = ClockedChannel(about(8.0 * MS, 0.1), 0.0, 0.0, 0.0)
        tracker = ClockedChannel(about(5.0 * MS, 0.3), about(3.0 * MS, 0.2), 0.05 * MS, 0.005)
        tracker_clock = OtherClock(float(rng.uniform(-2.0, 2.0)), float(20.0 * _PPM * rng.standard_normal()))
        correction = ClockedChannel(about(16.0 * MS, 0.15), about(45.0 * MS, 0.15), 0.0, 0.0)
        return cls(feedback, tracker, tracker_clock, correction, about(2.8 * MS, 0.05))


def _about(rng: np.random.Generator, value: float, spread: float) -> float:
    return float(value * math.exp(spread * rng.standard_normal()))
