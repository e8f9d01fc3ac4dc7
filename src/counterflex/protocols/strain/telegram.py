"""The neutral strain datagram, version 1: UDP, little-endian, ``32 + 8 n`` bytes for n bridges, 3 to 12.

| offset | type | field |
|---|---|---|
| 0 | 4 bytes | ``CFS1`` |
| 4 | u32 | sequence, +1 per datagram, wraps |
| 8 | u64 | time of measurement, ns of the source's clock; not below that of the datagram before |
| 16 | u32 | status: bit k is set where the amplifier reports bridge k + 1 out of order |
| 20 | u32 | n, number of bridges |
| 24 | f64 | temperature of the holder, deg C; NaN where it is not measured |
| 32 | n f64 | strain of each bridge, um/m, mean over the time since the datagram before; NaN: no reading |
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from typing import Final

from counterflex.core.arrays import Float
from counterflex.core.errors import ProtocolError
from counterflex.core.units import MICRO
from counterflex.protocols.strain import kernel as reading

MAGIC: Final = b"CFS1"
HEAD: Final = struct.Struct("<4sIQIId")
FEWEST, MOST = reading.FEWEST, reading.MOST


@dataclass(frozen=True, eq=False)
class StrainSample:
    """One reading of all bridges."""

    sequence: int  # see the table of the module
    time_ns: int  # source clock
    status: int  # bits; 0 is good
    temperature_c: float  # of the holder, NaN where not measured
    strain: Float  # (n,) of each bridge, dimensionless

    def telegram(self) -> bytes:
        """A reading as a datagram: the amplifier's side. Raises ProtocolError: a number does not fit its field."""
        count = len(self.strain)
        if not FEWEST <= count <= MOST:
            raise ProtocolError("number of bridges of a strain datagram", value=count, limit=f"{FEWEST}..{MOST}")
        try:
            head = HEAD.pack(MAGIC, self.sequence, self.time_ns, self.status, count, self.temperature_c)
            return head + struct.pack(f"<{count}d", *(float(value) / MICRO for value in self.strain))
        except struct.error as fault:
            raise ProtocolError("a strain reading does not fit its datagram", value=self.sequence) from fault

    def readable(self) -> bool:
        """Return whether every bridge shows a number."""
        return self.status == 0 and all(math.isfinite(value) for value in self.strain)
