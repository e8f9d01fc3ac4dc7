"""The tasks of a campaign: recipes of every truth, one waiting for the other; plans; programs machined."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex.app.campaign.axes import CHOSEN, PRESENT, CampaignSetup, branch_and_rotation
from counterflex.app.campaign.parameter_errors import parameter_errors
from counterflex.app.campaign.step import CELL, CampaignRecipe, step
from counterflex.app.compensation.compensate import compensate, limited_feed
from counterflex.app.compensation.languages import own_language, write
from counterflex.app.inputs import faults_in, in_working_plane, read_in_plane, read_job, setting_of
from counterflex.app.long_jobs.task import Reads, Task, Writes
from counterflex.app.posture import PostureOf
from counterflex.app.proof import simulate
from counterflex.app.proof.judge import ProofReference, judge, reference_of
from counterflex.app.proof.truth import exact_setting
from counterflex.core import atomic, file_content
from counterflex.core.arrays import Float
from counterflex.core.progress import Progress, share_of, silent
from counterflex.core.units import DEG
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.cell.set_up import text_placed_as, text_with_part, text_with_posture
from counterflex.files.summary_file import read_run
from counterflex.path.toolpath import FEED
from counterflex.plan.compensate import plan as make_plan
from counterflex.twin.truth.file import read_truth

POSES: Final = 16
"""Points of a program at which poses and deflections are compared with the truth."""


def placed(
    cell_file: str, program: str, pose: Mapping[str, float], posture: str, folder: str, *, progress: Progress = silent
) -> dict[str, Any]:
    """Write ``cell.toml``: the cell with the part elsewhere, or held in another posture.

    Args:
        pose: Keys of ``[part]`` that change (``x_mm`` ... ``c_deg``).

    Returns:
        ``branch`` and ``rotation_about_tool_deg``.

    Raises:
        CounterflexError: The program cannot be run there.
    """
    out = Path(folder)
    target = out / "cell.toml"
    atomic.write_text(target, text_with_part(Path(cell_file), pose, out))
    cell = read_cell(target)
    if posture == CHOSEN:
        best = PostureOf.of(program, cell, progress=progress).chosen.best
        atomic.write_text(target, text_with_posture(target, best.branch, best.rotation_rad / DEG, out))
    elif posture != PRESENT:
        branch, rotation_deg = branch_and_rotation(posture)
        atomic.write_text(target, text_with_posture(target, branch, rotation_deg, out))
    held = read_cell(target).tables.posture
    return {"branch": held.branch, "rotation_about_tool_deg": held.rotation_about_tool_deg}


def compensated(
    program: str, cell_file: str, folder: str, placed_cell: str | None = None, *, progress: Progress = silent
) -> dict[str, Any]:
    """Compensate a program with a cell, telling the fraction done.

    Args:
        placed_cell: Cell file that says where the part stands and how the robot holds the tool; None is the same.

    Returns:
        ``prediction``: figures of the plan.
    """
    out = Path(folder)
    if placed_cell is not None:
        atomic.write_text(out / "cell.toml", text_placed_as(Path(cell_file), Path(placed_cell), out))
        cell_file = str(out / "cell.toml")
    result = compensate(program, read_cell(cell_file), progress=progress)
    for name, text in result.files.items():
        atomic.write_bytes(out / name, text.encode(result.encoding, errors="replace"))
    return {"prediction": result.summary["prediction"]}


def compensated_exact(program: str, cell_file: str, truth_file: str, folder: str) -> dict[str, Any]:
    """Compensate a program with the truth's exact constants."""
    cell, job = read_in_plane(program, read_cell(cell_file))
    setting = exact_setting(job, cell, read_truth(truth_file))
    with faults_in(job):
        limited = limited_feed(job, cell, setting_of(cell, job, part_may_be_held=True))
        path = job.path if limited is None else limited.path
        plan = make_plan(path, job.line_of_motion, cell.stock(), setting, feeds=job.feeds, predict=False)
    for name, text in write(job, plan, cell, own_language(job.program))[0].items():
        atomic.write_bytes(Path(folder) / name, text.encode(job.program.encoding, errors="replace"))
    return {}


