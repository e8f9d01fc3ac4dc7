"""A signal between its samples: cubic spline through them, at any stamps in rising order."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from counterflex.core.arrays import Float, as_float
from counterflex.core.errors import InputError


class Continuous:
    """A sampled signal as a function of time.

    Between the samples a cubic spline (not-a-knot); before the first and after the last it keeps their values.

    Args:
        time_s: (n,) s, rising; need not be equally spaced.
        values: (n, k) any unit.

    Attributes:
        start_s: First stamp.
        end_s: Last stamp.
    """

    def __init__(self, time_s: Float, values: Float) -> None:
        t = as_float("time_s", time_s, (None,))
        y = as_float("values", values, (len(t), None))
        if len(t) < 4:
            raise InputError("a signal needs four samples", value=len(t), limit=">= 4")
        if np.any(np.diff(t) <= 0.0):
            raise InputError("time stamps of a signal must rise", value=float(np.diff(t).min()), limit="> 0 s")
        self.start_s, self.end_s = float(t[0]), float(t[-1])
        self._spline = CubicSpline(t, y, axis=0)
        self._slope = self._spline.derivative()

    def at(self, time_s: Float) -> Float:
        """Values (m, k) at times (m,)."""
        out: Float = self._spline(np.clip(time_s, self.start_s, self.end_s))
        return out

    def slope_at(self, time_s: Float) -> Float:
        """Derivatives (m, k) by time, 1/s, at times (m,); zero outside the record."""
        inside = (time_s >= self.start_s) & (time_s <= self.end_s)
        out: Float = self._slope(np.clip(time_s, self.start_s, self.end_s)) * inside[:, None]
        return out

    def covers(self, time_s: Float, margin_s: float = 0.0) -> Float:
        """(m,) True where the record reaches at least ``margin_s`` beyond a time on both sides."""
        return np.asarray((time_s >= self.start_s + margin_s) & (time_s <= self.end_s - margin_s))
