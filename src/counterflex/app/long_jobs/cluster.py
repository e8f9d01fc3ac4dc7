"""A cluster of workers does the tasks (dask.distributed): processes of this machine, or those of a scheduler.

The same code for both. Workers share no disk with this machine: what a task reads is sent along, what it writes comes
back. A worker that is lost costs the tasks that it worked on; the scheduler gives them to another one.
"""

from __future__ import annotations

import concurrent.futures
import contextlib
import math
import queue
import time
import uuid
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, Final

from counterflex.app.long_jobs.executors import Executor, Start
from counterflex.app.long_jobs.on_worker import WorkOrder, ordered, taken
from counterflex.app.long_jobs.scheduler import connected, local_cluster, require_scheduler_address
from counterflex.app.long_jobs.task import Task
from counterflex.app.long_jobs.workers import REPORT_EVERY_S, Shares
from counterflex.core.errors import InputError, SimulationError

AHEAD: Final = 2
"""Tasks handed out for each thread: the next is there when one ends. What waits is on disk, not at the scheduler."""


def cluster(root: Path, *, scheduler: str | None = None, count: int = 1) -> Start:
    """Workers of a cluster do the tasks.

    Args:
        root: Folder of the job; all that tasks read and write is below it.
        scheduler: Address of a scheduler that has workers; None starts processes of this machine.

    Returns:
        For :func:`counterflex.app.long_jobs.task_graph.run_tasks`.

    Raises:
        InputError: ``scheduler`` is no address; when started, nobody answers there.
    """
    address = None if scheduler is None else require_scheduler_address(scheduler)

    @contextlib.contextmanager
    def start(shares: Shares, tell: Callable[[], None]) -> Iterator[Executor]:  # noqa: ARG001
        opened = local_cluster(count) if address is None else connected(address)
        with opened as client:
            runs = _Cluster(client, root, shares)
            try:
                yield runs
            finally:
                runs.close()

    return start


class _Cluster:
    def __init__(self, client: Any, root: Path, shares: Shares) -> None:
        self._client, self._root, self._shares = client, root, shares
        self._address = str(client.scheduler.address)
        self._topic = f"counterflex-{uuid.uuid4().hex}"
        self._running: dict[int, tuple[Task, Any]] = {}
        self._ended: queue.SimpleQueue[int] = queue.SimpleQueue()
        self._threads, self._counted_s = 0, -math.inf
        client.subscribe_topic(self._topic, self._reported)

    def slots(self) -> int:
        if time.monotonic() - self._counted_s >= REPORT_EVERY_S:
            self._threads, self._counted_s = sum(self._client.nthreads().values()), time.monotonic()
        return AHEAD * max(1, self._threads)

    def submit(self, place: int, task: Task) -> None:
        order = ordered(task, self._root)
        key = f"{self._topic}-{place}-{uuid.uuid4().hex}"  # a key used again could still have the result of before
        future = self._client.submit(_worked, order, self._topic, place, key=key, pure=False)
        self._running[place] = (task, future)
        self._await(place, future)

    def _await(self, place: int, future: Any) -> None:
        future.add_done_callback(lambda _: self._ended.put(place))

    def ended(self) -> Iterator[tuple[int, Any]]:
        try:
            place = self._ended.get(timeout=REPORT_EVERY_S)
        except queue.Empty:
            self._require_scheduler()
            return
        task, future = self._running[place]
        if future.status == "lost":  # its worker went before it was fetched: another one does it again
            self._await(place, future)
            return
        if future.status == "error" and type(future.exception()).__name__ == "KilledWorker":
            raise SimulationError(
                "the workers that worked on this task were lost, one after the other",
                where=task.name,
                hint="Is there memory enough on them? Finished steps are stored; the same command continues",
            )
        try:
            parcel = future.result()
        except (concurrent.futures.CancelledError, OSError) as fault:
            raise self._gone() from fault
        except Exception as fault:
            raise InputError(
                "a worker cannot do a task",
                where=task.name,
                value=f"{type(fault).__name__}: {fault}"[:160],
                hint="Is the same counterflex installed there?",
            ) from fault
        del self._running[place]
        yield place, taken(parcel, task, self._root)

    def close(self) -> None:
        """Take back what has not ended."""
        with contextlib.suppress(Exception):
            self._client.unsubscribe_topic(self._topic)
            self._client.cancel([future for _, future in self._running.values()], force=True)

    def _reported(self, event: Any) -> None:
        place, fraction = event[1]
        self._shares.of(int(place))(float(fraction))

    def _require_scheduler(self) -> None:
        if self._client.status != "running":
            raise self._gone()

    def _gone(self) -> SimulationError:
        return SimulationError(
            "the scheduler has gone", where=self._address, hint="Finished steps are stored; the same command continues"
        )


def _worked(order: WorkOrder, topic: str, place: int) -> bytes:
    """On a worker: do a task, telling twice in a second at most how far it is."""
    from distributed import get_worker

    worker = get_worker()
    report = partial(_report, worker, topic, place, [time.monotonic()])
    return order.carry_out(report, worker.local_directory)


def _report(worker: Any, topic: str, place: int, reported_s: list[float], fraction: float, what: str = "") -> None:  # noqa: ARG001
    now = time.monotonic()
    if now - reported_s[0] >= REPORT_EVERY_S:
        reported_s[0] = now
        worker.log_event(topic, [place, fraction])
