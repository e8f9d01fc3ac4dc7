"""From elementary motions to a sampled tool path: short straight segments with time, vectorised over all motions."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int, as_float, as_positive
from counterflex.core.errors import InputError
from counterflex.path.toolpath import FEED, RAPID, ToolPath

RAPID_MOTION: Final = 0
FEED_MOTION: Final = 1
ARC_MOTION: Final = 2
DWELL_MOTION: Final = 3

# Two points closer than this are one point: below the resolution of any program text (0.1 um).
_JOIN_M: Final = 1e-9
_SHORTEST: Final = 0.2
"""Share of the longest step below which slow motions are not divided further."""
# A path of more points than this is a mistake in step_m rather than a wish (about 12 GB of columns).
_MAX_POINTS: Final = 100_000_000


@dataclass(frozen=True)
class MotionTable:
    """Elementary motions of the tool tip in the part frame, one row each, free of any program language."""

    kind: Int  # (n,) RAPID_MOTION, FEED_MOTION, ARC_MOTION or DWELL_MOTION
    p_start: Float  # (n, 3) m
    p_end: Float  # (n, 3) m
    feed_m_s: Float  # (n,) m/s along the path, positive for feed and arc motions
    spindle_rad_s: Float  # (n,) rad/s, positive for M3
    tool: Int  # (n,) tool number
    duration_s: Float  # (n,) s, of a dwell
    p_centre: Float  # (n, 3) m, a point on the axis of an arc at the height of its start; anything elsewhere
    normal: Float  # (n, 3) unit normal of the arc's plane; anything elsewhere
    turn_rad: Float  # (n,) rad, signed angle turned about `normal`; several turns and helices included

    def __post_init__(self) -> None:
        """Check lengths, finiteness and the sense of each row."""
        n = len(self.kind)
        for name in ("p_start", "p_end", "p_centre", "normal"):
            as_float(name, getattr(self, name), (n, 3))
        for name in ("feed_m_s", "spindle_rad_s", "duration_s", "turn_rad", "tool"):
            as_float(name, getattr(self, name), (n,))
        moving = (self.kind == FEED_MOTION) | (self.kind == ARC_MOTION)
        slow = np.flatnonzero(moving & (self.feed_m_s <= 0.0))
        if slow.size:
            raise InputError(
                f"motion {slow[0]} is a feed motion without feed", value=float(self.feed_m_s[slow[0]]), limit="> 0 m/s"
            )
        if np.any(self.duration_s < 0.0):
            raise InputError("a dwell lasts a negative time", value=float(self.duration_s.min()), limit=">= 0 s")

    def __len__(self) -> int:
        """Number of motions."""
        return len(self.kind)


def point_spacing(feed_m_s: float, cycle_s: float) -> float:
    """Distance between path points that a controller works off one per cycle: ``DS = f DT``.

    In shop units ``DS[um] = f[mm/min] DT[ms] / 60``: 1500 mm/min and 12 ms give 300 um.

    Args:
        feed_m_s: Feed, m/s, > 0.
        cycle_s: Interpolation cycle of the controller, s, > 0.

    Returns:
        Spacing in m.

    Raises:
        InputError: An argument is not positive and finite.

    Source: Berger2013 eq. 5.
    """
    return as_positive("feed_m_s", feed_m_s) * as_positive("cycle_s", cycle_s)


def chord_angle(radius_m: Float, chord_m: float) -> Float:
    """Largest angle of a chord whose middle is within ``chord_m`` of its arc: ``2 acos(1 - e / r)``.

    Args:
        radius_m: (n,) m, > 0.
        chord_m: Allowed chord error e, m, > 0.

    Returns:
        (n,) rad, at most pi/2 so that a small circle keeps its shape.
    """
    ratio = np.clip(1.0 - chord_m / np.maximum(radius_m, 1e-12), -1.0, 1.0)
    angle: Float = np.minimum(2.0 * np.arccos(ratio), 0.5 * np.pi)
    return angle


def motion_length(motions: MotionTable) -> Float:
    """Path length of each motion: the distance, or of a (helical) arc ``sqrt((r turn)^2 + rise^2)``.

    Returns:
        (n,) m. The radius of an arc is the mean of the start and end radius.
    """
    length: Float = np.linalg.norm(motions.p_end - motions.p_start, axis=1)
    arc = motions.kind == ARC_MOTION
    if arc.any():
        radius, end_radius, rise = _arc_geometry(motions, arc)
        length[arc] = np.hypot(0.5 * (radius + end_radius) * motions.turn_rad[arc], rise)
    length[motions.kind == DWELL_MOTION] = 0.0
    return length


def _arc_geometry(motions: MotionTable, arc: Bool) -> tuple[Float, Float, Float]:
    """Radius at the start, radius at the end and rise along the normal of the arcs selected, each (m,) in m."""
    normal = motions.normal[arc]
    spoke = motions.p_start[arc] - motions.p_centre[arc]
    end_spoke = motions.p_end[arc] - motions.p_centre[arc]
    height = np.einsum("ij,ij->i", spoke, normal)
    rise: Float = np.einsum("ij,ij->i", end_spoke, normal) - height
    radius: Float = np.linalg.norm(spoke - height[:, None] * normal, axis=1)
    end_radius: Float = np.linalg.norm(end_spoke - (height + rise)[:, None] * normal, axis=1)
    return radius, end_radius, rise


def _counts(motions: MotionTable, length: Float, step_m: float, step_s: float, chord_m: float) -> Int:
    """Number of segments of each motion, at least one."""
    count = np.ones(len(motions))
    moving = (motions.kind == FEED_MOTION) | (motions.kind == ARC_MOTION)
    # The small allowance keeps 10 mm at 1 mm from becoming eleven steps by a rounding of the last digit.
    step = np.minimum(step_m, np.maximum(motions.feed_m_s[moving] * step_s, _SHORTEST * step_m))
    count[moving] = np.maximum(1.0, np.ceil(length[moving] / step - 1e-9))
    arc = motions.kind == ARC_MOTION
    if arc.any():
        radius, end_radius, _ = _arc_geometry(motions, arc)
        by_chord = np.ceil(np.abs(motions.turn_rad[arc]) / chord_angle(np.maximum(radius, end_radius), chord_m) - 1e-9)
        count[arc] = np.maximum(count[arc], by_chord)
    if count.sum() > _MAX_POINTS:
        raise InputError(
            "the sampled path would have too many points",
            value=f"{count.sum():.3g}",
            limit=f"<= {_MAX_POINTS}",
            hint="Choose a larger step_m or chord_m",
        )
    whole: Int = count.astype(np.int64)
    return whole


def sample(
    motions: MotionTable,
    *,
    step_m: float = 1e-3,
    rapid_speed_m_s: float = 0.5,
    chord_m: float = 5e-6,
    step_s: float = math.inf,
    least: Int | None = None,
) -> ToolPath:
    """Cut motions into straight segments and give every point its time of arrival.

    Feed motions are divided evenly into steps no longer than ``step_m``, slow ones into steps that last no longer than
    ``step_s`` (not below a fifth of ``step_m``); arcs besides so that no chord leaves the arc by more than ``chord_m``.
    Ends of motions are kept exactly. A rapid is one segment, a dwell two equal points. Where a motion does not start at
    the end of the one before it (another tool length), a rapid segment joins them.

    Args:
        step_m: Longest step, m, > 0.
        rapid_speed_m_s: Speed assumed for rapids, m/s, > 0.
        chord_m: Allowed chord error of arcs, m, > 0.
        step_s: Longest time of a step, s, > 0.
        least: (n,) least number of segments of each motion; 1 when left out.

    Returns:
        The tool path; empty where there are no motions. ``axis_part`` is +z of the part (three-axis milling).

    Raises:
        InputError: An argument is out of range or the path would have more than 1e8 points.
    """
    step_m = as_positive("step_m", step_m)
    rapid_speed_m_s = as_positive("rapid_speed_m_s", rapid_speed_m_s)
    chord_m = as_positive("chord_m", chord_m)
    n = len(motions)
    if n == 0:
        none, no = np.zeros(0), np.zeros(0, dtype=np.int64)
        return ToolPath(np.zeros((0, 3)), np.zeros((0, 3)), no, none, none.copy(), none.copy(), no.copy(), no.copy())
    length = motion_length(motions)
    count = _counts(motions, length, step_m, step_s, chord_m)
    if least is not None:
        count = np.maximum(count, least)
    first = np.cumsum(count) - count
    index = np.repeat(np.arange(n), count)
    number = np.arange(len(index)) - first[index] + 1
    fraction = number / count[index]
    points = _interpolate(motions, index, fraction)
    last = first + count - 1
    points[last] = motions.p_end

    speed = np.where(motions.kind == RAPID_MOTION, rapid_speed_m_s, motions.feed_m_s)
    speed[motions.kind == DWELL_MOTION] = 0.0
    duration = np.where(motions.kind == DWELL_MOTION, motions.duration_s, length / np.where(speed > 0.0, speed, 1.0))
    passed_s = (duration / count)[index]
    kind = np.where(motions.kind == RAPID_MOTION, RAPID, FEED)[index]
    columns = _SampleColumns(
        points, kind, speed[index], motions.spindle_rad_s[index], passed_s, index, motions.tool[index]
    )
    return columns.joined(motions, first, rapid_speed_m_s)


def _interpolate(motions: MotionTable, index: Int, fraction: Float) -> Float:
    """Points at ``fraction`` of the motions ``index``: on the line, or on the (helical, slightly spiral) arc."""
    start = motions.p_start[index]
    points: Float = start + fraction[:, None] * (motions.p_end[index] - start)
    arc = motions.kind[index] == ARC_MOTION
    if arc.any():
        rows = index[arc]
        per_motion = motions.kind == ARC_MOTION
        place = np.cumsum(per_motion)[rows] - 1
        radius, end_radius, rise = _arc_geometry(motions, per_motion)
        normal, centre = motions.normal[rows], motions.p_centre[rows]
        spoke = motions.p_start[rows] - centre
        height = np.einsum("ij,ij->i", spoke, normal)[:, None] * normal
        flat = spoke - height
        turned = motions.turn_rad[rows] * fraction[arc]
        growth = 1.0 + fraction[arc] * (end_radius / radius - 1.0)[place]
        swept = np.cos(turned)[:, None] * flat + np.sin(turned)[:, None] * np.cross(normal, flat)
        points[arc] = centre + height + growth[:, None] * swept + (fraction[arc] * rise[place])[:, None] * normal
    return points


def _gaps(motions: MotionTable) -> Float:
    """Distance of the start of each motion from the end of the one before it, (n,) m."""
    gap: Float = np.zeros(len(motions))
    gap[1:] = np.linalg.norm(motions.p_start[1:] - motions.p_end[:-1], axis=1)
    return gap


def joints_before(motions: MotionTable) -> Int:
    """Motions that do not start at the end of the one before them: a rapid row leads to their start."""
    return np.flatnonzero(_gaps(motions) > _JOIN_M)


@dataclass
class _SampleColumns:
    """Columns of a path that still lacks its first row."""

    points: Float
    kind: Int
    feed: Float
    spindle: Float
    step_s: Float
    motion: Int
    tool: Int

    def joined(self, motions: MotionTable, first: Int, rapid_speed_m_s: float) -> ToolPath:
        """Put the start point first, and a rapid row before every motion that starts elsewhere."""
        gap = _gaps(motions)
        broken = joints_before(motions)
        where = np.concatenate(([0], first[broken]))
        owner = np.concatenate(([0], broken))
        points = np.insert(self.points, where, motions.p_start[owner], axis=0)
        step_s = np.insert(self.step_s, where, gap[owner] / rapid_speed_m_s)
        feed = np.insert(self.feed, where, rapid_speed_m_s)
        axis = np.zeros_like(points)
        axis[:, 2] = 1.0
        step_s[0] = 0.0
        return ToolPath(
            p_part_tcp=np.ascontiguousarray(points),
            axis_part=axis,
            kind=np.insert(self.kind, where, RAPID).astype(np.int64),
            feed_m_s=feed,
            spindle_rad_s=np.insert(self.spindle, where, motions.spindle_rad_s[owner]),
            time_s=np.cumsum(step_s),
            motion=np.insert(self.motion, where, owner).astype(np.int64),
            tool=np.insert(self.tool, where, motions.tool[owner]).astype(np.int64),
        )
