"""Reproduce Fig. 1 of Denkena2015: holder, matrix, model, correction, over sockets on the simulated cell.

Every identification, plan and run is kept on disk when it has ended; an interrupted job goes on where it was.
"""

from __future__ import annotations

import shutil
import statistics
import time
import tomllib
from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex import __version__
from counterflex.app.campaign import campaign
from counterflex.app.campaign.step import CELL
from counterflex.app.campaign.tasks import TRUTH
from counterflex.app.compensation import compensate
from counterflex.app.long_jobs.step_cache import begin, finish, finished, made_again, marks_below
from counterflex.app.long_jobs.task import Task
from counterflex.app.long_jobs.task_graph import run_tasks
from counterflex.app.proof import evaluate, simulate
from counterflex.app.run import session as online_session
from counterflex.app.simulated_cell import cell as live
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError, ModelError
from counterflex.core.progress import Progress, in_parts, silent
from counterflex.files.logs.segments import read_log
from counterflex.files.run_file import read_run
from counterflex.files.summary_file import write_summary
from counterflex.runtime.record_ring import COLUMNS, column
from counterflex.twin.truth.family import WIDE, Family
from counterflex_lab.reproduce import closed_loop, holder_case
from counterflex_lab.reproduce.holder_case import WAYS
from counterflex_lab.reproduce.mark import mark_of

RECIPES: Final[dict[str, tuple[str, ...]]] = {
    "catalogue": ("holder",),
    "identified": ("tracker-frame", "stiffness", "play", "servo", "holder", "cutting"),
}
"""What is identified of each simulated cell first; the holder always is."""
PRINTED_N: Final = (10.0, 10.0, 50.0)
"""Error of the force along feed, radial and axial (Denkena2015 section 4)."""
GOAL_AXIAL_N: Final = 10.0
DIRECTIONS: Final = ("feed", "radial", "axial")
_FIGURES: Final = ("path", "entry", "plateau", "exit")
_PLAN, _PLAN_FILE = "compensated", "plan.parquet"
_CYCLES: Final = 1600
_MEAN: Final = 5
"""Cycles of a mean: 20 ms, four whole revolutions."""
_AROUND: Final = 60
"""Cycles before and after the cut that count: air, entry and exit."""


