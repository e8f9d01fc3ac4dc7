"""A message with the fields of geometry_msgs/WrenchStamped as a generic wrench datagram. No ROS here."""

from __future__ import annotations

import math
import struct
from typing import Any

DATAGRAM = struct.Struct("<4sIQII6d")
MAGIC = b"CFW1"
SATURATED, INVALID = 1, 2
NS_PER_S = 1_000_000_000


class Converter:
    """Numbers the datagrams of one topic.

    Args:
        source: Source id of the datagrams, 0 .. 2^32 - 1.
        frame: ``frame_id`` that a message must have; empty: any.
        range_n: Beyond this force (N) on an axis a datagram says that the sensor is saturated; 0: not watched.
        range_nm: Beyond this moment (N m), likewise.

    Attributes:
        sent: Datagrams made.
        left_out: Messages of another frame.

    Raises:
        ValueError: ``source`` or a range is out of range.
    """

    def __init__(self, source: int = 0, frame: str = "", range_n: float = 0.0, range_nm: float = 0.0) -> None:
        if not 0 <= source < 2**32:
            raise ValueError(f"source id {source} is not within 0 .. {2**32 - 1}")
        if not (0.0 <= range_n < math.inf and 0.0 <= range_nm < math.inf):
            raise ValueError(f"range {range_n} N, {range_nm} N m is negative or not finite")
        self._source, self._frame = source, frame
        self._limits = [range_n or math.inf] * 3 + [range_nm or math.inf] * 3
        self.sent = self.left_out = 0

    def datagram(self, message: Any, arrived_ns: int) -> bytes | None:
        """The datagram of a message, or None where it is of another frame.

        Args:
            message: With ``header.stamp.sec``, ``header.stamp.nanosec``, ``header.frame_id``, ``wrench.force`` and
                ``wrench.torque`` (x, y, z; N and N m).
            arrived_ns: Time of arrival, used where the message has no stamp.
        """
        header = message.header
        if self._frame and header.frame_id != self._frame:
            self.left_out += 1
            return None
        time_ns = int(header.stamp.sec) * NS_PER_S + int(header.stamp.nanosec)
        if not 0 < time_ns < 2**64:
            time_ns = arrived_ns
        force, torque = message.wrench.force, message.wrench.torque
        w = [float(v) for v in (force.x, force.y, force.z, torque.x, torque.y, torque.z)]
        status = 0
        if not all(math.isfinite(v) for v in w):
            status |= INVALID
        elif any(abs(v) >= limit for v, limit in zip(w, self._limits, strict=True)):
            status |= SATURATED
        self.sent += 1
        return DATAGRAM.pack(MAGIC, self.sent & 0xFFFFFFFF, time_ns, status, self._source, *w)


def address(text: str) -> tuple[str, int]:
    """Host and port of ``HOST:PORT``.

    Raises:
        ValueError: It is not that.
    """
    host, _, port = text.rpartition(":")
    if not host or not port.isdigit() or not 0 < int(port) < 65536:
        raise ValueError(f"'{text}' is not HOST:PORT, for example 127.0.0.1:49300")
    return host, int(port)
