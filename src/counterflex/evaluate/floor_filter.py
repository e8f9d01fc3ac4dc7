"""Floors smoothed before they are measured: one Gaussian filter for simulated, scanned and tracked parts.

A height map knows a step to one cell, a scan smears it, and the furthest of many noisy places is as far off as the
noise is large. Form is therefore measured on the filtered surface, as ISO 12781-2 asks: a Gaussian filter
(ISO 16610-61) of :data:`CUTOFF_M`, as a regression of first order so that the edge of a floor is not pulled to its
middle (ISO 16610-31). Its weight falls as

    exp(-pi (r / (alpha cutoff))^2),   alpha = sqrt(ln 2 / pi)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Bool, Float, Float32, Int, batches
from counterflex.core.units import MM
from counterflex.cutting.stock import HeightMap

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


CUTOFF_M: Final = 2.5 * MM
"""Cut-off wavelength (nesting index), of the series 0.25, 0.8, 2.5, 8 mm of ISO 16610: half of a wave of it is left."""
_REACH: Final = 0.5  # The weight is cut off at this share of the cut-off, where it is 3 % of that in the middle
_ALPHA: Final = float(np.sqrt(np.log(2.0) / np.pi))
_ON_FLOOR: Final = 0.3
"""The weighted mean of the neighbours is nearer than this share of the reach: at the edge of a floor it is as far off,
so that a place beyond it is not measured."""
_ENTRIES: Final = 1_000_000


def floor_fit(points: Float, places: Float, pitch_m: float) -> LocalFit:
    """Filtered values at places from scattered measured values.

    Args:
        points: (n, 2) m, of the measured values.
        places: (m, 2) m.
        pitch_m: Distance of the points from each other, m: the filter reaches three of them at least.
    """
    cutoff = max(CUTOFF_M, 3.0 * pitch_m / _REACH)
    if len(points) == 0 or len(places) == 0:
        return _fit([], [], [], len(places), len(points), np.zeros(len(places), np.bool_))
    tree = scipy.spatial.cKDTree(points)
    rows, columns, weights = [], [], []
    known = np.zeros(len(places), np.bool_)
    for some in batches(len(places), 1024):
        lists = tree.query_ball_point(places[some], _REACH * cutoff)
        count = np.array([len(one) for one in lists])
        member = np.concatenate([np.asarray(one, np.int64) for one in lists])
        place = np.repeat(np.arange(len(lists)), count)
        weight, known[some] = _weights(place, points[member] - places[some][place], count, cutoff)
        rows.append(place + some.start)
        columns.append(member)
        weights.append(weight)
    return _fit(rows, columns, weights, len(places), len(points), known)


@dataclass(frozen=True, eq=False)
class FloorMap:
    """The floor of a part as a map that knows it to one cell."""

    nominal: HeightMap  # height map of the undisturbed part
    rise_m: Float32  # (ny, nx) how much higher the floor is than nominal, m; nan where it is no floor

    def heights(self, xy: Float) -> Float:
        """Filtered height of the floor, (n,) m, at places (n, 2) m: nominal height and filtered rise; nan off it."""
        grid = self.nominal
        inside: Bool = np.asarray(np.isfinite(xy).all(axis=1))
        place = np.where(inside[:, None], xy, 0.0)
        i = np.rint((place[:, 0] - grid.x0_m) / grid.cell_m).astype(np.int64)
        j = np.rint((place[:, 1] - grid.y0_m) / grid.cell_m).astype(np.int64)
        inside &= (i >= 0) & (j >= 0) & (i < grid.z.shape[1]) & (j < grid.z.shape[0])
        out = np.full(len(xy), np.nan)
        rows = np.flatnonzero(inside)
        rise = self._fit(xy[rows], i[rows], j[rows])
        out[rows] = grid.z[j[rows], i[rows]].astype(np.float64) + rise
        return out

    def _fit(self, xy: Float, i: Int, j: Int) -> Float:
        """Filtered rise at places on the map, (n,) m."""
        grid, reach = self.nominal, _REACH * CUTOFF_M
        k = int(np.ceil(reach / grid.cell_m))
        dj, di = (a.ravel() for a in np.mgrid[-k : k + 1, -k : k + 1])
        out = np.full(len(xy), np.nan)
        for some in batches(len(xy), max(1, _ENTRIES // len(di))):
            ci, cj = i[some][:, None] + di, j[some][:, None] + dj
            on = (ci >= 0) & (cj >= 0) & (ci < grid.z.shape[1]) & (cj < grid.z.shape[0])
            rise = self.rise_m[np.where(on, cj, 0), np.where(on, ci, 0)].astype(np.float64)
            step = np.stack([grid.x0_m + ci * grid.cell_m, grid.y0_m + cj * grid.cell_m], axis=2) - xy[some][:, None]
            on &= np.isfinite(rise) & (np.sum(step * step, axis=2) <= reach * reach)
            place = np.nonzero(on)[0]
            weight, known = _weights(place, step[on], on.sum(axis=1), CUTOFF_M)
            out[some] = np.where(known, np.bincount(place, weight * rise[on], len(on)), np.nan)
        return out


def _weights(place: Int, step: Float, count: Int, cutoff: float) -> tuple[Float, Bool]:
    """Weight of each neighbour (k,), ``step`` (k, 2) m away, in the value at its place; and which places are known."""
    far = np.sum(step * step, axis=1)
    w = np.exp(-np.pi * far / (_ALPHA * cutoff) ** 2)
    slope = step / (_REACH * cutoff)
    total = np.maximum(np.bincount(place, w, len(count)), 1e-300)
    aside = np.stack([np.bincount(place, w * slope[:, k], len(count)) for k in (0, 1)], axis=1) / total[:, None]
    known: Bool = np.asarray((count >= LEAST) & (np.linalg.norm(aside, axis=1) < _ON_FLOOR))
    return regression(place, slope, count, weight=w), known


def _fit(rows: list[Int], columns: list[Int], weights: list[Float], places: int, points: int, known: Bool) -> LocalFit:
    """The weights as one sparse matrix."""
    if not rows:
        return LocalFit(scipy.sparse.csr_matrix((places, points)), known)
    place = (np.concatenate(rows), np.concatenate(columns))
    return LocalFit(scipy.sparse.csr_matrix((np.concatenate(weights), place), shape=(places, points)), known)
