"""Set up a cell as a laboratory would, on simulated cells, and show what that is worth.

For every truth the recipes of :mod:`.campaign_plan` are done one after the other, over files: propose, measure on the
twin, identify, validate on a measurement of its own, go on with the cell so far. Then a program is compensated with the
cell file as it was and with the identified one, and machined on the same simulated cell before and after. Every
finished step is kept on disk with a fingerprint of its inputs: an interrupted campaign goes on where it was.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from counterflex import __version__
from counterflex.app.campaign.plan import Measurement, campaign_of
from counterflex.app.campaign.proof import compared, compensated, compensated_exact, machined
from counterflex.app.campaign.step import CELL, RESULT, step
from counterflex.app.compensation.cell_facts import robot_name
from counterflex.app.inputs import read_job
from counterflex.app.long_jobs.step_cache import made_again
from counterflex.app.long_jobs.task_graph import Task, run_tasks
from counterflex.app.proof.simulate import check_same_cell
from counterflex.app.proof.truth import make_truth
from counterflex.app.unknown_stiffness import require_stiffness
from counterflex.core import atomic
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, silent
from counterflex.evaluate.summary import SeedResult, summary
from counterflex.evaluate.truth_level import TruthLevel
from counterflex.files.cell.cell import read_cell
from counterflex.files.cell.update import copied_text
from counterflex.files.summary_file import write_summary
from counterflex.twin.truth.family import MILD, Family
from counterflex.twin.truth.file import read_truth, write_truth
from counterflex.twin.truth.truth import Truth

TRUTH: Final = "truth.toml"
_LEVELS: Final[tuple[TruthLevel, ...]] = ("identified", "catalogue", "exact")


@dataclass(frozen=True)
class _Place:
    """One truth and where its files are."""

    name: str
    folder: Path
    seed: int | None
    steps: tuple[Measurement, ...]

    @property
    def truth(self) -> str:
        return str(self.folder / TRUTH)

    def step_folder(self, k: int) -> Path:
        return self.folder / f"{k + 1}-{self.steps[k].recipe}"

    def cell_after(self, k: int, start: Path) -> str:
        """Cell file after step k; ``start`` for -1."""
        return str(start if k < 0 else self.step_folder(k) / CELL)


def run(
    cell_file: str | Path,
    out: str | Path,
    *,
    program: str | Path | None = None,
    seeds: Sequence[int] | None = None,
    family: Family = MILD,
    truth_file: str | Path | None = None,
    recipes: Sequence[str] | None = None,
    with_exact: bool = False,
    workers: int | None = None,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Do the job on files.

    Writes for every truth a folder ``seed-N`` with one folder per recipe, the machined programs and ``cell.toml``, the
    identified cell; ``summary.json`` and ``report.html`` over all of them. What is there already and was made from the
    same inputs is not done again.

    Args:
        cell_file: Cell as it is before any measurement.
        out: Folder.
        program: G-code to compensate and machine before and after; None identifies only.
        seeds: Truth seeds.
        family: Family that the truths are drawn from.
        truth_file: The one truth to do it for, instead of ``seeds``.
        recipes: Only these; None is all that the cell allows.
        with_exact: Also machine the program planned with the truth's exact constants.
        workers: Processes; None is one per core.
        progress: Progress callback, fraction 0 to 1.

    Returns:
        The summary.

    Raises:
        InputError: Neither or both of ``seeds`` and ``truth_file``, or an unknown recipe.
        CounterflexError: As the jobs it consists of.
    """
    if (seeds is None) == (truth_file is None):
        raise InputError("a campaign needs either a number of seeds or one truth file")
    if seeds is not None and not seeds:
        raise InputError("there are no truth seeds")
    begin, begun = time.perf_counter(), time.time()
    folder, cell = Path(out), read_cell(cell_file)
    cell.require_milling()
    require_stiffness(cell)
    steps = campaign_of(cell, recipes)
    if program is not None:
        read_job(program, cell)
    truth = None if truth_file is None else read_truth(truth_file)
    if truth is not None:
        check_same_cell(cell, truth, str(truth_file))
    start = _keep(copied_text(Path(cell_file), folder).encode("utf-8"), folder / CELL)
    part = None
    if program is not None:
        part = _keep(Path(program).read_bytes(), folder / "original" / Path(program).name)
    places = _places(start, folder, seeds or (), family, truth, steps)
    tasks = _tasks(places, start, part, with_exact=with_exact)
    results = run_tasks(tasks, workers, progress)
    for place in places:
        if steps:
            end = Path(place.cell_after(len(steps) - 1, start))
            _keep(copied_text(end, place.folder).encode("utf-8"), place.folder / CELL)
    summary = _summary(places, results, part, start, time.perf_counter() - begin)
    summary["family"] = family.name if truth is None else truth.family
    summary["made_again"] = made_again(folder, begun)
    from counterflex.app.campaign.report import campaign_page_of
    from counterflex.report.page import write_page

    write_summary(folder / "summary.json", summary)
    write_page(campaign_page_of(summary), folder / "report.html")
    return summary


