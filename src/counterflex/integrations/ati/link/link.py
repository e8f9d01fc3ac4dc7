"""Client of an ATI Net F/T: subscribes, drains, averages what came since the last cycle, watches status and gaps."""

from __future__ import annotations

import contextlib
import http.client
import socket
import urllib.error
import urllib.request
from typing import Final

import numpy as np

from counterflex.core.array_table import ArrayTable
from counterflex.core.arrays import Float
from counterflex.core.entry_calls import address_of
from counterflex.core.errors import OutputError, ProtocolError
from counterflex.core.records import Record, records
from counterflex.integrations.ati.link import kernel as reading, telegram as netft
from counterflex.integrations.ati.link.drain_kernel import ARRAYS, drain_at, drain_records
from counterflex.protocols.robot.compiled_link import CompiledForce
from counterflex.protocols.system.datagrams import Datagrams, Inbox, batches

SATURATED: Final = 0.95
"""Share of the range at which a reading is not believed any more."""
MOST_SAMPLES: Final = 512
"""Samples of one drain that are kept one by one: half a second at 1 kHz; later ones still enter the mean."""
_LONGEST_DOCUMENT: Final = 1 << 20


class NetftLink:
    """A stream of readings.

    Args:
        peer: UDP address of the sensor.
        scaling: Of its counts, see :func:`fetch_scaling`.
        range_n: Largest force that the sensor measures; 95 % of it counts as saturated. None: what it says itself that
            it is calibrated for. The end of its counts is saturation in any case.
        range_nm: Largest moment, likewise.
        inbox: Where the records come in; None takes them from a socket.

    Attributes:
        good: Good samples in the last drain.
        first: Sequence number of the first good sample that was taken last.
        saturated: One of them was beyond the range, or the sensor said so.
        frozen: The counts have not changed for a while.
    """

    def __init__(
        self,
        peer: tuple[str, int],
        scaling: netft.Scaling,
        *,
        range_n: float | None = None,
        range_nm: float | None = None,
        inbox: Inbox | None = None,
    ) -> None:
        self.peer = peer
        self._received = records(reading.RECEIVED)
        r: Record = self._received[0]
        r.scale = np.r_[np.full(3, scaling.force_n), np.full(3, scaling.moment_nm)]
        limits = (
            np.array(scaling.range_n) if range_n is None else np.full(3, range_n),
            np.array(scaling.range_nm) if range_nm is None else np.full(3, range_nm),
        )
        r.limit = SATURATED * np.minimum(np.concatenate(limits), netft.RAIL * r.scale)
        r.order.newest = r.first = -1
        self._inbox: Inbox = Datagrams(_connected(peer)) if inbox is None else inbox
        self.w_sensor: Float = r.wrench  # (6,) N, N m, mean of the good samples since the last :meth:`drain`
        # (MOST_SAMPLES, 6) the good ones of the last drain one by one, N, N m, in time
        self.samples: Float = np.zeros((MOST_SAMPLES, 6))
        self.good, self.first = 0, -1
        self.saturated = self.frozen = False
        self._table = ArrayTable(ARRAYS, **self._inbox.arrays(), samples=self.samples, received=self._received)

    def start(self) -> None:
        """Ask for the stream (again)."""
        with contextlib.suppress(ConnectionError, BlockingIOError):
            self._inbox.send(netft.request(netft.START))
        self._received["order"]["newest"] = -1

    def stop(self) -> None:
        """End the stream."""
        with contextlib.suppress(ConnectionError, BlockingIOError, OSError):
            self._inbox.send(netft.request(netft.STOP))

    def drain(self) -> int:
        """Take every record that is there.

        Returns:
            Number of good samples; with none :attr:`w_sensor` is left as it was.
        """
        inbox = self._inbox
        if not inbox.many:
            self._one_by_one()
        counts = drain_records(inbox.fd, not inbox.many, self._table.rows)
        self.take(*counts)
        return counts[0]

    def take(self, good: int, first: int, saturated: bool, frozen: bool) -> None:
        """Take what a drain has found, here or in the one call of a cycle."""
        self.good, self.first, self.saturated, self.frozen = good, first, saturated, frozen

    def compiled(self) -> CompiledForce | None:
        """The drain for the one call of a cycle; None where datagrams are taken one by one."""
        return CompiledForce(address_of(drain_at), self._table, self._inbox.fd) if self._inbox.many else None

    def _one_by_one(self) -> None:
        inbox, received = self._inbox, self._received
        received["total"] = 0.0
        received["good"] = received["saturated"] = 0
        for count in batches(inbox):
            reading.take_records(inbox.data, inbox.lengths, count, self.samples, received)

    @property
    def lost(self) -> int:
        """Records lost, in all."""
        return int(self._received["lost"][0])

    @property
    def bad(self) -> int:
        """Records whose status forbids their use, in all."""
        return int(self._received["bad"][0])

    @property
    def malformed(self) -> int:
        """Datagrams that are no records, in all."""
        return int(self._received["malformed"][0])

    def close(self) -> None:
        """End the stream and free the socket."""
        self.stop()
        self._inbox.close()


def _connected(peer: tuple[str, int]) -> socket.socket:
    """A socket that talks to one peer."""
    own = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        own.connect(peer)
    except OSError as fault:
        own.close()
        raise OutputError(
            f"the force sensor cannot be addressed: {fault.strerror or fault}", where=f"{peer[0]}:{peer[1]}"
        ) from fault
    return own


def fetch_scaling(host: str, port: int = 80, timeout_s: float = 3.0) -> netft.Scaling:
    """Read the sensor's scaling document over HTTP.

    Raises:
        OutputError: It cannot be reached.
        ProtocolError: What it serves is no scaling document.
    """
    where = f"http://{host}:{port}/netftapi2.xml"
    try:
        with urllib.request.urlopen(where, timeout=timeout_s) as answer:
            document = answer.read(_LONGEST_DOCUMENT)
    except (urllib.error.URLError, http.client.HTTPException, OSError, ValueError) as fault:
        # among them: a connection to a free port of this computer that has met itself and hears its own request
        raise OutputError(
            f"the force sensor does not serve its scaling: {getattr(fault, 'reason', fault)}",
            where=where,
            hint="Check address and cable, or give the scaling in the cell file",
        ) from fault
    if len(document) >= _LONGEST_DOCUMENT:
        raise ProtocolError("the scaling document is far too long", where=where, value=f"{len(document)} bytes")
    return netft.Scaling.of(document, where)
