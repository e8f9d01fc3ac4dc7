"""Headline: whether the figures that a plan begins with lie within their own range, and the truth with them.

Every plan begins with the median of its path error over all that is not known of the cell, before and after
compensation, and with the range that nine of ten such cells lie in. Each plan is made with what a level knows, and the
program is machined as it is and compensated on the simulated cell of a seed. Counted are the headlines within their own
range, the truths (99.7 % of the path across the feed while cutting) within the range, and the plans that made it worse
beside the probabilities that were printed. Levels:

- ``class``: no stiffness is known; the median of the robot's class (``--assume-class``);
- ``catalogue``: the cell file of the demonstration;
- ``measured``: its stiffness and cutting constants identified (``counterflex campaign``);
- ``identified``: every recipe;
- ``exact``: the constants of the truth.

Run ``OPENBLAS_NUM_THREADS=1 python benchmarks/headline.py --out out/headline``: 60 plans, about 20 minutes on an idle
core; it goes on where it was. ``--levels`` picks some, ``--store`` writes rows and table into
``benchmarks/results/headline.json`` and docs/benchmarks.md, where levels that were not run stay with the commit that
they were measured at; ``--quick`` is a smoke run.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

import accuracy
from counterflex.app.campaign import campaign
from counterflex.app.compensation.languages import write
from counterflex.app.compensation.prediction import figures
from counterflex.app.inputs import Job, read_job, setting_of
from counterflex.app.prediction_interval import headline_text, with_intervals, worse_text
from counterflex.app.proof.truth import exact_setting, knowing, truth_of
from counterflex.core import atomic
from counterflex.core.units import MM
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.cell.measured import IdentifiedTable, IdentifiedValue
from counterflex.plan.compensate import plan as make_plan
from counterflex.twin.truth.family import FAMILIES, REPORTING_SEEDS
from counterflex.twin.truth.truth import Truth

FAMILY: Final = "wide"
STORED: Final = accuracy.HERE / "results" / "headline.json"
PAGE: Final = accuracy.HERE.parent / "docs" / "benchmarks.md"
_BLOCK: Final = re.compile(r"(<!-- headline: begin[^\n]*-->\n).*?(<!-- headline: end -->)", re.DOTALL)
MEASURED: Final = ("tracker-frame", "stiffness", "cutting")
LEVELS: Final = ("class", "catalogue", "measured", "identified", "exact")
CLASS_CELL: Final = "irb6640_d16.toml"
PROGRAMS: Final = {"groove": "groove.ngc", "corner": "corner.ngc", "helix": "helix_ramp_return.ngc"}
_PART: Final = "kr300_d16_small.toml"
SEEDS: Final = {"class": 8}
"""Seeds of a level; 3 of all others: 60 plans."""
_SEEDS: Final = 3


def cells_of(level: str, seed: int, base: Path, folder: Path) -> Path:
    """Cell file that a level plans with; measured here where it is not there yet."""
    if level in ("catalogue", "exact"):
        return base
    target = folder / level / f"seed-{seed}" / "cell.toml"
    if not target.is_file():
        recipes = MEASURED if level == "measured" else None
        campaign.run(base, folder / level, seeds=[seed], family=FAMILIES[FAMILY], recipes=recipes, workers=1)
    return target


def known_exactly(cell: Cell, truth: Truth) -> Cell:
    """The cell with the constants of a truth, each marked as identified without an error."""
    chain = knowing(cell, truth)[0]
    elastic = [f"{name}.rz" for name in chain.names]
    drives = [f"axis{axis + 1}.half_band" for axis in range(6)]
    tables = []
    for recipe, names in (("stiffness", elastic), ("play", drives), ("cutting", [])):
        values = tuple(IdentifiedValue(name=name, value=1.0, sigma=0.0, unit="") for name in names)
        tables.append(
            IdentifiedTable(
                recipe=recipe, date="", data=(), data_sha256=(), counterflex="", holdout="", values=values
            )
        )  # fmt: skip
    return replace(cell, chain=chain, tables=cell.tables.model_copy(update={"identified": tuple(tables)}))


def one(level: str, program: str, seed: int, out: Path, before: dict[str, float]) -> dict[str, Any]:
    """One plan: what it says first, and what the simulated cell does.

    Args:
        level: One of :data:`LEVELS`.
        program: One of :data:`PROGRAMS`.
        seed: Of the truth.
        out: Folder of cells that are measured.
        before: Errors of programs as they are, by cell, program and seed: found once, added to.
    """
    base = accuracy.demonstration(out)
    source = accuracy.SHIPPED / "programs" / PROGRAMS[program]
    with tempfile.TemporaryDirectory() as scratch:
        place = Path(scratch)
        if level == "class":
            known = cell = read_cell(accuracy.SHIPPED / "cells" / CLASS_CELL, assume_class=True)
        else:
            accuracy.PROGRAMS[program] = (PROGRAMS[program], _PART)
            cell = read_cell(accuracy.files_of(program, base, base, place)[1])
            known = read_cell(accuracy.files_of(program, cells_of(level, seed, base, out), base, place)[1])
        truth = truth_of(cell, seed, FAMILIES[FAMILY])
        job, own = read_job(source, cell), read_job(source, known)
        exact = level == "exact"
        setting = exact_setting(job, cell, truth) if exact else setting_of(known)
        plan = make_plan(own.path, own.line_of_motion, known.stock(), setting, feeds=own.feeds)
        headline = with_intervals(figures(plan), plan, known_exactly(cell, truth) if exact else known)["headline"]
        for file, text in write(own, plan, known, "gcode")[0].items():
            atomic.write_bytes(place / level / file, text.encode(own.program.encoding, errors="replace"))
        key = f"{cell.name} {program} {seed}"
        if key not in before:
            before[key] = _machined(job, cell, truth)
        after = _machined(read_job(place / level / source.name, cell), cell, truth, job)
    return {
        "level": level, "program": program, "seed": seed, **headline,
        "model_mm": [figures(plan)[f"predicted_{name}"]["p997_mm"] for name in ("nominal", "compensated")],
        "cell_mm": [round(before[key], 4), round(after, 4)],
    }  # fmt: skip


def _machined(job: Job, cell: Cell, truth: Truth, source: Job | None = None) -> float:
    return accuracy.machined(job, cell, truth, source).path.path.p997_m / MM


def within(row: dict[str, Any], values: str) -> list[bool]:
    """Return whether the figures of a row, before and after, lie within the range of its headline."""
    ranges = (row["before_mm"], row["after_mm"])
    given = [row["before_mm"][0], row["after_mm"][0]] if values == "headline" else row[values]
    return [bool(low <= value <= high) for value, (_, low, high) in zip(given, ranges, strict=True)]


def table(rows: list[dict[str, Any]]) -> list[str]:
    """Lines of the table, Markdown."""
    lines = [
        "| planner knows | plans | headline within its range | model alone within it | simulated cell within it | "
        "probability of worse, mean | made worse | at commit |",
        "|---|---|---|---|---|---|---|---|",
    ]
    levels = [level for level in LEVELS if any(row["level"] == level for row in rows)]
    for level in [*levels, "all"]:
        mine = [row for row in rows if level in (row["level"], "all")]
        counts = []
        for values in ("headline", "model_mm", "cell_mm"):
            held = [one for row in mine for one in within(row, values)]
            counts.append(f"{sum(held)} of {len(held)}")
        worse = 100.0 * float(np.mean([row["probability_of_worse"] for row in mine]))
        became = sum(row["cell_mm"][1] > row["cell_mm"][0] for row in mine)
        made = "" if level == "all" else ", ".join(sorted({row.get("commit", "not kept") for row in mine}))
        words = f"{' | '.join(counts)} | {worse:.1f} % | {became} of {len(mine)} | {made}"
        lines.append(f"| {level} | {len(mine)} | {words} |")
    return lines


def with_stored(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Stored rows with those of the levels that were run in their place."""
    stored = json.loads(STORED.read_text(encoding="utf-8"))["rows"] if STORED.is_file() else []
    levels = {row["level"] for row in rows}
    kept = [row for row in stored if row["level"] not in levels]
    return sorted([*kept, *rows], key=lambda row: LEVELS.index(row["level"]))


