"""Plan better than compensate: place and posture, strategy and compensation on the part of the demonstration.

Six ways to machine the same part on the same simulated cells: as it is; in the chosen place and posture; with the
strategy; with all three; with compensation alone; with all three and compensation. The place and the posture are those
of ``counterflex plan placement``, the strategy is the feed within a limit of deflection (``process_limits``), as
``compensate`` writes it, without a correction. Grooves and spiral of this part leave no side, width or entry to choose.

Figure: 99.7 % of the path in the cut stay below it, of the deviation across the feed of the tool centre; every way is
judged against the original program. ``catalogue``: the planner knows the cell file only. ``identified``: the cell is
identified first, once for every truth (`counterflex campaign`), and chosen and compensated with that.

Run ``OPENBLAS_NUM_THREADS=1 python benchmarks/plan_better.py --out out/plan-better``; it goes on where it was.
``--seeds`` and ``--levels`` choose, ``--show`` prints the stored results with the goals, ``--store`` adds those of
``--out`` to them and to docs/strategy.md, ``--quick`` is a smoke run.
"""

from __future__ import annotations

import argparse
import json
import math
import multiprocessing
import re
import tempfile
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex.app import examples
from counterflex.app.campaign import campaign
from counterflex.app.compensation.compensate import limited_feed
from counterflex.app.compensation.languages import write
from counterflex.app.inputs import Job, read_job, setting_of
from counterflex.app.placement import placement
from counterflex.app.proof import simulate
from counterflex.app.proof.judge import judge, reference_of
from counterflex.app.proof.truth import truth_of
from counterflex.core import atomic
from counterflex.core.errors import CounterflexError
from counterflex.core.units import DEG, MM
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.cell.set_up import POSE_KEYS, text_with_place
from counterflex.plan.compensate import plan as make_plan
from counterflex.twin.truth.family import FAMILIES, REPORTING_SEEDS
from seeds_option import seeds_of

HERE: Final = Path(__file__).resolve().parent
STORED: Final = HERE / "results" / "plan_better.json"
PAGE: Final = HERE.parent / "docs" / "strategy.md"
SMALL: Final = HERE.parent / "examples" / "programs" / "groove.ngc"
_BLOCK: Final = re.compile(r"(<!-- plan_better: begin[^\n]*-->\n).*?(<!-- plan_better: end -->)", re.DOTALL)
FAMILY: Final = "wide"
LEVELS: Final = ("catalogue", "identified")
DEFLECTION_UM: Final = 300
"""Limit of the deflection that the strategy asks for."""
WAYS: Final[dict[str, tuple[bool, bool, bool]]] = {
    "as it is": (False, False, False),
    "place and posture": (True, False, False),
    "strategy": (False, True, False),
    "place, posture and strategy": (True, True, False),
    "compensation alone": (False, False, True),
    "all three and compensation": (True, True, True),
}
"""Whether a way chooses the place, the strategy, and compensates."""
GOAL_PERCENT: Final = 40.0
Row = dict[str, Any]


def base_files(folder: Path, *, quick: bool) -> tuple[Path, Path]:
    """Program and cell file of the demonstration; the small groove for a smoke run."""
    cell = folder / "base" / "cell.toml"
    program = SMALL if quick else cell.parent / "part.ngc"
    if not cell.is_file():
        cell.parent.mkdir(parents=True, exist_ok=True)
        if quick:
            atomic.write_text(cell, examples.small())
        else:
            examples.write(cell)
    return program, cell


def known_file(folder: Path, level: str, seed: int, base: Path) -> Path:
    """Cell file that the planner knows."""
    return base if level == "catalogue" else folder / "cells" / f"seed-{seed}" / "cell.toml"


def placed_file(folder: Path, level: str, seed: int) -> Path:
    """Cell file with the place that is chosen with what is known."""
    return folder / ("placed" if level == "catalogue" else f"placed-{seed}") / "cell.toml"


def limited(file: Path) -> Cell:
    """A cell with the limit of deflection."""
    target = file.with_name("limited.toml")
    text = file.read_text(encoding="utf-8") + f"\n[process_limits]\ndeflection_um = {DEFLECTION_UM}\n"
    atomic.write_text(target, text)
    return read_cell(target)


def in_place_of(base: Path, placed: Path) -> Cell:
    """The nominal cell, its part and posture as chosen: what the controller runs."""
    tables = read_cell(placed).tables
    part, posture = tables.part, tables.posture
    pose = {key: float(getattr(part, key)) for key in POSE_KEYS}
    target = placed.with_name("nominal.toml")
    text = text_with_place(base, pose, posture.branch, posture.rotation_about_tool_rad / DEG, target.parent)
    atomic.write_text(target, text)
    return read_cell(target)


