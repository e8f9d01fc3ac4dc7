"""Growth of the spindle and drift of the arm from touches between cuts: a Kalman filter of a slow state.

The spindle warms up towards a growth that rises with its speed, the arm drifts (d in part axes, a the direction from
the spindle to the tip)::

    tau dg/dt = A u - g,   u = speed / reference speed        g: growth along the tool axis, m; A: its end at u = 1
    db/dt = w,             w white                            b (3): drift of the tool point, m
    d = a g + b - c + n    each touch, n its uncertainty      d: deviation from the first place that was touched
                                                              c (3): what the first touch itself was off by

A is a constant that is not known, b walks at random, so does g a little (what a single time constant leaves out). The
time constant is not known either: one filter runs for each of :data:`TAUS`, weighted by how well it has foretold the
touches, and what is stated is their mean with the spread between them (Magill 1965, "Optimal adaptive estimation of
sampled stochastic processes"). Where a temperature of the spindle and a growth per kelvin are given, they are one
more measurement of g. Along the axis growth and drift can be told apart only by their course in time; their
uncertainties say how well.

A touch that is off by more than the filter expects says that the model no longer holds: the mean of the squared
normalised innovations of the last touches against the chi-squared distribution (Bar-Shalom, Estimation with
Applications to Tracking and Navigation, section 5.4).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, as_float, as_positive
from counterflex.core.errors import InputError
from counterflex.core.units import MICRO, UM

STATES: Final = 8
"""g, A, b (3) and c (3)."""
TAUS: Final[Float] = 60.0 * np.geomspace(4.0, 120.0, 13)
"""Time constants of the spindle that are weighed, s: 4 min to 2 h."""
WINDOW: Final = 4
"""Touches whose innovations are judged together."""
SURE: Final = 0.999
"""Probability below which a model that holds is not called off."""
_HOUR: Final = 3600.0


@dataclass(frozen=True, eq=False)
class Touches:
    """Touches of one place, in time.

    Attributes:
        time_s: (n,) rising.
        deviation_m: (n, 3) m, deviation from where the place was first, part axes.
        speed_rad_s: (n,) of the spindle since the touch before; 0 stands.
        sigma_m: (n,) standard deviation of each component.
        warmer_k: (n,) temperature of the spindle above that of the first touch; NaN is none.
    """

    time_s: Float
    deviation_m: Float
    speed_rad_s: Float
    sigma_m: Float
    warmer_k: Float

    def __post_init__(self) -> None:
        """Check shapes and ranges.

        Raises:
            InputError: Fewer than two touches, times that do not rise, an uncertainty that is not above 0.
        """
        n = len(self.time_s)
        as_float("touches: deviation_m", self.deviation_m, (n, 3))
        if n < 2:
            raise InputError("touches", value=n, limit=">= 2: the first says where the place was")
        steps = np.diff(self.time_s)
        if not np.all(steps > 0.0):
            where = f"touch {int(np.argmin(steps > 0.0)) + 2}"
            raise InputError("times of touches do not rise", where=where, value=float(steps.min()), limit="> 0 s")
        if not np.all(self.sigma_m > 0.0):
            raise InputError("uncertainty of a touch", value=float(self.sigma_m.min()), limit="> 0 m")


@dataclass(frozen=True, eq=False)
class GrowthModel:
    """What is believed of a machine before the first touch.

    Attributes:
        reference_rad_s: Speed at which A holds.
        end_m: Expected A.
        end_sigma_m: Its standard deviation.
        weights: Of :data:`TAUS`; sum 1.
        arm_walk_m: Standard deviation of the arm's drift over an hour, each direction.
        growth_walk_m: Likewise what the single time constant leaves out of g.
        per_kelvin_m: Growth per kelvin, or None.
        per_kelvin_ratio: Relative standard deviation of growth by temperature.
    """

    reference_rad_s: float = 12_000.0 * 2.0 * math.pi / 60.0
    end_m: float = 0.0
    end_sigma_m: float = 80.0 * UM
    weights: Float = field(default_factory=lambda: np.full(len(TAUS), 1.0 / len(TAUS)))
    arm_walk_m: float = 25.0 * UM
    growth_walk_m: float = 4.0 * UM
    per_kelvin_m: float | None = None
    per_kelvin_ratio: float = 0.15

    def __post_init__(self) -> None:
        """Check ranges.

        Raises:
            InputError: A number that is not above 0, or weights that are none.
        """
        for name in ("reference_rad_s", "end_sigma_m", "arm_walk_m", "growth_walk_m", "per_kelvin_ratio"):
            as_positive(f"thermal growth: {name}", getattr(self, name))
        w = as_float("thermal growth: weights", self.weights, (len(TAUS),))
        if np.any(w < 0.0) or not abs(float(w.sum()) - 1.0) < 1e-6:
            raise InputError("thermal growth: weights of the time constants", value=float(w.sum()), limit="sum 1, >= 0")


@dataclass(frozen=True, eq=False)
class GrowthCourse:
    """What the touches say, one row per touch.

    Attributes:
        growth_m: (n,) of the spindle along the tool axis, longer is positive.
        growth_sigma_m: (n,).
        arm_m: (n, 3) drift of the tool point, part axes.
        arm_sigma_m: (n, 3).
        total_m: (n, 3) both together: where a cut would be off after the touch, part axes.
        total_sigma_m: (n, 3).
        surprise_ratio: (n,) squared normalised innovation by its degrees of freedom; NaN for the first touch.
        holds: (n,) whether the model foretold the last touches.
        model: What is believed after the last touch.
        tau_s: Mean time constant.
        tau_sigma_s: Its standard deviation.
    """

    growth_m: Float
    growth_sigma_m: Float
    arm_m: Float
    arm_sigma_m: Float
    total_m: Float
    total_sigma_m: Float
    surprise_ratio: Float
    holds: np.ndarray[tuple[int], np.dtype[np.bool_]]
    model: GrowthModel
    tau_s: float
    tau_sigma_s: float


def follow(touches: Touches, axis_part: Float, model: GrowthModel | None = None) -> GrowthCourse:
    """Follow growth and drift through the touches.

    Args:
        touches: Of one place; the first says where it was.
        axis_part: (3,) unit vector from the spindle to the tool tip, part axes.
        model: What is believed beforehand; None: of any machine.

    Raises:
        InputError: A direction without length.
    """
    believed = GrowthModel() if model is None else model
    a = as_float("axis_part", axis_part, (3,))
    if not np.linalg.norm(a) > 0.0:
        raise InputError("direction of the tool", value=a.tolist(), limit="a length above 0")
    a = a / np.linalg.norm(a)
    n, count = len(touches.time_s), len(TAUS)
    x, P = np.zeros((count, STATES)), np.zeros((count, STATES, STATES))
    x[:, 1] = believed.end_m
    P[:, 1, 1] = believed.end_sigma_m**2
    P[:, 5:, 5:] = touches.sigma_m[0] ** 2 * np.eye(3)
    log_weight = np.log(np.maximum(believed.weights, 1e-300))
    means, covariances = np.zeros((n, STATES)), np.zeros((n, STATES, STATES))
    means[0], covariances[0] = _mixed(x, P, log_weight)
    surprise, freedom = np.full(n, np.nan), np.zeros(n)
    for k in range(1, n):
        dt, u = touches.time_s[k] - touches.time_s[k - 1], touches.speed_rad_s[k] / believed.reference_rad_s
        squares = np.zeros(count)
        for j, tau in enumerate(TAUS):
            x[j], P[j] = _moved(x[j], P[j], dt, u, float(tau), believed)
            H, y, R = _measured(touches, k, a, believed)
            S = H @ P[j] @ H.T + R
            innovation = y - H @ x[j]
            gain = np.linalg.solve(S, H @ P[j]).T
            squares[j] = innovation @ np.linalg.solve(S, innovation)
            log_weight[j] -= 0.5 * (squares[j] + np.linalg.slogdet(S)[1])
            x[j] = x[j] + gain @ innovation
            left = np.eye(STATES) - gain @ H
            P[j] = left @ P[j] @ left.T + gain @ R @ gain.T
            freedom[k] = len(y)
        log_weight -= log_weight.max()
        surprise[k] = squares[int(np.argmax(log_weight))] / freedom[k]
        means[k], covariances[k] = _mixed(x, P, log_weight)
    weights = np.exp(log_weight) / np.exp(log_weight).sum()
    tau = float(weights @ TAUS)
    spread = float(np.sqrt(weights @ (TAUS - tau) ** 2))
    total = np.column_stack([a, np.zeros(3), np.eye(3), np.zeros((3, 3))])
    after = replace(
        believed, end_m=float(means[-1, 1]), end_sigma_m=float(np.sqrt(covariances[-1, 1, 1])), weights=weights
    )
    sigma = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
    return GrowthCourse(
        growth_m=means[:, 0],
        growth_sigma_m=sigma[:, 0],
        arm_m=means[:, 2:5],
        arm_sigma_m=sigma[:, 2:5],
        total_m=means @ total.T,
        total_sigma_m=np.sqrt(np.einsum("ij,kjl,il->ki", total, covariances, total)),
        surprise_ratio=surprise,
        holds=_holds(surprise, freedom),
        model=after,
        tau_s=tau,
        tau_sigma_s=spread,
    )


def _moved(x: Float, P: Float, dt: float, u: float, tau: float, model: GrowthModel) -> tuple[Float, Float]:
    """State after a time at a speed."""
    kept = math.exp(-dt / tau)
    F = np.eye(STATES)
    F[0, 0], F[0, 1] = kept, (1.0 - kept) * u
    hours = dt / _HOUR
    noise = np.diag([model.growth_walk_m**2, 0.0, *(model.arm_walk_m**2,) * 3, 0.0, 0.0, 0.0]) * hours
    return F @ x, F @ P @ F.T + noise


def _measured(touches: Touches, k: int, axis: Float, model: GrowthModel) -> tuple[Float, Float, Float]:
    """H, y and R of a touch, with the temperature where there is one."""
    H = np.column_stack([axis, np.zeros(3), np.eye(3), -np.eye(3)])
    y, variances = touches.deviation_m[k], [touches.sigma_m[k] ** 2] * 3
    warmer = float(touches.warmer_k[k])
    if model.per_kelvin_m is None or not math.isfinite(warmer):
        return H, y, np.diag(variances)
    grown = model.per_kelvin_m * warmer
    spread = (model.per_kelvin_ratio * grown) ** 2 + (0.3 * model.per_kelvin_m) ** 2  # 0.3 K of the reading itself
    return np.vstack([H, np.eye(1, STATES)]), np.append(y, grown), np.diag([*variances, spread])


def _mixed(x: Float, P: Float, log_weight: Float) -> tuple[Float, Float]:
    """Mean and covariance over the time constants."""
    w = np.exp(log_weight - log_weight.max())
    w = w / w.sum()
    mean = w @ x
    off_mean = x - mean
    return mean, np.einsum("j,jab->ab", w, P) + np.einsum("j,ja,jb->ab", w, off_mean, off_mean)


def _holds(surprise: Float, freedom: Float) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """(n,) whether the squared innovations of the last :data:`WINDOW` touches are those of a model that holds."""
    from scipy.stats import chi2

    out = np.ones(len(surprise), dtype=np.bool_)
    for k in range(1, len(surprise)):
        last = slice(max(1, k - WINDOW + 1), k + 1)
        total, degrees = float(surprise[last] @ freedom[last]), float(freedom[last].sum())
        out[k] = total <= float(chi2.ppf(SURE, degrees))
    return out


def micro(value: float) -> float:
    """A length in um with two digits."""
    return round(value / MICRO, 2)
