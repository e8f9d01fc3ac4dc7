"""Strain datagrams read and taken in one after the other, compiled; the rules are those of the module telegram."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.jit import kernel
from counterflex.core.records import Records, record
from counterflex.protocols.decimal_kernel import ByteRows
from counterflex.protocols.sequence_kernel import ORDER, steps_on

OK: Final = 0
NO_DATAGRAM: Final = 1
UNKNOWN_STATUS: Final = 2
OUT_OF_RANGE: Final = 3

FEWEST: Final = 3
MOST: Final = 12
LONGEST: Final = 32 + 8 * MOST
LARGEST_UM_M: Final = 100_000.0
FROZEN: Final = 25
"""Samples with the same number in a row that no amplifier sends."""
_MAGIC: Final = 0x31534643  # CFS1, little-endian
_MICRO: Final = 1e-6
_COLDEST_C, _HOTTEST_C = -50.0, 150.0

RECEIVED: Final = record(
    range=float,  # strain beyond which a bridge is not believed
    strain=(float, MOST),  # of the last datagram
    before=(float, MOST),  # of the one before, of each bridge
    order=ORDER,  # of the numbers of the datagrams
    host=int,  # who is listened to; -1: whoever comes first
    bridges=int,  # that are expected
    good=int,  # datagrams taken since it was set to zero
    lost=int,  # in all, as the next three
    malformed=int,
    foreign=int,
    other=int,  # of another number of bridges
    same=(int, MOST),  # readings in a row with the number of the one before
    missing=(int, MOST),  # 1: the bridge has shown no number, or the amplifier reports it, in the last datagram
    outside=(int, MOST),  # 1: beyond the range in the last datagram
)
"""What is known of a stream of datagrams."""


@kernel("int64(uint8[:, ::1], int64, int64, int64)")
def _number(data: ByteRows, row: int, at: int, size: int) -> int:
    value = np.int64(0)
    for k in range(size):
        value |= np.int64(data[row, at + k]) << (8 * k)
    return int(value)


@kernel("int64(uint8[:, ::1], int64, int64, float64[::1])", entry=True)
def read_datagram(data: ByteRows, row: int, length: int, strain: Float) -> int:
    """Read one datagram.

    Args:
        data: (m, >= LONGEST) one datagram in a row.
        row: Which.
        strain: (MOST,) written: strain of each bridge, NaN where it shows none.

    Returns:
        OK, or what is wrong; the constants of this module.
    """
    if length < 32 or length > LONGEST or _number(data, row, 0, 4) != _MAGIC:
        return NO_DATAGRAM
    count = _number(data, row, 20, 4)
    if count < FEWEST or count > MOST or length != 32 + 8 * count:
        return NO_DATAGRAM
    if _number(data, row, 16, 4) >> count:
        return UNKNOWN_STATUS
    numbers = data[row, 24:LONGEST].view(np.float64)
    warm = numbers[0]
    if not (math.isnan(warm) or _COLDEST_C <= warm <= _HOTTEST_C):
        return OUT_OF_RANGE
    for k in range(count):
        value = numbers[1 + k]
        if not (math.isnan(value) or abs(value) <= LARGEST_UM_M):
            return OUT_OF_RANGE
        strain[k] = value * _MICRO
    return OK


@kernel(
    "int64(uint8[:, ::1], int64[::1], int64[::1], int64, int64[::1], float64[:, ::1], float64[::1], int64[::1],"
    " Received[::1])",
    Received=RECEIVED,
    entry=True,
)
def take_strains(
    data: ByteRows,
    lengths: Int,
    hosts: Int,
    count: int,
    allowed: Int,
    samples: Float,
    warm: Float,
    times: Int,
    received: Records,
) -> int:
    """Take datagrams in their order.

    Args:
        data: (m, size) one datagram in a row.
        lengths: (m,) bytes of each.
        hosts: (m,) who sent each.
        count: How many there are.
        allowed: (k,) senders that are listened to; empty: the first that sends a good datagram.
        samples: (r, MOST) strain of the first r datagrams since ``good`` was zero; NaN where a bridge shows none, is
            beyond the range, or repeats itself; changed.
        warm: (r,) their temperature, deg C; changed.
        times: (r,) their time, ns; changed.
        received: (1,) RECEIVED; changed.

    Returns:
        Datagrams since ``good`` was zero.
    """
    r = received[0]
    for row in range(count):
        known = len(allowed) == 0 and (r.host < 0 or r.host == hosts[row])
        for host in allowed:
            known |= host == hosts[row]
        if not known:
            r.foreign += 1
            continue
        if read_datagram(data, row, lengths[row], r.strain[:]) != OK:
            r.malformed += 1
            continue
        if _number(data, row, 20, 4) != r.bridges:
            r.other += 1
            continue
        if len(allowed) == 0:
            r.host = hosts[row]
        step = steps_on(r.order, _number(data, row, 4, 4), 0xFFFFFFFF)
        if step == 0:
            continue
        r.lost += step - 1
        status, at = _number(data, row, 16, 4), r.good
        for k in range(r.bridges):
            value = r.strain[k]
            r.missing[k] = 1 if math.isnan(value) or (status >> k) & 1 else 0
            r.outside[k] = 1 if abs(value) > r.range else 0
            r.same[k] = r.same[k] + 1 if value == r.before[k] else 0
            r.before[k] = value
            if r.missing[k] + r.outside[k] > 0 or r.same[k] >= FROZEN - 1:
                value = math.nan
            if at < samples.shape[0]:
                samples[at, k] = value
        if at < samples.shape[0]:
            warm[at] = data[row, 24:32].view(np.float64)[0]
            times[at] = _number(data, row, 8, 8)
        r.good += 1
    return int(r.good)
