"""Features of a scan against those that ``evaluate`` has of the same simulated part; memory of fifty million points.

The part is machined on the simulated cell, its surface meshed from the path that the tool really ran, and the mesh
sampled: noise 20 um, holes, one outlier in a hundred points, 15 deg and 30 mm off, in inches without saying so.
``inspect`` lays the scan on the sides and the bottom of the blank, on which the simulated part stands where the program
has it. Its top face does not: the simulated operator touched it off by some hundredths of a millimetre, which is part
of the truth.

    python benchmarks/scan.py
    python benchmarks/scan.py --seeds 1001-1005 --points 1700000
    python benchmarks/scan.py --memory 50000000
    python benchmarks/scan.py --quick
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import trimesh

from counterflex.app.inputs import read_job
from counterflex.app.inspection.judging import How, inspect
from counterflex.app.inspection.summary import InspectedScan
from counterflex.app.proof import judge, simulate
from counterflex.app.proof.cut_logs import log_of_run, top_of
from counterflex.app.proof.truth import truth_of
from counterflex.core.arrays import Float
from counterflex.core.units import MM, UM
from counterflex.cutting.tridexel.columns import ColumnStock
from counterflex.cutting.tridexel.surface import surface
from counterflex.evaluate.features import FeatureRow
from counterflex.files.cell.cell import read_cell
from counterflex.geometry import rotation
from counterflex.twin.truth.family import family_of
from seeds_option import seeds_of

ROOT = Path(__file__).resolve().parents[1]
GOAL_UM = 10.0
GOAL_GB = 4.0
NOISE_MM, HOLES, HOLE_MM, OUTLIERS = 0.02, 12, 2.5, 0.01
FACES = "x-,x+,y-,y+,bottom"
R_SCAN_PART = rotation.exp(np.radians(15.0) * np.array([1.0, 2.0, 2.0]) / 3.0)
P_SCAN_PART_MM = np.array([20.0, -20.0, 10.0])
INCH_MM = 25.4


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", type=Path, default=ROOT / "examples/programs/groove.ngc")
    parser.add_argument("--cell", type=Path, default=ROOT / "examples/cells/kr300_d16_small.toml")
    parser.add_argument("--seeds", type=seeds_of, default="1001-1003")
    parser.add_argument("--points", type=int, default=1_700_000)
    parser.add_argument("--memory", type=int, default=0, help="inspect so many points in a process of its own")
    parser.add_argument("--write", type=Path, help="write the scan of the first seed here, and do no more")
    parser.add_argument("--quick", action="store_true")
    given = parser.parse_args()
    seeds = given.seeds
    if given.quick:
        seeds, given.points = [1001], 150_000
    if given.memory:
        memory(given.memory, given.program, given.cell)
        return
    print("seed   feature      quantity      nominal mm  evaluate mm   worst off um   mean off um   U um")
    worst = {"worst": 0.0, "mean": 0.0}
    for seed in seeds:
        mesh, rows = machined(given.program, given.cell, seed)
        if given.write is not None:
            points = scan_of(mesh, given.points)
            write_ply(given.write, [points], len(points))
            return
        with tempfile.TemporaryDirectory() as folder:
            scan = Path(folder) / "scan.ply"
            points = scan_of(mesh, given.points)
            write_ply(scan, [points], len(points))
            begin = time.perf_counter()
            measured = inspect(given.program, given.cell, scan, how=How(datum=FACES))
            seconds = time.perf_counter() - begin
        by_name = {(row.feature, row.quantity): row for row in measured.features}
        for row in rows:
            compare(seed, row, by_name.get((row.feature, row.quantity)), worst)
        part = measured.parts["part"]
        assert isinstance(part, InspectedScan)
        density, unit = given.points / mesh.area, part.unit
        print(f"{seed}   {given.points} points, {density:.0f} per mm2, unit {unit}, {seconds:.1f} s")
    for name, value in worst.items():
        met = "met" if value <= GOAL_UM else "MISSED"
        print(f"largest difference of the {name} values: {value:.1f} um (goal {GOAL_UM:g} um, {met})")


def compare(seed: int, row: FeatureRow, other: FeatureRow | None, worst: dict[str, float]) -> None:
    """Print a quantity beside its other measurement."""
    if other is None or "part" not in other.worst_m:
        print(f"{seed}   {row.feature:12} {row.quantity:12}  not measured")
        worst["worst"] = worst["mean"] = np.inf
        return
    off = {
        "worst": (other.worst_m["part"] - row.worst_m["nominal"]) / UM,
        "mean": (other.mean_m["part"] - row.mean_m["nominal"]) / UM,
    }
    print(
        f"{seed}   {row.feature:12} {row.quantity:12} {row.nominal_m / MM:10.3f} {row.worst_m['nominal'] / MM:12.4f} "
        f"{off['worst']:+14.1f} {off['mean']:+13.1f} {2.0 * other.standard_deviation_m['part'] / UM:6.1f}"
    )
    for name, value in off.items():
        worst[name] = max(worst[name], abs(value))


def machined(program: Path, cell_file: Path, seed: int) -> tuple[trimesh.Trimesh, tuple[FeatureRow, ...]]:
    """The machined part as a mesh, mm, and its features as ``evaluate`` has them."""
    cell = read_cell(cell_file)
    job = read_job(program, cell)
    record = simulate.machine(job, cell, truth_of(cell, seed, family_of("mild")))
    reference = judge.reference_of(job, cell)
    judged = judge.judge(reference, record, record.stock)
    top = top_of(cell, job.path.p_part_tcp, record.p_part_tcp)
    made = surface(ColumnStock.of(record.stock), log_of_run(record, job.path, cell, top))
    mesh = trimesh.Trimesh(made.vertices / MM, made.triangles, process=False)
    return mesh, judge.features(reference, {"nominal": judged})


def scan_of(mesh: trimesh.Trimesh, count: int, seed: int = 5) -> Float:
    """Points of a scan of the mesh, inches, in the frame of the scanner."""
    rng = np.random.default_rng(seed)
    points, _ = trimesh.sample.sample_surface(mesh, count, seed=seed)
    kept = np.ones(len(points), np.bool_)
    for _ in range(HOLES):
        kept &= np.linalg.norm(points - points[rng.integers(len(points))], axis=1) > HOLE_MM
    points = points[kept] + rng.normal(scale=NOISE_MM, size=(int(kept.sum()), 3))
    low, high = mesh.bounds
    outliers = rng.uniform(low - 20.0, high + 20.0, (int(OUTLIERS * len(points)), 3))
    every = rng.permutation(np.concatenate([points, outliers]))
    out: Float = (every @ R_SCAN_PART.T + P_SCAN_PART_MM) / INCH_MM
    return out


def write_ply(path: Path, blocks: Iterable[Float], count: int) -> None:
    """Points as a binary PLY file."""
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {count}\n"
    with path.open("wb") as stream:
        stream.write((head + "".join(f"property float {axis}\n" for axis in "xyz") + "end_header\n").encode())
        for points in blocks:
            stream.write(points.astype("<f4").tobytes())


def memory(count: int, program: Path, cell_file: Path) -> None:
    """Inspect a scan of so many points by the command itself, and print its time and largest memory.

    Every million of them is the same places with noise of its own.
    """
    mesh, _ = machined(program, cell_file, 1001)
    million = scan_of(mesh, 1_000_000)
    times = -(-count // len(million))
    rng = np.random.default_rng(9)
    blocks = (million + rng.normal(scale=NOISE_MM / INCH_MM, size=million.shape) for _ in range(times))
    with tempfile.TemporaryDirectory() as folder:
        scan = Path(folder) / "scan.ply"
        write_ply(scan, blocks, times * len(million))
        command = [sys.executable, "-m", "counterflex", "inspect", str(program), "--cell", str(cell_file)]
        command += ["--scan", str(scan), "--datum", FACES, "--out", str(Path(folder) / "out")]
        begin = time.perf_counter()
        subprocess.run(command, check=True)
        seconds = time.perf_counter() - begin
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024 / 1e9
    met = "met" if peak <= GOAL_GB else "MISSED"
    print(f"{times * len(million)} points: {seconds:.0f} s, {peak:.2f} GB at most (goal {GOAL_GB:g} GB, {met})")


if __name__ == "__main__":
    main()
