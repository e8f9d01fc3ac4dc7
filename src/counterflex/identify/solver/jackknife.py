"""Standard deviations by what a fit becomes without a part of its data: the jackknife over whole parts.

What a model lacks is no noise: it is the same for neighbouring samples, for repeats of a posture, for the components of
one reading, and larger in one place than in another. A part that is left out takes its share of all that with it. The
fit without part k follows by one step from the whole fit (exact where the model is linear)::

    theta_k - theta = -(C^-1 - J_k^T J_k)^-1 J_k^T r_k        V = (K - 1) / K sum_k (theta_k - mean)(theta_k - mean)^T

with C the covariance with priors, J_k and r_k weighted rows of the part. V is an estimate from K parts only; the
standard deviation of a value so known is that of Student's t, larger by ``sqrt((K - 1) / (K - 3))``.

Sources: Efron and Tibshirani 1993, chapter 11; Cameron, Gelbach and Miller 2008 (few clusters); GUM supplement 1 (JCGM
101:2008), 6.4.9.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.identify.solver.fit import Fit
from counterflex.identify.solver.residuals import Residuals

# Standard deviations of a fit to a time series whose residuals are correlated. Neighbouring samples share what the
# model lacks, so a thousand samples are not a thousand measurements. The covariance is the sandwich ``B S B`` with B
# the covariance that independent residuals would give (its inverse the information) and S the long-run covariance of
# the scores ``g_n = J_n^T r_n``: the sum of their autocovariances over all lags. The scores are whitened by an
# autoregression of first order, the rest is summed with Bartlett's weights to a bandwidth that the data choose, and
# both are put together again.
#
# Source: Newey and West 1987; Andrews and Monahan 1992.

# What is known beforehand, is the same for all rows and is not fitted: its part in the standard deviations. Where each
# bearing sits, how true the scale of a load cell is: such a quantity moves all rows together, so that no residual, no
# fold and no part left out shows it. Its standard deviation goes through the fit instead::
#
# G = C sum_b J_b^T W_b D_b        covariance = C + G G^T
#
# with C the covariance, J_b and W_b weighted rows and weights of a block, and D_b what one standard deviation of each
# quantity moves its weighted rows by.
#
# Source: Bierman, Factorization Methods for Discrete Sequential Estimation (1977), chapter VIII (considered
# parameters).


def considered(fit: Fit, blocks: Sequence[Residuals], moved: Sequence[Float]) -> Float:
    """(f, f) covariance that quantities which are not fitted add, in fit coordinates.

    ``fit``: Of these blocks, its covariance that of independent rows. ``moved``: Per block (rows, components, m) what
    one standard deviation of each of m quantities, the same m in all blocks, moves the measured values by, in their
    units. Returns ``G G^T``; independent of the sign of ``moved``.
    """
    x, free = fit.values, fit.free_index
    slope = fit.parameters.slope(x)[free]
    pulled = np.zeros((len(free), moved[0].shape[2] if moved else 0))
    for block, by, weight, factor in zip(blocks, moved, fit.weights, fit.sigma_factors, strict=True):
        J = block.jacobian(x)[:, :, free] * slope * (weight / factor**2)[:, None, None]
        pulled += np.einsum("ncf,ncm->fm", J, by / block.sigma[:, :, None])
    G = fit.covariance @ pulled
    out: Float = G @ G.T
    return out


def added(fit: Fit, covariance: Float) -> Fit:
    """The fit with a covariance (f, f) of its free fit coordinates added."""
    before = np.diag(fit.covariance)
    grown = np.sqrt(1.0 + np.diag(covariance) / np.maximum(before, 1e-300))
    sigma = fit.sigma.copy()
    sigma[fit.free_index] *= grown
    return replace(fit, covariance=fit.covariance + covariance, sigma=sigma)


_STEEPEST = 0.97


def with_correlation(fit: Fit, blocks: Sequence[Residuals]) -> Fit:
    """The fit with covariance and standard deviations that allow for correlated rows.

    ``blocks``: Their rows in order of time. Returns the same values; ``covariance`` and ``sigma`` replaced, never
    smaller than half of what independence gives.
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
    # The whitening is undone on the sum, not on the series: of lags beyond the bandwidth only the autoregression tells.
    colour = 1.0 / (1.0 - a)
    result: Float = total * colour[:, None] * colour[None, :]
    return result


def _coefficient(series: Float) -> Float:
    power = np.maximum(np.sum(series[:-1] ** 2, axis=0), 1e-300)
    out: Float = np.clip(np.sum(series[1:] * series[:-1], axis=0) / power, -_STEEPEST, _STEEPEST)
    return out


STRETCHES: Final = 10
"""Parts that a record is divided into: long against the memory of the residuals, still enough to judge a spread."""
MOST_PARTS: Final = 40
"""Parts that groups of rows are gathered into, where there are more of them."""
FEWEST_PARTS: Final = 5
"""Parts below which their spread says nothing."""
_MOST_LEVERAGE: Final = 0.9
_LEAST_SHARE: Final = 1.0 / 9.0
"""Least share of the numbers that is left over to judge their spread by."""


