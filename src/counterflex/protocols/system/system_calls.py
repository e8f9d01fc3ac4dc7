"""System calls of 64-bit Linux as compiled kernels call them, without a way back through Python.

Where there are none (another system, kernels stepped through in Python) :data:`THERE` is False and what they stand for
is done with the sockets of Python.
"""

from __future__ import annotations

import ctypes
import errno
import socket
import sys
from collections.abc import Callable
from typing import Any, Final

import numba
import numpy as np
from numba import carray, types

from counterflex.core.arrays import Int
from counterflex.core.jit import compile_stated, kernel
from counterflex.core.records import Record, Records, record
from counterflex.protocols.decimal_kernel import ByteRows, Bytes

THERE: Final = (
    sys.platform.startswith("linux")
    and ctypes.sizeof(ctypes.c_void_p) == 8
    and sys.byteorder == "little"
    and not numba.config.DISABLE_JIT
    and hasattr(ctypes.CDLL(None), "recvmmsg")
    and hasattr(ctypes.CDLL(None), "__errno_location")
)
"""Whether the calls of this module can be made."""
_REFUSED: Final = errno.ECONNREFUSED
_INTERRUPTED: Final = errno.EINTR
_AT_ONCE: Final = getattr(socket, "MSG_DONTWAIT", 0x40)
_READABLE: Final = 1  # POLLIN
_MONOTONIC: Final = 1  # CLOCK_MONOTONIC

# struct mmsghdr in numbers of eight bytes (recvmmsg(2)).
H_NAME: Final = 0
H_NAME_LENGTH: Final = 1
H_PIECES: Final = 2
H_PIECE_COUNT: Final = 3
H_LENGTH: Final = 7
HEAD: Final = 8
NAME: Final = 16
"""Bytes of ``struct sockaddr_in``."""

if THERE:
    _recvmmsg: Any = types.ExternalFunction(
        "recvmmsg", types.int32(types.int32, types.intp, types.uint32, types.int32, types.intp)
    )
    _ppoll: Any = types.ExternalFunction("ppoll", types.int32(types.intp, types.uintp, types.intp, types.intp))
    _sendto: Any = types.ExternalFunction(
        "sendto", types.intp(types.int32, types.intp, types.uintp, types.int32, types.intp, types.uint32)
    )
    _clock_gettime: Any = types.ExternalFunction("clock_gettime", types.int32(types.int32, types.intp))
    _nanosleep: Any = types.ExternalFunction("nanosleep", types.int32(types.intp, types.intp))
    _errno_location: Any = types.ExternalFunction("__errno_location", types.CPointer(types.int32)())

    @kernel("int64()")
    def _why() -> int:
        """Errno of the last call."""
        return int(carray(_errno_location(), (1,))[0])

else:

    @kernel("int64(int64, int64, int64, int64, int64)", entry=True)
    def _recvmmsg(_fd: int, _heads: int, _rows: int, _flags: int, _timeout: int) -> int:
        return -1

    @kernel("int64(int64, int64, int64, int64)", entry=True)
    def _ppoll(_polled: int, _count: int, _timeout: int, _mask: int) -> int:
        return 0

    @kernel("int64(int64, int64, int64, int64, int64, int64)", entry=True)
    def _sendto(_fd: int, _data: int, _length: int, _flags: int, _name: int, _size: int) -> int:
        return -1

    @kernel("int64(int64, int64)", entry=True)
    def _clock_gettime(_clock: int, _time: int) -> int:
        return -1

    @kernel("int64(int64, int64)", entry=True)
    def _nanosleep(_time: int, _rest: int) -> int:
        return -1

    @kernel("int64()")
    def _why() -> int:
        """No call has failed."""
        return 0


WINDOW: Final = record(
    polled=int,  # struct pollfd
    time=(int, 2),  # struct timespec
    period_ns=int,
    most_ns=int,
    due_ns=int,
    jitter_ns=int,
)
"""Wait for the next datagram of a sender that keeps a cycle: work space, and when to poll instead of sleeping.

``most_ns``: longest time of polling before the datagram is due, and as long behind it; 0: sleep only. ``due_ns``: when
the next one is expected, CLOCK_MONOTONIC; 0: not known. ``jitter_ns``: mean distance of datagrams from that.
"""
_LEAST_NS: Final = 30_000
"""Half of the shortest window: waking up takes that long on an idle machine."""
_NAP_NS: Final = 100_000
"""Shorter times are not slept through: other programs would take the caches meanwhile."""
_JITTERS: Final = 4
"""Half of a window, in mean distances: 1 in 700 of normal ones lies outside."""


