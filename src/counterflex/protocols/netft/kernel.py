"""Records of a Net F/T taken in one after the other: gaps, status, range, sum. Compiled, without allocation."""

from __future__ import annotations

from typing import Final

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.jit import kernel
from counterflex.protocols.decimal_kernel import ByteRows

N_SEQUENCE: Final = 0  # of the last record taken; -1 before the first
N_SAME: Final = 1  # records in a row with the counts of the one before
N_GOOD: Final = 2  # since it was set to zero
N_SATURATED: Final = 3  # 1: a record beyond the range, or with a bad status; since it was set to zero
N_LOST: Final = 4  # in all, as the next two
N_BAD: Final = 5
N_MALFORMED: Final = 6
N_FIRST: Final = 7  # sequence number of the first good record since N_GOOD was zero
NUMBERS: Final = 8
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


@kernel(
    "void(uint8[:, ::1], int64[::1], int64, float64[::1], float64[::1], int64[::1], int64[::1],"
    " float64[::1], float64[:, ::1])"
)
def take_records(
    data: ByteRows,
    lengths: Int,
    count: int,
    scale: Float,
    limit: Float,
    numbers: Int,
    before: Int,
    total: Float,
    samples: Float,
) -> None:
    """Take records in their order.

    Args:
        data: (n, size) one datagram in a row.
        lengths: (n,) bytes of each.
        count: How many there are.
        scale: (6,) N, N m per count.
        limit: (6,) N, N m: beyond it a reading counts as saturated.
        numbers: (NUMBERS,) of this module; changed.
        before: (6,) counts of the last good record; changed.
        total: (6,) N, N m: sum of the good readings; changed.
        samples: (m, 6) N, N m: the first m good readings since N_GOOD was zero; changed.
    """
    for row in range(count):
        if lengths[row] != _SIZE:
            numbers[N_MALFORMED] += 1
            continue
        sequence = big_endian(data, row, 0)
        if numbers[N_SEQUENCE] >= 0:
            step = (sequence - numbers[N_SEQUENCE]) & 0xFFFFFFFF
            if step == 0 or step >= 0x80000000:
                continue  # late or repeated: a newer one has been taken already
            numbers[N_LOST] += step - 1
        numbers[N_SEQUENCE] = sequence
        status = big_endian(data, row, 8)
        if status not in (_GOOD, _MONITOR):
            numbers[N_BAD] += 1
            numbers[N_SATURATED] = 1
            continue
        same, good = 1, numbers[N_GOOD]
        if good == 0:
            numbers[N_FIRST] = sequence
        for k in range(6):
            counts = big_endian(data, row, 12 + 4 * k)
            if counts >= 0x80000000:
                counts -= 0x100000000
            if counts != before[k]:
                same = 0
            before[k] = counts
            value = counts * scale[k]
            if abs(value) > limit[k]:
                numbers[N_SATURATED] = 1
            total[k] += value
            if good < samples.shape[0]:
                samples[good, k] = value
        numbers[N_SAME] = numbers[N_SAME] + 1 if same == 1 else 0
        numbers[N_GOOD] += 1
