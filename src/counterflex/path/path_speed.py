"""Run of a tool path on a robot controller: rounded corners, speed limits, and time.

Corners are rounded within the blending distance (approximate positioning) or stopped at exactly; the path speed is
trapezoidal: programmed feed, limited acceleration along the path, and across it in the roundings.

A tool path as one pose per cycle, with the feed held and resumed softly: what is streamed to a robot without a path.

The path is run as :mod:`counterflex.path.path_speed` runs it: programmed feed, limited acceleration, corners rounded
within the blending distance or stopped at.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from counterflex.core.arrays import Bool, Float, Int, as_float, as_positive
from counterflex.core.errors import InputError
from counterflex.geometry import pose, rotation
from counterflex.path.toolpath import FEED, RAPID, ToolPath

_SMOOTH_RAD = math.radians(3.0)  # corners below this are run through at full speed
_ROUNDING_STEP_RAD = 0.12  # angle between the chords of a rounding
_TURN_LEVER_M = 0.3  # a pure change of orientation by 1 rad counts as this much path


@dataclass(frozen=True)
class Track:
    """The path the controller runs, as a polyline with speeds; row i ends segment i."""

    p: Float  # (n, 3) m
    axis: Float  # (n, 3) tool axis
    length_m: Float  # (n,) length of the segment that ends here; 0 for a dwell
    speed_m_s: Float  # (n,) highest speed on that segment
    corner_m_s: Float  # (n,) highest speed at this point
    dwell_s: Float  # (n,) standstill on a segment without length
    source: Int  # (n,) row of the tool path that the segment belongs to
    turned: Int  # (n,) row of the tool path whose orientation is reached here

    def timed(self, acceleration_m_s2: float, cycle_s: float) -> tuple[Float, Float, Float, Int]:
        """Run the track: samples at the controller's cycle, see :func:`places`.

        ``acceleration_m_s2``: limit along the path, m/s2; ``cycle_s``: time between samples, s.

        Returns:
            Time (m,) s, position (m, 3) m, tool axis (m, 3), row of the tool path (m,); the last sample is at the end.
        """
        segment, along = self.places(acceleration_m_s2, cycle_s)
        share = along[:, None]
        p = (1.0 - share) * self.p[segment] + share * self.p[segment + 1]
        axis = (1.0 - share) * self.axis[segment] + share * self.axis[segment + 1]
        axis /= np.linalg.norm(axis, axis=1, keepdims=True)
        t: Float = cycle_s * np.arange(len(segment), dtype=np.float64)
        return t, p, axis, self.source[segment + 1]

    def places(self, acceleration_m_s2: float, cycle_s: float) -> tuple[Int, Float]:
        """Places of the tool on the track at each cycle.

        Corner speeds are lowered so that ``v_i^2 <= v_(i-1)^2 + 2 a L`` forwards and backwards; each segment is then
        run in three phases (accelerate, hold, brake).

        Args:
            acceleration_m_s2: Limit along the path, m/s2.
            cycle_s: Time between samples, s.

        Returns:
            Segment (m,), which begins at that row of the track, share (m,) 0 .. 1 of it; the last sample is at the end.
        """
        v0, peak, rise, hold, duration = self._phases(acceleration_m_s2)
        a, span, moving = acceleration_m_s2, self.length_m[1:], self.length_m[1:] > 0.0
        station = np.concatenate([[0.0], np.cumsum(span)])
        begin = np.stack([station[:-1], station[:-1] + rise, station[:-1] + rise + hold], axis=1)
        begin[~moving] = station[:-1][~moving, None]
        speed = np.stack([v0, peak, peak], axis=1) * moving[:, None]
        slope = np.stack([np.full_like(v0, a), np.zeros_like(v0), np.full_like(v0, -a)], axis=1) * moving[:, None]
        clock = np.concatenate([[0.0], np.cumsum(duration.ravel())])
        samples = math.ceil(clock[-1] / cycle_s - 1e-9) + 1
        t = cycle_s * np.arange(samples)
        phase = np.clip(np.searchsorted(clock, t, side="right") - 1, 0, duration.size - 1)
        dt = np.minimum(t - clock[phase], duration.ravel()[phase])
        s = begin.ravel()[phase] + speed.ravel()[phase] * dt + 0.5 * slope.ravel()[phase] * dt**2
        segment = phase // 3
        s = np.clip(s, station[segment], station[segment + 1])
        share = np.where(moving[segment], (s - station[segment]) / np.where(moving, span, 1.0)[segment], 0.0)
        return np.asarray(segment, dtype=np.int64), share

    def end_s(self, acceleration_m_s2: float) -> Float:
        """(n,) s, when the tool is at each row, see :meth:`places`."""
        return np.concatenate([[0.0], np.cumsum(np.sum(self._phases(acceleration_m_s2)[-1], axis=1))])

    def _phases(self, acceleration_m_s2: float) -> tuple[Float, Float, Float, Float, Float]:
        """Phases of the segments from the second row on.

        Returns:
            Speed at the begin and speed that is held, m/s; length of speeding up and of holding, m; times (n, 3) s of
            speeding up, holding and braking.
        """
        a, length = acceleration_m_s2, self.length_m
        corner = self.corner_m_s.copy()
        corner[0] = corner[-1] = 0.0
        for i in range(1, len(corner)):
            corner[i] = min(corner[i], math.sqrt(corner[i - 1] ** 2 + 2.0 * a * length[i]))
        for i in range(len(corner) - 1, 0, -1):
            corner[i - 1] = min(corner[i - 1], math.sqrt(corner[i] ** 2 + 2.0 * a * length[i]))
        v0, v1 = corner[:-1], corner[1:]
        span = length[1:]
        peak = np.sqrt(np.minimum(self.speed_m_s[1:] ** 2, a * span + 0.5 * (v0**2 + v1**2)))
        peak = np.maximum(peak, np.maximum(v0, v1))
        rise, fall = (peak**2 - v0**2) / (2.0 * a), (peak**2 - v1**2) / (2.0 * a)
        hold = np.maximum(span - rise - fall, 0.0)
        moving = span > 0.0
        hold_s = np.where(moving, hold / np.where(peak > 0.0, peak, 1.0), self.dwell_s[1:])
        duration = np.stack([(peak - v0) / a, hold_s, (peak - v1) / a], axis=1)
        duration[~moving] = np.stack([np.zeros_like(hold_s), hold_s, np.zeros_like(hold_s)], axis=1)[~moving]
        return v0, peak, rise, hold, duration


def time_as_run(path: ToolPath, blending_m: float, acceleration_m_s2: float) -> Float:
    """(n,) s, when a controller has the tool at the points of a path: the feed does not change at once.

    Rapids take as long as the path says.

    Args:
        path: n rows.
        blending_m: See :func:`build_track`.
        acceleration_m_s2: Limit along and across the path, m/s2, > 0.
    """
    fastest = max(float(np.max(path.feed_m_s, initial=0.0)), 1e-6)
    track = build_track(path, blending_m=blending_m, rapid_m_s=fastest, acceleration_m_s2=acceleration_m_s2)
    at = np.searchsorted(track.source, np.arange(len(path)), side="right") - 1
    fed = np.diff(track.end_s(acceleration_m_s2)[at], prepend=0.0)
    step = np.where(path.kind == FEED, fed, np.diff(path.time_s, prepend=path.time_s[:1]))
    out: Float = path.time_s[:1] + np.cumsum(step)
    return out


def build_track(path: ToolPath, *, blending_m: float, rapid_m_s: float, acceleration_m_s2: float) -> Track:
    """Round the corners of a tool path and find the speed limits.

    A corner of angle theta is replaced by the parabola that leaves and meets its sides at ``d = min(blending, half of
    each side)``; its sharpest curvature ``sin(theta/2) / (d cos^2(theta/2))`` limits the speed to
    ``sqrt(a / curvature)``. Without blending the corner is an exact stop.

    Args:
        blending_m: Largest distance from a corner at which rounding starts, m; 0 is exact stop.
        rapid_m_s: Speed of rapid moves, m/s.
        acceleration_m_s2: Limit along and across the path, m/s2.
    """
    n = len(path)
    step = np.diff(path.p_part_tcp, axis=0, prepend=path.p_part_tcp[:1])
    length = np.linalg.norm(step, axis=1)
    turned = np.linalg.norm(np.diff(path.axis_part, axis=0, prepend=path.axis_part[:1]), axis=1)
    time = np.diff(path.time_s, prepend=path.time_s[:1])
    speed = np.where(path.kind == RAPID, rapid_m_s, np.maximum(path.feed_m_s, 1e-6))
    turning = (length < 1e-9) & (turned > 1e-9)
    reach = np.where(turning, _TURN_LEVER_M * turned, np.where(length < 1e-9, 0.0, length))
    speed = np.where(turning, np.where(time > 0.0, reach / np.maximum(time, 1e-3), rapid_m_s), speed)
    dwell = np.where(reach == 0.0, time, 0.0)
    unit = step / np.maximum(length, 1e-12)[:, None]

    rows: list[tuple[Float, Float, float, float, float, float, int, int]] = []
    begin, begin_axis = path.p_part_tcp[0], path.axis_part[0]
    rows.append((begin, begin_axis, 0.0, 1.0, 0.0, 0.0, 0, 0))
    last = 0
    followed = _followed(reach, dwell, turning)
    for i in range(1, n):
        if reach[i] == 0.0:
            if dwell[i] > 0.0:
                rows[-1] = (*rows[-1][:4], 0.0, *rows[-1][5:])
                rows.append((begin, begin_axis, 0.0, 1.0, 0.0, float(dwell[i]), i, last))
            continue
        end, end_axis, following = path.p_part_tcp[i], path.axis_part[i], int(followed[i])
        corner = distance = angle = 0.0
        if following:
            angle = math.acos(min(1.0, max(-1.0, float(unit[i] @ unit[following]))))
            blend = min(blending_m, 0.5 * length[i], 0.5 * length[following])
            corner, distance = _rounded(angle, blend, min(speed[i], speed[following]), acceleration_m_s2)
        target = end - distance * unit[i]
        span = float(np.linalg.norm(target - begin)) if not turning[i] else float(reach[i])
        rows.append((target, end_axis, span, float(speed[i]), float(corner), 0.0, i, i))
        begin, begin_axis, last = target, end_axis, i
        if distance > 0.0:
            exit_point = end + distance * unit[following]
            for t, p in _parabola(target, end, exit_point, angle):
                source = i if t <= 0.5 else following
                rows.append((p, end_axis, float(np.linalg.norm(p - begin)), corner, corner, 0.0, source, i))
                begin = p
    return Track(*(np.array(column) for column in zip(*rows, strict=True)))


def _followed(reach: Float, dwell: Float, turning: Bool) -> Int:
    """(n,) row that each row blends into, over rows that do not move; 0 where it ends in an exact stop."""
    out, following = np.zeros(len(reach), dtype=np.int64), 0
    for i in range(len(reach) - 1, 0, -1):
        if reach[i] > 0.0:
            out[i] = 0 if turning[i] else following
            following = 0 if turning[i] else i
        elif dwell[i] > 0.0:
            following = 0
    return out


def _parabola(begin: Float, corner: Float, end: Float, angle: float) -> Iterator[tuple[float, Float]]:
    """Parameter and points of a rounding about a corner, from begin, left out, to end."""
    chords = max(4, math.ceil(angle / _ROUNDING_STEP_RAD))
    for k in range(1, chords + 1):
        t = k / chords
        yield t, (1.0 - t) ** 2 * begin + 2.0 * t * (1.0 - t) * corner + t * t * end


def _rounded(angle: float, blend_m: float, speed_m_s: float, acceleration_m_s2: float) -> tuple[float, float]:
    """Speed in a corner, m/s, and the distance from it at which its rounding starts, m; 0, 0 for an exact stop."""
    if angle < _SMOOTH_RAD:
        return speed_m_s, 0.0
    sharp = math.cos(0.5 * angle)
    if not (blend_m > 1e-9 and sharp > 1e-3):
        return 0.0, 0.0
    curvature = math.sin(0.5 * angle) / (blend_m * sharp * sharp)
    return min(math.sqrt(acceleration_m_s2 / curvature), speed_m_s), blend_m


class PoseStream:
    """Poses along a path, one per cycle.

    Args:
        Ts_part_tcp: (n, 4, 4) poses at the points of the path.
        path: The path; its feeds, rapids and dwells count, its points and axes are replaced by those of the poses.
        period_s: Cycle.
        acceleration_m_s2: Limit along the path.
        blending_m: Largest distance from a corner at which rounding starts; 0 is exact stop.
        rapid_m_s: Speed of rapid moves.
        hold_s: Time from full speed to standstill, and back, when the feed is held.

    Attributes:
        at: Place, cycles since the start at full speed; between two where the feed was changed.
        rate: Present speed as a share of the programmed one, 0 .. 1.

    Raises:
        InputError: Shapes that do not fit, a path that does not move.
    """

    def __init__(
        self,
        Ts_part_tcp: Float,
        path: ToolPath,
        *,
        period_s: float,
        acceleration_m_s2: float = 0.5,
        blending_m: float = 0.2e-3,
        rapid_m_s: float = 0.1,
        hold_s: float = 0.2,
    ) -> None:
        T = as_float("Ts_part_tcp", Ts_part_tcp, (len(path), 4, 4))
        self.period_s = as_positive("period_s", period_s)
        self._slew = self.period_s / as_positive("hold_s", hold_s)
        track = build_track(
            replace(path, p_part_tcp=T[:, :3, 3], axis_part=-T[:, :3, 2]),
            blending_m=as_positive("blending_m", blending_m, zero=True),
            rapid_m_s=as_positive("rapid_m_s", rapid_m_s),
            acceleration_m_s2=as_positive("acceleration_m_s2", acceleration_m_s2),
        )
        if len(path) < 2 or float(track.length_m.sum()) == 0.0:
            raise InputError("a path that does not move cannot be streamed", value=len(path))
        self._segment, self._share = track.places(acceleration_m_s2, period_s)
        self._p = track.p
        self._Rs = T[track.turned, :3, :3]
        self._turn = rotation.log(self._Rs[1:] @ np.swapaxes(self._Rs[:-1], -1, -2))
        self.at = 0.0
        self.rate = 0.0

    def __len__(self) -> int:
        """Samples."""
        return len(self._segment)

    @property
    def duration_s(self) -> float:
        """Time at full speed."""
        return (len(self) - 1) * self.period_s

    @property
    def finished(self) -> bool:
        """Return whether the end has been reached."""
        return self.at >= len(self) - 1

    def advance(self, override: float = 1.0) -> None:
        """Go on by one cycle.

        Args:
            override: Share of the programmed speed that is wanted, 0 .. 1; reached at the limited rate.
        """
        requested = min(1.0, max(0.0, override))
        self.rate += min(self._slew, max(-self._slew, requested - self.rate))
        self.at = min(float(len(self) - 1), self.at + self.rate)

    def pose(self, at: float | None = None) -> Float:
        """(4, 4) pose at a place; None: at the present one."""
        at = self.at if at is None else min(float(len(self) - 1), max(0.0, at))
        k = int(at)
        T: Float = self._sample(k)
        if at > k:
            after = self._sample(k + 1)
            T[:3, 3] += (at - k) * (after[:3, 3] - T[:3, 3])
            T[:3, :3] = rotation.exp((at - k) * rotation.log(after[:3, :3] @ T[:3, :3].T)) @ T[:3, :3]
        return T

    def twist(self) -> Float:
        """(6,) m/s and rad/s of the tool at the present place and rate, part axes; zero at the end."""
        if self.finished:
            return np.zeros(6)
        before, after = self._sample(int(self.at)), self._sample(int(self.at) + 1)
        share = self.rate / self.period_s
        turn = rotation.log(after[:3, :3] @ before[:3, :3].T)
        out: Float = np.r_[(after[:3, 3] - before[:3, 3]) * share, turn * share]
        return out

    def _sample(self, k: int) -> Float:
        i, u = self._segment[k], self._share[k]
        p = (1.0 - u) * self._p[i] + u * self._p[i + 1]
        out: Float = pose.make(rotation.exp(u * self._turn[i]) @ self._Rs[i], p)
        return out
