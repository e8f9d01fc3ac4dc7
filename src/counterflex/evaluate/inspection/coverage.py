"""Area of the machined surface that a measurement judged, saw without judging, or did not see.

    machined = judged + unjudged + unseen

The machined surface is sampled at places that stand for an area each. A place is judged where a deviation was measured
beside it on its own face, and unjudged where points of the scan lie over it that count for no face: at edges, or where
the measured surface looks another way than the nominal one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Bool, Float, Int, batches
from counterflex.core.units import MM
from counterflex.evaluate.feature_finding import Feature
from counterflex.evaluate.features import WHOLE
from counterflex.evaluate.inspection.nominal_part import FACING, REACH_M
from counterflex.evaluate.inspection.sections import InspectedPart
from counterflex.evaluate.measured_values import height_at
from counterflex.evaluate.prismatic.finding import PrismaticFeature
from counterflex.evaluate.surface import CHANGED_M, HEIGHTS, NominalSurface

_PITCHES: Final = 1.5
"""A place is judged by a point nearer than so many pitches: of points at random one in 1200 has none."""
_FINEST_M: Final = 0.3 * MM
_STEEPEST: Final = 1.5
_WIDEST_M: Final = 2.0 * MM
"""A probed point says nothing about a surface further away, however far apart the points are."""


@dataclass(frozen=True)
class Coverage:
    """Machined area by what is known about it, m2."""

    machined_m2: float  # whole
    judged_m2: float  # with a measured deviation beside it
    unjudged_m2: float  # points were measured over it, and count for no face
    unseen_m2: float  # no point was measured within 3 mm of it

    @property
    def judged_share(self) -> float:
        """Judged by machined area; 1 where nothing is machined."""
        return self.judged_m2 / self.machined_m2 if self.machined_m2 > 0.0 else 1.0

    @property
    def whole(self) -> bool:
        """True where less than a tenth was not judged."""
        return self.judged_share >= WHOLE


@dataclass(frozen=True, eq=False)
class MachinedPlaces:
    """Samples of the machined surface."""

    points: Float  # (n, 3) m, part frame
    normals: Float  # (n, 3) outward unit normals
    area_m2: Float  # (n,) that each stands for

    def _sums(self, judged: Bool, seen: Bool, some: Bool) -> Coverage:
        area = self.area_m2
        return Coverage(
            float(area[some].sum()),
            float(area[some & judged].sum()),
            float(area[some & seen & ~judged].sum()),
            float(area[some & ~seen].sum()),
        )

    def _judged(self, part: InspectedPart, reach: float) -> Bool:
        """Return which places have a deviation of a face that looks their way within reach."""
        rows = part.rows
        out = np.zeros(len(self.points), np.bool_)
        if len(rows) == 0 or len(out) == 0:
            return out
        k = min(8, len(rows))
        distance, near = scipy.spatial.cKDTree(rows.points).query(self.points, k=k, distance_upper_bound=reach)
        distance, near = distance.reshape(len(out), k), near.reshape(len(out), k)
        near_by = np.isfinite(distance)
        facing = np.einsum("mkd,md->mk", rows.normals[np.where(near_by, near, 0)], self.normals)
        out |= np.any(near_by & (facing > FACING), axis=1)
        return out


def machined_places(surface: NominalSurface, pitch_m: float) -> MachinedPlaces:
    """Sample floors and walls about so far apart; the areas add up to those of the surface.

    Floors reach to the foot of their walls here: the row of cells there is not judged in the map, but it is machined.
    """
    grid = surface.nominal
    step = max(1, round(pitch_m / grid.cell_m))
    j, i = np.nonzero(surface.kept & (grid.z < surface.stock.z - np.float32(CHANGED_M)))
    whole = float(np.sum(grid.cell_m**2 / surface.normal_z[j, i].astype(np.float64)))
    thin = (j % step == step // 2) & (i % step == step // 2)
    if not thin.any():
        thin[:] = True
    j, i = j[thin], i[thin]
    floor = np.column_stack([grid.x0_m + i * grid.cell_m, grid.y0_m + j * grid.cell_m, grid.z[j, i].astype(np.float64)])
    area = 1.0 / surface.normal_z[j, i].astype(np.float64)
    area *= whole / area.sum() if len(area) else 1.0
    wall, way, wall_area = _wall_places(surface, pitch_m)
    up = _floor_normals(surface, j, i)
    sideways = np.column_stack([-way, np.zeros(len(way))])
    return MachinedPlaces(
        np.concatenate([floor, wall]), np.concatenate([up, sideways]), np.concatenate([area, wall_area])
    )


def _floor_normals(surface: NominalSurface, j: Int, i: Int) -> Float:
    """Unit normals (n, 3) of floor cells, by the heights of their neighbours."""
    z, cell = surface.nominal.z, surface.nominal.cell_m
    ny, nx = z.shape
    slope = [
        (z[np.minimum(j + dj, ny - 1), np.minimum(i + di, nx - 1)] - z[np.maximum(j - dj, 0), np.maximum(i - di, 0)])
        / (2.0 * cell)
        for dj, di in ((0, 1), (1, 0))
    ]
    flat = surface.normal_z[j, i] > 1.0 - 1e-6
    x, y = (np.where(flat | (np.abs(one) > _STEEPEST), 0.0, one) for one in slope)  # beside a wall it is the wall's
    out: Float = np.column_stack([-x, -y, np.ones(len(x))]).astype(np.float64)
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    return out


def _wall_places(surface: NominalSurface, pitch_m: float) -> tuple[Float, Float, Float]:
    """Places on the walls, the way into the material, and areas: each third of a wall's height in steps of a pitch."""
    points, way, area = surface.wall_point, surface.wall_normal, surface.wall_area_m2
    if len(points) == 0:
        return points, way, area
    aside = 1.5 * surface.nominal.cell_m * way
    low = height_at(surface.nominal, points[:, :2] - aside)
    high = height_at(surface.nominal, points[:, :2] + aside)
    size = high - low
    share = (points[:, 2] - low) / np.where(size > 0.0, size, np.nan)
    third = np.argmin(np.abs(np.nan_to_num(share, nan=0.5)[:, None] - np.array(HEIGHTS)), axis=1)
    whole = np.isfinite(share) & (np.abs(share - np.array(HEIGHTS)[third]) < 0.1)
    number = np.where(whole, np.maximum(1, np.ceil(size / 3.0 / pitch_m)), 1).astype(np.int64)
    owner = np.repeat(np.arange(len(points)), number)
    within = np.arange(len(owner)) - np.repeat(np.cumsum(number) - number, number)
    z = low[owner] + size[owner] / 3.0 * (third[owner] + (within + 0.5) / number[owner])
    out = points[owner].copy()
    out[:, 2] = np.where(whole[owner], z, out[:, 2])
    return out, way[owner], area[owner] / number[owner]


