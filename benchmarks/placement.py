"""Speed of the search for the place of the part, and what it gains on simulated cells.

The groove on the shipped cell: candidates are judged as ``counterflex plan placement`` does it, by survey, dynamic
programming and distances of bodies. Printed are wall and processor time, and the time per evaluated pose of the robot
beside that of the bare deflection kernel.

With ``--operations`` three grooves on a plate of 1.6 m are cut on a rail: error in the best place for all, and with a
place for each, by the criterion of the search.

With ``--gain PROGRAM`` (groove or part) the program is machined uncompensated on simulated cells of the family
``wide``, in the place and posture of the cell file and in the chosen ones; the choice knows the catalogue only.

Run ``OPENBLAS_NUM_THREADS=1 python benchmarks/placement.py``; ``--quick`` is a smoke run.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path
from typing import Final

import numba
import numpy as np

from counterflex.app import examples
from counterflex.app.inputs import AS_IT_IS, read_job
from counterflex.app.placement import operations_job, placement
from counterflex.app.placement.region import ProgramInCell, Wish
from counterflex.app.proof import simulate
from counterflex.app.proof.judge import judge, reference_of
from counterflex.app.proof.truth import truth_of
from counterflex.core.units import MM
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.plan.placement.candidate import site_of
from counterflex.plan.placement.search import POPULATION, search
from counterflex.plan.posture.deflection_kernel import deflection_sizes
from counterflex.plan.posture.survey import base_points
from counterflex.twin.truth.family import FAMILIES, REPORTING_SEEDS
from seeds_option import seeds_of

GOAL_S: Final = 180.0
COUNT: Final = 1024
RAIL: Final = (
    '\n[[external_axes]]\nname = "E1"\nkind = "linear"\ncarries = "robot"\ndirection = [0, 1, 0]\nat_mm = 0\n'
    "min_mm = -3000\nmax_mm = 4000\ncoupled = true\n"
)
SHIPPED: Final = Path(__file__).resolve().parents[1] / "examples"
GROOVE: Final = SHIPPED / "programs" / "groove.ngc"
CELL: Final = SHIPPED / "cells" / "kr300_d16_small.toml"


def speed(count: int) -> bool:
    """Print the time of a search; True where the goal is met."""
    _, cell, task = placement.task_of(GROOVE, read_cell(CELL), AS_IT_IS, "both")
    frame = ProgramInCell(cell, task.middle_of_cut)
    site, region = site_of(task, placement.stretches_of_task(task, cell)), Wish().region(frame)
    search(site, region, frame.seen, 1)
    wall, processor = time.perf_counter(), time.process_time()
    outcome = search(site, region, frame.seen, count)
    wall, processor = time.perf_counter() - wall, time.process_time() - processor
    judged = len(outcome.candidates)
    print(
        f"{judged} places x {len(site.cut)} points x {site.freedom.rotations} rotations x 8 = {judged * site.poses} "
        f"poses, {numba.get_num_threads()} threads: {wall:.1f} s, {processor:.1f} s of processor time"
    )
    print(f"  {1e3 * processor / judged:.1f} ms per place, {1e6 * processor / judged / site.poses:.3f} us per pose")
    q = outcome.candidates[outcome.ranked()[0]].q
    assert q is not None
    points = base_points(site.cut, site.robot.T_base_part, np.array([0, len(q) - 1]))
    many = [np.ascontiguousarray(np.concatenate([v] * 1000)) for v in (q, points.w, points.normals)]
    sizes, begin = np.empty(len(many[0])), time.process_time()
    deflection_sizes(site.robot.chain.compact, many[0], many[1], many[2], sizes, 0, len(sizes))
    print(f"  bare deflection kernel: {1e6 * (time.process_time() - begin) / len(sizes):.3f} us per pose")
    print(f"goal {GOAL_S:g} s: {'met' if wall <= GOAL_S else 'missed'}", flush=True)
    return wall <= GOAL_S


def path_error_m(program: Path, cell: Cell, known: Cell, seed: int) -> float:
    """99.7 % of the path error of an uncompensated program on the truth of a cell."""
    job = read_job(program, cell)
    record = simulate.machine(job, cell, truth_of(known, seed, FAMILIES["wide"]))
    return judge(reference_of(job, cell), record, record.stock).variant.path.path.p997_m


def gain(program: Path, cell_file: Path, seeds: list[int], folder: Path, count: int) -> None:
    """Print the path error in the present and in the chosen place."""
    summary = placement.run(program, cell_file, folder / "out", count=count)
    cell, chosen = read_cell(cell_file), read_cell(folder / "out" / "cell.toml")
    best = summary["chosen"]
    print(
        f"{program.name}: predicted {summary['present']['deflection_um']:.0f} -> {best['deflection_um']:.0f} um "
        f"(error {summary['present']['error_um']:.0f} -> {best['error_um']:.0f} um, damping in the cut "
        f"{summary['present']['damping_in_cut']:.3f} -> {best['damping_in_cut']:.3f}), "
        f"{best['x_mm']:g} {best['y_mm']:g} {best['z_mm']:g} mm, {best['a_deg']:g} deg, {best['branch']} at "
        f"{best['rotation_about_tool_deg']:g} deg",
        flush=True,
    )
    less = []
    for seed in seeds:
        before, after = (path_error_m(program, c, cell, seed) for c in (cell, chosen))
        less.append(100.0 * (1.0 - after / before))
        print(f"  seed {seed}: {before / MM:.3f} -> {after / MM:.3f} mm, {less[-1]:.0f} % less", flush=True)
    print(f"  median {np.median(less):.0f} %, worst {min(less):.0f} % less")


def operations(count: int) -> int:
    """Print the error of a program on a rail in one place and in one for each operation; 0 where that is less."""
    cut = "G0 X-12 Y{}\nG0 Z42\nG1 Z37 F3000\nG1 X72 F1500\nG0 Z80\n"
    text = (
        CELL.read_text(encoding="utf-8")
        .replace("../", f"{SHIPPED.as_posix()}/")
        .replace("cell_mm = 0.2", "cell_mm = 1")
    )
    with tempfile.TemporaryDirectory() as folder:
        cell, program = Path(folder) / "cell.toml", Path(folder) / "three.ngc"
        cell.write_text(text.replace("max_mm = [60, 60, 40]", "max_mm = [60, 1600, 40]") + RAIL, encoding="utf-8")
        lines = "".join(cut.format(y) for y in (40, 800, 1560))
        program.write_text(f"G17 G21 G90 G94\nM6 T1\nM3 S13000\nG0 Z80\n{lines}M5\nM30\n", encoding="ascii")
        summary = operations_job.run(program, cell, Path(folder) / "out", count=count)
    whole = summary["per_operation"]
    for row in summary["operations"]:
        print(f"E1 {row['E1']:g} mm: {row['error_um']:g} um, in one place {row['in_one_place_um']:g} um")
    print(f"{whole['in_one_place_um']:g} -> {whole['error_um']:g} um, {whole['reduction_percent']:g} % less")
    return int(whole["error_um"] >= whole["in_one_place_um"])


def main() -> int:
    """Run; 1 where the goal is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="few candidates, no goal")
    parser.add_argument("--operations", action="store_true", help="a place for each operation instead")
    parser.add_argument("--gain", choices=["groove", "part"], help="machine on simulated cells instead")
    parser.add_argument("--candidates", type=int, default=COUNT)
    parser.add_argument("--seeds", type=seeds_of, default=f"{REPORTING_SEEDS[0]}-{REPORTING_SEEDS[0] + 4}")
    args = parser.parse_args()
    if args.operations:
        return operations(args.candidates if args.candidates != COUNT else POPULATION)
    if args.gain is None:
        return 0 if speed(POPULATION if args.quick else args.candidates) or args.quick else 1
    with tempfile.TemporaryDirectory() as name:
        program, cell = GROOVE, CELL
        if args.gain == "part":
            cell, program = examples.write(Path(name) / "cell.toml")
        gain(program, cell, args.seeds, Path(name), args.candidates)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
