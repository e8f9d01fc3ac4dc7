"""A force sensor that sends a line of text over UDP for each sample: ``F fx fy fz mx my mz``, N and N m."""

from __future__ import annotations

import socket

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import OutputError
from counterflex.protocols.force.sensors import ForceSensorKind, Opening


class AsciiSensor:
    """The stream of one sensor.

    Args:
        opening: Where it is; ``values["start"]`` is the word that asks for the stream.

    Raises:
        OutputError: It cannot be addressed.
    """

    def __init__(self, opening: Opening) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            self._socket.connect((opening.host, opening.port))
            self._socket.send(str(opening.values["start"]).encode("ascii"))
        except OSError as fault:
            self._socket.close()
            raise OutputError(f"the force sensor cannot be addressed: {fault}", where=opening.host) from fault

    def receive(self) -> Float:
        """(k, 6) N, N m: what has come; a line of another form is left out."""
        samples = []
        while (line := self._line()) is not None:
            words = line.split()
            if len(words) == 7 and words[0] == b"F":
                samples.append([float(word) for word in words[1:]])
        return np.array(samples, dtype=np.float64).reshape(-1, 6)

    def _line(self) -> bytes | None:
        try:
            return self._socket.recv(256)
        except BlockingIOError:
            return None

    def close(self) -> None:
        """Free the socket."""
        self._socket.close()


SENSOR = ForceSensorKind("text lines over UDP", AsciiSensor, {"start": "GO"})
