"""Listening sockets of a server: connections of strangers are few, short, and taken a few at a time.

A server of one event loop looks at every connection that has sent something before it looks at the first one again. A
thousand strangers at once would make an operator wait for all of them, so their number is bounded here, before TLS and
before anything is read. Who has logged in is not counted.
"""

from __future__ import annotations

import contextlib
import ipaddress
import socket
import sys
import time
from collections import Counter
from collections.abc import Callable
from typing import Any, Final

STRANGERS: Final = 32
"""Open connections that nobody has logged in on. A further one ends the oldest of the address that has most of them."""
KNOWN: Final = 256
"""Open connections of users; further ones count as those of strangers."""
PATIENCE_S: Final = 15.0
"""Age at which a stranger's connection is ended: enough to log in by a slow link."""
AT_A_TIME: Final = 4
"""Connections taken in one pass of the event loop (``backlog`` of asyncio). A login that is refused takes some 2 ms."""
QUEUE: Final = 512
"""Connections that wait in the kernel to be taken."""


def network_of(host: str) -> str:
    """Return the address that strangers are counted by: of IPv6 the network of 64 bits, which one computer may own."""
    try:
        address = ipaddress.ip_address(host.split("%")[0])
    except ValueError:
        return host
    if isinstance(address, ipaddress.IPv4Address):
        return host
    mapped = address.ipv4_mapped
    return str(mapped or ipaddress.ip_network((address, 64), strict=False).network_address)


class Door:
    """Counts the connections of a server."""

    def __init__(self, clock_s: Callable[[], float] = time.monotonic) -> None:
        self._clock_s = clock_s
        self._strangers: dict[Any, tuple[float, _Connection]] = {}  # in the order of their ages
        self._known: set[Any] = set()
        self._listening: list[_Listening] = []

    def listen(self, host: str, port: int) -> list[socket.socket]:
        """Open the listening sockets of a host; of a free port (0) the first address only.

        Raises:
            OSError: The port cannot be opened.
        """
        places = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
        for family, kind, protocol, _, address in places if port else places[:1]:
            one = _Listening(family, kind, protocol)
            one.door = self
            self._listening.append(one)
            try:
                if sys.platform != "win32":
                    one.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                if family == socket.AF_INET6:
                    one.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
                one.bind(address)
            except OSError:
                for each in self._listening:
                    each.close()
                raise
        return list(self._listening)

    def widen(self) -> None:
        """Let more connections wait in the kernel than are taken at a time; after the event loop listens."""
        for one in self._listening:
            one.listen(QUEUE)

    def count(self, connection: _Connection, address: Any) -> None:
        """Count a new connection; where there are too many, end another one."""
        self.end_old()
        if len(self._strangers) >= STRANGERS:
            shares = Counter(network_of(key[0]) for key in self._strangers)
            most = max(shares.values())
            self._end(next(key for key in self._strangers if shares[network_of(key[0])] == most))
        connection.door, connection.peer = self, address[:2]
        self._strangers[connection.peer] = self._clock_s(), connection

    def know(self, peer: Any) -> None:
        """Count a connection as that of a user."""
        key = tuple(peer)[:2] if peer else None
        if key in self._strangers and len(self._known) < KNOWN:
            del self._strangers[key]
            self._known.add(key)

    def gone(self, peer: Any) -> None:
        """Forget a connection that is closed."""
        self._strangers.pop(peer, None)
        self._known.discard(peer)

    def end_old(self) -> None:
        """End the connections of strangers that are too old."""
        begin = self._clock_s() - PATIENCE_S
        while self._strangers:
            key, (since_s, _) = next(iter(self._strangers.items()))
            if since_s > begin:
                return
            self._end(key)

    def strangers(self) -> int:
        """Return the number of open connections of strangers."""
        return len(self._strangers)

    def _end(self, key: Any) -> None:
        """End a connection: its server reads the end of it and closes."""
        _, connection = self._strangers.pop(key)
        with contextlib.suppress(OSError):
            connection.shutdown(socket.SHUT_RDWR)


class _Connection(socket.socket):
    """A connection that tells its door when it is closed."""

    door: Door | None = None
    peer: Any = None

    def close(self) -> None:
        super().close()
        if self.door is not None:
            self.door.gone(self.peer)


class _Listening(socket.socket):
    """A listening socket that counts what it takes."""

    door: Door | None = None

    def accept(self) -> tuple[socket.socket, Any]:
        taken, address = super().accept()
        connection = _Connection(fileno=taken.detach())
        if self.door is not None:
            self.door.count(connection, address)
        return connection, address
