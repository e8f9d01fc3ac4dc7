"""Values at places from scattered measured values about them: a plane through the neighbours of each place."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Bool, Float, Int, batches

LEAST: Final = 3
"""Fewer neighbours say nothing about a place."""
PLANE: Final = 8
"""Fewer neighbours are averaged; from here on a plane is laid through them."""
CURVED: Final = 24
"""Fewer neighbours do not tell how the values bend."""
_BOTH_SIDES: Final = 0.15
"""The neighbours' mean is nearer to the place than this share of the radius: they lie on both sides of it."""
CENTRED: Final = 0.5
"""The neighbours' mean is nearer to the place than this share of the radius: beside them nothing is extrapolated."""
_STIFF: Final = 1e-4


@dataclass(frozen=True, eq=False)
class LocalFit:
    """Linear map from measured values to values at places: ``place = smoother @ measured``."""

    smoother: scipy.sparse.csr_matrix  # (m, n) sparse weights; rows of places without neighbours are empty
    known: Bool  # (m,) whether a place has neighbours, and in its middle

    def values(self, measured: Float) -> Float:
        """(m,) at the places from (n,) measured ones; nan where there are no neighbours."""
        out: Float = np.where(self.known, self.smoother @ measured, np.nan)
        return out

    def standard_deviation(self, sigma: Float) -> Float:
        """(m,) of the values at the places from independent ones (n,) of the measured values."""
        squared = self.smoother.multiply(self.smoother)
        out: Float = np.where(self.known, np.sqrt(squared @ (sigma * sigma)), np.nan)
        return out


def local_fit(
    points: Float, places: Float, radius: float, across: Float | None = None, *, curved: bool = False
) -> LocalFit:
    """Weights of a least-squares plane over the neighbours of each place, taken at the place.

    A plane is off by ``k r^2 / 8`` at a place about which the values curve by k. With ``curved`` the surface bends
    along the first direction, where enough neighbours lie on both sides, and is off by the change of curvature only.

    Args:
        points: (n, d) of the measured values, d 2 or 3, m.
        places: (m, d) m.
        radius: Neighbours are nearer than this, m.
        across: (m, d, 2) two directions in the surface at each place, along which the values may slope; None: the axes
            of a plane (d = 2).
        curved: Whether the values may bend along the first direction.
    """
    n, m = len(points), len(places)
    if n == 0 or m == 0:
        return LocalFit(scipy.sparse.csr_matrix((m, n)), np.zeros(m, np.bool_))
    tree = scipy.spatial.cKDTree(points)
    rows, columns, weights = [], [], []
    known = np.zeros(m, np.bool_)
    for some in batches(m, 4096):
        lists = tree.query_ball_point(places[some], radius)
        count = np.array([len(one) for one in lists])
        member = np.concatenate([np.asarray(one, np.int64) for one in lists]) if count.sum() else np.empty(0, np.int64)
        place = np.repeat(np.arange(len(lists)), count)
        step = points[member] - places[some][place]
        if across is None:
            slope = step / radius
        else:
            slope = np.einsum("kd,kdt->kt", step, across[some][place]) / radius
        rows.append(place + some.start)
        columns.append(member)
        total = np.stack([np.bincount(place, slope[:, k], len(lists)) for k in (0, 1)], axis=1)
        aside = np.linalg.norm(total, axis=1) / np.maximum(count, 1)
        bent = (count >= CURVED) & (aside < _BOTH_SIDES) if curved else np.zeros(len(lists), np.bool_)
        weights.append(regression(place, slope, count, bent))
        known[some] = (count >= LEAST) & (aside < CENTRED)
    row, column, weight = np.concatenate(rows), np.concatenate(columns), np.concatenate(weights)
    smoother = scipy.sparse.csr_matrix((weight, (row, column)), shape=(m, n))
    return LocalFit(smoother, known)


def regression(place: Int, slope: Float, count: Int, bent: Bool | None = None, weight: Float | None = None) -> Float:
    """Weight of each neighbour in the constant of the surface through the neighbours of its place.

    Args:
        place: (k,) of m places, whose neighbour each is.
        slope: (k, 2) where it lies in the surface from there, in radii.
        count: (m,) neighbours of each place.
        bent: (m,) whether the surface bends along the first direction; None: planes.
        weight: (k,) of each neighbour in the sum of squares that is least; None: all alike.

    Returns:
        (k,); fewer than :data:`PLANE` neighbours are averaged.
    """
    m = len(count)
    w = np.ones(len(place)) if weight is None else weight
    curved = np.zeros(m, np.bool_) if bent is None else bent
    A = np.column_stack([np.ones(len(place)), slope, np.where(curved[place], slope[:, 0] ** 2, 0.0)])
    normal = np.zeros((m, 4, 4))
    for a in range(4):
        for b in range(a, 4):
            normal[:, a, b] = normal[:, b, a] = np.bincount(place, w * A[:, a] * A[:, b], m)
    total = np.where(count > 0, normal[:, 0, 0], 1.0)
    few = count < PLANE
    normal[few] = np.eye(4) * total[few, None, None]
    normal[:, 1, 1] += _STIFF * total  # neighbours in one line: no slope across it
    normal[:, 2, 2] += _STIFF * total
    normal[~curved, 3, 3] += total[~curved]
    first = np.linalg.solve(normal, np.tile([[1.0], [0.0], [0.0], [0.0]], (m, 1, 1)))[:, :, 0]
    out: Float = w * np.einsum("kt,kt->k", A, first[place])
    out[few[place]] = (w / total[place])[few[place]]
    return out
