"""Measure features of a machined part: width, depth, wall positions, diameter, roundness, flatness."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, as_positive
from counterflex.core.errors import InputError
from counterflex.core.units import DEG, MM, UM
from counterflex.cutting.stock import HeightMap
from counterflex.evaluate.feature_finding import CircularPocket, Feature, Groove
from counterflex.evaluate.floor_filter import FloorMap
from counterflex.evaluate.iso230.circular_test import Circularity
from counterflex.evaluate.measured_values import (
    OWN_FLOOR_M,
    MeasurablePart,
    Row,
    cells,
    flatness,
    height_at,
    values_row,
)
from counterflex.evaluate.prismatic.finding import PrismaticFeature, stands_out
from counterflex.evaluate.prismatic.measuring import measure_prismatic
from counterflex.evaluate.surface import NominalSurface, floor_rise
from counterflex.evaluate.swept_section import SweptSection, swept_section

# General tolerances for features whose drawing gives none: ISO 2768-1 m and ISO 2768-2 K.
# ISO 2768-2 was withdrawn in 2021. ISO 22081, which replaces it, has no tables: a drawing states its own values. The
# zones of part 2 are kept for drawings that name 2768-mK, and each row that stands on them says so.

SIZES: Final = "ISO 2768-1 m"
FORM: Final = "ISO 2768-2 K (withdrawn, see ISO 22081)"
"""Sources of tolerances that no drawing gave, as printed: of sizes and places, of flatness and roundness."""
# Upper end of the nominal range in mm -> +- tolerance in mm, class m (medium), ISO 2768-1 table 1
_LINEAR_M: Final = ((3.0, 0.1), (6.0, 0.1), (30.0, 0.2), (120.0, 0.3), (400.0, 0.5), (1000.0, 0.8), (2000.0, 1.2))
# Longest side in mm -> tolerance zone in mm, class K, ISO 2768-2 table 1
_FLAT_K: Final = ((10.0, 0.05), (30.0, 0.1), (100.0, 0.2), (300.0, 0.4), (1000.0, 0.6), (3000.0, 0.8))


def linear_m(nominal_m: float) -> float:
    """Permitted deviation of a length, +- m: ISO 2768-1, class m.

    Args:
        nominal_m: Nominal size, m, up to 2 m; sizes below 0.5 mm get the tolerance of the smallest range.

    Raises:
        InputError: The size is negative or beyond the table.
    """
    return _look_up(_LINEAR_M, nominal_m)


def flatness_k(side_m: float) -> float:
    """Width of the zone a flat surface must lie in, m: ISO 2768-2 (withdrawn), class K, by its longest side to 3 m."""
    return _look_up(_FLAT_K, side_m)


def _look_up(table: tuple[tuple[float, float], ...], size_m: float) -> float:
    size = as_positive("nominal size", size_m, zero=True)
    for limit, tolerance in table:
        if size <= limit * MM + UM:  # sizes measured on a map come with its rounding
            return tolerance * MM
    raise InputError("size is beyond the table of general tolerances", value=size, limit=f"<= {table[-1][0] * MM:g} m")


_LEAST_DEPTH_M = 0.2 * MM  # shallower, a wall has no height to be measured at
ZONES = ("flatness", "roundness")
_SIGNED = ("centre", "profile", "corners")
"""Beside the zones: distances from nominal, and deviations that have the sign of the surface already."""
WHOLE = 0.9
"""A quantity with values at fewer of its places is measured in part. Strips at the ends of a groove have none."""


@dataclass(frozen=True)
class FeatureRow:
    """One measured quantity of one feature."""

    feature: str  # its name
    # `width`, `depth`, `wall left`, `wall right`, `flatness`, `diameter`, `roundness` or `centre`. Left and right are
    # seen along the programmed motion; wall positions count from the centre line
    quantity: str
    nominal_m: float  # as the undisturbed program makes it, m
    worst_m: Mapping[str, float]  # variant name to the value furthest from nominal, m
    mean_m: Mapping[str, float]  # variant name to the mean value, m
    tolerance_m: float  # permitted deviation from nominal, +- m (a one-sided zone where the nominal value is 0)
    tolerance_source: str  # where the tolerance comes from
    # variant name to the standard deviation of the mean value, m, where the part was measured
    standard_deviation_m: Mapping[str, float] = field(default_factory=dict)
    # variant name to the share of the feature's places at which there was a value, 0 to 1
    measured_share: Mapping[str, float] = field(default_factory=dict)
    grows: bool = False  # the value grows with the material that is left: a zone, or the size of an island, rib or boss

    def partly(self, variant: str) -> bool:
        """True where a tenth of the places or more of a variant had no value: elsewhere it may be worse."""
        return self.measured_share.get(variant, 1.0) < WHOLE

    def ok(self, variant: str) -> bool:
        """True where the worst value of a variant keeps the tolerance."""
        return abs(self.worst_m[variant] - self.nominal_m) <= self.tolerance_m

    def material_left_m(self, variant: str) -> float:
        """Deviation of the worst value with the sign of the surface, m: positive where material is left.

        A groove or pocket that is too wide or too deep lacks material, an island that is too wide has some left; zones
        are positive.
        """
        off = self.worst_m[variant] - self.nominal_m
        return off if self.grows else -off


@dataclass(frozen=True)
class Machined:
    """One machining: its height map, and the tool path as it really ran (see :meth:`.SurfaceDeviation.of`)."""

    actual: HeightMap
    p_part_actual: Float
    joined: Bool | None = None
    outline: Float | None = None


@dataclass(frozen=True, eq=False)
class _Swept:
    """A simulated part: walls from the section of its tool path, floors from its map."""

    section: SweptSection
    floor: FloorMap

    def exits(self, point: Float, direction: Float) -> Float:
        return self.section.wall_exit(point, direction, 0.0)[0]

    def heights(self, xy: Float) -> Float:
        return self.floor.heights(xy)


def measure_features(
    surface: NominalSurface,
    p_part_nominal: Float,
    features: Sequence[Feature | PrismaticFeature],
    variants: Mapping[str, Machined | MeasurablePart],
    tolerances_m: Mapping[tuple[str, str], float] | None = None,
    *,
    outline: Float | None = None,
) -> tuple[FeatureRow, ...]:
    """Measure features on every variant and compare them with the undisturbed part.

    Walls are exact sections of the tool paths half way up the wall, every millimetre (every 2 deg in pockets), where
    the undisturbed part has a wall on both sides. Depths and flatness are those of the filtered floor
    (:mod:`~counterflex.evaluate.floor_filter`). Depths come from along the centre line; a ramp's
    depth is its deepest, changed by the largest deviation of any station. Flatness is the zone that holds
    the deviation of the floor after its best plane is taken out.

    Args:
        surface: From :func:`~counterflex.evaluate.nominal_surface`.
        p_part_nominal: (n, 3) m, path of the undisturbed program.
        features: From :func:`~counterflex.evaluate.feature_finding.find_features`, or given by hand; and from
            :func:`~counterflex.evaluate.prismatic.finding.find_prismatic`.
        variants: Name to machining, or to another part that can be measured.
        tolerances_m: (feature, quantity) to +- tolerance; general tolerances for what is not listed.
        outline: (n, 2) m, radius and corner radius of the tool that each row of the undisturbed path was run to with;
            None: of the one tool.

    Returns:
        Rows; a feature that the undisturbed part does not show (no walls, no depth) has none.

    Raises:
        InputError: There are no variants.
    """
    if not variants:
        raise InputError("there is no machined part to measure")
    reach = surface.cutter.radius_m + surface.reach_m
    one = surface.cutter
    nominal = swept_section(p_part_nominal, one if outline is None else outline, reach)
    parts: dict[str, MeasurablePart] = {
        name: _swept(surface, v, reach) if isinstance(v, Machined) else v for name, v in variants.items()
    }
    smallest = one.radius_m if outline is None else float(np.min(outline[:, 0]))
    rows: list[FeatureRow] = []
    for feature in features:
        if isinstance(feature, PrismaticFeature):
            measured = measure_prismatic(feature, surface, parts, smallest)
        elif isinstance(feature, Groove):
            measured = _groove(feature, surface, nominal, parts)
        else:
            measured = _pocket(feature, surface, nominal, parts)
        for quantity, value, size, worst, mean, share in measured:
            tolerance, by = (tolerances_m or {}).get((feature.name, quantity)), "given"
            if tolerance is None:
                tolerance, by = (flatness_k(size), FORM) if quantity in ZONES else (linear_m(size), SIZES)
            grows = quantity in (*ZONES, *_SIGNED) or (quantity != "height" and stands_out(feature))
            rows.append(
                FeatureRow(feature.name, quantity, value, worst, mean, tolerance, by, measured_share=share, grows=grows)
            )
    return tuple(rows)


def _groove(
    groove: Groove, surface: NominalSurface, nominal: SweptSection, parts: Mapping[str, MeasurablePart]
) -> list[Row]:
    run = groove.end - groove.start
    length = float(np.hypot(run[0], run[1]))
    u = run[:2] / length
    left = np.array([-u[1], u[0]])
    s = np.arange(0.5 * MM, length, MM)
    tip = groove.start + (s / length)[:, None] * run
    radius = groove.radius_m
    top = height_at(surface.stock, tip[:, :2])
    wall_top = _wall_top(surface, tip[:, :2], np.tile(left, (len(s), 1)), radius, top)
    height = tip[:, 2] + 0.5 * (wall_top - tip[:, 2])
    good = np.isfinite(wall_top) & (wall_top - tip[:, 2] > _LEAST_DEPTH_M)
    point = np.column_stack([tip[:, :2], np.where(good, height, 0.0)])
    sides = {"wall left": np.tile(left, (len(s), 1)), "wall right": np.tile(-left, (len(s), 1))}
    reached = {side: nominal.wall_exit(point, ray, 0.0)[0] for side, ray in sides.items()}
    for value in reached.values():
        good &= np.abs(value - radius) < UM
    if int(good.sum()) < 3:
        return []
    position = {
        side: {name: part.exits(point[good], ray[good]) for name, part in parts.items()} for side, ray in sides.items()
    }
    rows: list[Row] = []
    width = {name: position["wall left"][name] + position["wall right"][name] for name in parts}
    rows.append(values_row("width", 2.0 * radius, 2.0 * radius, width))
    rows.extend(values_row(side, radius, radius, position[side]) for side in sides)
    near = np.inf if groove.inclined else OWN_FLOOR_M
    floor = good & (np.abs(height_at(surface.nominal, tip[:, :2]) - tip[:, 2]) < near)
    floor &= _clear(surface, tip[:, :2], radius)
    if int(floor.sum()) >= 3:  # else a deeper cut has taken the middle of it away
        depth = top[floor] - height_at(surface.nominal, tip[floor, :2])
        deepest = float(depth.max())
        change = {name: depth - (top[floor] - part.heights(tip[floor, :2])) for name, part in parts.items()}
        rows.append(values_row("depth", deepest, deepest, {name: deepest - value for name, value in change.items()}))
    across = np.linspace(-0.6, 0.6, 7) * radius
    place = (tip[good, None, :2] + across[None, :, None] * left).reshape(-1, 2)
    own = np.abs(height_at(surface.nominal, place) - np.repeat(tip[good, 2], len(across))) < near
    place = place[own]
    rows.extend(flatness(place, surface, parts, float(np.ptp(s[good]))))
    return rows


def _pocket(
    pocket: CircularPocket, surface: NominalSurface, nominal: SweptSection, parts: Mapping[str, MeasurablePart]
) -> list[Row]:
    angle = np.arange(0.0, 360.0, 2.0) * DEG
    ray = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    place = pocket.centre + pocket.path_radius_m * ray
    cutter = pocket.radius_m
    top = height_at(surface.stock, place)
    wall_top = np.minimum(top, height_at(surface.nominal, place + (cutter + 1.5 * surface.nominal.cell_m) * ray))
    good = np.isfinite(wall_top) & (wall_top - pocket.floor_m > _LEAST_DEPTH_M)
    point = np.column_stack([place, np.where(good, 0.5 * (wall_top + pocket.floor_m), 0.0)])
    # the chords of a sampled arc stay inside it by less than this
    good &= np.abs(nominal.wall_exit(point, ray, 0.0)[0] - cutter) < 20.0 * UM
    if int(good.sum()) < 90:
        return []
    radius = pocket.path_radius_m + cutter
    diameter, round_, centre, shares = {}, {}, {}, {}
    for name, part in parts.items():
        reached = part.exits(point[good], ray[good])
        hit = np.isfinite(reached)
        shares[name] = float(hit.mean())
        wall = place[good][hit] + reached[hit, None] * ray[good][hit]
        if len(wall) < 45:
            continue
        circle = Circularity.of(wall, pocket.centre, radius)
        diameter[name] = np.array([2.0 * circle.radius_m])
        round_[name] = np.array([circle.g_m])
        centre[name] = np.array([float(np.hypot(*circle.centre_offset_m))])
    rings = np.concatenate([pocket.centre + r * ray[good] for r in np.linspace(0.3, 1.0, 5) * pocket.path_radius_m])
    rings = rings[np.abs(height_at(surface.nominal, rings) - pocket.floor_m) < OWN_FLOOR_M]
    floor = place[good]
    own = np.abs(height_at(surface.nominal, floor) - pocket.floor_m) < OWN_FLOOR_M
    own &= _clear(surface, floor, cutter)
    floor, depths = floor[own], []
    if len(floor) >= 3:
        depth = top[good][own] - height_at(surface.nominal, floor)
        deepest = float(depth.max())
        change = {name: depth - (top[good][own] - part.heights(floor)) for name, part in parts.items()}
        depths = [values_row("depth", deepest, deepest, {name: deepest - value for name, value in change.items()})]
    return [
        values_row("diameter", 2.0 * radius, 2.0 * radius, diameter, shares),
        values_row("roundness", 0.0, 2.0 * radius, round_, shares),
        values_row("centre", 0.0, radius, centre, shares),
        *depths,
        *flatness(rings, surface, parts, 2.0 * radius),
    ]


def _clear(surface: NominalSurface, xy: Float, radius: float) -> Bool:
    """Places on which no shifted wall can stand: of a tool that reaches so far only those of crossing cuts can."""
    if radius <= surface.reach_m:
        return np.ones(len(xy), np.bool_)
    j, i, _ = cells(surface.nominal, xy)
    out: Bool = np.isinf(surface.rise_m[j, i]) & np.isinf(surface.fall_m[j, i])
    return out


def _wall_top(surface: NominalSurface, xy: Float, left: Float, radius: float, top: Float) -> Float:
    """Height of what stands beside a groove, the lower of both sides: its walls end there; ``top`` off the blank."""
    out = top
    for sign in (1.0, -1.0):
        height = height_at(surface.nominal, xy + sign * (radius + 1.5 * surface.nominal.cell_m) * left)
        out = np.minimum(out, np.where(np.isfinite(height), height, top))
    return out


def uncovered(
    surface: NominalSurface, features: Sequence[Feature], rows: Sequence[FeatureRow]
) -> tuple[tuple[Feature, ...], Bool, Bool]:
    """Return which features have rows, and which wall points (m,) and floor cells (ny, nx) of a surface are theirs.

    ``features``: that were measured; ``rows``: of them.
    """
    named = {row.feature for row in rows}
    shown = tuple(feature for feature in features if feature.name in named)
    walls = np.zeros(len(surface.wall_point), np.bool_)
    floors = np.zeros(surface.floor.shape, np.bool_)
    grid = surface.nominal
    j, i = np.nonzero(surface.floor)
    places = np.column_stack([grid.x0_m + i * grid.cell_m, grid.y0_m + j * grid.cell_m, grid.z[j, i].astype(float)])
    tolerance = 1.5 * grid.cell_m
    for feature in shown:
        walls |= feature.covers(surface.wall_point, tolerance)
        floors[j, i] |= feature.covers(places, tolerance)
    return shown, walls, floors


def _swept(surface: NominalSurface, machined: Machined, reach: float) -> _Swept:
    outline = surface.cutter if machined.outline is None else machined.outline
    return _Swept(
        swept_section(machined.p_part_actual, outline, reach, machined.joined),
        FloorMap(surface.nominal, floor_rise(surface, machined.actual)),
    )
