"""Trend of a figure over runs of the same program: slope per run with its interval."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy

LEAST_RUNS: Final = 4
"""Runs that a trend is told from: three would leave one degree of freedom."""


@dataclass(frozen=True)
class Trend:
    """A straight line through a figure of several runs, least squares.

    Attributes:
        runs: With the figure.
        mean: Of it.
        slope: Change from one run to the next.
        half_width: Half width of the 95 % interval of the slope, for runs that scatter independently.
    """

    runs: int
    mean: float
    slope: float
    half_width: float

    @property
    def clear(self) -> bool:
        """Whether the interval excludes that nothing changes."""
        return abs(self.slope) > self.half_width


def trend(values: Sequence[float | None]) -> Trend | None:
    """Trend over runs in their order, equally spaced; None with fewer than :data:`LEAST_RUNS` figures.

    Args:
        values: One per run; None where it has no such figure. Any unit.
    """
    known = [(k, float(v)) for k, v in enumerate(values) if v is not None and math.isfinite(v)]
    n = len(known)
    if n < LEAST_RUNS:
        return None
    x, y = np.array(known).T
    dx, mean = x - x.mean(), float(y.mean())
    square = float(dx @ dx)
    slope = float(dx @ y) / square
    rest = y - mean - slope * dx
    sigma = math.sqrt(float(rest @ rest) / (n - 2) / square)
    return Trend(n, mean, slope, sigma * float(scipy.special.stdtrit(n - 2, 0.975)))
