"""Measures how this machine keeps time for a loop: waking up, the step, a datagram to another process and back.

Both sides are meant to run in processes prepared as the online loop's: the other one stands for the robot's controller,
which shares no processor with other programs of this machine.
"""

from __future__ import annotations

import socket
import time
from collections.abc import Callable
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import OutputError

TELEGRAM: Final = bytes(600)
"""As long as a robot's telegram."""
_END: Final = b"end"
_LONGEST_S: Final = 10.0


def echo_socket() -> socket.socket:
    """A socket on loopback for :func:`echo`. Raises OutputError: there is no loopback interface."""
    out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        out.bind(("127.0.0.1", 0))
    except OSError as fault:
        out.close()
        raise OutputError(f"loopback cannot be used: {fault.strerror or fault}", where="127.0.0.1") from fault
    return out


def echo(own: socket.socket) -> None:
    """Send every datagram back, until one says end or none came for 10 s; closes the socket."""
    own.settimeout(_LONGEST_S)
    with own:
        while True:
            try:
                data, peer = own.recvfrom(2048)
            except TimeoutError:
                return
            if data == _END:
                return
            own.sendto(data, peer)


def await_echo(peer: tuple[str, int]) -> None:
    """Return when the other process sends datagrams back, so that none of the measured ones is lost to its start.

    Raises:
        OutputError: It does not within 300 s: several of them may start at once.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asking:
        asking.settimeout(0.1)
        for _ in range(3000):
            asking.sendto(b"hello", peer)
            try:
                asking.recv(16)
            except TimeoutError:
                continue
            return
    raise OutputError("the process that sends datagrams back does not answer", where=f"{peer[0]}:{peer[1]}")


def measure(
    cycle: Callable[[int], None], cycles: int, period_s: float, peer: tuple[str, int], *, warm: int = 50
) -> tuple[Float, Float, Float]:
    """Run a loop and time its parts.

    Args:
        cycle: The step; told the number of the cycle.
        cycles: How many are measured.
        period_s: Cycle time.
        peer: Address of :func:`echo`; told to end afterwards.
        warm: Cycles before the measured ones.

    Returns:
        (n,) s each: how late the loop woke up, time of its step, time until the datagram was back; the last is
        not-a-number where it was not within a cycle.
    """
    late, compute, back = (np.full(cycles, np.nan) for _ in range(3))
    buffer = bytearray(2048)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as own:
        own.bind(("127.0.0.1", 0))
        own.settimeout(period_s)
        due = time.perf_counter() + period_s
        for k in range(-warm, cycles):
            rest = due - time.perf_counter()
            if rest > 0.0:
                time.sleep(rest)
            woke = time.perf_counter()
            cycle(k + warm)
            computed = time.perf_counter()
            _flush(own, buffer, period_s)
            begin = time.perf_counter()
            own.sendto(TELEGRAM, peer)
            try:
                own.recv_into(buffer)
                end = time.perf_counter()
            except (TimeoutError, ConnectionError):
                end = np.nan
            if k >= 0:
                late[k], compute[k], back[k] = woke - due, computed - woke, end - begin
            # A cycle that was missed is not made up for: the next one is the next that can be met.
            missed = max(0.0, time.perf_counter() - due) // period_s
            due += period_s * (1.0 + missed)
        own.sendto(_END, peer)
    return late, compute, back


def _flush(own: socket.socket, buffer: bytearray, period_s: float) -> None:
    """Throw away echoes that came too late."""
    own.settimeout(0.0)
    try:
        while True:
            own.recv_into(buffer)
    except (BlockingIOError, ConnectionError):
        pass
    own.settimeout(period_s)
