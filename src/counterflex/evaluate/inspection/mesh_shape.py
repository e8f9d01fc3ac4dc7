"""A CAD mesh as what was to be made: exact signed distances to its triangles."""

from __future__ import annotations

from typing import Final

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.units import MM
from counterflex.evaluate.inspection.mesh_kernel import count_cubes, list_cubes, signed_distances

_SIDE_M: Final = 1.0 * MM
_MOST_CUBES: Final = 8_000_000


class MeshShape:
    """Signed distances to a closed mesh, positive inside it, however fine or coarse its triangles are."""

    def __init__(self, vertices: Float, faces: Int, reach_m: float) -> None:
        """Prepare a mesh.

        Args:
            vertices: (v, 3) m, part frame.
            faces: (t, 3), counterclockwise seen from outside.
            reach_m: Distances up to this are computed.
        """
        corners = np.ascontiguousarray(vertices[faces], np.float64)
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        double = np.linalg.norm(across, axis=1)
        self._corners = np.ascontiguousarray(corners[double > 0.0])
        self._normals = np.ascontiguousarray(across[double > 0.0] / double[double > 0.0, None])
        self._reach = reach_m
        self._low: Float = corners.min(axis=(0, 1))
        size: Float = corners.max(axis=(0, 1)) - self._low
        self._side = max(_SIDE_M, float(np.cbrt(np.prod(size + _SIDE_M) / _MOST_CUBES)))
        self._shape: Int = (np.floor(size / self._side) + 1).astype(np.int64)
        first = np.zeros(int(np.prod(self._shape)) + 1, np.int64)
        count_cubes(self._corners, self._low, self._side, self._shape, first)
        self._first: Int = np.cumsum(first)
        self._member: Int = np.zeros(int(self._first[-1]), np.int64)
        list_cubes(self._corners, self._low, self._side, self._shape, self._first[:-1].copy(), self._member)

    def distance(self, points_part: Float) -> Float:
        """(n,) m, signed distance of points (n, 3), part frame: positive in the material, nan beyond reach."""
        out = np.empty(len(points_part))
        signed_distances(
            np.ascontiguousarray(points_part, np.float64),
            self._corners,
            self._normals,
            self._low,
            self._side,
            self._shape,
            self._first,
            self._member,
            self._reach,
            out,
        )
        return out
