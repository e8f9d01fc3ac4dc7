"""Clocks: how stamps of one map to another, and the rough shift between two records of the same motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from counterflex.core.arrays import Float, as_float, as_positive
from counterflex.core.errors import InputError


@dataclass(frozen=True)
class Clock:
    """How another clock runs: ``stamp = t + offset + drift (t - reference)`` for an instant t of the first clock.

    Attributes:
        offset_s: By how much the other clock is ahead at the reference, s.
        drift: Relative rate, 1 (1e-6 is one microsecond in a second).
        reference_s: Instant at which ``offset_s`` holds.
    """

    offset_s: float = 0.0
    drift: float = 0.0
    reference_s: float = 0.0

    def stamps(self, time_s: Float) -> Float:
        """What the other clock shows at instants (n,) of the first."""
        out: Float = time_s + self.offset_s + self.drift * (time_s - self.reference_s)
        return out

    def instants(self, stamps_s: Float) -> Float:
        """Instants (n,) of the first clock at stamps (n,) of the other; the inverse of :meth:`stamps`."""
        out: Float = self.reference_s + (stamps_s - self.offset_s - self.reference_s) / (1.0 + self.drift)
        return out


def coarse_shift(
    time_a: Float, a: Float, time_b: Float, b: Float, *, step_s: float, limit_s: float | None = None
) -> tuple[float, float]:
    """Shift by which record b trails record a, from the peak of the normalised cross-correlation of their slopes.

    Args:
        time_a: (n,) s, rising.
        a: (n,) any unit.
        time_b: (m,) s, rising, perhaps of another clock.
        b: (m,) any unit, either sign.
        step_s: Grid on which both are compared; the shift is a multiple of it.
        limit_s: Largest shift that is considered; None is any that leaves a third of the shorter record.

    Returns:
        Shift s (positive: b is late), and the correlation there, -1..1.

    Raises:
        InputError: A record does not move.
    """
    step = as_positive("step_s", step_s)
    first, second = _slope(time_a, a, step), _slope(time_b, b, step)
    norm = float(np.linalg.norm(first) * np.linalg.norm(second))
    if norm == 0.0:
        raise InputError("a record that does not move has no delay", value=0.0, limit="some motion")
    together = scipy.signal.correlate(second, first, method="fft") / norm
    lags = scipy.signal.correlation_lags(len(second), len(first))
    start = float(time_b[0]) - float(time_a[0])
    shifts = lags * step + start
    shared = np.minimum(len(first), lags + len(first)) - np.maximum(0, lags - (len(second) - len(first)))
    allowed = shared >= min(len(first), len(second)) // 3
    if limit_s is not None:
        allowed &= np.abs(shifts) <= limit_s
    if not allowed.any():
        raise InputError("the records do not overlap within the largest shift", value=start, limit=limit_s)
    best = int(np.argmax(np.where(allowed, np.abs(together), -1.0)))
    return float(shifts[best]), float(together[best])


def _slope(time_s: Float, values: Float, step: float) -> Float:
    t = as_float("time_s", time_s, (None,))
    y = as_float("values", values, (len(t),))
    grid = np.arange(t[0], t[-1], step)
    if len(grid) < 8:
        raise InputError("a record is too short to be aligned", value=len(t), limit=f"longer than {8 * step:g} s")
    out: Float = np.diff(np.interp(grid, t, y))
    return out - float(np.mean(out))
