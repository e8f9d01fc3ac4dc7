"""Reproduce Mandiola2023: square and circle with a tracker in the loop, over sockets, judged by the true tool."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np

from counterflex.app.long_jobs.task import Task
from counterflex.app.proof import simulate
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError, OutputError
from counterflex.core.progress import Progress, silent
from counterflex.core.units import DEG, MM
from counterflex.files.cell.cell import read_cell
from counterflex.files.plan_file import read_plan
from counterflex.files.summary_file import read_run
from counterflex.twin.devices.path_answer import PathAnswer
from counterflex_lab.reproduce import mandiola_case, mandiola_report, tracking
from counterflex_lab.reproduce.experiment import SAID, Experiment, Own, Run, mill, plan_task
from counterflex_lab.reproduce.mandiola_case import VARIANTS, Case
from counterflex_lab.reproduce.way import Way

SHAPES: Final = ("square", "circle")
QUICK_SCALE: Final = 0.15
CORNER_M: Final = 15.0 * MM
"""Path on either side of a corner that counts as corner, at full size: 1.3 s at 700 mm/min."""
AFTER_REVERSAL_S: Final = 1.5
_WHOLE: Final = 0.9
"""Share of the expected cycles below which a run has ended early: nothing is stored as its result."""
PAPER: Final[dict[str, Any]] = {
    "circle_reduction": 0.66,
    "overall_reduction": (0.8, 0.9),
    "tracker_um": 25.0,
    "static_um": (100.0, 400.0),
    "moving_um": 1000.0,
}
"""What Mandiola2023 reports (sections IV and V)."""


class Paths(Experiment):
    """Square and circle in the air; quick: paths of 15 % of the size. Nothing is identified of the cells."""

    name = "paths"
    recipes: ClassVar[Mapping[str, tuple[str, ...]]] = {"catalogue": ()}
    identifying = (0.1,)

    def identify(self, _progress: Progress) -> None:
        """Write the files of every truth."""
        scale = QUICK_SCALE if self.quick else 1.0
        self.cases = {n: mandiola_case.write_case(self.folder / f"seed-{n}", n, scale=scale) for n in self.seeds}

    def tasks(self) -> list[Task]:
        """One plan of each path for all truths; the longest runs first."""
        first = next(iter(self.cases.values()))
        runs = [task_of(case, s, v) for s in SHAPES for case in self.cases.values() for v in VARIANTS]
        return [*(plan_of(first, shape) for shape in SHAPES), *runs]

    def summary(self, results: Mapping[str, Any]) -> dict[str, Any]:
        """Rows by truth, what each controller leaves, goals, margins."""
        rows = [
            {"seed": seed, "variants": _by_shape(case, results, "figures"), "loops": _by_shape(case, results, "loop")}
            for seed, case in sorted(self.cases.items())
        ]
        first = next(iter(self.cases.values()))
        return {
            "scale": first.scale,
            "seeds": rows,
            "reductions": reductions(rows),
            "goals": goals(rows),
            "paper": PAPER,
            "margins": mandiola_report.margin_table(mandiola_report.open_loops(first.cell("designed"))),
        }

    def page(self, summary: Mapping[str, Any]) -> str:
        """Figures of the summary, curves of the first truth's runs."""
        case = next(iter(self.cases.values()))
        return mandiola_report.page(summary, case, partial(_read, case))


def _read(case: Case, shape: str, variant: str) -> tuple[tracking.Tracked, Float]:
    run_ = tracked(case.folder / f"{shape}-{variant}", case.cell(variant))
    return run_, nearest(run_, case, shape)


def _by_shape(case: Case, results: Mapping[str, Any], what: str) -> dict[str, dict[str, Any]]:
    return {v: {s: results[task_of(case, s, v).name][what] for s in SHAPES} for v in VARIANTS}


@dataclass(frozen=True)
class Controller(Way):
    """A controller of the tracker loop on one path; the case lies where its files lie."""

    shape: str = "square"
    scale: float = 1.0


def plan_of(case: Case, shape: str) -> Task:
    """The plan of a shape: what the loop knows of play ahead of time."""
    folder = case.plan(shape).parent
    return plan_task(f"{shape}: plan", folder, case.program(shape), case.bare_cell, programmed_feed=True, predict=False)


def task_of(case: Case, shape: str, variant: str) -> Task:
    """A shape with a controller on a truth."""
    way = Controller(
        variant, VARIANTS[variant], armed=variant != "off", force=False, tracker=True, shape=shape, scale=case.scale
    )
    run = Run(
        f"{case.seed}: {shape}: {variant}",
        case.folder / f"{shape}-{variant}",
        case.cell(variant),
        case.truth,
        case.program(shape),
        case.plan(shape),
        way,
        case.seed,
    )
    return run.task(f"{shape}: plan", one)


