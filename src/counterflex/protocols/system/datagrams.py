"""All datagrams that wait at a socket, with one system call where there is one, into memory that is allocated once."""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Iterator
from typing import Any, Final, Protocol

import numpy as np

from counterflex.core.arrays import Int
from counterflex.core.errors import OutputError
from counterflex.core.records import Records
from counterflex.protocols.decimal_kernel import ByteRows
from counterflex.protocols.system import system_calls

ROWS: Final = 64
SIZE: Final = 2048
"""Bytes that are kept of a datagram; none of the protocols has longer ones."""

INBOX: Final = ("heads", "names", "lengths", "hosts", "datagrams")
"""Names of the arrays of an inbox in a kernel's table."""


class Inbox(Protocol):
    """Datagrams of an instrument, see :class:`Datagrams`; one that is no socket says that they are taken one by one."""

    data: ByteRows
    lengths: Int
    hosts: Int
    many: bool

    @property
    def fd(self) -> int:
        """Of the socket; -1 where there is none."""

    def arrays(self) -> dict[str, np.ndarray[Any, Any]]:
        """Arrays of :data:`INBOX`."""

    def take(self) -> int:
        """Take what is there, at most ROWS."""

    def send(self, data: bytes, /) -> None:
        """Send to the peer that the socket is connected to."""

    def close(self) -> None:
        """End."""


class Datagrams:
    """Datagrams that came to a UDP socket of IPv4.

    Args:
        own: The socket; made non-blocking.

    Attributes:
        data: (ROWS, SIZE) bytes, one datagram in a row; what lies behind its end means nothing.
        lengths: (ROWS,) of each, at most SIZE.
        hosts: (ROWS,) sender's IPv4 address as a number, see :func:`host_number`.
        many: They are taken with one system call, in a compiled kernel over :meth:`arrays`.
    """

    def __init__(self, own: socket.socket) -> None:
        own.setblocking(False)
        self._socket = own
        self.data: ByteRows = np.zeros((ROWS, SIZE), dtype=np.uint8)
        self.lengths: Int = np.zeros(ROWS, dtype=np.int64)
        self.hosts: Int = np.zeros(ROWS, dtype=np.int64)
        self._views: list[memoryview] = [row.data for row in self.data]
        self.many = system_calls.THERE
        self._names: ByteRows = np.zeros((ROWS, system_calls.NAME), dtype=np.uint8)
        self._pieces, self._heads = system_calls.heads(self.data, self._names)

    @property
    def fd(self) -> int:
        """Of the socket; -1 where it is closed."""
        return self._socket.fileno()

    def send(self, data: bytes) -> None:
        """Send to the peer that the socket is connected to."""
        self._socket.send(data)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def arrays(self) -> dict[str, np.ndarray[Any, Any]]:
        """Arrays of :data:`INBOX`, as a kernel that calls the system itself takes them."""
        own = self._heads, self._names, self.lengths, self.hosts, self.data
        return dict(zip(INBOX, own, strict=True))

    def take(self) -> int:
        """Take what is there, at most ROWS; never waits, never raises. Call again where it returns ROWS.

        Returns:
            Datagrams taken.
        """
        if self.many:
            return system_calls.receive(self.fd, self._heads, self._names, self.lengths, self.hosts)
        return self._one_by_one()

    def _one_by_one(self) -> int:
        count = 0
        while count < ROWS:
            try:
                length, peer = self._socket.recvfrom_into(self._views[count])
            except ConnectionError:
                continue
            except OSError:
                break
            self.lengths[count], self.hosts[count] = length, host_number(peer[0])
            count += 1
        return count


class DatagramLink:
    """Receiver of one instrument: its inbox, whom it listens to, and what its kernel counts.

    Args:
        inbox: Takes the datagrams.
        received: (1,) record of the instrument's kernel, with order, host, lost, malformed and foreign; changed.
        peers: Addresses that are listened to; None takes the first that sends a good datagram.
    """

    def __init__(self, inbox: Inbox, received: Records, peers: tuple[str, ...] | None = None) -> None:
        self._inbox, self._received = inbox, received
        self._allowed: Int = np.array([host_number(peer) for peer in peers or ()], dtype=np.int64)
        received["order"]["newest"] = received["host"] = -1

    @property
    def lost(self) -> int:
        """Datagrams lost, in all."""
        return int(self._received["lost"][0])

    @property
    def malformed(self) -> int:
        """Datagrams that are none, in all."""
        return int(self._received["malformed"][0])

    @property
    def foreign(self) -> int:
        """Datagrams from another address."""
        return int(self._received["foreign"][0])

    def close(self) -> None:
        """Free the port."""
        self._inbox.close()


def batches(inbox: Inbox) -> Iterator[int]:
    """Take what waits, at most ROWS at a time; the number of datagrams of each batch."""
    count = ROWS
    while count == ROWS:
        count = inbox.take()
        if count:
            yield count


def listening(
    host: str, port: int, what: str = "the port", hint: str = "Is another program listening there?"
) -> tuple[Datagrams, tuple[str, int]]:
    """Inbox of a port, 0 for a free one, and the address at which it listens.

    Raises:
        OutputError: ``what`` cannot be opened.
    """
    own = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        own.bind((host, port))
    except OSError as fault:
        own.close()
        raise OutputError(
            f"{what} cannot be opened: {fault.strerror or fault}", where=f"{host}:{port}", hint=hint
        ) from fault
    return Datagrams(own), own.getsockname()


def host_number(host: str) -> int:
    """IPv4 address or name of a computer as a number; -1 where it cannot be found."""
    with contextlib.suppress(OSError):
        return int.from_bytes(socket.inet_aton(socket.gethostbyname(host)), "big")
    return -1
