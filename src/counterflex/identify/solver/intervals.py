"""Intervals that hold the truth at their stated rate: of parameters, of what follows from them, of predictions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from counterflex.core.arrays import Float, as_float
from counterflex.core.errors import InputError
from counterflex.identify.solver.fit import Fit

LEVEL = 0.95


@dataclass(frozen=True, eq=False)
class Derived:
    """Quantities that follow from the parameters.

    Attributes:
        value: (m,) in the unit of the derivative times the parameter's.
        sigma: (m,) standard deviation of the value.
        lower: (m,) lower end of its interval.
        upper: (m,) upper end.
    """

    value: Float
    sigma: Float
    lower: Float
    upper: Float


def coverage_factor(fit: Fit, level: float = LEVEL) -> float:
    """Half width of a symmetric interval in standard deviations.

    The normal quantile where the stated standard deviations hold; Student's t with the degrees of freedom of the fit
    where a block's were widened by what its residuals show, which is then an estimate from as many numbers.

    ``level``: Probability that the interval holds the truth, 0..1.

    Raises:
        InputError: A level outside 0..1.

    Source: GUM (JCGM 100:2008), annex G.
    """
    if not 0.0 < level < 1.0:
        raise InputError("the level of an interval is a probability", value=level, limit="between 0 and 1")
    p = 0.5 + 0.5 * level
    if max(fit.sigma_factors, default=1.0) > 1.0:
        return float(scipy.stats.t.ppf(p, max(fit.dof, 1.0)))
    return float(scipy.stats.norm.ppf(p))


def intervals(fit: Fit, level: float = LEVEL) -> Float:
    """Interval of every parameter.

    ``x -+ k sigma``; of a logarithmic parameter ``x exp(-+ k sigma / x)``, so that it stays positive; cut at the bounds
    of the parameter.

    Returns:
        (p, 2) lower and upper end, SI; of a held parameter both are its value.

    Valid for: parameters that the data determine well enough for the model to be linear within the interval; where
    only the prior holds a value, the interval is the prior's.
    """
    k = coverage_factor(fit, level)
    out = np.stack([fit.values, fit.values], axis=1)
    for i, (p, x, sigma) in enumerate(zip(fit.parameters, fit.values, fit.sigma, strict=True)):
        if not p.free:
            continue
        with np.errstate(over="ignore"):
            ends = x * np.exp(np.array([-k, k]) * sigma / x) if p.log else x + np.array([-k, k]) * sigma
        out[i] = np.clip(ends, p.lower, p.upper)
    return out


def covariance_si(fit: Fit) -> Float:
    """(p, p) covariance of all parameters in SI, zero for held ones; first order for logarithmic parameters."""
    out = np.zeros((len(fit.values), len(fit.values)))
    slope = fit.parameters.slope(fit.values)[fit.free_index]
    out[np.ix_(fit.free_index, fit.free_index)] = fit.covariance * np.outer(slope, slope)
    return out


def of_linear(fit: Fit, derivative: Float, value: Float, level: float = LEVEL) -> Derived:
    """Quantities whose derivative by the parameters is known: ``var = G C G^T``.

    ``derivative``: (m, p) G, derivative of each quantity by every parameter, SI. ``value``: (m,) the quantities at the
    fitted values.

    Returns:
        Values with standard deviations and intervals.
    """
    G = as_float("derivative", derivative, (None, len(fit.values)))
    y = as_float("value", value, (len(G),))
    slope = fit.parameters.slope(fit.values)[fit.free_index]
    half = G[:, fit.free_index] * slope
    sigma = np.sqrt(np.maximum(np.sum((half @ fit.covariance) * half, axis=1), 0.0))
    k = coverage_factor(fit, level)
    return Derived(y, sigma, y - k * sigma, y + k * sigma)
