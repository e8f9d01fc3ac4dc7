"""Soft entries: error where a cut begins, uncompensated, as programmed and as ``counterflex plan entry`` rewrites it.

Five programs: a finishing cut that runs straight at a wall (``boss.ngc``), a slot that begins over an edge of the
blank (``groove.ngc`` with ``--edges``), one that begins with a plunge into the full depth, and a shallow slot over an
edge that is come to against its own direction, so that axes turn round just before the first contact (it gets a
run-up); the same once more after a rest in which the swing of the approach dies away. Each is machined before and
after on simulated cells of the family ``wide``; moves and figures are those of the command, by the cell file only.

Figure: the largest deviation of the tool square to the path, over two radii from where the cut begins, of all passes
there, beside the largest step of the force (mean over a cycle of the controller).

Run ``OPENBLAS_NUM_THREADS=1 python benchmarks/soft_entry.py``; ``--quick`` is a smoke run.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from counterflex.app.inputs import read_job
from counterflex.app.proof import simulate
from counterflex.app.proof.truth import truth_of
from counterflex.app.strategy import entry
from counterflex.app.strategy.entry_text import Moves
from counterflex.core.arrays import Bool, Float
from counterflex.core.units import MM
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.path.toolpath import FEED
from counterflex.twin.plant.record import Record
from counterflex.twin.truth.family import FAMILIES, REPORTING_SEEDS
from seeds_option import seeds_of

SHIPPED: Final = Path(__file__).resolve().parents[1] / "examples"
CELL: Final = SHIPPED / "cells" / "kr300_d16_small.toml"
RADIUS_M: Final = 8.0 * MM


@dataclass(frozen=True)
class Case:
    """A program and where its cut begins."""

    edges: bool  # rewrite entries over an edge of the blank
    centre: tuple[float, float] | None  # (x, y) m of a round wall, or None for a slot along x
    begin: tuple[float, float]  # (x, y) m, where the cut begins
    wall_m: float = 0.0  # radius of the tool's path about the centre


CASES: Final = {
    "straight at a wall": Case(False, (0.030, 0.030), (0.008, 0.030), 0.022),
    "slot over an edge": Case(True, None, (-0.008, 0.015)),
    "slot plunged": Case(False, None, (0.015, 0.015)),
    "shallow, come to from ahead": Case(False, None, (-0.008, 0.015)),
    "the same after a rest of 1 s": Case(False, None, (-0.008, 0.015)),
}


def program(folder: Path, name: str) -> Path:
    """The program of a case."""
    if name == "straight at a wall":
        return SHIPPED / "programs" / "boss.ngc"
    groove = SHIPPED / "programs" / "groove.ngc"
    if name == "slot over an edge":
        return groove
    text = groove.read_text(encoding="utf-8")
    if name == "slot plunged":
        text = text.replace("X-12 Y15", "X15 Y15").replace("Z34 F3000", "Z34 F600")
    else:
        text = text.replace("G0 X-12 Y15", "G0 X60 Y15\nG0 Z42\nG0 X-8.2").replace("Z34 F3000", "Z39 F3000")
        rest = "\nG4 P1" if name == "the same after a rest of 1 s" else ""
        text = text.replace("Z39 F3000", f"Z39 F3000{rest}")
    target = folder / "groove.ngc"
    target.write_text(text, encoding="utf-8")
    return target


def deviation_m(record: Record, last: Bool, case: Case) -> float:
    """Largest deviation square to the path where the cut begins; ``last``: rows of the last cut."""
    p: Float = record.p_part_tcp
    cuts = record.engaged & (record.kind == FEED) & last
    if case.centre is None:
        along = p[:, 0] - case.begin[0]
        near = cuts & (along >= 0.0) & (along <= 2.0 * RADIUS_M)
        return float(np.abs(p[near, 1] - case.begin[1]).max())
    arm = p[:, :2] - np.array(case.centre)
    turned = np.arctan2(arm[:, 1], -arm[:, 0])  # clockwise from where the cut begins
    near = cuts & (turned >= 0.0) & (turned <= 2.0 * RADIUS_M / case.wall_m)
    return float(np.abs(np.hypot(arm[near, 0], arm[near, 1]) - case.wall_m).max())


def force_step(record: Record, last: Bool, case: Case) -> float:
    """Largest step of the force about the beginning of the cut, N/ms."""
    away = np.linalg.norm(record.p_part_tcp[:, :2] - np.array(case.begin), axis=1)
    rows = np.flatnonzero((away <= 2.0 * RADIUS_M) & (record.kind == FEED) & last)
    force = np.where(record.engaged[rows, None], record.force_part[rows], 0.0)
    return entry.force_step(record.time_s[rows], force) * 1e-3


def machined(path: Path, cell: Cell, seed: int, case: Case) -> tuple[float, float]:
    """Deviation, m, and force step, N/ms."""
    job = read_job(path, cell)
    record = simulate.machine(job, cell, truth_of(cell, seed, FAMILIES["wide"]))
    kinds = [motion.kind for motion in job.program.motions]
    arcs = [k for k, kind in enumerate(kinds) if kind == "arc"]
    first = max(k for k in range(arcs[-1]) if kinds[k] == "rapid") if arcs else 0
    motion = job.machined.motion[record.row]
    rows = motion == arcs[-1] if arcs else motion >= 0
    return deviation_m(record, rows, case), force_step(record, motion > first, case)


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=seeds_of, default=f"{REPORTING_SEEDS[0]}-{REPORTING_SEEDS[0] + 4}")
    parser.add_argument("--cases", nargs="+", choices=list(CASES), default=list(CASES))
    parser.add_argument("--quick", action="store_true")
    chosen = parser.parse_args()
    seeds = [1] if chosen.quick else chosen.seeds
    cell = read_cell(CELL)
    print("| entry | move | predicted, um | median, mm | less: median, least | force step, N/ms | time |")
    print("|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as scratch:
        for name in chosen.cases[:1] if chosen.quick else chosen.cases:
            case, source, out = CASES[name], program(Path(scratch), name), Path(scratch) / f"out-{name}"
            summary = entry.run(source, CELL, out, Moves(edges=case.edges))
            moved = [row for row in summary["entries"] if row["move"]]
            row = next((row for row in moved if row["kind"] != "run-up"), moved[0])
            pairs = [[machined(p, cell, seed, case) for p in (source, out / source.name)] for seed in seeds]
            errors, steps = (np.array([[one[k] for one in pair] for pair in pairs]) for k in (0, 1))
            less = 100.0 * (1.0 - errors[:, 1] / errors[:, 0])
            middle, force = np.median(errors, axis=0) / MM, np.median(steps, axis=0)
            print(
                f"| {name} | {row['move']} | {row['error_um'][0]:.0f} -> {row['error_um'][1]:.0f} | {middle[0]:.3f} -> "
                f"{middle[1]:.3f} | {np.median(less):.0f} %, {less.min():.0f} % | {force[0]:.1f} -> {force[1]:.1f} | "
                f"{summary['time_s'][0]:.0f} -> {summary['time_s'][1]:.0f} s |",
                flush=True,
            )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
