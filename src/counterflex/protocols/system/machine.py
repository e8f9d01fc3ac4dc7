"""Machine as the operating system describes it: cores, governor, clock, stolen time. Nothing where it does not."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Final

_CPU: Final = Path("/sys/devices/system/cpu")
_CLOCK: Final = Path("/sys/devices/system/clocksource/clocksource0/current_clocksource")
_STAT: Final = Path("/proc/stat")
_REAL_TIME: Final = Path("/sys/kernel/realtime")
_SHARED: Final = Path("/dev/shm")


@dataclass(frozen=True)
class Machine:
    """Properties of the machine that were found."""

    cores: int  # that this process may use
    governors: tuple[str, ...]  # of their clocks, each once; empty where not known
    clock_source: str  # of the kernel; empty where not known
    realtime_kernel: bool  # the kernel says that it is a real-time one
    shared_free_bytes: int | None  # free shared memory; None where not known


def look() -> Machine:
    """Ask the operating system."""
    usable = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else range(os.cpu_count() or 1)
    governors = {_text(_CPU / f"cpu{k}" / "cpufreq" / "scaling_governor") for k in usable} - {""}
    free = None
    if _SHARED.is_dir() and hasattr(os, "statvfs"):
        status = os.statvfs(_SHARED)
        free = status.f_bavail * status.f_frsize
    return Machine(len(usable), tuple(sorted(governors)), _text(_CLOCK), _text(_REAL_TIME) == "1", free)


def processor_times() -> tuple[int, int]:
    """Time of all cores since the start in ticks, and how much of it a virtual machine's host took; 0, 0 unknown."""
    return read_stat(_text(_STAT))


def read_stat(text: str) -> tuple[int, int]:
    """Total and stolen ticks by the first line of ``/proc/stat``; its eighth number is what was stolen (proc(5))."""
    words = text.partition("\n")[0].split()
    if len(words) < 9 or words[0] != "cpu" or not all(word.isdigit() for word in words[1:9]):
        return 0, 0
    ticks = [int(word) for word in words[1:9]]
    return sum(ticks), ticks[7]


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="ascii", errors="replace").strip()
    except OSError:
        return ""
