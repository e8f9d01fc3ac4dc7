"""Tracker poses taken from their socket in one compiled call, system call included.

The arrays come as a table (:mod:`counterflex.core.array_table`): first those of
:meth:`counterflex.protocols.system.datagrams.Datagrams.arrays`, then those that the kernel names.
"""

from __future__ import annotations

from typing import Final

from counterflex.core.array_table import byte_matrix, matrix, reals, whole_matrix, wholes
from counterflex.core.arrays import Int
from counterflex.core.jit import kernel
from counterflex.protocols.system.system_calls import receive
from counterflex.protocols.tracker import kernel as tracker

_INBOX: Final = 5


@kernel("boolean(int64, int64[:, ::1])")
def drain_poses(fd: int, table: Int) -> bool:
    """Take every tracker datagram that is there.

    Args:
        fd: Of the socket.
        table: Inbox; allowed, numbers, pose, spare and values of
            :func:`counterflex.protocols.tracker.kernel.take_poses`.

    Returns:
        Whether a new good pose is among them.
    """
    heads, lengths, hosts = whole_matrix(table, 0), wholes(table, 2), wholes(table, 3)
    numbers, fresh = wholes(table, _INBOX + 1), False
    while True:
        count = receive(fd, heads, byte_matrix(table, 1), lengths, hosts)
        if count > 0:
            fresh |= tracker.take_poses(
                byte_matrix(table, 4),
                lengths,
                hosts,
                count,
                wholes(table, _INBOX),
                numbers,
                matrix(table, _INBOX + 2),
                matrix(table, _INBOX + 3),
                reals(table, _INBOX + 4),
            )
        if count < heads.shape[0]:
            return fresh and numbers[tracker.N_STATUS] & tracker.UNUSABLE == 0
