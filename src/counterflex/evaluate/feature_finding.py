"""Features that can be measured on a part: straight grooves, ramps and circular pockets, found in the program."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.units import DEG, UM
from counterflex.path import FEED, ToolPath

_SAME_M = 10.0 * UM


@dataclass(frozen=True)
class Groove:
    """A straight groove as wide as the cutter; a ramp where its floor is inclined."""

    name: str  # for the table
    start: Float  # (3,) m tool tip where the groove starts, part frame
    end: Float  # (3,) m tool tip where it ends
    radius_m: float  # of the cutter that made it

    @property
    def inclined(self) -> bool:
        """True for a ramp."""
        return abs(float(self.end[2] - self.start[2])) > _SAME_M

    def covers(self, points: Float, tolerance_m: float) -> Bool:
        """Tell places (n, 3) of the machined surface that are of the groove: swept by its tool, not below its tip."""
        run = self.end - self.start
        share = np.clip((points - self.start)[:, :2] @ run[:2] / (run[:2] @ run[:2]), 0.0, 1.0)
        nearest = self.start + share[:, None] * run
        off: Float = np.linalg.norm((points - nearest)[:, :2], axis=1)
        out: Bool = (off < self.radius_m + tolerance_m) & (points[:, 2] > nearest[:, 2] - tolerance_m)
        return out


@dataclass(frozen=True)
class CircularPocket:
    """A round pocket or bore."""

    name: str  # for the table
    centre: Float  # (2,) m, part frame
    path_radius_m: float  # radius of the outermost turn of the tool centre
    floor_m: float  # height of its floor, m
    radius_m: float  # of the cutter that made it

    def covers(self, points: Float, tolerance_m: float) -> Bool:
        """Tell places (n, 3) of the machined surface that are of the pocket: within its wall, not below its floor."""
        off: Float = np.linalg.norm(points[:, :2] - self.centre, axis=1)
        inside: Bool = off < self.path_radius_m + self.radius_m + tolerance_m
        return inside & (points[:, 2] > self.floor_m - tolerance_m)


Feature = Groove | CircularPocket


@dataclass(frozen=True)
class _Arc:
    """A level arc: centre (2,) m, radius and height in m, angles from ``first`` to the larger ``last``, rad."""

    centre: Float
    radius: float
    z: float
    first: float
    last: float


def find_features(nominal: ToolPath, cutter_radius_m: float | Float) -> tuple[Feature, ...]:
    """Find candidates in the feed motions of a program; measuring drops those without walls on the part.

    A groove is a straight feed motion that runs at least two cutter diameters in the plane; passes over the same line
    with one cutter count once, the deepest. A pocket is a closed set of arcs about one centre at one height, each angle
    counted once; its outermost turn and lowest floor count.

    Args:
        nominal: Tool path of the original program; arcs sampled by at least four rows each.
        cutter_radius_m: Cutter radius; (n,) of the rows where several tools cut.

    Returns:
        Grooves in the order of the program, then pockets.
    """
    p, motion = np.asarray(nominal.p_part_tcp), np.asarray(nominal.motion)
    radii = np.broadcast_to(np.asarray(cutter_radius_m, dtype=np.float64), (len(motion),))
    grooves: list[tuple[Float, Float, float]] = []
    arcs: list[tuple[_Arc, float]] = []
    edges = np.flatnonzero(np.diff(motion)) + 1
    for first, stop in zip(np.append(0, edges), np.append(edges, len(motion)), strict=True):
        if nominal.kind[stop - 1] != FEED or stop < 2:
            continue
        rows: Float = p[max(first - 1, 0) : stop]
        chord, radius = rows[-1] - rows[0], float(radii[stop - 1])
        if float(np.hypot(chord[0], chord[1])) >= 4.0 * radius and _straight(rows):
            _add_groove(grooves, rows[0], rows[-1], radius)
        elif len(rows) >= 4 and float(np.ptp(rows[:, 2])) < UM:
            arc = _arc(rows)
            if arc is not None:
                arcs.append((arc, radius))
    results: list[Feature] = []
    counts = {False: 0, True: 0}
    for start, end, radius in grooves:
        ramp = abs(float(end[2] - start[2])) > _SAME_M
        counts[ramp] += 1
        results.append(Groove(f"{'ramp' if ramp else 'groove'} {counts[ramp]}", start, end, radius))
    results.extend(_pockets(arcs))
    return tuple(results)


def _straight(rows: Float) -> bool:
    chord = rows[-1] - rows[0]
    unit = chord / np.linalg.norm(chord)
    away = rows - rows[0]
    return float(np.abs(away - np.outer(away @ unit, unit)).max()) < UM


def _add_groove(grooves: list[tuple[Float, Float, float]], start: Float, end: Float, radius: float) -> None:
    for k, (a, b, other) in enumerate(grooves):
        if other != radius:
            continue
        same = np.abs(a - start)[:2].max() < _SAME_M and np.abs(b - end)[:2].max() < _SAME_M
        back = np.abs(a - end)[:2].max() < _SAME_M and np.abs(b - start)[:2].max() < _SAME_M
        if same or back:
            if start[2] + end[2] < a[2] + b[2]:
                grooves[k] = (start, end, radius) if same else (end, start, radius)
            return
    grooves.append((start.copy(), end.copy(), radius))


def _arc(rows: Float) -> _Arc | None:
    """Arc that rows are on; None where they are on none."""
    xy = rows[:, :2] - rows[:, :2].mean(axis=0)
    A = np.column_stack([2.0 * xy, np.ones(len(xy))])
    solution, _, rank, _ = np.linalg.lstsq(A, np.sum(xy * xy, axis=1), rcond=None)
    if rank < 3:
        return None
    centre: Float = solution[:2]
    radius = float(np.sqrt(max(solution[2] + centre @ centre, 0.0)))
    if radius > 1.0 or float(np.abs(np.linalg.norm(xy - centre, axis=1) - radius).max()) > 2.0 * UM:
        return None
    angle = np.unwrap(np.arctan2(xy[:, 1] - centre[1], xy[:, 0] - centre[0]))
    first, last = sorted((float(angle[0]), float(angle[-1])))
    return _Arc(centre + rows[:, :2].mean(axis=0), radius, float(rows[0, 2]), first, last)


def _pockets(arcs: list[tuple[_Arc, float]]) -> list[Feature]:
    """Closed turns about one centre with one cutter, the outermost of each centre at its lowest floor."""
    if not arcs:
        return []
    values = np.array([[*arc.centre, arc.radius, arc.z] for arc, _ in arcs])
    x, y, size, level = (_alike(column).tolist() for column in values.T)
    closed: dict[tuple[int, int, float], dict[tuple[int, int], list[int]]] = {}
    for k, (_, cutter) in enumerate(arcs):
        closed.setdefault((x[k], y[k], cutter), {}).setdefault((size[k], level[k]), []).append(k)
    results: list[Feature] = []
    for (_, _, cutter), circles in closed.items():
        whole = [own for own in circles.values() if _covered([arcs[k][0] for k in own]) > 330.0 * DEG]
        if whole:
            rows = np.array([values[own].mean(axis=0) for own in whole])
            name = f"pocket {len(results) + 1}"
            outermost = rows[np.argmax(rows[:, 2])]
            results.append(CircularPocket(name, outermost[:2], float(outermost[2]), float(rows[:, 3].min()), cutter))
    return results


def _alike(values: Float) -> Int:
    """(n,) the same number for values that follow each other within :data:`_SAME_M`."""
    order = np.argsort(values, kind="stable")
    out = np.empty(len(values), dtype=np.int64)
    out[order] = np.cumsum(np.diff(values[order], prepend=values[order[:1]]) > _SAME_M)
    return out


def _covered(arcs: list[_Arc]) -> float:
    """Angle of a circle that arcs on it cover, rad; what several cover counts once."""
    whole, pieces = 2.0 * np.pi, []
    for arc in arcs:
        begin, span = arc.first % whole, min(arc.last - arc.first, whole)
        pieces += [(begin, min(begin + span, whole)), (0.0, max(begin + span - whole, 0.0))]
    total = reach = 0.0
    for begin, end in sorted(pieces):
        total += max(0.0, end - max(begin, reach))
        reach = max(reach, end)
    return total
