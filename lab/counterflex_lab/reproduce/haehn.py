"""Reproduce Haehn2020: a groove corrected from force, with pilot control, and with plan and rest, over sockets.

Every identification and every run is kept on disk when it has ended; an interrupted job goes on where it was.
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

from counterflex import __version__
from counterflex.app.campaign import campaign
from counterflex.app.campaign.step import CELL
from counterflex.app.campaign.tasks import TRUTH
from counterflex.app.compensation import compensate
from counterflex.app.long_jobs.step_cache import Mark, begin, finish, finished, made_again, marks_below
from counterflex.app.long_jobs.workers import Shares, count_of, done_one_by_one, interrupts_deferred, pool_of, share
from counterflex.app.proof import evaluate
from counterflex.app.run import session as online_session
from counterflex.app.simulated_cell import cell as live
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, in_parts, share_of, silent
from counterflex.files.schema import write_toml
from counterflex.files.summary_file import write_summary
from counterflex.report.page import write_page
from counterflex_lab.reproduce import closed_loop, haehn_case, haehn_report
from counterflex_lab.reproduce.mark import mark_of

RECIPES: Final[dict[str, tuple[str, ...]]] = {
    "catalogue": ("payload",),
    "identified": ("tracker-frame", "stiffness", "payload", "play", "servo", "cutting"),
}
"""What is identified of each simulated cell first. The weight on the sensor always is: a run is not armed without."""
PAPER: Final[dict[str, float]] = {"uncompensated": 1.4, "force": 0.7, "force_pilot_40ms": 0.3}
"""Largest deviation of the scanned part, mm (Haehn2020 section 3)."""
GOALS_MM: Final[dict[str, float]] = {"force_pilot": 0.3, "hybrid": 0.15}
"""Largest error that these should leave, at every edge and on every truth."""
_FIGURES: Final = ("path", "entry", "plateau", "exit")
_BASE: Final = "cell.toml"
PLANNED: Final = "compensated"
"""Folder of an edge's plan; no variant has this name, so that neither takes the other's place."""
_PLAN_FILE: Final = "plan.parquet"


def run(
    out: str | Path,
    *,
    seeds: Sequence[int] = (1001, 1002, 1003, 1004, 1005),
    level: str = "identified",
    quick: bool = False,
    workers: int | None = None,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Do the job on files: a folder per truth and edge, ``summary.json`` and ``report.html`` over all of them.

    Args:
        out: Folder; what is there and was made from the same inputs is not done again.
        seeds: Truth seeds.
        level: ``identified``: the cell's stiffness, play, drives, payload and cutting constants are measured on the
            simulated cell first; ``catalogue``: its payload only.
        quick: The first seed, straight edge and Cartesian corrections only; payload only identified.
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
    start, before = time.perf_counter(), marks_below(Path(out))
    folder, numbers = Path(out), tuple(seeds[:1]) if quick else tuple(seeds)
    of_cells = 4.0 if level == "identified" else 1.0
    parts = in_parts(progress, {"identifying": of_cells, "milling": 10.0 - of_cells})
    cells = _identify(folder, numbers, level, workers, parts["identifying"])
    edges = ("straight",) if quick else tuple(haehn_case.EDGES)
    jobs = [
        (seed, edge, kind, output)
        for seed in numbers
        for edge in edges
        for kind, item in haehn_case.KINDS.items()
        for output in item.outputs
        if output == "cartesian" or not quick
    ]
    results = _mill_all(folder, jobs, cells, workers, share_of(parts["milling"], 0.0, 0.99))
    summary = _summary(results, level, time.perf_counter() - start)
    summary["made_again"] = made_again(folder, before)
    write_summary(folder / "summary.json", summary)
    parts["milling"](0.99, "page")
    write_page(haehn_report.page(summary, folder), folder / "report.html")
    progress(1.0, "done")
    return summary


def _mill_all(
    folder: Path,
    jobs: Sequence[tuple[int, str, str, str]],
    cells: Mapping[int, Path],
    workers: int | None,
    progress: Progress,
) -> dict[tuple[int, str, str], dict[str, Any]]:
    """Prepare every edge on every cell, then mill; results in the order of the jobs."""
    places = {(seed, edge): folder / f"seed-{seed}" / edge for seed, edge, _, _ in jobs}
    results: dict[tuple[int, str, str, str], dict[str, Any]] = {}
    shares, weights = Shares(len(jobs)), [1.0] * len(jobs)
    with pool_of(count_of(workers, len(jobs)), shares) as pool:
        with interrupts_deferred():
            plans = [pool.submit(_prepare, place, key[1], cells[key[0]]) for key, place in places.items()]
        for plan in plans:
            plan.result()
        with interrupts_deferred():
            waiting = {
                pool.submit(_one_at, k, places[job[:2]], cells[job[0]].with_name(TRUTH), job): job
                for k, job in enumerate(jobs)
            }

        def report() -> None:
            progress(shares.sum(weights), f"milled {len(results)} of {len(jobs)}")

        for done in done_one_by_one(waiting, report):
            results[waiting[done]] = done.result()
    return {(s, e, haehn_case.variant_name(k, o)): results[s, e, k, o] for s, e, k, o in jobs}


def _one_at(task: int, place: Path, truth: Path, job: tuple[int, str, str, str]) -> dict[str, Any]:
    """A run in a worker process, which tells how far it is."""
    result = one(place, truth, job[0], job[2], job[3], progress=share(task))
    share(task)(1.0)
    return result


def _identify(
    folder: Path, numbers: Sequence[int], level: str, workers: int | None, progress: Progress
) -> dict[int, Path]:
    """Cell files that a laboratory makes of the simulated cells; their truth files lie beside them."""
    folder.mkdir(parents=True, exist_ok=True)
    start = folder / _BASE
    write_toml(start, haehn_case.cell_table(haehn_case.demonstration_cell(), 0.0))
    campaign.run(start, folder / level, seeds=numbers, recipes=RECIPES[level], workers=workers, progress=progress)
    return {seed: folder / level / f"seed-{seed}" / CELL for seed in numbers}


def _prepare(place: Path, edge: str, cell: Path) -> None:
    """Program, cell files and plan of one edge on one simulated cell."""
    base = tomllib.loads(cell.read_text(encoding="utf-8"))
    haehn_case.write_cells(base, place, edge)
    cell_file, program, plan = place / haehn_case.OFFLINE, place / haehn_case.PROGRAM, place / PLANNED
    mark = _plan_mark(place)
    if finished(plan, mark) is None:
        begin(plan, mark)
        # At the feed of the paper, which the original program runs as well: one plan for both.
        compensate.run(program, cell_file, plan, report=False, programmed_feed=True)
        finish(plan, mark, {})


def _plan_mark(place: Path) -> Mark:
    """What a plan is made from: the cell without ``[online]``, which no plan depends on."""
    return mark_of(place / haehn_case.OFFLINE, place / haehn_case.PROGRAM)


def _run_mark(place: Path, truth: Path, seed: int, kind: str, output: str) -> Mark:
    """What a run is made from."""
    plan = place / PLANNED
    commanded = (plan / haehn_case.PROGRAM,) if haehn_case.KINDS[kind].compensated else ()
    files = (place / haehn_case.cell_name(kind, output), place / haehn_case.PROGRAM, *commanded)
    return mark_of(*files, plan / _PLAN_FILE, truth, kind=kind, output=output, seed=seed)


def one(place: Path, truth: Path, seed: int, kind: str, output: str, *, progress: Progress = silent) -> dict[str, Any]:
    """Mill one groove, unless that was done, and judge it.

    Args:
        place: Folder of the edge, prepared.
        truth: Truth file.
        seed: Of truth and instruments.
        kind: Of :data:`~counterflex_lab.reproduce.haehn_case.KINDS`.
        output: ``cartesian`` or ``axes``.
        progress: Progress callback, fraction 0 to 1.

    Returns:
        Figures of ``evaluate`` and what the loop said.
    """
    item = haehn_case.KINDS[kind]
    part = place / haehn_case.variant_name(kind, output)
    cell, original = place / haehn_case.cell_name(kind, output), place / haehn_case.PROGRAM
    plan = place / PLANNED / _PLAN_FILE
    program = place / PLANNED / haehn_case.PROGRAM if item.compensated else original
    mark = _run_mark(place, truth, seed, kind, output)
    figures = finished(part, mark)
    if figures is not None:
        return figures
    begin(part, mark)
    log = part.with_name(f"{part.name}-log")
    shutil.rmtree(log, ignore_errors=True)
    with resources.as_file(resources.files("counterflex.app") / "demo" / "rsi.xml") as config:
        twin = live.LiveSettings(program, cell, truth, ("rsi", config), original=original, seed=seed)
        loop = online_session.RunSettings(cell, ("rsi", config), plan, compensated=item.compensated, arm=item.armed)
        outcome = closed_loop.run(twin, part, loop, log, sensors=closed_loop.Sensors(), cycles=1850, progress=progress)
    shutil.rmtree(log, ignore_errors=True)
    judged = evaluate.run([part], None)["variants"]["nominal"]
    figures = {key: judged[key] for key in (*_FIGURES, "surface") if key in judged}
    figures["loop"] = {key: outcome[key] for key in ("cycles", "states", "causes", "largest_correction_um")}
    finish(part, mark, figures)
    return figures


def _summary(results: Mapping[tuple[int, str, str], dict[str, Any]], level: str, seconds: float) -> dict[str, Any]:
    rows = []
    for seed, edge in dict.fromkeys(key[:2] for key in results):
        variants = {name: value for (s, e, name), value in results.items() if (s, e) == (seed, edge)}
        rows.append({"seed": seed, "edge": edge, "truth_level": level, "variants": variants})
    total = over_seeds(rows)
    return {
        "job": "reproduce groove",
        "truth_level": level,
        "seeds": rows,
        "variants": total,
        "goals": {name: _goal(total.get(name, {}), limit) for name, limit in GOALS_MM.items()},
        "paper": PAPER,
        "seconds": round(seconds, 1),
        "counterflex": __version__,
    }


def _goal(figures: Mapping[str, Any], limit_mm: float) -> dict[str, Any]:
    """Worst figure beside its limit; met only where no run was refused."""
    worst = figures["path"]["max_mm"] if "path" in figures else None
    met = worst is not None and worst <= limit_mm and figures["refused"] == 0
    return {"limit_mm": limit_mm, "worst_mm": worst, "met": met}


def over_seeds(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Over truths and edges: ``variants.<name>.path.max_mm`` is the worst, ``.median_max_mm`` the median.

    Runs in which the loop refused to act, though it was to be armed, say nothing of the correction and are left out;
    ``runs`` counts those that are in, ``refused`` the others.

    Args:
        rows: Of the summary.
    """
    out: dict[str, Any] = {}
    for name in dict.fromkeys(name for row in rows for name in row["variants"]):
        there = [row["variants"][name] for row in rows if name in row["variants"]]
        counted = [item for item in there if haehn_report.acted(name, item)]
        out[name] = {"runs": len(counted), "refused": len(there) - len(counted)}
        if not counted:
            continue
        for figure in _FIGURES:
            values = [item[figure]["max_mm"] for item in counted]
            out[name][figure] = {"max_mm": max(values), "median_max_mm": round(statistics.median(values), 6)}
    return out
