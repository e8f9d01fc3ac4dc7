"""Deviation of the machined surface from the simulated undisturbed one, positive = material left.

Floors are compared on the height maps, along the nominal normal. A height map knows a vertical wall to one cell only,
so walls are taken from the swept tool paths instead: the horizontal distance between where the nominal and the actual
moves end, at three heights of each wall.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from counterflex.core.arrays import Bool, Float, Float32, as_positive
from counterflex.core.errors import InputError
from counterflex.core.units import MM, UM
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.stock import HeightMap
from counterflex.evaluate.figures import DeviationFigures
from counterflex.evaluate.swept_section import SweptSection, swept_section

CHANGED_M = 1.0 * UM  # a cell lowered by less was not machined
_OVER_M = 5.0 * UM  # the tool has been at this height above what it left: rounding of the map, and chords of the path
HEIGHTS = (0.1, 0.5, 0.9)  # of a wall


@dataclass(frozen=True)
class NominalSurface:
    """Surface that the undisturbed program makes: the floors and walls that deviations are measured on."""

    stock: HeightMap  # before machining
    nominal: HeightMap  # after the undisturbed program
    cutter: Cutter  # the tool; of several the widest
    floor: Bool  # (ny, nx) True on machined cells that do not adjoin a wall
    normal_z: Float32  # (ny, nx) vertical component of the floor's unit normal
    # (ny, nx) highest wall that stands within `reach_m` of the cell, m; infinite where there is none. Floor that lies
    # higher by more than half of it is not floor but the shifted wall
    rise_m: Float32
    # (ny, nx) deepest wall that drops off within `reach_m` of the cell, m; infinite where there is none
    fall_m: Float32
    wall_point: Float  # (m, 3) m points on nominal walls, exact (from the tool path)
    wall_normal: Float  # (m, 2) horizontal unit normals, from the cut into the material
    wall_area_m2: Float  # (m,) wall area each point stands for
    reach_m: float  # wall shifts up to this are followed

    @property
    def kept(self) -> Bool:
        """(ny, nx) True where something of the blank is left: elsewhere the program cuts through it."""
        out: Bool = self.nominal.z > self.stock.bottom_m + CHANGED_M
        return out


@dataclass(frozen=True)
class SurfaceDeviation:
    """Deviation of one machined part; m, positive = material left."""

    # (ny, nx) along the nominal normal; NaN off the floors and where a shifted wall stands on the floor: within reach
    # of a nominal wall, more than half its height off, or on a flank of the machined part
    floor_m: Float32
    wall_m: Float  # (m,) horizontal, at the nominal surface's wall points; NaN where the wall was not found in reach
    surface: DeviationFigures  # figures over floors and walls, by area
    floor: DeviationFigures  # over floors
    wall: DeviationFigures  # over walls
    floor_resolution_m: float  # grid of the floors: one cell
    # resolution of walls: exact section of the given path, so its sampling alone counts; stated as 0.1 um. The height
    # map alone would give one cell
    wall_resolution_m: float
    wall_lost_m2: float  # wall area with no result: shifted beyond the reach, or cut away from another side

    @classmethod
    def of(
        cls,
        surface: NominalSurface,
        actual: HeightMap,
        p_part_actual: Float,
        joined: Bool | None = None,
        outline: Float | None = None,
    ) -> SurfaceDeviation:
        """Compare a machined part with the nominal surface.

        Args:
            surface: From :func:`nominal_surface`.
            actual: Map as machined; same grid.
            p_part_actual: (n, 3) m, path of the tool tip as it really ran, dense enough that chords are as good as the
                path (the stations of :class:`~counterflex.evaluate.PathDeviation` are).
            joined: (n,) False where a sample does not continue the one before, or None.
            outline: (n, 2) m, radius and corner radius of the tool at each sample; None: of the one tool.

        Raises:
            InputError: Grids differ, or values are not finite.
        """
        floor: Float32 = floor_rise(surface, actual) * surface.normal_z
        wall = np.full(len(surface.wall_point), np.nan)
        if len(wall):
            section = swept_section(
                p_part_actual, surface.cutter if outline is None else outline, surface.reach_m, joined
            )
            inside = min(surface.reach_m, float(np.min(section.radius_m, initial=surface.cutter.radius_m)))
            reached, _ = section.wall_exit(surface.wall_point, surface.wall_normal, inside)
            wall = np.where(np.isfinite(reached), -reached, np.nan)
            above = _material_above(actual, surface, section)
            wall = np.where((wall > 0.0) & (above > 0.0), np.minimum(wall, above), wall)
        cells: Float = floor[~np.isnan(floor)].astype(np.float64)
        result = ~np.isnan(wall)
        cell_area = np.full(len(cells), actual.cell_m**2)
        return cls(
            floor_m=floor,
            wall_m=wall,
            surface=DeviationFigures.weighted(
                np.concatenate([cells, wall[result]]), np.concatenate([cell_area, surface.wall_area_m2[result]])
            ),
            floor=DeviationFigures.weighted(cells, cell_area),
            wall=DeviationFigures.weighted(wall[result], surface.wall_area_m2[result]),
            floor_resolution_m=actual.cell_m,
            wall_resolution_m=0.1 * UM,
            wall_lost_m2=float(surface.wall_area_m2[~result].sum()),
        )


def nominal_surface(
    stock: HeightMap,
    nominal: HeightMap,
    p_part_tcp: Float,
    cutter: Cutter,
    *,
    outline: Float | None = None,
    reach_m: float = 3.0 * MM,
    pitch_m: float = 0.5 * MM,
) -> NominalSurface:
    """Find the floors and walls that a program machines.

    A wall is where neighbouring cells differ by more than 1.5 cells (56 deg) and more than 0.1 mm; everything else
    that the program lowers is floor, but for the row of cells along a wall, which the map cannot tell from it.

    Args:
        stock: Map before machining.
        nominal: Map after removal simulation of the undisturbed path; same grid.
        p_part_tcp: (n, 3) m, the undisturbed path, joined by straight moves; part frame, tool along part z.
        cutter: The tool; of several the widest.
        outline: (n, 2) m, radius and corner radius of the tool that each row was run to with; None: of the one tool.
        reach_m: Largest wall shift that is followed; also how far from a wall the floor may be covered by it.
        pitch_m: Distance between wall points.

    Raises:
        InputError: Grids differ, or a length is out of range.
    """
    _same_grid(stock, nominal)
    reach, pitch = as_positive("reach_m", reach_m), as_positive("pitch_m", pitch_m)
    z = nominal.z
    machined: Bool = z < stock.z - np.float32(CHANGED_M)
    cell = nominal.cell_m
    step = _wall_step(cell)
    slope_x, slope_y = _slope(z, 1, cell, step), _slope(z, 0, cell, step)
    normal_z: Float32 = (1.0 / np.sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)).astype(np.float32)
    window = 2 * round(reach / cell) + 1
    foot, edge = _steps(z, step)
    rise: Float32 = scipy.ndimage.maximum_filter(foot, window)
    fall: Float32 = scipy.ndimage.maximum_filter(edge, window)
    rise[rise == 0.0] = np.inf
    fall[fall == 0.0] = np.inf
    point, normal, area = _walls(nominal, machined, p_part_tcp, cutter if outline is None else outline, step, pitch)
    floor: Bool = machined & (foot == 0.0) & (edge == 0.0)
    return NominalSurface(stock, nominal, cutter, floor, normal_z, rise, fall, point, normal, area, reach)


def floor_rise(surface: NominalSurface, actual: HeightMap) -> Float32:
    """Height of the floor of a machined part above nominal, (ny, nx) m.

    NaN off the floors and where a shifted wall stands on the floor (:class:`SurfaceDeviation`).

    Args:
        surface: From :func:`nominal_surface`.
        actual: Map as machined; same grid.

    Raises:
        InputError: Grids differ.
    """
    _same_grid(surface.nominal, actual)
    rise = actual.z - surface.nominal.z
    covered = (rise > 0.5 * surface.rise_m) | (-rise > 0.5 * surface.fall_m)
    foot, edge = _steps(actual.z, _wall_step(actual.cell_m))
    covered |= (np.isfinite(surface.rise_m) | np.isfinite(surface.fall_m)) & ((foot > 0.0) | (edge > 0.0))
    out: Float32 = np.where(surface.floor & ~covered, rise, np.float32(np.nan))
    return out


def _material_above(actual: HeightMap, surface: NominalSurface, section: SweptSection) -> Float:
    """Height of the machined surface above each wall point, on the side of the cut, m; inf under the blank's face."""
    # Where a shallow wall meets a floor that is a little too high, the surface above the point is far nearer than the
    # wall beside it. Machined is what the tool has been right above: the face of the real blank may lie lower than that
    # of the nominal one, so that a cell which is lower than the nominal blank need not have been cut.
    ny, nx = actual.z.shape
    side = surface.wall_point[:, :2] - actual.cell_m * surface.wall_normal
    i = np.clip(np.rint((side[:, 0] - actual.x0_m) / actual.cell_m).astype(np.int64), 0, nx - 1)
    j = np.clip(np.rint((side[:, 1] - actual.y0_m) / actual.cell_m).astype(np.int64), 0, ny - 1)
    z = actual.z[j, i].astype(np.float64)
    out = np.full(len(z), np.inf)
    lowered = np.flatnonzero(z < surface.stock.z[j, i] - np.float32(CHANGED_M))
    i, j = i[lowered], j[lowered]
    over = np.column_stack([actual.x0_m + i * actual.cell_m, actual.y0_m + j * actual.cell_m, z[lowered] + _OVER_M])
    cut = ~np.isnan(section.wall_exit(over, surface.wall_normal[lowered], 0.0)[0])
    out[lowered[cut]] = z[lowered[cut]] - surface.wall_point[lowered[cut], 2]
    return out


