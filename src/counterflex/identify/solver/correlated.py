"""Standard deviations of a fit to a time series whose residuals are correlated.

Neighbouring samples share what the model lacks, so a thousand samples are not a thousand measurements. The covariance
is the sandwich ``B S B`` with B the covariance that independent residuals would give (its inverse the information) and
S the long-run covariance of the scores ``g_n = J_n^T r_n``: the sum of their autocovariances over all lags. The scores
are whitened by an autoregression of first order, the rest is summed with Bartlett's weights to a bandwidth that the
data choose, and both are put together again.

Source: Newey and West 1987; Andrews and Monahan 1992.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from counterflex.core.arrays import Float
from counterflex.identify.solver.fit import Fit
from counterflex.identify.solver.residuals import Residuals

_STEEPEST = 0.97


def with_correlation(fit: Fit, blocks: Sequence[Residuals]) -> Fit:
    """The fit with covariance and standard deviations that allow for correlated rows.

    ``blocks``: Their rows in order of time.

    Returns:
        The same values; ``covariance`` and ``sigma`` replaced, never smaller than half of what independence gives.
    """
    x, free = fit.values, fit.free_index
    slope = fit.parameters.slope(x)[free]
    prior = np.array([fit.parameters.items[int(i)].has_prior for i in free], dtype=np.float64)
    meat = np.diag(prior)
    for block, weight, factor in zip(blocks, fit.weights, fit.sigma_factors, strict=True):
        J = block.jacobian(x)[:, :, free] * slope
        r = block.evaluate(x)
        scores = np.einsum("ncp,nc->np", J, r) * (weight / factor**2)[:, None]
        meat = meat + long_run(scores) * len(scores)
    rows = sum(len(w) for w in fit.weights)
    covariance = fit.covariance @ meat @ fit.covariance * (rows / max(rows - len(free), 1))
    least = 0.25 * np.diag(fit.covariance)
    variance = np.maximum(np.diag(covariance), least)
    covariance = covariance + np.diag(variance - np.diag(covariance))
    sigma = np.zeros(len(x))
    sigma[free] = np.sqrt(variance) * slope
    return replace(fit, covariance=covariance, sigma=sigma)


def long_run(scores: Float) -> Float:
    """Long-run covariance (p, p) of a series (n, p): the sum of its autocovariances over all lags.

    ``scores``: (n, p), mean zero at a least-squares solution.
    """
    n = len(scores)
    if n < 4:
        out: Float = scores.T @ scores / max(n, 1)
        return out
    before, after = scores[:-1], scores[1:]
    power = np.maximum(np.sum(before**2, axis=0), 1e-300)
    a = np.clip(np.sum(before * after, axis=0) / power, -_STEEPEST, _STEEPEST)
    white = after - a * before
    rest = _coefficient(white)
    power = np.var(white, axis=0)
    share = power / np.maximum(power, 1e-300)
    top = float(np.sum(share * 4.0 * rest**2 * power**2 / ((1.0 - rest) ** 6 * (1.0 + rest) ** 2)))
    bottom = float(np.sum(share * power**2 / (1.0 - rest) ** 4))
    width = 1.1447 * (top / max(bottom, 1e-300) * n) ** (1.0 / 3.0)
    count = int(min(width, n // 4))
    total: Float = white.T @ white / n
    for lag in range(1, count + 1):
        shifted = white[lag:].T @ white[:-lag] / n
        total = total + (1.0 - lag / (width + 1.0)) * (shifted + shifted.T)
    colour = 1.0 / (1.0 - a)
    result: Float = total * colour[:, None] * colour[None, :]
    return result


def _coefficient(series: Float) -> Float:
    power = np.maximum(np.sum(series[:-1] ** 2, axis=0), 1e-300)
    out: Float = np.clip(np.sum(series[1:] * series[:-1], axis=0) / power, -_STEEPEST, _STEEPEST)
    return out
