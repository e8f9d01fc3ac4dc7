"""Run tasks that wait for one another, several at a time; those that are kept on disk are not done again."""

from __future__ import annotations

import contextlib
import graphlib
import heapq
from collections.abc import Sequence
from typing import Any, Final

from counterflex.app.long_jobs.executors import Executor, Start, here, processes
from counterflex.app.long_jobs.step_cache import Mark, begin, finish, finished
from counterflex.app.long_jobs.task import Failed, Task
from counterflex.app.long_jobs.workers import Shares, count_of
from counterflex.core.errors import CounterflexError, InputError
from counterflex.core.progress import Progress

_NAMED: Final = 4  # Running tasks that the progress names; the others are counted


def run_tasks(
    tasks: Sequence[Task],
    workers: int | None,
    progress: Progress,
    *,
    start: Start | None = None,
    keep_going: bool = False,
) -> dict[str, Any]:
    """Run tasks, the earlier of those that are ready first.

    Args:
        tasks: In order of urgency.
        workers: Processes of this machine; None is one per core, 1 works in this process.
        progress: Progress callback, share of the weights 0 to 1, running tasks included.
        start: Who does them instead, such as :func:`counterflex.app.long_jobs.cluster.cluster`.
        keep_going: A task that raises a CounterflexError does not end the job: it, and the tasks that wait for it,
            result in :class:`Failed`.

    Returns:
        What each returned, by name.

    Raises:
        InputError: Names are not unique, a task waits for one that is not there, or tasks wait in a circle.
        CounterflexError: What a task raised; the others are ended.
    """
    run = _GraphRun(tasks, progress, keep_going)
    count = count_of(workers, len(tasks))
    own = here if count == 1 else processes(count)
    with contextlib.ExitStack() as stack:
        executor: Executor | None = None  # nothing is started where all is kept
        while run.graph.active or run.running:
            while (executor is None or len(run.running) < executor.slots()) and (place := run.graph.next()) is not None:
                if run.is_known(place):
                    continue
                if executor is None:
                    executor = stack.enter_context((start or own)(run.shares, run.report))
                run.running.append(place)
                executor.submit(place, tasks[place])
            run.report()
            for place, result in executor.ended() if executor is not None and run.running else ():
                run.returned(place, result)
    run.report()
    return run.results


class _GraphRun:
    """State of the tasks of a job: those that run, and results by name."""

    def __init__(self, tasks: Sequence[Task], progress: Progress, keep_going: bool) -> None:
        self.graph, self.shares = _Graph(tasks), Shares(len(tasks))
        self.results: dict[str, Any] = {}
        self.running: list[int] = []
        self._tasks, self._progress, self._keep_going = tasks, progress, keep_going
        self._weights = [task.weight for task in tasks]
        self._marks: dict[int, Mark | None] = {}

    def report(self) -> None:
        self._progress(self.shares.sum(self._weights), _texts([self._tasks[place] for place in self.running]))

    def is_known(self, place: int) -> bool:
        """Return whether the result is kept, or a task before it failed; mark its output as begun otherwise."""
        task = self._tasks[place]
        result = next((self.results[name] for name in task.after if isinstance(self.results[name], Failed)), None)
        if result is None and task.writes is not None:
            mark = self._marks[place] = task.mark()
            result = None if mark is None else finished(task.writes, mark)
            if result is None:
                begin(task.writes, mark)
        if result is not None:
            self._end(place, result)
        return result is not None

    def returned(self, place: int, result: Any) -> None:
        """Take a result, or the exception of a task."""
        self.running.remove(place)
        writes, mark = self._tasks[place].writes, self._marks.get(place)
        if isinstance(result, BaseException):
            if not (self._keep_going and isinstance(result, CounterflexError)):
                raise result
            result = Failed(str(result))
        elif mark is not None and writes is not None:
            finish(writes, mark, result)
        self._end(place, result)

    def _end(self, place: int, result: Any) -> None:
        self.results[self._tasks[place].name] = result
        self.shares.of(place)(1.0)
        self.graph.done(place)


class _Graph:
    """Order of tasks: of those that wait for none that has not ended the first."""

    def __init__(self, tasks: Sequence[Task]) -> None:
        self._place = {task.name: i for i, task in enumerate(tasks)}
        if len(self._place) != len(tasks):
            raise InputError("two tasks have the same name")
        self._names = [task.name for task in tasks]
        for task in tasks:
            for name in task.after:
                if name not in self._place:
                    raise InputError(f"{task.name} waits for a task that is not there", value=name)
        self._sorter = graphlib.TopologicalSorter({task.name: task.after for task in tasks})
        try:
            self._sorter.prepare()
        except graphlib.CycleError as fault:
            raise InputError("tasks wait for each other in a circle", value=", ".join(fault.args[1])) from fault
        self._ready: list[int] = []

    @property
    def active(self) -> bool:
        return bool(self._ready) or self._sorter.is_active()

    def next(self) -> int | None:
        for name in self._sorter.get_ready():
            heapq.heappush(self._ready, self._place[name])
        return heapq.heappop(self._ready) if self._ready else None

    def done(self, place: int) -> None:
        self._sorter.done(self._names[place])


def _texts(running: Sequence[Task]) -> str:
    texts = [task.text for task in running[:_NAMED]]
    more = [f"{len(running) - _NAMED} more"] if len(running) > _NAMED else []
    return ", ".join(texts + more)