def _wall_step(cell: float) -> float:
    """Least difference of neighbouring cells that makes a wall, m."""
    return max(1.5 * cell, 0.1 * MM)


def _same_grid(a: HeightMap, b: HeightMap) -> None:
    """Refuse maps that do not lie cell on cell."""
    tiny = 1e-6 * a.cell_m
    if (
        a.z.shape != b.z.shape
        or abs(a.cell_m - b.cell_m) > tiny
        or abs(a.x0_m - b.x0_m) > tiny
        or abs(a.y0_m - b.y0_m) > tiny
    ):
        raise InputError(
            "height maps have different grids",
            value=f"{b.z.shape} cells of {b.cell_m:g} m at ({b.x0_m:g}, {b.y0_m:g})",
            limit=f"{a.z.shape} cells of {a.cell_m:g} m at ({a.x0_m:g}, {a.y0_m:g})",
        )


def _slope(z: Float32, axis: int, cell: float, step: float) -> Float32:
    """Mean slope to the two neighbours along an axis, those across a wall left out."""
    rise = np.diff(z, axis=axis)
    good = np.abs(rise) <= step
    rise = np.where(good, rise, np.float32(0.0))
    pad = [(0, 0), (0, 0)]
    before, after = list(pad), list(pad)
    before[axis], after[axis] = (1, 0), (0, 1)
    total = np.pad(rise, before) + np.pad(rise, after)
    count = np.pad(good.astype(np.int8), before) + np.pad(good.astype(np.int8), after)
    out: Float32 = (total / (np.maximum(count, 1) * cell)).astype(np.float32)
    return out