def _keep(data: bytes, target: Path) -> Path:
    """Write a file unless it is there already, byte for byte."""
    if not target.is_file() or target.read_bytes() != data:
        atomic.write_bytes(target, data)
    return target


def _places(
    start: Path,
    out: Path,
    seeds: Sequence[int],
    family: Family,
    truth: Truth | None,
    steps: tuple[Measurement, ...],
) -> list[_Place]:
    places = []
    if truth is not None:
        name = "twin" if truth.seed is None else f"seed-{truth.seed}"
        places.append(_Place(name, out / name, truth.seed, steps))
        write_truth(places[0].truth, truth)
    cell = read_cell(start)
    for seed in seeds:
        places.append(_Place(f"seed-{seed}", out / f"seed-{seed}", seed, steps))
        make_truth(cell, seed, places[-1].truth, family)
    return places


def _tasks(places: Sequence[_Place], start: Path, part: Path | None, *, with_exact: bool) -> list[Task]:
    """Recipes of every truth first, one waiting for the other; machining fills the gaps."""
    tasks: list[Task] = []
    for place in places:
        for k, plan in enumerate(place.steps):
            tasks.append(
                Task(
                    f"{place.name}/{plan.recipe}",
                    f"{place.name}: {plan.recipe}",
                    step,
                    (plan, place.cell_after(k - 1, start), place.truth, str(place.step_folder(k)), place.seed or 0),
                    (f"{place.name}/{place.steps[k - 1].recipe}",) if k else (),
                    plan.weight,
                    tells=True,
                )
            )
        last = (f"{place.name}/{place.steps[-1].recipe}",) if place.steps else ()
        end = place.cell_after(len(place.steps) - 1, start)
        tasks.append(
            Task(
                f"{place.name}/truth",
                f"{place.name}: against the truth",
                compared,
                (str(start), end, place.truth, None if part is None else str(part)),
                last,
                0.05,
            )
        )
    if part is None:
        return tasks
    shared = start.parent / "compensated"
    tasks.insert(
        0, Task("compensated", "planning", compensated, (str(part), str(start), str(shared)), (), 0.2, tells=True)
    )
    for place in places:
        tasks += _machining(place, start, part, shared, with_exact=with_exact)
    return tasks


def _machining(place: _Place, start: Path, part: Path, shared: Path, *, with_exact: bool) -> list[Task]:
    last = (f"{place.name}/{place.steps[-1].recipe}",) if place.steps else ()
    own = place.folder / "compensated"
    end = place.cell_after(len(place.steps) - 1, start)
    planned = [
        Task(
            f"{place.name}/plan",
            f"{place.name}: planning",
            compensated,
            (str(part), end, str(own)),
            last,
            0.2,
            tells=True,
        )
    ]
    variants = [("nominal", part, ()), ("catalogue", shared / part.name, ("compensated",))]
    if place.steps:
        variants.append(("identified", own / part.name, (f"{place.name}/plan",)))
    else:
        planned = []
    if with_exact:
        exact = place.folder / "exact"
        planned.append(
            Task(
                f"{place.name}/exact",
                f"{place.name}: planning",
                compensated_exact,
                (str(part), str(start), place.truth, str(exact)),
            )
        )
        variants.append(("exact", exact / part.name, (f"{place.name}/exact",)))
    runs = [
        Task(
            f"{place.name}/machined {name}",
            f"{place.name}: machining, {name}",
            machined,
            (str(program), str(part), str(start), place.truth, str(place.folder / f"machined-{name}")),
            after,
            tells=True,
        )
        for name, program, after in variants
    ]
    return [*planned, *runs]


def _with_report(result: Mapping[str, Any], place: _Place, k: int) -> dict[str, Any]:
    """What a recipe found, and where its report is, relative to the campaign's folder."""
    report = f"{place.folder.name}/{place.step_folder(k).name}/{RESULT}/report.html" if result["accepted"] else ""
    return {**result, "report": report}


def _summary(
    places: Sequence[_Place], results: Mapping[str, Any], part: Path | None, start: Path, seconds: float
) -> dict[str, Any]:
    cell = read_cell(start)
    campaigns = [
        {
            "seed": place.seed,
            "recipes": [
                _with_report(results[f"{place.name}/{place.steps[k].recipe}"], place, k)
                for k in range(len(place.steps))
            ],
            "parameter_errors": results[f"{place.name}/truth"],
        }
        for place in places
    ]
    about: dict[str, Any] = {
        "job": "campaign",
        "program": "" if part is None else part.name,
        "cell": cell.name,
        "robot": robot_name(cell),
        "campaigns": campaigns,
        "seconds": round(seconds, 1),
        "counterflex": __version__,
    }
    if part is None:
        return about
    about["prediction"] = results["compensated"]["prediction"]
    seeds = [
        SeedResult(
            place.seed,
            name,
            {
                "nominal": results[f"{place.name}/machined nominal"],
                "compensated": results[f"{place.name}/machined {name}"],
            },
        )
        for name in _LEVELS
        for place in places
        if f"{place.name}/machined {name}" in results
    ]
    return summary(seeds, about)
