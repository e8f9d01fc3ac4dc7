"""The generic wrench datagram: 72 bytes, UDP, little-endian; ours to define, for any maker's sensor behind a bridge.

| offset | type | field |
|---|---|---|
| 0 | 3 bytes | ``CFW`` |
| 3 | 1 byte | version as a digit: ``1`` |
| 4 | u32 | sequence, +1 per datagram, wraps |
| 8 | u64 | time of measurement, ns of the source's clock; increases |
| 16 | u32 | status bits |
| 20 | u32 | source id, 0 where there is one only |
| 24 | 3 f64 | force, N, on the sensor's measuring side, in its axes |
| 48 | 3 f64 | moment, N m, about the sensor's origin |
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from counterflex.core.arrays import Bool
from counterflex.core.errors import ProtocolError

NAME: Final = b"CFW"
VERSION: Final = 1
MAGIC: Final = b"CFW1"
DATAGRAM: Final = struct.Struct("<4sIQII6d")
SIZE: Final = 72
SATURATED: Final = 1
"""Status bit: a component is at or beyond the range of the sensor."""
INVALID: Final = 2
"""Status bit: the sensor or its bridge has no value; the six numbers mean nothing."""
WARNING: Final = 4
"""Status bit: something is wrong with the sensor, the values hold (a threshold of its own monitor, its temperature)."""
KNOWN: Final = SATURATED | INVALID | WARNING
LARGEST_N: Final = 1e6
"""Largest force that a datagram may hold; the loop's robots carry a thousandth of it."""
LARGEST_NM: Final = 1e6
FIELDS: Final = np.dtype(
    [
        ("magic", "<u4"),
        ("sequence", "<u4"),
        ("time_ns", "<u8"),
        ("status", "<u4"),
        ("source", "<u4"),
        ("wrench", "<f8", (6,)),
    ]
)
"""The same bytes as rows of an array."""
_MAGIC: Final = int.from_bytes(MAGIC, "little")


@dataclass(frozen=True)
class Wrench:
    """One measurement."""

    sequence: int  # see the table of the module
    time_ns: int  # source clock
    status: int  # bits; 0 is good
    source: int  # see the table
    w_sensor: tuple[float, float, float, float, float, float]  # Fx Fy Fz N, Mx My Mz N m

    def written(self) -> bytes:
        """The measurement as a datagram: the source's side. Raises ProtocolError: a number does not fit its field."""
        try:
            return DATAGRAM.pack(MAGIC, self.sequence, self.time_ns, self.status, self.source, *self.w_sensor)
        except struct.error as fault:
            raise ProtocolError("a wrench does not fit its datagram", value=self.sequence) from fault


def read_wrench(data: bytes) -> Wrench:
    """Read a datagram.

    Raises:
        ProtocolError: Another length or name, a newer version, unknown status bits, a number that is not finite or
            beyond 1e6 N or N m; an invalid measurement may hold any numbers.
    """
    if data[:3] == NAME and data[3:4].isdigit() and data[:4] != MAGIC:
        raise ProtocolError("another version of the wrench datagram", value=data[3:4].decode("ascii"), limit=VERSION)
    if len(data) != SIZE or data[:4] != MAGIC:
        raise ProtocolError("not a wrench datagram", value=f"{len(data)} bytes, {data[:4]!r}", limit="72 bytes, CFW1")
    _, sequence, time_ns, status, source, *w = DATAGRAM.unpack(data)
    if status & ~KNOWN:
        raise ProtocolError("unknown status bits of a force sensor", value=f"0x{status:x}", limit=f"0x{KNOWN:x}")
    if not status & INVALID:
        if not all(math.isfinite(value) for value in w):
            raise ProtocolError("a force sensor sent a number that is not finite", value=w)
        if max(map(abs, w[:3])) > LARGEST_N or max(map(abs, w[3:])) > LARGEST_NM:
            raise ProtocolError("a force sensor's reading is out of range", value=w, limit=f"{LARGEST_N:g} N, N m")
    return Wrench(sequence, time_ns, status, source, (w[0], w[1], w[2], w[3], w[4], w[5]))


def rows_of(data: NDArray[np.uint8], lengths: NDArray[np.int64], count: int) -> tuple[NDArray[Any], Bool]:
    """Several datagrams at once.

    Args:
        data: (n, size) one datagram in a row, what lies behind its end means nothing; size at least 72.
        lengths: (n,) bytes of each.

    Returns:
        (count,) rows of :data:`FIELDS`, and which of them :func:`read_wrench` would read.
    """
    rows = np.ascontiguousarray(data[:count, :SIZE]).view(FIELDS)[:, 0]
    status, w = rows["status"], rows["wrench"]
    valid = np.all(np.abs(w) <= np.repeat([LARGEST_N, LARGEST_NM], 3), axis=1)  # a NaN is not
    good: Bool = (lengths[:count] == SIZE) & (rows["magic"] == _MAGIC) & (status & ~np.uint32(KNOWN) == 0)
    good &= valid | (status & INVALID != 0)
    return rows, good
