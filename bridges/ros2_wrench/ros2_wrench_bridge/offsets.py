"""Corrections of a counterflex loop as poses and twists, with the rules when nothing may be published. No ROS here."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

NS_PER_S = 1_000_000_000
_UNIT = 1e-6
"""A quaternion may miss unit length by that; longer ones are refused, not repaired."""


@dataclass(frozen=True)
class Shot:
    """What is taken from one snapshot of the loop.

    Attributes:
        number: Of the snapshot, rising; a new run begins at 1.
        time_ns: Monotonic clock of the computer that the loop runs on.
        correction: Sent: m and rotation vector rad, part axes, about the tool tip.
        trouble: The loop's own program failed.
    """

    number: int
    time_ns: int
    correction: tuple[float, ...]
    trouble: bool = False


@dataclass(frozen=True)
class Offset:
    """What is to be published.

    Attributes:
        age_ns: Of the snapshot.
        position_m: (3,) total offset of the commanded tool tip from the programmed one, axes of the published frame.
        orientation_xyzw: (4,) total offset of the orientation: turned = offset * programmed, in the same axes.
        velocity_m_s: (3,) change of the offset, m/s; None for the first one and behind a gap.
        turn_rad_s: (3,) likewise, rad/s.
    """

    age_ns: int
    position_m: tuple[float, float, float]
    orientation_xyzw: tuple[float, float, float, float]
    velocity_m_s: tuple[float, float, float] | None = None
    turn_rad_s: tuple[float, float, float] | None = None


class Offsets:
    """Decides for each snapshot whether it is published, and as what.

    Args:
        orientation_xyzw: Orientation of the part frame in the published one: vectors are turned by it.
        max_age_s: Older snapshots are not published.
        max_gap_s: No twist is computed over a longer time between two snapshots.

    Attributes:
        published: Offsets given.
        stale: Snapshots that were too old.
        refused: Snapshots with trouble, with numbers that are not finite, or from the future.

    Raises:
        ValueError: A parameter is out of range.
    """

    def __init__(
        self,
        orientation_xyzw: Sequence[float] = (0.0, 0.0, 0.0, 1.0),
        max_age_s: float = 0.1,
        max_gap_s: float = 0.1,
    ) -> None:
        q = tuple(float(v) for v in orientation_xyzw)
        if len(q) != 4 or not abs(math.sqrt(sum(v * v for v in q)) - 1.0) <= _UNIT:
            raise ValueError(f"orientation {list(q)} is not a quaternion x, y, z, w of length 1")
        for name, value in (("max_age_s", max_age_s), ("max_gap_s", max_gap_s)):
            if not 0.0 < value <= 10.0:
                raise ValueError(f"{name} {value} s is not within 0 .. 10 s")
        self._q = q
        self._age_ns, self._gap_ns = max_age_s * NS_PER_S, max_gap_s * NS_PER_S
        self._last: Shot | None = None
        self.published = self.stale = self.refused = 0

    def take(self, shot: Shot | None, now_ns: int) -> Offset | None:
        """The offset of a snapshot, or None where nothing may be published.

        Nothing is published without a loop (None), twice for the same snapshot, of one that is older than
        ``max_age_s``, or with trouble: who listens sees that messages stop, and never an old value with a new stamp.

        Args:
            shot: The newest snapshot of a loop that lives, or None.
            now_ns: Monotonic clock.
        """
        if shot is None:
            self._last = None
            return None
        last = self._last
        if last is not None and shot.number == last.number:
            return None
        age = now_ns - shot.time_ns
        if shot.trouble or age < 0 or len(shot.correction) != 6 or not all(map(math.isfinite, shot.correction)):
            self.refused += 1
            self._last = None
            return None
        if age > self._age_ns:
            self.stale += 1
            self._last = None
            return None
        self._last = shot
        self.published += 1
        velocity = turn = None
        if last is not None and shot.number > last.number and 0 < shot.time_ns - last.time_ns <= self._gap_ns:
            velocity, turn = self._rate(last, shot)
        return Offset(
            age, self._turned(shot.correction[:3]), quaternion(self._turned(shot.correction[3:])), velocity, turn
        )

    def _rate(self, last: Shot, shot: Shot) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        """Change from one offset to the next; that of the orientation by the rotation between both."""
        span_s = (shot.time_ns - last.time_ns) / NS_PER_S
        step = [(b - a) / span_s for a, b in zip(last.correction[:3], shot.correction[:3], strict=True)]
        between = product(quaternion(shot.correction[3:]), conjugate(quaternion(last.correction[3:])))
        turn = [v / span_s for v in rotation_vector(between)]
        return self._turned(step), self._turned(turn)

    def _turned(self, v: Sequence[float]) -> tuple[float, float, float]:
        x, y, z, _ = product(product(self._q, (v[0], v[1], v[2], 0.0)), conjugate(self._q))
        return x, y, z


Quaternion = tuple[float, float, float, float]


def quaternion(rotvec: Sequence[float]) -> Quaternion:
    """x, y, z, w of a rotation vector, rad; w >= 0 up to half a turn."""
    angle = math.sqrt(sum(v * v for v in rotvec))
    share = 0.5 - angle * angle / 48.0 if angle < 1e-4 else math.sin(0.5 * angle) / angle
    return rotvec[0] * share, rotvec[1] * share, rotvec[2] * share, math.cos(0.5 * angle)


def rotation_vector(q: Sequence[float]) -> tuple[float, float, float]:
    """Rotation vector of a quaternion x, y, z, w: the shorter way, rad."""
    sign = 1.0 if q[3] >= 0.0 else -1.0
    size = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2])
    share = sign * (2.0 if size < 1e-12 else 2.0 * math.atan2(size, abs(q[3])) / size)
    return q[0] * share, q[1] * share, q[2] * share


def product(a: Sequence[float], b: Sequence[float]) -> Quaternion:
    """Quaternion a b: first b, then a."""
    return (
        a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1],
        a[3] * b[1] - a[0] * b[2] + a[1] * b[3] + a[2] * b[0],
        a[3] * b[2] + a[0] * b[1] - a[1] * b[0] + a[2] * b[3],
        a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2],
    )


def conjugate(q: Sequence[float]) -> Quaternion:
    """The other way round."""
    return -q[0], -q[1], -q[2], q[3]


def fill_header(header: Any, frame: str, stamp_ns: int) -> None:
    """Fill a std_msgs/Header, or an object with its fields; ``stamp_ns`` of the ROS clock."""
    header.frame_id = frame
    header.stamp.sec, header.stamp.nanosec = divmod(stamp_ns, NS_PER_S)


def fill_pose(message: Any, offset: Offset, frame: str, now_ns: int) -> Any:
    """Fill a geometry_msgs/PoseStamped.

    Args:
        message: Empty.
        offset: To be said.
        frame: Name of the frame whose axes it is given in.
        now_ns: ROS clock; the stamp is that of the snapshot.
    """
    fill_header(message.header, frame, now_ns - offset.age_ns)
    place, turn = message.pose.position, message.pose.orientation
    place.x, place.y, place.z = offset.position_m
    turn.x, turn.y, turn.z, turn.w = offset.orientation_xyzw
    return message


def fill_twist(message: Any, offset: Offset, frame: str, now_ns: int) -> Any | None:
    """Fill a geometry_msgs/TwistStamped; None where the change is not known, see :func:`fill_pose`."""
    if offset.velocity_m_s is None or offset.turn_rad_s is None:
        return None
    fill_header(message.header, frame, now_ns - offset.age_ns)
    linear, angular = message.twist.linear, message.twist.angular
    linear.x, linear.y, linear.z = offset.velocity_m_s
    angular.x, angular.y, angular.z = offset.turn_rad_s
    return message


def shot_of(run: Any) -> Shot | None:
    """The newest snapshot of a watched run.

    Args:
        run: With ``seen`` (an enumeration with the value ``"running"``) and ``last`` (fields of a snapshot):
            :class:`counterflex.app.opcua.server.ObservedRun`, polled before.

    Returns:
        None where no loop lives or nothing was seen yet.
    """
    last = run.last
    if last is None or run.seen.value != "running":
        return None
    correction = tuple(float(v) for v in last.correction)
    return Shot(int(last.number), int(last.time_ns), correction, bool(last.trouble))
