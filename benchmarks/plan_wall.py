"""Placement, posture, strategy and compensation on a finished wall: what each leaves of the error, and all of them.

A finished wall in both materials of Berger2013 (as ``benchmarks/wall_finish.py`` has it): as programmed, in the place
and posture of ``plan placement``, as ``plan strategy`` advises, and with all three; each uncompensated and compensated.
Every choice and every plan is made from the cell file alone (``catalogue``), and machined on simulated cells of the
family ``wide``. Figure: the deviation normal to the wall that 99.7 % of the path in the cut stay below, in mm.

Run ``OPENBLAS_NUM_THREADS=1 python benchmarks/plan_wall.py``; ``--seeds 200-204`` chooses others, ``--quick`` is a
smoke run. ``--write FILE`` adds the rows to a JSON file as they are made and leaves out those that it has.
"""

from __future__ import annotations

import argparse
import json
import math
import multiprocessing
import tempfile
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np

import wall_finish
from counterflex.app.compensation.compensate import compensate
from counterflex.app.inputs import read_job
from counterflex.app.placement import placement
from counterflex.app.proof import simulate
from counterflex.app.proof.truth import truth_of
from counterflex.app.strategy.advice import WallOperation, advise
from counterflex.app.strategy.advice_table import shown
from counterflex.core import atomic
from counterflex.core.errors import SimulationError
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.cell.set_up import text_placed_as
from counterflex.plan.posture.cut_path import Surface
from counterflex.twin.truth.family import FAMILIES, REPORTING_SEEDS
from seeds_option import seeds_of

CHOICES: Final = ("as programmed", "placement and posture", "strategy", "all three")


@dataclass(frozen=True)
class Work:
    """A program with its cell file."""

    program: Path  # as it is or as advised
    cell_file: Path  # with the part in the place that was chosen for it
    known: Path  # the cell file as it was: simulated cells are drawn about it
    folder: Path  # for the compensated program

    @cached_property
    def cell(self) -> Cell:
        """The cell."""
        return read_cell(self.cell_file)

    @cached_property
    def compensated(self) -> Path:
        """The compensated program."""
        target = self.folder / f"compensated_{self.program.name}"
        files = compensate(self.program, self.cell, predict=False).files
        target.write_text(next(text for name, text in files.items() if name.endswith(".ngc")), encoding="utf-8")
        return target


def error_mm(program: Path, cell_file: Path, known_file: Path, seed: int) -> float:
    """Error left on a simulated cell, mm; infinite where the tool is pulled in as deep as its flutes are long."""
    cell = read_cell(cell_file)
    truth = truth_of(read_cell(known_file), seed, FAMILIES["wide"])
    try:
        record = simulate.machine(read_job(program, cell), cell, truth)
    except SimulationError:
        return math.inf
    return wall_finish.normal_error_mm(record)


def _placed(program: Path, cell_file: Path, folder: Path, surface: Surface, count: int) -> Path:
    summary = placement.run(program, cell_file, folder, surface=surface, count=count)
    best, present = summary["chosen"], summary["present"]
    print(
        f"<!-- {program.name}: {present['deflection_um']:.0f} -> {best['deflection_um']:.0f} um predicted, error "
        f"{present['error_um']:.0f} -> {best['error_um']:.0f} um, damping in the cut "
        f"{present['damping_in_cut']:.3f} -> {best['damping_in_cut']:.3f} at "
        f"{best['x_mm']:g} {best['y_mm']:g} {best['z_mm']:g} mm, {best['a_deg']:g} deg, {best['branch']} "
        f"{best['rotation_about_tool_deg']:g} deg -->",
        flush=True,
    )
    return folder / "cell.toml"


def _advised(program: Path, cell_file: Path) -> dict[str, Any]:
    """The cut that is advised for a program at its place."""
    advice = advise(read_cell(cell_file), WallOperation(), program)
    best = shown(advice.choices, advice.best[0], advice.law)
    return {key: best[key] for key in ("milling", "ae_mm", "ap_mm", "fz_mm")} | {"rpm": best["spindle_rpm"]}


