"""Real-time priority, locked memory, no garbage collection: set for the loop where the system allows it."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Final

PRIORITY: Final = 80
_MCL_CURRENT, _MCL_FUTURE = 1, 2


@dataclass(frozen=True)
class Granted:
    """Rights that the operating system granted."""

    fifo: bool  # real-time priority
    locked: bool  # memory locked
    collector: bool  # garbage collector frozen and off
    reasons: tuple[str, ...]  # why something was not allowed


@dataclass(frozen=True)
class RealtimePreparation:
    """Priority and locked memory of another process, by the operating system."""

    fifo: bool  # real-time priority
    locked: bool  # memory locked, some of it at least; False where the system does not say


def prepared(pid: int | None) -> RealtimePreparation:
    """Return whether a process has what :func:`prepare` asks for; nothing where there is no such process."""
    fifo = locked = False
    if pid is not None and hasattr(os, "sched_getscheduler"):
        with contextlib.suppress(OSError):
            fifo = os.sched_getscheduler(pid) == os.SCHED_FIFO
    with contextlib.suppress(OSError):
        locked = locked_kb(Path(f"/proc/{pid}/status").read_text(encoding="ascii", errors="replace")) > 0
    return RealtimePreparation(fifo, locked)


def locked_kb(status: str) -> int:
    """Locked memory by the line ``VmLck`` of ``/proc/PID/status`` (proc(5)), kB; 0 where there is none."""
    for line in status.splitlines():
        name, _, value = line.partition(":")
        words = value.split()
        if name == "VmLck" and words and words[0].isdigit():
            return int(words[0])
    return 0


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
