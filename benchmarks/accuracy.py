"""Accuracy: what is left of the path error on simulated cells, by what the planner knows; whether its interval holds.

A cell is identified once for every truth, over files (`counterflex campaign`), on the cell file of the demonstration;
the other programs take its result with a part of their own. Every program is machined as it is and compensated with the
cell file of the catalogue, with that taught by a first cut (a coupon on the small blank, measured to 15 um), with the
identified one and with the exact constants of the truth. Printed are the median
and the worst share of the error that remains (99.7 % of the path across the feed while cutting), the largest error, and
how many of the predicted 90 % intervals hold what was machined.

Run ``OPENBLAS_NUM_THREADS=1 python benchmarks/accuracy.py --out out/accuracy``; it goes on where it was. ``--family``,
``--seeds``, ``--programs`` and ``--levels`` choose; ``--show`` prints the stored results with the goals; ``--store``
adds those of ``--out`` to them, and to docs/twin.md; ``--calibrate`` writes the factors on the intervals of the
catalogue from tuning seeds into the package; ``--quick`` is a smoke run.
"""

from __future__ import annotations

import argparse
import json
import math
import re
import shlex
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from datetime import UTC, datetime
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex.app import examples, prediction_interval
from counterflex.app.campaign import campaign
from counterflex.app.compensation.languages import write
from counterflex.app.first_cut import first_cut
from counterflex.app.inputs import Job, read_job, setting_of
from counterflex.app.proof import simulate
from counterflex.app.proof.judge import judge, reference_of
from counterflex.app.proof.truth import exact_setting, truth_of
from counterflex.core import atomic
from counterflex.core.arrays import Float
from counterflex.core.units import MM
from counterflex.evaluate.summary import Variant
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.schema import write_toml
from counterflex.plan.compensate import plan as make_plan
from counterflex.twin.truth.family import FAMILIES, REPORTING_SEEDS, TUNING_SEEDS
from counterflex.twin.truth.file import write_truth
from counterflex.twin.truth.truth import Truth
from seeds_option import seeds_of

HERE: Final = Path(__file__).resolve().parent
SHIPPED: Final = HERE.parent / "examples"
STORED: Final = HERE / "results" / "accuracy.json"
PAGE: Final = HERE.parent / "docs" / "twin.md"
_BLOCK: Final = re.compile(r"(<!-- accuracy: begin[^\n]*-->\n).*?(<!-- accuracy: end -->)", re.DOTALL)
PROGRAMS: Final = {
    "part": None,
    "groove": ("groove.ngc", "kr300_d16_small.toml"),
    "corner": ("corner.ngc", "kr300_d16_small.toml"),
    "profile": ("fc_profile.ngc", "kr300_d16_flat.toml"),
}
"""Program and cell file of the part that it machines; ``part`` is the demonstration."""
FIRST_CUT: Final = "first cut"
LEVELS: Final = ("catalogue", FIRST_CUT, "identified", "exact")
FEED_MM_MIN, RPM = 1500.0, 13000.0
"""Of the coupon: those of the groove."""
GOALS: Final = {
    (FIRST_CUT, "wide"): (15.0, 25.0),
    ("exact", "mild"): (6.0, 9.0),
    ("exact", "wide"): (6.0, 9.0),
    ("exact", "other"): (6.0, 9.0),
    ("identified", "mild"): (10.0, 15.0),
    ("identified", "wide"): (12.0, 20.0),
    ("identified", "other"): (20.0, 30.0),
    ("catalogue", "wide"): (25.0, 40.0),
}
"""Per cent that may remain: median, worst seed."""
COVERAGE: Final = (80.0, 97.0)
VARIANTS: Final = ("nominal", "compensated")
CORNER_MM: Final = (0.12, 0.1)
"""Largest error with the identified cell, and largest of the floor."""


def demonstration(folder: Path) -> Path:
    """Cell file of the demonstration, with its part beside it."""
    file = folder / "demonstration" / "cell.toml"
    if not file.is_file():
        file.parent.mkdir(parents=True, exist_ok=True)
        examples.write(file)
    return file


