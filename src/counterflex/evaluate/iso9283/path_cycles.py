"""Find the cycles of a path test in one log, by the order of the commanded path."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, Int, as_float
from counterflex.core.errors import InputError
from counterflex.core.units import MM
from counterflex.evaluate import path_matching
from counterflex.evaluate.iso9283.commanded_path import CommandedPath

REACH_M: Final = 10.0 * MM
"""Farther from the commanded path a reading belongs to no cycle."""
_CAPTURE_M: Final = 1.0 * MM
_STATIONS: Final = 1500
_LEAST_SPACING_M: Final = 0.2 * MM
_SAME_WAY: Final = 0.2


@dataclass(frozen=True, eq=False)
class Cycle:
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
) -> list[Cycle]:
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
    matches: list[Cycle] = []
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
            Cycle(
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
