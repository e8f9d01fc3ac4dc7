"""Find the cycles of a path test in one log, by the order of the commanded path."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, Int, as_float
from counterflex.core.errors import InputError
from counterflex.core.units import DEG, MM
from counterflex.evaluate import path_matching

CORNER_RAD: Final = 20.0 * DEG
"""Sharper turns of the polyline are corners; flatter ones approximate an arc."""
ZONE: Final = 0.1
"""Share of a stretch at either end that is no place of measurement: acceleration, rounded corners."""
PLACES: Final = 100
"""Places of measurement along the whole path, about."""


@dataclass(frozen=True, eq=False)
class CommandedPath:
    """A polyline."""

    p: Float  # (k, 3) m, k >= 2, in the frame of the commands, no two successive ones equal
    R: Float | None = None  # (k, 3, 3) commanded orientation at them, or None
    speed_m_s: float | None = None  # commanded speed along the path, or None

    def __post_init__(self) -> None:
        """Check it. Raises InputError: fewer than two points, or a point that repeats the one before."""
        p = as_float("p", self.p, (None, 3))
        if len(p) < 2:
            raise InputError("a path needs two points", value=len(p), limit=">= 2")
        if float(self._steps.min()) <= 0.0:
            raise InputError(
                "a point of the path repeats the one before", where=f"point {int(self._steps.argmin()) + 2}"
            )

    @property
    def _steps(self) -> Float:
        out: Float = np.linalg.norm(np.diff(self.p, axis=0), axis=1)
        return out

    @property
    def length(self) -> Float:
        """(k,) m, length along the path at each point."""
        return np.concatenate([[0.0], np.cumsum(self._steps)])

    @property
    def corners(self) -> Int:
        """Points at which the path turns by more than :data:`CORNER_RAD`."""
        t = np.diff(self.p, axis=0) / self._steps[:, None]
        turn = np.arccos(np.clip(np.sum(t[1:] * t[:-1], axis=1), -1.0, 1.0))
        return np.flatnonzero(turn > CORNER_RAD) + 1

    @property
    def stretches(self) -> tuple[tuple[float, float], ...]:
        """From and to, as lengths along the path, m: the parts between corners and ends."""
        ends = [0.0, *self.length[self.corners].tolist(), float(self.length[-1])]
        return tuple(itertools.pairwise(ends))

    def at(self, s: Float) -> tuple[Float, Float]:
        """Points (m, 3) m and directions (m, 3) at lengths (m,) m along the path."""
        length = self.length
        j = np.clip(np.searchsorted(length, s, side="right") - 1, 0, len(self.p) - 2)
        t = np.diff(self.p, axis=0)[j] / self._steps[j, None]
        return self.p[j] + (np.asarray(s) - length[j])[:, None] * t, t

    def orientation(self, s: Float) -> Float | None:
        """(m, 3, 3) commanded orientation at lengths (m,) m, that of the point before; None where none is known."""
        if self.R is None:
            return None
        out: Float = self.R[np.clip(np.searchsorted(self.length, s, side="right") - 1, 0, len(self.p) - 1)]
        return out

    def places(self, share: float = 1.0 - 2.0 * ZONE, count: int = PLACES) -> Float:
        """Lengths (m,) m along the path at which it is measured: evenly over the middle ``share`` of each stretch."""
        total = float(self.length[-1])
        out: list[Float] = []
        for begin, end in self.stretches:
            m = max(5, round(count * (end - begin) / total))
            out.append(begin + (end - begin) * (0.5 + share * ((np.arange(m) + 0.5) / m - 0.5)))
        return np.concatenate(out)


def path_of(p: Float, R: Float | None = None, speed_m_s: float | None = None) -> CommandedPath:
    """A path of points that may repeat; repeated ones (within 1 um) are one."""
    points = as_float("p", p, (None, 3))
    kept = [0]
    for k in range(1, len(points)):
        if float(np.linalg.norm(points[k] - points[kept[-1]])) > 1e-3 * MM:
            kept.append(k)
    return CommandedPath(points[kept], None if R is None else R[kept], speed_m_s)


REACH_M: Final = 10.0 * MM
"""Farther from the commanded path a reading belongs to no cycle."""
_CAPTURE_M: Final = 1.0 * MM
_STATIONS: Final = 1500
_LEAST_SPACING_M: Final = 0.2 * MM
_SAME_WAY: Final = 0.2


@dataclass(frozen=True, eq=False)
class PathCycle:
    """One run along the commanded path."""

    first: int  # reading of the log that it begins with
    p: Float  # (r, 3) m, readings in the frame of the commands
    length_m: Float  # (r,) where on the commanded path each lies, not decreasing
    R: Float | None = None  # (r, 3, 3) orientations, or None
    time_s: Float | None = None  # (r,) s, or None where the log has no usable times

    @cached_property
    def longest_step_m(self) -> float:
        """Longest distance between two readings in a row, m."""
        return float(np.max(np.linalg.norm(np.diff(self.p, axis=0), axis=1)))


def path_cycles(
    path: CommandedPath, p: Float, *, R: Float | None = None, time_s: Float | None = None, reach_m: float = REACH_M
) -> list[PathCycle]:
    """Cycles in a log: a cycle passes the start of the path in its direction and goes along it to its end.

    Readings between cycles (return, rest, other moves) belong to none. A run that leaves the path by more than
    ``reach_m`` or does not come to its end is no cycle.

    Args:
        path: As commanded.
        p: (n, 3) m, readings in the frame of the commands.
        R: (n, 3, 3), or None.
        time_s: (n,) s, or None.
        reach_m: See :data:`REACH_M`.

    Raises:
        InputError: Fewer than two readings.
    """
    points = as_float("p", p, (None, 3))
    if len(points) < 2:
        raise InputError("a path test needs a log of readings", value=len(points))
    P, S = np.ascontiguousarray(path.p), path.length
    total = float(S[-1])
    spacing = max(_LEAST_SPACING_M, total / _STATIONS)
    q, place, broken = path_matching.even_stations(points, spacing, reach_m)
    way = path_matching.travel_directions(q, broken)
    starts = _starts(q, way, P, reach_m)
    matches: list[PathCycle] = []
    free, longest = 0, int(1.6 * total / spacing) + 50
    overlap = int(reach_m / spacing) + 2  # a closed path begins again where it ends
    for k in starts:
        if k < free - overlap:
            continue
        stop = min(len(q), k + longest)
        u, _ = path_matching.match(
            q[k:stop], broken[k:stop], np.ones(stop - k, dtype=np.bool_), P, S, spacing, _CAPTURE_M, reach_m,
            np.full(stop - k, np.nan), reach_m,
        )  # fmt: skip
        end = _end(u, q[k:stop], path, total, spacing, reach_m)
        if end is None:
            continue
        rows = slice(int(np.floor(place[k])), int(np.ceil(place[k + end])) + 1)
        index = np.arange(rows.start, rows.stop, dtype=np.float64)
        length = np.interp(index, place[k : k + end + 1], u[: end + 1])
        matches.append(
            PathCycle(
                rows.start,
                points[rows],
                length,
                None if R is None else R[rows],
                None if time_s is None else time_s[rows],
            )
        )
        free = k + end
    return matches


def _starts(q: Float, way: Float, P: Float, reach_m: float) -> Int:
    """Stations that may begin a cycle: of each stay near the start, the nearest one that runs the path's way."""
    t = (P[1] - P[0]) / np.linalg.norm(P[1] - P[0])
    near = np.linalg.norm(q - P[0], axis=1)
    may = (near < reach_m) & (way @ t > _SAME_WAY)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], may, [False]]).astype(np.int8)))
    return np.array(
        [a + int(np.argmin(near[a:b])) for a, b in zip(edges[::2], edges[1::2], strict=True)], dtype=np.int64
    )


def _end(u: Float, q: Float, path: CommandedPath, total: float, spacing: float, reach_m: float) -> int | None:
    """Station at which the end of the path is reached; None where it is not, or the path was left before."""
    reached = np.flatnonzero(u >= total - 2.0 * spacing)
    if len(reached) == 0:
        return None
    near, _ = path.at(np.minimum(u, total))
    away = np.linalg.norm(q - near, axis=1)
    first = int(reached[0])
    if np.any(away[: first + 1] > reach_m):
        return None
    last = first
    while last + 1 < len(q) and away[last + 1] < away[last]:  # up to the end itself, not beyond it
        last += 1
    return last
