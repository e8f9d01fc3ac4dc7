"""A simulated ATI Net F/T on real sockets: Raw Data Transfer over UDP, scaling over HTTP."""

from __future__ import annotations

import contextlib
import http.server
import socket
import threading
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import ProtocolError
from counterflex.wire import netft

COUNTS: Final = 1_000_000
"""Counts per N and per N m."""
_LARGEST: Final = 2**31 - 1


class NetftServer:
    """The sensor's side.

    Args:
        host: Address to bind.
        port: UDP port; 0 takes a free one.
        http_port: Of the scaling document; 0 takes a free one, None serves none.
        rate_hz: Records per second it claims to send.

    Attributes:
        address: Where requests go.
        http_address: Where the scaling document is, or None.
        peer: Who gets the records, or None.
        status: Status word of the records.
    """

    def __init__(self, host: str = "127.0.0.1", port: int = 0, http_port: int | None = 0, rate_hz: int = 1000) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind((host, port))
        self._socket.setblocking(False)
        self.address: tuple[str, int] = self._socket.getsockname()
        self.peer: tuple[str, int] | None = None
        self.status = netft.GOOD
        self._sequence = 0
        self._sample = 0
        self._left = 0
        self._bias: Float = np.zeros(6)
        self._last: Float = np.zeros(6)
        self._http: http.server.ThreadingHTTPServer | None = None
        self.http_address: tuple[str, int] | None = None
        if http_port is not None:
            self._http = _document_server(host, http_port, netft.write_scaling(COUNTS, COUNTS, rate_hz, "Net F/T"))
            self.http_address = (host, self._http.server_address[1])
            threading.Thread(target=self._http.serve_forever, daemon=True).start()

    def poll(self) -> None:
        """Take requests that have come; never waits. What is no request is passed over, as the sensor does."""
        while True:
            try:
                data, peer = self._socket.recvfrom(2048)
            except (BlockingIOError, ConnectionError):
                return
            with contextlib.suppress(ProtocolError):
                command, samples = netft.read_request(data)
                if command == netft.START:
                    self.peer, self._left, self._sequence = peer, samples, 0
                elif command == netft.STOP:
                    self.peer = None
                elif command == netft.SET_BIAS:
                    self._bias = self._last.copy()

    def send(self, w_sensor: Float) -> None:
        """Send a reading (6,) N, N m to whoever asked for the stream; beyond its range it saturates and says so."""
        self._last = w_sensor
        self._sample = (self._sample + 1) & 0xFFFFFFFF
        if self.peer is None:
            return
        counts = np.rint((w_sensor - self._bias) * COUNTS)
        status = self.status
        if np.any(np.abs(counts) > _LARGEST):
            status |= 0x80000002
            counts = np.clip(counts, -_LARGEST, _LARGEST)
        self._sequence = (self._sequence + 1) & 0xFFFFFFFF
        record = netft.Record(self._sequence, self._sample, status, tuple(int(c) for c in counts))  # type: ignore[arg-type]
        with contextlib.suppress(BlockingIOError, ConnectionError):
            self._socket.sendto(netft.write_record(record), self.peer)
        if self._left:
            self._left -= 1
            if self._left == 0:
                self.peer = None

    def close(self) -> None:
        """Free the sockets."""
        self._socket.close()
        if self._http is not None:
            self._http.shutdown()
            self._http.server_close()


def _document_server(host: str, port: int, document: bytes) -> http.server.ThreadingHTTPServer:
    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            if self.path != "/netftapi2.xml":
                self.send_error(404)
                return
            self.send_response(200)
            self.send_header("Content-Type", "text/xml")
            self.send_header("Content-Length", str(len(document)))
            self.end_headers()
            self.wfile.write(document)

        def log_message(self, *_: object) -> None:
            """Say nothing."""

    return http.server.ThreadingHTTPServer((host, port), Handler)
