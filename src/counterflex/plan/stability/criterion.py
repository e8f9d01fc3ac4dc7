"""The criterion of chatter that strategy, stability, placement and trial share.

Modes of the robot in the posture, directional matrix A of the engagement, tooth period T. The limit is the factor on
the depth at which the modes together swing for ever: by the low-frequency criterion where it holds (every mode turns
by at most 0.3 rad within a tooth period and regeneration takes little of the modal mass), otherwise by the
zeroth-order solution. A cut chatters where its factor is below 1, which is where :func:`least_damping` at its depth
is below 0. The damping of the modes is that of :mod:`counterflex.plan.lowest_mode`.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Complex, Float
from counterflex.cutting.stability import lobes, low_frequency
from counterflex.cutting.stability.delayed import least_damping as least_damping
from counterflex.cutting.stability.modes import TipModes
from counterflex.cutting.stability.response import Response

LARGEST: Final = 100.0
"""Margin from which a cut counts as stable at any depth."""
LOW, ZEROTH = "robot, low frequency", "robot, zeroth order"
_SAME: Final = 5e-3


@dataclass(frozen=True)
class Limit:
    """Factor on the depth at which a structure chatters."""

    factor: float  # inf without a limit
    omega: float  # angular frequency of chatter, rad/s; nan without a limit
    method: str  # how it was found
    low: float = math.inf  # by the low-frequency criterion with the slow modes


def robot_limit(modes: TipModes, A: Float, T: float) -> Limit:
    """Limit of the robot's modes: low-frequency where it holds, otherwise zeroth order.

    Args:
        modes: In the axes of A.
        A: (3, 3) mean directional matrix, N/m.
        T: Tooth period, s.
    """
    if len(modes) == 0:
        return Limit(math.inf, math.nan, ZEROTH)
    slow = modes.omega_rad_s * T <= low_frequency.VALID_TO
    low, omega = low_frequency.limit(modes.only(slow), A, T)
    # Without a limit within its validity the criterion says nothing: a deeper cut may still chatter.
    if np.all(slow) and math.isfinite(low):
        return Limit(low, omega, LOW, low)
    grid, response = _responses(modes)
    factors, chatter = lobes.limits(A, response, grid, np.array([T]))
    return Limit(float(factors[0]), float(chatter[0]), ZEROTH, low)


@functools.lru_cache(maxsize=16)
def _responses(modes: TipModes) -> tuple[Float, Complex]:
    """Frequencies and response of modes: the same for hundreds of cuts in one posture."""
    grid = lobes.frequencies_for(modes)
    return grid, modes.response(grid)


class SharedLimits:
    """Limits by posture, tooth period and shape of the directional matrix; the size of A divides the factor.

    Matrices whose shapes agree within half a percent share a result.
    """

    def __init__(self, limit_of: Callable[..., Limit] = robot_limit) -> None:
        self._limit_of = limit_of
        self._known: dict[tuple[int, float, bytes], Limit] = {}

    def __call__(self, posture: int, structure: TipModes | Response, A: Float, T: float) -> Limit:
        """Return the limit of a structure that is known by the number of its posture."""
        # The limit of A times a factor is the limit of A over it: cuts of one shape share a solution.
        size = float(np.abs(A).max())
        if size == 0.0:  # nothing regenerates
            return Limit(LARGEST, math.nan, ZEROTH)
        key = (posture, T, np.round(A / (size * 2.0 * _SAME)).astype(np.int64).tobytes())
        if key not in self._known:
            self._known[key] = self._limit_of(structure, A / size, T)
        unit = self._known[key]
        return Limit(min(unit.factor / size, LARGEST), unit.omega, unit.method, unit.low / size)