def files_of(name: str, known: Path, base: Path, folder: Path) -> tuple[Path, Path]:
    """Program, and the cell file ``known`` with the part that the program machines."""
    chosen = PROGRAMS[name]
    if chosen is None:
        return base.parent / "part.ngc", known
    program, shipped = chosen
    data = tomllib.loads(known.read_text(encoding="utf-8"))
    data["part"] = tomllib.loads((SHIPPED / "cells" / shipped).read_text(encoding="utf-8"))["part"]
    target = folder / f"{name}-{known.parent.name}.toml"
    write_toml(target, data)
    return SHIPPED / "programs" / program, target


def machined(job: Job, cell: Cell, truth: Truth, source: Job | None = None) -> Variant:
    """Figures of a program on a truth; ``source``: the program that it is judged against."""
    record = simulate.machine(job, cell, truth)
    return judge(reference_of(source or job, cell), record, record.stock).variant


def one(name: str, family: str, seed: int, levels: list[str], out: str) -> list[dict[str, Any]]:
    """All levels of a program on one truth."""
    folder = Path(out)
    base = demonstration(folder)
    truth = truth_of(read_cell(base), seed, FAMILIES[family])
    with tempfile.TemporaryDirectory() as scratch:
        place = Path(scratch)
        program, catalogue = files_of(name, base, base, place)
        cell = read_cell(catalogue)
        job = read_job(program, cell)
        before = machined(job, cell, truth)
        rows = []
        for level in levels:
            known = cell
            if level == FIRST_CUT:
                known = read_cell(files_of(name, taught(base, family, seed, folder), base, place)[1])
            elif level == "identified":
                measured_cell = folder / "cells" / family / f"seed-{seed}" / "cell.toml"
                known = read_cell(files_of(name, measured_cell, base, place)[1])
            own = read_job(program, known)
            exact = level == "exact"
            setting = exact_setting(job, cell, truth) if exact else setting_of(known)
            plan = make_plan(own.path, own.line_of_motion, known.stock(), setting, feeds=own.feeds, predict=not exact)
            for file, text in write(own, plan, known, "gcode")[0].items():
                atomic.write_bytes(place / level / file, text.encode(own.program.encoding, errors="replace"))
            after = machined(read_job(place / level / program.name, cell), cell, truth, job)
            row = {"program": name, "family": family, "seed": seed, "level": level, **figures(before, after)}
            drawn = None if exact else prediction_interval.foreseen(plan, known, as_drawn=True)
            found = None if exact else prediction_interval.foreseen(plan, known)
            if drawn is not None and found is not None:
                row["probability_of_worse"] = round(found.worse_share, 4)
                for variant in VARIANTS:
                    i = getattr(found, variant)
                    row[f"{variant}_interval_mm"] = [round(i.low_m / MM, 4), round(i.high_m / MM, 4)]
                    row[f"{variant}_median_mm"] = round(i.median_m / MM, 4)
                    i = getattr(drawn, variant)
                    row[f"{variant}_drawn_mm"] = [round(i.low_m / MM, 4), round(i.high_m / MM, 4)]
            rows.append(row)
    return rows


def taught(base: Path, family: str, seed: int, folder: Path) -> Path:
    """Cell file taught by a coupon that a truth has milled."""
    out = folder / "first-cut" / family / f"seed-{seed}"
    if not (out / "cell.toml").is_file():
        with tempfile.TemporaryDirectory() as scratch:
            place = Path(scratch)
            cell_file = files_of("groove", base, base, place)[1]
            first_cut.propose(cell_file, place / "coupon", tool=1, feed_mm_min=FEED_MM_MIN, rpm=RPM)
            truth_file = place / "truth.toml"
            write_truth(truth_file, truth_of(read_cell(base), seed, FAMILIES[family]))
            program = place / "coupon" / first_cut.PROGRAM
            simulate.run(program, cell_file, truth_file, place / "part")
            first_cut.run(program, cell_file, out, part=place / "part")
    return out / "cell.toml"


def figures(before: Variant, after: Variant) -> dict[str, float]:
    """Figures of one machining before and after, mm."""
    out = {}
    for prefix, variant in (("nominal", before), ("compensated", after)):
        path = variant.path
        for part in ("path", "entry", "plateau", "exit"):
            out[f"{prefix}_{part}_p997_mm"] = round(getattr(path, part).p997_m / MM, 4)
        out[f"{prefix}_max_mm"] = round(path.path.max_m / MM, 4)
        if variant.surface is not None:
            out[f"{prefix}_floor_max_mm"] = round(variant.surface.floor.max_m / MM, 4)
    return out


