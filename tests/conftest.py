"""Tests depend on no machine's speed: hypothesis sets no deadline, small matrices are not shared between threads."""

from __future__ import annotations

import os
import signal
from collections import Counter
from pathlib import PurePath

import pytest
from hypothesis import settings

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("COUNTERFLEX_PROGRESS_S", "0")  # how slow a machine is shows in no output
settings.register_profile("counterflex", deadline=None)
settings.load_profile("counterflex")

# A shell that starts the suite in the background has it ignore Ctrl-C, and every process that a test starts inherits
# that: none could be interrupted, and what waits for it would wait for ever.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Print how long each test room took, all its processes together, and its slowest file."""
    rooms: Counter[str] = Counter()
    files: dict[str, Counter[str]] = {}
    for kind in ("passed", "failed", "error", ""):
        for report in terminalreporter.stats.get(kind, ()):
            path = PurePath(str(report.nodeid).split("::")[0])
            room = path.parts[1] if len(path.parts) > 2 else "."
            seconds = getattr(report, "duration", 0)  # a file that could not be collected has none
            rooms[room] += seconds
            files.setdefault(room, Counter())[path.name] += seconds
    if len(rooms) < 2:
        return
    terminalreporter.section("seconds per room")
    for room, seconds in rooms.most_common():
        name, longest = files[room].most_common(1)[0]
        terminalreporter.write_line(f"{seconds:8.1f} s  {room:<12} slowest: {name} {longest:.1f} s")
