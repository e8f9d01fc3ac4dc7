"""Answer of a robot controller's path planning to a correction: dead time, then a second-order lag.

Real controllers add a sensor correction to the interpolated path and smooth it before it reaches the drives: 100 to
150 ms in all from force to motion (Haehn2020 section 2.8), of which the exchange of telegrams is the least part.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Float, as_positive


@dataclass(frozen=True)
class PathAnswer:
    """Dynamics of the correction inside the controller."""

    dead_s: float = 12.0e-3  # dead time
    natural_hz: float = 5.0  # natural frequency of the lag; 0 leaves it out
    damping: float = 0.7  # its damping ratio

    def __post_init__(self) -> None:
        """Check ranges."""
        as_positive("dead_s", self.dead_s, zero=True)
        as_positive("natural_hz", self.natural_hz, zero=True)
        as_positive("damping", self.damping)


class AnswerState:
    """The answer, cycle by cycle, exact for a correction that is held over each cycle.

    Args:
        size: Numbers of a correction.
    """

    def __init__(self, answer: PathAnswer, period_s: float, size: int = 6) -> None:
        self._queue: Float = np.zeros((round(answer.dead_s / period_s) + 1, size))
        self._at = 0
        self.value: Float = np.zeros(size)
        self.rate: Float = np.zeros(size)
        self._lagging = answer.natural_hz > 0.0
        if self._lagging:
            self._step, self._gain = _exact_step(2.0 * math.pi * answer.natural_hz, answer.damping, period_s)

    def __call__(self, correction: Float) -> Float:
        """Take the correction of this cycle; returns what is in effect at its end."""
        self._queue[self._at] = correction
        self._at = (self._at + 1) % len(self._queue)
        delayed = self._queue[self._at]
        if not self._lagging:
            self.value = delayed.copy()
            return self.value
        A, b = self._step, self._gain
        value = A[0, 0] * self.value + A[0, 1] * self.rate + b[0] * delayed
        self.rate = A[1, 0] * self.value + A[1, 1] * self.rate + b[1] * delayed
        self.value = value
        return self.value

    def reset(self) -> None:
        """Forget every correction."""
        self._queue[:] = 0.0
        self.value = np.zeros_like(self.value)
        self.rate = np.zeros_like(self.rate)


def _exact_step(w: float, damping: float, period_s: float) -> tuple[Float, Float]:
    """State transition (2, 2) and input (2,) of ``x'' + 2 zeta w x' + w^2 x = w^2 u`` over one held period."""
    A = np.array([[0.0, 1.0], [-w * w, -2.0 * damping * w]])
    values, vectors = np.linalg.eig(A.astype(np.complex128) + np.array([[0.0, 0.0], [0.0, 1e-9 * w]]))
    step: Float = np.real(vectors @ np.diag(np.exp(values * period_s)) @ np.linalg.inv(vectors))
    gain: Float = np.linalg.solve(A, (step - np.eye(2)) @ np.array([0.0, w * w]))
    return step, gain
