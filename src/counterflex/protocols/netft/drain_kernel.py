"""Force records taken from their socket in one compiled call, system call included.

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
from counterflex.protocols.netft.kernel import RECEIVED, take_records
from counterflex.protocols.system.system_calls import receive

_INBOX: Final = 5
FROZEN: Final = 8
"""Samples with the same counts in a row that no living sensor sends."""


@kernel("Received[::1](int64[:, ::1])", Received=RECEIVED)
def _received(table: Int) -> Records:
    out: Records = carray(to_pointer(table[_INBOX + 1, 0]), (1,), RECEIVED)
    return out


@kernel("Tuple((int64, int64, boolean, boolean))(int64, boolean, int64[:, ::1])")
def drain_records(fd: int, taken: bool, table: Int) -> tuple[int, int, bool, bool]:
    """Take every record of a Net F/T that is there.

    Args:
        fd: Of the socket.
        taken: The records were taken one by one before; only their mean is made.
        table: Inbox; samples and RECEIVED of :func:`counterflex.protocols.netft.kernel.take_records`.

    Returns:
        Good records, sequence number of the first one taken last, whether one was beyond the range, whether the counts
        have not changed for a while.
    """
    received = _received(table)
    r = received[0]
    if not taken:
        heads, lengths = whole_matrix(table, 0), wholes(table, 2)
        data = byte_matrix(table, 4)
        r.total[:] = 0.0
        r.good = r.saturated = 0
        while True:
            count = receive(fd, heads, byte_matrix(table, 1), lengths, wholes(table, 3))
            if count > 0:
                take_records(data, lengths, count, matrix(table, _INBOX), received)
            if count < heads.shape[0]:
                break
    if r.good > 0:
        for k in range(6):
            r.wrench[k] = r.total[k] / r.good
    return r.good, r.first, r.saturated != 0, r.same >= FROZEN - 1