def _steps(z: Float32, step: float) -> tuple[Float32, Float32]:
    """Height of the highest wall that rises from each cell, and that drops off it; 0 where there is none."""
    foot, edge = np.zeros_like(z), np.zeros_like(z)
    for axis in (0, 1):
        before = (slice(None, -1), slice(None)) if axis == 0 else (slice(None), slice(None, -1))
        after = (slice(1, None), slice(None)) if axis == 0 else (slice(None), slice(1, None))
        rise = z[after] - z[before]
        rise[np.abs(rise) <= step] = 0.0
        for here, there, up in ((before, after, rise), (after, before, -rise)):
            foot[here] = np.maximum(foot[here], up)
            edge[there] = np.maximum(edge[there], up)
    return foot, edge


def _walls(
    nominal: HeightMap, machined: Bool, p_part_tcp: Float, cutter: Cutter | Float, step: float, pitch: float
) -> tuple[Float, Float, Float]:
    """Exact points on the nominal walls, their normals and areas."""
    cell = nominal.cell_m
    stride = max(1, round(pitch / cell))
    z = nominal.z
    points, directions, areas = [], [], []
    for axis in (0, 1):
        low, high = (z[:-1], z[1:]) if axis == 0 else (z[:, :-1], z[:, 1:])
        cut_low, cut_high = (machined[:-1], machined[1:]) if axis == 0 else (machined[:, :-1], machined[:, 1:])
        for sign, lower, upper, cut in ((1.0, low, high, cut_low), (-1.0, high, low, cut_high)):
            face = (upper - lower > step) & cut
            thin = np.zeros_like(face)
            if axis == 0:
                thin[:, ::stride] = True
            else:
                thin[::stride, :] = True
            j, i = np.nonzero(face & thin)
            base, top = lower[j, i].astype(np.float64), upper[j, i].astype(np.float64)
            centre = np.stack([nominal.x0_m + i * cell, nominal.y0_m + j * cell], axis=1)
            centre[:, 1 - axis] += 0.5 * cell
            ray = np.zeros((len(i), 2))
            ray[:, 1 - axis] = sign
            for fraction in HEIGHTS:
                points.append(np.column_stack([centre, base + fraction * (top - base)]))
                directions.append(ray)
                areas.append((top - base) * cell * stride / len(HEIGHTS))
    point, ray = np.concatenate(points), np.concatenate(directions)
    area = np.concatenate(areas)
    if len(point) == 0:
        return point, ray, area
    section = swept_section(p_part_tcp, cutter, max(2.0 * cell, 1e-3))
    distance, normal = section.wall_exit(point, ray, 0.5 * cell)
    valid = np.isfinite(distance) & (distance <= cell)
    point[:, :2] += np.where(valid, distance, 0.0)[:, None] * ray
    projected = area * np.abs(np.sum(normal * ray, axis=1))
    return point[valid], normal[valid], projected[valid]