def table(rows: list[dict[str, Any]]) -> list[str]:
    """Lines of the table, Markdown."""
    lines = [
        "| program | family | planner knows | seeds | median left | worst | goal | largest error | floor "
        "| intervals hold |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    keys = sorted({(r["program"], r["family"], r["level"]) for r in rows}, key=_order)
    for program, family, level in keys:
        mine = [r for r in rows if (r["program"], r["family"], r["level"]) == (program, family, level)]
        left = [100.0 * r["compensated_path_p997_mm"] / r["nominal_path_p997_mm"] for r in mine]
        median, worst = float(np.median(left)), max(left)
        goal = GOALS.get((level, family))
        met = "-" if goal is None else f"{goal[0]:g} / {goal[1]:g}: " + _met(median <= goal[0] and worst <= goal[1])
        held = [
            r[f"{v}_interval_mm"][0] <= r[f"{v}_path_p997_mm"] <= r[f"{v}_interval_mm"][1]
            for r in mine
            for v in VARIANTS
            if f"{v}_interval_mm" in r
        ]
        share = f"{sum(held)} of {len(held)}" if held else "-"
        lines.append(
            f"| {program} | `{family}` | {level} | {len(mine)} | {median:.1f} % | {worst:.1f} % | {met} | "
            f"{max(r['compensated_max_mm'] for r in mine):.2f} mm | "
            f"{max(r.get('compensated_floor_max_mm', 0.0) for r in mine):.2f} mm | {share} |"
        )
    return lines + _corner(rows) + _bounds(rows, keys) + _coverage(rows) + _worse(rows)


def _corner(rows: list[dict[str, Any]]) -> list[str]:
    """The goal of the sharp corner."""
    corners = [r for r in rows if (r["program"], r["family"], r["level"]) == ("corner", "wide", "identified")]
    if not corners:
        return []
    largest = [max(r[f"compensated_{key}_mm"] for r in corners) for key in ("max", "floor_max")]
    first, second = (_met(value <= goal) for value, goal in zip(largest, CORNER_MM, strict=True))
    return [
        "",
        f"Sharp corner, `wide`, identified: at most {largest[0]:.2f} mm in the whole program (goal {CORNER_MM[0]:g}: "
        f"{first}), {largest[1]:.2f} mm on its floor (goal {CORNER_MM[1]:g}: {second}).",
    ]


def _bounds(rows: list[dict[str, Any]], keys: list[tuple[str, str, str]]) -> list[str]:
    """Error that no plan from a catalogue can go below."""
    lines = []
    for key in keys:
        if key[2] == "catalogue":
            mine = [r["nominal_path_p997_mm"] for r in rows if (r["program"], r["family"], r["level"]) == key]
            median, worst = same_for_all(np.array(mine))
            lines += [
                "",
                f"{key[0]}, `{key[1]}`: one correction for all these robots, made knowing them all, leaves at least "
                f"{median:.0f} % in the median or {worst:.0f} % at worst.",
            ]
    return lines


def _coverage(rows: list[dict[str, Any]]) -> list[str]:
    """Number of intervals that hold, by family."""
    lines = []
    for family in sorted({r["family"] for r in rows}):
        held = [
            r[f"{v}_interval_mm"][0] <= r[f"{v}_path_p997_mm"] <= r[f"{v}_interval_mm"][1]
            for r in rows
            if r["family"] == family
            for v in VARIANTS
            if f"{v}_interval_mm" in r
        ]
        if held:
            share = 100.0 * sum(held) / len(held)
            met = _met(COVERAGE[0] <= share <= COVERAGE[1])
            lines += ["", f"Intervals that hold on `{family}`: {share:.0f} % of {len(held)} (goal 80 to 97 %: {met})."]
    return lines


def _worse(rows: list[dict[str, Any]]) -> list[str]:
    """Parts that compensation made worse, by level, beside how likely that was said to be, and width of intervals."""
    lines = []
    for level in LEVELS:
        told = [r for r in rows if r["level"] == level and "probability_of_worse" in r]
        if told:
            worse = sum(r["compensated_path_p997_mm"] > r["nominal_path_p997_mm"] for r in told)
            said = float(np.mean([r["probability_of_worse"] for r in told]))
            ratio = (float(np.median([np.divide(*r[f"{v}_interval_mm"][::-1]) for r in told])) for v in VARIANTS)
            lines += [
                "",
                f"{level}: {worse} of {len(told)} parts worse than uncompensated, {100.0 * said:.1f} % foretold; upper "
                "over lower end of the intervals {:.1f} uncompensated, {:.1f} compensated (medians).".format(*ratio),
            ]
    return lines


def same_for_all(errors_m: Float) -> tuple[float, float]:
    """Error that one correction leaves on many robots, chosen after all of them have been measured.

    A plan that knows the catalogue corrects all robots of a type by one c and leaves ``|c / e - 1|`` of an error e.

    Args:
        errors_m: (n,) uncompensated errors.

    Returns:
        The smallest median that any c leaves, and the smallest worst, ``(max - min) / (max + min)``; per cent.
    """
    c = np.linspace(errors_m.min(), errors_m.max(), 2000)[:, None]
    left = np.abs(c / errors_m - 1.0)
    return 100.0 * float(np.median(left, axis=1).min()), 100.0 * float(left.max(axis=1).min())


BEYOND: Final = 0.05
"""Share of the cells that may lie beyond each end of an interval."""


def conformal_factors(measured: Sequence[float], drawn: Sequence[Sequence[float]], cells: int) -> tuple[float, float]:
    """Return factors on the logarithmic distance of the lower and the upper end from the median (split conformal).

    Of n figures of c cells the ``ceil(n (c + 1) / c (1 - BEYOND))``-th smallest is taken: a figure of a further cell
    lies beyond that end with :data:`BEYOND` at most, if it is drawn as they are. Cells are drawn independently, the
    programs that one cell cuts are not: taken for independent figures they narrow an end to less than it holds (Lee,
    Barber and Willett 2023, hierarchical conformal prediction).

    Args:
        measured: n path errors, as many of each cell.
        drawn: Median, lower and upper end of the interval of each.
        cells: c.

    Raises:
        ValueError: There are fewer figures than that rank.
    """
    rank = math.ceil(len(measured) * (cells + 1) / cells * (1.0 - BEYOND) - 1e-9)
    if rank > len(measured):
        raise ValueError(f"{cells} cells say nothing of 1 in {1.0 / BEYOND:g}")
    median, *ends = np.log(np.asarray(drawn)).T
    lower, upper = (np.sort((np.log(measured) - median) / (end - median))[rank - 1] for end in ends)
    return max(float(lower), 0.0), max(float(upper), 0.0)


def calibrate(rows: list[dict[str, Any]], command: str) -> None:
    """Write the factors on the intervals of the catalogue into the package.

    Raises:
        ValueError: The rows are too few, or not of tuning seeds.
    """
    mine = [row for row in rows if row["level"] == "catalogue"]
    if not {row["seed"] for row in mine} <= set(TUNING_SEEDS):
        raise ValueError("factors come from tuning seeds alone")
    seeds = sorted({row["seed"] for row in mine})
    before, after = (
        conformal_factors(
            [row[f"{v}_path_p997_mm"] for row in mine],
            [(row[f"{v}_median_mm"], *row[f"{v}_drawn_mm"]) for row in mine],
            len(seeds),
        )
        for v in VARIANTS
    )
    found = {
        "level": "catalogue", "before": [round(f, 3) for f in before], "after": [round(f, 3) for f in after],
        "cells": len(seeds), "figures": len(mine), "family": ", ".join(sorted({row["family"] for row in mine})),
        "seeds": f"{seeds[0]}-{seeds[-1]}", "date": datetime.now(UTC).date().isoformat(), "command": command,
    }  # fmt: skip
    file = Path(prediction_interval.__file__).with_name(prediction_interval.CALIBRATION)
    write_toml(file, {"levels": [found]})


def _met(reached: bool) -> str:
    return "met" if reached else "**missed**"


def _order(key: tuple[str, str, str]) -> tuple[int, int, int]:
    program, family, level = key
    levels: list[str] = list(LEVELS)
    return list(PROGRAMS).index(program), list(FAMILIES).index(family), levels.index(level)


def with_block(text: str, rows: list[dict[str, Any]]) -> str:
    """The page with the table of some rows between its marks."""
    return _BLOCK.sub(lambda match: match[1] + "\n" + "\n".join(table(rows)) + "\n\n" + match[2], text)


def commit() -> str:
    """Commit that is measured, with a mark where files have changed since."""
    words = ["git", "-C", str(HERE), "describe", "--always", "--dirty", "--abbrev=10"]
    return subprocess.run(words, capture_output=True, text=True, check=False).stdout.strip() or "unknown"


def measured(
    out: Path, programs: list[str], families: list[str], seeds: list[int], levels: list[str], workers: int
) -> list[dict[str, Any]]:
    """Measure what is not in ``rows.jsonl`` yet."""
    out.mkdir(parents=True, exist_ok=True)
    log = out / "rows.jsonl"
    done = [json.loads(line) for line in log.read_text().splitlines()] if log.is_file() else []
    base = demonstration(out)
    for family in families:
        missing = [s for s in seeds if not (out / "cells" / family / f"seed-{s}" / "cell.toml").is_file()]
        if "identified" in levels and missing:
            print(f"identifying {len(missing)} cells of {family}", file=sys.stderr)
            campaign.run(base, out / "cells" / family, seeds=missing, family=FAMILIES[family], workers=workers)
    have = {(r["program"], r["family"], r["seed"], r["level"]) for r in done}
    jobs = []
    for family in families:
        for name in programs:
            for seed in seeds:
                open_levels = [level for level in levels if (name, family, seed, level) not in have]
                if open_levels:
                    jobs.append((name, family, seed, open_levels, str(out)))
    rows = done
    with ProcessPoolExecutor(workers, get_context("spawn")) as pool, log.open("a") as file:
        for i, found in enumerate(pool.map(one, *zip(*jobs, strict=True)) if jobs else ()):
            rows += found
            for row in found:
                file.write(json.dumps({**row, "commit": commit()}) + "\n")
            file.flush()
            what = f"{found[0]['program']}, {found[0]['family']}, seed {found[0]['seed']}"
            print(f"{i + 1} of {len(jobs)}: {what}", file=sys.stderr)
    return rows


def main() -> int:
    """Measure and print, or print what is stored."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("out/accuracy"))
    parser.add_argument("--programs", nargs="+", choices=list(PROGRAMS), default=list(PROGRAMS))
    parser.add_argument("--family", nargs="+", choices=list(FAMILIES), default=list(FAMILIES))
    parser.add_argument("--levels", nargs="+", choices=list(LEVELS), default=list(LEVELS))
    parser.add_argument("--seeds", type=seeds_of, default=f"{REPORTING_SEEDS[0]}-{REPORTING_SEEDS[-1]}")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--show", action="store_true")
    parser.add_argument("--store", action="store_true")
    parser.add_argument("--calibrate", action="store_true")
    parser.add_argument("--quick", action="store_true")
    chosen = parser.parse_args()
    if chosen.show:
        print("\n".join(table(json.loads(STORED.read_text())["rows"])))
        return 0
    programs, families, levels, seeds = chosen.programs, chosen.family, chosen.levels, chosen.seeds
    with tempfile.TemporaryDirectory() as scratch:
        out = Path(scratch) if chosen.quick else chosen.out
        if chosen.quick:
            programs, families, levels, seeds = ["groove"], ["wide"], ["catalogue"], [1]
        rows = measured(out, programs, families, seeds, levels, 1 if chosen.quick else chosen.workers)
    if chosen.calibrate and not chosen.quick:
        calibrate(rows, shlex.join(["python", "benchmarks/accuracy.py", *sys.argv[1:]]))
    if chosen.store:
        stored = json.loads(STORED.read_text())["rows"] if STORED.is_file() else []
        key = ("program", "family", "seed", "level")
        merged = {tuple(r[k] for k in key): r for r in [*stored, *rows]}
        STORED.parent.mkdir(exist_ok=True)
        lines = ",\n".join(json.dumps(merged[k], sort_keys=True) for k in sorted(merged))
        atomic.write_text(STORED, f'{{"rows": [\n{lines}\n]}}\n')
        atomic.write_text(PAGE, with_block(PAGE.read_text(encoding="utf-8"), list(merged.values())))
    print("\n".join(table(rows)))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