def machined(
    program: str,
    original: str,
    cell_file: str,
    truth_file: str,
    folder: str,
    keep: bool = True,
    *,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Machine a program on a truth and judge it against the original.

    Args:
        folder: What ``simulate`` writes goes there.
        keep: Write it; otherwise only the figures are kept.
        progress: Of the machining, which takes nine tenths of the time.

    Returns:
        Its figures in mm, as :func:`counterflex.evaluate.summary.variant_summary` has them.
    """
    reference = _reference(original, cell_file)
    machining = share_of(progress, 0.0, 0.9)
    if keep:
        out = Path(folder)
        simulate.run(program, cell_file, truth_file, out, original=original, progress=machining)
        run, surface = read_run(out / simulate.RUN)[0], simulate.read_part(out)[0]
    else:
        cell, truth = in_working_plane(original, read_cell(cell_file)), read_truth(truth_file)
        simulate.check_same_cell(cell, truth, truth_file)
        record = simulate.machine(read_job(program, cell), cell, truth, progress=machining)
        run, surface = record, record.stock
    return judge(reference, run, surface).variant.summary()


_references: Final[dict[str, ProofReference]] = {}
"""References that programs are judged against, by the contents of their files, which lie elsewhere on each worker."""


def _reference(original: str, cell_file: str) -> ProofReference:
    content = hashlib.sha256(file_content.content(original) + b"\n" + file_content.content(cell_file)).hexdigest()
    reference = _references.get(content)
    if reference is None:
        cell = in_working_plane(original, read_cell(cell_file))
        reference = reference_of(read_job(original, cell), cell)
        _references.clear()
        _references[content] = reference
    return reference


def compared(before: str, identified: str, truth_file: str, program: str | None, folder: str) -> dict[str, Any]:  # noqa: ARG001
    """The identified cell against the truth, at the joints of a program or, without one, around the part.

    Returns:
        ``rows``; nothing is written into the folder.
    """
    cell = read_cell(before)
    rows = parameter_errors(cell, read_cell(identified), read_truth(truth_file), _joints(cell, program))
    return {"rows": [row.plain() for row in rows]}


def _joints(cell: Cell, program: str | None) -> Float:
    """(n, 6) rad: at points spread over a program, or with the blank's corners and centre as the tool's places."""
    cell = cell if program is None else in_working_plane(program, cell)
    controller = simulate.controller(cell)
    if program is not None:
        path = read_job(program, cell).path
        feed = np.flatnonzero(path.kind == FEED)
        rows = feed[np.linspace(0, len(feed) - 1, POSES).round().astype(int)]
        return np.stack([controller.joints(path.p_part_tcp[[k]], path.axis_part[[k]])[0] for k in rows])
    stock = cell.stock()
    ny, nx = stock.z.shape
    x = stock.x0_m + stock.cell_m * (nx - 1) * np.array([0.0, 1.0, 0.0, 1.0, 0.5])
    y = stock.y0_m + stock.cell_m * (ny - 1) * np.array([0.0, 0.0, 1.0, 1.0, 0.5])
    p = np.stack([x, y, np.full(5, float(stock.z.max()))], axis=1)
    return np.stack([controller.joints(row[None], np.array([[0.0, 0.0, 1.0]]))[0] for row in p])


TRUTH: Final = "truth.toml"
_PLACING, _CHOOSING, _PLANNING, _COMPARING = 0.02, 0.5, 0.2, 0.05  # Expected time, relative to a machining


@dataclass(frozen=True)
class TaskPlace:
    """One truth and where its files are."""

    name: str
    folder: Path
    seed: int | None
    steps: tuple[CampaignRecipe, ...]

    @property
    def truth(self) -> str:
        """Its file."""
        return str(self.folder / TRUTH)

    def step_folder(self, k: int) -> Path:
        """Folder of a recipe."""
        return self.folder / f"{k + 1}-{self.steps[k].recipe}"

    def cell_after(self, k: int, start: Path) -> str:
        """Cell file after step k; ``start`` for -1."""
        return str(start if k < 0 else self.step_folder(k) / CELL)

    def last(self, start: Path) -> tuple[str, tuple[str, ...]]:
        """The identified cell file, and the task that makes it."""
        after = (f"{self.name}/{self.steps[-1].recipe}",) if self.steps else ()
        return self.cell_after(len(self.steps) - 1, start), after


@dataclass(frozen=True)
class Layout:
    """Places of the files of a campaign."""

    out: Path
    inputs: tuple[str, ...]
    with_exact: bool
    keep: bool  # Keep what ``simulate`` writes of every machining, not only its figures

    @property
    def start(self) -> Path:
        """The cell file as it was."""
        return self.out / CELL

    def program(self, setup: CampaignSetup) -> str:
        """Its program as it was."""
        return str(self.out / "original" / setup.program)

    def cell(self, setup: CampaignSetup) -> str:
        """The cell file with the part and the posture of a set-up."""
        return str(self.out / "setups" / setup.name / CELL) if setup.moved else str(self.start)

    def planned(self, setup: CampaignSetup) -> Path:
        """Folder of the program planned with the cell file as it was."""
        return self.out / "compensated" / setup.name


def tasks_of(places: Sequence[TaskPlace], setups: Sequence[CampaignSetup], layout: Layout) -> list[Task]:
    """All tasks, the recipes before what is machined, which fills the gaps."""
    tasks: list[Task] = []
    for setup in setups:
        tasks += _prepared(setup, layout)
    for place in places:
        tasks += _identified(place, layout, setups[0] if setups else None)
    for place in places:
        for setup in setups:
            tasks += _machined(place, setup, layout)
    return tasks


def _named(*parts: str) -> str:
    return "/".join(part for part in parts if part)


def _prepared(setup: CampaignSetup, layout: Layout) -> Iterator[Task]:
    program, after = Reads(layout.program(setup)), _placed(setup)
    words = f"{setup.name}: " if setup.name else ""
    if after:
        folder = Writes(str(Path(layout.cell(setup)).parent))
        placing = (Reads(str(layout.start)), program, setup.placement.pose, setup.posture, folder)
        weight = _CHOOSING if setup.posture == CHOSEN else _PLACING
        yield Task(after[0], f"{words}placing", placed, placing, (), weight, tells=True, reads=layout.inputs)
    planning = (program, Reads(layout.cell(setup)), Writes(str(layout.planned(setup))))
    name = _named("compensated", setup.name)
    yield Task(name, f"{words}planning", compensated, planning, after, _PLANNING, tells=True, reads=layout.inputs)


def _placed(setup: CampaignSetup) -> tuple[str, ...]:
    """The task that places part and robot; none where they are as in the cell file."""
    return (_named("placed", setup.name),) if setup.moved else ()


def _identified(place: TaskPlace, layout: Layout, setup: CampaignSetup | None) -> Iterator[Task]:
    for k, plan in enumerate(place.steps):
        yield Task(
            f"{place.name}/{plan.recipe}",
            f"{place.name}: {plan.recipe}",
            step,
            (
                plan,
                Reads(place.cell_after(k - 1, layout.start)),
                Reads(place.truth),
                Writes(str(place.step_folder(k))),
                place.seed or 0,
            ),
            (f"{place.name}/{place.steps[k - 1].recipe}",) if k else (),
            plan.weight,
            tells=True,
            reads=layout.inputs,
        )
    end, after = place.last(layout.start)
    yield Task(
        f"{place.name}/truth",
        f"{place.name}: against the truth",
        compared,
        (
            Reads(str(layout.start)),
            Reads(end),
            Reads(place.truth),
            None if setup is None else Reads(layout.program(setup)),
            Writes(str(place.folder / "parameter-errors")),
        ),
        after,
        _COMPARING,
        reads=layout.inputs,
    )


def _machined(place: TaskPlace, setup: CampaignSetup, layout: Layout) -> Iterator[Task]:
    here, words = place.folder / setup.name, _named(place.name, setup.name)
    cell, original = Reads(layout.cell(setup)), Reads(layout.program(setup))
    ready = _placed(setup)
    planned = _named("compensated", setup.name)
    variants = [
        ("nominal", original, ready),
        ("catalogue", Reads(str(layout.planned(setup) / setup.program)), (planned,)),
    ]
    if place.steps:
        end, after = place.last(layout.start)
        own = here / "compensated"
        arguments = (original, Reads(end), Writes(str(own)), *((cell,) if setup.moved else ()))
        name = f"{words}/plan"
        yield Task(
            name,
            f"{words}: planning",
            compensated,
            arguments,
            (*after, *ready),
            _PLANNING,
            tells=True,
            reads=layout.inputs,
        )
        variants.append(("identified", Reads(str(own / setup.program)), (name,)))
    if layout.with_exact:
        exact = here / "exact"
        name = f"{words}/exact"
        arguments = (original, cell, Reads(place.truth), Writes(str(exact)))
        yield Task(name, f"{words}: planning", compensated_exact, arguments, ready, reads=layout.inputs)
        variants.append(("exact", Reads(str(exact / setup.program)), (name,)))
    for level, program, after in variants:
        yield Task(
            machined_name(place, setup, level),
            f"{words}: machining, {level}",
            machined,
            (program, original, cell, Reads(place.truth), Writes(str(here / f"machined-{level}")), layout.keep),
            after,
            tells=True,
            reads=layout.inputs,
        )


def machined_name(place: TaskPlace, setup: CampaignSetup, variant: str) -> str:
    """Name of the task that machines a variant."""
    return f"{_named(place.name, setup.name)}/machined {variant}"
