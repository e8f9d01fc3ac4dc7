"""Executors of the tasks of a job: this process, or worker processes that share this machine's disk."""

from __future__ import annotations

import concurrent.futures
import contextlib
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from typing import Any, Protocol

from counterflex.app.long_jobs.task import Task
from counterflex.app.long_jobs.workers import REPORT_EVERY_S, Shares, interrupts_deferred, pool_of, share
from counterflex.core.progress import Progress


class Executor(Protocol):
    """Does tasks; the job hands out those that are ready and takes what they return."""

    def slots(self) -> int:
        """Tasks to hand out before one of them has ended."""

    def submit(self, place: int, task: Task) -> None:
        """Take a task; ``place`` is its number in the job."""

    def ended(self) -> Iterator[tuple[int, Any]]:
        """Tasks that have ended, with what they returned or the exception; waits at most half a second for one."""


Start = Callable[[Shares, Callable[[], None]], AbstractContextManager[Executor]]
"""Makes an executor: where tasks tell how much of them is done, and what to call when one has told it."""


def call(task: Task, progress: Progress) -> Any:
    """Do a task in this process."""
    return task.function(*task.plain_arguments(), **({"progress": progress} if task.tells else {}))


class _Here:
    def __init__(self, shares: Shares, tell: Callable[[], None]) -> None:
        self._shares, self._tell = shares, tell
        self._waiting: deque[tuple[int, Task]] = deque()

    def slots(self) -> int:
        return 1

    def submit(self, place: int, task: Task) -> None:
        self._waiting.append((place, task))

    def ended(self) -> Iterator[tuple[int, Any]]:
        place, task = self._waiting.popleft()
        try:
            result = call(task, lambda fraction, what="": self._report(place, fraction))  # noqa: ARG005
        except Exception as fault:
            result = fault
        yield place, result

    def _report(self, place: int, fraction: float) -> None:
        self._shares.of(place)(fraction)
        self._tell()


@contextlib.contextmanager
def here(shares: Shares, tell: Callable[[], None]) -> Iterator[Executor]:
    """This process does the tasks, one after the other."""
    yield _Here(shares, tell)


class _Pool:
    def __init__(self, count: int, pool: concurrent.futures.Executor) -> None:
        self._count, self._pool = count, pool
        self._running: dict[concurrent.futures.Future[Any], int] = {}

    def slots(self) -> int:
        return self._count

    def submit(self, place: int, task: Task) -> None:
        with interrupts_deferred():
            self._running[self._pool.submit(_call_at, task, place)] = place

    def ended(self) -> Iterator[tuple[int, Any]]:
        done, _ = concurrent.futures.wait(self._running, REPORT_EVERY_S, return_when=concurrent.futures.FIRST_COMPLETED)
        for future in done:
            fault = future.exception()
            yield self._running.pop(future), future.result() if fault is None else fault


def _call_at(task: Task, place: int) -> Any:
    return call(task, share(place))


def processes(count: int) -> Start:
    """Worker processes do the tasks, ``count`` at a time."""

    @contextlib.contextmanager
    def start(shares: Shares, tell: Callable[[], None]) -> Iterator[Executor]:  # noqa: ARG001
        with pool_of(count, shares) as pool:
            yield _Pool(count, pool)

    return start
