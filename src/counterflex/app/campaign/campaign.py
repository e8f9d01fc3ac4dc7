"""Set up a cell as a laboratory would, on simulated cells, and show what that is worth.

For every truth the recipes of :mod:`.campaign_plan` are done one after the other, over files: propose, measure on the
twin, identify, validate on a measurement of its own, go on with the cell so far. Then a program is compensated with the
cell file as it was and with the identified one, and machined on the same simulated cell before and after. Every
finished step is kept on disk with a fingerprint of its inputs: an interrupted campaign goes on where it was.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import polars

from counterflex import __version__
from counterflex.app.campaign.axes import IDENTIFY_ONLY, CampaignSetup, Grid
from counterflex.app.campaign.step import CELL, RESULT, CampaignRecipe, campaign_of
from counterflex.app.campaign.tasks import Layout, TaskPlace, machined_name, tasks_of
from counterflex.app.compensation.cell_facts import robot_name
from counterflex.app.inputs import read_in_plane
from counterflex.app.long_jobs.cluster import cluster
from counterflex.app.long_jobs.executors import Start, here
from counterflex.app.long_jobs.scheduler import require_scheduler
from counterflex.app.long_jobs.step_cache import made_again, marks_below
from counterflex.app.long_jobs.task import Failed
from counterflex.app.long_jobs.task_graph import run_tasks
from counterflex.app.long_jobs.workers import count_of
from counterflex.app.proof.simulate import check_same_cell
from counterflex.app.proof.truth import make_truth
from counterflex.app.unknown_stiffness import require_stiffness
from counterflex.core import atomic, file_content
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, silent
from counterflex.evaluate.summary import SeedResult, TruthLevel, summary
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.cell.set_up import copied_text, text_with_files
from counterflex.files.summary_file import write_summary
from counterflex.twin.truth.family import MILD, Family
from counterflex.twin.truth.file import read_truth, write_truth
from counterflex.twin.truth.truth import Truth

FILE: Final = "results.parquet"
LEVELS: Final[tuple[TruthLevel, ...]] = ("identified", "catalogue", "exact")
_FIGURES: Final = ("p997_mm", "max_mm", "rms_mm")
_SCHEMA: Final = {
    "program": polars.String,
    "placement": polars.String,
    "posture": polars.String,
    "branch": polars.String,
    "rotation_about_tool_deg": polars.Float64,
    "seed": polars.Int64,
    "truth_level": polars.String,
    **{f"{variant}_{name}": polars.Float64 for variant in ("nominal", "compensated") for name in _FIGURES},
    "remains_percent": polars.Float64,
    "fault": polars.String,
}


def rows_of_results(
    places: Sequence[TaskPlace], setups: Sequence[CampaignSetup], results: Mapping[str, Any]
) -> Iterator[dict[str, Any]]:
    """Rows of the table, in the order of set-ups, seeds, levels.

    Yields:
        Values by column; figures are empty and ``fault`` says why where a task could not be done.
    """
    for setup in setups:
        held = results.get(f"placed/{setup.name}")
        for place in places:
            before = results[machined_name(place, setup, "nominal")]
            for level in LEVELS:
                after = results.get(machined_name(place, setup, level))
                if after is not None:
                    yield _row(place, setup, level, held, (before, after))


def _row(place: TaskPlace, setup: CampaignSetup, level: str, held: Any, machined: tuple[Any, Any]) -> dict[str, Any]:
    row: dict[str, Any] = dict.fromkeys(_SCHEMA)
    row |= {
        "program": setup.program,
        "placement": setup.placement.name,
        "posture": setup.posture,
        "seed": place.seed,
        "truth_level": level,
        "fault": next((item.why for item in machined if isinstance(item, Failed)), None),
    }
    if isinstance(held, Mapping):
        row |= {key: held[key] for key in ("branch", "rotation_about_tool_deg")}
    for variant, item in zip(("nominal", "compensated"), machined, strict=True):
        if not isinstance(item, Failed):
            row |= {f"{variant}_{name}": item["path"][name] for name in _FIGURES}
    if row["fault"] is None and row["nominal_p997_mm"] > 0.0:
        row["remains_percent"] = 100.0 * row["compensated_p997_mm"] / row["nominal_p997_mm"]
    return row


def write_results(file: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write the table as Parquet, whole or not at all."""
    atomic.write_made(file, polars.DataFrame(list(rows), schema=_SCHEMA, orient="row").write_parquet)


