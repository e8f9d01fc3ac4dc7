"""Worker processes for jobs that machine many parts; they ignore Ctrl-C and end with the job."""

from __future__ import annotations

import concurrent.futures
import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, Final

from counterflex.core.progress import Progress, silent

ONE_THREAD: Final = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
"""What keeps libraries of linear algebra to one thread: several workers with several each would wait for each other."""
REPORT_EVERY_S: Final = 0.5
"""How often the job looks how far the workers are."""
MOST: Final = 61
"""More processes Windows cannot wait for."""


def count_of(requested: int | None, tasks: int) -> int:
    """Number of workers for some tasks; ``requested`` None is one per core."""
    return max(1, min(tasks, requested or os.cpu_count() or 1, MOST))


@contextlib.contextmanager
def interrupts_deferred() -> Iterator[None]:
    """Hold Ctrl-C back: workers that are started within ignore it, and the job receives it a moment later.

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
    threading.Thread(target=_end_after, args=(parent,), name="parent", daemon=True).start()


def _end_after(parent: Any) -> None:
    parent.join()
    for child in multiprocessing.active_children():
        child.terminate()
    os._exit(1)


class Shares:
    """Share of each task that is done, told by the workers that do them and read by the job."""

    def __init__(self, count: int) -> None:
        self._done: Any = multiprocessing.get_context("spawn").RawArray("d", max(1, count))

    def of(self, task: int) -> Progress:
        """Progress of one task, for who does it; it never falls."""

        def report(fraction: float, what: str = "") -> None:  # noqa: ARG001
            self._done[task] = max(self._done[task], min(1.0, fraction))

        return report

    def sum(self, weights: Sequence[float]) -> float:
        """Share of the whole work that is done; one weight for each task."""
        done = [float(share) for share in self._done]
        return sum(w * share for w, share in zip(weights, done, strict=False)) / (sum(weights) or 1.0)


_shares: list[Shares] = []


def share(task: int) -> Progress:
    """Progress of a task, for the worker process that does it."""
    return _shares[0].of(task) if _shares else silent


def _begin_worker(shares: Shares | None = None) -> None:
    _shares[:] = [] if shares is None else [shares]
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent()


@contextlib.contextmanager
def pool_of(count: int, shares: Shares | None = None) -> Iterator[concurrent.futures.ProcessPoolExecutor]:
    """Worker processes, one thread each, that are ended at once when the job is interrupted.

    Args:
        shares: Where tasks tell how much of them is done (:func:`share`), or None.
    """
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))  # read once, when a worker starts
    try:
        with _pool_of(count, shares) as pool:
            yield pool
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


@contextlib.contextmanager
def _pool_of(count: int, shares: Shares | None) -> Iterator[concurrent.futures.ProcessPoolExecutor]:
    pool = concurrent.futures.ProcessPoolExecutor(
        count, mp_context=multiprocessing.get_context("spawn"), initializer=_begin_worker, initargs=(shares,)
    )
    try:
        yield pool
    except BaseException:
        for process in list((pool._processes or {}).values()):
            process.terminate()
        pool.shutdown(wait=True, cancel_futures=True)
        raise
    pool.shutdown()


def done_one_by_one(
    waiting: Iterable[concurrent.futures.Future[Any]], report: Callable[[], None]
) -> Iterator[concurrent.futures.Future[Any]]:
    """Tasks as they end; while none does, what is done of them is told now and then.

    Args:
        report: Called twice in a second, and for each task that has ended.
    """
    remaining = set(waiting)
    while remaining:
        done, remaining = concurrent.futures.wait(
            remaining, REPORT_EVERY_S, return_when=concurrent.futures.FIRST_COMPLETED
        )
        report()
        yield from done
