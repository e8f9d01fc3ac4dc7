"""A CAD mesh as what was to be made: exact signed distances to its triangles."""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from counterflex.core.arrays import Float, Int, batches
from counterflex.core.units import MM

_PITCH_M: Final = 0.7 * MM
_MOST_SAMPLES: Final = 2_000_000
_CANDIDATES: Final = 6


class MeshShape:
    """Signed distances to a closed mesh, positive inside it.

    Samples all over the triangles find candidates; the distance is that to the nearest of these triangles.
    """

    def __init__(self, vertices: Float, faces: Int, reach_m: float) -> None:
        """Prepare a mesh.

        Args:
            vertices: (v, 3) m, part frame.
            faces: (t, 3), counterclockwise seen from outside.
            reach_m: Distances up to this are computed.
        """
        self._corners = vertices[faces]
        across = np.cross(self._corners[:, 1] - self._corners[:, 0], self._corners[:, 2] - self._corners[:, 0])
        double = np.linalg.norm(across, axis=1)
        self._corners, across, double = (one[double > 0.0] for one in (self._corners, across, double))
        self._normals = across / double[:, None]
        self._reach = reach_m
        pitch = max(_PITCH_M, float(np.sqrt(0.5 * double.sum() / _MOST_SAMPLES)))
        self._samples, self._owner = _samples(self._corners, 0.5 * double, pitch)
        self._tree = cKDTree(self._samples)

    def distance(self, points_part: Float) -> Float:
        """(n,) m, signed distance of points (n, 3), part frame: positive in the material, nan beyond reach."""
        from trimesh.triangles import closest_point  # heavy

        out = np.full(len(points_part), np.nan)
        for some in batches(len(points_part), 1 << 16):
            points = points_part[some]
            _, near = self._tree.query(points, k=_CANDIDATES, distance_upper_bound=2.0 * self._reach)
            near = near.reshape(len(points), -1)
            within = near < len(self._samples)
            owner = self._owner[np.where(within, near, 0)]
            best = np.full(len(points), np.inf)
            signed = np.full(len(points), np.nan)
            for k in range(owner.shape[1]):
                foot = closest_point(self._corners[owner[:, k]], points)
                step = points - foot
                size = np.linalg.norm(step, axis=1)
                closer = within[:, k] & (size < best)
                inward = -np.sum(step * self._normals[owner[:, k]], axis=1)
                best[closer] = size[closer]
                signed[closer] = np.copysign(size, inward)[closer]
            out[some] = np.where(best <= self._reach, signed, np.nan)
        return out


def _samples(corners: Float, area: Float, pitch: float) -> tuple[Float, Int]:
    """Points on the triangles about so far from each other, and the triangle of each."""
    number = np.maximum(1, np.ceil(2.0 * area / pitch**2)).astype(np.int64)
    owner = np.repeat(np.arange(len(area)), number)
    rng = np.random.default_rng(0)
    u, v = np.sqrt(rng.random(len(owner))), rng.random(len(owner))
    triangle = corners[owner]
    points = (1.0 - u)[:, None] * triangle[:, 0] + (u * (1.0 - v))[:, None] * triangle[:, 1]
    points += (u * v)[:, None] * triangle[:, 2]
    middle = corners.mean(axis=1)
    return np.concatenate([points, middle]), np.concatenate([owner, np.arange(len(area))])
