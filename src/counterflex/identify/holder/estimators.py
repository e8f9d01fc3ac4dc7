"""Ways from strain to force, compared on loads they have not seen."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.identify.holder.residuals import HolderReadings
from counterflex.sensing.strain_holder import regressed_matrix

RIDGE = 1e-4
"""Regularisation of the ridge regression, relative to the variance of the strains."""


def regressions(block: HolderReadings, fold: Int) -> Mapping[str, Float]:
    """Held-out force errors (m, 3) N of regressions of force on strain (Denkena2015 eq. 8), by name.

    ``ordinary`` least squares; ``ridge``; ``weighted``: rows by the inverse square of what their load leaves, found in
    a first pass, so that small loads count as much as large ones.

    Args:
        block: Readings; only those at the most frequent point of load are used, as one matrix knows one tool.
        fold: (m,) which fold holds a row out.

    Returns:
        By name; rows at other points of load are not a number.
    """
    places, which = np.unique(np.round(block.p_holder_load, 4), axis=0, return_inverse=True)
    which = which.reshape(-1)
    # A regression knows one lever only: loads at another point would teach it a matrix of neither.
    mine = which == int(np.argmax(np.bincount(which, minlength=len(places))))
    out = {name: np.full((len(fold), 3), np.nan) for name in ("ordinary", "ridge", "weighted")}
    for k in np.unique(fold):
        train, test = mine & (fold != k), mine & (fold == k)
        s, f = block.strain[train], block.force[train]
        if np.sum(train) <= s.shape[1] + 1 or not np.any(test):
            continue
        M, f0 = regressed_matrix(s, f)
        size = np.linalg.norm(f, axis=1)
        residual = np.linalg.norm(s @ M.T + f0 - f, axis=1)
        share = float(np.median(residual / np.maximum(size, 0.1 * size.max())))
        spread = np.hypot(float(np.median(residual)), share * size)
        solved = {
            "ordinary": (M, f0),
            "ridge": regressed_matrix(s, f, RIDGE),
            "weighted": regressed_matrix(s, f, RIDGE, 1.0 / np.maximum(spread, 1e-9) ** 2),
        }
        for name, (matrix, zero) in solved.items():
            out[name][test] = block.strain[test] @ matrix.T + zero - block.force[test]
    return out


def cross_talk(block: HolderReadings, error: Float) -> Float:
    """(3,) for a load along x, y, z: mean length of the error across it, as a share of the load; NaN without such.

    ``error``: (m, 3) N of the estimated force.
    """
    size = np.linalg.norm(block.force, axis=1)
    out = np.full(3, np.nan)
    for axis in range(3):
        pure = np.abs(block.force[:, axis]) > 0.98 * np.maximum(size, 1e-9)
        pure &= size > 0.3 * size.max()
        if np.any(pure):
            across = np.linalg.norm(np.delete(error[pure], axis, axis=1), axis=1)
            out[axis] = float(np.mean(across / size[pure]))
    return out


def hysteresis(block: HolderReadings, estimated: Float) -> float:
    """Share of a load that stays when it is taken away, along it: mean over unloaded rows after a loaded one.

    Args:
        block: Readings in the order in which they were taken.
        estimated: (m, 3) N.

    Returns:
        Dimensionless; NaN where no unloaded row follows a loaded one.
    """
    size = np.linalg.norm(block.force, axis=1)
    after = np.flatnonzero((size[1:] < 0.05 * size.max()) & (size[:-1] > 0.3 * size.max())) + 1
    if len(after) == 0:
        return float("nan")
    along = block.force[after - 1] / size[after - 1, None]
    level = np.median(estimated[size < 0.05 * size.max()], axis=0)
    return float(np.mean(np.sum((estimated[after] - level) * along, axis=1) / size[after - 1]))
