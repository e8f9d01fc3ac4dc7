"""Walls of a nominal surface as segments: straight ones, and the others as contours."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.units import DEG, MM, UM
from counterflex.evaluate.measured_values import height_at
from counterflex.evaluate.surface import NominalSurface

_NEAR_M: Final = 1.6 * MM
"""Wall points lie about half a millimetre apart, three heights of a wall above each other apart from that."""
_ALIKE: Final = float(np.cos(1.0 * DEG))
_OFF_M: Final = 20.0 * UM
"""Off the line of a neighbour: chords of sampled arcs stay within it."""
_STRAIGHT: Final = float(np.cos(0.5 * DEG))
LEAST_M: Final = 3.0 * MM
_MIDDLE: Final = 0.2


@dataclass(frozen=True, eq=False)
class WallSegment:
    """A piece of wall."""

    points: Float  # (n, 3) m, half way up, part frame
    normals: Float  # (n, 2) horizontal unit normals, from the cut into the material
    low_m: float  # height of its foot, m
    high_m: float  # height of its top, m
    straight: bool  # whether it is plane

    @property
    def normal(self) -> Float:
        """(2,) mean unit normal."""
        mean: Float = self.normals.mean(axis=0)
        return mean / np.linalg.norm(mean)

    @property
    def offset_m(self) -> float:
        """Distance of the plane from the origin along its normal, m."""
        return float(np.mean(self.points[:, :2] @ self.normal))

    @property
    def along(self) -> Float:
        """(2,) unit vector along the wall."""
        n = self.normal
        return np.array([-n[1], n[0]])

    @property
    def ends_m(self) -> tuple[float, float]:
        """Return where it begins and ends along :attr:`along`, m."""
        t = self.points[:, :2] @ self.along
        return float(t.min()), float(t.max())

    @property
    def length_m(self) -> float:
        """Of a straight one, m."""
        return self.ends_m[1] - self.ends_m[0]

    def covers(self, points: Float, tolerance_m: float) -> Bool:
        """Return whether places (n, 3) of the machined surface lie on it."""
        level = (points[:, 2] > self.low_m - tolerance_m) & (points[:, 2] < self.high_m + tolerance_m)
        distance = scipy.spatial.cKDTree(self.points[:, :2]).query(points[:, :2], distance_upper_bound=1.0 * MM)[0]
        near: Bool = distance < max(0.5 * MM, tolerance_m)
        return near & level


def wall_segments(surface: NominalSurface, taken: Bool) -> tuple[WallSegment, ...]:
    """Segments of the walls, straight ones first, each in the order of the wall points.

    Args:
        taken: (m,) wall points that belong to other features.
    """
    aside = 1.5 * surface.nominal.cell_m * surface.wall_normal
    low = height_at(surface.nominal, surface.wall_point[:, :2] - aside)
    high = height_at(surface.nominal, surface.wall_point[:, :2] + aside)
    share = (surface.wall_point[:, 2] - low) / np.where(high > low, high - low, np.nan)
    rows: Int = np.flatnonzero((np.abs(share - 0.5) < _MIDDLE) & ~taken)
    points, normals = surface.wall_point[rows], surface.wall_normal[rows]
    if len(points) == 0:
        return ()
    out, rest = [], np.ones(len(points), np.bool_)
    for some in _pieces(points, normals, plane=True):
        mean = normals[some].mean(axis=0)
        mean /= np.linalg.norm(mean)
        line = points[some, :2] @ np.array([-mean[1], mean[0]])
        if float((normals[some] @ mean).min()) < _STRAIGHT or float(np.ptp(line)) < LEAST_M:
            continue
        rest[some] = False
        out.append(_segment(points, normals, low[rows], high[rows], some, straight=True))
    other = np.flatnonzero(rest)
    curved = [other[some] for some in _pieces(points[other], normals[other], plane=False) if len(some) >= 6]
    out += [_segment(points, normals, low[rows], high[rows], some, straight=False) for some in curved]
    return tuple(out)


def _segment(points: Float, normals: Float, low: Float, high: Float, some: Int, *, straight: bool) -> WallSegment:
    return WallSegment(points[some], normals[some], float(np.median(low[some])), float(np.median(high[some])), straight)


def _pieces(points: Float, normals: Float, *, plane: bool) -> list[Int]:
    """Rows of points that hang together; with ``plane`` on one plane, else around corners too."""
    if len(points) == 0:
        return []
    i, j = scipy.spatial.cKDTree(points).query_pairs(_NEAR_M, output_type="ndarray").T
    if plane:
        step = (points[j] - points[i])[:, :2]
        alike = np.sum(normals[i] * normals[j], axis=1) > _ALIKE
        alike &= np.abs(np.sum(step * normals[i], axis=1)) < _OFF_M
        i, j = i[alike], j[alike]
    graph = scipy.sparse.coo_matrix((np.ones(len(i)), (i, j)), shape=(len(points), len(points)))
    count, label = scipy.sparse.csgraph.connected_components(graph, directed=False)
    order = np.argsort(label, kind="stable")
    pieces = np.split(order, np.flatnonzero(np.diff(label[order])) + 1)
    pieces.sort(key=lambda piece: int(piece[0]))
    return pieces if count else []
