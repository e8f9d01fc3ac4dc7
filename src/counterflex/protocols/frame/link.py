"""Receiver of frames that the cell file describes: over UDP, listening or asking, or as a stream over TCP."""

from __future__ import annotations

import contextlib
import socket
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from counterflex.core.errors import InputError, OutputError
from counterflex.protocols.force.frame_format import FrameFormat
from counterflex.protocols.force.stream import SampleStream

_MOST_BYTES: Final = 1 << 16
"""Taken in one cycle at most: a flood does not stop the loop."""


@dataclass(frozen=True)
class FrameSource:
    """Transport and requests of a sensor that sends frames."""

    frame: FrameFormat  # what they look like
    transport: Literal["udp", "tcp"] = "udp"  # UDP datagrams of one or several whole frames, or a TCP stream
    # sent once at the beginning; empty: nothing. With it, or ``request``, the sensor is addressed; else the loop
    # listens
    start: bytes = b""
    stop: bytes = b""  # sent at the end
    request: bytes = b""  # sent once in every cycle, for a sensor that answers requests

    def __post_init__(self) -> None:
        """A stream without a header cannot be cut into frames. Raises InputError: it is one."""
        if self.transport == "tcp" and not self.frame.header:
            raise InputError("frames over TCP need a header, to be found in the stream")


class FrameLink(SampleStream):
    """Samples of a sensor that sends frames.

    Args:
        host: Of the sensor, or where the loop listens.
        source: See :class:`FrameSource`.
        wait_s: How long a TCP connection may take.
        range_n: Largest force, see :class:`SampleStream`.
        range_nm: Largest moment.

    Attributes:
        address: Own address.

    Raises:
        OutputError: The port cannot be opened, or the sensor not be reached.
    """

    def __init__(
        self,
        host: str,
        port: int,
        source: FrameSource,
        *,
        wait_s: float = 10.0,
        range_n: float | None = None,
        range_nm: float | None = None,
    ) -> None:
        super().__init__(range_n=range_n, range_nm=range_nm, bits=source.frame.sequence_bits)
        self._source, self._frame, self._rest = source, source.frame, b""
        stream = source.transport == "tcp"
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_STREAM if stream else socket.SOCK_DGRAM)
        try:
            if stream:
                self._socket.settimeout(wait_s)
                self._socket.connect((host, port))
            elif source.start or source.request:
                self._socket.connect((host, port))
            else:
                self._socket.bind((host, port))
        except OSError as fault:
            self._socket.close()
            raise OutputError(
                f"the force sensor cannot be reached: {fault.strerror or fault}", where=f"{host}:{port}"
            ) from fault
        self._socket.setblocking(False)
        self.address: tuple[str, int] = self._socket.getsockname()
        self._say(source.start)

    def drain(self) -> int:
        """Take every frame that is there; returns the number of good samples. Never waits, never raises."""
        self.begin()
        received = 0
        while received < _MOST_BYTES:
            try:
                data = self._socket.recv(4096)
            except OSError:
                break
            if not data:
                break
            received += len(data)
            if self._source.transport == "tcp":
                self._rest += data
            elif len(data) % self._frame.size:
                self.malformed += 1
            else:
                self._take_frames(data)
        if self._source.transport == "tcp":
            self._take_frames(self._cut())
        self._say(self._source.request)
        return self.end()

    def _cut(self) -> bytes:
        """Whole frames of the stream, found by header, footer and checksum; what is none is passed over."""
        size, header, pieces = self._frame.size, self._frame.header, []
        at, lost = 0, 0
        while True:
            place = self._rest.find(header, at)
            if place < 0:  # a header may have begun at the end
                keep = max(at, len(self._rest) - len(header) + 1)
                lost += keep - at
                at = keep
                break
            lost += place - at
            at = place
            if len(self._rest) - at < size:
                break
            piece = self._rest[at : at + size]
            if self._frame.rows(piece)[1][0]:
                pieces.append(piece)
                at += size
            else:
                lost += 1
                at += 1
        self.malformed += int(lost > 0)
        self._rest = self._rest[at:]
        return b"".join(pieces)

    def _take_frames(self, data: bytes) -> None:
        if not data:
            return
        frame = self._frame
        rows, good = frame.rows(data)
        self.malformed += int(np.sum(~good))
        taken = rows[good]
        status = taken["status"].astype(np.int64) if frame.has("status") else np.zeros(len(taken), dtype=np.int64)
        self.take(
            frame.wrench(taken),
            sequence=taken["sequence"].astype(np.int64) if frame.has("sequence") else None,
            invalid=status & frame.invalid_bits != 0,
            saturated=status & frame.saturated_bits != 0,
        )

    def _say(self, data: bytes) -> None:
        if data:
            with contextlib.suppress(OSError):
                self._socket.send(data)

    def close(self) -> None:
        """End the stream and free the socket."""
        self._say(self._source.stop)
        self._socket.close()
