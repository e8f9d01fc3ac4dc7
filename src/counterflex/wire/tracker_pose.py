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
from counterflex.geometry import pose, rotation

MAGIC: Final = b"CFP1"
DATAGRAM: Final = struct.Struct("<4sIQII3d4dd")
BEAM_BROKEN: Final = 1
"""Status bit: the tracker does not see the target; the pose is the last one."""
NO_ORIENTATION: Final = 2
"""Status bit: a reflector only, the quaternion means nothing."""
INACCURATE: Final = 4
"""Status bit: the tracker itself doubts the value."""
_KNOWN: Final = BEAM_BROKEN | NO_ORIENTATION | INACCURATE
FARTHEST_MM: Final = 200_000.0
_UNIT: Final = 1e-6


@dataclass(frozen=True, eq=False)
class TrackerPose:
    """One measurement.

    Attributes:
        sequence: See the table of the module.
        time_ns: Source clock.
        status: Bits; 0 is good.
        frame_id: See the table.
        T_tracker_target: (4, 4) m.
        sigma_m: Standard deviation of the position, 0 where not known.
    """

    sequence: int
    time_ns: int
    status: int
    frame_id: int
    T_tracker_target: Float
    sigma_m: float


def read_pose(data: bytes) -> TrackerPose:
    """Read a datagram.

    Raises:
        ProtocolError: Another length or magic, unknown status bits, a number that is not finite, a position beyond
            200 m, a quaternion that is not of unit length.
    """
    if len(data) != DATAGRAM.size:
        raise ProtocolError("not a tracker datagram", value=f"{len(data)} bytes", limit=f"{DATAGRAM.size} bytes")
    magic, sequence, time_ns, status, frame_id, *numbers = DATAGRAM.unpack(data)
    if magic != MAGIC:
        raise ProtocolError("not a tracker datagram", value=repr(magic), limit=repr(MAGIC))
    if status & ~_KNOWN:
        raise ProtocolError("unknown status bits of a tracker", value=f"0x{status:x}", limit=f"0x{_KNOWN:x}")
    if not all(map(math.isfinite, numbers)):
        raise ProtocolError("a tracker sent a number that is not finite", value=numbers)
    p, quat, sigma = np.array(numbers[:3]), np.array(numbers[3:7]), float(numbers[7])
    if float(np.max(np.abs(p))) > FARTHEST_MM or sigma < 0.0:
        raise ProtocolError(
            "a tracker's position is out of range", value=[*p.tolist(), sigma], limit=f"{FARTHEST_MM:g} mm"
        )
    R = np.eye(3)
    if not status & NO_ORIENTATION:
        size = float(np.linalg.norm(quat))
        if abs(size - 1.0) > _UNIT:
            raise ProtocolError("a tracker's quaternion is not of unit length", value=size, limit=f"1 +- {_UNIT:g}")
        R = rotation.from_quat_wxyz(quat / size)
    return TrackerPose(sequence, time_ns, status, frame_id, pose.make(R, p * MM), sigma * MM)


def write_pose(measured: TrackerPose) -> bytes:
    """A measurement as a datagram: the tracker's side.

    Raises:
        ProtocolError: A number does not fit its field.
    """
    T = measured.T_tracker_target
    quat = rotation.quat_wxyz(T[:3, :3])
    try:
        return DATAGRAM.pack(
            MAGIC,
            measured.sequence,
            measured.time_ns,
            measured.status,
            measured.frame_id,
            *(T[:3, 3] / MM).tolist(),
            *quat.tolist(),
            measured.sigma_m / MM,
        )
    except struct.error as fault:
        raise ProtocolError("a tracker pose does not fit its datagram", value=measured.sequence) from fault


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
