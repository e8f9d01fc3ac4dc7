"""Path deviation: how far the tool centre was from the programmed path, across and along the feed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int, as_float, as_positive
from counterflex.core.errors import InputError
from counterflex.core.units import MM
from counterflex.evaluate import path_matching
from counterflex.evaluate.figures import DeviationFigures
from counterflex.path import FEED, ToolPath

BRIDGE_M = 1.0 * MM  # a shorter break of contact does not end a stretch
PLATEAU = 0.95  # of the level just inside the stretch


def contact_runs(cutting: Bool, broken: Bool, spacing_m: float) -> list[tuple[int, int]]:
    """Stretches of contact as (first, behind last) station.

    Args:
        cutting: (k,) True while material is removed.
        broken: (k,) True where a station does not continue the one before; ends a stretch.
        spacing_m: Distance between stations.

    Returns:
        In order; breaks of contact up to :data:`BRIDGE_M` are bridged.
    """
    runs: list[tuple[int, int]] = []
    inside = np.flatnonzero(cutting)
    if len(inside) == 0:
        return runs
    holes = np.cumsum(broken)
    bridge = max(1, round(BRIDGE_M / spacing_m))
    breaks = (np.diff(inside) > bridge) | (np.diff(holes[inside]) > 0)
    starts = np.concatenate([[0], np.flatnonzero(breaks) + 1])
    ends = np.concatenate([np.flatnonzero(breaks), [len(inside) - 1]])
    return [(int(inside[a]), int(inside[b]) + 1) for a, b in zip(starts, ends, strict=True)]


def entry_exit(runs: list[tuple[int, int]], engagement: Float, spacing_m: float, radius_m: float) -> tuple[Bool, Bool]:
    """Entry and exit stretches of contact.

    The level of the plateau beside an entry is the median engagement between one and four cutter radii after first
    contact. The entry lasts until the engagement first reaches 95 % of it, at least one radius; exits are the same
    read backwards. Where a stretch of contact is too short for both, they share it half and half.

    Args:
        runs: From :func:`contact_runs`.
        engagement: (k,) measure of how much is removed; a constant makes every entry one radius long.
        spacing_m: Distance between stations.
        radius_m: Cutter radius.

    Returns:
        Masks (k,) of entries and exits.
    """
    entry = np.zeros(len(engagement), dtype=np.bool_)
    leave = np.zeros(len(engagement), dtype=np.bool_)
    for first, end in runs:
        level = engagement[first:end]
        a, b = _length(level, spacing_m, radius_m), _length(level[::-1], spacing_m, radius_m)
        n = end - first
        if a + b > n:
            a = min(a, max(n - b, (n + 1) // 2))
            b = n - a
        entry[first : first + a] = True
        leave[end - b : end] = True
    return entry, leave


def _length(level: Float, spacing_m: float, radius_m: float) -> int:
    """Stations from the start of ``level`` to its plateau."""
    radius = max(1, int(np.ceil(radius_m / spacing_m)))
    inner = level[radius : 4 * radius]
    if len(inner) == 0:
        return min(radius, len(level))
    reached = np.flatnonzero(level >= PLATEAU * float(np.median(inner)))
    return min(len(level), max(radius, int(reached[0]) if len(reached) else radius))


SPACING_M = 0.1 * MM


WINDOW_M: Final = 2.0 * MM
"""How far ahead of where the machine's progress says a place on the nominal path may be."""
CAPTURE_M: Final = 1.0 * MM
LOST_M: Final = 5.0 * MM
"""See :func:`counterflex.evaluate.path_matching.match`."""


