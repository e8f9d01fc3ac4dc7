"""The end of a bridge between an instrument and the loop: a socket that datagrams leave by."""

from __future__ import annotations

import contextlib
import socket

from counterflex.core.errors import OutputError


class Forwarder:
    """Sends datagrams to one receiver.

    Args:
        peer: Where they go.
        what: Of the datagrams, for the message: ``poses``.

    Attributes:
        sent: Datagrams sent.

    Raises:
        OutputError: The address cannot be used.
    """

    def __init__(self, peer: tuple[str, int], what: str) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.connect(peer)
        except OSError as fault:
            self._socket.close()
            raise OutputError(
                f"the receiver of {what} cannot be addressed: {fault.strerror or fault}", where=f"{peer[0]}:{peer[1]}"
            ) from fault
        self.sent = 0

    def send(self, data: bytes) -> None:
        """Send a datagram; nobody listening is no fault."""
        self.sent += 1
        with contextlib.suppress(ConnectionError, BlockingIOError):
            self._socket.send(data)

    def close(self) -> None:
        """Free the socket."""
        self._socket.close()
