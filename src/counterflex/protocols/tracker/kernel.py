"""Tracker datagrams read and taken in one after the other, compiled; the rules are those of the module tracker_pose."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.jit import kernel
from counterflex.core.records import Record, Records, record
from counterflex.protocols.decimal_kernel import ByteRows
from counterflex.protocols.sequence_kernel import ORDER, steps_on

OK: Final = 0
NO_DATAGRAM: Final = 1
UNKNOWN_STATUS: Final = 2
NOT_FINITE: Final = 3
OUT_OF_RANGE: Final = 4
NOT_UNIT: Final = 5

SIZE: Final = 88
_MAGIC: Final = 0x31504643  # CFP1, little-endian
_BROKEN, _NO_ORIENTATION, _INACCURATE = 1, 2, 4
UNUSABLE: Final = _BROKEN | _INACCURATE
"""Bits of the status with which a pose is not used."""
FARTHEST_MM: Final = 200_000.0
UNIT: Final = 1e-6

RECEIVED: Final = record(
    order=ORDER,  # of the numbers of the datagrams
    status=int,
    time_ns=int,  # clock of the source, of the pose
    lost=int,  # in all, as the next two
    malformed=int,
    foreign=int,
    host=int,  # who is listened to; -1: whoever comes first
    values=(float, 8),  # of the newest good datagram: position mm, quaternion, standard deviation mm
    read=(float, 8),  # of the last one read
    # Of the good poses since these were set to zero.
    poses=(float, (4, 4)),  # sum
    count=float,
    first_ns=float,  # time of the first
    later_ns=float,  # sum of their times after the first
    most=float,  # poses of which a mean is taken at most; up to 1: none is
    pose_ns=int,  # time of the newest pose, or mean time
)
"""What is known of a stream of datagrams."""


@kernel("int64(uint8[:, ::1], int64, int64, int64)")
def _number(data: ByteRows, row: int, at: int, size: int) -> int:
    value = np.int64(0)
    for k in range(size):
        value |= np.int64(data[row, at + k]) << (8 * k)
    return int(value)


@kernel("int64(uint8[:, ::1], int64, int64, float64[:, ::1], float64[::1])", entry=True)
def read_datagram(data: ByteRows, row: int, length: int, T: Float, values: Float) -> int:
    """Read one datagram.

    Args:
        data: (n, size) one datagram in a row.
        row: Which.
        T: (4, >= 4) written where the result is OK: pose in m; its rotation is the identity where there is none.
        values: (8,) written: position mm, quaternion, standard deviation mm.

    Returns:
        OK, or what is wrong; the constants of this module.
    """
    if length != SIZE or _number(data, row, 0, 4) != _MAGIC:
        return NO_DATAGRAM
    status = _number(data, row, 16, 4)
    if status & ~(_BROKEN | _NO_ORIENTATION | _INACCURATE):
        return UNKNOWN_STATUS
    numbers = data[row, 24:SIZE].view(np.float64)
    for k in range(8):
        values[k] = numbers[k]
        if not math.isfinite(values[k]):
            return NOT_FINITE
    if max(abs(values[0]), abs(values[1]), abs(values[2])) > FARTHEST_MM or values[7] < 0.0:
        return OUT_OF_RANGE
    w, x, y, z = values[3], values[4], values[5], values[6]
    if status & _NO_ORIENTATION:
        w, x, y, z = 1.0, 0.0, 0.0, 0.0
    else:
        size = math.sqrt(w * w + x * x + y * y + z * z)
        if not abs(size - 1.0) <= UNIT:
            return NOT_UNIT
        w, x, y, z = w / size, x / size, y / size, z / size
    T[0, 0], T[0, 1], T[0, 2] = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)
    T[1, 0], T[1, 1], T[1, 2] = 2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)
    T[2, 0], T[2, 1], T[2, 2] = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)
    for k in range(3):
        T[k, 3] = values[k] * 1e-3
        T[3, k] = 0.0
    T[3, 3] = 1.0
    return OK


@kernel(
    "boolean(uint8[:, ::1], int64[::1], int64[::1], int64, int64[::1], float64[:, ::1], float64[:, ::1],"
    " Received[::1])",
    Received=RECEIVED,
    entry=True,
)
def take_poses(
    data: ByteRows, lengths: Int, hosts: Int, count: int, allowed: Int, T: Float, spare: Float, received: Records
) -> bool:
    """Take datagrams in their order.

    Args:
        data: (n, size) one datagram in a row.
        lengths: (n,) bytes of each.
        hosts: (n,) who sent each.
        count: How many there are.
        allowed: (m,) senders that are listened to; empty: the first that comes.
        T: (4, 4) newest good pose, m; changed.
        spare: (4, 4) work space.
        received: (1,) RECEIVED; changed, the sums too, see :func:`mean_pose`.

    Returns:
        Whether :data:`T` is new.
    """
    r, fresh = received[0], False
    for row in range(count):
        known = len(allowed) == 0 and (r.host < 0 or r.host == hosts[row])
        for host in allowed:
            known |= host == hosts[row]
        if not known:
            r.foreign += 1
            continue
        if read_datagram(data, row, lengths[row], spare, r.read[:]) != OK:
            r.malformed += 1
            continue
        if len(allowed) == 0:
            r.host = hosts[row]
        step = steps_on(r.order, _number(data, row, 4, 4), 0xFFFFFFFF)
        if step == 0:
            continue
        r.lost += step - 1
        r.status = _number(data, row, 16, 4)
        if r.status & UNUSABLE:
            continue
        r.time_ns = _number(data, row, 8, 8)
        for i in range(4):
            for j in range(4):
                T[i, j] = spare[i, j]
                r.poses[i, j] += spare[i, j]
        for k in range(8):
            r.values[k] = r.read[k]
        if r.count == 0.0:
            r.first_ns = float(r.time_ns)
        r.count += 1.0
        r.later_ns += float(r.time_ns) - r.first_ns
        fresh = True
    return fresh


@kernel("void(float64[:, ::1], float64[:, ::1], float64[:, ::1], float64[::1], int64)", entry=True)
def tool_pose(T_part_tracker: Float, T_tracker_target: Float, T_target_tcp: Float, out: Float, at: int) -> None:
    """Pose of the tool in the part frame, ``T_part_tracker T_tracker_target T_target_tcp``.

    Args:
        T_part_tracker: (4, 4) tracker in the part frame.
        T_tracker_target: (4, 4) what was measured.
        T_target_tcp: (4, 4) tool tip in the target.
        out: Written from ``at`` on: nine numbers of the rotation by rows, three of the position, m.
    """
    A, B, C = T_part_tracker, T_tracker_target, T_target_tcp
    for i in range(3):
        a0, a1, a2 = A[i, 0], A[i, 1], A[i, 2]
        r0 = a0 * B[0, 0] + a1 * B[1, 0] + a2 * B[2, 0]
        r1 = a0 * B[0, 1] + a1 * B[1, 1] + a2 * B[2, 1]
        r2 = a0 * B[0, 2] + a1 * B[1, 2] + a2 * B[2, 2]
        p = a0 * B[0, 3] + a1 * B[1, 3] + a2 * B[2, 3] + A[i, 3]
        for j in range(3):
            out[at + 3 * i + j] = r0 * C[0, j] + r1 * C[1, j] + r2 * C[2, j]
        out[at + 9 + i] = r0 * C[0, 3] + r1 * C[1, 3] + r2 * C[2, 3] + p


@kernel("void(Received)", Received=RECEIVED)
def begin_poses(r: Record) -> None:
    """Forget the poses of the drain before."""
    r.poses[:] = 0.0
    r.count = r.first_ns = r.later_ns = 0.0


@kernel("float64(Received[::1], float64[:, ::1])", Received=RECEIVED)
def mean_pose(received: Records, T: Float) -> float:
    """Mean of the poses that :func:`take_poses` has summed up since its sums were set to zero.

    The mean of rotations a few degrees apart: columns of the mean matrix, made square to each other again.

    Args:
        received: (1,) RECEIVED of :func:`take_poses`. With more poses than ``most``, or one, ``T`` is left as it is:
            they have piled up, and the newest counts.
        T: (4, 4) newest good pose; written.

    Returns:
        Mean time of the poses after the first of them, ns; below 0 where ``T`` was left.
    """
    r = received[0]
    count, total = r.count, r.poses
    if count < 2.0 or count > r.most:
        return -1.0
    for k in range(3):
        T[k, 3] = total[k, 3] / count
    size = 0.0
    for k in range(3):
        size += total[k, 0] ** 2
    size = math.sqrt(size)
    along = 0.0
    for k in range(3):
        T[k, 0] = total[k, 0] / size
        along += T[k, 0] * total[k, 1]
    size = 0.0
    for k in range(3):
        T[k, 1] = total[k, 1] - along * T[k, 0]
        size += T[k, 1] ** 2
    size = math.sqrt(size)
    for k in range(3):
        T[k, 1] /= size
    T[0, 2] = T[1, 0] * T[2, 1] - T[2, 0] * T[1, 1]
    T[1, 2] = T[2, 0] * T[0, 1] - T[0, 0] * T[2, 1]
    T[2, 2] = T[0, 0] * T[1, 1] - T[1, 0] * T[0, 1]
    return float(r.later_ns / count)
