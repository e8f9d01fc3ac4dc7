"""Reproduce Mandiola2023: square and circle with a tracker in the loop, over sockets, judged by the true tool.

Every run is kept on disk when it has ended; an interrupted job goes on where it was.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex import __version__
from counterflex.app.compensation.compensate import compensate
from counterflex.app.long_jobs.step_cache import begin, finish, finished, made_again, marks_below
from counterflex.app.long_jobs.workers import Shares, count_of, done_one_by_one, interrupts_deferred, pool_of, share
from counterflex.app.proof import simulate
from counterflex.app.run import session as online_session
from counterflex.app.simulated_cell import cell as live
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError, OutputError
from counterflex.core.progress import Progress, silent
from counterflex.core.units import DEG, MM
from counterflex.evaluate import tracking
from counterflex.files.cell.cell import read_cell
from counterflex.files.plan_file import read_plan, write_plan
from counterflex.files.run_file import read_run
from counterflex.files.summary_file import write_summary
from counterflex.report.page import write_page
from counterflex.twin.devices.path_answer import PathAnswer
from counterflex_lab.reproduce import closed_loop, mandiola_case, mandiola_report
from counterflex_lab.reproduce.mandiola_case import VARIANTS, Case
from counterflex_lab.reproduce.mark import mark_of

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


def run(
    out: str | Path,
    *,
    seeds: Sequence[int] = (1001, 1002, 1003),
    quick: bool = False,
    workers: int | None = None,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Do the job on files: a folder per truth, ``summary.json`` and ``report.html`` over all of them.

    Args:
        out: Folder; what is there and was made from the same inputs is not done again.
        seeds: Truth seeds.
        quick: The first seed, paths of 15 % of the size.
        workers: Runs at a time; None is one per core.
        progress: Progress callback, fraction 0 to 1.

    Returns:
        The summary.

    Raises:
        InputError: No seeds.
        CounterflexError: As the jobs it consists of.
    """
    if not seeds:
        raise InputError("there are no truth seeds")
    start, before = time.perf_counter(), marks_below(Path(out))
    folder, scale = Path(out), QUICK_SCALE if quick else 1.0
    cases = {n: mandiola_case.write_case(folder / f"seed-{n}", n, scale=scale) for n in (seeds[:1] if quick else seeds)}
    results = _run_all(cases, workers, progress)
    first = next(iter(cases.values()))
    margins = mandiola_report.margin_table(mandiola_report.open_loops(first.cell("designed")))
    summary = {
        **_summary(results, scale, time.perf_counter() - start),
        "margins": margins,
        "made_again": made_again(folder, before),
    }

    def read(shape: str, variant: str) -> tuple[tracking.Tracked, Float]:
        run_ = tracked(first.folder / f"{shape}-{variant}", first.cell(variant))
        return run_, nearest(run_, first, shape)

    write_summary(folder / "summary.json", summary)
    write_page(mandiola_report.page(summary, first, read), folder / "report.html")
    progress(1.0, "done")
    return summary


def _run_all(
    cases: Mapping[int, Case], workers: int | None, progress: Progress
) -> dict[tuple[int, str, str], dict[str, Any]]:
    """Plan every path, then run all variants, the longest first; results in the order of the table."""
    order = [(seed, shape, variant) for seed in cases for shape in SHAPES for variant in VARIANTS]
    results: dict[tuple[int, str, str], dict[str, Any]] = {}
    jobs = sorted(order, key=lambda job: SHAPES.index(job[1]))
    shares, weights = Shares(len(jobs)), [1.0] * len(jobs)
    with pool_of(count_of(workers, len(order)), shares) as pool:
        with interrupts_deferred():
            plans = [pool.submit(prepare, next(iter(cases.values())), shape) for shape in SHAPES]
        for plan in plans:
            plan.result()
        with interrupts_deferred():
            waiting = {pool.submit(_one_at, k, cases[job[0]], job[1], job[2]): job for k, job in enumerate(jobs)}

        def report() -> None:
            progress(0.01 + 0.98 * shares.sum(weights), f"ran {len(results)} of {len(order)}")

        for done in done_one_by_one(waiting, report):
            results[waiting[done]] = done.result()
    return {job: results[job] for job in order}


def _one_at(task: int, case: Case, shape: str, variant: str) -> dict[str, Any]:
    """A run in a worker process, which tells how far it is."""
    result = one(case, shape, variant, progress=share(task))
    share(task)(1.0)
    return result


