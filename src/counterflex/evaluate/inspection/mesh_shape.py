"""A CAD mesh or solid as what was to be made: exact signed distances to its triangles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.units import MM
from counterflex.evaluate.inspection.mesh_kernel import count_cubes, list_cubes, signed_distances

_SIDE_M: Final = 1.0 * MM
_MOST_CUBES: Final = 8_000_000
_SAME: Final = 0.98  # Cosine of 11 deg: neighbouring triangles of a curved face differ by less


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
        self._kept: Int = np.flatnonzero(double > 0.0)
        corners = np.ascontiguousarray(corners[self._kept])
        self._normals = np.ascontiguousarray(across[self._kept] / double[self._kept, None])
        low: Float = corners.min(axis=(0, 1))
        size: Float = corners.max(axis=(0, 1)) - low
        side = max(_SIDE_M, float(np.cbrt(np.prod(size + _SIDE_M) / _MOST_CUBES)))
        shape: Int = (np.floor(size / side) + 1).astype(np.int64)
        count = np.zeros(int(np.prod(shape)) + 1, np.int64)
        count_cubes(corners, low, side, shape, count)
        first: Int = np.cumsum(count)
        member: Int = np.zeros(int(first[-1]), np.int64)
        list_cubes(corners, low, side, shape, first[:-1].copy(), member)
        self._grid = (corners, self._normals, low, side, shape, first, member, reach_m)

    def distance(self, points_part: Float) -> Float:
        """(n,) m, signed distance of points (n, 3), part frame: positive in the material, nan beyond reach."""
        return self.nearest(points_part)[0]

    def nearest(self, points_part: Float) -> tuple[Float, Int]:
        """As :meth:`distance`, and the nearest triangle of each point (n,), of those that have an area."""
        out, triangle = np.empty(len(points_part)), np.empty(len(points_part), np.int64)
        signed_distances(np.ascontiguousarray(points_part, np.float64), *self._grid, out, triangle)
        return out, triangle


@dataclass(frozen=True, eq=False)
class CadFace:
    """A face of a solid, by its CAD file."""

    name: str  # its own; else kind and number in the file
    kind: str  # plane, cylinder, cone, sphere, torus, or free form
    point: Float  # (3,) m, on the plane, or on the axis; part frame
    axis: Float  # (3,) unit vector: of a plane its outward normal
    radius_m: float  # of a cylinder
    # by quantity: nominal value, m (None: that of the geometry), and +- tolerance, m, as the file states them
    limits: dict[str, tuple[float | None, float]]

    @property
    def frame(self) -> Float:
        """(3, 3), columns: two directions across the axis, and the axis."""
        first = np.cross(self.axis, np.eye(3)[np.argmin(np.abs(self.axis))])
        first /= np.linalg.norm(first)
        return np.column_stack([first, np.cross(self.axis, first), self.axis])


class CadSolid(MeshShape):
    """A closed solid, meshed, whose triangles know their faces."""

    def __init__(
        self,
        vertices: Float,
        triangles: Int,
        owner: Int,
        faces: Sequence[CadFace],
        reach_m: float,
        not_measured: tuple[str, ...] = (),
    ) -> None:
        """Prepare a solid, see :class:`MeshShape`.

        Args:
            owner: (t,) face of each triangle.
            not_measured: Names of tolerances of the file that no face holds.
        """
        super().__init__(vertices, triangles, reach_m)
        self.vertices, self.triangles, self.owner, self.faces = vertices, triangles, owner, tuple(faces)
        self.not_measured = not_measured

    def face_of(self, points_part: Float, normals: Float) -> Int:
        """(n,) face that points (n, 3) on the surface lie on; -1 where it looks another way than ``normals`` (n, 3).

        Beyond a wall that was cut too far out, the nearest place of the nominal part is the edge at its foot: such a
        point is of the wall, and not of the floor that ends there too.
        """
        triangle = self.nearest(points_part)[1]
        same = np.einsum("nk,nk->n", self._normals[triangle], normals) > _SAME
        return np.where(same, self.owner[self._kept[triangle]], -1)
