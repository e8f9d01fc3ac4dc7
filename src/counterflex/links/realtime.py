"""What a loop needs of the operating system: real-time priority, locked memory, no garbage collection."""

from __future__ import annotations

import ctypes
import gc
import os
import sys
from dataclasses import dataclass
from typing import Final

PRIORITY: Final = 80
_MCL_CURRENT, _MCL_FUTURE = 1, 2


@dataclass(frozen=True)
class Granted:
    """What the operating system allowed.

    Attributes:
        fifo: Real-time priority.
        locked: Memory locked.
        collector: Garbage collector frozen and off.
        reasons: Why something was not allowed.
    """

    fifo: bool
    locked: bool
    collector: bool
    reasons: tuple[str, ...]


def prepare() -> Granted:
    """Take what can be had, for this process; call it after everything is built and warmed."""
    reasons = []
    fifo = locked = False
    if hasattr(os, "sched_setscheduler"):
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
            fifo = True
        except OSError as fault:
            reasons.append(f"real-time priority: {fault.strerror}")
    else:
        reasons.append("real-time priority: not on this system")
    if sys.platform.startswith("linux"):
        libc = ctypes.CDLL(None, use_errno=True)
        if libc.mlockall(_MCL_CURRENT | _MCL_FUTURE) == 0:
            locked = True
        else:
            reasons.append(f"locked memory: {os.strerror(ctypes.get_errno())}")
    else:
        reasons.append("locked memory: not on this system")
    gc.collect()
    gc.freeze()
    gc.disable()
    return Granted(fifo, locked, True, tuple(reasons))
