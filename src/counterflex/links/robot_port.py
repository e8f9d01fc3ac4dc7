"""The UDP port that one robot controller talks to: drains to the newest datagram, answers its sender, counts."""

from __future__ import annotations

import socket
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from counterflex.core.errors import OutputError
from counterflex.wire.decimal_kernel import Bytes


class Verdict(IntEnum):
    """What a datagram is."""

    MALFORMED = -1
    """No message of this protocol; its sender is not believed to be the controller."""
    OLD = 0
    """Good, but not newer than what was there."""
    NEW = 1
    """To be answered."""


@dataclass(eq=False)
class Counters:
    """What came, since the link was opened.

    Attributes:
        telegrams: Good ones that were answered or could have been.
        drained: Older ones that were passed over because a newer one was there.
        malformed: In all.
        malformed_in_a_row: Until the last good one.
        foreign: From an address that is not the controller's.
        old: With a counter at or before the last one.
        lost: Cycles without a telegram, by the counter.
        late_at_robot: What the controller itself counts as late (Delay), last value.
    """

    telegrams: int = 0
    drained: int = 0
    malformed: int = 0
    malformed_in_a_row: int = 0
    foreign: int = 0
    old: int = 0
    lost: int = 0
    late_at_robot: int = 0


class RobotPort:
    """A bound port, and the one peer it belongs to.

    Args:
        host: Address to listen on.
        port: UDP port; 0 takes a free one.
        largest: Longest datagram, bytes.
        peers: Addresses whose telegrams are taken; None takes the first that comes, and from then on only that one.

    Attributes:
        address: Where telegrams are expected.
        peer: Who is answered, or None before the first good telegram.
        data: (largest,) bytes of the datagram that is being read.
        counters: See :class:`Counters`.

    Raises:
        OutputError: The port cannot be bound.
    """

    def __init__(self, host: str, port: int, largest: int, peers: tuple[str, ...] | None = None) -> None:
        self._peers = peers
        self.peer: tuple[str, int] | None = None
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((host, port))
        except OSError as fault:
            self._socket.close()
            raise OutputError(
                f"the port cannot be opened: {fault.strerror or fault}",
                where=f"{host}:{port}",
                hint="Is another sensor program running? One at a time answers a robot",
            ) from fault
        self.address: tuple[str, int] = self._socket.getsockname()
        self._bytes = bytearray(largest)
        self.data: Bytes = np.frombuffer(self._bytes, dtype=np.uint8)
        self.counters = Counters()

    def wait(self, timeout_s: float, read: Callable[[int], Verdict]) -> bool:
        """Wait for a datagram, then take all that are there.

        Args:
            timeout_s: Longest wait.
            read: Told the length of each datagram of the peer in :attr:`data`; keeps what it needs of it.

        Returns:
            Whether one of them was :attr:`Verdict.NEW`.
        """
        found = False
        self._socket.settimeout(timeout_s)
        while True:
            try:
                length, peer = self._socket.recvfrom_into(self._bytes)
            except (TimeoutError, BlockingIOError):
                return found
            except ConnectionError:
                continue
            self._socket.settimeout(0.0)
            if self._take(length, peer, read):
                self.counters.drained += int(found)
                found = True

    def _take(self, length: int, peer: tuple[str, int], read: Callable[[int], Verdict]) -> bool:
        counters = self.counters
        if self.peer is None:
            if self._peers is not None and peer[0] not in self._peers:
                counters.foreign += 1
                return False
        elif peer != self.peer:
            counters.foreign += 1
            return False
        verdict = read(length)
        if verdict == Verdict.MALFORMED:
            counters.malformed += 1
            counters.malformed_in_a_row += 1
            return False
        self.peer = peer
        counters.malformed_in_a_row = 0
        if verdict == Verdict.OLD:
            counters.old += 1
            return False
        return True

    def send(self, data: bytes | memoryview) -> bool:
        """Send to the peer; False where there is none yet or the system does not take it."""
        if self.peer is None:
            return False
        try:
            self._socket.sendto(data, self.peer)
        except (BlockingIOError, ConnectionError):
            return False
        return True

    def close(self) -> None:
        """Free the port."""
        self._socket.close()