def run(
    out: str | Path,
    *,
    seeds: Sequence[int] = (1001, 1002, 1003),
    family: Family = WIDE,
    level: str = "identified",
    quick: bool = False,
    workers: int | None = None,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Do the job on files: a folder per truth, and ``summary.json`` over all of them.

    Args:
        out: Folder; what is there and was made from the same inputs is not done again.
        seeds: Truth seeds.
        family: Family that the truths are drawn from.
        level: Of :data:`RECIPES`: what is identified of the cells first.
        quick: The first seed, holder alone identified.
        workers: Runs at a time; None is one per core.
        progress: Progress callback, fraction 0 to 1.

    Returns:
        The summary.

    Raises:
        InputError: No seeds, or an unknown level.
        CounterflexError: As the jobs it consists of.
    """
    if not seeds:
        raise InputError("there are no truth seeds")
    level = "catalogue" if quick else level
    if level not in RECIPES:
        raise InputError("no such truth level", value=level, limit=", ".join(RECIPES))
    start, folder = time.perf_counter(), Path(out)
    before = marks_below(folder)
    folder.mkdir(parents=True, exist_ok=True)
    numbers = tuple(seeds[:1]) if quick else tuple(seeds)
    parts = in_parts(progress, {"identifying": 1.0 if level == "catalogue" else 4.0, "milling": 6.0})
    catalogue = holder_case.catalogue_cell(folder)
    campaign.run(
        catalogue,
        folder / level,
        seeds=numbers,
        family=family,
        recipes=RECIPES[level],
        workers=workers,
        progress=parts["identifying"],
    )
    tasks = []
    for seed in numbers:
        tasks.append(Task(f"{seed}: plan", f"{seed}: plan", prepare, (str(folder), level, seed), weight=2.0))
        for way in WAYS:
            name = f"{seed}: {way}"
            tasks.append(Task(name, name, one, (str(folder), level, seed, way), (f"{seed}: plan",), tells=True))
    results = run_tasks(tasks, workers, parts["milling"])
    table = [{"seed": seed, "variants": {way: results[f"{seed}: {way}"] for way in WAYS}} for seed in numbers]
    total = over_seeds(table)
    summary = {
        "job": "reproduce holder",
        "truth_level": level,
        "family": family.name,
        "seeds": table,
        "rows": total,
        "printed_n": list(PRINTED_N),
        "goal": goal(total),
        "made_again": made_again(folder, before),
        "seconds": round(time.perf_counter() - start, 1),
        "counterflex": __version__,
    }
    write_summary(folder / "summary.json", summary)
    progress(1.0, "done")
    return summary


def prepare(folder: str, level: str, seed: int) -> None:
    """Plan of a simulated cell as it was identified, and its cell files.

    Args:
        folder: Of the job.
        level: See :func:`run`.
        seed: Of the truth.
    """
    base, place = Path(folder), Path(folder) / f"seed-{seed}"
    cell = base / level / f"seed-{seed}" / CELL
    holder_case.write_cells(tomllib.loads(cell.read_text(encoding="utf-8")), place)
    plan, program = place / _PLAN, base / holder_case.PROGRAM
    mark = mark_of(cell, program)
    if finished(plan, mark) is None:
        begin(plan, mark)
        compensate.run(program, cell, plan, report=False, programmed_feed=True, predict=False)
        finish(plan, mark, {})


def one(folder: str, level: str, seed: int, way: str, *, progress: Progress = silent) -> dict[str, Any]:
    """Mill one edge, unless that was done, and judge part and force.

    Args:
        folder: Of the job, prepared.
        level: See :func:`run`.
        seed: Of truth, laboratory and holder.
        way: How it is corrected.
        progress: Progress callback, fraction 0 to 1.

    Returns:
        Figures of ``evaluate``, errors of the force by direction, and what the loop said.
    """
    item, base, place = WAYS[way], Path(folder), Path(folder) / f"seed-{seed}"
    original, truth = base / holder_case.PROGRAM, base / level / f"seed-{seed}" / TRUTH
    program = place / _PLAN / holder_case.PROGRAM if item.compensated else original
    cell, plan = place / holder_case.cell_name(way), place / _PLAN / _PLAN_FILE
    part = place / cell.stem.removeprefix("cell-")
    mark = mark_of(cell, truth, program, plan, way=way, seed=seed)
    figures = finished(part, mark)
    if figures is not None:
        return figures
    begin(part, mark)
    log = part.with_name(f"{part.name}-log")
    shutil.rmtree(log, ignore_errors=True)
    with resources.as_file(resources.files("counterflex.app") / "demo" / "rsi.xml") as config:
        twin = live.LiveSettings(program, cell, truth, ("rsi", config), original=original, seed=seed)
        loop = online_session.RunSettings(cell, ("rsi", config), plan, compensated=item.compensated, arm=item.armed)
        sensors = closed_loop.Sensors(force=False, holder=True)
        outcome = closed_loop.run(twin, part, loop, log, sensors=sensors, cycles=_CYCLES, progress=progress)
    judged = evaluate.run([part], None)["variants"]["nominal"]
    figures = {key: judged[key] for key in (*_FIGURES, "surface") if key in judged}
    figures["force"] = force_errors(log, part)
    figures["loop"] = {key: outcome[key] for key in ("cycles", "states", "causes", "largest_correction_um")}
    shutil.rmtree(log, ignore_errors=True)
    finish(part, mark, figures)
    return figures


def force_errors(log: Path, part: Path) -> dict[str, Any]:
    """Force of the holder, zeros taken off, less the true one, in part axes: along the feed, across it, along the tool.

    Both are means over 20 ms, telegram by telegram, from a quarter of a second before the cut to as much behind it.

    Args:
        log: Folder of the run log.
        part: Folder of the simulated cell.

    Returns:
        ``half_width_n``: three half widths that hold 95 % of the errors; ``largest_n``; ``mean_n``; ``stated_n``: the
        median standard deviation that the loop stated, holder axes; ``peak_n``: largest true force by direction.
    """
    rows, _, _ = read_log(log)
    true, _ = read_run(part / simulate.RUN)
    shown, stated_by_cycle = by_cycle(rows, len(true.time_s))
    cut = np.flatnonzero(np.linalg.norm(true.force_part, axis=1) > 5.0)
    if not len(cut) or not np.any(np.isfinite(shown)):
        raise ModelError("the run has no force to compare", where=str(log), value=f"{len(rows)} cycles, {len(cut)} cut")
    first, last = max(0, cut[0] - _AROUND), min(len(shown), cut[-1] + _AROUND)
    mean = np.ones(_MEAN) / _MEAN
    error = np.stack([np.convolve((shown - true.force_part)[first:last, i], mean, "valid") for i in range(3)], axis=1)
    error = error[np.all(np.isfinite(error), axis=1)]
    stated = stated_by_cycle[first:last]
    stated = stated[np.all(np.isfinite(stated), axis=1)]
    peak = [np.max(np.abs(np.convolve(true.force_part[first:last, i], mean, "valid"))) for i in range(3)]
    return {
        "half_width_n": [round(float(v), 2) for v in holder_case.half_widths(error)],
        "largest_n": [round(float(v), 2) for v in np.max(np.abs(error), axis=0)],
        "mean_n": [round(float(v), 2) for v in error.mean(axis=0)],
        "stated_n": [round(float(v), 2) for v in np.median(stated, axis=0)],
        "peak_n": [round(float(v), 2) for v in peak],
    }


def by_cycle(rows: Float, count: int) -> tuple[Float, Float]:
    """Force and its stated standard deviation by the controller's cycle, NaN in cycles of which no telegram came.

    A cycle in which the loop waited has no counter of the controller (-1 before the first telegram, the last one
    afterwards): only rows with a telegram count.

    Args:
        rows: (n, WIDTH) of the run log.
        count: Cycles of the simulated cell, the first telegram's is 0.

    Returns:
        (count, 3) and (count, 3) N.
    """
    rows = rows[rows[:, column("elapsed")] > 0]
    named = dict(zip(COLUMNS, rows.T, strict=True))
    out: list[Float] = []
    for prefix in ("wrench_f", "sensor_m"):
        by: Float = np.full((count, 3), np.nan)
        if len(rows):
            cycle = np.round((named["counter_ms"] - named["counter_ms"][0]) / 4.0).astype(np.int64)
            ok = (cycle >= 0) & (cycle < count)
            by[cycle[ok]] = np.stack([named[f"{prefix}{a}"] for a in "xyz"], axis=1)[ok]
        out.append(by)
    return out[0], out[1]


def acted(way: str, figures: Mapping[str, Any]) -> bool:
    """Whether a run did what its way says: the loop corrected, or was to watch only."""
    return not WAYS[way].armed or "active" in figures["loop"]["states"]


def over_seeds(table: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """Median and worst of each figure by way, runs in which the loop refused to act left out and counted."""
    out: dict[str, dict[str, Any]] = {}
    for way in WAYS:
        runs = [item["variants"][way] for item in table if acted(way, item["variants"][way])]
        out[way] = {"runs": len(runs), "refused": len(table) - len(runs)}
        if not runs:
            continue
        figures = {
            "p997_mm": [r["path"]["p997_mm"] for r in runs],
            "max_mm": [r["path"]["max_mm"] for r in runs],
            "entry_mm": [r["entry"]["max_mm"] for r in runs],
        }
        figures |= {f"{d}_n": [r["force"]["half_width_n"][k] for r in runs] for k, d in enumerate(DIRECTIONS)}
        for name, values in figures.items():
            out[way] |= {name: max(values), f"median_{name}": round(statistics.median(values), 6)}
    return out


def goal(total: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """The axial force within 10 N in every armed run."""
    worst = [row["axial_n"] for way, row in total.items() if WAYS[way].armed and "axial_n" in row]
    met = bool(worst) and max(worst) <= GOAL_AXIAL_N and not any(row["refused"] for row in total.values())
    return {"axial_n": GOAL_AXIAL_N, "worst_n": max(worst) if worst else None, "met": met}


def table_rows(summary: Mapping[str, Any]) -> list[list[str]]:
    """Rows of the table that is printed: median / worst of each figure."""
    rows = []
    for way, item in summary["rows"].items():
        keys = ("p997_mm", "max_mm", "entry_mm", *(f"{d}_n" for d in DIRECTIONS))
        digits = (3, 3, 3, 1, 1, 1)
        cells = [
            f"{item[f'median_{key}']:.{n}f} / {item[key]:.{n}f}" if key in item else "-"
            for key, n in zip(keys, digits, strict=True)
        ]
        rows.append([way, *cells, f"{item['runs']}"])
    return rows