def coverage(
    part: InspectedPart, features: Sequence[Feature | PrismaticFeature]
) -> tuple[Coverage, Mapping[str, Coverage]]:
    """Areas of a whole part and of each of its features.

    Args:
        features: Of the program; one that leaves no machined surface has no entry.
    """
    surface = part.part.surface
    places = machined_places(surface, float(np.clip(part.pitch_m, _FINEST_M, _WIDEST_M)))
    reach = min(max(_PITCHES * part.pitch_m, surface.nominal.cell_m), _WIDEST_M)
    judged = places._judged(part, reach)
    seen = judged.copy()
    rows = np.flatnonzero(~judged)
    seen[rows] = _under_points(places.points[rows], places.normals[rows], part.left_out, reach)
    tolerance = max(1.5 * surface.nominal.cell_m, 0.1 * MM)
    of_features = {one.name: one.covers(places.points, tolerance) for one in features}
    return places._sums(judged, seen, np.ones(len(judged), np.bool_)), {
        name: places._sums(judged, seen, mask) for name, mask in of_features.items() if mask.any()
    }


def _under_points(points: Float, normals: Float, measured: Float, reach: float) -> Bool:
    """Return which places have a measured point over or under them: within reach of their normal, 3 mm along it."""
    out = np.zeros(len(points), np.bool_)
    if len(measured) == 0 or len(points) == 0:
        return out
    tree = scipy.spatial.cKDTree(measured)
    for some in batches(len(points), 2048):
        lists = tree.query_ball_point(points[some], REACH_M)
        count = np.array([len(one) for one in lists])
        if count.sum() == 0:
            continue
        place = np.repeat(np.arange(len(lists)), count)
        step = measured[np.concatenate([np.asarray(one, np.int64) for one in lists])] - points[some][place]
        along = np.einsum("kd,kd->k", step, normals[some][place])
        aside = np.linalg.norm(step - along[:, None] * normals[some][place], axis=1)
        out[some] = np.bincount(place[aside < reach], minlength=len(lists)) > 0
    return out