def heads(inbox: ByteRows, names: ByteRows) -> tuple[Int, Int]:
    """Structures that tell the system where datagrams and their senders go.

    Args:
        inbox: (n, size) one datagram in a row.
        names: (n, NAME) one sender in a row.

    Returns:
        (n, 2) pieces and (n, HEAD) heads; both must live as long as they are used.
    """
    rows, size = inbox.shape
    pieces: Int = np.zeros((rows, 2), dtype=np.int64)
    pieces[:, 0] = inbox.ctypes.data + size * np.arange(rows)
    pieces[:, 1] = size
    out: Int = np.zeros((rows, HEAD), dtype=np.int64)
    out[:, H_NAME] = names.ctypes.data + NAME * np.arange(rows)
    out[:, H_NAME_LENGTH] = NAME
    out[:, H_PIECES] = pieces.ctypes.data + pieces.strides[0] * np.arange(rows)
    out[:, H_PIECE_COUNT] = 1
    return pieces, out


@kernel("int64(int64, int64[:, ::1], uint8[:, ::1], int64[::1], int64[::1])", entry=True)
def receive(fd: int, heads: Int, names: ByteRows, lengths: Int, hosts: Int) -> int:
    """Take all datagrams that wait at a socket of IPv4, with one call; never waits.

    Args:
        heads: (n, HEAD) of :func:`heads`.
        names: (n, NAME) that they point to.
        lengths: (n,) bytes of each datagram; written.
        hosts: (n,) sender's IPv4 address as a number; written.

    Returns:
        Datagrams taken; 0: none was there, or the socket is closed.
    """
    while True:
        count = _recvmmsg(fd, heads.ctypes.data, heads.shape[0], _AT_ONCE, 0)
        if count > 0:
            for k in range(count):
                lengths[k] = heads[k, H_LENGTH] & 0xFFFFFFFF
                hosts[k] = (
                    (int(names[k, 4]) << 24) | (int(names[k, 5]) << 16) | (int(names[k, 6]) << 8) | int(names[k, 7])
                )
            return int(count)
        if _why() not in (_REFUSED, _INTERRUPTED):
            return 0


@kernel("int64(Window[::1])", Window=WINDOW)
def now_ns(windows: Records) -> int:
    """Monotonic clock, ns."""
    w = windows[0]
    _clock_gettime(_MONOTONIC, windows.ctypes.data + 8)
    return int(w.time[0] * 1_000_000_000 + w.time[1])


@kernel("int64(int64, int64, Window[::1])", Window=WINDOW)
def _sleep(fd: int, longest_ns: int, windows: Records) -> int:
    """Sleep until a datagram is there: 1; 0 where none received, below 0 where a signal ended it."""
    w = windows[0]
    w.polled = fd | (_READABLE << 32)
    w.time[0], w.time[1] = longest_ns // 1_000_000_000, longest_ns % 1_000_000_000
    return int(_ppoll(windows.ctypes.data, 1, windows.ctypes.data + 8, 0))


@kernel("void(Window, int64)", Window=WINDOW)
def _learn(w: Record, now: int) -> None:
    """Learn from a datagram when the next one is due, and how exactly."""
    error = now - w.due_ns
    if w.due_ns == 0 or abs(error) > w.period_ns // 2:  # the first one, or some were lost: no measure of the jitter
        w.due_ns = now
    else:
        w.due_ns += error // 8
        w.jitter_ns += (abs(error) - w.jitter_ns) // 16
    w.due_ns += w.period_ns


@kernel("int64(Window)", Window=WINDOW)
def _half_ns(w: Record) -> int:
    """Half of the window in which the next datagram is polled for."""
    return int(min(w.most_ns, _LEAST_NS + _JITTERS * w.jitter_ns))


