"""An experiment again on simulated cells: identify, plan, mill over sockets in lockstep, judge; table and page.

Every identification, plan and run is a step that is kept on disk when it has ended; an interrupted job goes on where it
was. Experiments differ by data, ways of correcting (:mod:`counterflex_lab.reproduce.way`), and by what a subclass of
:class:`Experiment` says.
"""

from __future__ import annotations

import shutil
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any, ClassVar, Final

from counterflex import __version__
from counterflex.app.campaign import campaign
from counterflex.app.campaign.step import CELL
from counterflex.app.campaign.tasks import TRUTH
from counterflex.app.compensation import compensate
from counterflex.app.long_jobs.step_cache import made_again, marks_below
from counterflex.app.long_jobs.task import Reads, Task, Writes
from counterflex.app.long_jobs.task_graph import run_tasks
from counterflex.app.proof import evaluate
from counterflex.app.run import session as online_session
from counterflex.app.simulated_cell import cell as live
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, in_parts, silent
from counterflex.files.summary_file import write_summary
from counterflex.report.page import write_page
from counterflex.twin.devices.path_answer import PathAnswer
from counterflex.twin.truth.family import MILD, Family
from counterflex_lab.reproduce import closed_loop
from counterflex_lab.reproduce.way import Way

PLANNED: Final = "compensated"
"""Folder of a plan; no way of correcting has this name, so that neither takes the other's place."""
PLAN_FILE: Final = "plan.parquet"
_FIGURES: Final = ("path", "entry", "plateau", "exit", "surface")
SAID: Final = ("cycles", "states", "causes", "largest_correction_um")


@dataclass(frozen=True)
class Run:
    """One run of a program on a simulated cell with the loop beside it."""

    name: str  # unique in the job
    part: Path  # folder that it writes
    cell: Path  # cell file of the way of correcting
    truth: Path  # truth file
    original: Path  # original program; the compensated one lies beside the plan
    plan: Path | None  # plan that the loop gets, if any
    way: Way  # how it is corrected
    seed: int  # of truth and instruments
    touched: Path | None = None  # truth at the time when the part was touched, where it is another

    def task(self, planned: str, function: Callable[..., dict[str, Any]]) -> Task:
        """It as a piece of work.

        Args:
            planned: Name of the task that makes the plan.
            function: :func:`mill`, or one that calls it.
        """
        reads = (None if file is None else Reads(str(file)) for file in self._files)
        commanded = (str(self.plan.with_name(self.original.name)),) if self.plan and self.way.compensated else ()
        arguments = (Writes(str(self.part)), *reads, self.way, self.seed)
        return Task(self.name, self.name, function, arguments, (planned,), tells=True, reads=commanded)

    @property
    def _files(self) -> tuple[Path | None, ...]:
        return self.cell, self.truth, self.original, self.plan, self.touched


Judge = Callable[[Path, Path, Mapping[str, Any]], dict[str, Any]]
"""Figures of a run, from the folder that the cell wrote, the loop's log and the loop's summary."""


def judged(part: Path, _log: Path, outcome: Mapping[str, Any]) -> dict[str, Any]:
    """Figures of ``evaluate``, and what the loop said."""
    found = evaluate.run([part], None)["variants"]["nominal"]
    figures = {key: found[key] for key in _FIGURES if key in found}
    return {**figures, "loop": {key: outcome[key] for key in SAID}}


@dataclass(frozen=True)
class Own:
    """Parts of an experiment that differ from the others."""

    judge: Judge = judged  # gives the figures of a run
    answer: PathAnswer = field(default_factory=PathAnswer)  # how the controller answers corrections
    cycles: int = 1600  # about what a run takes, for the progress


GROOVE: Final = Own()


