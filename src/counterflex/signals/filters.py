"""Causal filters of the online loop, sample by sample, with the delay they cost: second-order low-pass, moving average.

Both have unit gain at rest and start at the value they are reset to, so that nothing jumps when a loop begins.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Float, Int, as_positive
from counterflex.core.errors import InputError
from counterflex.core.jit import kernel

_LOWEST = 1e-6  # of the sampling rate
_HIGHEST = 0.45  # of the sampling rate


@dataclass(frozen=True)
class Smoothing:
    """Butterworth low-pass of second order, then a moving average."""

    corner_hz: float  # -3 dB frequency of the low-pass; 0 leaves it out
    average: int  # samples of the moving average; 1 leaves it out
    period_s: float

    def __post_init__(self) -> None:
        """Check ranges."""
        as_positive("filter: corner_hz", self.corner_hz, zero=True)
        as_positive("filter: period_s", self.period_s)
        if self.corner_hz > 0.0 and self.corner_hz * self.period_s < _LOWEST:
            raise InputError(
                "the filter's corner is so low that nothing passes",
                value=f"{self.corner_hz:g} Hz",
                limit=f">= {_LOWEST / self.period_s:g} Hz, or 0 to leave the filter out",
            )
        if self.corner_hz * self.period_s > _HIGHEST:
            raise InputError(
                "the filter's corner is too high for its sampling rate",
                value=f"{self.corner_hz:g} Hz",
                limit=f"<= {_HIGHEST / self.period_s:g} Hz",
            )
        if not 1 <= self.average <= 1024:
            raise InputError("samples of a moving average", value=self.average, limit="1 .. 1024")

    @property
    def delay_s(self) -> float:
        """Delay of slow signals: ``sqrt(2) / w'`` of the low-pass with ``w' = (2/T) tan(w T/2)``, ``(n-1) T/2``."""
        low_pass = 0.0
        if self.corner_hz > 0.0:
            low_pass = math.sqrt(2.0) / (2.0 / self.period_s * math.tan(math.pi * self.corner_hz * self.period_s))
        return low_pass + 0.5 * (self.average - 1) * self.period_s

    def coefficients(self) -> Float:
        """(5,) ``b0 b1 b2 a1 a2`` of the low-pass: bilinear transform, corner kept in place."""
        if self.corner_hz == 0.0:
            return np.array([1.0, 0.0, 0.0, 0.0, 0.0])
        k = math.tan(math.pi * self.corner_hz * self.period_s)
        norm = 1.0 + math.sqrt(2.0) * k + k * k
        b = k * k / norm
        return np.array([b, 2.0 * b, b, 2.0 * (k * k - 1.0) / norm, (1.0 - math.sqrt(2.0) * k + k * k) / norm])


class Smoother:
    """State of a :class:`Smoothing` for several channels, with buffers that are allocated once."""

    def __init__(self, smoothing: Smoothing, channels: int) -> None:
        self.coefficients = smoothing.coefficients()
        self.memory: Float = np.zeros((4, channels))
        self.ring: Float = np.zeros((smoothing.average, channels))
        self.place: Int = np.zeros(1, dtype=np.int64)
        self.delay_s = smoothing.delay_s

    def reset(self, value: Float) -> None:
        """Take a value (channels,) as if it had been there forever."""
        self.memory[:] = value
        self.ring[:] = value
        self.place[0] = 0

    def __call__(self, value: Float, out: Float) -> None:
        """One sample in (channels,), one out (channels,)."""
        smooth(value, out, self.coefficients, self.memory, self.ring, self.place)


@kernel("void(float64[::1], float64[::1], float64[::1], float64[:, ::1], float64[:, ::1], int64[::1])", entry=True)
def smooth(value: Float, out: Float, coefficients: Float, memory: Float, ring: Float, place: Int) -> None:
    """One sample through low-pass and moving average.

    Args:
        value: (k,) sample.
        out: (k,) result.
        coefficients: (5,) of :meth:`Smoothing.coefficients`.
        memory: (4, k) last two inputs, last two outputs of the low-pass.
        ring: (n, k) last n of those outputs.
        place: (1,) where in the ring the next one goes.
    """
    n = ring.shape[0]
    i = place[0]
    for k in range(value.shape[0]):
        y = (
            coefficients[0] * value[k]
            + coefficients[1] * memory[0, k]
            + coefficients[2] * memory[1, k]
            - coefficients[3] * memory[2, k]
            - coefficients[4] * memory[3, k]
        )
        memory[1, k], memory[0, k] = memory[0, k], value[k]
        memory[3, k], memory[2, k] = memory[2, k], y
        ring[i, k] = y
        total = 0.0
        for j in range(n):
            total += ring[j, k]
        out[k] = total / n
    place[0] = i + 1 if i + 1 < n else 0