def planned(program: Path, known: Cell, *, strategy: bool, compensate: bool, folder: Path) -> Path:
    """The program with a feed within limits, with a correction, or both."""
    job, setting = read_job(program, known), setting_of(known)
    slowed = limited_feed(job, known, setting) if strategy else None
    path = job.path if slowed is None else slowed.path
    plan = make_plan(path, job.line_of_motion, known.stock(), setting, feeds=job.feeds, predict=False)
    if not compensate:
        still = np.zeros_like(plan.correction_part)
        plan = replace(plan, correction_part=still, rotvec_part=still)
    for name, text in write(job, plan, known, "gcode")[0].items():
        atomic.write_bytes(folder / name, text.encode(job.program.encoding, errors="replace"))
    return folder / program.name


def one(folder: Path, level: str, seed: int, way: str, quick: bool) -> Row:
    """One way on one truth; a planner that refuses gives a row with its reason and without figures."""
    about: Row = {"level": level, "seed": seed, "way": way}
    try:
        return about | figures(folder, level, seed, way, quick)
    except CounterflexError as fault:
        return about | {"path_p997_mm": None, "path_max_mm": None, "duration_s": None, "refused": str(fault)}


def figures(folder: Path, level: str, seed: int, way: str, quick: bool) -> Row:
    """Plan, machine and judge one way on one truth."""
    program, base = base_files(folder, quick=quick)
    place, strategy, compensate = WAYS[way]
    known = known_file(folder, level, seed, base)
    catalogue = read_cell(base)
    cell = catalogue
    if place:
        chosen = placed_file(folder, level, seed)
        cell, known = in_place_of(base, chosen), chosen
    with tempfile.TemporaryDirectory() as scratch:
        run = program
        if strategy or compensate:
            there = Path(scratch)
            copied = there / "known" / "cell.toml"
            atomic.write_text(copied, known.read_text(encoding="utf-8"))
            plan_cell = limited(copied) if strategy else read_cell(copied)
            run = planned(program, plan_cell, strategy=strategy, compensate=compensate, folder=there / "out")
        job: Job = read_job(run, cell)
        record = simulate.machine(job, cell, truth_of(catalogue, seed, FAMILIES[FAMILY]))
    path = judge(reference_of(read_job(program, cell), cell), record, record.stock).variant.path.path
    return {
        "path_p997_mm": round(path.p997_m / MM, 5),
        "path_max_mm": round(path.max_m / MM, 5),
        "duration_s": round(float(job.machined.time_s[-1]), 2),
    }


def prepare(folder: Path, levels: list[str], seeds: list[int], *, count: int, quick: bool, workers: int) -> None:
    """Choose places, and identify cells where that is asked for; what is there is kept."""
    program, base = base_files(folder, quick=quick)
    if "identified" in levels:
        missing = [s for s in seeds if not known_file(folder, "identified", s, base).is_file()]
        if missing:
            campaign.run(base, folder / "cells", seeds=missing, family=FAMILIES[FAMILY], workers=workers)
    for level in levels:
        for seed in seeds:
            target = placed_file(folder, level, seed).parent
            if not (target / "cell.toml").is_file():
                placement.run(program, known_file(folder, level, seed, base), target, count=count)


def measured(
    folder: Path, levels: list[str], seeds: list[int], workers: int, *, count: int, quick: bool = False
) -> list[Row]:
    """Measure what is not in ``rows.jsonl`` yet."""
    folder.mkdir(parents=True, exist_ok=True)
    log = folder / "rows.jsonl"
    rows = [json.loads(line) for line in log.read_text().splitlines()] if log.is_file() else []
    have = {(r["level"], r["seed"], r["way"]) for r in rows}
    jobs = [(level, seed, way) for level in levels for seed in seeds for way in WAYS if (level, seed, way) not in have]
    if jobs:
        prepare(folder, levels, seeds, count=count, quick=quick, workers=workers)
    alone = multiprocessing.get_context("spawn")  # threads of the kernels do not survive a fork
    with ProcessPoolExecutor(workers, mp_context=alone) as pool, log.open("a") as file:
        tasks = [pool.submit(one, folder, *job, quick) for job in jobs]
        for task in tasks:
            rows.append(task.result())
            file.write(json.dumps(rows[-1]) + "\n")
            file.flush()
    return rows