@dataclass(frozen=True)
class PathDeviation:
    """Deviation at stations every ``spacing_m`` of the travelled path; part frame, m.

    ``deviation = actual - nominal``, with the nearest nominal point in the order of the program.
    """

    spacing_m: float  # distance between stations
    time_s: Float  # (k,) when the tool was there
    p_part_actual: Float  # (k, 3) actual tool centre
    p_part_nominal: Float  # (k, 3) its nominal point
    length_m: Float  # (k,) place on the nominal path, from its start, never decreasing
    motion: Int  # (k,) program motion of the nominal point
    feed_direction: Float  # (k, 3) unit vector of the nominal feed
    left: Float  # (k, 3) unit vector to the left of it, seen from the spindle; of a plunge any direction square to it
    across: Float  # (k, 3) deviation normal to the feed
    across_left_m: Float  # (k,) its component to the left of the feed, seen from the spindle
    # (k,) its component along `feed x left`, the tool axis where the feed is square to it; positive = away from the
    # part, too little depth
    across_axis_m: Float
    along_m: Float  # (k,) progress ahead of the set-point along the path; negative = the tool lags
    engagement: Float  # (k,) as given
    cutting: Bool  # (k,) True in feed motion while material is removed
    entry: Bool  # (k,) True from first contact until the plateau; subset of `cutting`
    exit: Bool  # (k,) True from the end of the plateau to the end of contact; subset of `cutting`
    air: Bool  # (k,) True in feed motion without contact, where the place on the program is known
    broken: Bool  # (k,) True where the station does not continue the one before

    @property
    def across_m(self) -> Float:
        """Magnitude of the deviation across the feed, (k,) m."""
        out: Float = np.linalg.norm(self.across, axis=1)
        return out


@dataclass(frozen=True)
class PathFigures:
    """The figures of a path, each of the magnitude across the feed except ``along``."""

    path: DeviationFigures  # over all feed motion that removes material, entries and exits included
    entry: DeviationFigures  # over entries alone
    exit: DeviationFigures  # over exits alone
    plateau: DeviationFigures  # over what is neither entry nor exit
    air: DeviationFigures  # feed motion without contact; reported apart, never part of `path`
    along: DeviationFigures  # lag or lead along the feed while cutting; reported, never counted as path error
    at_p_m: float  # path accuracy of ISO 9283 for one cycle: largest distance over all feed motion, contact or not

    @classmethod
    def of(cls, deviation: PathDeviation) -> PathFigures:
        """Figures of one machined path; every station weighs its spacing.

        Example:
            >>> import numpy as np
            >>> from counterflex.path import FEED, ToolPath
            >>> x = np.linspace(0.0, 0.1, 11)
            >>> line = np.stack([x, 0 * x, 0 * x], axis=1)
            >>> column = np.full(11, 1)
            >>> up = np.tile([0.0, 0.0, 1.0], (11, 1))
            >>> nominal = ToolPath(line, up, column * FEED, column * 0.025, column * 1.0, x / 0.025, column, column)
            >>> found = path_deviation(nominal, x / 0.025, line + [0, 2e-4, 0], np.ones(11, dtype=bool), 8e-3)
            >>> round(PathFigures.of(found).path.max_m * 1e3, 6)
            0.2
        """
        size, h = deviation.across_m, deviation.spacing_m
        plateau = deviation.cutting & ~deviation.entry & ~deviation.exit
        return cls(
            path=DeviationFigures.weighted(size[deviation.cutting], h),
            entry=DeviationFigures.weighted(size[deviation.entry], h),
            exit=DeviationFigures.weighted(size[deviation.exit], h),
            plateau=DeviationFigures.weighted(size[plateau], h),
            air=DeviationFigures.weighted(size[deviation.air], h),
            along=DeviationFigures.weighted(deviation.along_m[deviation.cutting], h),
            at_p_m=DeviationFigures.weighted(size[deviation.cutting | deviation.air], h).max_m,
        )


