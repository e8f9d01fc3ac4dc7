"""Life of the processes of a run: each gives a sign many times a second, the operating system says who has died.

What a process says of itself tells a stopped one from a running one, the system tells at once who has died. Neither
waits: the loop asks in every cycle.
"""

from __future__ import annotations

import contextlib
import os
import select
import sys
import threading
import time
from collections.abc import Callable
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Int
from counterflex.protocols.processes.control_array import Life

_PRIORITY: Final = 1
BEAT_S: Final = 0.01
"""How often a process says that it lives."""
SILENT_S: Final = 1.0
"""A process that has spoken and has said nothing for so long is dead or stands still."""
_SILENT_NS: Final = round(SILENT_S * 1e9)
_BEATS: Final = {Life.LOOP_PID: Life.LOOP_NS, Life.RECORDER_PID: Life.RECORDER_NS, Life.RUN_PID: Life.RUN_NS}


class Living:
    """Processes that are watched, once their numbers are known.

    Where the system has no handles for processes (``pidfd``, Linux 5.3), a parent that has died is seen by the parent
    having changed, another process by signal 0 (not on Windows), and each by its silence: one that has
    spoken and says nothing for :data:`SILENT_S` counts as gone.

    Args:
        control: Shared, see :mod:`counterflex.protocols.processes.control_array`.
        numbers: Which ones: places of their process numbers.
        clock_ns: Monotonic.
    """

    def __init__(self, control: Int, *numbers: Life, clock_ns: Callable[[], int] = time.monotonic_ns) -> None:
        self._control, self._unknown, self._clock_ns = control, list(numbers), clock_ns
        self._beats = [int(_BEATS[place]) for place in numbers]
        self._handles = select.poll() if hasattr(select, "poll") and hasattr(os, "pidfd_open") else None
        self._plain: list[int] = []
        self._open: list[int] = []
        self._ended = False

    def gone(self) -> bool:
        """Return whether one of them has died; once it has, for ever."""
        if self._ended:
            return True
        if self._unknown:
            self._unknown = [place for place in self._unknown if not self._begin(int(self._control[place]))]
        if self._handles is not None and self._open and self._handles.poll(0):
            self._ended = True
        if self._plain and (self._silent() or not all(_lives(number) for number in self._plain)):
            self._ended = True
        return self._ended

    def _silent(self) -> bool:
        now = self._clock_ns()
        return any((beat_ns := int(self._control[place])) != 0 and now - beat_ns > _SILENT_NS for place in self._beats)

    def _begin(self, number: int) -> bool:
        if number == 0:
            return False
        if self._handles is None:
            self._plain.append(number)
            return True
        try:
            handle = os.pidfd_open(number)
        except ProcessLookupError:
            self._ended = True
        except OSError:  # an older kernel, or one that forbids it
            self._plain.append(number)
        else:
            self._open.append(handle)
            self._handles.register(handle, select.POLLIN)
        return True

    def close(self) -> None:
        """Give the handles back."""
        for handle in self._open:
            os.close(handle)
        self._open.clear()


def _lives(number: int) -> bool:
    if sys.platform == "win32" or number == os.getppid():
        return True
    try:
        os.kill(number, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True


class Beat:
    """Says that this process lives, from a thread of its own: a disk or a terminal that stands still does not stop it.

    Args:
        control: Shared, (n,) whole 64-bit numbers.
        time_place: Where the time is written.
        number_place: Where the number of this process is written, once.
    """

    def __init__(self, control: Any, time_place: Life, number_place: Life) -> None:
        self._control, self._place = control, int(time_place)
        self._end = threading.Event()
        self._ended: Int = np.zeros(1, dtype=np.int64)
        self._beat_on: Callable[[Int, int, int, Int], None] | None = None
        control[self._place] = time.monotonic_ns()
        control[number_place] = os.getpid()
        self._thread = threading.Thread(target=self._go_on, name="beat", daemon=True)
        self._thread.start()

    def _go_on(self) -> None:
        if hasattr(os, "sched_setscheduler"):  # of this thread alone: it does next to nothing, but on time
            with contextlib.suppress(OSError):
                os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_PRIORITY))
        while not self._end.wait(BEAT_S):
            self._control[self._place] = time.monotonic_ns()
            if self._beat_on is not None:
                self._beat_on(self._control, self._place, round(BEAT_S * 1e9), self._ended)
                return

    def unlock(self, beat_on: Callable[[Int, int, int, Int], None]) -> None:
        """Say it from now on without the interpreter lock, which another thread may keep for long on a busy computer.

        Args:
            beat_on: Compiled, of :func:`counterflex.protocols.system.system_calls.unlocked_beat`.
        """
        self._beat_on = beat_on

    def close(self) -> None:
        """Say nothing any more."""
        self._end.set()
        self._ended[0] = 1
        self._thread.join()