def with_block(text: str, rows: list[dict[str, Any]]) -> str:
    """The page with the table of some rows between its marks."""
    return _BLOCK.sub(lambda match: match[1] + "\n" + "\n".join(table(rows)) + "\n\n" + match[2], text)


def plans(levels: list[str], quick: bool) -> Iterator[tuple[str, str, int]]:
    """Level, program and seed of every plan."""
    for level in levels:
        for seed in REPORTING_SEEDS[: 1 if quick else SEEDS.get(level, _SEEDS)]:
            for program in list(PROGRAMS)[: 1 if quick else None]:
                yield level, program, seed


def main() -> int:
    """Plan, machine and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("out/headline"))
    parser.add_argument("--levels", nargs="+", choices=LEVELS, default=list(LEVELS))
    parser.add_argument("--store", action="store_true")
    parser.add_argument("--quick", action="store_true")
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        out = Path(scratch) if chosen.quick else chosen.out
        out.mkdir(parents=True, exist_ok=True)
        log = out / "plans.jsonl"
        rows = [json.loads(line) for line in log.read_text().splitlines()] if log.is_file() else []
        done = {(row["level"], row["program"], row["seed"]) for row in rows}
        before: dict[str, float] = {}
        levels = ["catalogue"] if chosen.quick else chosen.levels
        for what in plans(levels, chosen.quick):
            if what in done:
                continue
            row = one(*what, out, before) | {"commit": accuracy.commit()}
            rows.append(row)
            with log.open("a") as file:
                file.write(json.dumps(row) + "\n")
            print(
                f"{' '.join(map(str, what))}: expected after {headline_text(row['after_mm'])}, worse "
                f"{worse_text(row['probability_of_worse'])}, simulated {row['cell_mm'][1]:.3f} mm",
                file=sys.stderr,
            )
    if chosen.store:
        rows = with_stored(rows)
        lines = ",\n".join(json.dumps(row, sort_keys=True) for row in rows)
        atomic.write_text(STORED, f'{{"rows": [\n{lines}\n]}}\n')
        atomic.write_text(PAGE, with_block(PAGE.read_text(encoding="utf-8"), rows))
    print("\n".join(table(rows)))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
