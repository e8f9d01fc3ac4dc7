"""Sends measured poses as the neutral tracker datagram: the end of a bridge between a tracker and the loop."""

from __future__ import annotations

import contextlib
import socket

from counterflex.core.errors import OutputError
from counterflex.protocols.tracker.telegram import TrackerPose, write_pose


class PoseForwarder:
    """A socket that datagrams leave by.

    Args:
        peer: Where they go.

    Attributes:
        sent: Datagrams sent.

    Raises:
        OutputError: The address cannot be used.
    """

    def __init__(self, peer: tuple[str, int]) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.connect(peer)
        except OSError as fault:
            self._socket.close()
            raise OutputError(
                f"the receiver of poses cannot be addressed: {fault.strerror or fault}", where=f"{peer[0]}:{peer[1]}"
            ) from fault
        self.sent = 0

    def send(self, measured: TrackerPose) -> None:
        """Send a measurement; nobody listening is no fault.

        Raises:
            ProtocolError: A number does not fit its field.
        """
        data = write_pose(measured)
        with contextlib.suppress(ConnectionError, BlockingIOError):
            self._socket.send(data)
        self.sent += 1

    def close(self) -> None:
        """Free the socket."""
        self._socket.close()
