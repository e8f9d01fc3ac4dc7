"""Every experiment's tasks: their names are unique, each run waits for its plan, and the marks tell the ways apart."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from counterflex.app.long_jobs.task import Task, Writes
from counterflex.app.proof.truth import truth_of
from counterflex.core.progress import silent
from counterflex.files.cell.cell import read_cell
from counterflex.twin.truth.file import write_truth
from counterflex_lab.reproduce.experiment import PLAN_FILE, Experiment
from counterflex_lab.reproduce.haehn import Groove
from counterflex_lab.reproduce.holder import Edge
from counterflex_lab.reproduce.mandiola import Paths
from counterflex_lab.reproduce.online import WrongPlans

Made = Callable[..., Experiment]


def identified(experiment: Experiment) -> None:
    """Write cells as if the catalogue were what was identified of them."""
    start = experiment.catalogue()
    for seed in experiment.seeds:
        experiment.cell(seed).parent.mkdir(parents=True)
        shutil.copy(start, experiment.cell(seed))
        write_truth(experiment.truth(seed), truth_of(read_cell(start), seed))


@pytest.fixture(params=[Groove, Edge, Paths, WrongPlans], ids=lambda kind: kind.name)
def made(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[Experiment, list[Task]]:
    kind: Made = request.param
    given: dict[str, Any] = {"rows": ("drift",)} if request.param is WrongPlans else {}
    experiment = kind(tmp_path, seeds=(3, 4), **given)
    if request.param is Paths:
        experiment.identify(silent)
    else:
        identified(experiment)
    return experiment, experiment.tasks()


def test_runs_wait_for_their_plan_and_each_has_its_own_folder(made: tuple[Experiment, list[Task]]) -> None:
    experiment, tasks = made
    assert len({task.name for task in tasks}) == len(tasks)
    folders = [str(task.writes) for task in tasks]
    assert len(set(folders)) == len(folders)
    plans = {task.name: task for task in tasks if not task.after}
    runs = [task for task in tasks if task.after]
    assert len(runs) > len(plans) >= 2
    for run in runs:
        (planned,) = run.after
        plan = plans[planned].writes
        assert plan is not None
        read = [str(item.path) for item in run.arguments if hasattr(item, "path") and not isinstance(item, Writes)]
        others = {
            str(other.writes / PLAN_FILE) for other in plans.values() if other is not plans[planned] and other.writes
        }
        assert not others & set(read)
    assert experiment.folder in {folder for path in map(Path, folders) for folder in path.parents}


def test_marks_tell_the_runs_apart_and_name_the_laboratory(made: tuple[Experiment, list[Task]]) -> None:
    _, tasks = made
    for task in tasks:
        if not task.after and task.writes is not None:
            task.writes.mkdir(parents=True, exist_ok=True)
            (task.writes / PLAN_FILE).write_bytes(b"a plan")
            for program in (file for file in task.files() if file.suffix == ".ngc"):
                shutil.copy(program, task.writes)
    marks = [task.mark() for task in tasks if task.after]
    assert len(set(marks)) == len(marks)
    assert all("code of counterflex_lab" in dict(task.mark()) for task in tasks)
