"""Residuals of a motor that yields: measured angle against what the loop makes of the measured torque.

A position loop P around a speed loop PI answers its error by a torque; read the other way round, the torque tau_m that
the motor gave tells how far it stood from its command (see :mod:`counterflex.robot.elasticity.servo`)::

    e(s) = -tau_m(s) s / (K (s + Kv) (s + 1/Ti)) = -(y_a - y_b) / (K (Kv - 1/Ti))

with ``y_a``, ``y_b`` the torque behind lags of first order with the times ``1/Kv`` and ``Ti``. Whatever the arm does
(it rings, its friction turns round) is in the torque, so nothing needs to be known about it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.signals.lag import Lag

_RATE_SEPARATION = 1e-4


@dataclass(frozen=True, eq=False)
class Release:
    """One load step of one axis.

    Attributes:
        step_s: Between rows, s.
        torque: (n,) N m given by the motor, less its mean before the step.
        error: (n,) rad, motor angle less command, less its mean before the step.
        sigma: (n,) rad.
    """

    run: int
    step_s: float
    torque: Float
    error: Float
    sigma: Float


def motor_error(
    gain: float, position_gain: float, integral_time: float, torque: Float, step_s: float
) -> tuple[Float, Float]:
    """Error of the motor (n,) rad and its derivatives (n, 3) by K, Kv and Ti.

    Args:
        gain: K, N m s/rad.
        position_gain: Kv, 1/s.
        integral_time: Ti, s.
        torque: (n,) N m given by the motor, zero at the first row.
        step_s: s.
    """
    if len(torque) == 0:
        return np.zeros(0), np.zeros((0, 3))
    a, b = position_gain, 1.0 / integral_time
    if abs(a - b) < _RATE_SEPARATION * b:
        a = b * (1.0 + _RATE_SEPARATION)
    (y_a, by_a), (y_b, by_b) = (Lag(1.0 / r).sensitivity(torque[:, None], step_s) for r in (a, b))
    difference = a - b
    gap = (y_a - y_b)[:, 0]
    e = -gap / (gain * difference)
    by_position = -(-by_a[0, :, 0] / a**2) / (gain * difference) + gap / (gain * difference**2)
    by_rate = (-by_b[0, :, 0] / b**2) / (gain * difference) - gap / (gain * difference**2)
    slope = np.stack([-e / gain, by_position, by_rate * (-1.0 / integral_time**2)], axis=1)
    return e, slope


@dataclass(frozen=True, eq=False)
class ServoResiduals:
    """See :class:`.solver.residuals.Residuals`; the parameters are K, Kv and Ti of one axis, in order.

    Attributes:
        axis: 0..5.
    """

    axis: int
    releases: tuple[Release, ...]

    @property
    def name(self) -> str:
        """Of the block."""
        return f"load steps of axis {self.axis + 1}"

    @property
    def group(self) -> Int:
        """(n,) number of the load step."""
        return np.concatenate([np.full(len(r.error), r.run, dtype=np.int64) for r in self.releases])

    @property
    def components(self) -> tuple[str, ...]:
        """One."""
        return ("motor minus command rad",)

    @property
    def sigma(self) -> Float:
        """(n, 1) rad."""
        return np.concatenate([r.sigma for r in self.releases])[:, None]

    def predict(self, x: Float) -> Float:
        """(n,) rad."""
        return np.concatenate([motor_error(x[0], x[1], x[2], r.torque, r.step_s)[0] for r in self.releases])

    def evaluate(self, x: Float) -> Float:
        """(n, 1) weighted residuals."""
        measured = np.concatenate([r.error for r in self.releases])
        out: Float = (measured - self.predict(x))[:, None] / self.sigma
        return out

    def jacobian(self, x: Float) -> Float:
        """(n, 1, 3)."""
        slope = np.concatenate([motor_error(x[0], x[1], x[2], r.torque, r.step_s)[1] for r in self.releases])
        out: Float = -slope[:, None, :] / self.sigma[:, :, None]
        return out

    def subset(self, rows: Bool) -> ServoResiduals:
        """Load steps of which any row is marked; a step is a whole."""
        ends = np.cumsum([len(r.error) for r in self.releases])[:-1]
        releases = [r for r, mask in zip(self.releases, np.split(rows, ends), strict=True) if mask.any()]
        if not releases:
            empty = np.zeros(0)
            releases = [Release(-1, 1.0, empty, empty, empty)]
        return ServoResiduals(self.axis, tuple(releases))
