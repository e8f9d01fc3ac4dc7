"""Reproduce Fig. 1 of Denkena2015: holder, matrix, model, correction, over sockets on the simulated cell."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np

from counterflex.app.long_jobs.task import Task
from counterflex.app.proof import simulate
from counterflex.core.arrays import Float
from counterflex.core.errors import ModelError
from counterflex.core.progress import Progress, silent
from counterflex.files.logs.segments import read_log
from counterflex.files.summary_file import read_run
from counterflex.runtime.record_ring import COLUMNS, column
from counterflex_lab.reproduce import holder_case
from counterflex_lab.reproduce.experiment import PLAN_FILE, PLANNED, Experiment, Own, Run, judged, mill, plan_task
from counterflex_lab.reproduce.holder_case import WAYS
from counterflex_lab.reproduce.way import worst_and_median

PRINTED_N: Final = (10.0, 10.0, 50.0)
"""Error of the force along feed, radial and axial (Denkena2015 section 4)."""
GOAL_AXIAL_N: Final = 10.0
DIRECTIONS: Final = ("feed", "radial", "axial")
_MEAN: Final = 5
"""Cycles of a mean: 20 ms, four whole revolutions."""
_AROUND: Final = 60
"""Cycles before and after the cut that count: air, entry and exit."""


class Edge(Experiment):
    """The validation cut of the paper; quick: the holder alone is identified."""

    name = "holder"
    recipes: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "catalogue": ("holder",),
        "identified": ("tracker-frame", "stiffness", "play", "servo", "holder", "cutting"),
    }

    def catalogue(self) -> Path:
        """Write the cell before any measurement, and the program."""
        return holder_case.catalogue_cell(self.folder)

    def tasks(self) -> list[Task]:
        """Every way on every truth."""
        out = []
        for seed in self.seeds:
            place, cell = self.folder / f"seed-{seed}", self.cell(seed)
            holder_case.write_cells(tomllib.loads(cell.read_text(encoding="utf-8")), place)
            program, plan, planned = self.folder / holder_case.PROGRAM, place / PLANNED, f"{seed}: plan"
            out.append(plan_task(planned, plan, program, cell, programmed_feed=True, predict=False))
            for name, way in WAYS.items():
                own = place / holder_case.cell_name(name)
                part = place / own.stem.removeprefix("cell-")
                run = Run(f"{seed}: {name}", part, own, self.truth(seed), program, plan / PLAN_FILE, way, seed)
                out.append(run.task(planned, one))
        return out

    def summary(self, results: Mapping[str, Any]) -> dict[str, Any]:
        """Rows by truth, figures over them, the goal."""
        table = [{"seed": seed, "variants": {way: results[f"{seed}: {way}"] for way in WAYS}} for seed in self.seeds]
        total = over_seeds(table)
        about = {"family": self.family.name, "seeds": table, "rows": total}
        return {**about, "printed_n": list(PRINTED_N), "goal": goal(total)}


def one(*given: Any, progress: Progress = silent) -> dict[str, Any]:
    """Mill one edge and judge part and force; arguments as those of :func:`mill`."""
    return mill(*given, own=Own(_with_force), progress=progress)


def _with_force(part: Path, log: Path, outcome: Mapping[str, Any]) -> dict[str, Any]:
    figures = judged(part, log, outcome)
    said = figures.pop("loop")
    return {**figures, "force": force_errors(log, part), "loop": said}


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


def over_seeds(table: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """Median and worst of each figure by way, runs in which the loop refused to act left out and counted."""
    out: dict[str, dict[str, Any]] = {}
    for name, way in WAYS.items():
        runs, out[name] = way.counted([item["variants"][name] for item in table])
        if not runs:
            continue
        figures = {
            "p997_mm": [r["path"]["p997_mm"] for r in runs],
            "max_mm": [r["path"]["max_mm"] for r in runs],
            "entry_mm": [r["entry"]["max_mm"] for r in runs],
        }
        figures |= {f"{d}_n": [r["force"]["half_width_n"][k] for r in runs] for k, d in enumerate(DIRECTIONS)}
        for figure, values in figures.items():
            out[name] |= worst_and_median(figure, values)
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
