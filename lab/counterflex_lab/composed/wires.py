"""Datagrams without sockets: what arrives waits in a queue, and waiting for it lets the virtual world go on."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Int
from counterflex.protocols.decimal_kernel import ByteRows, Bytes
from counterflex.protocols.system.datagrams import INBOX, ROWS, SIZE
from counterflex.protocols.system.system_calls import HEAD, NAME

_MOST_WAITING: Final = 200
"""Datagrams of a telegram's length that the buffer of a socket holds."""
_TAKEN: Final = 8


class VirtualWire:
    """The robot's port, as :class:`counterflex.protocols.robot.wire.Wire`.

    Args:
        address: Where it listens.
        largest: Longest datagram, bytes.
        wait: Lets the world go on until a datagram waits, at most so many ns; then the process runs again.
        send: Takes an answer and whom it is for.
        clock_ns: Monotonic clock of the loop's computer.

    Attributes:
        taken: Who sent what was taken since the loop last waited.
        closed: Nobody listens any more.
    """

    def __init__(
        self,
        address: tuple[str, int],
        largest: int,
        wait: Callable[[int], None],
        send: Callable[[bytes, tuple[str, int]], None],
        clock_ns: Callable[[], int],
    ) -> None:
        self.address, self.most = address, _TAKEN
        self._inbox: ByteRows = np.zeros((_TAKEN, largest), dtype=np.uint8)
        self.rows: list[Bytes] = list(self._inbox)
        self._views = [row.data for row in self.rows]
        self.names: ByteRows = np.zeros((_TAKEN, NAME), dtype=np.uint8)
        self.lengths: Int = np.zeros(_TAKEN, dtype=np.int64)
        self.senders: Int = np.zeros(_TAKEN, dtype=np.int64)
        self._wait, self._send, self.now_ns = wait, send, clock_ns
        self.waiting: deque[tuple[bytes, int]] = deque()
        self.taken: set[int] = set()
        self.closed = False

    @property
    def target(self) -> int:
        """There is no socket."""
        return -1

    def put(self, data: bytes, sender: int) -> None:
        """A datagram arrives; where the buffer is full it is lost.

        Args:
            data: Its bytes.
            sender: ``address << 16 | port``.
        """
        if len(self.waiting) < _MOST_WAITING and not self.closed:
            self.waiting.append((data, sender))

    def receive(self, timeout_ns: int) -> int:
        """Take what came; waits for the first one."""
        self.taken = set() if timeout_ns > 0 else self.taken
        if not self.waiting or timeout_ns > 0:
            self._wait(timeout_ns)
        count = 0
        while self.waiting and count < _TAKEN:
            data, sender = self.waiting.popleft()
            length = min(len(data), len(self._views[count]))
            self._views[count][:length] = data[:length]
            self.lengths[count], self.senders[count] = length, sender
            self.taken.add(sender)
            count += 1
        return count

    def send(self, data: bytes | memoryview, peer: tuple[str, int]) -> bool:
        """Send an answer."""
        self._send(bytes(data), peer)
        return True

    def close(self) -> None:
        """Nobody listens any more."""
        self.closed = True


class VirtualInbox:
    """An instrument's datagrams, as :class:`counterflex.protocols.system.datagrams.Inbox`.

    Args:
        host: IPv4 address of the instrument as a number.
    """

    def __init__(self, host: int = 0x7F000001) -> None:
        self.data: ByteRows = np.zeros((ROWS, SIZE), dtype=np.uint8)
        self.lengths: Int = np.zeros(ROWS, dtype=np.int64)
        self.hosts: Int = np.full(ROWS, host, dtype=np.int64)
        self._views = [row.data for row in self.data]
        self.many, self.fd = False, -1
        self.waiting: deque[bytes] = deque(maxlen=4 * _MOST_WAITING)
        self.sent: list[bytes] = []

    def arrays(self) -> dict[str, np.ndarray[Any, Any]]:
        """Arrays of an inbox; the kernel that would call the system with them is never asked to."""
        heads: Int = np.zeros((ROWS, HEAD), dtype=np.int64)
        names: ByteRows = np.zeros((ROWS, NAME), dtype=np.uint8)
        return dict(zip(INBOX, (heads, names, self.lengths, self.hosts, self.data), strict=True))

    def take(self) -> int:
        """Take what is there."""
        count = 0
        while self.waiting and count < ROWS:
            data = self.waiting.popleft()
            self._views[count][: len(data)] = data
            self.lengths[count] = len(data)
            count += 1
        return count

    def send(self, data: bytes) -> None:
        """Keep what is asked of the instrument."""
        self.sent.append(data)

    def close(self) -> None:
        """Nothing is open."""
