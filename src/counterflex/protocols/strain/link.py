"""Receiver of strain datagrams: every sample since the last cycle, and which bridges show nothing to be believed."""

from __future__ import annotations

from typing import Final

import numpy as np

from counterflex.core.array_table import ArrayTable
from counterflex.core.arrays import Float, Int
from counterflex.core.errors import InputError
from counterflex.core.records import Record, records
from counterflex.protocols.strain import kernel as reading
from counterflex.protocols.strain.drain_kernel import ARRAYS, drain_strains
from counterflex.protocols.system.datagrams import DatagramLink, Inbox, batches, listening

MOST_SAMPLES: Final = 512
"""Samples of one drain that are kept; the newest ones beyond that are lost, and counted as taken."""


class StrainLink(DatagramLink):
    """A stream of strains, taken by the session as a :class:`~counterflex.protocols.force.source.ForceSource`.

    Args:
        host: Address to listen on; loopback unless told otherwise.
        port: UDP port; 0 takes a free one.
        bridges: Number of bridges; datagrams with another number are counted and not used.
        range_: Strain beyond which a bridge is not believed, 1.
        least: Bridges that must show a number for the reading to be used.
        peers: Addresses that are listened to; None takes the first that sends a good datagram.
        inbox: Takes the datagrams; None opens the port.

    Attributes:
        address: Where datagrams are expected.
        bridges: Number of bridges expected.
        strain: (MOST_SAMPLES, 12) of the last drain, row by row; NaN where a bridge is not believed.
        warm_c: (MOST_SAMPLES,) deg C, NaN where not measured.
        times_ns: (MOST_SAMPLES,) clock of the source.
        counts: (1,) datagrams of the last drain.
        good: Samples in the last drain.
        w_sensor: (6,) N: force at the tool in holder axes and its standard deviation, as the estimator wrote it.
        samples: (0, 6): there is no force of single samples, and ``w_sensor`` is that of the cycle before.
        first: -1: they are not the force sensor's at 1 kHz.

    Raises:
        InputError: No such number of bridges, or a range that is not above 0.
        OutputError: The port cannot be opened.
    """

    def __init__(
        self,
        host: str,
        port: int,
        bridges: int,
        *,
        range_: float,
        least: int = 4,
        peers: tuple[str, ...] | None = None,
        inbox: Inbox | None = None,
    ) -> None:
        if not reading.FEWEST <= bridges <= reading.MOST:
            raise InputError("bridges of the holder", value=bridges, limit=f"{reading.FEWEST}..{reading.MOST}")
        if not range_ > 0.0:
            raise InputError("the range of the bridges is not above 0", value=range_)
        self.bridges = bridges
        self._least = min(least, bridges)
        self.address = host, port
        if inbox is None:
            inbox, self.address = listening(host, port, "the port for strains")
        super().__init__(inbox, records(reading.RECEIVED), peers)
        self.received: Record = self._received[0]
        self.received.bridges, self.received.range = bridges, range_
        self.strain: Float = np.full((MOST_SAMPLES, reading.MOST), np.nan)
        self.warm_c: Float = np.full(MOST_SAMPLES, np.nan)
        self.times_ns: Int = np.zeros(MOST_SAMPLES, dtype=np.int64)
        self.w_sensor: Float = np.zeros(6)
        self.samples: Float = np.zeros((0, 6))
        self.good, self.first = 0, -1
        self.counts: Int = self._received["good"]
        self._same: Int = self._received["same"][0]
        self._missing: Int = self._received["missing"][0]
        self._outside: Int = self._received["outside"][0]
        self._table = ArrayTable(
            ARRAYS,
            **self._inbox.arrays(),
            allowed=self._allowed,
            samples=self.strain,
            warm=self.warm_c,
            times=self.times_ns,
            received=self._received,
        )

    def drain(self) -> int:
        """Take every datagram that is there; returns their number, those with too few bridges included."""
        inbox = self._inbox
        if inbox.many:
            count = drain_strains(inbox.fd, self._table.rows)
        else:
            count = self._drain_singly()
        self.good = min(count, MOST_SAMPLES)
        return self.good

    def _drain_singly(self) -> int:
        inbox, self.counts[0] = self._inbox, 0
        for count in batches(inbox):
            reading.take_strains(
                inbox.data, inbox.lengths, inbox.hosts, count, self._allowed,
                self.strain, self.warm_c, self.times_ns, self._received,
            )  # fmt: skip
        return int(self.counts[0])

    @property
    def saturated(self) -> bool:
        """So many bridges are beyond their range that too few are left."""
        outside = sum(self._outside.tolist())
        return outside > 0 and bool(self.bridges - outside - sum(self._missing.tolist()) < self._least)

    @property
    def frozen(self) -> bool:
        """Too few bridges show a new number."""
        still = [same >= reading.FROZEN - 1 for same in self._same[: self.bridges].tolist()].count(True)
        return bool(self.bridges - still - sum(self._missing.tolist()) < self._least)