def over_seeds(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """One entry for each set-up and truth level: median and worst over the simulated cells, and how many failed."""
    groups: dict[tuple[str, ...], list[Mapping[str, Any]]] = {}
    for row in rows:
        groups.setdefault((row["program"], row["placement"], row["posture"], row["truth_level"]), []).append(row)
    out = []
    for (program, placement, posture, level), members in groups.items():
        entry: dict[str, Any] = {"program": program, "placement": placement, "posture": posture, "truth_level": level}
        for key in ("nominal_p997_mm", "compensated_p997_mm", "remains_percent"):
            values = [row[key] for row in members if row[key] is not None and row["fault"] is None]
            entry[key] = {"median": _round(statistics.median(values)), "worst": _round(max(values))} if values else None
        faults = [row["fault"] for row in members if row["fault"] is not None]
        out.append({**entry, "cells": len(members), "failed": len(faults), "fault": faults[0] if faults else ""})
    return out


def _round(value: float) -> float:
    return round(value, 4)


def run(
    cell_file: str | Path,
    out: str | Path,
    *,
    grid: Grid = IDENTIFY_ONLY,
    seeds: Sequence[int] | None = None,
    family: Family = MILD,
    truth_file: str | Path | None = None,
    recipes: Sequence[str] | None = None,
    with_exact: bool = False,
    workers: int | str | None = None,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Do the job on files.

    Writes for every truth a folder ``seed-N`` with one folder per recipe, the machined programs and ``cell.toml``, the
    identified cell; ``results.parquet``, ``summary.json`` and ``report.html`` over all of them. What is there already
    and was made from the same inputs is not done again.

    Args:
        grid: Programs to compensate and machine before and after, placements of the part, postures; without a program
            the cells are only identified. With several set-ups (program, placement, posture) one that cannot be run is
            a row with its fault, and of every machining only the figures are kept.
        truth_file: The one truth to do it for, instead of ``seeds``.
        recipes: Only these; None is all that the cell allows, none identifies nothing.
        with_exact: Also machine the program planned with the truth's exact constants.
        workers: Processes of this machine; None is one per core, 1 starts none. Or the address of a scheduler of dask,
            whose workers do it instead.

    Raises:
        InputError: Neither or both of ``seeds`` and ``truth_file``, an unknown recipe, nothing to do, no scheduler, or
            no set-up could be run.
    """
    setups = grid.setups()
    _require_task(seeds, truth_file, setups, recipes)
    if isinstance(workers, str):
        require_scheduler(workers)
    begin = time.perf_counter()
    folder, cell = Path(out), read_cell(cell_file)
    before = marks_below(folder)
    cell.require_milling()
    require_stiffness(cell)
    steps = campaign_of(cell, recipes)
    for program in grid.programs:
        read_in_plane(program, cell)
    truth = None if truth_file is None else _truth_of(cell, truth_file)
    layout = Layout(folder, _kept_inputs(Path(cell_file), folder, grid.programs), with_exact, keep=len(setups) < 2)
    places = _places(layout.start, folder, seeds or (), family, truth, steps)
    tasks = tasks_of(places, setups, layout)
    results = run_tasks(tasks, 1, progress, start=_start(folder, workers, len(tasks)), keep_going=len(setups) > 1)
    rows = list(rows_of_results(places, setups, results))
    if rows and all(row["fault"] is not None for row in rows):
        raise InputError("none of the set-ups could be run", value=rows[0]["fault"])
    for place in places if steps else ():
        end = Path(place.last(layout.start)[0])
        if end.is_file():
            atomic.write_text(place.folder / CELL, copied_text(end, place.folder))
    summary = _summary(places, setups, results, layout, time.perf_counter() - begin)
    summary["family"] = family.name if truth is None else truth.family
    summary["made_again"] = made_again(folder, before)
    if len(setups) > 1:
        summary["setups"] = over_seeds(rows)
    from counterflex.app.campaign.report import campaign_page_of
    from counterflex.report.page import write_page

    with atomic.atomic_folder(folder) as staging:
        if rows:
            write_results(staging / FILE, rows)
        write_summary(staging / "summary.json", summary)
        write_page(campaign_page_of(summary), staging / "report.html")
    return summary


def _require_task(
    seeds: Sequence[int] | None, truth_file: object, setups: Sequence[CampaignSetup], recipes: Sequence[str] | None
) -> None:
    if (seeds is None) == (truth_file is None):
        raise InputError("a campaign needs either a number of seeds or one truth file")
    if seeds is not None and not seeds:
        raise InputError("there are no truth seeds")
    if not setups and recipes is not None and not recipes:
        raise InputError("without a program and without a recipe there is nothing to do")


def _truth_of(cell: Cell, file: str | Path) -> Truth:
    truth = read_truth(file)
    check_same_cell(cell, truth, str(file))
    return truth


def _start(folder: Path, workers: int | str | None, tasks: int) -> Start:
    if isinstance(workers, str):
        return cluster(folder, scheduler=workers)
    count = count_of(workers, tasks)
    return here if count == 1 else cluster(folder, count=count)


def _kept_inputs(cell_file: Path, out: Path, programs: Sequence[str | Path]) -> tuple[str, ...]:
    """Put cell file, the files that it names and the programs into the folder; return the names of the files."""
    text, files = text_with_files(cell_file, out, out / "inputs")
    content = {**files, out / CELL: text.encode("utf-8")}
    content |= {out / "original" / Path(program).name: file_content.content(program) for program in programs}
    new = {path: data for path, data in content.items() if not path.is_file() or file_content.content(path) != data}
    with atomic.atomic_folder(out) as staging:
        for path, data in new.items():
            atomic.write_bytes(staging / path.relative_to(out), data)
    return tuple(str(file) for file in sorted(files))


def _places(
    start: Path, out: Path, seeds: Sequence[int], family: Family, truth: Truth | None, steps: tuple[CampaignRecipe, ...]
) -> list[TaskPlace]:
    places = []
    if truth is not None:
        name = "twin" if truth.seed is None else f"seed-{truth.seed}"
        places.append(TaskPlace(name, out / name, truth.seed, steps))
        write_truth(places[0].truth, truth)
    cell = read_cell(start)
    for seed in seeds:
        places.append(TaskPlace(f"seed-{seed}", out / f"seed-{seed}", seed, steps))
        make_truth(cell, seed, places[-1].truth, family)
    return places


def _with_report(result: Mapping[str, Any], place: TaskPlace, k: int) -> dict[str, Any]:
    """Return what a recipe brought, and where its report is, relative to the campaign's folder."""
    report = f"{place.folder.name}/{place.step_folder(k).name}/{RESULT}/report.html" if result["accepted"] else ""
    return {**result, "report": report}


def _summary(
    places: Sequence[TaskPlace],
    setups: Sequence[CampaignSetup],
    results: Mapping[str, Any],
    layout: Layout,
    seconds: float,
) -> dict[str, Any]:
    cell = read_cell(layout.start)
    campaigns = []
    for place in places:
        outcomes = [results[f"{place.name}/{plan.recipe}"] for plan in place.steps]
        against = results[f"{place.name}/truth"]
        campaigns.append(
            {
                "seed": place.seed,
                "recipes": [
                    _with_report(item, place, k) for k, item in enumerate(outcomes) if not isinstance(item, Failed)
                ],
                "parameter_errors": [] if isinstance(against, Failed) else against["rows"],
            }
        )
    about: dict[str, Any] = {
        "job": "campaign",
        "program": ", ".join(dict.fromkeys(setup.program for setup in setups)),
        "cell": cell.name,
        "robot": robot_name(cell),
        "campaigns": campaigns,
        "seconds": round(seconds, 1),
        "counterflex": __version__,
    }
    if len(setups) != 1:
        return about
    about["prediction"] = results["/".join(filter(None, ("compensated", setups[0].name)))]["prediction"]
    seeds = [
        SeedResult(
            place.seed,
            level,
            {
                "nominal": results[machined_name(place, setups[0], "nominal")],
                "compensated": results[machined_name(place, setups[0], level)],
            },
        )
        for level in LEVELS
        for place in places
        if machined_name(place, setups[0], level) in results
    ]
    return summary(seeds, about)
