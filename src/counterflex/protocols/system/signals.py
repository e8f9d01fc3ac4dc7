"""The signals by which the system asks a process to end, held back while it starts."""

from __future__ import annotations

import signal
from typing import Final

SIGNALS: Final = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
"""Ctrl-C, a request to terminate, a terminal that is closed."""


def hear_signals() -> None:
    """Let the signals through that a process was started with blocked; to be called when it can deal with them."""
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)
