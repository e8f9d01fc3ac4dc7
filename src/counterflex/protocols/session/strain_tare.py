"""The zero of an instrumented holder before the cut: of each bridge, not of the force.

Zeros of bridges wander by strains that mean little across the cheeks and much along them. So what is accepted is
judged by direction: the force that the mean strain would be is to stay within the limit of every force sensor, and
three standard deviations of what the zeros may have wandered since the holder was identified.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float
from counterflex.protocols.session.tare import CYCLES, STEADY, Tare
from counterflex.runtime.sensing.strain_wrench import StrainWrench

SIGMAS: Final = 3.0


class StrainTare(Tare):
    """Takes the mean strain of idle readings as zero of each bridge.

    Args:
        wrench: Whose zeros they are.
        force_n: Largest force that may remain in a direction that the bridges determine well.
        moment_nm: Not used: the holder knows forces only.
        since: Standard deviation of a bridge's change of zero since it was identified, strain.

    Attributes:
        zero: (6,) zeros: what the bridges show is taken off before a force is made of it.
        mean: (6,) N: force that the last whole mean of strains would be, part of no load.
    """

    def __init__(self, wrench: StrainWrench, force_n: float, moment_nm: float, since: float) -> None:
        super().__init__(force_n, moment_nm, keep=False)
        self._wrench, self._since = wrench, since
        self._strain: Float = np.zeros(len(wrench.mean))
        self._half: Float = np.zeros(len(wrench.mean))

    def take(self, w: Float) -> None:
        """Take one reading; a bridge that shows nothing has no mean: the others are judged, if they are enough.

        Args:
            w: Not used: the strains are asked for.
        """
        del w
        self._strain += self._wrench.mean
        self._count += 1
        if self._count == CYCLES // 2:
            self._half[:] = self._strain
        if self._count < CYCLES:
            return
        mean = self._strain / CYCLES
        drift = (self._strain - 2.0 * self._half) / (CYCLES // 2)
        self._strain[:], self._count = 0.0, 0
        there = np.isfinite(mean)
        self.accepted = int(there.sum()) >= self._wrench.tuning.least and self._judged(mean, drift, there)
        self.refusals = 0 if self.accepted else self.refusals + 1
        if self.accepted:
            self._wrench.take_zero(mean)

    def _judged(self, mean: Float, drift: Float, there: Bool) -> bool:
        """Return whether the mean of the bridges that are there is a zero, and does not change."""
        M = self._wrench.matrix(there)
        noise = np.sqrt(2.0 / (CYCLES // 2)) * self._wrench.noise[there]
        self.mean[:3] = M @ mean[there]
        small = self._within(M, mean[there], self._since, 1.0) & self._within(M, drift[there], noise, STEADY)
        return bool(np.all(small))

    def _within(self, M: Float, strain: Float, sigma: Float | float, share: float) -> Bool:
        """(3,) whether the force of a strain is small; not a number is not."""
        limit = share * self._force_n + SIGMAS * np.linalg.norm(M * sigma, axis=1)
        out: Bool = np.abs(M @ strain) <= limit
        return out

    def again(self) -> None:
        """Take new zeros: those so far hold until then."""
        super().again()
        self._wrench.forget_zero()
        self._strain[:] = 0.0
