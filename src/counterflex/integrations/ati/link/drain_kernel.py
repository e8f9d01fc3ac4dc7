"""Force records taken from their socket in one compiled call, system call included.

The arrays come as a table (:mod:`counterflex.core.array_table`).
"""

from __future__ import annotations

from typing import Final

from numba import carray

from counterflex.core.array_table import addresses, byte_matrix, matrix, to_pointer, whole_matrix, wholes
from counterflex.core.jit import kernel
from counterflex.core.records import Records
from counterflex.integrations.ati.link.kernel import RECEIVED, take_records
from counterflex.protocols.robot.compiled_link import DRAIN, DRAINED
from counterflex.protocols.system.datagrams import INBOX
from counterflex.protocols.system.system_calls import receive

ARRAYS: Final = addresses(*INBOX, "samples", "received")
FROZEN: Final = 8
"""Samples with the same counts in a row that no living sensor sends."""


@kernel("Tuple((int64, int64, boolean, boolean))(int64, boolean, Arrays[::1])", Arrays=ARRAYS, entry=True)
def drain_records(fd: int, taken: bool, tables: Records) -> tuple[int, int, bool, bool]:
    """Take every record of a Net F/T that is there.

    Args:
        taken: The records were taken one by one before; only their mean is made.
        tables: (1,) ARRAYS: inbox; samples and RECEIVED of :func:`.take_records`.

    Returns:
        Good records, sequence number of the first one taken last, whether one was beyond the range, whether the counts
        have not changed for a while.
    """
    table = tables[0]
    received = carray(to_pointer(table.received.place), (1,), RECEIVED)
    r = received[0]
    if not taken:
        heads, lengths = whole_matrix(table.heads), wholes(table.lengths)
        data = byte_matrix(table.datagrams)
        r.total[:] = 0.0
        r.good = r.saturated = 0
        while True:
            count = receive(fd, heads, byte_matrix(table.names), lengths, wholes(table.hosts))
            if count > 0:
                take_records(data, lengths, count, matrix(table.samples), received)
            if count < heads.shape[0]:
                break
    if r.good > 0:
        for k in range(6):
            r.wrench[k] = r.total[k] / r.good
    return r.good, r.first, r.saturated != 0, r.same >= FROZEN - 1


@kernel(DRAIN, Drained=DRAINED, entry=True)
def drain_at(place: int, fd: int, taken: bool, out: Records) -> None:
    """As :func:`drain_records`, by the place of its table.

    Args:
        out: (1,) DRAINED; written.
    """
    d = out[0]
    good, first, saturated, frozen = drain_records(fd, taken, carray(to_pointer(place), (1,), ARRAYS))
    d.good, d.first, d.saturated, d.frozen = good, first, int(saturated), int(frozen)
