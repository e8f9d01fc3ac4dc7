"""Find features on the surface that a program makes, whatever its moves are: by floors and the walls about them.

::

    facing walls       -> pocket (two pairs), slot (one pair)
    walls back to back -> island (two pairs), rib (one pair)
    a wall alone       -> step where a floor lies at its foot, else wall
    a curved wall      -> boss or bore where it is a circle, else contour
    an inclined or curved floor -> surface

Walls and floors of grooves and round pockets, which are found by the moves of the tool, are left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.units import DEG, MM, UM
from counterflex.evaluate.measured_values import cells, height_at
from counterflex.evaluate.surface import NominalSurface

_NEAR_M: Final = 1.6 * MM
"""Wall points lie about half a millimetre apart, three heights of a wall above each other apart from that."""
_ALIKE: Final = float(np.cos(1.0 * DEG))
_OFF_M: Final = 20.0 * UM  # Off the line of a neighbour: chords of sampled arcs stay within it
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


_PARALLEL: Final = float(np.cos(0.5 * DEG))
_SQUARE: Final = float(np.sin(0.5 * DEG))
_OVERLAP: Final = 0.5
_FLAT: Final = 1.0 - 1e-6
_LEAST_FLOOR_M2: Final = 25.0 * MM * MM
_RIM_M: Final = 1.25 * MM  # Strip along the edges of a floor that is left out: the filter of a floor has no value there
_ROUND_M: Final = 30.0 * UM
_ORDER: Final = (
    (True, "rectangular pocket", True),
    (False, "island", True),
    (True, "slot", False),
    (False, "rib", False),
)
"""Do walls face each other; name; are two pairs needed? What is closed is looked for first."""


@dataclass(frozen=True)
class WallPair:
    """Two parallel walls."""

    walls: tuple[WallSegment, WallSegment]  # both
    size_m: float  # distance, m
    facing: bool  # cut between them; else material

    @property
    def common_m(self) -> tuple[float, float]:
        """Return where both stand, along the first one, m."""
        first, second = self.walls
        other = second.points[:, :2] @ first.along
        return max(first.ends_m[0], float(other.min())), min(first.ends_m[1], float(other.max()))


@dataclass(frozen=True, eq=False)
class PrismaticFeature:
    """A feature found on the surface."""

    name: str  # for the table
    pairs: tuple[WallPair, ...] = ()  # its pairs of walls, the longer size first
    walls: tuple[WallSegment, ...] = ()  # its single walls
    contour: tuple[WallSegment, ...] = ()  # its curved walls
    circle_m: tuple[float, float, float] | None = None  # centre and radius, m, where the contour is a circle
    floor: Float | None = None  # (n, 2) m, places on its floor, on a grid; empty where it has none
    floor_m: float = float("nan")  # height of the floor where it is level; nan else

    @property
    def kind(self) -> str:
        """Name without its number."""
        return self.name.rpartition(" ")[0]

    @property
    def every_wall(self) -> tuple[WallSegment, ...]:
        """All of its walls."""
        return (*(wall for pair in self.pairs for wall in pair.walls), *self.walls, *self.contour)

    def covers(self, points: Float, tolerance_m: float) -> Bool:
        """Return whether places (n, 3) of the machined surface are of the feature."""
        out = np.zeros(len(points), np.bool_)
        for wall in self.every_wall:
            out |= wall.covers(points, tolerance_m)
        if self.floor is not None and len(self.floor):
            near = scipy.spatial.cKDTree(self.floor).query(points[:, :2], distance_upper_bound=1.5 * MM)[0] < 1.5 * MM
            out |= near & (np.isnan(self.floor_m) | (np.abs(points[:, 2] - self.floor_m) < tolerance_m))
        return out


def stands_out(feature: object) -> bool:
    """Return whether walls of a feature look outward: an island, a rib or a boss."""
    return isinstance(feature, PrismaticFeature) and feature.kind in ("island", "rib", "boss")


def find_prismatic(surface: NominalSurface, taken_walls: Bool, taken_floors: Bool) -> tuple[PrismaticFeature, ...]:
    """Find the features of a surface.

    ``taken_walls``: (m,) wall points of other features; ``taken_floors``: (ny, nx) floor cells of other features.
    """
    segments = wall_segments(surface, taken_walls)
    flat = surface.floor & (surface.normal_z > _FLAT) & surface.kept
    labels = np.asarray(scipy.ndimage.label(flat)[0], np.int64)
    free = labels * ~taken_floors
    straight = [one for one in segments if one.straight]
    region = [_foot(one, surface, labels) for one in straight]
    out: list[PrismaticFeature] = []
    used: set[int] = set()
    for facing, name, double in _ORDER:
        for one in _of_pairs(_pairs(straight, region, used, facing), name, double, surface, labels):
            out.append(one)
            used |= {k for k, wall in enumerate(straight) if any(wall is w for w in one.every_wall)}
    for k, wall in enumerate(straight):
        if k not in used:
            xy, height = _floor(surface, labels, region[k])
            name = "step" if region[k] else "wall"
            out.append(PrismaticFeature(name, walls=(wall,), floor=xy, floor_m=height))
    for segment in segments:
        if not segment.straight:
            _add_curved(out, _contour(segment), _foot(segment, surface, labels), surface, labels)
    floors_used = {_label_at(labels, surface, one.floor) for one in out}
    out += _bare_floors(surface, free, floors_used)
    out += _free_forms(surface, taken_floors)
    return _numbered(out)


def _add_curved(
    features: list[PrismaticFeature], curved: PrismaticFeature, floor: int, surface: NominalSurface, labels: Int
) -> None:
    """Add a curved wall: to the pocket or island at whose floor it stands, as a corner of it, else by itself."""
    if curved.circle_m is None and floor:
        for k, one in enumerate(features):
            if len(one.pairs) == 2 and _label_at(labels, surface, one.floor) == floor:
                features[k] = replace(one, contour=(*one.contour, *curved.contour))
                return
    features.append(curved)


def _numbered(features: Sequence[PrismaticFeature]) -> tuple[PrismaticFeature, ...]:
    count: dict[str, int] = {}
    out = []
    for one in features:
        count[one.name] = count.get(one.name, 0) + 1
        out.append(replace(one, name=f"{one.name} {count[one.name]}"))
    return tuple(out)


def _foot(wall: WallSegment, surface: NominalSurface, labels: Int) -> int:
    """Label of the level floor at the foot of a wall, 0 where there is none."""
    at = wall.points[:, :2] - 2.5 * surface.nominal.cell_m * wall.normals
    j, i, on = cells(surface.nominal, at)
    below = labels[j, i][on]
    below = below[below > 0]
    return int(np.bincount(below).argmax()) if 2 * len(below) > len(at) else 0


def _pairs(
    walls: Sequence[WallSegment], region: Sequence[int], used: set[int], facing: bool
) -> list[tuple[int, WallPair]]:
    """Pairs of parallel walls at one floor, with the floor."""
    # Of several that face a wall the furthest counts, because islands stand between the walls of a pocket; of several
    # behind it the nearest.
    sized = []
    for a, first in enumerate(walls):
        for b in range(a + 1, len(walls)):
            second = walls[b]
            if a in used or b in used or region[a] != region[b] or first.normal @ second.normal > -_PARALLEL:
                continue
            distance = first.offset_m + second.offset_m  # along the first normal; the second one points the other way
            pair = WallPair((first, second), abs(distance), distance > 0.0)
            low, high = pair.common_m
            if pair.facing == facing and high - low >= _OVERLAP * min(first.length_m, second.length_m):
                sized.append((-distance, a, b, pair))
    sized.sort(key=lambda one: one[0])
    out, taken = [], set()
    for _, a, b, pair in sized:
        if a not in taken and b not in taken:
            taken |= {a, b}
            out.append((region[a], pair))
    return out


def _of_pairs(
    pairs: Sequence[tuple[int, WallPair]], name: str, double: bool, surface: NominalSurface, labels: Int
) -> list[PrismaticFeature]:
    """Two pairs square to each other at one floor as one feature; or each pair as one."""
    out: list[PrismaticFeature] = []
    taken: set[int] = set()
    for k, (floor, pair) in enumerate(pairs):
        if k in taken:
            continue
        both = [pair]
        if double:
            mates = (m for m in range(k + 1, len(pairs)) if m not in taken and pairs[m][0] == floor)
            mate = next((m for m in mates if _crosses(pair, pairs[m][1])), None)
            if mate is None:
                continue
            taken |= {k, mate}
            both = sorted((pair, pairs[mate][1]), key=lambda one: -one.size_m)
        xy, height = _floor(surface, labels, floor)
        out.append(PrismaticFeature(name, pairs=tuple(both), floor=xy, floor_m=height))
    return out


def _crosses(a: WallPair, b: WallPair) -> bool:
    """Return whether two pairs are the sides of one rectangle: square to each other, with the same middle."""
    if abs(float(a.walls[0].normal @ b.walls[0].normal)) > _SQUARE:
        return False
    low, high = a.common_m
    middle = 0.5 * (b.walls[0].points[:, :2].mean(axis=0) + b.walls[1].points[:, :2].mean(axis=0))
    place = float(middle @ a.walls[0].along)
    return low - 1.0 * MM < place < high + 1.0 * MM


def _floor(surface: NominalSurface, labels: Int, label: int) -> tuple[Float | None, float]:
    """Places on a level floor, about a millimetre distance, and its height; none for label 0."""
    if label == 0:
        return None, float("nan")
    grid = surface.nominal
    region = labels == label
    inside = scipy.ndimage.distance_transform_edt(np.pad(region, 1))[1:-1, 1:-1] * grid.cell_m > _RIM_M
    j, i = np.nonzero(inside if inside.any() else region)
    step = max(1, round(1.0 * MM / grid.cell_m))
    kept = (j % step == 0) & (i % step == 0)
    if not kept.any():
        kept[:] = True
    xy = np.column_stack([grid.x0_m + i[kept] * grid.cell_m, grid.y0_m + j[kept] * grid.cell_m])
    return xy, float(np.median(grid.z[j, i]))


def _label_at(labels: Int, surface: NominalSurface, xy: Float | None) -> int:
    if xy is None or len(xy) == 0:
        return 0
    j, i, _ = cells(surface.nominal, xy[:1])
    return int(labels[j[0], i[0]])


def _bare_floors(surface: NominalSurface, free: Int, used: set[int]) -> list[PrismaticFeature]:
    """Level floors with no wall of their own, such as a faced top."""
    area = np.bincount(free.ravel()) * surface.nominal.cell_m**2
    labels = [k for k in range(1, len(area)) if k not in used and area[k] >= _LEAST_FLOOR_M2]
    places = [_floor(surface, free, label) for label in labels]
    return [PrismaticFeature("plane", floor=xy, floor_m=height) for xy, height in places]


def _free_forms(surface: NominalSurface, taken: Bool) -> list[PrismaticFeature]:
    """Floors that are inclined or curved."""
    curved = surface.floor & (surface.normal_z <= _FLAT) & ~taken & surface.kept
    closed = scipy.ndimage.binary_closing(curved, iterations=2) & surface.floor & ~taken
    labels = np.asarray(scipy.ndimage.label(closed)[0], np.int64)
    area = np.bincount(labels.ravel()) * surface.nominal.cell_m**2
    large = [label for label in range(1, len(area)) if area[label] >= _LEAST_FLOOR_M2]
    return [PrismaticFeature("surface", floor=_floor(surface, labels, label)[0]) for label in large]


def _contour(wall: WallSegment) -> PrismaticFeature:
    """A curved wall; a boss or a bore where it is a whole circle."""
    xy = wall.points[:, :2] - wall.points[:, :2].mean(axis=0)
    A = np.column_stack([2.0 * xy, np.ones(len(xy))])
    solution = np.linalg.lstsq(A, np.sum(xy * xy, axis=1), rcond=None)[0]
    centre = solution[:2]
    radius = float(np.sqrt(max(solution[2] + centre @ centre, 0.0)))
    off = np.abs(np.linalg.norm(xy - centre, axis=1) - radius)
    angle = np.sort(np.arctan2(xy[:, 1] - centre[1], xy[:, 0] - centre[0]))
    gap = float(np.max(np.diff(np.append(angle, angle[0] + 2.0 * np.pi))))
    if off.max() > _ROUND_M or gap > 30.0 * DEG:
        return PrismaticFeature("contour", contour=(wall,))
    middle = centre + wall.points[:, :2].mean(axis=0)
    outward = float(np.mean(np.sum((xy - centre) * wall.normals, axis=1))) < 0.0
    circle = (float(middle[0]), float(middle[1]), radius)
    return PrismaticFeature("boss" if outward else "bore", contour=(wall,), circle_m=circle)