@kernel("boolean(int64, int64, int64, Window[::1])", Window=WINDOW)
def sleep_until_near(fd: int, timeout_ns: int, before_ns: int, windows: Records) -> bool:
    """Sleep until some time before the polling of :func:`await_datagrams` begins.

    Args:
        timeout_ns: Longest wait.
        before_ns: How long before.
        windows: (1,) WINDOW.

    Returns:
        Whether that time has come; False at once where nothing is polled, and where a datagram or a signal comes first.
    """
    w = windows[0]
    if w.most_ns <= 0 or w.due_ns <= 0:
        return False
    now = now_ns(windows)
    begin = w.due_ns - _half_ns(w) - before_ns
    return bool(now < begin < now + timeout_ns) and _sleep(fd, begin - now, windows) == 0


@kernel(
    "int64(int64, int64[:, ::1], uint8[:, ::1], int64[::1], int64[::1], int64, Window[::1])",
    Window=WINDOW,
    waits=True,
    entry=True,
)
def await_datagrams(
    fd: int, heads: Int, names: ByteRows, lengths: Int, senders: Int, timeout_ns: int, windows: Records
) -> int:
    """As :func:`receive`, but waits for the first datagram, and tells address and port of each sender.

    With ``most_ns`` it sleeps until shortly before the datagram is due and polls from there: a processor that does not
    sleep answers sooner. At most once a cycle, and for no longer than twice ``most_ns``.

    Args:
        heads: As for :func:`receive`.
        senders: (n,) ``address << 16 | port``; written.
        timeout_ns: Longest wait; 0 or less: none.
        windows: (1,) WINDOW.

    Returns:
        Datagrams taken; 0 also where a signal ended the wait.
    """
    w, count = windows[0], 0
    if timeout_ns > 0:
        now, half = 0, 0
        if w.most_ns > 0:
            now, half = now_ns(windows), _half_ns(w)
        end, begin, last = now + timeout_ns, w.due_ns - half, w.due_ns + half
        received = 0
        if half > 0 and now < last < end:
            received = _sleep(fd, begin - now, windows) if begin - now > _NAP_NS else 0
            while received == 0 and count == 0 and now_ns(windows) < last:
                count = receive(fd, heads, names, lengths, senders)
            now = now_ns(windows)
        if received == 0 and count == 0:
            received = _sleep(fd, max(0, end - now), windows)
        if received <= 0 and count == 0:
            return 0
    if count == 0:
        count = receive(fd, heads, names, lengths, senders)
    if w.most_ns > 0 and count > 0 and timeout_ns > 0:
        _learn(w, now_ns(windows))
    for k in range(count):
        senders[k] = (senders[k] << 16) | (int(names[k, 2]) << 8) | int(names[k, 3])
    return count


@kernel("boolean(int64, uint8[::1], int64, uint8[::1])")
def send_to(fd: int, data: Bytes, length: int, name: Bytes) -> bool:
    """Send a datagram; never waits.

    Args:
        data: (n,) buffer.
        length: Bytes of it.
        name: (NAME,) to whom, as :func:`receive` had it from the system.

    Returns:
        Whether the system took it.
    """
    while True:
        if _sendto(fd, data.ctypes.data, length, _AT_ONCE, name.ctypes.data, NAME) == length:
            return True
        if _why() != _INTERRUPTED:
            return False


@kernel("void(int64[::1], int64, int64, int64[::1])", waits=True, entry=True)
def _beat_on(words: Int, place: int, every_ns: int, end: Int) -> None:
    """Write the monotonic time into a word again and again, without the interpreter lock."""
    work = np.zeros(4, dtype=np.int64)  # two struct timespec
    while end[0] == 0:
        if _clock_gettime(_MONOTONIC, work.ctypes.data) != 0:
            return
        words[place] = work[0] * 1_000_000_000 + work[1]
        work[2], work[3] = 0, every_ns
        _nanosleep(work.ctypes.data + 16, 0)


def unlocked_beat() -> Callable[[Int, int, int, Int], None] | None:
    """Return what beats without the interpreter lock, compiled; None on other systems."""
    if not THERE:
        return None
    compile_stated(__name__)
    return _beat_on
