"""Force records taken from their socket in one compiled call, system call included.

The arrays come as a table (:mod:`counterflex.core.array_table`): first those of
:meth:`counterflex.protocols.system.datagrams.Datagrams.arrays`, then those that the kernel names.
"""

from __future__ import annotations

from typing import Final

from counterflex.core.array_table import byte_matrix, matrix, reals, whole_matrix, wholes
from counterflex.core.arrays import Int
from counterflex.core.jit import kernel
from counterflex.protocols.netft import kernel as netft
from counterflex.protocols.system.system_calls import receive

_INBOX: Final = 5
FROZEN: Final = 8
"""Samples with the same counts in a row that no living sensor sends."""


@kernel("Tuple((int64, int64, boolean, boolean))(int64, boolean, int64[:, ::1])")
def drain_records(fd: int, taken: bool, table: Int) -> tuple[int, int, bool, bool]:
    """Take every record of a Net F/T that is there.

    Args:
        fd: Of the socket.
        taken: The records were taken one by one before; only their mean is made.
        table: Inbox; scale, limit, numbers, before, total and samples of
            :func:`counterflex.protocols.netft.kernel.take_records`, then (6,) the mean of the good ones, left where
            there are none.

    Returns:
        Good records, sequence number of the first one taken last, whether one was beyond the range, whether the counts
        have not changed for a while.
    """
    numbers, total = wholes(table, _INBOX + 2), reals(table, _INBOX + 4)
    mean = reals(table, _INBOX + 6)
    if not taken:
        heads, lengths = whole_matrix(table, 0), wholes(table, 2)
        data = byte_matrix(table, 4)
        total[:] = 0.0
        numbers[netft.N_GOOD] = numbers[netft.N_SATURATED] = 0
        while True:
            count = receive(fd, heads, byte_matrix(table, 1), lengths, wholes(table, 3))
            if count > 0:
                netft.take_records(
                    data,
                    lengths,
                    count,
                    reals(table, _INBOX),
                    reals(table, _INBOX + 1),
                    numbers,
                    wholes(table, _INBOX + 3),
                    total,
                    matrix(table, _INBOX + 5),
                )
            if count < heads.shape[0]:
                break
    good = numbers[netft.N_GOOD]
    if good > 0:
        for k in range(6):
            mean[k] = total[k] / good
    return good, numbers[netft.N_FIRST], numbers[netft.N_SATURATED] != 0, numbers[netft.N_SAME] >= FROZEN - 1
