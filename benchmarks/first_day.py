"""The first day: what each measurement of a cell gains on a machined part, in the order in which a shop takes them.

Simulated cells are identified over files by `counterflex campaign`; the small groove is compensated with the cell file
as it is after each step, and with one that knows the cutting constants only, for a shop without a tracker. Printed is
the share of the path error (99.7 %) that remains, median and worst over the seeds.

Run ``OPENBLAS_NUM_THREADS=1 python benchmarks/first_day.py --out out/first-day``; it goes on where it was. ``--quick``
is a smoke run: one cell, nothing measured.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import Final

import numpy as np

from accuracy import SHIPPED, machined
from counterflex.app.campaign import campaign
from counterflex.app.compensation.languages import write
from counterflex.app.inputs import Job, read_job, setting_of
from counterflex.app.proof.truth import truth_of
from counterflex.core import atomic
from counterflex.core.units import MM
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.plan.compensate import plan as make_plan
from counterflex.twin.truth.family import FAMILIES
from counterflex.twin.truth.truth import Truth
from seeds_option import seeds_of

CELL: Final = SHIPPED / "cells" / "kr300_d16_small.toml"
PROGRAM: Final = SHIPPED / "programs" / "groove.ngc"
STEPS: Final = {
    "nothing": None,
    "test cuts only": "cutting/seed-{seed}/cell.toml",
    "tracker frame, pulls, poses": "all/seed-{seed}/3-kinematics/cell.toml",
    "and reversals": "all/seed-{seed}/5-play/cell.toml",
    "and load steps": "all/seed-{seed}/7-timing/cell.toml",
    "and test cuts": "all/seed-{seed}/cell.toml",
}
"""What has been measured, and the cell file that knows it."""


def left_m(known: Cell, job: Job, cell: Cell, truth: Truth) -> float:
    """Path error of the program compensated with a cell file, machined on a truth."""
    own = read_job(PROGRAM, known)
    plan = make_plan(own.path, own.line_of_motion, known.stock(), setting_of(known), feeds=own.feeds, predict=False)
    with tempfile.TemporaryDirectory() as scratch:
        for file, text in write(own, plan, known, "gcode")[0].items():
            atomic.write_bytes(Path(scratch) / file, text.encode(own.program.encoding, errors="replace"))
        return machined(read_job(Path(scratch) / PROGRAM.name, cell), cell, truth, job).path.path.p997_m


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("out/first-day"))
    parser.add_argument("--family", choices=list(FAMILIES), default="wide")
    parser.add_argument("--seeds", type=seeds_of, default="1001-1006")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--quick", action="store_true")
    chosen = parser.parse_args()
    seeds = [1] if chosen.quick else chosen.seeds
    family, cell = FAMILIES[chosen.family], read_cell(CELL)
    steps = {name: file for name, file in STEPS.items() if file is None or not chosen.quick}
    if not chosen.quick:
        for name, recipes in (("all", None), ("cutting", ["cutting"])):
            campaign.run(CELL, chosen.out / name, seeds=seeds, family=family, recipes=recipes, workers=chosen.workers)
    job = read_job(PROGRAM, cell)
    left: dict[str, list[tuple[float, float]]] = {name: [] for name in steps}
    for seed in seeds:
        truth = truth_of(cell, seed, family)
        before = machined(job, cell, truth).path.path.p997_m
        for name, file in steps.items():
            known = cell if file is None else read_cell(chosen.out / file.format(seed=seed))
            after = left_m(known, job, cell, truth)
            left[name].append((100.0 * after / before, after / MM))
    print("| measured | remains: median | worst | median mm | worst mm |\n|---|---|---|---|---|")
    for name, rows in left.items():
        (share, size), (most, largest) = np.median(rows, axis=0), np.max(rows, axis=0)
        print(f"| {name} | {share:.0f} % | {most:.0f} % | {size:.2f} | {largest:.2f} |")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
