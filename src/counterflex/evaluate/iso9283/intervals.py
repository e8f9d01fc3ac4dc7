"""Confidence intervals of the figures of ISO 9283: few cycles are measured, so every figure is an estimate.

The standard names none. Cycles are taken as independent and normally distributed about their barycentre, with any
covariance of the axes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Float, as_float
from counterflex.core.errors import InputError

CONFIDENCE: Final = 0.95
DRAWS: Final = 1000
_SEED: Final = 9283
_GRID: Final = np.linspace(-18.0, 18.0, 289)


@dataclass(frozen=True)
class Figure:
    """A figure and the interval that holds the true one with :data:`CONFIDENCE`."""

    value: float  # SI
    low: float | None  # None where too few cycles were measured for an interval
    high: float | None  # likewise
    count: int  # cycles that it stands on

    def over(self, unit: float, digits: int = 4) -> dict[str, float | int | None]:
        """In a shop unit: ``value``, ``low``, ``high``, ``cycles``."""
        value, low, high = (
            None if x is None else round(x / unit, digits) + 0.0 for x in (self.value, self.low, self.high)
        )
        return {"value": value, "low": low, "high": high, "cycles": self.count}


def mean_figure(values: Float) -> Figure:
    """Mean of (n,) values with Student's interval, ``mean +- t s / sqrt(n)``."""
    x = as_float("values", values, (None,))
    n, mean = len(x), float(np.mean(x))
    if n < 2:
        return Figure(mean, None, None, n)
    half = float(scipy.stats.t.ppf(0.5 + 0.5 * CONFIDENCE, n - 1) * np.std(x, ddof=1) / math.sqrt(n))
    return Figure(mean, mean - half, mean + half, n)


def three_sigma(values: Float) -> Figure:
    """``3 S`` of (n,) values, ``S`` with n - 1, and its chi-square interval ``S sqrt((n-1) / chi2)``.

    Raises:
        InputError: One value has no scatter.
    """
    x = as_float("values", values, (None,))
    n = len(x)
    if n < 2:
        raise InputError("a repeatability needs two cycles", value=n, limit=">= 2")
    s3 = 3.0 * float(np.std(x, ddof=1))
    low, high = (
        math.sqrt((n - 1) / q) for q in scipy.stats.chi2.ppf([0.5 + 0.5 * CONFIDENCE, 0.5 - 0.5 * CONFIDENCE], n - 1)
    )
    return Figure(s3, low * s3, high * s3, n)


def length_figure(d: Float, covariance_m2: Float, count: int) -> Figure:
    """Length of a vector that is known with a scatter: ``|d| +- t s_u`` along its direction u, not below zero.

    Near zero the direction is free and the length is estimated too large; there the largest scatter of any direction
    is taken.

    Args:
        d: (3,) m.
        covariance_m2: (3, 3) of ``d``.
        count: Cycles behind it; n - 1 degrees of freedom.
    """
    size = float(np.linalg.norm(d))
    if count < 2:
        return Figure(size, None, None, count)
    t = float(scipy.stats.t.ppf(0.5 + 0.5 * CONFIDENCE, count - 1))
    widest = math.sqrt(max(float(np.linalg.eigvalsh(covariance_m2)[-1]), 0.0))
    u = d / size if size > 3.0 * widest else None
    s = widest if u is None else math.sqrt(max(float(u @ covariance_m2 @ u), 0.0))
    return Figure(size, max(0.0, size - t * s), size + t * s, count)


def mean_distance(covariances_m2: Float) -> Float:
    """Mean length of normally distributed vectors about zero, (m,) of covariances (m, 3, 3) m2.

    ``E|x| = pi^-1/2 int_0^inf (1 - prod_k (1 + 2 l_k s^2)^-1/2) s^-2 ds`` with the eigenvalues ``l_k``.
    """
    spread = np.maximum(np.linalg.eigvalsh(covariances_m2), 0.0)
    scale = np.sqrt(np.maximum(spread.sum(axis=-1), 1e-300))
    s = np.exp(_GRID) / scale[:, None]
    kept = 1.0 - np.prod((1.0 + 2.0 * spread[:, None, :] * s[..., None] ** 2) ** -0.5, axis=-1)
    out: Float = np.trapezoid(kept / s, _GRID, axis=-1) / math.sqrt(math.pi)
    return out


def repeatability(residual: Float) -> Float:
    """``mean(l) + 3 S_l`` of the distances ``l`` of n vectors from their barycentre.

    Args:
        residual: (..., n, 3) m.

    Returns:
        (...) m.
    """
    distance = np.linalg.norm(residual - residual.mean(axis=-2, keepdims=True), axis=-1)
    out: Float = distance.mean(axis=-1) + 3.0 * distance.std(axis=-1, ddof=1)
    return out


def largest_repeatability(points: Float) -> Figure:
    """Largest ``mean(l) + 3 S_l`` of several places, and its interval.

    The interval scales the figure by what normally distributed cycles with the covariance that was found would give:
    new sets of cycles, correlated from place to place as the measured ones are, give figures R*; the covariance itself
    gives R. The true figure lies between ``value / q`` for the quantiles q of R*/R.

    Args:
        points: (m, n, 3) m: n cycles at m places.

    Raises:
        InputError: Fewer than two cycles.
    """
    p = as_float("points", points, (None, None, 3))
    m, n = p.shape[:2]
    if n < 2 or m < 1:
        raise InputError("a repeatability needs two cycles", value=n, limit=">= 2")
    value = float(repeatability(p).max())
    if value <= 0.0 or n < 3:
        return Figure(value, 0.0 if n >= 3 else None, 0.0 if n >= 3 else None, n)
    e = p - p.mean(axis=1, keepdims=True)
    covariance = np.einsum("mni,mnj->mij", e, e) / (n - 1)
    mean = mean_distance(covariance)
    total = np.trace(covariance, axis1=1, axis2=2)
    true = float((mean + 3.0 * np.sqrt(np.maximum(total - mean**2, 0.0))).max())
    drawn = np.random.default_rng(_SEED).standard_normal((DRAWS * n, n)) / math.sqrt(n - 1)
    new = (drawn @ e.transpose(1, 0, 2).reshape(n, 3 * m)).reshape(DRAWS, n, m, 3)
    ratio = repeatability(new.swapaxes(1, 2)).max(axis=1) / true
    low, high = np.quantile(ratio, [0.5 + 0.5 * CONFIDENCE, 0.5 - 0.5 * CONFIDENCE])
    return Figure(value, value / float(low), value / float(high), n)