def path_deviation(
    nominal: ToolPath,
    time_s: Float,
    p_part_tcp: Float,
    engagement: Float | Bool,
    cutter_radius_m: float,
    *,
    command_part_tcp: Float | None = None,
    progress: Float | None = None,
    spacing_m: float = SPACING_M,
    gap_m: float = 2.0 * MM,
) -> PathDeviation:
    """Match a measured path to the nominal one and split its deviation.

    The measured samples are walked in chords of ``spacing_m``, so that slow and fast stretches weigh alike and a
    stop weighs nothing. Each station gets the nearest nominal point within reach ahead of the last one. Where the
    samples jump (air moves left out), the place is searched among all later passes.

    ``along`` compares progress at equal times: that of the actual tool minus that of the set-point. Without
    set-points the program's own clock (``nominal.time_s``) takes their place; it is right only where the machine
    keeps the programmed speed.

    Args:
        nominal: Tool path of the original program, whatever was sent to the robot; part frame.
        time_s: (n,) s, non-decreasing, same clock as ``nominal.time_s`` unless ``command_part_tcp`` is given.
        p_part_tcp: (n, 3) m, actual tool tip in the part frame.
        engagement: (n,) True while material is removed, or a measure of how much (axial depth, cross-section,
            force): above 0 is contact, and the plateau is found from it. Entry i holds on the way from sample i - 1
            to sample i.
        cutter_radius_m: Shortest length of an entry or exit.
        command_part_tcp: (n, 3) m, set-points sent to the drives at the same instants, or None.
        progress: (n,) share 0..1 of the program's path length that the machine has run, or None. Where it is known, a
            place on the nominal path is only looked for near it (:data:`WINDOW_M`), so that a program which comes back
            to the same spot is not taken for a later pass.
        spacing_m: Station spacing.
        gap_m: A longer step that is more than four times its neighbours is a hole in the samples.

    Raises:
        InputError: Lengths differ, values are not finite, time runs backwards, or the nominal path has no length.

    Source: design of figures after ISO 9283 (path accuracy); nearest-point deviation across and along the feed.
    """
    p = as_float("p_part_tcp", p_part_tcp, (None, 3))
    n = len(p)
    time = as_float("time_s", time_s, (n,))
    contact = as_float("engagement", np.asarray(engagement, dtype=np.float64), (n,))
    radius = as_positive("cutter_radius_m", cutter_radius_m)
    as_positive("spacing_m", spacing_m)
    as_positive("gap_m", gap_m)
    if n == 0:
        raise InputError("the measured path holds no samples")
    if np.any(np.diff(time) < 0.0):
        sample = int(np.argmin(np.diff(time))) + 1
        raise InputError("time of the measured path runs backwards", where=f"sample {sample}")
    rows = as_float("nominal.p_part_tcp", nominal.p_part_tcp, (None, 3))
    S = _lengths(rows)
    if len(rows) < 2 or S[-1] <= 0.0:
        raise InputError("the nominal path has no length")
    feed: Bool = np.asarray(nominal.kind) == FEED

    q, place, broken = path_matching.even_stations(p, spacing_m, gap_m)
    where = np.arange(n, dtype=np.float64)
    engaged_at: Float = contact[np.ceil(place).astype(np.int64)]
    touching: Bool = engaged_at > 0.0
    hint = np.full(n, np.nan) if progress is None else as_float("progress", progress, (n,)) * S[-1]
    near_hint: Float = np.interp(place, where, hint)
    u, seg = path_matching.match(q, broken, touching, rows, S, spacing_m, CAPTURE_M, LOST_M, near_hint, WINDOW_M)
    axis = np.ascontiguousarray(nominal.axis_part, dtype=np.float64)
    dev, tangent, left, near = path_matching.split(q, axis, u, seg, rows, S, feed)
    across: Float = dev - np.sum(dev * tangent, axis=1)[:, None] * tangent
    station_time: Float = np.interp(place, where, time)
    due: Float = np.interp(station_time, np.asarray(nominal.time_s), S)
    if command_part_tcp is not None:
        command = as_float("command_part_tcp", command_part_tcp, (n, 3))
        qc, placec, brokenc = path_matching.even_stations(command, spacing_m, gap_m)
        touchc: Bool = contact[np.ceil(placec).astype(np.int64)] > 0.0
        hintc: Float = np.interp(placec, where, hint)
        uc, _ = path_matching.match(qc, brokenc, touchc, rows, S, spacing_m, CAPTURE_M, LOST_M, hintc, WINDOW_M)
        due = np.interp(place, placec, uc)
    cutting: Bool = touching & feed[seg]
    runs = contact_runs(cutting, broken, spacing_m)
    entry, exit_ = entry_exit(runs, engaged_at, spacing_m, radius)
    return PathDeviation(
        spacing_m=spacing_m,
        time_s=station_time,
        p_part_actual=q,
        p_part_nominal=near,
        length_m=u,
        motion=np.asarray(nominal.motion, dtype=np.int64)[seg],
        feed_direction=tangent,
        left=left,
        across=across,
        across_left_m=np.sum(across * left, axis=1),
        across_axis_m=np.sum(across * np.cross(tangent, left), axis=1),
        along_m=u + np.sum(dev * tangent, axis=1) - due,
        engagement=engaged_at,
        cutting=cutting,
        entry=entry & cutting,
        exit=exit_ & cutting,
        air=feed[seg] & ~touching & (np.linalg.norm(dev, axis=1) <= LOST_M),
        broken=broken,
    )


def _lengths(rows: Float) -> Float:
    steps: Float = np.linalg.norm(np.diff(rows, axis=0), axis=1)
    return np.concatenate([np.zeros(min(len(rows), 1)), np.cumsum(steps)])
