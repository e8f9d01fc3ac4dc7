"""Path accuracy AT and path repeatability RT (ISO 9283:1998, 8.2 and 8.3)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.errors import InputError
from counterflex.core.units import MM
from counterflex.evaluate.iso9283 import intervals
from counterflex.evaluate.iso9283.intervals import FigureInterval, mean_figure, three_sigma
from counterflex.evaluate.iso9283.path_cycles import REACH_M, ZONE, CommandedPath, PathCycle
from counterflex.geometry import rotation


@dataclass(frozen=True, eq=False)
class Corner:
    """Cornering deviations at one corner."""

    point: int  # of the commanded path, index
    length_m: float  # along the path
    turn_rad: float  # how much the path turns there
    cr_m: Float  # (n,) least distance of each attained path from the corner
    co_m: Float  # (n,) largest deviation of each from the second path, outward; 0 where there is none


def corners(path: CommandedPath, cycles: Sequence[PathCycle]) -> list[Corner]:
    """CR and CO at every corner of the commanded path; the figures are the largest over the cycles.

    ``CR_j`` is the least distance between the corner and attained path j. ``CO_j`` is the largest distance of attained
    path j from the second commanded path once it runs along that, counted only on the outer side, where the first path
    would have gone on; up to the end of the straight second path, less a tenth before the next corner.

    Source: ISO 9283:1998, 8.5.2 and 8.5.3 (three cycles).
    """
    out = []
    ends = [0, *path.corners.tolist(), len(path.p) - 1]
    for before, k, after in zip(ends, ends[1:], ends[2:], strict=False):
        a, b = path.p[k] - path.p[k - 1], path.p[k + 1] - path.p[k]
        t1, t2 = a / np.linalg.norm(a), b / np.linalg.norm(b)
        outward = t1 - (t1 @ t2) * t2
        size = float(np.linalg.norm(outward))
        length = path.length
        straight = k + 1
        while straight < after and float(np.linalg.norm(np.cross(path.p[straight + 1] - path.p[k], t2))) < 1e-6:
            straight += 1
        end = length[straight] - ZONE * (length[after] - length[k])
        cr, co = np.empty(len(cycles)), np.zeros(len(cycles))
        for j, cycle in enumerate(cycles):
            near = (cycle.length_m >= 0.5 * (length[before] + length[k])) & (
                cycle.length_m <= 0.5 * (length[k] + length[after])
            )
            cr[j] = _least_distance(cycle.p[near], path.p[k])
            if size < 1e-9:
                continue
            d = cycle.p - path.p[k]
            along = d @ t2
            second = (cycle.length_m >= length[k] - 1e-9) & (along >= 0.0) & (along <= end - length[k])
            across = d - along[:, None] * t2
            outer = second & (across @ (outward / size) > 0.0)
            co[j] = float(np.linalg.norm(across[outer], axis=1).max()) if outer.any() else 0.0
        turn = float(np.arccos(np.clip(t1 @ t2, -1.0, 1.0)))
        out.append(Corner(k, float(length[k]), turn, cr, co))
    return out


def _least_distance(p: Float, point: Float) -> float:
    """Distance of a point from a polyline, m."""
    if len(p) < 2:
        return float(np.linalg.norm(p - point, axis=1).min()) if len(p) else float("nan")
    step = np.diff(p, axis=0)
    share = np.clip(np.sum((point - p[:-1]) * step, axis=1) / np.maximum(np.sum(step * step, axis=1), 1e-18), 0.0, 1.0)
    return float(np.linalg.norm(p[:-1] + share[:, None] * step - point, axis=1).min())


_WINDOW_M: Final = 4.0 * MM


@dataclass(frozen=True, eq=False)
class IsoPathFigures:
    """Figures of a path and what they come from."""

    length_m: Float  # (m,) places along the commanded path
    command: Float  # (m, 3) m, commanded points there
    direction: Float  # (m, 3) of the commanded path
    p_attained: Float  # (m, n, 3) m, where each of n attained paths crosses the plane normal to the commanded one
    turned_rad: Float | None  # (m, n, 3) rad, rotation vectors from commanded to attained orientation there; or None
    at_p: intervals.FigureInterval  # `AT_P = max_i |mean_i - c_i|`, m
    rt_p: intervals.FigureInterval | None  # `RT_P = max_i (mean(l_i) + 3 S_li)`, m; None with one cycle
    at_abc: tuple[intervals.FigureInterval, ...]  # `max_i |mean a_i|`, rad
    rt_abc: tuple[intervals.FigureInterval, ...]  # `max_i 3 S_ai`, rad
    at_place: int  # place of the largest `AT`
    rt_place: int | None  # of the largest `RT`, or None
    by_place_at_m: Float  # (m,) distance of the barycentres
    by_place_rt_m: Float  # (m,) radius of the tube `mean(l) + 3 S`; zero with one cycle

    @classmethod
    def of(cls, path: CommandedPath, cycles: Sequence[PathCycle], places: Float | None = None) -> IsoPathFigures:
        """AT and RT of attained paths in planes normal to the commanded one.

        Args:
            path: As commanded.
            cycles: Attained paths.
            places: (m,) m along the path; None takes :meth:`CommandedPath.places`.

        Raises:
            InputError: No cycle, or a cycle does not cross a plane: there is a hole in the log.

        Source: ISO 9283:1998, 8.2 and 8.3 (ten cycles).
        """
        if not cycles:
            raise InputError("no attained path goes along the commanded one")
        s = path.places() if places is None else places
        c, t = path.at(s)
        attained = np.stack([crossings(cycle, s, c, t) for cycle in cycles], axis=1)
        gap = np.argwhere(np.isnan(attained[..., 0]))
        if len(gap):
            place, cycle = gap[0]
            raise InputError(
                "an attained path has a hole",
                where=f"cycle {cycle + 1}, {s[place] / MM:.1f} mm along the path",
                hint="Readings are missing there: was the beam interrupted?",
            )
        n = len(cycles)
        centre = attained.mean(axis=1)
        by_at = np.linalg.norm(centre - c, axis=1)
        i = int(np.argmax(by_at))
        scatter = np.cov(attained[i].T) / n if n > 1 else np.zeros((3, 3))
        away = np.linalg.norm(attained - centre[:, None], axis=2)
        by_rt = away.mean(axis=1) + 3.0 * away.std(axis=1, ddof=1) if n > 1 else np.zeros(len(s))
        turned = _turned(path, cycles, s)
        angles = () if turned is None else tuple(np.moveaxis(turned, 2, 0))
        return cls(
            length_m=s,
            command=c,
            direction=t,
            p_attained=attained,
            turned_rad=turned,
            at_p=intervals.length_figure(centre[i] - c[i], scatter, n),
            rt_p=intervals.largest_repeatability(attained) if n > 1 else None,
            at_abc=tuple(_size(intervals.mean_figure(a[int(np.argmax(np.abs(a.mean(axis=1))))])) for a in angles),
            rt_abc=tuple(max((intervals.three_sigma(row) for row in a), key=lambda f: f.value) for a in angles)
            if n > 1
            else (),
            at_place=i,
            rt_place=int(np.argmax(by_rt)) if n > 1 else None,
            by_place_at_m=by_at,
            by_place_rt_m=by_rt,
        )


def crossings(cycle: PathCycle, s: Float, p_plane: Float, normal: Float) -> Float:
    """Points where an attained path crosses planes: (m, 3) m, NaN where it does not.

    Readings are joined by straight lines. Where noise makes a slow path cross a plane several times, the mean counts.

    Args:
        s: (m,) m, places along the commanded path.
        p_plane: (m, 3) m, points of the planes.
        normal: (m, 3) unit normals.
    """
    out: Float = np.full((len(s), 3), np.nan)
    for i in range(len(s)):
        k, share = crossing_steps(cycle, s[i], p_plane[i], normal[i])
        if len(k):
            out[i] = np.mean(cycle.p[k] + share[:, None] * (cycle.p[k + 1] - cycle.p[k]), axis=0)
    return out


def crossing_steps(cycle: PathCycle, s: float, p_plane: Float, normal: Float) -> tuple[Int, Float]:
    """Readings before each crossing of a plane, and where between them and the next it lies, 0..1."""
    window = _WINDOW_M + REACH_M + 2.0 * cycle.longest_step_m
    a, b = np.searchsorted(cycle.length_m, [s - window, s + window])
    a, b = max(0, int(a) - 1), min(len(cycle.p), int(b) + 1)
    d = (cycle.p[a:b] - p_plane) @ normal
    near = np.linalg.norm(cycle.p[a:b] - p_plane - d[:, None] * normal, axis=1) <= REACH_M
    k = np.flatnonzero((d[:-1] < 0.0) & (d[1:] >= 0.0) & near[:-1] & near[1:])
    k = np.union1d(k, np.flatnonzero((d[:-1] >= 0.0) & (d[1:] < 0.0) & near[:-1] & near[1:])) if len(k) else k
    share = d[k] / (d[k] - d[k + 1]) if len(k) else np.zeros(0)
    return k + a, share


def _turned(path: CommandedPath, cycles: Sequence[PathCycle], s: Float) -> Float | None:
    command = path.orientation(s)
    if command is None or any(cycle.R is None for cycle in cycles):
        return None
    out = np.empty((len(s), len(cycles), 3))
    for j, cycle in enumerate(cycles):
        assert cycle.R is not None
        nearest = np.clip(np.searchsorted(cycle.length_m, s), 0, len(cycle.p) - 1)
        out[:, j] = rotation.log(cycle.R[nearest] @ np.swapaxes(command, 1, 2))
    return out


def _size(figure: intervals.FigureInterval) -> intervals.FigureInterval:
    """The figure as a magnitude: turned round where it is negative."""
    if figure.value >= 0.0 or figure.low is None or figure.high is None:
        return intervals.FigureInterval(abs(figure.value), figure.low, figure.high, figure.count)
    return intervals.FigureInterval(-figure.value, -figure.high, -figure.low, figure.count)


MIDDLE: Final = 0.5
"""Share of each stretch that velocities are taken from, its middle."""
WINDOW_S: Final = 0.1
"""Time over which a velocity is the slope of a straight line through the readings."""
_PLACES: Final = 50


@dataclass(frozen=True, eq=False)
class PathVelocity:
    """Velocity figures."""

    commanded_m_s: float  # commanded velocity
    av: FigureInterval  # `AV = mean(v) - v_c`, m/s; the standard gives it in % of `v_c`
    rv: FigureInterval | None  # `RV = 3 S_v` of the cycles' means, m/s; None with one cycle
    fv_m_s: float  # `FV = max_j (max_i v_ij - min_i v_ij)`, m/s
    mean_m_s: Float  # (n,) mean of each cycle
    length_m: Float  # (m,) places
    v: Float
    noise_m_s: float  # standard deviation of one velocity that the noise of the readings alone gives

    @classmethod
    def of(cls, path: CommandedPath, cycles: Sequence[PathCycle], window_s: float = WINDOW_S) -> PathVelocity:
        """AV, RV and FV over the middle half of each stretch.

        A velocity is the slope of the progress along the commanded direction against time, by least squares over
        ``window_s``. The noise of a velocity is estimated from what those straight lines leave.

        Raises:
            InputError: The path has no commanded velocity, or a log no times.

        Source: ISO 9283:1998, 8.6.
        """
        vc = path.speed_m_s
        if vc is None or any(cycle.time_s is None for cycle in cycles):
            raise InputError("velocities need a commanded velocity and times")
        s = path.places(MIDDLE, _PLACES)
        c, t = path.at(s)
        v, left = np.full((len(cycles), len(s)), np.nan), []
        for j, cycle in enumerate(cycles):
            assert cycle.time_s is not None
            for i in range(len(s)):
                k, _ = crossing_steps(cycle, s[i], c[i], t[i])
                if len(k) == 0:
                    continue
                at = float(np.mean(cycle.time_s[k]))
                a, b = np.searchsorted(cycle.time_s, [at - 0.5 * window_s, at + 0.5 * window_s])
                a, b = min(int(a), int(k[0])), max(int(b), int(k[-1]) + 2)
                time, along = cycle.time_s[a:b] - at, (cycle.p[a:b] - c[i]) @ t[i]
                time0 = time - time.mean()
                sum2 = float(time0 @ time0)
                v[j, i] = float(time0 @ along) / sum2
                if b - a > 2:
                    rest = along - along.mean() - v[j, i] * time0
                    left.append(math.sqrt(float(rest @ rest) / (b - a - 2) / sum2))
        if np.isnan(v).any():
            raise InputError("an attained path has a hole where its velocity is measured")
        mean = v.mean(axis=1)
        error = mean_figure(mean - vc)
        return cls(
            commanded_m_s=vc,
            av=error,
            rv=three_sigma(mean) if len(mean) > 1 else None,
            fv_m_s=float((v.max(axis=1) - v.min(axis=1)).max()),
            mean_m_s=mean,
            length_m=s,
            v=v,
            noise_m_s=float(np.median(left)) if left else 0.0,
        )