def prepare(case: Case, shape: str) -> None:
    """Write the plan of a shape, unless that was done: what the loop knows of play ahead of time.

    Args:
        case: Files of the truth.
        shape: ``square`` or ``circle``.
    """
    cell, program, plan = case.bare_cell, case.program(shape), case.plan(shape)
    part = plan.parent
    mark = mark_of(cell, program)
    if finished(part, mark) is None:
        begin(part, mark)
        planned = compensate(program, read_cell(cell), predict=False, programmed_feed=True)
        write_plan(plan, planned.plan, {"program": program.name, "counterflex": __version__})
        finish(part, mark, {})


def one(case: Case, shape: str, variant: str, *, progress: Progress = silent) -> dict[str, Any]:
    """Run one shape with one controller, unless that was done, and judge what was recorded of it.

    Args:
        case: Files of the truth.
        shape: ``square`` or ``circle``.
        variant: Of :data:`~counterflex_lab.reproduce.mandiola_case.VARIANTS`.
        progress: Progress callback, fraction 0 to 1.

    Returns:
        Figures and what the loop said.
    """
    cell, program = case.cell(variant), case.program(shape)
    part = case.folder / f"{shape}-{variant}"
    mark = mark_of(cell, program, case.truth, shape=shape, variant=variant, dead=mandiola_case.DEAD_S)
    result = finished(part, mark)
    if result is None:
        begin(part, mark)
        result = _mill(case, shape, variant, part, progress)
        finish(part, mark, result)
    return {"loop": result["loop"], "figures": figures(tracked(part, cell), case, shape)}


def _mill(case: Case, shape: str, variant: str, part: Path, progress: Progress) -> dict[str, Any]:
    cell, program = case.cell(variant), case.program(shape)
    with resources.as_file(resources.files("counterflex.app") / "demo" / "rsi.xml") as rsi:
        twin = live.LiveSettings(
            program,
            cell,
            case.truth,
            ("rsi", rsi),
            seed=case.seed,
            answer=PathAnswer(dead_s=mandiola_case.DEAD_S, natural_hz=0.0),
        )
        prepare(case, shape)
        plan = case.plan(shape)
        cycles = round(float(read_plan(plan)[0].path.time_s[-1]) / mandiola_case.PERIOD_S) + 250
        loop = online_session.RunSettings(cell, ("rsi", rsi), plan, compensated=False, arm=variant != "off")
        log = part.with_name(f"{part.name}-log")
        shutil.rmtree(log, ignore_errors=True)
        outcome = closed_loop.run(
            twin,
            part,
            loop,
            log,
            sensors=closed_loop.Sensors(force=False, tracker=True),
            cycles=cycles,
            progress=progress,
        )
    if outcome["cycles"] < _WHOLE * cycles:
        raise OutputError(
            f"the run over the {shape} ended early",
            where=str(log),
            value=f"{outcome['cycles']} of about {cycles} cycles, {', '.join(outcome['causes']) or 'no cause'}",
            hint="Its log says why (counterflex log show); the same command runs it again",
        )
    shutil.rmtree(log, ignore_errors=True)
    return {"loop": {key: outcome[key] for key in ("cycles", "states", "causes", "largest_correction_um", "seconds")}}


def tracked(part: Path, cell: Path) -> tracking.Tracked:
    """What the twin recorded of a run; the angles are those of the program."""
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


def _summary(results: Mapping[tuple[int, str, str], dict[str, Any]], scale: float, seconds: float) -> dict[str, Any]:
    seeds = sorted({seed for seed, _, _ in results})
    rows = [
        {
            "seed": seed,
            "variants": {v: {s: results[seed, s, v]["figures"] for s in SHAPES} for v in VARIANTS},
            "loops": {v: {s: results[seed, s, v]["loop"] for s in SHAPES} for v in VARIANTS},
        }
        for seed in seeds
    ]
    return {
        "job": "reproduce paths",
        "truth_level": "catalogue",
        "scale": scale,
        "seeds": rows,
        "reductions": reductions(rows),
        "goals": goals(rows),
        "paper": PAPER,
        "seconds": round(seconds, 1),
        "counterflex": __version__,
    }


def reductions(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """What each controller leaves of the figures that the paper and the goals speak of, truth by truth."""
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
