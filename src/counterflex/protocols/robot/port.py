"""The UDP port that one robot controller talks to: drains to the newest datagram, answers its sender, counts."""

from __future__ import annotations

import socket
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

import numpy as np

from counterflex.protocols.decimal_kernel import Bytes
from counterflex.protocols.robot.wire import UdpWire, Wire, host_address
from counterflex.protocols.system import system_calls

_MOST_DRAINED: Final = 512
_NOBODY: Final = -1


class Verdict(IntEnum):
    """Verdict on a datagram."""

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
    """Counts of datagrams since the link was opened."""

    telegrams: int = 0  # good ones that were answered or could have been
    drained: int = 0  # older ones that were passed over because a newer one was there
    malformed: int = 0  # in all
    malformed_in_a_row: int = 0  # until the last good one
    foreign: int = 0  # from an address that is not the controller's
    moved: int = 0  # of these, from another port of the controller's computer
    moved_port: int = 0  # the port of the last of them
    old: int = 0  # with a counter at or before the last one
    astray: int = 0  # with a counter far away from the last one
    lost: int = 0  # cycles without a telegram, by the counter
    repeated: int = 0  # unreadable ones that were answered all the same, with what had been said before
    late_at_robot: int = -1  # what the controller itself counts as late (Delay), last value; -1 where it does not say
    sender: int = _NOBODY  # the controller: its IPv4 address times 65536, plus its port; -1: nobody yet


class RobotPort:
    """A bound port, and the one peer it belongs to.

    Args:
        host: Address to listen on.
        port: UDP port; 0 takes a free one.
        largest: Longest datagram, bytes.
        peer: Address and port of the controller, port 0 for any: nobody else is listened to; None takes the first that
            sends a good telegram. From then on it is that address and port alone, after :meth:`forget` that address.
        wire: What carries the datagrams; None opens a UDP port.

    Attributes:
        address: Where telegrams are expected.
        data: (largest,) bytes of the datagram that is being read.
        name: (NAME,) the peer's address, as the system has it.
        counters: See :class:`Counters`.
        peer: Peer that is answered, or None before the first good telegram.

    Raises:
        InputError: The peer's name is none.
        OutputError: The port cannot be bound.
    """

    def __init__(
        self, host: str, port: int, largest: int, peer: tuple[str, int] | None = None, wire: Wire | None = None
    ) -> None:
        self._allowed = None if peer is None else (host_address(peer[0]), peer[1])
        self._sender = self._host = _NOBODY
        self.peer: tuple[str, int] | None = None
        self._wire = UdpWire(host, port, largest) if wire is None else wire
        self.address: tuple[str, int] = self._wire.address
        self.data: Bytes = self._wire.rows[0]
        self.name: Bytes = np.zeros(system_calls.NAME, dtype=np.uint8)
        self.counters = Counters()

    def wait(self, timeout_s: float, read: Callable[[int], Verdict], waiting: int = 0) -> bool:
        """Wait for a datagram, then take all that are there.

        Args:
            read: Told the length of each datagram of the peer in :attr:`data`; keeps what it needs of it.
            waiting: Datagrams that were taken from the wire already, and not looked at.

        Returns:
            Whether one of them was :attr:`Verdict.NEW`.
        """
        received, taken, remaining_ns = False, 0, int(timeout_s * 1e9)
        end = self._wire.now_ns() + remaining_ns
        while taken < _MOST_DRAINED:
            count, waiting = waiting or self._wire.receive(remaining_ns), 0
            for row in range(count):
                if self._take(row, read):
                    self.counters.drained += int(received)
                    received = True
            taken += count
            if count == self._wire.most:  # there may be more
                remaining_ns = 0
                continue
            # What is no telegram does not end the wait: rubbish must not look like a cycle without one.
            remaining_ns = 0 if received else end - self._wire.now_ns()
            if remaining_ns <= 0:
                break
        return received

    def _take(self, row: int, read: Callable[[int], Verdict]) -> bool:
        counters, sender = self.counters, int(self._wire.senders[row])
        if sender != self._sender and not self._may_speak(sender):
            counters.foreign += 1
            if self._sender != _NOBODY and sender >> 16 == self._host:
                counters.moved += 1
                counters.moved_port = sender & 0xFFFF
            return False
        self.data = self._wire.rows[row]
        verdict = read(int(self._wire.lengths[row]))
        if verdict is _MALFORMED:
            counters.malformed += 1
            counters.malformed_in_a_row += 1
            return False
        if sender != self._sender:
            self._sender = self.counters.sender = sender
            self.peer = socket.inet_ntoa((sender >> 16).to_bytes(4, "big")), sender & 0xFFFF
            self._host = sender >> 16
            self.name[:] = self._wire.names[row]
        counters.malformed_in_a_row = 0
        if verdict is _NEW:
            return True
        counters.old += verdict == _OLD
        counters.astray += verdict == _ASTRAY
        return False

    def _may_speak(self, sender: int) -> bool:
        if self._sender != _NOBODY or self._host not in (_NOBODY, sender >> 16):
            return False
        allowed = self._allowed
        return allowed is None or (sender >> 16 == allowed[0] and allowed[1] in (0, sender & 0xFFFF))

    def poll(self, period_s: float, most_s: float) -> None:
        """Poll when a telegram is due instead of sleeping; a wire that is no UDP port goes on sleeping.

        Args:
            period_s: Cycle of the controller.
            most_s: Longest time before and behind that moment; 0 sleeps.
        """
        if isinstance(self._wire, UdpWire):
            self._wire.window["period_ns"], self._wire.window["most_ns"] = round(period_s * 1e9), round(most_s * 1e9)

    def forget(self) -> None:
        """Take the next good telegram of the controller's computer, never of another, as a session on any port."""
        self._sender = self.counters.sender = _NOBODY
        self.peer = None

    def send(self, data: bytes | memoryview) -> bool:
        """Send to the peer; False where there is none yet or the system does not take it."""
        return self.peer is not None and self._wire.send(data, self.peer)

    @property
    def sender(self) -> int:
        """Who is answered, as :attr:`Counters.sender`; -1: nobody yet."""
        return self._sender

    @property
    def wire(self) -> Wire:
        """Carrier of the datagrams."""
        return self._wire

    @property
    def target(self) -> int:
        """Of the socket, for a kernel that sends to :attr:`name` itself; -1: there is nobody, or use :meth:`send`."""
        return -1 if self._sender == _NOBODY else self._wire.target

    def close(self) -> None:
        """Free the port."""
        self._wire.close()
