"""Reproduce how a plan fails and what corrects it: wrong plans by ways of correcting, over sockets in lockstep.

Every identification, plan and run is kept on disk when it has ended; an interrupted job goes on where it was.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any, Final

from counterflex import __version__
from counterflex.app.campaign import campaign
from counterflex.app.campaign.step import CELL
from counterflex.app.campaign.tasks import TRUTH
from counterflex.app.compensation import compensate
from counterflex.app.long_jobs.step_cache import begin, finish, finished, made_again, marks_below
from counterflex.app.long_jobs.task import Task
from counterflex.app.long_jobs.task_graph import run_tasks
from counterflex.app.proof import evaluate
from counterflex.app.run import session as online_session
from counterflex.app.simulated_cell import cell as live
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, in_parts, silent
from counterflex.files.summary_file import write_summary
from counterflex.report.page import write_page
from counterflex.twin.truth.family import WIDE, Family
from counterflex_lab.reproduce import closed_loop, online_case, online_report
from counterflex_lab.reproduce.mark import mark_of
from counterflex_lab.reproduce.online_case import WAYS
from counterflex_lab.reproduce.wrong_plans import WRONG

RECIPES: Final = ("tracker-frame", "stiffness", "kinematics", "payload", "play", "servo", "timing", "cutting")
"""What is identified of each simulated cell before anything goes wrong."""
QUICK_ROWS: Final = ("as planned", "worn tool")
PLANNED: Final = "compensated"
_PLAN_FILE: Final = "plan.parquet"
_FIGURES: Final = ("path", "entry", "plateau", "exit")
_CYCLES: Final = 1500
"""About what a run takes, for the progress."""


def run(
    out: str | Path,
    *,
    seeds: Sequence[int] = (1001, 1002, 1003),
    family: Family = WIDE,
    rows: Sequence[str] = tuple(WRONG),
    quick: bool = False,
    workers: int | None = None,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Do the job on files: a folder per truth and row, ``summary.json`` and ``report.html`` over all of them.

    Args:
        out: Folder; what is there and was made from the same inputs is not done again.
        seeds: Truth seeds.
        family: Family that the truths are drawn from.
        rows: Of :data:`~counterflex_lab.reproduce.wrong_plans.WRONG`; the right plan is always among them.
        quick: The first seed, a right plan and a worn tool only; of the cell, only its payload is identified.
        workers: Runs at a time; None is one per core.
        progress: Progress callback, fraction 0 to 1.

    Returns:
        The summary.

    Raises:
        InputError: No seeds, or an unknown row.
        CounterflexError: As the jobs it consists of.
    """
    if not seeds:
        raise InputError("there are no truth seeds")
    for row in rows:
        if row not in WRONG:
            raise InputError("no such row", value=row, limit=", ".join(WRONG))
    start, folder = time.perf_counter(), Path(out)
    before = marks_below(folder)
    folder.mkdir(parents=True, exist_ok=True)
    numbers = tuple(seeds[:1]) if quick else tuple(seeds)
    required = QUICK_ROWS if quick else tuple(row for row in WRONG if row in rows or row == next(iter(WRONG)))
    recipes = ("tracker-frame", "payload") if quick else RECIPES
    parts = in_parts(progress, {"identifying": 1.0 if quick else 2.0, "milling": 8.0})
    catalogue = online_case.catalogue_cell(folder)
    campaign.run(
        catalogue,
        folder / "cells",
        seeds=numbers,
        family=family,
        recipes=recipes,
        workers=workers,
        progress=parts["identifying"],
    )
    results = run_tasks(_tasks(folder, numbers, required), workers, parts["milling"])
    summary = _summary(results, numbers, required, family, "catalogue" if quick else "identified")
    summary |= {"made_again": made_again(folder, before), "seconds": round(time.perf_counter() - start, 1)}
    write_summary(folder / "summary.json", summary)
    write_page(online_report.page(summary), folder / "report.html")
    progress(1.0, "done")
    return summary


def _tasks(folder: Path, seeds: Sequence[int], rows: Sequence[str]) -> list[Task]:
    tasks = []
    for seed in seeds:
        plan = f"{seed}: plan"
        tasks.append(Task(plan, plan, prepare, (str(folder), seed, tuple(rows)), weight=2.0))
        for row in rows:
            for way in WAYS:
                name = _name(seed, row, way)
                tasks.append(Task(name, name, one, (str(folder), seed, row, way), (plan,), tells=True))
    return tasks


