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

from counterflex.core.arrays import Int
from counterflex.core.errors import InputError, OutputError
from counterflex.protocols.decimal_kernel import ByteRows, Bytes
from counterflex.protocols.system import system_calls
from counterflex.protocols.system.system_calls import await_datagrams

_MOST_DRAINED: Final = 512
_ROWS: Final = 8
_NOBODY: Final = -1


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
        stranger: Who sent the last of these, ``address << 16 | port``.
        old: With a counter at or before the last one.
        astray: With a counter far away from the last one.
        lost: Cycles without a telegram, by the counter.
        repeated: Unreadable ones that were answered all the same, with what had been said before.
        late_at_robot: What the controller itself counts as late (Delay), last value; -1 where it does not say.
        sender: The controller: its IPv4 address times 65536, plus its port; -1: nobody yet.
    """

    telegrams: int = 0
    drained: int = 0
    malformed: int = 0
    malformed_in_a_row: int = 0
    foreign: int = 0
    stranger: int = _NOBODY
    old: int = 0
    astray: int = 0
    lost: int = 0
    repeated: int = 0
    late_at_robot: int = -1
    sender: int = _NOBODY


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
        data: (largest,) bytes of the datagram that is being read.
        name: (NAME,) the peer's address, as the system has it.
        counters: See :class:`Counters`.

    Raises:
        InputError: The peer's name is none.
        OutputError: The port cannot be bound.
    """

    def __init__(self, host: str, port: int, largest: int, peer: tuple[str, int] | None = None) -> None:
        self._allowed = None if peer is None else (_number(peer[0]), peer[1])
        self._sender = _NOBODY
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
        self._fd = self._socket.fileno()
        self._inbox: ByteRows = np.zeros((_ROWS, largest), dtype=np.uint8)
        self._rows: list[Bytes] = list(self._inbox)
        self._views: list[memoryview] = [row.data for row in self._rows]
        self.data: Bytes = self._rows[0]
        self._many = system_calls.THERE
        self._most = _ROWS if self._many else 1
        self._socket.setblocking(False)
        self._names: ByteRows = np.zeros((_ROWS, system_calls.NAME), dtype=np.uint8)
        self._pieces, self._heads = system_calls.heads(self._inbox, self._names)
        self._lengths: Int = np.zeros(_ROWS, dtype=np.int64)
        self._senders: Int = np.zeros(_ROWS, dtype=np.int64)
        self.name: Bytes = np.zeros(system_calls.NAME, dtype=np.uint8)
        self._waiting: Int = np.zeros(system_calls.WAITING, dtype=np.int64)
        self.counters = Counters()

    @property
    def peer(self) -> tuple[str, int] | None:
        """Who is answered, or None before the first good telegram."""
        if self._sender == _NOBODY:
            return None
        return socket.inet_ntoa((self._sender >> 16).to_bytes(4, "big")), self._sender & 0xFFFF

    def wait(self, timeout_s: float, read: Callable[[int], Verdict]) -> bool:
        """Wait for a datagram, then take all that are there.

        Args:
            timeout_s: Longest wait.
            read: Told the length of each datagram of the peer in :attr:`data`; keeps what it needs of it.

        Returns:
            Whether one of them was :attr:`Verdict.NEW`.
        """
        received, taken, remaining_ns = False, 0, int(timeout_s * 1e9)
        end = time.monotonic_ns() + remaining_ns
        while taken < _MOST_DRAINED:
            count = self._receive(remaining_ns)
            for row in range(count):
                if self._take(row, read):
                    self.counters.drained += int(received)
                    received = True
            taken += count
            if count == self._most:  # there may be more
                remaining_ns = 0
                continue
            # What is no telegram does not end the wait: rubbish must not look like a cycle without one.
            remaining_ns = 0 if received else end - time.monotonic_ns()
            if remaining_ns <= 0:
                break
        return received

    def _receive(self, timeout_ns: int) -> int:
        """Datagrams that came, in the rows of the inbox; waits for the first one."""
        if self._many:
            return await_datagrams(
                self._fd, self._heads, self._names, self._lengths, self._senders, timeout_ns, self._waiting
            )
        self._socket.settimeout(max(0, timeout_ns) * 1e-9)
        try:
            self._lengths[0], (host, port) = self._socket.recvfrom_into(self._views[0])
        except OSError:  # none came, or the last answer was refused
            return 0
        self._senders[0] = _number(host) << 16 | port
        return 1

    def _take(self, row: int, read: Callable[[int], Verdict]) -> bool:
        counters, sender = self.counters, int(self._senders[row])
        if sender != self._sender and not self._may_speak(sender):
            counters.foreign += 1
            counters.stranger = sender
            return False
        self.data = self._rows[row]
        verdict = read(int(self._lengths[row]))
        if verdict is _MALFORMED:
            counters.malformed += 1
            counters.malformed_in_a_row += 1
            return False
        if sender != self._sender:
            self._sender = self.counters.sender = sender
            self.name[:] = self._names[row]
        counters.malformed_in_a_row = 0
        if verdict is _NEW:
            return True
        counters.old += verdict == _OLD
        counters.astray += verdict == _ASTRAY
        return False

    def _may_speak(self, sender: int) -> bool:
        if self._sender != _NOBODY:
            return False
        allowed = self._allowed
        return allowed is None or (sender >> 16 == allowed[0] and allowed[1] in (0, sender & 0xFFFF))

    def forget(self) -> None:
        """Whoever sends the next good telegram is the controller, as far as it is allowed to be."""
        self._sender = self.counters.sender = _NOBODY

    def send(self, data: bytes | memoryview) -> bool:
        """Send to the peer; False where there is none yet or the system does not take it."""
        peer = self.peer
        if peer is None:
            return False
        try:
            self._socket.sendto(data, peer)
        except OSError:  # a cable that is pulled (no route) must not end the loop: it is then a line without telegrams
            return False
        return True

    @property
    def target(self) -> int:
        """Of the socket, for a kernel that sends to :attr:`name` itself; -1: there is nobody, or use :meth:`send`."""
        return self._fd if self._many and self._sender != _NOBODY else -1

    def close(self) -> None:
        """Free the port."""
        self._fd = -1
        self._socket.close()


def _number(host: str) -> int:
    """IPv4 address of a host as a number.

    Raises:
        InputError: There is no such host.
    """
    try:
        return int.from_bytes(socket.inet_aton(socket.gethostbyname(host)), "big")
    except OSError as fault:
        raise InputError("the controller's address is none", value=host) from fault
