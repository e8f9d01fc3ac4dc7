"""Speed of the choice of a posture, its distance to a bound, and what it gains on simulated cells.

A path of 10 000 points over a part of 200 x 150 mm with forces of 300 N in turning directions, 72 rotations about the
tool, all eight branches: every pose is solved and its deflection computed, then dynamic programming finds the way
through them, once with the tool held still and once with the tool free to turn. Printed are wall and processor time,
the time per pose that the robot can take and per pose tried beside that of the bare deflection kernels on the same
poses, and the cost over the bound (every point in its best posture, free of all constraints).

With ``--gain`` the demonstration part and the groove are machined uncompensated on simulated cells of the family
``wide``, in the posture of the cell file and in the chosen one; the choice knows the catalogue only.

Run ``OPENBLAS_NUM_THREADS=1 python benchmarks/posture.py``; ``--quick`` is a smoke run.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

import numba
import numpy as np

from counterflex.app import examples, posture
from counterflex.app.inputs import read_job, setting_of
from counterflex.app.proof import simulate
from counterflex.app.proof.judge import judge, reference_of
from counterflex.app.proof.truth import truth_of
from counterflex.core.arrays import Float
from counterflex.core.units import DEG, MM
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.plan.posture.choose import MOST_EDGES, Freedom
from counterflex.plan.posture.cut_path import LoadedPath, in_contact, stations
from counterflex.plan.posture.deflection_kernel import deflection_sizes
from counterflex.plan.posture.survey import RobotHere, survey_path
from counterflex.plan.posture.survey_kernel import OK, POWER
from counterflex.plan.posture.way import allowed_steps, best_way
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.robot.elasticity.kernels.batch import ON_RIGID, deflection_range
from counterflex.robot.elasticity.kernels.lanes import deflection_blocks
from counterflex.twin.truth.family import FAMILIES, REPORTING_SEEDS
from seeds_option import seeds_of

GOAL_S: Final = 5.0
FEED_M_S: Final = 0.025
SHIPPED: Final = Path(__file__).resolve().parents[1] / "examples"


def path(points: int) -> LoadedPath:
    """Lissajous figure over the part at a constant feed, the force turning against it."""
    u = np.linspace(0.0, 2.0 * np.pi, points)
    p = np.stack([0.1 + 0.09 * np.cos(3.0 * u), 0.075 + 0.065 * np.sin(4.0 * u), np.full(points, 0.03)], axis=1)
    step = np.diff(p, axis=0, prepend=p[:1])
    length = np.linalg.norm(step, axis=1)
    t = step / np.where(length > 0.0, length, 1.0)[:, None]
    axis = np.tile([0.0, 0.0, 1.0], (points, 1))
    w = np.zeros((points, 6))
    w[:, 0], w[:, 1], w[:, 2] = 300.0 * np.cos(7.0 * u), 300.0 * np.sin(7.0 * u), 60.0
    normals = np.stack([np.cross(axis, t), axis], axis=1)
    return LoadedPath(p, axis, w, normals, length, np.cumsum(length) / FEED_M_S, np.zeros(points, dtype=np.int64))


def bare(chain: ElasticChain, q: Float, count: int) -> dict[str, float]:
    """Processor time per pose of the deflection kernels alone, us."""
    rows = np.ascontiguousarray(q[np.random.default_rng(0).integers(0, len(q), count)])
    w = np.tile([200.0, 200.0, 60.0, 0.0, 0.0, 0.0], (count, 1))
    normals, sizes, out = np.tile(np.eye(3)[:2], (count, 1, 1)), np.empty(count), np.empty((count, 6))
    works: dict[str, Callable[[int], object]] = {
        "deflection in two directions": lambda n: deflection_sizes(chain.compact, rows, w, normals, sizes, 0, n),
        "deflection, six components": lambda n: deflection_range(chain.compact, rows, w, ON_RIGID, 0, out, 0, n),
        "deflection, six components, 16 at a time": lambda n: deflection_blocks(chain.compact, rows, w, out, 0, n),
    }
    times = {}
    for name, work in works.items():
        work(16)
        begin = time.process_time()
        work(count)
        times[name] = 1e6 * (time.process_time() - begin) / count
    return times


def warm_up(robot: RobotHere, free: Freedom) -> None:
    """Compile what is timed."""
    few = path(50)
    rows = stations(few, 1.0, MOST_EDGES)
    still = np.zeros(len(rows) - 1, dtype=np.int64)
    best_way(few, robot, survey_path(few, robot, free.grid_rad, rows), rows, still, free.weights)


def speed(points: int, rounds: int) -> bool:
    """Print time and distance to the bound; True where the goal is met."""
    with tempfile.TemporaryDirectory() as folder:
        cell = read_cell(examples.write(Path(folder) / "cell.toml")[0])
    cut, robot = path(points), posture.robot_of(cell, setting_of(cell))
    free = Freedom(rate_rad_s=20.0 * DEG, air_rate_rad_s=60.0 * DEG)
    rows = stations(cut, free.step_rad / free.rate_rad_s, MOST_EDGES)
    best = np.inf
    warm_up(robot, free)
    for _ in range(rounds):
        wall, processor = time.perf_counter(), time.process_time()
        survey = survey_path(cut, robot, free.grid_rad, rows)
        surveyed, used = time.perf_counter() - wall, time.process_time() - processor
        costs = {}
        for name, freedom in (("held", Freedom()), ("turning", free)):
            begin = time.perf_counter()
            duration = np.diff(cut.time_s[rows])
            steps = allowed_steps(
                in_contact(cut, rows), duration, free.step_rad, freedom.rate_rad_s, freedom.air_rate_rad_s
            )
            way, _ = best_way(cut, robot, survey, rows, steps, freedom.weights)
            if way is not None:
                costs[name] = (way.cost, time.perf_counter() - begin)
        total, processor = time.perf_counter() - wall, time.process_time() - processor
        best = min(best, total)
        tried, possible = int(survey.failed.sum()), int(survey.failed[:, OK].sum())
        print(
            f"{points} points x 72 x 8 = {tried} poses, {possible} possible, {len(rows) - 1} edges, "
            f"{numba.get_num_threads()} threads: {total:.2f} s, {processor:.2f} s of processor time; "
            f"survey {surveyed:.2f} s"
        )
        print(f"  per pose tried {1e6 * used / tried:.3f} us, per possible pose {1e6 * used / possible:.3f} us")
        for name, (cost, seconds) in costs.items():
            above = 100.0 * (cost ** (1.0 / POWER) - 1.0)
            print(f"  {name}: deflection {above:.1f} % above the bound, {seconds:.2f} s")
    q = survey.q[~np.isnan(survey.q[..., 0])]
    for name, micro in bare(robot.chain, q, min(100_000, 10 * points)).items():
        print(f"  bare kernel, {name}: {micro:.3f} us")
    print(f"goal {GOAL_S:g} s: {'met' if best <= GOAL_S else 'missed'}")
    return best <= GOAL_S


def path_error_m(program: Path, cell: Cell, known: Cell, seed: int) -> float:
    """99.7 % of the path error of an uncompensated program on the truth of a cell."""
    job = read_job(program, cell)
    record = simulate.machine(job, cell, truth_of(known, seed, FAMILIES["wide"]))
    return judge(reference_of(job, cell), record, record.stock).variant.path.path.p997_m


def gain(program: Path, cell_file: Path, seeds: list[int], folder: Path) -> None:
    """Print the path error in the present and in the chosen posture."""
    summary = posture.run(program, cell_file, folder / "out")
    cell, chosen = read_cell(cell_file), read_cell(folder / "out" / "cell.toml")
    print(
        f"{program.name}: predicted {summary['present']['deflection_um']:.0f} -> "
        f"{summary['chosen']['deflection_um']:.0f} um, {summary['chosen']['branch']} at "
        f"{summary['chosen']['rotation_about_tool_deg']:g} deg"
    )
    reductions = []
    for seed in seeds:
        before, after = (path_error_m(program, c, cell, seed) for c in (cell, chosen))
        reductions.append(100.0 * (1.0 - after / before))
        print(f"  seed {seed}: {before / MM:.3f} -> {after / MM:.3f} mm, {reductions[-1]:.0f} % less", flush=True)
    print(f"  median {np.median(reductions):.0f} %, worst {min(reductions):.0f} % less")


def main() -> int:
    """Run; 1 where the goal is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="few points, no goal")
    parser.add_argument("--gain", action="store_true", help="also machine on simulated cells")
    parser.add_argument("--seeds", type=seeds_of, default=f"{REPORTING_SEEDS[0]}-{REPORTING_SEEDS[0] + 4}")
    args = parser.parse_args()
    met = speed(300 if args.quick else 10_000, 1 if args.quick else 3)
    if args.gain:
        with tempfile.TemporaryDirectory() as name:
            cell, part = examples.write(Path(name) / "cell.toml")
            gain(
                SHIPPED / "programs" / "groove.ngc", SHIPPED / "cells" / "kr300_d16_small.toml", args.seeds, Path(name)
            )
            gain(part, cell, args.seeds, Path(name))
    return 0 if met or args.quick else 1


if __name__ == "__main__":
    raise SystemExit(main())
