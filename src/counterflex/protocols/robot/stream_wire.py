"""Carrier of the messages of a controller that speaks over TCP: it is connected to, or connects itself."""

from __future__ import annotations

import select
import socket
import time
from collections.abc import Callable
from typing import Final

import numpy as np

from counterflex.core.arrays import Int
from counterflex.core.errors import OutputError
from counterflex.protocols.decimal_kernel import ByteRows, Bytes
from counterflex.protocols.robot.wire import host_address
from counterflex.protocols.system import system_calls

_CHUNK: Final = 1 << 16
NO_MESSAGE: Final = -1
"""Length of what begins no message."""


def line_length(data: bytes) -> int:
    """Length of a message that ends with a line feed, the end included; 0 where that has not come yet."""
    return data.find(b"\n") + 1


class StreamWire:
    """A TCP connection as a :class:`counterflex.protocols.robot.wire.Wire`; an ended one is opened again.

    What cannot be cut into messages ends the connection: behind it no byte is known to begin one. A controller that
    connects once more, from the same computer, has begun again: the connection before may never end by itself.

    Args:
        host: Address to listen on.
        port: Likewise, 0 takes a free one.
        largest: Longest message, bytes.
        length: Told the bytes that are there; returns the length of the message that they begin with, 0 where it is
            not whole yet, :data:`NO_MESSAGE` where they begin none.
        peer: Address and port of a controller that listens and is connected to. Port 0, or None: the controller
            connects itself, from that address, or from any.

    Raises:
        InputError: The controller's address is none.
        OutputError: The port cannot be opened.
    """

    most, target = 1, -1

    def __init__(
        self, host: str, port: int, largest: int, length: Callable[[bytes], int], peer: tuple[str, int] | None = None
    ) -> None:
        self._length, self._largest = length, largest
        self._host = None if peer is None else host_address(peer[0])
        self._listener: socket.socket | None = None
        self._stream: socket.socket | None = None
        self._kept = b""
        self.address: tuple[str, int] = peer or (host, port)
        if peer is None or peer[1] == 0:
            try:
                self._listener = socket.create_server((host, port), backlog=1)
            except OSError as fault:
                raise OutputError(
                    f"the port cannot be opened: {fault.strerror or fault}", where=f"{host}:{port}"
                ) from fault
            self._listener.setblocking(False)
            self.address = self._listener.getsockname()
        self._inbox: ByteRows = np.zeros((1, largest), dtype=np.uint8)
        self.rows: list[Bytes] = list(self._inbox)
        self.lengths: Int = np.zeros(1, dtype=np.int64)
        self.senders: Int = np.zeros(1, dtype=np.int64)
        self.names: ByteRows = np.zeros((1, system_calls.NAME), dtype=np.uint8)

    now_ns = staticmethod(time.monotonic_ns)

    def receive(self, timeout_ns: int) -> int:
        """See :class:`counterflex.protocols.robot.wire.Wire`."""
        end = self.now_ns() + max(0, timeout_ns)
        while not self._message():
            left_s = max(0, end - self.now_ns()) * 1e-9
            if self._listener is None and self._stream is None:
                self._connect(left_s)
            else:
                ready = select.select([one for one in (self._listener, self._stream) if one], [], [], left_s)[0]
                if self._listener in ready:
                    self._accept()
                elif ready:
                    self._take()
            if self.now_ns() >= end:
                return int(self._message())
        return 1

    def _message(self) -> bool:
        """Move the first whole message, if there is one, to where it is read."""
        if not self._kept:
            return False
        length = self._length(self._kept)
        if length < 0 or max(length, len(self._kept) if length == 0 else 0) > self._largest:
            self._end()
            return False
        self._inbox[0, :length] = np.frombuffer(self._kept[:length], dtype=np.uint8)
        self.lengths[0], self._kept = length, self._kept[length:]
        return length > 0

    def _connect(self, wait_s: float) -> None:
        try:
            self._begin(socket.create_connection(self.address, timeout=max(wait_s, 1e-3)), self.address)
        except OSError:  # a controller that is off is a cycle without a telegram
            time.sleep(wait_s)

    def _accept(self) -> None:
        assert self._listener is not None
        try:
            stream, name = self._listener.accept()
            owner = self._host if self._stream is None else int(self.senders[0]) >> 16
            if owner in (None, host_address(name[0])):
                self._begin(stream, name)
            else:  # it would hold the one place that the controller needs
                stream.close()
        except OSError:  # it went away at once
            return

    def _begin(self, stream: socket.socket, name: tuple[str, int]) -> None:
        self._end()
        stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)  # an answer must not wait for the next
        stream.setblocking(False)
        self._stream, self.senders[0] = stream, host_address(name[0]) << 16 | name[1]

    def _take(self) -> None:
        assert self._stream is not None
        try:
            data = self._stream.recv(_CHUNK)
        except OSError:
            data = b""
        if data:
            self._kept += data
        else:
            self._end()

    def _end(self) -> None:
        if self._stream is not None:
            self._stream.close()
        self._stream, self._kept = None, b""

    def send(self, data: bytes | memoryview, _: tuple[str, int]) -> bool:
        """See :class:`counterflex.protocols.robot.wire.Wire`; an answer that is not taken whole ends the connection."""
        if self._stream is None:
            return False
        try:
            if self._stream.send(data) == len(data):
                return True
        except OSError:
            pass
        self._end()
        return False

    def close(self) -> None:
        """Free the port."""
        self._end()
        if self._listener is not None:
            self._listener.close()
