"""Messages with the fields of WrenchStamped and PoseStamped (geometry_msgs) as datagrams of the loop. No ROS here."""

from __future__ import annotations

import abc
import math
import struct
from typing import Any

WRENCH, POSE = struct.Struct("<4sIQII6d"), struct.Struct("<4sIQII3d4dd")
SATURATED, INVALID = 1, 2
BEAM_BROKEN, NO_ORIENTATION = 1, 2
MM = 1e-3
FROM_UNIT = 1e-3
"""By which the length of a quaternion may differ from 1: messages hold numbers that were rounded."""
NS_PER_S = 1_000_000_000


class Converter(abc.ABC):
    """Numbers the datagrams of one topic.

    Args:
        source: Id in the datagrams, 0 .. 2^32 - 1: source of wrenches, frame of poses.
        frame: ``frame_id`` that a message must have; empty: any.

    Attributes:
        sent: Datagrams made.
        left_out: Messages of another frame, and poses that are none before the first good one.

    Raises:
        ValueError: ``source`` is out of range.
    """

    def __init__(self, source: int = 0, frame: str = "") -> None:
        if not 0 <= source < 2**32:
            raise ValueError(f"source id {source} is not within 0 .. {2**32 - 1}")
        self._source, self._frame = source, frame
        self.sent = self.left_out = 0

    def datagram(self, message: Any, arrived_ns: int) -> bytes | None:
        """The datagram of a message, or None where it is left out.

        Args:
            message: With ``header.stamp.sec``, ``.nanosec``, ``header.frame_id``, the fields of its kind.
            arrived_ns: Time of arrival, used where the message has no stamp.
        """
        header = message.header
        values = None if self._frame and header.frame_id != self._frame else self._values(message)
        if values is None:
            self.left_out += 1
            return None
        form, magic, status, numbers = values
        time_ns = int(header.stamp.sec) * NS_PER_S + int(header.stamp.nanosec)
        if not 0 < time_ns < 2**64:
            time_ns = arrived_ns
        self.sent += 1
        return form.pack(magic, self.sent & 0xFFFFFFFF, time_ns, status, self._source, *numbers)

    @abc.abstractmethod
    def _values(self, message: Any) -> tuple[struct.Struct, bytes, int, list[float]] | None:
        """Form, magic, status and numbers of the datagram; None of a message that says nothing."""


class Wrenches(Converter):
    """Messages of WrenchStamped: ``wrench.force``, ``wrench.torque``, N and N m.

    Args:
        range_n: Beyond this force (N) on an axis a datagram says that the sensor is saturated; 0: not watched.
        range_nm: Beyond this moment (N m), likewise.

    Raises:
        ValueError: A range or ``source`` is out of range.
    """

    def __init__(self, source: int = 0, frame: str = "", range_n: float = 0.0, range_nm: float = 0.0) -> None:
        super().__init__(source, frame)
        if not (0.0 <= range_n < math.inf and 0.0 <= range_nm < math.inf):
            raise ValueError(f"range {range_n} N, {range_nm} N m is negative or not finite")
        self._limits = [range_n or math.inf] * 3 + [range_nm or math.inf] * 3

    def _values(self, message: Any) -> tuple[struct.Struct, bytes, int, list[float]]:
        force, torque = message.wrench.force, message.wrench.torque
        w = [float(v) for v in (force.x, force.y, force.z, torque.x, torque.y, torque.z)]
        status = 0
        if not all(math.isfinite(v) for v in w):
            status |= INVALID
        elif any(abs(v) >= limit for v, limit in zip(w, self._limits, strict=True)):
            status |= SATURATED
        return WRENCH, b"CFW1", status, w


class Poses(Converter):
    """Messages of PoseStamped: ``pose.position``, m, of a target in the tracker's frame, and ``pose.orientation``.

    A pose that is none (a number that is not finite, a quaternion of another length than 1) repeats the last good one
    with the status *beam broken*: the loop sees the gap at once. A quaternion of zeros is a target without orientation.

    Args:
        sigma_mm: Standard deviation of the position; 0: not known.

    Raises:
        ValueError: ``sigma_mm`` or ``source`` is out of range.
    """

    def __init__(self, source: int = 0, frame: str = "", sigma_mm: float = 0.0) -> None:
        super().__init__(source, frame)
        if not 0.0 <= sigma_mm < math.inf:
            raise ValueError(f"standard deviation {sigma_mm} mm is negative or not finite")
        self._sigma_mm = sigma_mm
        self._last: list[float] | None = None

    def _values(self, message: Any) -> tuple[struct.Struct, bytes, int, list[float]] | None:
        position, turn = message.pose.position, message.pose.orientation
        p_mm = [float(v) / MM for v in (position.x, position.y, position.z)]
        quaternion = [float(v) for v in (turn.w, turn.x, turn.y, turn.z)]
        status = 0
        if quaternion == [0.0] * 4:
            quaternion, status = [1.0, 0.0, 0.0, 0.0], NO_ORIENTATION
        length = math.hypot(*quaternion)
        if not all(map(math.isfinite, p_mm)) or not abs(length - 1.0) <= FROM_UNIT:
            if self._last is None:
                return None
            status, numbers = BEAM_BROKEN, self._last
        else:
            numbers = self._last = [*p_mm, *(v / length for v in quaternion), self._sigma_mm]
        return POSE, b"CFP1", status, numbers


def address(text: str) -> tuple[str, int]:
    """Host and port of ``HOST:PORT``.

    Raises:
        ValueError: It is not that.
    """
    host, _, port = text.rpartition(":")
    if not host or not port.isdigit() or not 0 < int(port) < 65536:
        raise ValueError(f"'{text}' is not HOST:PORT, for example 127.0.0.1:49300")
    return host, int(port)
