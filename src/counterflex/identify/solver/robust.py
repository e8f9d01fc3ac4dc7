"""Robust weights of rows, the spread of a block, and what both do to the standard deviations.

A row's *size* is ``sqrt(mean_c r_c^2)`` of its weighted residual: 1 in the mean for noise of the stated standard
deviation. Weights follow Hampel's three parts, so that a gross error has no influence at all.

Source: Hampel et al. 1986, Robust Statistics, sections 2.6 and 6.3; Huber 1981, section 7.6 (covariance).
"""

from __future__ import annotations

import math
from functools import cache
from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Float, Int

USUAL: Final = 0.999
"""Share of good rows that keep full weight."""
FEWEST: Final = 4
"""Rows below which a block has no outliers: nothing says which of them would be the bad one."""
_LARGEST_SHRINK: Final = 3.0


def sizes(rows: Float) -> Float:
    """(n,) size of weighted residuals (n, k)."""
    out: Float = np.sqrt(np.sum(rows**2, axis=1) / max(rows.shape[1], 1))
    return out


@cache
def usual_size(components: int, share: float = USUAL) -> float:
    """Size that this share of rows of so many components stays below, for noise of unit variance."""
    return math.sqrt(float(scipy.stats.chi2.ppf(share, components)) / components)


def spread(rows: Float, used: float = 0.0) -> float:
    """Median size over what unit noise gives, at least 1.

    Residuals of a fit are smaller than the noise: with ``used`` of the ``n k`` numbers taken up by parameters they are
    ``sqrt(1 - used / (n k))`` of it, which is undone (by a factor of 3 at most).

    Args:
        rows: (n, k) weighted residuals.
        used: Effective number of parameters that these rows determine.
    """
    n, k = rows.shape
    if n == 0 or k == 0:
        return 1.0
    remaining = max(1.0 - used / (n * k), 1.0 / _LARGEST_SHRINK**2)
    return max(1.0, float(np.median(sizes(rows))) / usual_size(k, 0.5) / math.sqrt(remaining))


def median_weights(rows: Float) -> Float:
    """(n,) weights for a start that may be far off: 1 up to the median size, then as its inverse (least absolutes)."""
    if len(rows) < FEWEST:
        return np.ones(len(rows))
    size = sizes(rows)
    typical = float(np.median(size))
    out: Float = np.minimum(1.0, typical / np.maximum(size, 1e-300)) if typical > 0.0 else np.ones(len(rows))
    return out


def hampel_weights(rows: Float, scale: float) -> Float:
    """(n,) weights: 1 up to the usual size t, t / size up to 2 t, falling to 0 at 4 t.

    Args:
        rows: (n, k) weighted residuals.
        scale: Spread that is taken for ordinary.
    """
    if len(rows) < FEWEST or rows.shape[1] == 0:
        return np.ones(len(rows))
    s = np.maximum(sizes(rows) / scale / usual_size(rows.shape[1]), 1e-300)
    influence = np.where(s <= 2.0, np.minimum(s, 1.0), np.clip((4.0 - s) / 2.0, 0.0, 1.0))
    out: Float = influence / s
    return out


def excess(rows: Float, weights: Float, scale: float, used: float, group: Int) -> float:
    """Variance of what was estimated over that promised by ``(J^T W J)^-1``, at least 1 (the square of a Birge ratio).

    ``v = sum(psi^2) / (sum(w) k - used) (sum(w) / sum(psi'))^2`` with ``psi = w r`` (Huber's covariance of a robust
    estimate, gathered into one factor): 1 for noise as stated, the Birge ratio squared for noise of another size, and
    what the weights lose for heavy tails. Where the residuals of a group have a part in common (more than chance
    gives), its repeats tell less than their number promises, and v grows by ``sum_g |sum psi|^2 / sum |psi|^2``.

    Args:
        rows: (n, k) weighted residuals at the solution.
        weights: (n,) of :func:`hampel_weights`.
        scale: As given to it.
        used: Effective number of parameters that these rows determine.
        group: (n,) ids of rows that belong together.
    """
    n, k = rows.shape
    total = float(np.sum(weights))
    remaining = k * total - used
    if n == 0 or k == 0 or total <= 0.0 or remaining <= 0.0:
        return 1.0
    psi = rows * weights[:, None]
    slope = max(float(np.sum(_slope(rows, weights, scale))), 0.2 * total)
    v = float(np.sum(psi**2)) * total**2 / slope**2 / remaining
    return float(max(1.0, v) * _in_common(psi, group))


def _slope(rows: Float, weights: Float, scale: float) -> Float:
    """(n,) derivative of w r by r, mean over its directions: ``w + size w' / k``."""
    k = rows.shape[1]
    if np.all(weights == 1.0):
        return weights
    s = sizes(rows) / scale / usual_size(k)
    fall = np.where(s <= 1.0, 0.0, np.where(s <= 2.0, -weights, np.where(s < 4.0, -2.0 / np.maximum(s, 1.0), 0.0)))
    out: Float = weights + fall / k
    return out


def _in_common(psi: Float, group: Int) -> float:
    ids, place = np.unique(group, return_inverse=True)
    squares = float(np.sum(psi**2))
    if len(ids) < 5 or len(ids) == len(group) or squares <= 0.0:
        return 1.0
    sums = np.zeros((len(ids), psi.shape[1]))
    np.add.at(sums, place, psi)
    ratio = float(np.sum(sums**2)) / squares
    members = len(group) / len(ids)
    by_chance = math.sqrt(2.0 / (len(ids) * psi.shape[1]) * (1.0 - 1.0 / members))
    return ratio if ratio > 1.0 + 2.0 * by_chance else 1.0
