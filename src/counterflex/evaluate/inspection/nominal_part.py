"""The nominal part of an inspection: how far points are off its surface, and on which face they lie."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.units import MM, UM
from counterflex.cutting.stock import HeightMap
from counterflex.cutting.tridexel.cut_log import CutLog
from counterflex.evaluate.inspection.datum import NAMES, DatumFaces, datum_faces
from counterflex.evaluate.inspection.part_deviations import FLOOR, FREE, WALL
from counterflex.evaluate.surface import NominalSurface

REACH_M: Final = 3.0 * MM
"""Points further from the nominal surface are not of it."""
LARGEST_BALL_M: Final = 2.0 * MM
"""Radius of a probe's ball whose centres are found on their face: distances to what was cut are known within 5 mm."""
STEEP: Final = 0.55
"""Vertical component of the normal below which a surface is a wall: 56 deg."""
FACING: Final = float(np.cos(np.radians(30.0)))
"""Largest angle between the measured and the nominal normal: beyond it a point is of another face, or at an edge."""
_KINK: Final = 0.5
_STEP_M: Final = 1.0 * UM


@dataclass(frozen=True, eq=False)
class Nearest:
    """Points against the nominal surface, row by row."""

    # (n,) along the nominal normal, positive = outside of the nominal part; nan where the point is of no nominal
    # surface within reach that looks its way
    deviation_m: Float
    normals: Float  # (n, 3) outward unit normals of the nominal surface
    face: Int  # (n,) floor, wall or free (counterflex.evaluate.inspection.sections.FACES)
    near: Bool  # (n,) whether a nominal surface is within reach at all, whichever way it looks


class NominalShape(Protocol):
    """Machined surface of the nominal part: distances to it."""

    def distance(self, points_part: Float) -> Float:
        """(n,) m, signed distance of points (n, 3) to it, positive inside the material; nan out of reach."""


