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
from counterflex.evaluate.local_fit import LEAST, LocalFit, regression

CUTOFF_M: Final = 2.5 * MM
"""Cut-off wavelength (nesting index), of the series 0.25, 0.8, 2.5, 8 mm of ISO 16610: half of a wave of it is left."""
_REACH: Final = 0.5
"""The weight is cut off at this share of the cut-off, where it is 3 % of that in the middle."""
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
