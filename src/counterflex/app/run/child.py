"""First lines of a process of a run: it ends with the one that started it until it can end by itself.

Imports little, so that these lines come before what takes long: importing and compiling what the process needs.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import multiprocessing
import os
import pickle
import signal
import sys
import threading
import time
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, Final

from counterflex.core import compiling
from counterflex.protocols.processes.control_array import CONTROL, Course
from counterflex.protocols.processes.shared_words import SharedWords

_PR_SET_PDEATHSIG: Final = 1
_LIVE_S: Final = 0.1
_RELEASED: Final = threading.Event()  # The process ends by itself from now on


def child(job: bytes, words: Path, lives: int, pipe: Any) -> None:
    """Run the target of a process of a run.

    Args:
        job: Pickled function and its arguments, without the pipe; unpickled here, as that imports what they need.
        words: Where the shared numbers of the control array are.
        lives: Place among them where the process says that it lives, from here until the target says it.
        pipe: Last argument of the function.
    """
    end_with_starter()
    imported = threading.Event()
    with contextlib.suppress(Exception):  # who watches is told less
        shared = SharedWords(CONTROL, words)
        _count_compilations(shared)
        threading.Thread(target=_live, args=(shared, lives, imported), name="imports", daemon=True).start()
    try:
        target, args = pickle.loads(job)
    finally:
        imported.set()
    target(*args, pipe)


def end_with_starter() -> None:
    """Have the system end this process at once when the one that started it has died, whatever it does then.

    Linux; elsewhere a thread does it, as soon as it gets to run.
    """
    starter = multiprocessing.parent_process()
    if starter is None:
        return
    if sys.platform.startswith("linux"):
        with contextlib.suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(signal.SIGKILL), 0, 0, 0)
        if not starter.is_alive():  # it died before the line above
            os._exit(1)
        return
    threading.Thread(target=_end_after, args=(starter,), name="starter", daemon=True).start()


def _end_after(starter: BaseProcess) -> None:
    starter.join()
    if not _RELEASED.is_set():
        os._exit(1)


def outlive_starter() -> None:
    """End by itself from now on: the feed is held and the correction ramped out where the other process has died."""
    _RELEASED.set()
    if sys.platform.startswith("linux"):
        with contextlib.suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, 0, 0, 0, 0)


def _live(shared: SharedWords, lives: int, ended: threading.Event) -> None:
    """Say that the process lives while it imports: on a computer with twenty busy processes that takes a minute."""
    while True:
        shared.words[lives] = time.monotonic_ns()
        if ended.wait(_LIVE_S):
            return


def _count_compilations(shared: SharedWords) -> None:
    """Count the kernels that this process compiles, for who waits for it."""
    compiling.tell(functools.partial(_add_compiled, shared))


def _add_compiled(shared: SharedWords) -> None:
    shared.words[Course.COMPILED] += 1
