"""The path speed that a robot holds along a program: the programmed feed, less what drives and controller cannot do.

Each segment has the speed at which the first axis reaches its limit (also near a singularity, where a little way is
much turning), the tool turns as fast as it may, or the controller has no faster blocks. Each corner has the speed at
which its rounding takes the acceleration of the tool or of an axis: over a rounding that begins at the distance d
before a corner that turns by theta, direction u and joint rates per way g = dq/ds change by ``a = v^2 (u2 - u1) / (2 d
cos^2(theta/2))`` at the apex of the parabola. In between the tool speeds up and brakes,
``v_2^2 <= v_1^2 + 2 a L``, with the acceleration of the tool or less where an axis has less.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.path.toolpath import ToolPath
from counterflex.plan.preflight.approximation import LEAST_M, Corners
from counterflex.plan.preflight.row import CheckLimits
from counterflex.plan.preflight.spacing import BlockSpacing, reached_feed


class SpeedCause(IntEnum):
    """Cause that limits a path speed."""

    PROGRAMMED = 0
    JOINT_SPEED = 1
    REORIENTATION = 2
    BLOCK_TIME = 3
    LOOK_AHEAD = 4
    TOOL_ACCELERATION = 5
    JOINT_ACCELERATION = 6
    EXACT_STOP = 7
    STANDSTILL = 8


# Speeds that agree to rounding keep the cause that came first.
_TIE: Final = 1.0 - 1e-9
_STATION_M: Final = 1e-9


@dataclass(frozen=True, eq=False)
class HeldSpeed:
    """Path speed along a path of n rows; a value of a segment stands at the row at which it ends."""

    programmed_m_s: Float  # (n,) on the segment; 0 where nothing moves
    mean_m_s: Float  # (n,) that the robot holds on the segment in the mean
    lowest_m_s: Float  # (n,) the lower one of its two ends
    at_m_s: Float  # (n,) at the row itself
    duration_s: Float  # (n,) of the segment, standstill included
    cause: Int  # (n,) Cause of what is missing of the programmed speed
    axis: Int  # (n,) 0..5 where the cause is an axis, else -1
    length_m: Float  # (n,) of the segment

    def slower(self, share: float) -> Bool:
        """(n,) segments on which the robot is slower in the mean than a share of the programmed speed."""
        out: Bool = (self.length_m > LEAST_M) & (self.mean_m_s < share * self.programmed_m_s)
        return out


class _Speeds:
    """Speeds with what limits each of them."""

    def __init__(self, speed_m_s: Float, cause: SpeedCause) -> None:
        self.speed = speed_m_s.copy()
        self.cause: Int = np.full(len(speed_m_s), int(cause), dtype=np.int64)
        self.axis: Int = np.full(len(speed_m_s), -1, dtype=np.int64)

    def limit(self, rows: Int | slice, speed_m_s: Float | float, cause: Int | int, axis: Int | int = -1) -> None:
        """Lower the speed of rows where another one is lower."""
        new = np.broadcast_to(speed_m_s, self.speed[rows].shape)
        lower = new < self.speed[rows] * _TIE
        for own, value in ((self.speed, new), (self.cause, cause), (self.axis, axis)):
            own[rows] = np.where(lower, value, own[rows])


def held_speed(
    path: ToolPath, q: Float, turned_rad: Float, blocks: BlockSpacing, corners: Corners, bounds: CheckLimits
) -> HeldSpeed:
    """Path speed that the robot holds.

    Args:
        path: n >= 1 rows; its times are those of the programmed feed.
        q: (n, 6) rad, continuous.
        turned_rad: (n,) angle by which the tool frame turns on the way to each row.
        bounds: Limits; those that are not known limit nothing.
    """
    n = len(path)
    step = np.diff(path.p_part_tcp, axis=0, prepend=path.p_part_tcp[:1])
    length = np.linalg.norm(step, axis=1)
    time = np.diff(path.time_s, prepend=path.time_s[:1])
    row = np.flatnonzero(length > LEAST_M)
    if len(row) == 0:
        nothing = np.zeros(n)
        standing: Int = np.full(n, int(SpeedCause.STANDSTILL), dtype=np.int64)
        return HeldSpeed(nothing, nothing, nothing, nothing, time, standing, np.full(n, -1), nothing)
    way, unit = length[row], step[row] / length[row, None]
    rates = np.diff(q, axis=0, prepend=q[:1])[row] / way[:, None]
    programmed = np.where(time[row] > 0.0, way / np.where(time[row] > 0.0, time[row], 1.0), path.feed_m_s[row])
    segment = _Speeds(np.maximum(programmed, 1e-6), SpeedCause.PROGRAMMED)
    _limit_segments(segment, row, way, rates, turned_rad[row], blocks, bounds)
    along = np.full(len(row), bounds.acceleration_m_s2)
    if bounds.joint_accelerations_rad_s2 is not None:
        share = np.max(np.abs(rates) / bounds.joint_accelerations_rad_s2, axis=1)
        along = np.minimum(along, 1.0 / np.maximum(share, 1e-12))
    node = _nodes(segment, path, row, way, unit, rates, along, corners, bounds)
    at, source = _driven(node.speed, 2.0 * along * way)
    return _result(path, row, way, programmed, time, segment, node, at, source, along)


def _limit_segments(
    segment: _Speeds, row: Int, way: Float, rates: Float, turned: Float, blocks: BlockSpacing, bounds: CheckLimits
) -> None:
    """Speeds that hold anywhere on a segment."""
    every = slice(None)
    if bounds.joint_speeds_rad_s is not None:
        share = np.abs(rates) / bounds.joint_speeds_rad_s
        axis = np.argmax(share, axis=1)
        segment.limit(every, 1.0 / np.maximum(share.max(axis=1), 1e-12), SpeedCause.JOINT_SPEED, axis)
    if bounds.orientation_rad_s is not None:
        speed = bounds.orientation_rad_s * way / np.maximum(turned, 1e-12)
        segment.limit(every, speed, SpeedCause.REORIENTATION)
    number = np.searchsorted(blocks.point, row)
    known = np.flatnonzero((number < len(blocks.point)) & blocks.cuts[np.minimum(number, len(blocks.point) - 1)])
    own = number[known]
    segment.limit(known, blocks.length_m[own] / bounds.least_block_s, SpeedCause.BLOCK_TIME)
    if bounds.look_ahead is not None:
        reached = reached_feed(blocks, 1e-12, bounds.look_ahead, bounds.acceleration_m_s2)
        segment.limit(known, reached[own], SpeedCause.LOOK_AHEAD)


def _nodes(
    segment: _Speeds, path: ToolPath, row: Int, way: Float, unit: Float, rates: Float, along: Float, corners: Corners,
    bounds: CheckLimits,
) -> _Speeds:  # fmt: skip
    """Speeds at the ends of the segments; where a corner is rounded its speed holds on the whole rounding."""
    m = len(row)
    node = _Speeds(np.full(m + 1, np.inf), SpeedCause.PROGRAMMED)
    inner = np.arange(1, m)
    between = np.zeros(m + 1)  # over which way the direction changes
    between[1:-1] = 0.5 * (way[:-1] + way[1:])
    at = np.searchsorted(row, corners.point) + 1
    distance = np.where(corners.sharp, corners.distance_m, 0.5 * corners.side_m)
    between[at] = 2.0 * distance * np.cos(0.5 * corners.turn_rad) ** 2
    stops = corners.exact | (corners.sharp & (distance <= LEAST_M))
    node.limit(at[stops], 0.0, SpeedCause.EXACT_STOP)
    bend = np.maximum(np.linalg.norm(np.diff(unit, axis=0), axis=1), 1e-12)
    node.limit(inner, np.sqrt(bounds.acceleration_m_s2 * between[inner] / bend), SpeedCause.TOOL_ACCELERATION)
    if bounds.joint_accelerations_rad_s2 is not None:
        share = np.abs(np.diff(rates, axis=0)) / bounds.joint_accelerations_rad_s2
        axis = np.argmax(share, axis=1)
        speed = np.sqrt(between[inner] / np.maximum(share.max(axis=1), 1e-12))
        node.limit(inner, speed, SpeedCause.JOINT_ACCELERATION, axis)
    station = np.concatenate([[0.0], np.cumsum(way)])
    for corner in np.flatnonzero(corners.sharp & ~stops):
        k = int(at[corner])
        if node.speed[k] >= min(segment.speed[k - 1], segment.speed[k]) * _TIE:
            continue
        _round(segment, station, along, k, float(distance[corner]), node)
    stands = np.flatnonzero(path.time_s[row[1:] - 1] > path.time_s[row[:-1]]) + 1
    node.limit(np.concatenate([[0], stands, [m]]), 0.0, SpeedCause.STANDSTILL)
    for ends in (slice(0, m), slice(1, m + 1)):
        node.limit(ends, segment.speed, segment.cause, segment.axis)
    return node


def _round(segment: _Speeds, station: Float, along: Float, k: int, distance_m: float, node: _Speeds) -> None:
    """Hold the speed of node k from the distance before it to the distance behind it; beyond, the tool speeds up."""
    m, speed = len(along), float(node.speed[k])
    cause, axis = int(node.cause[k]), int(node.axis[k])
    begin, end = station[k] - distance_m, station[k] + distance_m
    first = int(np.searchsorted(station, begin - _STATION_M, side="left"))
    last = int(np.searchsorted(station, end + _STATION_M, side="right")) - 1
    segment.limit(slice(first, last), speed, cause, axis)
    for index, beyond in ((first - 1, begin - station[first - 1]), (last, station[min(last + 1, m)] - end)):
        if 0 <= index < m:
            fastest = float(np.sqrt(speed**2 + 2.0 * along[index] * max(beyond, 0.0)))
            segment.limit(slice(index, index + 1), fastest, cause, axis)


def _driven(node_m_s: Float, gain: Float) -> tuple[Float, Int]:
    """Speeds that are reached and braked from: ``v_i^2 <= v_(i-1)^2 + 2 a L`` forwards and backwards."""
    # Returned beside the speeds: of which node each is a consequence.
    forward, source = _reached(node_m_s**2, gain)
    backward, later = _reached(forward[::-1], gain[::-1])
    later = len(node_m_s) - 1 - later[::-1]
    return np.sqrt(backward[::-1]), source[later]


def _reached(square: Float, gain: Float) -> tuple[Float, Int]:
    """``y_i = min(x_i, y_(i-1) + g_i)`` as a running minimum of ``x - cumsum(g)``, and the index that it stems from."""
    total = np.concatenate([[0.0], np.cumsum(gain)])
    rest = square - total
    least = np.minimum.accumulate(rest)
    place = np.arange(len(square))
    source: Int = np.maximum.accumulate(np.where(rest <= least, place, 0))
    out: Float = np.where(source == place, square, np.minimum(square, np.maximum(least + total, 0.0)))
    return out, source


def _result(
    path: ToolPath, row: Int, way: Float, programmed: Float, time: Float, segment: _Speeds, node: _Speeds, at: Float,
    source: Int, along: Float,
) -> HeldSpeed:  # fmt: skip
    """Time of each segment in three phases (speed up, hold, brake), and what its cause is."""
    n = len(path)
    v0, v1 = at[:-1], at[1:]
    top = np.maximum(v0, v1)
    peak = np.maximum(np.sqrt(np.minimum(segment.speed**2, along * way + 0.5 * (v0**2 + v1**2))), top)
    ramps = (2.0 * peak**2 - v0**2 - v1**2) / (2.0 * along)
    duration = (2.0 * peak - v0 - v1) / along + np.maximum(way - ramps, 0.0) / peak
    lower = np.where(v0 <= v1, source[:-1], source[1:])
    by_node = np.minimum(v0, v1) < segment.speed * _TIE
    out = HeldSpeed(
        np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n), time.copy(),
        np.full(n, int(SpeedCause.STANDSTILL), dtype=np.int64), np.full(n, -1, dtype=np.int64), np.zeros(n),
    )  # fmt: skip
    out.programmed_m_s[row], out.mean_m_s[row], out.length_m[row] = programmed, way / duration, way
    out.lowest_m_s[row], out.duration_s[row] = np.minimum(v0, v1), duration
    out.cause[row] = np.where(by_node, node.cause[lower], segment.cause)
    out.axis[row] = np.where(by_node, node.axis[lower], segment.axis)
    behind = np.searchsorted(row, np.arange(n), side="right")
    out.at_m_s[:] = at[behind]
    return out
