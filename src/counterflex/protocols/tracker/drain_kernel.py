"""Tracker poses taken from their socket in one compiled call, system call included.

The arrays come as a table (:mod:`counterflex.core.array_table`): first those of
:meth:`counterflex.protocols.system.datagrams.Datagrams.arrays`, then those that the kernel names.
"""

from __future__ import annotations

from typing import Final

from numba import carray

from counterflex.core.array_table import byte_matrix, matrix, to_pointer, whole_matrix, wholes
from counterflex.core.arrays import Int
from counterflex.core.jit import kernel
from counterflex.core.records import Records
from counterflex.protocols.system.system_calls import receive
from counterflex.protocols.tracker import kernel as tracker

_INBOX: Final = 5


@kernel("Received[::1](int64[:, ::1])", Received=tracker.RECEIVED)
def _received(table: Int) -> Records:
    out: Records = carray(to_pointer(table[_INBOX + 3, 0]), (1,), tracker.RECEIVED)
    return out


@kernel("boolean(int64, int64[:, ::1])")
def drain_poses(fd: int, table: Int) -> bool:
    """Take every tracker datagram that is there.

    Args:
        fd: Of the socket.
        table: Inbox; allowed, pose, spare and RECEIVED of :func:`counterflex.protocols.tracker.kernel.take_poses`.

    Returns:
        Whether a new good pose is among them.
    """
    heads, lengths, hosts = whole_matrix(table, 0), wholes(table, 2), wholes(table, 3)
    received, fresh = _received(table), False
    while True:
        count = receive(fd, heads, byte_matrix(table, 1), lengths, hosts)
        if count > 0:
            fresh |= tracker.take_poses(
                byte_matrix(table, 4),
                lengths,
                hosts,
                count,
                wholes(table, _INBOX),
                matrix(table, _INBOX + 1),
                matrix(table, _INBOX + 2),
                received,
            )
        if count < heads.shape[0]:
            return fresh and received[0].status & tracker.UNUSABLE == 0
