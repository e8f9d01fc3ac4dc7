"""The signals by which the system asks a process to end: held back while it starts, or heard where it can end whole."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from functools import partial
from types import FrameType
from typing import Any, Final

SIGNALS: Final = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
"""Ctrl-C, a request to terminate, a terminal that is closed."""


def hear_signals() -> None:
    """Let the signals through that a process was started with blocked; to be called when it can deal with them."""
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)


def _hear(received: list[int], before: dict[int, Any], number: int, frame: FrameType | None) -> None:
    received.append(number)
    with contextlib.suppress(KeyboardInterrupt) if len(received) == 1 else contextlib.nullcontext():
        before[number](number, frame if len(received) > 1 else None)  # who counts signals hears of each


@contextlib.contextmanager
def heard_when_asked() -> Iterator[Callable[[], bool]]:
    """Within, the first signal interrupts nothing: the job asks now and then whether one came, and ends where it can.

    A second signal acts as it did before, in whatever place. Outside the main thread nothing is changed.

    Yields:
        Tells whether a signal has come.
    """
    received: list[int] = []
    before: dict[int, Any] = {}
    if threading.current_thread() is threading.main_thread():
        for number in SIGNALS:
            handler = signal.getsignal(number)
            if callable(handler):
                before[number] = handler
                signal.signal(number, partial(_hear, received, before))
    try:
        yield lambda: bool(received)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
