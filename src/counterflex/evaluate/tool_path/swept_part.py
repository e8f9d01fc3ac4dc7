"""The part that the measured path of the tool would leave: walls and floors by removal, as of a simulated part."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.units import MM
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.removal import remove_path
from counterflex.cutting.stock import HeightMap
from counterflex.evaluate.figures import DeviationFigures
from counterflex.evaluate.floor_filter import FloorMap
from counterflex.evaluate.inspection.nominal_part import NominalPart
from counterflex.evaluate.inspection.part_deviations import FLOOR, WALL, PartDeviations
from counterflex.evaluate.inspection.registration import Registration
from counterflex.evaluate.measured_values import height_at
from counterflex.evaluate.surface import SurfaceDeviation, floor_rise
from counterflex.evaluate.swept_section import SweptSection, swept_section
from counterflex.evaluate.tool_path.tracked_path import TrackedPath
from counterflex.path.toolpath import ToolPath

_PLACES_M: Final = 1.0 * MM


@dataclass(frozen=True, eq=False)
class SweptPart:
    """Part that a tool leaves of the blank along a measured path; the surface itself was not measured."""

    part: NominalPart  # what was to be made
    registration: Registration  # where the log lies in the part frame
    track: TrackedPath  # the measured path on the program's
    p_part_tcp: Float  # (n, 3) m, the undisturbed path
    p_part_actual: Float  # (k, 3) m, the measured path, smoothed
    joined: Bool  # (k,) stations that continue the one before
    outline: Float  # (k, 2) m, radius and corner radius of the tool at each station
    actual: HeightMap  # what removal along it leaves
    hidden: Float  # (m, 3) m, places of the program's path that were not measured
    # (n, 2) m, radius and corner radius of the tool at each row of the undisturbed path
    nominal_outline: Float | None = None

    @cached_property
    def _section(self) -> SweptSection:
        surface = self.part.surface
        return swept_section(self.p_part_actual, self.outline, surface.cutter.radius_m + surface.reach_m, self.joined)

    @cached_property
    def _floor(self) -> FloorMap:
        surface = self.part.surface
        return FloorMap(surface.nominal, floor_rise(surface, self.actual))

    @cached_property
    def _hidden(self) -> scipy.spatial.cKDTree | None:
        return scipy.spatial.cKDTree(self.hidden[:, :2]) if len(self.hidden) else None

    def _shown(self, xy: Float) -> Bool:
        """Return whether places (n, 2) are out of reach of what was not measured."""
        out = np.ones(len(xy), np.bool_)
        tree = self._hidden
        if tree is not None:
            reach = float(self.outline[:, 0].max()) + _PLACES_M
            finite = np.isfinite(xy).all(axis=1)
            out[finite] = tree.query(xy[finite], distance_upper_bound=reach)[0] > reach
        return out

    def exits(self, point: Float, direction: Float) -> Float:
        """See :class:`~counterflex.evaluate.features.MeasurablePart`: where the measured moves of the tool end."""
        out = self._section.wall_exit(point, direction, 0.0)[0]
        return np.where(self._shown(point[:, :2]), out, np.nan)

    def heights(self, xy: Float) -> Float:
        """See :class:`~counterflex.evaluate.features.MeasurablePart`: what the measured moves leave."""
        return np.where(self._shown(xy), self._floor.heights(xy), np.nan)

    def shifted(self, step: Float) -> SweptPart:
        """The same path lying elsewhere by a small shift and turn (6,) about the registration's centre: m, rad."""
        centre = self.registration.centre
        moved = self.p_part_actual + step[:3] + np.cross(step[3:], self.p_part_actual - centre)
        grid = self.actual
        ny, nx = grid.z.shape
        x = grid.x0_m + grid.cell_m * np.arange(nx) - centre[0]
        y = grid.y0_m + grid.cell_m * np.arange(ny) - centre[1]
        rise = step[2] + step[3] * y[:, None] - step[4] * x[None, :]
        cut = grid.z < self.part.stock.z
        z = np.where(cut, grid.z + rise.astype(np.float32), grid.z).astype(np.float32)
        return replace(self, p_part_actual=moved, actual=replace(grid, z=z))

    def redrawn(self, rng: np.random.Generator) -> None:
        """None: each draw would be a removal of its own."""

    @property
    def pitch_m(self) -> float:
        """Distance of the rows from each other, m."""
        return _PLACES_M

    @property
    def left_out(self) -> Float:
        """No points: the surface itself was not measured."""
        return np.empty((0, 3))

    def place_sigma_m(self) -> float:
        """Standard deviation of a wall or floor place by the noise of the readings, median where the tool cut, m."""
        some = self.track.deviation.cutting
        return float(np.median(self.track.sigma_m[some])) if some.any() else 0.0

    @cached_property
    def _deviation(self) -> SurfaceDeviation:
        surface = self.part.surface
        whole = SurfaceDeviation.of(surface, self.actual, self.p_part_actual, self.joined, self.outline)
        if self._hidden is None:
            return whole
        floor, wall = whole.floor_m.copy(), whole.wall_m.copy()
        grid = self.actual
        j, i = np.nonzero(~np.isnan(floor))
        unseen = ~self._shown(np.column_stack([grid.x0_m + i * grid.cell_m, grid.y0_m + j * grid.cell_m]))
        floor[j[unseen], i[unseen]] = np.nan
        wall[~self._shown(surface.wall_point[:, :2])] = np.nan
        cells, known = floor[~np.isnan(floor)].astype(np.float64), ~np.isnan(wall)
        area = np.full(len(cells), grid.cell_m**2)
        return replace(
            whole,
            floor_m=floor,
            wall_m=wall,
            surface=DeviationFigures.weighted(
                np.concatenate([cells, wall[known]]), np.concatenate([area, surface.wall_area_m2[known]])
            ),
            floor=DeviationFigures.weighted(cells, area),
            wall=DeviationFigures.weighted(wall[known], surface.wall_area_m2[known]),
            wall_lost_m2=float(surface.wall_area_m2[~known].sum()),
        )

    def surface_deviation(self) -> SurfaceDeviation:
        """The map, as of a simulated part."""
        return self._deviation

    @cached_property
    def rows(self) -> PartDeviations:
        """Deviations at places of the nominal surface, about a millimetre apart, with their standard deviation."""
        surface, deviation = self.part.surface, self._deviation
        grid = surface.nominal
        step = max(1, round(_PLACES_M / grid.cell_m))
        j, i = (
            step // 2 + step * index
            for index in np.nonzero(~np.isnan(deviation.floor_m[step // 2 :: step, step // 2 :: step]))
        )
        floor = np.column_stack([grid.x0_m + i * grid.cell_m, grid.y0_m + j * grid.cell_m, grid.z[j, i]]).astype(
            np.float64
        )
        known = np.flatnonzero(~np.isnan(deviation.wall_m))
        points = np.concatenate([floor, surface.wall_point[known]])
        up = np.tile([0.0, 0.0, 1.0], (len(floor), 1))
        normals = np.concatenate([up, np.column_stack([-surface.wall_normal[known], np.zeros(len(known))])])
        values = np.concatenate([deviation.floor_m[j, i].astype(np.float64), deviation.wall_m[known]])
        nearest = scipy.spatial.cKDTree(self.p_part_actual).query(points)[1]
        by_pose = self.registration.standard_deviation_m(points, normals)
        sigma = np.sqrt(self.track.sigma_m[nearest] ** 2 + by_pose**2)
        face = np.concatenate([np.full(len(floor), FLOOR), np.full(len(known), WALL)])
        return PartDeviations(points, normals, values, sigma, face)


def swept_part(
    part: NominalPart,
    path: ToolPath,
    tool: Int,
    cutter: Callable[[int], Cutter],
    track: TrackedPath,
    registration: Registration,
) -> SweptPart:
    """Cut the blank along a measured path.

    Args:
        part: What was to be made.
        tool: (n,) number of the tool that each row of it is cut with.
        cutter: Gives the cutter of a number.
        registration: Where the log lies.
    """
    p, joined = track.p_part, ~track.deviation.broken
    number, kind = tool[track.row], np.asarray(path.kind)[track.row]
    cutters = {int(one): cutter(int(one)) for one in np.unique(number)}
    outline = np.array([[cutters[int(k)].radius_m, cutters[int(k)].corner_radius_m] for k in number])
    of_rows = {int(one): cutter(int(one)) for one in np.unique(tool)}
    nominal_outline = np.array([[of_rows[int(k)].radius_m, of_rows[int(k)].corner_radius_m] for k in tool])
    left = part.stock.copy()
    edges = np.flatnonzero(~joined[1:] | (number[1:] != number[:-1])) + 1
    for first, last in itertools.pairwise([0, *edges.tolist(), len(p)]):
        begin = first if first == 0 or not joined[first] else first - 1
        if last - begin > 1:
            some = slice(begin, last)
            remove_path(left, p[some], kind[some], cutters[int(number[last - 1])], engagement=False)
    return SweptPart(
        part, registration, track, path.p_part_tcp, p, joined, outline, left, track.hidden, nominal_outline
    )


def surfaces_made(part: NominalPart, track: TrackedPath, radius_m: Float) -> tuple[Bool, Bool, Bool]:
    """Mark the surfaces of the finished part that each station makes: floor, wall on its left, wall on its right.

    Args:
        part: What was to be made.
        track: The measured path, k stations.
        radius_m: (k,) of the tool at each station.
    """
    deviation, surface = track.deviation, part.surface
    near = deviation.p_part_nominal
    height = height_at(surface.nominal, near[:, :2])
    floor: Bool = deviation.cutting & (np.abs(height - near[:, 2]) < 0.05 * MM + surface.nominal.cell_m)
    sides = []
    tree = scipy.spatial.cKDTree(surface.wall_point) if len(surface.wall_point) else None
    for sign in (1.0, -1.0):
        on = np.zeros(len(near), np.bool_)
        if tree is not None:
            way = sign * deviation.left
            level = np.abs(way[:, 2]) < 0.1
            reach = near + way * radius_m[:, None]
            for height_share in (0.5, 2.0):  # above the tip, mm
                place = reach + np.array([0.0, 0.0, height_share * MM])
                distance, nearest = tree.query(place, k=8)
                facing = (
                    np.einsum(
                        "nkd,nd->nk", surface.wall_normal[np.minimum(nearest, len(surface.wall_point) - 1)], way[:, :2]
                    )
                    > 0.95
                )
                away = surface.wall_point[np.minimum(nearest, len(surface.wall_point) - 1), :2] - reach[:, None, :2]
                across = np.abs(np.einsum("nkd,nd->nk", away, way[:, :2])) < 0.1 * MM
                on |= level & np.any(facing & across & (distance < 2.5 * MM), axis=1)
        sides.append(deviation.cutting & on)
    return floor, sides[0], sides[1]
