"""The tasks of a campaign: recipes of every truth, one waiting for the other; plans; programs machined."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from counterflex.app.campaign.axes import CHOSEN, Setup
from counterflex.app.campaign.plan import Measurement
from counterflex.app.campaign.proof import compared, compensated, compensated_exact, machined, placed
from counterflex.app.campaign.step import CELL, step
from counterflex.app.long_jobs.task import Reads, Task, Writes

TRUTH: Final = "truth.toml"
_PLACING, _CHOOSING, _PLANNING, _COMPARING = 0.02, 0.5, 0.2, 0.05
"""Expected time, relative to a machining."""


@dataclass(frozen=True)
class Place:
    """One truth and where its files are."""

    name: str
    folder: Path
    seed: int | None
    steps: tuple[Measurement, ...]

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
    """Where the files of a campaign are."""

    out: Path
    inputs: tuple[str, ...]
    with_exact: bool
    keep: bool  # Keep what ``simulate`` writes of every machining, not only its figures

    @property
    def start(self) -> Path:
        """The cell file as it was."""
        return self.out / CELL

    def program(self, setup: Setup) -> str:
        """Its program as it was."""
        return str(self.out / "original" / setup.program)

    def cell(self, setup: Setup) -> str:
        """The cell file with the part and the posture of a set-up."""
        return str(self.out / "setups" / setup.name / CELL) if setup.moved else str(self.start)

    def planned(self, setup: Setup) -> Path:
        """Folder of the program planned with the cell file as it was."""
        return self.out / "compensated" / setup.name


def tasks_of(places: Sequence[Place], setups: Sequence[Setup], layout: Layout) -> list[Task]:
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


def _prepared(setup: Setup, layout: Layout) -> Iterator[Task]:
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


def _placed(setup: Setup) -> tuple[str, ...]:
    """The task that places part and robot; none where they are as in the cell file."""
    return (_named("placed", setup.name),) if setup.moved else ()


def _identified(place: Place, layout: Layout, setup: Setup | None) -> Iterator[Task]:
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


def _machined(place: Place, setup: Setup, layout: Layout) -> Iterator[Task]:
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


def machined_name(place: Place, setup: Setup, variant: str) -> str:
    """Name of the task that machines a variant."""
    return f"{_named(place.name, setup.name)}/machined {variant}"
