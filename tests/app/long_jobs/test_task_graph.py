"""Tasks run in the order that their results allow, each once, in one process or in several."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from counterflex.app.long_jobs.task import Task
from counterflex.app.long_jobs.task_graph import run_tasks
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, silent


def joined(target: str, *sources: str) -> int:
    """Write the texts of the sources, one after the other, and the target's own name; return the process."""
    text = "".join(Path(source).read_text(encoding="ascii") for source in sources) + Path(target).name
    Path(target).write_text(text, encoding="ascii")
    return os.getpid()


def fails() -> None:
    raise InputError("broken")


def diamond(folder: Path) -> list[Task]:
    a, b, c, d = (str(folder / name) for name in "abcd")
    return [
        Task("d", "last", joined, (d, b, c), ("b", "c")),
        Task("b", "left", joined, (b, a), ("a",), 2.0),
        Task("c", "right", joined, (c, a), ("a",)),
        Task("a", "first", joined, (a,)),
    ]


@pytest.mark.parametrize("workers", [1, 2])
def test_each_waits_for_those_it_needs(tmp_path: Path, workers: int) -> None:
    told: list[float] = []

    def report(fraction: float, what: str = "") -> None:
        told.append(fraction)

    results = run_tasks(diamond(tmp_path), workers, report)
    assert (tmp_path / "d").read_text(encoding="ascii") == "abacd"
    assert set(results) == set("abcd")
    assert (set(results.values()) == {os.getpid()}) == (workers == 1)
    assert told == sorted(told)
    assert told[0] == 0.0
    assert told[-1] == 1.0


@pytest.mark.parametrize("workers", [1, 2])
def test_a_fault_ends_all(tmp_path: Path, workers: int) -> None:
    tasks = [Task("x", "", fails), Task("y", "", joined, (str(tmp_path / "y"),), ("x",))]
    with pytest.raises(InputError, match="broken"):
        run_tasks(tasks, workers, silent)
    assert not (tmp_path / "y").exists()


def test_circles_and_twins_are_refused(tmp_path: Path) -> None:
    a, b = Task("a", "", fails, (), ("b",)), Task("b", "", fails, (), ("a",))
    for workers in (1, 2):
        with pytest.raises(InputError, match="circle"):
            run_tasks([a, b], workers, silent)
    with pytest.raises(InputError, match="same name"):
        run_tasks([a, a], 1, silent)


def half(*, progress: Progress = silent) -> None:
    progress(0.5)


def test_a_running_task_moves_the_bar_by_its_work() -> None:
    told: list[float] = []

    def report(fraction: float, what: str = "") -> None:
        told.append(fraction)

    tasks = [Task("long", "", half, weight=3.0, tells=True), Task("short", "", half, (), ("long",), tells=True)]
    run_tasks(tasks, 1, report)
    assert told == pytest.approx([0.0, 0.375, 0.75, 0.875, 1.0])
    assert set(run_tasks(tasks, 2, silent)) == {"long", "short"}  # a worker hands the progress over as well
