"""The generic wrench datagram as a protocol that a cell file can name: the loop listens, the source sends."""

from __future__ import annotations

import itertools
from typing import Final

import numpy as np

from counterflex.core.errors import InputError
from counterflex.protocols.force.sensors import ForceSensorKind, Opening
from counterflex.protocols.force.stream import SampleStream
from counterflex.protocols.system.datagrams import batches, host_number, listening
from counterflex.protocols.wrench import telegram

_BATCHES: Final = 32
"""Batches of 64 datagrams that are taken in one cycle at most: a flood does not stop the loop."""


class WrenchLink(SampleStream):
    """Samples of a source that sends wrench datagrams; everything else that comes is counted and passed over.

    Args:
        host: Address to listen on.
        port: UDP port; 0 takes a free one.
        sender: Address that is listened to; empty takes the first that sends a good datagram.
        source: Source id of the datagrams that are taken; others are foreign. -1 takes any.
        range_n: Largest force, see :class:`SampleStream`.
        range_nm: Largest moment.

    Attributes:
        address: Where datagrams are expected.
        foreign: Datagrams from another sender, or of another source id.

    Raises:
        InputError: ``sender`` cannot be found.
        OutputError: The port cannot be opened.
    """

    def __init__(
        self,
        host: str = "127.0.0.1",
        port: int = 0,
        *,
        sender: str = "",
        source: int = -1,
        range_n: float | None = None,
        range_nm: float | None = None,
    ) -> None:
        super().__init__(range_n=range_n, range_nm=range_nm)
        self._host = host_number(sender) if sender else -1
        if sender and self._host < 0:
            raise InputError("the sender of the wrench datagrams cannot be found", value=sender)
        self._source = source
        self._inbox, self.address = listening(
            host,
            port,
            "the port for the wrench datagrams",
            "force_sensor.address is where the datagrams come to: an address of this computer, a free port",
        )
        self.foreign = 0

    def drain(self) -> int:
        """Take every datagram that is there; returns the number of good samples. Never waits, never raises."""
        self.begin()
        for count in itertools.islice(batches(self._inbox), _BATCHES):
            self._take_batch(count)
        return self.end()

    def _take_batch(self, count: int) -> None:
        rows, good = telegram.rows_of(self._inbox.data, self._inbox.lengths, count)
        hosts = self._inbox.hosts[:count]
        if self._host < 0 and np.any(good):
            self._host = int(hosts[np.argmax(good)])
        known = hosts == self._host if self._host >= 0 else np.ones(count, dtype=np.bool_)
        if self._source >= 0:
            known &= ~good | (rows["source"] == self._source)
        self.foreign += int(np.sum(~known))
        self.malformed += int(np.sum(known & ~good))
        taken = rows[known & good]
        if len(taken):
            self.take(
                taken["wrench"],
                sequence=taken["sequence"],
                time_ns=taken["time_ns"],
                invalid=taken["status"] & telegram.INVALID != 0,
                saturated=taken["status"] & telegram.SATURATED != 0,
            )

    def close(self) -> None:
        """Free the port."""
        self._inbox.close()


def _open(opening: Opening) -> WrenchLink:
    return WrenchLink(
        opening.host,
        opening.port,
        sender=str(opening.values["sender"]),
        source=int(opening.values["source"]),
        range_n=opening.range_n,
        range_nm=opening.range_nm,
    )


WRENCH: Final = ForceSensorKind(
    "generic wrench datagram: UDP, any sensor behind a bridge",
    _open,
    {"sender": "", "source": -1},
    "counterflex.app.simulated_cell.instruments:wrench_sender",
)
