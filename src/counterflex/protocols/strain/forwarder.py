"""Sends strains as the neutral datagram: the end of a bridge between strain terminals and the loop."""

from __future__ import annotations

import contextlib
import socket

from counterflex.core.arrays import Float
from counterflex.core.errors import OutputError
from counterflex.protocols.strain.telegram import StrainSample, write_strain


class StrainForwarder:
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
                f"the receiver of strains cannot be addressed: {fault.strerror or fault}", where=f"{peer[0]}:{peer[1]}"
            ) from fault
        self.sent = 0

    def send(self, time_ns: int, temperature_c: float, strain: Float) -> None:
        """Send a reading; nobody listening is no fault.

        Args:
            time_ns: Clock of the source.
            temperature_c: deg C, NaN where not measured.
            strain: (n,) dimensionless, NaN where a bridge shows no number.

        Raises:
            ProtocolError: A number does not fit its field.
        """
        self.sent += 1
        data = write_strain(StrainSample(self.sent & 0xFFFFFFFF, time_ns, 0, temperature_c, strain))
        with contextlib.suppress(ConnectionError, BlockingIOError):
            self._socket.send(data)

    def close(self) -> None:
        """Free the socket."""
        self._socket.close()