def one(
    part: str,
    cell: str,
    truth: str,
    program: str,
    plan: str,
    _touched: None,
    way: Controller,
    seed: int,
    *,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Run one shape with one controller and judge what was recorded of it; arguments as those of :func:`mill`.

    Raises:
        OutputError: It ended early; its log is left.
    """
    cycles = round(float(read_plan(Path(plan))[0].path.time_s[-1]) / mandiola_case.PERIOD_S) + 250
    judge = functools.partial(_judged, Case(Path(truth).parent, seed, way.scale), Path(cell), way.shape, cycles)
    own = Own(judge, PathAnswer(dead_s=mandiola_case.DEAD_S, natural_hz=0.0), cycles)
    return mill(part, cell, truth, program, plan, None, way, seed, own=own, progress=progress)


def _judged(
    case: Case, cell: Path, shape: str, cycles: int, part: Path, log: Path, outcome: Mapping[str, Any]
) -> dict[str, Any]:
    if outcome["cycles"] < _WHOLE * cycles:
        raise OutputError(
            f"the run over the {shape} ended early",
            where=str(log),
            value=f"{outcome['cycles']} of about {cycles} cycles, {', '.join(outcome['causes']) or 'no cause'}",
            hint="Its log says why (counterflex log show); the same command runs it again",
        )
    said = {key: outcome[key] for key in (*SAID, "seconds")}
    return {"loop": said, "figures": figures(tracked(part, cell), case, shape)}


def tracked(part: Path, cell: Path) -> tracking.Tracked:
    """Record of a run by the twin; the angles are those of the program."""
    run_, _ = read_run(part / "run.parquet")
    upright = np.tile(np.array([0.0, 0.0, 1.0]), (len(run_.time_s), 1))
    q = simulate.controller(read_cell(cell)).joints(run_.p_part_command, upright)
    return tracking.Tracked(run_.time_s, run_.p_part_command, run_.p_part_tcp, run_.tilt_part, q)


def nearest(run_: tracking.Tracked, case: Case, shape: str) -> Float:
    """Point of the path (n, 3) m nearest to where the tool was."""
    if shape == "square":
        near = tracking.segment_of(run_.p_command, case.corners)
        return tracking.nearest_on_polyline(run_.p_actual, case.corners, near)
    return tracking.nearest_on_circle(run_.p_actual, case.radius_m)


def figures(run_: tracking.Tracked, case: Case, shape: str) -> dict[str, Any]:
    """Figures of one run.

    Args:
        run_: What the twin recorded.
        case: Which paths.
        shape: ``square`` or ``circle``.

    Raises:
        InputError: The run has no sample in a zone: it ended early.
    """
    contour = np.linalg.norm(run_.p_actual - nearest(run_, case, shape), axis=1)
    if shape == "square":
        straight, corner = tracking.corner_zones(
            run_, case.corners, min(CORNER_M, 0.25 * mandiola_case.SIDE_M * case.scale)
        )
        zones = {"straights": straight, "corners": corner}
    else:
        turn = tracking.turn_zone(run_, mandiola_case.RUN_IN_DEG * DEG)
        zones = {"turn": turn, "reversals": tracking.reversal_zone(run_, turn, AFTER_REVERSAL_S)}
    out = {}
    for name, where in zones.items():
        if name == "reversals" and not where.any():
            continue
        if not where.any():
            raise InputError(
                f"the run over the {shape} has no sample on its {name}",
                value=f"{len(contour)} samples",
                hint="It ended early, as on a computer that is busy with other work: remove its folder and run again",
            )
        out[name] = {
            "contour": tracking.spread(contour, where).as_um(),
            "total": tracking.spread(run_.total, where).as_um(),
            "orientation": tracking.spread(run_.turned, where).as_mdeg(),
        }
    return out


def reductions(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Share of the paper's and the goals' figures that each controller leaves, truth by truth."""
    out = []
    for row in rows:
        v = row["variants"]
        off, published = v["off"], v["published"]
        item: dict[str, Any] = {"seed": row["seed"]}
        for name in VARIANTS:
            if name == "off":
                continue
            item[name] = {
                "circle_contour_rms": _share(v[name], off, "circle", "turn", "contour", "rms_um"),
                "circle_total_rms": _share(v[name], off, "circle", "turn", "total", "rms_um"),
                "square_total_rms": _share(v[name], off, "square", "straights", "total", "rms_um"),
                "corner_peak_to_published": _ratio(v[name], published, "square", "corners", "total", "max_um"),
            }
        out.append(item)
    return out


def goals(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The figures that the goals speak of, worst over the truths, and whether each goal is reached."""
    shares = reductions(rows)
    contour = min(item["designed"]["circle_contour_rms"] for item in shares)
    published = min(item["published"]["circle_contour_rms"] for item in shares)
    straights = max(row["variants"]["designed"]["square"]["straights"]["total"]["rms_um"] for row in rows)
    corner = max(item["designed"]["corner_peak_to_published"] for item in shares)
    return {
        "circle_contour_reduction": {
            "worst": contour,
            "published_worst": published,
            "goal": 0.9,
            "reached": contour >= 0.9,
        },
        "straights_total_rms_um": {
            "worst": straights,
            "goal": PAPER["tracker_um"],
            "reached": straights <= PAPER["tracker_um"],
        },
        "corner_peak_ratio": {"worst": corner, "goal": round(1.0 / 3.0, 4), "reached": corner <= 1.0 / 3.0},
    }


def _ratio(a: Mapping[str, Any], b: Mapping[str, Any], *keys: str) -> float:
    for key in keys:
        a, b = a[key], b[key]
    return float(np.round(float(a) / float(b), 4))  # type: ignore[arg-type]


def _share(a: Mapping[str, Any], b: Mapping[str, Any], *keys: str) -> float:
    """Reduction 1 - a / b."""
    return round(1.0 - _ratio(a, b, *keys), 4)