def _wall(material: dict[str, Any], folder: Path, count: int) -> dict[str, Work]:
    """A finished wall in the four ways."""
    table = material["table"]
    own = {"milling": "down", **{key: material[key] for key in ("ae_mm", "ap_mm", "fz_mm", "rpm")}}
    program, cell_file = wall_finish.files(folder / "own", own, table)
    moved = _placed(program, cell_file, folder / "moved", "wall", count)
    works = {
        "as programmed": Work(program, cell_file, cell_file, folder / "own"),
        "placement and posture": Work(program, moved, cell_file, folder / "moved"),
    }
    for name, at in (("strategy", cell_file), ("all three", moved)):
        cut = _advised(program, at)
        print(f"<!-- {name}: {cut} -->", flush=True)
        advised, known = wall_finish.files(folder / name, cut, table)
        target = folder / name / "placed.toml"
        atomic.write_text(target, text_placed_as(known, at, target.parent))
        works[name] = Work(advised, target, known, folder / name)
    return works


def rows(
    name: str, folder: Path, seeds: list[int], count: int, known: list[dict[str, Any]], workers: int
) -> Iterator[dict[str, Any]]:
    """Rows of a workpiece that are not known yet: name, choice, compensated, seed, error in mm."""
    have = {(row["workpiece"], row["choice"], row["compensated"], row["seed"]) for row in known}
    wanted = [
        (choice, compensated, seed)
        for choice in CHOICES
        for seed in seeds
        for compensated in (False, True)
        if (name, choice, compensated, seed) not in have
    ]
    if not wanted:
        return
    folder.mkdir(parents=True)
    works = _wall(wall_finish.MATERIALS[name], folder, count)
    alone = multiprocessing.get_context("spawn")  # threads of the kernels do not survive a fork
    with ProcessPoolExecutor(workers, mp_context=alone) as pool:
        tasks = {}
        for compensated in (False, True):
            for choice, seed in [(c, s) for c, done, s in wanted if done == compensated]:
                work = works[choice]
                program = work.compensated if compensated else work.program
                task = pool.submit(error_mm, program, work.cell_file, work.known, seed)
                tasks[task] = (choice, compensated, seed)
        for task in as_completed(tasks):
            choice, compensated, seed = tasks[task]
            error = task.result()
            yield {
                "workpiece": name,
                "choice": choice,
                "compensated": compensated,
                "seed": seed,
                "p997_mm": round(error, 4) if math.isfinite(error) else None,
            }


def table(found: list[dict[str, Any]]) -> str:
    """Markdown: median and worst of each way."""
    lines = [
        "| workpiece | | uncompensated: median | worst | less, median | least | compensated: median | worst |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name in dict.fromkeys(row["workpiece"] for row in found):
        of = {
            (choice, compensated): {
                row["seed"]: math.inf if row["p997_mm"] is None else row["p997_mm"]
                for row in found
                if (row["workpiece"], row["choice"], row["compensated"]) == (name, choice, compensated)
            }
            for choice in CHOICES
            for compensated in (False, True)
        }
        before = of[CHOICES[0], False]
        for choice in CHOICES:
            bare, done = of[choice, False], of[choice, True]
            if not bare or not done:
                continue
            less = [100.0 * (1.0 - bare[seed] / before[seed]) for seed in bare if seed in before]
            values = np.array(list(bare.values())), np.array(list(done.values()))
            gain = "| |" if choice == CHOICES[0] else f"| {np.median(less):.0f} % | {min(less):.0f} % "
            lines.append(
                f"| {name} | {choice} | {np.median(values[0]):.3f} mm | {values[0].max():.3f} mm {gain}"
                f"| {np.median(values[1]):.3f} mm | {values[1].max():.3f} mm |"
            )
    return "\n".join(lines)


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    names = tuple(wall_finish.MATERIALS)
    parser.add_argument("--seeds", type=seeds_of, default=f"{REPORTING_SEEDS[0]}-{REPORTING_SEEDS[0] + 4}")
    parser.add_argument("--workpieces", nargs="+", choices=names, default=list(names))
    parser.add_argument("--candidates", type=int, default=placement.CANDIDATES)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--write", type=Path, metavar="FILE", help="JSON file of rows; those that it has are kept")
    parser.add_argument("--quick", action="store_true", help="one material, one seed, few candidates")
    args = parser.parse_args()
    seeds = [200] if args.quick else args.seeds
    found: list[dict[str, Any]] = []
    if args.write is not None and args.write.exists():
        found = json.loads(args.write.read_text(encoding="utf-8"))
    with tempfile.TemporaryDirectory() as scratch:
        for number, name in enumerate(names[:1] if args.quick else args.workpieces):
            count = 64 if args.quick else args.candidates
            for row in rows(name, Path(scratch) / str(number), seeds, count, found, args.workers):
                found.append(row)
                if args.write is not None:
                    atomic.write_text(args.write, json.dumps(found, indent=1) + "\n")
    print(table(found))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
