"""Worker processes for jobs that machine many parts: deaf to Ctrl-C, ended when the job is interrupted or dies."""

from __future__ import annotations

import concurrent.futures
import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from typing import Final

ONE_THREAD: Final = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
"""What keeps libraries of linear algebra to one thread: several workers with several each would wait for each other."""
MOST: Final = 61
"""More processes Windows cannot wait for."""


def count_of(wanted: int | None, tasks: int) -> int:
    """Number of workers for some tasks; ``wanted`` None is one per core."""
    return max(1, min(tasks, wanted or os.cpu_count() or 1, MOST))


@contextlib.contextmanager
def interrupts_held() -> Iterator[None]:
    """Hold Ctrl-C back while workers are started: they are born deaf to it, and the job hears it a moment later.

    A terminal sends it to every process of the job; only the job itself is to answer, in one line.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def end_with_parent() -> None:
    """End this process, and those that it started, as soon as the one that started it has ended, however it did.

    A process that is killed cannot end its workers; they see it by themselves.
    """
    parent = multiprocessing.parent_process()
    if parent is None:
        return

    def watch() -> None:
        parent.join()
        for child in multiprocessing.active_children():
            child.terminate()
        os._exit(1)

    threading.Thread(target=watch, name="parent", daemon=True).start()


def _begin_worker() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent()


@contextlib.contextmanager
def pool_of(count: int) -> Iterator[concurrent.futures.ProcessPoolExecutor]:
    """Worker processes, one thread each, that are ended at once when the job is interrupted."""
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))  # read once, when a worker starts
    try:
        with _pool_of(count) as pool:
            yield pool
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


@contextlib.contextmanager
def _pool_of(count: int) -> Iterator[concurrent.futures.ProcessPoolExecutor]:
    pool = concurrent.futures.ProcessPoolExecutor(
        count, mp_context=multiprocessing.get_context("spawn"), initializer=_begin_worker
    )
    try:
        yield pool
    except BaseException:
        for process in list((pool._processes or {}).values()):
            process.terminate()
        pool.shutdown(wait=True, cancel_futures=True)
        raise
    pool.shutdown()
