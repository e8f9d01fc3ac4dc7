"""Whether something grows: the slope of a straight line through its values, with its standard error."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Float, as_float
from counterflex.core.errors import InputError


@dataclass(frozen=True)
class Growth:
    """A straight line through values.

    Attributes:
        slope: Change per unit of time.
        standard_error: Of the slope, from the scatter about the line; values that come one after the other are taken
            as independent, so slow waves make it too small.
    """

    slope: float
    standard_error: float


def growth(time: Float, values: Float) -> Growth | None:
    """Least squares: ``slope = sum (t - mean t) (x - mean x) / sum (t - mean t)^2``, ``s^2 / sum (t - mean t)^2``.

    Args:
        time: (n,) of any unit.
        values: (n,); those not finite are left out.

    Returns:
        None where fewer than three values at different times are left.

    Raises:
        InputError: The shapes differ.
    """
    time, values = as_float("time", time, (None,)), np.asarray(values, dtype=np.float64)
    if time.shape != values.shape:
        raise InputError("times and values", value=(time.shape, values.shape), limit="of the same length")
    good = np.isfinite(values)
    t, x = time[good], values[good]
    if len(t) < 3 or np.ptp(t) <= 0.0:
        return None
    t = t - np.mean(t)
    spread = float(np.sum(t**2))
    slope = float(np.sum(t * (x - np.mean(x)))) / spread
    residual = x - np.mean(x) - slope * t
    return Growth(slope, math.sqrt(float(np.sum(residual**2)) / (len(t) - 2) / spread))
