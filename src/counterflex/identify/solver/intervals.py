"""Intervals that hold the truth at their stated rate: of parameters, of what follows from them, of predictions."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Float, as_float
from counterflex.core.errors import InputError
from counterflex.identify.solver.fit import Fit

# Agreement of a fit with what was known before: within noise, or against its priors.
# In fit coordinates the former values are 0 with covariance I. An eigendirection of the posterior covariance with the
# variance l < 1/2 is one that the data determine; if the former values are the true ones, the fitted value along it has
# the variance ``l (1 - l)``. The sum of the squares in these units is chi-squared distributed: the sum over i
# of ``(v_i . u)^2 / (l_i (1 - l_i))`` for all l_i < 1/2.
# Parameters without a prior (frames and the like) have no former values and are marginalised.

AGREES: Final = 0.01
"""Probability of a difference at least as large, below which the data contradict the former values."""
DETERMINED: Final = 0.5
"""Variance in units of the prior's below which the data say more about a direction than the prior does."""
OFF: Final = 4.0
"""Prior standard deviations beyond which a determined value contradicts its prior: 1 in 16 000 is as far by chance."""


@dataclass(frozen=True)
class Agreement:
    """Comparison of identified with former values."""

    chance: float  # probability of at least such a difference if the former values are true; 1 without any to compare
    directions: int  # combinations of parameters that the data determine
    # largest ratio by which a held-out error may exceed that of true former values by the noise of the fit alone: `1 +
    # 4 p / n`, p determined parameters, n degrees of freedom. A fit adds p / n of the variance; few rows are held out,
    # so the ratio of two means scatters by as much again
    growth: float

    @property
    def agrees(self) -> bool:
        """Return whether the data agree with the former values within noise."""
        return self.chance >= AGREES


def agreement(fits: Iterable[Fit]) -> Agreement:
    """Compare the values of fits with those known before."""
    total, count, seen, freedom = 0.0, 0, 0.0, 0.0
    for fit in fits:
        free = fit.free_index
        known = np.array([fit.parameters.items[i].has_prior for i in free], dtype=np.bool_)
        seen += float(sum(how in ("determined", "partly") for how in fit.seen))
        freedom += max(fit.dof, 1.0)
        if not np.any(known):
            continue
        u = fit.parameters.coordinates(fit.values)[free][known]
        variance, directions = np.linalg.eigh(fit.covariance[np.ix_(known, known)])
        determined = (variance < DETERMINED) & (variance > 0.0)
        along = directions[:, determined].T @ u
        # Only what the data determine: a direction that the prior holds agrees with the prior by construction.
        total += float(np.sum(along**2 / (variance[determined] * (1.0 - variance[determined]))))
        count += int(np.sum(determined))
    return Agreement(
        float(scipy.stats.chi2.sf(total, count)) if count else 1.0, count, 1.0 + 4.0 * seen / max(freedom, 1.0)
    )


def contradicted(fit: Fit) -> tuple[tuple[str, float], ...]:
    """Names of the parameters that the data determine far from their priors, with the distance in prior sigmas."""
    u = np.abs(fit.parameters.coordinates(fit.values))
    off = [
        (p.label or p.name, float(u[i]))
        for i, (p, how) in enumerate(zip(fit.parameters, fit.seen, strict=True))
        if p.free and p.has_prior and how in ("determined", "partly") and u[i] > OFF
    ]
    return tuple(sorted(off, key=lambda item: -item[1]))


LEVEL = 0.95


@dataclass(frozen=True, eq=False)
class Derived:
    """Quantities that follow from the parameters."""

    value: Float  # (m,) in the unit of the derivative times the parameter's
    sigma: Float  # (m,) standard deviation of the value
    lower: Float  # (m,) lower end of its interval
    upper: Float  # (m,) upper end


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