def _name(seed: int, row: str, way: str) -> str:
    return f"{seed}: {row}: {way}"


def _place(folder: str | Path, seed: int, row: str) -> Path:
    return Path(folder) / f"seed-{seed}" / row.replace(" ", "-")


def prepare(folder: str, seed: int, rows: Sequence[str]) -> None:
    """Plan of a simulated cell, and the files of everything that may be wrong with it.

    Args:
        folder: Of the job.
        seed: Of the truth; its cell is identified.
        rows: What may be wrong.
    """
    base = Path(folder)
    cell, truth = base / "cells" / f"seed-{seed}" / CELL, base / "cells" / f"seed-{seed}" / TRUTH
    for row in rows:
        online_case.write_case(_place(folder, seed, row), row, cell, truth, base / online_case.CATALOGUE, seed)
    plan, program = base / f"seed-{seed}" / PLANNED, base / online_case.PROGRAM
    bare = _place(folder, seed, next(iter(WRONG))) / "cell.toml"
    mark = mark_of(bare, program)
    if finished(plan, mark) is None:
        begin(plan, mark)
        compensate.run(program, bare, plan, report=False)
        finish(plan, mark, {})


def one(folder: str, seed: int, row: str, way: str, *, progress: Progress = silent) -> dict[str, Any]:
    """Mill one groove, unless that was done, and judge it.

    Args:
        folder: Of the job, prepared.
        seed: Of truth and instruments.
        row: What is wrong.
        way: How it is corrected.
        progress: Progress callback, fraction 0 to 1.

    Returns:
        Figures of ``evaluate`` and what the loop said.
    """
    item, place, plans = WAYS[way], _place(folder, seed, row), Path(folder) / f"seed-{seed}" / PLANNED
    original, part = Path(folder) / online_case.PROGRAM, place / way
    program = plans / online_case.PROGRAM if item.compensated else original
    cell, truth, touched = place / online_case.cell_name(way), place / online_case.TRUTH, place / online_case.TOUCHED
    drifted = (touched,) if WRONG[row].since_touched else ()
    mark = mark_of(cell, truth, *drifted, program, plans / _PLAN_FILE, way=way, seed=seed)
    figures = finished(part, mark)
    if figures is not None:
        return figures
    begin(part, mark)
    log = part.with_name(f"{part.name}-log")
    shutil.rmtree(log, ignore_errors=True)
    with resources.as_file(resources.files("counterflex.app") / "demo" / "rsi.xml") as config:
        twin = live.LiveSettings(
            program, cell, truth, ("rsi", config), original=original, seed=seed, touched=touched if drifted else None
        )
        planned = plans / _PLAN_FILE if item.compensated else None  # the plan is for the feeds of its own program
        loop = online_session.RunSettings(cell, ("rsi", config), planned, compensated=item.compensated, arm=item.armed)
        sensors = closed_loop.Sensors(force=item.force, tracker=item.tracker)
        outcome = closed_loop.run(twin, part, loop, log, sensors=sensors, cycles=_CYCLES, progress=progress)
    shutil.rmtree(log, ignore_errors=True)
    judged = evaluate.run([part], None)["variants"]["nominal"]
    figures = {key: judged[key] for key in (*_FIGURES, "surface") if key in judged}
    figures["loop"] = {key: outcome[key] for key in ("cycles", "states", "causes", "largest_correction_um")}
    finish(part, mark, figures)
    return figures


def _summary(
    results: Mapping[str, Any], seeds: Sequence[int], rows: Sequence[str], family: Family, level: str
) -> dict[str, Any]:
    table = [
        {
            "seed": seed,
            "row": row,
            "truth_level": level,
            "variants": {way: results[_name(seed, row, way)] for way in WAYS},
        }
        for seed in seeds
        for row in rows
    ]
    total = online_report.over_seeds(table)
    return {
        "job": "reproduce online",
        "truth_level": level,
        "family": family.name,
        "seeds": table,
        "rows": total,
        "goals": online_report.goals(total),
        "counterflex": __version__,
    }