def mill(
    part: str,
    cell: str,
    truth: str,
    original: str,
    plan: str | None,
    touched: str | None,
    way: Way,
    seed: int,
    *,
    own: Own = GROOVE,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Run cell and loop over sockets, each in a process of its own, and judge; files as :class:`Run` has them.

    Args:
        part: Folder that the simulated cell writes.
        cell: Cell file.
        truth: Truth file.
        original: Original program.
        plan: Plan file.
        touched: Earlier truth.
        way: How it is corrected.
        seed: Of truth and instruments.
        own: What the experiment does in a way of its own. A log is left only of a run that cannot be judged.
        progress: Progress callback, fraction 0 to 1.
    """
    folder, log = Path(part), Path(f"{part}-log")
    shutil.rmtree(log, ignore_errors=True)
    planned = None if plan is None else Path(plan)
    program = planned.with_name(Path(original).name) if planned and way.compensated else Path(original)
    before = None if touched is None else Path(touched)
    with resources.as_file(resources.files("counterflex.app") / "demo" / "rsi.xml") as config:
        twin = live.LiveSettings(
            program, Path(cell), Path(truth), ("rsi", config),
            original=Path(original), seed=seed, touched=before, answer=own.answer,
        )  # fmt: skip
        loop = online_session.RunSettings(
            Path(cell), ("rsi", config), planned, compensated=way.compensated, arm=way.armed
        )
        sensors = closed_loop.Sensors(way.force, way.tracker, way.holder)
        outcome = closed_loop.run(twin, folder, loop, log, sensors=sensors, cycles=own.cycles, progress=progress)
    figures = own.judge(folder, log, outcome)
    shutil.rmtree(log, ignore_errors=True)
    return figures


def plan_task(name: str, folder: Path, program: Path, cell: Path, **options: bool) -> Task:
    """The plan of a program as a piece of work; ``options`` as those of ``compensate``."""
    arguments = (Writes(str(folder)), Reads(str(program)), Reads(str(cell)), options)
    return Task(name, name, _planned, arguments, weight=2.0)


def _planned(folder: str, program: str, cell: str, options: Mapping[str, Any]) -> dict[str, Any]:
    compensate.run(program, cell, folder, report=False, **options)
    return {}


class Experiment(ABC):
    """A published experiment, or one of ours, on simulated cells.

    Args:
        out: Folder; what is there and was made from the same inputs is not done again.
        seeds: Truth seeds.
        family: Family that the truths are drawn from.
        level: Of :attr:`recipes`: what is identified of the cells first.
        quick: The first seed, the lower level, and as little as shows whether it works at all.
        workers: Runs at a time; None is one per core.

    Raises:
        InputError: No seeds, or an unknown level.
    """

    name: ClassVar[str]
    """As ``counterflex reproduce`` has it."""
    recipes: ClassVar[Mapping[str, tuple[str, ...]]]
    """What is identified of each simulated cell first, by level; the first is the quick one."""
    identifying: ClassVar[tuple[float, ...]] = (1.0, 4.0)
    """Share of the time that identifying takes, by level; milling takes the rest of ten."""

    def __init__(
        self,
        out: str | Path,
        *,
        seeds: Sequence[int],
        family: Family = MILD,
        level: str | None = None,
        quick: bool = False,
        workers: int | None = None,
    ) -> None:
        if not seeds:
            raise InputError("there are no truth seeds")
        levels = list(self.recipes)
        level = levels[0] if quick else level or levels[-1]
        if level not in levels:
            raise InputError("no such truth level", value=level, limit=", ".join(levels))
        self.folder, self.family, self.level, self.quick = Path(out), family, level, quick
        self.seeds = tuple(seeds[:1]) if quick else tuple(seeds)
        self.workers = workers

    def run(self, progress: Progress = silent) -> dict[str, Any]:
        """Do the job on files: a folder per truth, ``summary.json`` and ``report.html`` over all of them.

        Raises:
            CounterflexError: As the jobs it consists of.
        """
        start, before = time.perf_counter(), marks_below(self.folder)
        self.folder.mkdir(parents=True, exist_ok=True)
        share = self.identifying[list(self.recipes).index(self.level)]
        parts = in_parts(progress, {"identifying": share, "milling": 10.0 - share})
        self.identify(parts["identifying"])
        results = run_tasks(self.tasks(), self.workers, parts["milling"])
        summary = {
            "job": f"reproduce {self.name}",
            "truth_level": self.level,
            **self.summary(results),
            "seconds": round(time.perf_counter() - start, 1),
            "counterflex": __version__,
            "made_again": made_again(self.folder, before),
        }
        write_summary(self.folder / "summary.json", summary)
        page = self.page(summary)
        if page:
            write_page(page, self.folder / "report.html")
        progress(1.0, "done")
        return summary

    def identify(self, progress: Progress) -> None:
        """Have a laboratory identify the simulated cells."""
        campaign.run(
            self.catalogue(),
            self.folder / self.level,
            seeds=self.seeds,
            family=self.family,
            recipes=self.recipes[self.level],
            workers=self.workers,
            progress=progress,
        )

    def cell(self, seed: int) -> Path:
        """Identified cell file of a truth."""
        return self.folder / self.level / f"seed-{seed}" / CELL

    def truth(self, seed: int) -> Path:
        """Truth file."""
        return self.cell(seed).with_name(TRUTH)

    def catalogue(self) -> Path:
        """Write the cell file before any measurement, and the program where all truths have one."""
        raise NotImplementedError

    @abstractmethod
    def tasks(self) -> list[Task]:
        """Write programs and cell files; plans and runs, in order of urgency."""

    @abstractmethod
    def summary(self, results: Mapping[str, Any]) -> dict[str, Any]:
        """Table, figures over truths and goals, from what each task found by its name."""

    def page(self, summary: Mapping[str, Any]) -> str:  # noqa: ARG002
        """The page as HTML text; empty where there is none."""
        return ""
