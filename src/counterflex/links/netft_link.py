"""Client of an ATI Net F/T: subscribes, drains, averages what came since the last cycle, watches status and gaps."""

from __future__ import annotations

import contextlib
import socket
import struct
import urllib.error
import urllib.request
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import OutputError, ProtocolError
from counterflex.wire import netft

MOST_SAMPLES: Final = 512
"""Samples of one drain that are kept one by one: half a second at 1 kHz; later ones still enter the mean."""
FROZEN: Final = 8
"""Samples with the same counts in a row that no living sensor sends."""
_LONGEST_DOCUMENT: Final = 1 << 20


class NetftLink:
    """A stream of readings.

    Args:
        peer: UDP address of the sensor.
        scaling: Of its counts, see :func:`fetch_scaling`.
        range_n: Largest force that the sensor measures; 95 % of it counts as saturated. None: not watched.
        range_nm: Largest moment, likewise.

    Attributes:
        w_sensor: (6,) N, N m, mean of the good samples since the last :meth:`drain`.
        good: Good samples in the last drain.
        samples: (MOST_SAMPLES, 6) the good ones of the last drain one by one, N, N m, in time.
        first: Sequence number of the first of them.
        saturated: One of them was beyond the range, or the sensor said so.
        frozen: The counts have not changed for a while.
        lost: Records lost, in all.
        bad: Records whose status forbids their use, in all.
        malformed: Datagrams that are no records, in all.
    """

    def __init__(
        self,
        peer: tuple[str, int],
        scaling: netft.Scaling,
        *,
        range_n: float | None = None,
        range_nm: float | None = None,
    ) -> None:
        self.peer = peer
        self._scale = np.r_[np.full(3, scaling.force_n), np.full(3, scaling.moment_nm)]
        limits = (np.inf if range_n is None else range_n, np.inf if range_nm is None else range_nm)
        self._limit = 0.95 * np.r_[np.full(3, limits[0]), np.full(3, limits[1])]
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.connect(peer)
        except OSError as fault:
            self._socket.close()
            raise OutputError(
                f"the force sensor cannot be addressed: {fault.strerror or fault}", where=f"{peer[0]}:{peer[1]}"
            ) from fault
        self._socket.setblocking(False)
        self._buffer = bytearray(2048)
        self.w_sensor: Float = np.zeros(6)
        self._sum: Float = np.zeros(6)
        self._counts: Float = np.zeros(6)
        self._before: Float = np.zeros(6)
        self.samples: Float = np.zeros((MOST_SAMPLES, 6))
        self.first = -1
        self._sequence = -1
        self._same = 0
        self.good = self.lost = self.bad = self.malformed = 0
        self.saturated = self.frozen = False

    def start(self) -> None:
        """Ask for the stream (again)."""
        with contextlib.suppress(ConnectionError, BlockingIOError):
            self._socket.send(netft.request(netft.START))
        self._sequence = -1

    def stop(self) -> None:
        """End the stream."""
        with contextlib.suppress(ConnectionError, BlockingIOError, OSError):
            self._socket.send(netft.request(netft.STOP))

    def drain(self) -> int:
        """Take every record that is there.

        Returns:
            Number of good samples; with none :attr:`w_sensor` is left as it was.
        """
        self._sum[:] = 0.0
        self.good, self.saturated = 0, False
        while True:
            try:
                length = self._socket.recv_into(self._buffer)
            except BlockingIOError:
                break
            except ConnectionError:
                continue
            if length != netft.RECORD.size:
                self.malformed += 1
                continue
            self._take()
        if self.good:
            np.divide(self._sum, self.good, out=self.w_sensor)
        return self.good

    def _take(self) -> None:
        sequence, _, status, *counts = _UNPACK(self._buffer)
        if self._sequence >= 0:
            gap = netft.lost(self._sequence, sequence)
            if gap < 0:
                return  # late or repeated: a newer one has been taken already
            self.lost += gap
        self._sequence = sequence
        if status not in (netft.GOOD, netft.MONITOR):
            self.bad += 1
            self.saturated = True
            return
        self._counts[:] = counts
        self._same = self._same + 1 if np.array_equal(self._counts, self._before) else 0
        self.frozen = self._same >= FROZEN - 1
        self._before[:] = self._counts
        np.multiply(self._counts, self._scale, out=self._counts)
        if np.any(np.abs(self._counts) > self._limit):
            self.saturated = True
        self._sum += self._counts
        if self.good < MOST_SAMPLES:
            self.samples[self.good] = self._counts
        self.first = sequence if self.good == 0 else self.first
        self.good += 1

    def close(self) -> None:
        """End the stream and free the socket."""
        self.stop()
        self._socket.close()


_UNPACK = struct.Struct(">III6i").unpack_from


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
    except (urllib.error.URLError, OSError, ValueError) as fault:
        raise OutputError(
            f"the force sensor does not serve its scaling: {getattr(fault, 'reason', fault)}",
            where=where,
            hint="Check address and cable, or give the scaling in the cell file",
        ) from fault
    if len(document) >= _LONGEST_DOCUMENT:
        raise ProtocolError("the scaling document is far too long", where=where, value=f"{len(document)} bytes")
    return netft.read_scaling(document, where)
