"""The zero of a force sensor before the cut: what remains once the weight is taken off, or why it is no zero."""

from __future__ import annotations

import math

import numpy as np

from counterflex.core.arrays import Float

CYCLES = 50
"""Readings of a mean: 0.2 s at 4 ms."""
STEADY = 0.2
"""Share of the limits by which the means of both halves may differ: a load that changes meanwhile has no mean."""


class Tare:
    """Takes the mean of idle readings as zero; what is more than the limits is no zero but a wrong load (R17).

    Both halves of a mean must agree to a fifth of the limits. A mean that was refused is taken again at once, for as
    long as it takes: the load may be put right, the tool lifted off the part, while everything runs.

    Args:
        force_n: Largest force that may remain.
        moment_nm: Largest moment.
        keep: Take what remains as zero; else it is only tested.

    Attributes:
        zero: (6,) N, N m: to be taken off; nothing before a mean was accepted.
        mean: (6,) the last whole mean, accepted or not.
        accepted: There is a zero.
        refusals: Means refused in a row; 0 before the first one and once one was accepted.
    """

    def __init__(self, force_n: float, moment_nm: float, *, keep: bool = True) -> None:
        self._force_n, self._moment_nm, self._keep = force_n, moment_nm, keep
        self.zero: Float = np.zeros(6)
        self.mean: Float = np.zeros(6)
        self._sum: Float = np.zeros(6)
        self._first: Float = np.zeros(6)
        self._count = 0
        self.accepted = False
        self.refusals = 0

    def take(self, w: Float) -> None:
        """Take one reading.

        Args:
            w: (6,) N, N m, weight taken off.
        """
        self._sum += w
        self._count += 1
        if self._count == CYCLES // 2:
            self._first[:] = self._sum
        if self._count < CYCLES:
            return
        self.mean[:] = self._sum / CYCLES
        drift = (self._sum - 2.0 * self._first) / (CYCLES // 2)
        self._sum[:] = 0.0
        self._count = 0
        self.accepted = self._small(self.mean, 1.0) and self._small(drift, STEADY)
        self.refusals = 0 if self.accepted else self.refusals + 1
        if self.accepted and self._keep:
            self.zero[:] = self.mean

    def _small(self, w: Float, share: float) -> bool:
        """Return whether a wrench is within a share of the limits; not a number is not."""
        return math.hypot(*w[:3]) <= share * self._force_n and math.hypot(*w[3:]) <= share * self._moment_nm

    def again(self) -> None:
        """Take a new one: the zero so far holds until it is accepted, but nothing may be armed on it."""
        self.accepted, self._count = False, 0
        self._sum[:] = 0.0