@dataclass(frozen=True, eq=False)
class NominalPart:
    """Part that a program makes of a blank."""

    surface: NominalSurface  # floors and walls of the undisturbed part
    shape: NominalShape  # exact distances to the surface that the program makes
    faces: DatumFaces  # planes of the blank

    @property
    def stock(self) -> HeightMap:
        """The blank."""
        return self.surface.stock

    @property
    def diagonal_m(self) -> float:
        """Of the blank."""
        return float(np.linalg.norm(self.faces.high - self.faces.low))

    @property
    def area_m2(self) -> float:
        """Of the blank's six faces, about that of the part."""
        x, y, z = self.faces.high - self.faces.low
        return float(2.0 * (x * y + y * z + z * x))

    def nearest(self, points_part: Float, measured_normals: Float | None = None, ball_radius_m: float = 0.0) -> Nearest:
        """Points against the nearest of what was cut and what was left of the blank.

        A wall that is 0.9 mm off lies nearer to the face of the blank that it runs out of than to its own nominal
        wall, all along the last 0.9 mm. Only surfaces that look the way of a point count for it, therefore.

        Args:
            points_part: (n, 3) m, part frame.
            measured_normals: (n, 3) unit normals of the measured surface at the points, of either sign; where one is
                nan, no surface counts. None: they are not known, and every surface counts.
            ball_radius_m: Where the points are centres of a probe's ball: its radius, m. Deviations are of centres.
        """
        reach = REACH_M + ball_radius_m
        deviation, normals = self._cut(points_part, reach)
        face = np.where(normals[:, 2] > STEEP, FLOOR, WALL)
        near = np.isfinite(deviation)
        if measured_normals is not None:
            deviation[~_agree(measured_normals, normals)] = np.nan
        for name in NAMES:
            normal, distance = self.faces.plane(name)
            off = points_part @ normal - distance
            closer = (np.abs(off) < reach) & ~(np.abs(off) >= np.abs(deviation))
            rows = np.flatnonzero(closer)
            rows = rows[self.faces.on(name, points_part[rows], edges=True)]
            inner = self.faces.on(name, points_part[rows])  # at its edges a face is not to be told from what is beside
            near[rows[inner]] = True
            if measured_normals is not None:
                same = _agree(measured_normals[rows], np.broadcast_to(normal, (len(rows), 3)))
                rows, inner = rows[same], inner[same]
            deviation[rows], normals[rows], face[rows] = np.where(inner, off[rows], np.nan), normal, FREE
        return Nearest(deviation, normals, face, near)

    def _cut(self, points_part: Float, reach: float) -> tuple[Float, Float]:
        """Deviation from the cut surface within reach, and its normals; nan where the foot is not on the part."""
        d = self.shape.distance(points_part)
        normals = np.full((len(d), 3), np.nan)
        rows = np.flatnonzero(np.abs(d) < reach)
        for axis in range(3):
            step = np.zeros(3)
            step[axis] = _STEP_M
            normals[rows, axis] = -(self.shape.distance(points_part[rows] + step) - d[rows]) / _STEP_M
        length = np.linalg.norm(normals[rows], axis=1)
        # under a slope the depth within the tool is less than the distance to what its edge sweeps: by the gradient
        slant = np.abs(length - 1.0) > 1e-2
        smooth = np.abs(length - 1.0) < _KINK  # at an edge between two sweeps there is no one normal
        normals[rows] /= np.where(smooth, length, np.nan)[:, None]
        d[rows] /= np.where(slant & smooth, length, 1.0)
        foot = points_part[rows] + d[rows, None] * normals[rows]
        on = smooth & self._was_material(foot)
        deviation = np.full(len(d), np.nan)
        deviation[rows[on]] = -d[rows[on]]
        return deviation, normals

    def _was_material(self, foot: Float) -> Bool:
        """Return whether feet of points lie in the blank, off its edges."""
        margin = 0.3 * MM
        inset = np.array([margin, margin, 0.0])
        low, high = self.faces.low + inset, self.faces.high - inset
        inside = np.all((foot > low) & (foot < high), axis=1)
        stock = self.stock
        i = np.clip(np.rint((foot[:, 0] - stock.x0_m) / stock.cell_m), 0, stock.z.shape[1] - 1)
        j = np.clip(np.rint((foot[:, 1] - stock.y0_m) / stock.cell_m), 0, stock.z.shape[0] - 1)
        i, j = np.nan_to_num(i).astype(np.int64), np.nan_to_num(j).astype(np.int64)
        out: Bool = inside & (foot[:, 2] < stock.z[j, i] - margin)
        return out

    def samples(self, pitch_m: float) -> tuple[Float, Float]:
        """Points (n, 3) m and outward normals (n, 3) all over the nominal part, about so far from each other."""
        points, normals = [], []
        for name in NAMES:
            some = self.faces.samples(name, pitch_m)
            points.append(some)
            normals.append(np.tile(self.faces.plane(name)[0], (len(some), 1)))
        nominal = self.surface.nominal
        step = max(1, round(pitch_m / nominal.cell_m))
        j, i = np.nonzero(self.surface.floor[step // 2 :: step, step // 2 :: step])
        j, i = step // 2 + j * step, step // 2 + i * step
        floor = np.column_stack(
            [nominal.x0_m + i * nominal.cell_m, nominal.y0_m + j * nominal.cell_m, nominal.z[j, i].astype(np.float64)]
        )
        points.append(floor)
        normals.append(np.tile([0.0, 0.0, 1.0], (len(floor), 1)))
        thin = max(1, round(pitch_m / (0.5 * MM)))
        wall = self.surface.wall_point[::thin]
        points.append(wall)
        normals.append(np.column_stack([-self.surface.wall_normal[::thin], np.zeros(len(wall))]))
        return np.concatenate(points), np.concatenate(normals)


def _agree(measured_normals: Float, normals: Float) -> Bool:
    """Return whether measured normals (n, 3), of either sign, are those of surfaces (n, 3)."""
    out: Bool = np.abs(np.einsum("nk,nk->n", measured_normals, normals)) > FACING  # nan agrees with nothing
    return out


def nominal_part(surface: NominalSurface, log: CutLog | NominalShape) -> NominalPart:
    """The nominal part of a program, from its floors and walls and all that it sweeps."""
    return NominalPart(surface, log, datum_faces(surface.stock, surface.nominal))
