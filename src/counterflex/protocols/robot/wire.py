"""Carrier of the datagrams of a robot's port: the network, or whatever stands in its place."""

from __future__ import annotations

import socket
import sys
import time
from typing import Any, Final, Protocol

import numpy as np

from counterflex.core.arrays import Int
from counterflex.core.errors import InputError, OutputError
from counterflex.core.records import records
from counterflex.protocols.decimal_kernel import ByteRows, Bytes
from counterflex.protocols.system import system_calls
from counterflex.protocols.system.system_calls import await_datagrams

_ROWS: Final = 8


class Wire(Protocol):
    """Datagrams in and out."""

    address: tuple[str, int]  # where datagrams are expected
    most: int  # datagrams that one call of receive takes at most
    rows: list[Bytes]  # bytes of each
    lengths: Int  # of each
    senders: Int  # ``address << 16 | port`` of each
    names: ByteRows  # (most, NAME) each sender's address as the system has it

    @property
    def target(self) -> int:
        """Socket for a kernel that sends by itself; -1: use :meth:`send`."""

    def now_ns(self) -> int:
        """Monotonic clock, ns, that a wait is measured by."""

    def receive(self, timeout_ns: int, /) -> int:
        """Take what came, at most :attr:`most` datagrams; waits for the first one."""

    def send(self, data: bytes | memoryview, peer: tuple[str, int], /) -> bool:
        """Send a datagram; False where it is not taken."""

    def close(self) -> None:
        """End."""


class UdpWire:
    """A bound UDP port, see :class:`Wire`.

    Args:
        host: Address to listen on.
        port: 0 takes a free one.
        largest: Longest datagram, bytes.

    Raises:
        OutputError: The port cannot be bound.
    """

    def __init__(self, host: str, port: int, largest: int) -> None:
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
        self.rows: list[Bytes] = list(self._inbox)
        self._views: list[memoryview] = [row.data for row in self.rows]
        self._many = system_calls.THERE
        self.most = _ROWS if self._many else 1
        self._socket.setblocking(False)
        self.names: ByteRows = np.zeros((_ROWS, system_calls.NAME), dtype=np.uint8)
        self._pieces, self._heads = system_calls.heads(self._inbox, self.names)
        self.lengths: Int = np.zeros(_ROWS, dtype=np.int64)
        self.senders: Int = np.zeros(_ROWS, dtype=np.int64)
        self.window = records(system_calls.WINDOW)  # When to poll, see :meth:`RobotPort.poll`

    now_ns = staticmethod(time.monotonic_ns)

    def receive(self, timeout_ns: int) -> int:
        """See :class:`Wire`."""
        if self._many:
            return await_datagrams(
                self._fd, self._heads, self.names, self.lengths, self.senders, timeout_ns, self.window
            )
        self._socket.settimeout(max(0, timeout_ns) * 1e-9)
        try:
            self.lengths[0], (host, port) = self._socket.recvfrom_into(self._views[0])
        except OSError:  # none came, or the last answer was refused
            return 0
        self.senders[0] = host_address(host) << 16 | port
        return 1

    def arrays(self) -> dict[str, np.ndarray[Any, Any]]:
        """Arguments of :func:`.await_datagrams` by name, and the datagrams."""
        own = self._heads, self.names, self.lengths, self.senders, self._inbox, self.window
        return dict(zip(("heads", "names", "lengths", "senders", "inbox", "window"), own, strict=True))

    def send(self, data: bytes | memoryview, peer: tuple[str, int]) -> bool:
        """See :class:`Wire`."""
        try:
            self._socket.sendto(data, peer)
        except OSError:  # a cable that is pulled (no route) must not end the loop: it is then a line without telegrams
            return False
        return True

    @property
    def target(self) -> int:
        """See :class:`Wire`."""
        return self._fd if self._many else -1

    def close(self) -> None:
        """Free the port."""
        self._fd = -1
        self._socket.close()


def host_address(host: str) -> int:
    """IPv4 address of a host as a number. Raises InputError: there is no such host."""
    try:
        return int.from_bytes(socket.inet_aton(socket.gethostbyname(host)), "big")
    except OSError as fault:
        raise InputError("the controller's address is none", value=host) from fault
