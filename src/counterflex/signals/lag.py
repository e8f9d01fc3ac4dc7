"""Lags of first and second order, exact for signals that are linear between samples.

First order ``1 / (1 + T s)``, second order ``1 / (1 + 2 zeta T s + T^2 s^2)``. Steady state before the first sample.
A lag knows its delay: ``T`` and ``2 zeta T``, by which it trails a ramp (its group delay at zero frequency).
The formulas hold for complex parameters, so that derivatives by them are exact (complex step).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy

from counterflex.core.arrays import Float, as_float, as_positive
from counterflex.core.errors import InputError


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


_STEP = 1e-30  # of the complex-step derivative: far below rounding, so nothing is lost


@dataclass(frozen=True)
class Lag:
    """A causal lag of first or second order."""

    time_s: float  # T > 0
    damping: float | None = None  # zeta > 0 of a lag of second order, None for first order

    def __post_init__(self) -> None:
        """Check ranges."""
        as_positive("time_s of a lag", self.time_s)
        if self.damping is not None:
            as_positive("damping of a lag", self.damping)

    @property
    def delay_s(self) -> float:
        """By how much it trails a ramp, s: ``T`` or ``2 zeta T``."""
        return self.time_s if self.damping is None else 2.0 * self.damping * self.time_s

    @property
    def bandwidth_hz(self) -> float:
        """Frequency at which the amplitude has fallen by 3 dB, Hz.

        First order ``1 / (2 pi T)``; second order ``sqrt(a + sqrt(a^2 + 1)) / (2 pi T)`` with ``a = 1 - 2 zeta^2``.
        """
        if self.damping is None:
            return 1.0 / (2.0 * math.pi * self.time_s)
        a = 1.0 - 2.0 * self.damping**2
        return math.sqrt(a + math.sqrt(a * a + 1.0)) / (2.0 * math.pi * self.time_s)

    def sensitivity(self, signal: Float, step_s: float) -> tuple[Float, Float]:
        """Response and its derivatives by the parameters.

        Args:
            signal: (n, k).

        Returns:
            Response (n, k); derivatives (1 or 2, n, k) by ``time_s`` and, for second order, ``damping``.
        """
        values = as_float("signal", signal, (None, None))
        step = as_positive("step_s", step_s)
        by_time = _respond(complex(self.time_s, _STEP), self.damping, values, step)
        rows = [np.imag(by_time) / _STEP]
        if self.damping is not None:
            rows.append(np.imag(_respond(self.time_s, complex(self.damping, _STEP), values, step)) / _STEP)
        return np.real(by_time), np.array(rows)


def _respond(
    time_s: float | complex, damping: float | complex | None, signal: Float, step_s: float
) -> npt.NDArray[np.complex128]:
    forward, back = _first(time_s, step_s) if damping is None else _second(time_s, damping, step_s)
    start = signal[:1]
    out: npt.NDArray[np.complex128] = scipy.signal.lfilter(forward, back, signal - start, axis=0) + start
    return out


def _first(time_s: float | complex, h: float) -> tuple[npt.NDArray[np.complex128], npt.NDArray[np.complex128]]:
    decay = np.exp(-h / time_s)
    mean = (1.0 - decay) * time_s / h
    return np.array([1.0 - mean, mean - decay], dtype=np.complex128), np.array([1.0, -decay], dtype=np.complex128)


def _second(
    time_s: float | complex, damping: float | complex, h: float
) -> tuple[npt.NDArray[np.complex128], npt.NDArray[np.complex128]]:
    """Coefficients of the difference equation, from the matrix exponential of state, input and slope of the input."""
    M = np.zeros((4, 4), dtype=np.complex128)
    w = 1.0 / time_s
    M[0, 1] = w * h
    M[1, 0], M[1, 1], M[1, 2] = -w * h, -2.0 * damping * w * h, w * h
    M[2, 3] = 1.0
    E = scipy.linalg.expm(M)
    A, slope = E[:2, :2], E[:2, 3]
    zero_order = E[:2, 2] - slope
    trace, determinant = A[0, 0] + A[1, 1], A[0, 0] * A[1, 1] - A[0, 1] * A[1, 0]
    adjugate = trace * np.eye(2) - A
    forward = np.array([slope[0], zero_order[0] - adjugate[0] @ slope, -(adjugate[0] @ zero_order)])
    return forward, np.array([1.0, -trace, determinant])
