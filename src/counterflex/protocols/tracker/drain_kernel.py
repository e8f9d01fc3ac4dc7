"""Tracker poses taken from their socket in one compiled call, system call included.

The arrays come as a table (:mod:`counterflex.core.array_table`).
"""

from __future__ import annotations

from typing import Final

from numba import carray

from counterflex.core.array_table import addresses, byte_matrix, matrix, to_pointer, whole_matrix, wholes
from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.core.records import Record, Records
from counterflex.protocols.system.datagrams import INBOX
from counterflex.protocols.system.system_calls import receive
from counterflex.protocols.tracker import kernel as tracker

ARRAYS: Final = addresses(*INBOX, "allowed", "pose", "spare", "received")


@kernel("boolean(int64, Arrays, Received[::1], float64[:, ::1])", Arrays=ARRAYS, Received=tracker.RECEIVED)
def _take_all(fd: int, table: Record, received: Records, pose: Float) -> bool:
    """Take every datagram; whether a pose is new."""
    heads, lengths, hosts = whole_matrix(table.heads), wholes(table.lengths), wholes(table.hosts)
    fresh = False
    while True:
        count = receive(fd, heads, byte_matrix(table.names), lengths, hosts)
        if count > 0:
            fresh |= tracker.take_poses(
                byte_matrix(table.datagrams),
                lengths,
                hosts,
                count,
                wholes(table.allowed),
                pose,
                matrix(table.spare),
                received,
            )
        if count < heads.shape[0]:
            return fresh


@kernel("boolean(int64, boolean, Arrays[::1])", Arrays=ARRAYS, entry=True)
def drain_poses(fd: int, taken: bool, tables: Records) -> bool:
    """Take every tracker datagram that is there; the mean of their poses where it is asked for.

    Args:
        taken: New ones were taken one by one before; only the mean is made.
        tables: (1,) ARRAYS: inbox; allowed, pose, spare and RECEIVED of
            :func:`counterflex.protocols.tracker.kernel.take_poses`.

    Returns:
        Whether a new good pose is among them.
    """
    table = tables[0]
    received, pose = carray(to_pointer(table.received.place), (1,), tracker.RECEIVED), matrix(table.pose)
    r, fresh = received[0], taken
    if not taken:
        tracker.begin_poses(r)
        fresh = _take_all(fd, table, received, pose)
    if not fresh or r.status & tracker.UNUSABLE != 0:
        return False
    after = tracker.mean_pose(received, pose)
    r.pose_ns = r.time_ns if after < 0.0 else int(r.first_ns + after)
    return True
