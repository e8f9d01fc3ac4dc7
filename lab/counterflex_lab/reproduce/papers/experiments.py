"""Experiments behind the rows that no formula gives: run on simulated cells, or measured by a benchmark.

Each gives plain results that are small enough to be stored with the program: figures, and curves for the pictures.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib import resources
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex.app import examples, holder_design
from counterflex.app.campaign import laboratory
from counterflex.app.identification import identify
from counterflex.app.identification.propose import propose
from counterflex.app.inputs import read_job
from counterflex.app.proof.truth import truth_of
from counterflex.core.arrays import Float
from counterflex.core.progress import Progress, in_parts
from counterflex.core.units import DEG, MM, UM
from counterflex.cutting.coefficients import KienzleLaw, edge_force
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.twin.truth.family import WIDE
from counterflex.twin.truth.file import write_truth
from counterflex.twin.truth.truth import CuttingTruth, Truth
from counterflex_lab.reproduce import haehn, haehn_case, haehn_report, holder, holder_case, mandiola, mandiola_case

REPORTING: Final = 1001
"""First truth seed that nothing is tuned on."""
CURVE_POINTS: Final = 240
"""Most points of a stored curve."""
CHIP_M: Final = 0.03 * MM
LOADS: Final = 16
CUTS: Final = 12
_GROOVES: Final = ("uncompensated", "force", "force_pilot_40ms", "force_pilot")


@dataclass(frozen=True)
class Options:
    """Options of experiments."""

    seeds: Sequence[int]  # truth seeds
    level: str  # ``identified`` or ``catalogue``: how well the loop knows the cell
    quick: bool  # as briefly as possible
    workers: int | None  # runs at a time; None is one per core


Run = Callable[[Path, Options, Progress], dict[str, Any]]


def holder_loop(folder: Path, options: Options, progress: Progress) -> dict[str, Any]:
    """The validation cut of Denkena2015 with the holder in the loop."""
    summary = holder.Edge(folder, family=WIDE, **asdict(options)).run(progress)
    rows = {way: dict(row) for way, row in summary["rows"].items()}
    for way, row in rows.items():
        plateau = [
            item["variants"][way]["plateau"]["p997_mm"]
            for item in summary["seeds"]
            if holder_case.WAYS[way].acted(item["variants"][way]) and "plateau" in item["variants"][way]
        ]
        if plateau:
            row["median_plateau_mm"] = float(np.median(plateau))
    return {"cells": _cells(summary["family"], summary["truth_level"], summary["seeds"]), "rows": rows}


def design(folder: Path, _: Options, progress: Progress) -> dict[str, Any]:
    """Finite elements of two drawings of a holder: pockets with ribs, and one pocket across each cheek."""
    parts = in_parts(progress, {"bridged": 1.0, "across": 1.0})
    drawings = resources.files("counterflex_lab.reproduce.papers") / "data" / "holders"
    out = {}
    for name in ("bridged", "across"):
        with resources.as_file(drawings / f"{name}.toml") as file:
            out[name] = holder_design.run(file, folder / name, progress=parts[name])
    return design_results(out["bridged"], out["across"])


def design_results(bridged: Mapping[str, Any], across: Mapping[str, Any]) -> dict[str, Any]:
    """Results of two designs that are stored.

    Args:
        bridged: Summary of the drawing with several pockets.
        across: Summary of the drawing with one pocket across each cheek.
    """
    both = bridged["compliance_um_per_kn"]
    return {
        "plain_um_n": [round(1e-3 * value, 6) for value in both["without_pockets"]],
        "pockets_um_n": [round(1e-3 * value, 6) for value in both["with_pockets"]],
        "rib_gain": max(float(row["rib_gain"]) for row in across["bridges"]),
    }


def groove(folder: Path, options: Options, progress: Progress) -> dict[str, Any]:
    """The groove of Haehn2020 with every way of correcting."""
    summary = haehn.Groove(folder, **asdict(options)).run(progress)
    first = summary["seeds"][0]
    place = folder / f"seed-{first['seed']}" / first["edge"]
    cell = read_cell(place / haehn_case.OFFLINE)
    job = read_job(place / haehn_case.PROGRAM, cell)
    curves = {}
    for name in _GROOVES:
        run = haehn_report.groove_run(place / name, name, first["edge"], first["seed"], job, cell)
        error = np.where(run.cutting, np.hypot(run.left_m, run.axis_m), np.nan)
        curves[name] = _curve(run.place_m / MM, error / MM, 0.002)
    cells = _cells("mild", summary["truth_level"], summary["seeds"])
    return {"cells": cells, "table": groove_table(summary["seeds"]), "curves": curves}


def groove_table(rows: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, dict[str, list[float]]]]:
    """Largest error by variant, edge and stretch (``path``, ``exit``), mm: median and worst of the truths.

    Args:
        rows: ``seeds`` of the summary; runs in which the loop refused to act are left out.
    """
    out: dict[str, dict[str, dict[str, list[float]]]] = {}
    for name in dict.fromkeys(name for row in rows for name in row["variants"]):
        for edge in dict.fromkeys(row["edge"] for row in rows):
            runs = [row["variants"][name] for row in rows if row["edge"] == edge and name in row["variants"]]
            runs = [item for item in runs if haehn_case.WAYS[name].acted(item)]
            if runs:
                sizes = {k: [item[k]["max_mm"] for item in runs] for k in ("path", "exit")}
                out.setdefault(name, {})[edge] = {k: [float(np.median(v)), max(v)] for k, v in sizes.items()}
    return out


def paths(folder: Path, options: Options, progress: Progress) -> dict[str, Any]:
    """Square and circle of Mandiola2023, without correction, with the published gain, with the designed controller."""
    job = mandiola.Paths(folder, seeds=options.seeds, quick=options.quick, workers=options.workers)
    summary = job.run(progress)
    at_rest = {str(n): _at_rest_mm(case) for n, case in job.cases.items()}
    case = job.cases[min(job.cases)]
    curves: dict[str, Any] = {"circle": {}, "square": {}}
    for name in mandiola_case.VARIANTS:
        run = mandiola.tracked(case.folder / f"circle-{name}", case.cell(name))
        near = mandiola.nearest(run, case, "circle")
        angle = np.unwrap(np.arctan2(run.p_command[:, 1], run.p_command[:, 0])) / DEG
        out = np.einsum("ni,ni->n", run.p_actual - near, near / np.linalg.norm(near, axis=1)[:, None])
        turn = (angle >= mandiola_case.RUN_IN_DEG) & (angle <= 360.0 + mandiola_case.RUN_IN_DEG)
        curves["circle"][name] = _curve(angle[turn], out[turn] / UM, 0.1)
        run = mandiola.tracked(case.folder / f"square-{name}", case.cell(name))
        curves["square"][name] = _curve(run.time_s, run.total / UM, 0.1)
    return {
        "cells": _cells("mild", "catalogue", summary["seeds"]),
        "scale": summary["scale"],
        "seeds": [{"seed": row["seed"], "variants": row["variants"]} for row in summary["seeds"]],
        "reductions": summary["reductions"],
        "at_rest_mm": at_rest,
        "curves": curves,
    }


def _at_rest_mm(case: mandiola_case.Case) -> float:
    """Mean error over the second half of the uncorrected robot's wait at the first corner of the square, mm."""
    run = mandiola.tracked(case.folder / "square-off", case.cell("off"))
    moving = np.linalg.norm(np.diff(run.p_command, axis=0), axis=1) > 1e-9
    still = np.flatnonzero(~moving)
    runs = np.split(still, np.flatnonzero(np.diff(still) > 1) + 1)
    longest = max(runs, key=len)
    return float(np.mean(run.total[longest[len(longest) // 2] : longest[-1]]) / MM)


def cubes(folder: Path, options: Options, progress: Progress) -> dict[str, Any]:
    """Stiffness of every element from cubes on simulated robots, against the true one."""
    errors, determined = [], []
    for seed, part in _each(options, progress):
        place, cell, truth = _measured_cell(folder, seed)
        identified = _identified("cubes", LOADS, {"history": "relaxed"}, place, cell, seed, part)
        known = _determined(identified)
        determined.append(len(known))
        errors += _stiffness_errors(read_cell(place / "cubes" / "cell.toml"), truth, known)
    return {
        "cells": _cells("mild", "catalogue", [{"seed": n} for n in _seeds(options)]),
        "median_percent": float(np.median(errors)),
        "worst_percent": float(np.max(errors)),
        "determined": float(np.median(determined)),
        "errors_percent": [round(float(v), 2) for v in errors],
    }


def cutting(folder: Path, options: Options, progress: Progress) -> dict[str, Any]:
    """Force constants of simulated cells from test cuts, against the true ones."""
    rows = []
    for seed, part in _each(options, progress):
        place, cell, truth = _measured_cell(folder, seed)
        identified = _identified("cutting", CUTS, {}, place, cell, seed, part)
        after = read_cell(place / "cutting" / "cell.toml")
        rows.append({"seed": seed, **_cutting_errors(after, truth.cutting, identified)})
    return {
        "cells": _cells("mild", "catalogue", rows),
        "seeds": rows,
        **{key: max(row[key] for row in rows) for key in ("kc_percent", "mc_percent", "held_out_percent")},
    }


EXPERIMENTS: Final[Mapping[str, Run]] = {
    "holder_design": design,
    "holder_loop": holder_loop,
    "groove": groove,
    "cubes": cubes,
    "cutting": cutting,
    "paths": paths,
}
"""What ``--long`` runs, by name; the others are benchmarks."""
BENCHMARKS: Final = ("step_time", "strategy")
"""Experiments that are benchmarks: ``benchmarks/`` makes their results, ``tools/refresh_papers.py`` stores them."""


def _seeds(options: Options) -> list[int]:
    return list(options.seeds[:1]) if options.quick else list(options.seeds)


def _each(options: Options, progress: Progress) -> list[tuple[int, Progress]]:
    seeds = _seeds(options)
    parts = in_parts(progress, {str(seed): 1.0 for seed in seeds})
    return [(seed, parts[str(seed)]) for seed in seeds]


def _cells(family: str, level: str, rows: Sequence[Mapping[str, Any]]) -> str:
    seeds = sorted({row["seed"] for row in rows})
    several = f"seeds {seeds[0]} to {seeds[-1]}" if len(seeds) > 1 else f"seed {seeds[0]}"
    note = f"; seeds below {REPORTING} may have been tuned on" if seeds[0] < REPORTING else ""
    return f"truth {several} of the family {family}, {level}{note}"


def _curve(x: Float, y: Float, digit: float) -> list[list[float | None]]:
    """At most :data:`CURVE_POINTS` points, each with the largest error of its stretch, in the order of x."""
    chunks = np.array_split(np.arange(len(x)), min(CURVE_POINTS, len(x)))
    out: list[list[float | None]] = []
    for rows in chunks:
        known = rows[np.isfinite(y[rows])]
        if len(known) == 0:
            out.append([round(float(x[rows[0]]), 3), None])
            continue
        k = known[int(np.argmax(np.abs(y[known])))]
        out.append([round(float(x[k]), 3), round(round(float(y[k]) / digit) * digit, 6)])
    return out


def _measured_cell(folder: Path, seed: int) -> tuple[Path, Path, Truth]:
    """Folder of a simulated cell, its cell file and its truth."""
    place = folder / f"seed-{seed}"
    place.mkdir(parents=True, exist_ok=True)
    cell = place / "start.toml"
    examples.write(cell)
    truth = truth_of(read_cell(cell), seed)
    write_truth(place / "truth.toml", truth)
    return place, cell, truth


def _identified(
    recipe: str, count: int, settings: Mapping[str, str], place: Path, cell: Path, seed: int, progress: Progress
) -> dict[str, Any]:
    """Propose, measure on the simulated cell, identify; the result."""
    parts = in_parts(progress, {"measure": 3.0, "identify": 1.0})
    proposal = propose(recipe, count, cell, place / f"{recipe}-proposal", settings=settings)
    measured = laboratory.measure(
        proposal, cell, place / "truth.toml", place / f"{recipe}-data", seed=seed, progress=parts["measure"]
    )
    return identify.run(recipe, [measured["manifest"]], cell, place / recipe, progress=parts["identify"])


def _determined(identified: Mapping[str, Any]) -> set[str]:
    """Names of the parameters that the data determine, ``axis1.rz``."""
    return {row["name"] for row in identified["fits"]["cubes"]["parameters"] if row["seen"] == "determined"}


def _stiffness_errors(cell: Cell, truth: Truth, known: set[str]) -> list[float]:
    """Identified stiffness against the true one, %, of every direction that the data determine."""
    bodies = {s.name: s for s in (*cell.robot.segments, *cell.end_effector.segments)}
    out = []
    for body in truth.bodies:
        for k, axis in enumerate(("tx", "ty", "tz", "rx", "ry", "rz")):
            if f"{body.name}.{axis}" in known and body.compliance[k] > 0.0:
                out.append(100.0 * abs(body.compliance[k] / float(bodies[body.name].compliance[k]) - 1.0))
    return out


def _cutting_errors(cell: Cell, truth: CuttingTruth, identified: Mapping[str, Any]) -> dict[str, float]:
    from counterflex.app.campaign.parameter_errors import true_edge_force

    law, chip = cell.force_law, np.array([CHIP_M])
    ours, true = float(edge_force(law, chip)[0, 0]), float(true_edge_force(truth, chip)[0, 0])
    exponent = law.mc if isinstance(law, KienzleLaw) else 0.0
    return {
        "kc_percent": 100.0 * abs(ours / true - 1.0),
        "mc_percent": 100.0 * abs(exponent / truth.exponent[0] - 1.0),
        "held_out_percent": next(
            float(row["value"]) for row in identified["headline"] if row["name"] == "holdout_worst_percent"
        ),
    }
