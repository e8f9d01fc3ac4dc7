"""Run tasks that wait for one another, several at a time."""

from __future__ import annotations

import concurrent.futures
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from counterflex.app.long_jobs.workers import REPORT_EVERY_S, Shares, count_of, interrupts_deferred, pool_of, share
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress


@dataclass(frozen=True)
class Task:
    """One piece of work in a worker process.

    Attributes:
        name: Unique.
        text: What is being worked on, for people.
        function: Of a module, so that a worker finds it.
        arguments: Plain values and paths.
        after: Names of tasks that must have ended; their results are on disk.
        weight: Expected time, in any unit.
        tells: The function takes ``progress`` and tells the fraction done.
    """

    name: str
    text: str
    function: Callable[..., Any]
    arguments: tuple[Any, ...] = ()
    after: tuple[str, ...] = ()
    weight: float = 1.0
    tells: bool = False


def run_tasks(tasks: Sequence[Task], workers: int | None, progress: Progress) -> dict[str, Any]:
    """Run tasks, the earlier of those that are ready first.

    Args:
        tasks: In order of urgency.
        workers: Processes; None is one per core, 1 works in this process.
        progress: Progress callback, share of the weights 0 to 1, running tasks included.

    Returns:
        What each returned, by name.

    Raises:
        InputError: Names are not unique, or tasks wait for each other in a circle.
        CounterflexError: What a task raised; the others are ended.
    """
    if len({task.name for task in tasks}) != len(tasks):
        raise InputError("two tasks have the same name")
    results: dict[str, Any] = {}
    count = count_of(workers, len(tasks))
    shares, weights, place = (
        Shares(len(tasks)),
        [task.weight for task in tasks],
        {t.name: i for i, t in enumerate(tasks)},
    )

    def report(text: str) -> None:
        progress(shares.sum(weights), text)

    def ready(waiting: Sequence[Task]) -> Task | None:
        return next((task for task in waiting if all(name in results for name in task.after)), None)

    waiting = list(tasks)
    if count == 1:
        while waiting:
            task = _require_task(ready(waiting), waiting)
            report(task.text)
            done_of, text = shares.of(place[task.name]), task.text

            def task_progress(fraction: float, what: str = "", done_of: Progress = done_of, text: str = text) -> None:  # noqa: ARG001
                done_of(fraction)
                report(text)

            results[task.name] = _work(task, task_progress)
            done_of(1.0)
            waiting.remove(task)
        report("")
        return results
    with pool_of(count, shares) as pool:
        running: dict[concurrent.futures.Future[Any], Task] = {}
        while waiting or running:
            while len(running) < count and (task_ready := ready(waiting)) is not None:
                with interrupts_deferred():
                    running[pool.submit(_work_at, task_ready, place[task_ready.name])] = task_ready
                waiting.remove(task_ready)
            if not running:
                _require_task(None, waiting)
            done: set[concurrent.futures.Future[Any]] = set()
            while not done:
                report(", ".join(task.text for task in running.values()))
                done, _ = concurrent.futures.wait(
                    running, REPORT_EVERY_S, return_when=concurrent.futures.FIRST_COMPLETED
                )
            for future in done:
                task = running.pop(future)
                results[task.name] = future.result()
                shares.of(place[task.name])(1.0)
    report("")
    return results


def _work(task: Task, progress: Progress) -> Any:
    return task.function(*task.arguments, **({"progress": progress} if task.tells else {}))


def _work_at(task: Task, place: int) -> Any:
    return _work(task, share(place))


def _require_task(task: Task | None, waiting: Sequence[Task]) -> Task:
    if task is None:
        raise InputError("tasks wait for each other in a circle", value=", ".join(t.name for t in waiting))
    return task
