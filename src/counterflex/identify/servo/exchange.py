"""Kv and 1/Ti of a loop: which is which, and what is known of both together.

The two enter the motion of a loaded motor alike (:mod:`counterflex.identify.servo.residuals`): exchanged they explain
load steps as well. Their sum and product are seen; the rest is what was known of each beforehand. A commanded motion
would tell them apart where the drive has no speed feed-forward, which no load step shows.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from counterflex.core.arrays import Float
from counterflex.identify.solver.fit import Fit
from counterflex.identify.solver.intervals import Derived, of_linear
from counterflex.identify.solver.parameters import Parameters


def _places(fit: Fit, axis: int) -> tuple[int, int]:
    name = f"axis{axis + 1}"
    return fit.parameters.index(f"{name}.position_gain"), fit.parameters.index(f"{name}.integral_time")


def with_exchange(fit: Fit, axis: int) -> Fit:
    """The fit with what is not known of which is which in the standard deviations of Kv and Ti.

    With p the probability of the exchange, a variance is larger by p times the square of the difference between the
    two solutions: the second moment, about the one found, of both together.

    ``axis``: 0..5.

    Returns:
        The same values and covariance; ``sigma`` of Kv and Ti widened.
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