def stretches(blocks: Sequence[Residuals], count: int = STRETCHES) -> tuple[Int, ...]:
    """Per block (rows,) the part 0..count-1 of every row: stretches of equal length of rows in order of time."""
    return tuple(np.arange(len(b.group)) * count // max(len(b.group), 1) for b in blocks)


def parts_of_groups(blocks: Sequence[Residuals], most: int = MOST_PARTS) -> tuple[Int, ...]:
    """Per block (rows,) the part of every row: whole groups (shared between blocks), at most ``most`` parts of them.

    Groups are gathered with their neighbours, whose readings follow each other in a motion.
    """
    ids = np.unique(np.concatenate([b.group for b in blocks]))
    count = min(most, len(ids))
    return tuple(np.searchsorted(ids, b.group) * count // len(ids) for b in blocks)


def with_jackknife(fit: Fit, blocks: Sequence[Residuals], parts: Sequence[Int]) -> Fit:
    """The fit with standard deviations not below those of the jackknife.

    ``fit``: Of these blocks, its covariance that of independent rows (its inverse the information). ``parts``: Per
    block (rows,) which part a row belongs to.

    Returns:
        The same values; ``covariance`` and ``sigma`` widened where the jackknife says so, correlations kept. The fit as
        it was where there are fewer than :data:`FEWEST_PARTS` parts.

    Valid for: parameters that no single part determines alone; where one holds more than nine tenths of what is known,
    it counts as nine tenths.
    """
    ids = np.unique(np.concatenate([np.asarray(p) for p in parts]))
    count = len(ids)
    if count < FEWEST_PARTS:
        return fit
    x, free = fit.values, fit.free_index
    slope = fit.parameters.slope(x)[free]
    root = _root(fit.covariance)
    information = np.zeros((count, len(free), len(free)))
    scores = np.zeros((count, len(free)))
    for block, part, weight, factor in zip(blocks, parts, fit.weights, fit.sigma_factors, strict=True):
        share = np.sqrt(weight) / factor
        J = block.jacobian(x)[:, :, free] * slope * share[:, None, None]
        r = block.evaluate(x) * share[:, None]
        for k, one in enumerate(ids):
            rows = part == one
            of_part = J[rows].reshape(-1, len(free)) @ root
            information[k] += of_part.T @ of_part
            scores[k] += of_part.T @ r[rows].reshape(-1)
    moved = np.empty((count, len(free)))
    for k in range(count):
        # One step instead of K fits: exact where the model is linear. A part that alone holds a direction would divide
        # by zero.
        eigenvalues, axes = np.linalg.eigh(information[k])
        moved[k] = root @ (axes @ ((axes.T @ scores[k]) / (1.0 - np.minimum(eigenvalues, _MOST_LEVERAGE))))
    spread = (count - 1) / count * np.sum((moved - moved.mean(axis=0)) ** 2, axis=0) * (count - 1) / (count - 3)
    return widened(fit, spread)


def with_groups_once(fit: Fit, blocks: Sequence[Residuals]) -> Fit:
    """The fit with standard deviations not below those of data in which every group of rows counts as one row.

    Only where there are fewer than :data:`FEWEST_PARTS` groups, too few to say what their rows have in common: then
    they are taken to have everything in common, as copies do::

        V = (sum_g 1/m_g sum_rows J^T J / s^2 + priors)^-1,    s^2 = sum_g 1/m_g sum_rows |r|^2 / (k G - used)

    with m_g rows in group g, G groups of k numbers each, and s never below the factor of the fit. Returns the same
    values, ``covariance`` and ``sigma`` widened; the fit as it was where no group has two rows.
    """
    ids, counts = np.unique(np.concatenate([b.group for b in blocks]), return_counts=True)
    if len(ids) >= FEWEST_PARTS or len(ids) == int(np.sum(counts)):
        return fit
    x, free = fit.values, fit.free_index
    slope = fit.parameters.slope(x)[free]
    all_rows, once = np.zeros((len(free), len(free))), np.zeros((len(free), len(free)))
    squares, numbers = 0.0, 0.0
    for block, weight, factor in zip(blocks, fit.weights, fit.sigma_factors, strict=True):
        share = 1.0 / counts[np.searchsorted(ids, block.group)]
        J = block.jacobian(x)[:, :, free] * slope / factor
        all_rows += np.einsum("n,nci,ncj->ij", weight, J, J)
        once += np.einsum("n,nci,ncj->ij", weight * share, J, J)
        squares += float(np.sum(weight * share * np.sum((block.evaluate(x) / factor) ** 2, axis=1)))
        numbers += float(np.sum(weight * share)) * len(block.components)
    # What the covariance holds beyond the rows are the priors.
    priors = np.linalg.inv(fit.covariance) - all_rows
    covariance = np.linalg.inv(once + priors)
    used = len(free) - float(np.trace(covariance @ priors))
    remaining = max(numbers - used, numbers * _LEAST_SHARE)
    covariance = np.linalg.inv(once / max(1.0, squares / remaining) + priors)
    return widened(fit, np.diag(covariance))


def widened(fit: Fit, variance: Float) -> Fit:
    """The fit with variances (f,) of its free fit coordinates not below the given ones, correlations kept."""
    before = np.diag(fit.covariance)
    grown = np.sqrt(np.maximum(variance / np.maximum(before, 1e-300), 1.0))
    sigma = fit.sigma.copy()
    sigma[fit.free_index] *= grown
    return replace(fit, covariance=fit.covariance * np.outer(grown, grown), sigma=sigma)


def _root(covariance: Float) -> Float:
    """B with ``B B^T`` the covariance."""
    size = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    values, axes = np.linalg.eigh(covariance / np.outer(size, size))
    out: Float = size[:, None] * axes * np.sqrt(np.maximum(values, 0.0))
    return out
