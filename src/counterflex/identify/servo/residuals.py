"""Residuals of a motor that yields: measured angle against what the loop makes of the measured torque.

A position loop P around a speed loop PI answers its error by a torque; read the other way round, the torque tau_m that
the motor gave tells how far it stood from its command (see :mod:`counterflex.robot.elasticity.servo`)::

    e(s) = -tau_m(s) s / (K (s + Kv) (s + 1/Ti)) = -(y_a - y_b) / (K (Kv - 1/Ti))

with ``y_a``, ``y_b`` the torque behind lags of first order with the times ``1/Kv`` and ``Ti``. Whatever the arm does
(it rings, its friction turns round) is in the torque, so nothing needs to be known about it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.identify.solver.fit import Fit
from counterflex.identify.solver.intervals import Derived, of_linear
from counterflex.identify.solver.parameters import Parameters
from counterflex.signals.lag import Lag

# Kv and 1/Ti of a loop: which is which, and what is known of both together.
# The two enter the motion of a loaded motor alike (:mod:`counterflex.identify.servo.residuals`): exchanged they explain
# load steps as well. Their sum and product are seen; the rest is what was known of each beforehand. A commanded motion
# would tell them apart where the drive has no speed feed-forward, which no load step shows.


def _places(fit: Fit, axis: int) -> tuple[int, int]:
    name = f"axis{axis + 1}"
    return fit.parameters.index(f"{name}.position_gain"), fit.parameters.index(f"{name}.integral_time")


def with_exchange(fit: Fit, axis: int) -> Fit:
    """The fit with what is not known of which is which in the standard deviations of Kv and Ti.

    With p the probability of the exchange, a variance is larger by p times the square of the difference between the
    two solutions: the second moment, about the one found, of both together.

    ``axis``: 0..5. Returns the same values and covariance; ``sigma`` of Kv and Ti widened.
    """
    at_rate, at_time = _places(fit, axis)
    rate, time = float(fit.values[at_rate]), float(fit.values[at_time])
    p = exchange_probability(fit.parameters, fit.values, at_rate, at_time)
    sigma = fit.sigma.copy()
    sigma[at_rate] = math.hypot(sigma[at_rate], math.sqrt(p) * (rate - 1.0 / time))
    sigma[at_time] = math.hypot(sigma[at_time], math.sqrt(p) * (time - 1.0 / rate))
    return replace(fit, sigma=sigma)


def exchange_probability(parameters: Parameters, x: Float, rate: int, time: int) -> float:
    """Probability that Kv and 1/Ti are the other way round, by their priors: ``1 / (1 + exp((u'^2 - u^2) / 2))``.

    ``x``: (p,) values.
    """
    other = np.array(x)
    other[rate], other[time] = 1.0 / x[time], 1.0 / x[rate]
    u, v = parameters.coordinates(x), parameters.coordinates(other)
    worse = float(np.sum(v[[rate, time]] ** 2 - u[[rate, time]] ** 2))
    return 1.0 / (1.0 + math.exp(float(np.clip(0.5 * worse, -700.0, 700.0))))


def together(fit: Fit, axis: int) -> Derived:
    """Kv + 1/Ti (1/s) and Kv / Ti (1/s^2), (2,) each: the same whichever of the two is which.

    ``axis``: 0..5.
    """
    at_rate, at_time = _places(fit, axis)
    rate, time = float(fit.values[at_rate]), float(fit.values[at_time])
    G = np.zeros((2, len(fit.values)))
    G[:, at_rate] = 1.0, 1.0 / time
    G[:, at_time] = -1.0 / time**2, -rate / time**2
    return of_linear(fit, G, np.array([rate + 1.0 / time, rate / time]))


_RATE_SEPARATION = 1e-4


@dataclass(frozen=True, eq=False)
class Release:
    """One load step of one axis."""

    run: int
    step_s: float  # between rows, s
    torque: Float  # (n,) N m given by the motor, less its mean before the step
    error: Float  # (n,) rad, motor angle less command, less its mean before the step
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
    """See :class:`.solver.residuals.Residuals`; the parameters are K, Kv and Ti of one axis, in order."""

    axis: int  # 0..5
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