def table(rows: list[Row]) -> list[str]:
    """The results as lines of Markdown, and the goals beneath them."""
    lines: list[str] = []
    for level in [level for level in LEVELS if any(r["level"] == level for r in rows)]:
        of = {(r["way"], r["seed"]): r for r in rows if r["level"] == level}
        seeds = sorted({seed for way, seed in of if all((other, seed) in of for other in WAYS)})
        if not seeds:
            continue
        first = {seed: of["as it is", seed]["path_p997_mm"] for seed in seeds}
        names = " | ".join(str(seed) for seed in seeds)
        lines += [""] * bool(lines)
        lines += [f"| `{level}`, mm | {names} | median | least gain | time |"]
        lines += ["|---" * (len(seeds) + 4) + "|"]
        for way in WAYS:
            planned_on = [seed for seed in seeds if of[way, seed]["path_p997_mm"] is not None]
            cells = [f"{of[way, seed]['path_p997_mm']:.3f}" if seed in planned_on else "refused" for seed in seeds]
            if not planned_on:
                lines.append(f"| {way} | {' | '.join(cells)} | | | |")
                continue
            values = [of[way, seed]["path_p997_mm"] for seed in planned_on]
            less = [100.0 * (1.0 - value / first[seed]) for value, seed in zip(values, planned_on, strict=True)]
            gain = "" if way == "as it is" else f"{min(less):.0f} %"
            middle = f"{np.median(values):.3f}" + (f", {np.median(less):.0f} % less" if gain else "")
            seconds = np.median([of[way, seed]["duration_s"] for seed in planned_on])
            lines.append(f"| {way} | {' | '.join(cells)} | {middle} | {gain} | {seconds:.0f} s |")
        lines += ["", *goals(of, seeds)]
        lines += [f"Refused, {r['way']} on {r['seed']}: {r['refused']}" for r in of.values() if "refused" in r]
    return lines


def goals(of: dict[tuple[str, int], Row], seeds: list[int]) -> list[str]:
    """Goals, and the number of seeds on which each was reached; a refused way has not reached it."""

    def value(way: str, seed: int) -> float:
        found = of[way, seed]["path_p997_mm"]
        return math.inf if found is None else float(found)

    reached = [value("place and posture", s) <= (1.0 - GOAL_PERCENT / 100.0) * value("as it is", s) for s in seeds]
    better = [value("all three and compensation", s) < value("compensation alone", s) for s in seeds]
    n = len(seeds)
    return [
        f"Place and posture {GOAL_PERCENT:.0f} % less on every seed: {_met(reached, n)}. "
        f"All three and compensation below compensation alone: {_met(better, n)}."
    ]


def _met(held: list[bool], n: int) -> str:
    return f"met on {sum(held)} of {n}" if all(held) else f"**missed** on {n - sum(held)} of {n}"


def with_block(text: str, rows: list[Row]) -> str:
    """The page with the table of some rows between its marks."""
    return _BLOCK.sub(lambda match: match[1] + "\n" + "\n".join(table(rows)) + "\n\n" + match[2], text)


def main() -> int:
    """Measure and print, or print what is stored."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("out/plan-better"))
    parser.add_argument("--levels", nargs="+", choices=LEVELS, default=["catalogue"])
    parser.add_argument("--seeds", type=seeds_of, default=f"{REPORTING_SEEDS[0]}-{REPORTING_SEEDS[0] + 4}")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--show", action="store_true")
    parser.add_argument("--store", action="store_true")
    parser.add_argument("--candidates", type=int, default=placement.CANDIDATES, help="places that are judged")
    parser.add_argument("--quick", action="store_true")
    chosen = parser.parse_args()
    if chosen.show:
        print("\n".join(table(json.loads(STORED.read_text())["rows"])))
        return 0
    seeds = [1] if chosen.quick else chosen.seeds
    with tempfile.TemporaryDirectory() as scratch:
        out = Path(scratch) if chosen.quick else chosen.out
        workers, count = (1, 64) if chosen.quick else (chosen.workers, chosen.candidates)
        rows = measured(out, chosen.levels, seeds, workers, count=count, quick=chosen.quick)
    if chosen.store:
        stored = json.loads(STORED.read_text())["rows"] if STORED.is_file() else []
        merged = {(r["level"], r["seed"], r["way"]): r for r in [*stored, *rows]}
        lines = ",\n".join(json.dumps(merged[k], sort_keys=True) for k in sorted(merged))
        atomic.write_text(STORED, f'{{"rows": [\n{lines}\n]}}\n')
        atomic.write_text(PAGE, with_block(PAGE.read_text(encoding="utf-8"), list(merged.values())))
    print("\n".join(table(rows)))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
