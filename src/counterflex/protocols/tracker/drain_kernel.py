"""Tracker poses taken from their socket in one compiled call, system call included.

The arrays come as a table (:mod:`counterflex.core.array_table`).
"""

from __future__ import annotations

from typing import Final

from numba import carray

from counterflex.core.array_table import addresses, byte_matrix, matrix, to_pointer, whole_matrix, wholes
from counterflex.core.jit import kernel
from counterflex.core.records import Records
from counterflex.protocols.system.datagrams import INBOX
from counterflex.protocols.system.system_calls import receive
from counterflex.protocols.tracker import kernel as tracker

ARRAYS: Final = addresses(*INBOX, "allowed", "pose", "spare", "received")


@kernel("boolean(int64, Arrays[::1])", Arrays=ARRAYS, entry=True)
def drain_poses(fd: int, tables: Records) -> bool:
    """Take every tracker datagram that is there.

    Args:
        tables: (1,) ARRAYS: inbox; allowed, pose, spare and RECEIVED of
            :func:`counterflex.protocols.tracker.kernel.take_poses`.

    Returns:
        Whether a new good pose is among them.
    """
    table = tables[0]
    heads, lengths, hosts = whole_matrix(table.heads), wholes(table.lengths), wholes(table.hosts)
    received, fresh = carray(to_pointer(table.received.place), (1,), tracker.RECEIVED), False
    while True:
        count = receive(fd, heads, byte_matrix(table.names), lengths, hosts)
        if count > 0:
            fresh |= tracker.take_poses(
                byte_matrix(table.datagrams),
                lengths,
                hosts,
                count,
                wholes(table.allowed),
                matrix(table.pose),
                matrix(table.spare),
                received,
            )
        if count < heads.shape[0]:
            return fresh and received[0].status & tracker.UNUSABLE == 0
