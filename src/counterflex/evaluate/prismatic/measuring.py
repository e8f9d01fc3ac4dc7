"""Measure the features that were found on a surface."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import MM
from counterflex.evaluate.iso230.circular_test import Circularity
from counterflex.evaluate.measured_values import MeasurablePart, Row, flatness, height_at, values_row
from counterflex.evaluate.prismatic.finding import PrismaticFeature, WallPair, WallSegment
from counterflex.evaluate.surface import NominalSurface

_END_M: Final = 1.0 * MM  # Strip at both ends of a wall that is left out: corners have a radius
_INSET: Final = 0.5
"""A ray begins at this share of the smallest radius of a tool before the wall, where the tool has been."""
_SIDES: Final = {(1, 0): "x+", (-1, 0): "x-", (0, 1): "y+", (0, -1): "y-"}
Parts = Mapping[str, MeasurablePart]


def measure_prismatic(
    feature: PrismaticFeature, surface: NominalSurface, parts: Parts, smallest_radius_m: float
) -> list[Row]:
    """Rows of one feature.

    ``feature``: found on the surface; ``parts``: by name.
    """
    inset = _INSET * smallest_radius_m
    rows: list[Row] = []
    names = ("length", "width") if len(feature.pairs) == 2 else ("width" if feature.kind == "slot" else "thickness",)
    for name, pair in zip(names, feature.pairs, strict=False):
        rows += _size(name, pair, parts, inset)
    for pair in feature.pairs:
        rows += [_position(wall, parts, inset, 0.5 * pair.size_m, inward=not pair.facing) for wall in pair.walls]
    rows += [_position(wall, parts, inset, wall.offset_m) for wall in feature.walls]
    if feature.circle_m is not None:
        rows += _circle(feature, parts, inset)
    elif feature.contour:
        off = {name: np.concatenate([_left(w, part, inset) for w in feature.contour]) for name, part in parts.items()}
        span = float(np.max([np.ptp(w.points, axis=0).max() for w in feature.contour]))
        rows.append(values_row("corners" if feature.pairs else "profile", 0.0, span, off))
    return rows + _floor(feature, surface, parts)


def _stations(wall: WallSegment, low: float, high: float) -> Float:
    """Places along a straight wall, every millimetre, half way up, (n, 3) m."""
    t = np.arange(low + _END_M, high - _END_M + 1e-9, 1.0 * MM)
    if len(t) == 0:
        t = np.array([0.5 * (low + high)])
    xy = t[:, None] * wall.along + wall.offset_m * wall.normal
    return np.column_stack([xy, np.full(len(t), 0.5 * (wall.low_m + wall.high_m))])


def _exit_beyond(place: Float, normals: Float, part: MeasurablePart, inset: float) -> Float:
    """Reach of the cut beyond nominal wall places along their normals, (n,) m; nan where it is not known."""
    before = place.copy()
    before[:, :2] -= inset * normals
    out = part.exits(before, normals) - inset
    return np.where(np.isfinite(out), out, np.nan)


def _left(wall: WallSegment, part: MeasurablePart, inset: float) -> Float:
    """Material left on a curved wall, (n,) m."""
    return -_exit_beyond(wall.points, wall.normals, part, inset)


def _size(name: str, pair: WallPair, parts: Parts, inset: float) -> list[Row]:
    """Distance of two walls across, station by station."""
    first, second = pair.walls
    place = _stations(first, *pair.common_m)
    other = place.copy()
    other[:, :2] -= (first.offset_m + second.offset_m) * first.normal
    other[:, 2] = 0.5 * (second.low_m + second.high_m)
    sign = 1.0 if pair.facing else -1.0
    values = {}
    for part_name, part in parts.items():
        beyond = _exit_beyond(place, np.tile(first.normal, (len(place), 1)), part, inset)
        beyond = beyond + _exit_beyond(other, np.tile(-first.normal, (len(place), 1)), part, inset)
        values[part_name] = pair.size_m + sign * beyond
    return [values_row(name, pair.size_m, pair.size_m, values)]


def _position(wall: WallSegment, parts: Parts, inset: float, nominal: float, *, inward: bool = False) -> Row:
    """Place of a wall, counted outward as ``nominal`` is: out of the cut, or with ``inward`` out of an island."""
    sign = -1.0 if inward else 1.0
    place = _stations(wall, *wall.ends_m)
    normals = np.tile(wall.normal, (len(place), 1))
    values = {name: nominal + sign * _exit_beyond(place, normals, part, inset) for name, part in parts.items()}
    return values_row(f"wall {side_of(sign * wall.normal)}", nominal, abs(nominal), values)


def side_of(normal: Float) -> str:
    """Side on which a wall stands: an axis of the part, or its direction in degrees."""
    whole = np.round(normal)
    if float(np.abs(normal - whole).max()) < 1e-2:
        return _SIDES[int(whole[0]), int(whole[1])]
    return f"{np.degrees(np.arctan2(normal[1], normal[0])):.0f} deg"


def _circle(feature: PrismaticFeature, parts: Parts, inset: float) -> list[Row]:
    x, y, radius = feature.circle_m or (0.0, 0.0, 0.0)
    wall = feature.contour[0]
    diameter, round_, centre, shares = {}, {}, {}, {}
    for name, part in parts.items():
        beyond = _exit_beyond(wall.points, wall.normals, part, inset)
        known = np.isfinite(beyond)
        shares[name] = float(known.mean())
        if known.sum() < 0.5 * len(known):
            continue
        made = wall.points[known, :2] + beyond[known, None] * wall.normals[known]
        circle = Circularity.of(made, np.array([x, y]), radius)
        diameter[name] = np.array([2.0 * circle.radius_m])
        round_[name] = np.array([circle.g_m])
        centre[name] = np.array([float(np.hypot(*circle.centre_offset_m))])
    return [
        values_row("diameter", 2.0 * radius, 2.0 * radius, diameter, shares),
        values_row("roundness", 0.0, 2.0 * radius, round_, shares),
        values_row("centre", 0.0, radius, centre, shares),
    ]


def _floor(feature: PrismaticFeature, surface: NominalSurface, parts: Parts) -> list[Row]:
    """Depth below the top of the blank and flatness of a level floor; profile of another one."""
    xy = feature.floor
    if xy is None or len(xy) == 0:
        return []
    base = height_at(surface.nominal, xy)
    off = {name: part.heights(xy) - base for name, part in parts.items()}
    side = float(np.ptp(xy, axis=0).max())
    if np.isnan(feature.floor_m):
        j = np.round((xy[:, 1] - surface.nominal.y0_m) / surface.nominal.cell_m).astype(np.int64)
        i = np.round((xy[:, 0] - surface.nominal.x0_m) / surface.nominal.cell_m).astype(np.int64)
        slant = surface.normal_z[j, i].astype(np.float64)
        return [values_row("profile", 0.0, side, {name: value * slant for name, value in off.items()})]
    if feature.kind in ("island", "rib"):
        wall = feature.pairs[0].walls[0]
        size, name = wall.high_m - feature.floor_m, "height"
    else:
        size, name = float(np.max(height_at(surface.stock, xy))) - feature.floor_m, "depth"
    values = {part: size - value for part, value in off.items()}
    return [values_row(name, size, size, values), *flatness(xy, surface, parts, side)]
