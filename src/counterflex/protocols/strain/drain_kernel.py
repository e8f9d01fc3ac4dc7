"""Strain datagrams taken from their socket in one compiled call, system call included.

The arrays come as a table (:mod:`counterflex.core.array_table`).
"""

from __future__ import annotations

from typing import Final

from numba import carray

from counterflex.core.array_table import addresses, byte_matrix, matrix, reals, to_pointer, whole_matrix, wholes
from counterflex.core.jit import kernel
from counterflex.core.records import Records
from counterflex.protocols.strain.kernel import RECEIVED, take_strains
from counterflex.protocols.system.datagrams import INBOX
from counterflex.protocols.system.system_calls import receive

ARRAYS: Final = addresses(*INBOX, "allowed", "samples", "warm", "times", "received")


@kernel("int64(int64, Arrays[::1])", Arrays=ARRAYS, entry=True)
def drain_strains(fd: int, tables: Records) -> int:
    """Take every strain datagram that is there.

    Args:
        tables: (1,) ARRAYS: inbox; allowed, samples, warm, times and RECEIVED of
            :func:`counterflex.protocols.strain.kernel.take_strains`.

    Returns:
        Datagrams taken.
    """
    table = tables[0]
    heads, lengths, hosts = whole_matrix(table.heads), wholes(table.lengths), wholes(table.hosts)
    received = carray(to_pointer(table.received.place), (1,), RECEIVED)
    received[0].good = 0
    while True:
        count = receive(fd, heads, byte_matrix(table.names), lengths, hosts)
        if count > 0:
            take_strains(
                byte_matrix(table.datagrams),
                lengths,
                hosts,
                count,
                wholes(table.allowed),
                matrix(table.samples),
                reals(table.warm),
                wholes(table.times),
                received,
            )
        if count < heads.shape[0]:
            return int(received[0].good)
