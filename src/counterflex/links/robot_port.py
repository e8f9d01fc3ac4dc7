"""The UDP port that one robot controller talks to: drains to the newest datagram, answers its sender, counts."""

from __future__ import annotations

import socket
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

import numpy as np

from counterflex.core.errors import InputError, OutputError
from counterflex.wire.decimal_kernel import Bytes

_MOST_DRAINED: Final = 512


class Verdict(IntEnum):
    """What a datagram is."""

    MALFORMED = -1
    """No message of this protocol; its sender is not believed to be the controller."""
    OLD = 0
    """Good, but not newer than what was there."""
    NEW = 1
    """To be answered."""
    ASTRAY = 2
    """Good, but its counter lies far from the last one's; perhaps of another session."""


_MALFORMED, _OLD, _NEW, _ASTRAY = Verdict.MALFORMED, Verdict.OLD, Verdict.NEW, Verdict.ASTRAY


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
        astray: With a counter far away from the last one.
        lost: Cycles without a telegram, by the counter.
        late_at_robot: What the controller itself counts as late (Delay), last value; -1 where it does not say.
    """

    telegrams: int = 0
    drained: int = 0
    malformed: int = 0
    malformed_in_a_row: int = 0
    foreign: int = 0
    old: int = 0
    astray: int = 0
    lost: int = 0
    late_at_robot: int = -1


class RobotPort:
    """A bound port, and the one peer it belongs to.

    Args:
        host: Address to listen on.
        port: UDP port; 0 takes a free one.
        largest: Longest datagram, bytes.
        peer: Address and port of the controller, port 0 for any: nobody else is listened to; None takes the first that
            sends a good telegram. From then on it is that address and port alone, until :meth:`forget`.

    Attributes:
        address: Where telegrams are expected.
        peer: Who is answered, or None before the first good telegram.
        data: (largest,) bytes of the datagram that is being read.
        counters: See :class:`Counters`.

    Raises:
        InputError: The peer's name is none.
        OutputError: The port cannot be bound.
    """

    def __init__(self, host: str, port: int, largest: int, peer: tuple[str, int] | None = None) -> None:
        self._allowed = None if peer is None else (_numeric(peer[0]), peer[1])
        self.peer: tuple[str, int] | None = None
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        if sys.platform == "win32":  # elsewhere a port that is bound cannot be bound again
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_EXCLUSIVEADDRUSE, 1)
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
        found, taken = False, 0
        end = time.monotonic() + timeout_s
        self._socket.settimeout(timeout_s)
        while taken < _MOST_DRAINED:
            try:
                length, peer = self._socket.recvfrom_into(self._bytes)
            except (TimeoutError, BlockingIOError):
                break
            except ConnectionError:
                continue
            taken += 1
            if self._take(length, peer, read):
                self.counters.drained += int(found)
                found = True
            # What is no telegram does not end the wait: rubbish must not look like a cycle without one.
            self._socket.settimeout(0.0 if found else max(0.0, end - time.monotonic()))
        return found

    def _take(self, length: int, peer: tuple[str, int], read: Callable[[int], Verdict]) -> bool:
        counters = self.counters
        if not self._known(peer):
            counters.foreign += 1
            return False
        verdict = read(length)
        if verdict == _MALFORMED:
            counters.malformed += 1
            counters.malformed_in_a_row += 1
            return False
        self.peer = peer
        counters.malformed_in_a_row = 0
        counters.old += verdict == _OLD
        counters.astray += verdict == _ASTRAY
        return verdict == _NEW

    def _known(self, peer: tuple[str, int]) -> bool:
        if self.peer is not None:
            return peer == self.peer
        allowed = self._allowed
        return allowed is None or (peer[0] == allowed[0] and allowed[1] in (0, peer[1]))

    def forget(self) -> None:
        """Whoever sends the next good telegram is the controller, as far as it is allowed to be."""
        self.peer = None

    def send(self, data: bytes | memoryview) -> bool:
        """Send to the peer; False where there is none yet or the system does not take it."""
        if self.peer is None:
            return False
        try:
            self._socket.sendto(data, self.peer)
        except OSError:  # a cable that is pulled (no route) must not end the loop: it is then a line without telegrams
            return False
        return True

    def close(self) -> None:
        """Free the port."""
        self._socket.close()


def _numeric(host: str) -> str:
    """Numeric address of a host.

    Raises:
        InputError: There is no such host.
    """
    try:
        return socket.gethostbyname(host)
    except OSError as fault:
        raise InputError("the controller's address is none", value=host) from fault
