"""The neutral pose datagram of trackers: 88 bytes, UDP, little-endian; ours to define, for any maker's bridge.

| offset | type | field |
|---|---|---|
| 0 | 4 bytes | ``CFP1`` |
| 4 | u32 | sequence, +1 per datagram, wraps |
| 8 | u64 | time of measurement, ns of the source's clock |
| 16 | u32 | status bits |
| 20 | u32 | frame id: which target or registration, 0 where there is one only |
| 24 | 3 f64 | position of the target in the tracker's frame, mm |
| 48 | 4 f64 | orientation, quaternion w x y z |
| 80 | f64 | standard deviation of the position, mm; 0 where not known |
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import ProtocolError
from counterflex.core.units import MM
from counterflex.geometry import rotation
from counterflex.protocols.tracker import kernel as reading

MAGIC: Final = b"CFP1"
DATAGRAM: Final = struct.Struct("<4sIQII3d4dd")
BEAM_BROKEN: Final = 1
"""Status bit: the tracker does not see the target; the pose is the last one."""
NO_ORIENTATION: Final = 2
"""Status bit: a reflector only, the quaternion means nothing."""
INACCURATE: Final = 4
"""Status bit: the tracker itself doubts the value."""
_KNOWN: Final = BEAM_BROKEN | NO_ORIENTATION | INACCURATE
FARTHEST_MM: Final = reading.FARTHEST_MM


@dataclass(frozen=True, eq=False)
class TrackerPose:
    """One measurement."""

    sequence: int  # see the table of the module
    time_ns: int  # source clock
    status: int  # bits; 0 is good
    frame_id: int  # see the table
    T_tracker_target: Float  # (4, 4) m
    sigma_m: float  # standard deviation of the position, 0 where not known

    def telegram(self) -> bytes:
        """A measurement as a datagram: the tracker's side. Raises ProtocolError: a number does not fit its field."""
        T = self.T_tracker_target
        quat = rotation.quat_wxyz(T[:3, :3])
        try:
            return DATAGRAM.pack(
                MAGIC,
                self.sequence,
                self.time_ns,
                self.status,
                self.frame_id,
                *(T[:3, 3] / MM).tolist(),
                *quat.tolist(),
                self.sigma_m / MM,
            )
        except struct.error as fault:
            raise ProtocolError("a tracker pose does not fit its datagram", value=self.sequence) from fault


def read_pose(data: bytes) -> TrackerPose:
    """Read a datagram.

    Raises:
        ProtocolError: Another length or magic, unknown status bits, a number that is not finite, a position beyond
            200 m, a quaternion that is not of unit length.
    """
    rows = np.zeros((1, DATAGRAM.size), dtype=np.uint8)
    rows[0, : min(len(data), DATAGRAM.size)] = np.frombuffer(data[: DATAGRAM.size], dtype=np.uint8)
    T, values = np.eye(4), np.zeros(8)
    outcome = reading.read_datagram(rows, 0, len(data), T, values)
    if outcome == reading.NO_DATAGRAM:
        raise ProtocolError("not a tracker datagram", value=f"{len(data)} bytes, {data[:4]!r}", limit="88 bytes, CFP1")
    _, sequence, time_ns, status, frame_id, *numbers = DATAGRAM.unpack(data)
    if outcome == reading.UNKNOWN_STATUS:
        raise ProtocolError("unknown status bits of a tracker", value=f"0x{status:x}", limit=f"0x{_KNOWN:x}")
    if outcome == reading.NOT_FINITE:
        raise ProtocolError("a tracker sent a number that is not finite", value=numbers)
    if outcome == reading.OUT_OF_RANGE:
        raise ProtocolError("a tracker's position is out of range", value=numbers, limit=f"{FARTHEST_MM:g} mm")
    if outcome == reading.NOT_UNIT:
        size = math.hypot(*numbers[3:7])
        raise ProtocolError("a tracker's quaternion is not of unit length", value=size, limit=f"1 +- {reading.UNIT:g}")
    return TrackerPose(sequence, time_ns, status, frame_id, T, float(values[7]) * MM)


def spherical_point(distance: float, azimuth: float, zenith: float) -> Float:
    """Position (3,) m from what a laser tracker measures (Mandiola2023 eq. 1).

    ``x = d sin(zenith) cos(azimuth)``, ``y = d sin(zenith) sin(azimuth)``, ``z = d cos(zenith)``.

    Args:
        distance: m.
        azimuth: Horizontal angle, rad, right-handed about the tracker's vertical axis.
        zenith: Angle from that axis, rad.
    """
    return distance * np.array(
        [math.sin(zenith) * math.cos(azimuth), math.sin(zenith) * math.sin(azimuth), math.cos(zenith)]
    )
