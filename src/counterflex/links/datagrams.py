"""All datagrams that wait at a socket, with one system call where there is one, into memory that is allocated once."""

from __future__ import annotations

import contextlib
import ctypes
import errno
import socket
import sys
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Int
from counterflex.wire.decimal_kernel import ByteRows

ROWS: Final = 64
SIZE: Final = 2048
"""Bytes that are kept of a datagram; none of the protocols has longer ones."""
_HEAD: Final = np.dtype(
    {
        "names": ["name", "namelen", "iov", "iovlen", "control", "controllen", "flags", "length"],
        "formats": ["u8", "u4", "u8", "u8", "u8", "u8", "i4", "u4"],
        "offsets": [0, 8, 16, 24, 32, 40, 48, 56],
        "itemsize": 64,
    }
)
"""``struct mmsghdr`` of 64-bit Linux (recvmmsg(2))."""
_ADDRESS: Final = 16


class Datagrams:
    """What came to a UDP socket of IPv4.

    Args:
        own: The socket; made non-blocking.

    Attributes:
        data: (ROWS, SIZE) bytes, one datagram in a row; what lies behind its end means nothing.
        lengths: (ROWS,) of each, at most SIZE.
        hosts: (ROWS,) sender's IPv4 address as a number, see :func:`host_number`.
    """

    def __init__(self, own: socket.socket) -> None:
        own.setblocking(False)
        self._socket = own
        self.data: ByteRows = np.zeros((ROWS, SIZE), dtype=np.uint8)
        self.lengths: Int = np.zeros(ROWS, dtype=np.int64)
        self.hosts: Int = np.zeros(ROWS, dtype=np.int64)
        self._views: list[memoryview] = [row.data for row in self.data]
        self._many = _many()
        if self._many is not None:
            self._names = np.zeros((ROWS, _ADDRESS), dtype=np.uint8)
            self._pieces = np.zeros((ROWS, 2), dtype=np.uint64)
            self._pieces[:, 0] = self.data.ctypes.data + SIZE * np.arange(ROWS)
            self._pieces[:, 1] = SIZE
            self._heads = np.zeros(ROWS, dtype=_HEAD)
            self._heads["name"] = self._names.ctypes.data + _ADDRESS * np.arange(ROWS)
            self._heads["namelen"] = _ADDRESS
            self._heads["iov"] = self._pieces.ctypes.data + 16 * np.arange(ROWS)
            self._heads["iovlen"] = 1
            self._said = self._heads["length"]
            self._from = self._names[:, 4:8].view(">u4")[:, 0]
            self._at = self._heads.ctypes.data

    def take(self) -> int:
        """Take what is there, at most ROWS; never waits, never raises. Call again where it returns ROWS.

        Returns:
            Datagrams taken.
        """
        if self._many is None:
            return self._one_by_one()
        while True:
            count = int(self._many(self._socket.fileno(), self._at, ROWS, socket.MSG_DONTWAIT, None))
            if count > 0:
                self.lengths[:count] = self._said[:count]
                self.hosts[:count] = self._from[:count]
                return count
            if ctypes.get_errno() not in (errno.ECONNREFUSED, errno.EINTR):
                return 0

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


def host_number(host: str) -> int:
    """IPv4 address or name of a computer as a number; -1 where it cannot be found."""
    with contextlib.suppress(OSError):
        return int.from_bytes(socket.inet_aton(socket.gethostbyname(host)), "big")
    return -1


def _many() -> Any:
    """``recvmmsg`` of the C library, or None."""
    if not sys.platform.startswith("linux") or ctypes.sizeof(ctypes.c_void_p) != 8:
        return None
    found = getattr(ctypes.CDLL(None, use_errno=True), "recvmmsg", None)
    if found is not None:
        found.argtypes = (ctypes.c_int, ctypes.c_void_p, ctypes.c_uint, ctypes.c_int, ctypes.c_void_p)
        found.restype = ctypes.c_int
    return found
