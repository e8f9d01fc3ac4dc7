"""A simulated ATI Net F/T on real sockets: Raw Data Transfer over UDP, scaling over HTTP."""

from __future__ import annotations

import contextlib
import http.server
import socket
import threading
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import OutputError, ProtocolError
from counterflex.integrations.ati.link import telegram as netft
from counterflex.twin.devices.force_device import ForceStart
from counterflex.twin.network.faults import FaultSchedule, FaultyLine

COUNTS: Final = 1_000_000
"""Counts per N and per N m."""
SATURATED: Final = 0x80000002
"""Status bits of a record whose counts are at the end of their range."""
FAULTS: Final = ("silent", "dying", "counter", "saturated", "frozen", "status", "offset")
"""Faults of the instrument itself that the sensor can show."""
_LARGEST: Final = 2**31 - 1


class NetftServer:
    """The sensor's side.

    Args:
        host: Address to bind.
        port: UDP port; 0 takes a free one.
        http_port: Of the scaling document; 0 takes a free one, None serves none.
        rate_hz: Records per second it claims to send.
        faults: Scripted, by the time of the samples and their number.
    """

    def __init__(
        self,
        host: str = "127.0.0.1",
        port: int = 0,
        http_port: int | None = 0,
        rate_hz: int = 1000,
        faults: FaultSchedule | None = None,
    ) -> None:
        self._faults = faults if faults is not None else FaultSchedule()
        self._faults.require(FAULTS, "a force sensor")
        self._out, self._in = FaultyLine(self._faults, "out"), FaultyLine(self._faults, "in")
        self._period_s = 1.0 / rate_hz
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((host, port))
        except OSError as fault:
            self._socket.close()
            raise _taken(fault, host, port) from fault
        self._socket.setblocking(False)
        self.address: tuple[str, int] = self._socket.getsockname()  # Where requests go
        self.peer: tuple[str, int] | None = None  # Who gets the records, or None
        self.status = netft.GOOD  # Status word of the records
        self._sequence = 0
        self._sample = 0
        self._remaining = 0
        self._time_s = 0.0
        self._asker: tuple[str, int] | None = None
        self.dead = False  # It never sends again
        self.records = 0  # That left it
        self._bias: Float = np.zeros(6)
        self._last: Float = np.zeros(6)
        self._shown: list[float] = [0.0] * 6
        self._http: http.server.ThreadingHTTPServer | None = None
        self.http_address: tuple[str, int] | None = None  # Where the scaling document is, or None
        if http_port is not None:
            document = netft.write_scaling(COUNTS, COUNTS, rate_hz, "Net F/T")
            try:
                self._http = _document_server(host, http_port, document)
            except OSError as fault:
                self._socket.close()
                raise _taken(fault, host, http_port) from fault
            self.http_address = (host, self._http.server_address[1])
            threading.Thread(target=self._http.serve_forever, daemon=True).start()

    def poll(self) -> None:
        """Take requests that have come; never waits. What is no request is passed over, as the sensor does."""
        requests: list[bytes] = []
        while True:
            try:
                data, self._asker = self._socket.recvfrom(2048)
            except BlockingIOError:
                break
            except ConnectionError:
                continue
            self._in.put(data, self._time_s, requests.append)
        self._in.release(self._time_s, requests.append)
        for data in requests:
            with contextlib.suppress(ProtocolError):
                command, samples = netft.read_request(data)
                if command == netft.START:
                    self.peer, self._remaining, self._sequence = self._asker, samples, 0
                elif command == netft.STOP:
                    self.peer = None
                elif command == netft.SET_BIAS:
                    self._bias = self._last.copy()

    def send(self, w_sensor: Float, time_s: float | None = None) -> None:
        """Send a reading to the client that asked for the stream; beyond its range it saturates and says so.

        Args:
            w_sensor: (6,) N, N m.
            time_s: Since the start, for scripted faults; None counts samples.
        """
        self._time_s = self._sample * self._period_s if time_s is None else time_s
        condition = self._faults.condition(self._sample, self._time_s)
        self._sample = (self._sample + 1) & 0xFFFFFFFF
        self.dead = condition.dead
        self._out.release(self._time_s, self._put)
        self._last = np.array(w_sensor, dtype=np.float64)
        if any(condition.offset):
            self._last[:3] += condition.offset
        if self.peer is None or condition.silent:
            return
        if not condition.frozen:
            self._shown = np.rint((self._last - self._bias) * COUNTS).tolist()
        counts, status = self._shown, self.status | condition.bits
        if condition.saturated:
            counts = [-_LARGEST if count < 0.0 else _LARGEST for count in counts]
        if condition.saturated or max(map(abs, counts)) > _LARGEST:
            status |= SATURATED
            counts = [min(max(count, -_LARGEST), _LARGEST) for count in counts]
        self._sequence = (self._sequence + 1) & 0xFFFFFFFF
        sequence = (self._sequence + condition.step) & 0xFFFFFFFF
        record = netft.NetftRecord(sequence, self._sample, status, tuple(map(int, counts)))  # type: ignore[arg-type]
        self._out.put(record.written(), self._time_s, self._put)
        if self._remaining:
            self._remaining -= 1
            if self._remaining == 0:
                self.peer = None

    def counts(self, taken: int, /) -> dict[str, int]:
        """Samples taken, and records that left."""
        return {"samples": taken, "records": self.records}

    def _put(self, data: bytes) -> None:
        if self.peer is not None:
            with contextlib.suppress(BlockingIOError, ConnectionError):
                self._socket.sendto(data, self.peer)
                self.records += 1

    def close(self) -> None:
        """Free the sockets."""
        self._socket.close()
        if self._http is not None:
            self._http.shutdown()
            self._http.server_close()


def opened(start: ForceStart) -> NetftServer:
    """One as it is started with the cell."""
    server = NetftServer(start.host, start.port, start.http_port, start.rate_hz, start.faults)
    server.status = start.status
    return server


def _taken(fault: OSError, host: str, port: int) -> OutputError:
    return OutputError(
        f"the port cannot be opened: {fault.strerror or fault}",
        where=f"{host}:{port}",
        hint="Is another program there? A port below 1024 needs rights; 0 takes a free one",
    )


def _document_server(host: str, port: int, document: bytes) -> http.server.ThreadingHTTPServer:
    handler = type("Handler", (_DocumentHandler,), {"document": document})
    return http.server.ThreadingHTTPServer((host, port), handler)


class _DocumentHandler(http.server.BaseHTTPRequestHandler):
    document: bytes  # Of a subclass: the server makes a handler for each request

    def do_GET(self) -> None:
        if self.path != "/netftapi2.xml":
            self.send_error(404)
            return
        self.send_response(200)
        self.send_header("Content-Type", "text/xml")
        self.send_header("Content-Length", str(len(self.document)))
        self.end_headers()
        self.wfile.write(self.document)

    def log_message(self, *_: object) -> None:
        """Say nothing."""
