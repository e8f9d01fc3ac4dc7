"""Records of a Net F/T taken in one after the other: gaps, status, range, sum. Compiled, without allocation."""

from __future__ import annotations

from typing import Final

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.jit import kernel
from counterflex.core.records import Records, record
from counterflex.protocols.decimal_kernel import ByteRows
from counterflex.protocols.sequence_kernel import ORDER, steps_on

RECEIVED: Final = record(
    scale=(float, 6),  # N, N m per count
    limit=(float, 6),  # N, N m: beyond it a reading counts as saturated
    order=ORDER,  # of the numbers of the records
    same=int,  # records in a row with the counts of the one before
    good=int,  # since it was set to zero
    saturated=int,  # 1: a record beyond the range, or with a bad status; since it was set to zero
    lost=int,  # in all, as the next two
    bad=int,
    malformed=int,
    first=int,  # sequence number of the first good record since good was zero
    before=(int, 6),  # counts of the last good record
    total=(float, 6),  # N, N m: sum of the good readings since good was zero
    wrench=(float, 6),  # N, N m: mean of the good readings; left where there are none
)
"""What is known of a stream of records."""
_SIZE: Final = 36
_GOOD: Final = 0
_MONITOR: Final = 0x80010000


@kernel("int64(uint8[:, ::1], int64, int64)")
def big_endian(data: ByteRows, row: int, at: int) -> int:
    """Unsigned number of four bytes, the highest first."""
    return int(
        (np.int64(data[row, at]) << 24)
        | (np.int64(data[row, at + 1]) << 16)
        | (np.int64(data[row, at + 2]) << 8)
        | np.int64(data[row, at + 3])
    )


@kernel("void(uint8[:, ::1], int64[::1], int64, float64[:, ::1], Received[::1])", Received=RECEIVED, entry=True)
def take_records(data: ByteRows, lengths: Int, count: int, samples: Float, received: Records) -> None:
    """Take records in their order.

    Args:
        data: (n, size) one datagram in a row.
        lengths: (n,) bytes of each.
        count: How many there are.
        samples: (m, 6) N, N m: the first m good readings since ``good`` was zero; changed.
        received: (1,) RECEIVED; changed.
    """
    r = received[0]
    for row in range(count):
        if lengths[row] != _SIZE:
            r.malformed += 1
            continue
        sequence = big_endian(data, row, 0)
        step = steps_on(r.order, sequence, 0xFFFFFFFF)
        if step == 0:
            continue
        r.lost += step - 1
        status = big_endian(data, row, 8)
        if status not in (_GOOD, _MONITOR):
            r.bad += 1
            r.saturated = 1
            continue
        same, good = True, r.good
        if good == 0:
            r.first = sequence
        for k in range(6):
            counts = big_endian(data, row, 12 + 4 * k)
            if counts >= 0x80000000:
                counts -= 0x100000000
            same = same and counts == r.before[k]
            r.before[k] = counts
            value = counts * r.scale[k]
            if abs(value) > r.limit[k]:
                r.saturated = 1
            r.total[k] += value
            if good < samples.shape[0]:
                samples[good, k] = value
        r.same = r.same + 1 if same else 0
        r.good += 1
