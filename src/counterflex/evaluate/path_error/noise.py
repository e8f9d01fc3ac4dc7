"""How much of a scan's noise goes away in a mean: neighbouring points are often off together."""

from __future__ import annotations

from typing import Final

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.units import MM

PATCH_M: Final = 2.0 * MM
_LEAST: Final = 4
"""Points of a patch from which its mean says something."""
_FEW: Final = 12
"""Patches below which nothing is said."""


def variance_inflation(residual_m: Float, sigma_m: Float, points: Float, face: Int) -> float:
    """By how much the variance of means is larger than of independent points, >= 1.

    Points of one face in one cube of :data:`PATCH_M` make a patch. Of independent residuals r with standard deviations
    s the mean of m has the variance s^2/m; the ratio of the mean squares, ``m mean(r/s)^2 / mean((r/s)^2)``, is 1 for
    them and m for residuals that are equal within a patch. Its median over the patches, divided by that of a
    chi-squared variable of one degree of freedom, is taken: it does not see single outliers.

    Args:
        residual_m: (n,) what an estimate of the path leaves of the deviations, m.
        sigma_m: (n,) their standard deviations without correlation.
        points: (n, 3) m.
        face: (n,) number of the face.
    """
    key = np.column_stack([np.floor(points / PATCH_M).astype(np.int64), face])
    patch = np.unique(key, axis=0, return_inverse=True)[1].reshape(-1)
    r = residual_m / sigma_m
    count, total = np.bincount(patch), np.bincount(patch, r)
    enough = count >= _LEAST
    if int(enough.sum()) < _FEW:
        return 1.0
    scatter = float(np.median(r**2) / 0.4549)
    means = total[enough] ** 2 / count[enough]
    return max(1.0, float(np.median(means) / 0.4549) / max(scatter, 1e-12))
