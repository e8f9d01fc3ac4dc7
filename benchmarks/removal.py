"""Speed of material removal: cells and segments per CPU-second, and how far that is from what the machine allows.

Four cases on 200 x 200 mm at 0.1 mm (milling a ball surface, a flat zigzag, trochoids, a small zigzag), each with and
without engagement, on 1 and 2 threads; with ``--adaptive`` also a CAM system's adaptive clearing, repeated one layer
below the other until it has as many segments as the others. The bound is one scattered addition (1 ns) for every cell
lowered, plus every cell visited at the rate at which this machine takes minima within its cache, measured in the same
run. FreeCAD's path simulator runs the same segments when its ``freecadcmd`` is installed (it books no engagement).

Run ``python benchmarks/removal.py``; ``--quick`` is a smoke run, ``--json FILE`` writes the figures.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from counterflex.core.arrays import Float, Float32, Int
from counterflex.core.atomic import write_text
from counterflex.core.jit import kernel
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.removal import remove_path
from counterflex.cutting.stock import HeightMap
from counterflex.path import FEED, RAPID

SIDE_M = 0.2
GOAL_OF_BOUND = 0.20
GOALS = {"ball": 4.0, "flat": 10.0}
"""Times as fast as FreeCAD's simulator."""


@dataclass(frozen=True)
class Case:
    """A path, its cutter and its block."""

    name: str
    points: Float
    kind: Int
    cutter: Cutter
    low: tuple[float, float, float]
    high: tuple[float, float, float]


def zigzag(step: float, width: float, depth: float, levels: int, n: int) -> Float:
    """Level lines over the block, one level under the other."""
    rows = []
    for level in range(levels):
        for k, y in enumerate(np.arange(0.0, SIDE_M + 1e-9, width)):
            x = np.arange(0.0, SIDE_M + 1e-9, step)[:: 1 if k % 2 == 0 else -1]
            rows.append(np.stack([x, np.full_like(x, y), np.full_like(x, -depth * (level + 1))], axis=1))
    return np.concatenate(rows)[: n + 1]


def surface(n: int) -> Float:
    """Lines over a wavy surface at 0.6 mm step-over, as a CAM system makes them for finishing with a ball."""
    rows = []
    x = np.arange(0.005, SIDE_M - 0.005, 0.67e-3)
    for k, y in enumerate(np.arange(0.005, SIDE_M - 0.005, 0.6e-3)):
        z = -0.008 + 0.004 * np.sin(x / 0.021) * np.cos(y / 0.027) + 0.002 * np.sin((x + y) / 0.05)
        rows.append(np.stack([x, np.full_like(x, y), z], axis=1)[:: 1 if k % 2 == 0 else -1])
    return np.concatenate(rows)[: n + 1]


def trochoids(n: int) -> Float:
    """Loops of 8 mm radius that walk 1 mm per turn, in lanes, 12 mm deep: the kind of path adaptive clearing makes."""
    per_turn = 100
    turn = np.arange(n + 1) * 2.0 * np.pi / per_turn
    along = turn / (2.0 * np.pi) * 1e-3
    lane, x = np.divmod(along, SIDE_M - 0.04)
    return np.stack(
        [0.02 + x + 0.008 * np.cos(turn), 0.02 + 0.028 * lane + 0.008 * np.sin(turn), np.full(n + 1, -0.012)], axis=1
    )


def program(path: Path) -> tuple[Float, Int]:
    """End points of the G0 and G1 lines of a plain G-code program in mm."""
    place = {"X": 0.0, "Y": 0.0, "Z": 0.0}
    points, kind, mode = [], [], RAPID
    for line in path.read_text(encoding="ascii").splitlines():
        text = re.sub(r"\(.*?\)", "", line)
        if found := re.match(r"\s*G0?([01])\b", text):
            mode = FEED if found[1] == "1" else RAPID
        words = {a: float(b) for a, b in re.findall(r"([XYZ])(-?[\d.]+)", text)}
        if words:
            place.update(words)
            points.append(tuple(place.values()))
            kind.append(mode)
    return np.array(points) * 1e-3, np.array(kind[1:], dtype=np.int64)


def layers(path: Path, n: int) -> Case:
    """A program for a flat D16 mill, repeated below itself until it has n segments."""
    points, kind = program(path)
    feed = points[1:][kind == FEED]
    low, high = feed.min(axis=0) - 0.01, feed.max(axis=0) + 0.01
    bottom, top = feed[:, 2].min(), feed[:, 2].max()
    repeats = -(-n // len(points))
    down = np.array([0.0, 0.0, top - bottom])
    path_points = np.concatenate([points - k * down for k in range(repeats)])[: n + 1]
    kinds = np.tile(np.append(kind, RAPID), repeats)[: len(path_points) - 1]
    corners = ((low[0], low[1], bottom - repeats * down[2]), (high[0], high[1], top))
    return Case("flat D16 adaptive", path_points, kinds, Cutter(0.016), *corners)


def cases(n: int, source: Path | None, adaptive: Path | None = None) -> list[Case]:
    """The four cases with n segments each, and a fifth when there is a program for it."""
    if source is None:
        ball = surface(n)
        kind = np.full(len(ball) - 1, FEED, dtype=np.int64)
        corners = ((0.0, 0.0, -0.03), (SIDE_M, SIDE_M, 0.0))
    else:
        ball, kind = program(source)
        ball, kind = ball[: n + 1], kind[:n]
        feed = ball[1:][kind == FEED]
        low, high = feed.min(axis=0) - 0.01, feed.max(axis=0) + np.array([0.01, 0.01, 0.002])
        corners = (tuple(low), tuple(high))
    block = ((0.0, 0.0, -0.03), (SIDE_M, SIDE_M, 0.0))
    paths = [
        ("flat D16 zigzag", zigzag(5e-4, 4e-3, 1e-3, 5, n), Cutter(0.016)),
        ("flat D16 trochoids", trochoids(n), Cutter(0.016)),
        ("flat D6 zigzag", zigzag(5e-4, 2e-3, 2e-3, 3, n), Cutter(0.006)),
    ]
    out = [Case("ball D10 surface", ball, kind, Cutter(0.010, 0.005), *corners)]
    out += [
        Case(name, points, np.full(len(points) - 1, FEED, dtype=np.int64), cutter, *block)
        for name, points, cutter in paths
    ]
    return out if adaptive is None else [*out, layers(adaptive, n)]


@kernel()
def _minima(row: Float32, other: Float32, repeats: int) -> None:
    for _ in range(repeats):
        for k in range(row.size):
            row[k] = min(row[k], other[k])


def minimum_rate() -> float:
    """Cells per CPU-second at which this machine takes minima of two rows within its first-level cache."""
    row, other = np.ones(2048, np.float32), np.full(2048, 2.0, np.float32)
    _minima(row, other, 1)
    best = np.inf
    for _ in range(5):
        start = time.process_time()
        _minima(row, other, 20_000)
        best = min(best, time.process_time() - start)
    return 2048 * 20_000 / best


def lowered(case: Case, cell: float) -> int:
    """Number of times that a cell was lowered, the work that cannot be avoided; from 400 segments drawn at random."""
    stock = HeightMap.from_box(case.low, case.high, cell)
    n = len(case.kind)
    length = np.linalg.norm(np.diff(case.points, axis=0), axis=1)
    usual = np.flatnonzero(length <= 3.0 * np.median(length))  # not the few long links, which would dominate a sample
    draw = np.unique(np.random.default_rng(1).choice(usual[usual > 0], 400))
    counts, done = [], 0
    for i in draw:
        if i > done:
            remove_path(stock, case.points[done : i + 1], case.kind[done:i], case.cutter, engagement=False)
        before = stock.z.copy()
        remove_path(stock, case.points[i : i + 2], case.kind[i : i + 1], case.cutter, engagement=False)
        counts.append(np.count_nonzero(stock.z != before))
        done = int(i) + 1
    return round(float(np.mean(counts)) * n)


def measure(case: Case, cell: float, engagement: bool, threads: int, repeats: int) -> dict[str, float]:
    """Median CPU and wall time of cutting the case."""
    cpu, wall, visited = [], [], 0
    for _ in range(repeats):
        stock = HeightMap.from_box(case.low, case.high, cell)
        start, begin = time.process_time(), time.perf_counter()
        result = remove_path(stock, case.points, case.kind, case.cutter, engagement=engagement, threads=threads)
        cpu.append(time.process_time() - start)
        wall.append(time.perf_counter() - begin)
        visited = result.cells_visited
    return {"cpu_s": float(np.median(cpu)), "wall_s": float(np.median(wall)), "visited": float(visited)}


FREECAD = """
import sys, time
import FreeCAD, Part, Path, PathSimulator
data = open(sys.argv[-1]).read().split("\\n")
diameter, corner, cell = (float(v) for v in data[0].split())
low, high = data[1].split(), data[2].split()
box = Part.makeBox(*(float(b) - float(a) for a, b in zip(low, high)), FreeCAD.Vector(*(float(a) for a in low)))
if corner > 0:
    shape = Part.makeSphere(diameter / 2, FreeCAD.Vector(0, 0, diameter / 2))
else:
    shape = Part.makeCylinder(diameter / 2, 30)
simulator = PathSimulator.PathSim()
simulator.BeginSimulation(box, cell)
simulator.SetToolShape(shape, cell)
points = [tuple(float(v) for v in line.split()) for line in data[3:] if line]
commands = [Path.Command("G1", {"X": x, "Y": y, "Z": z}) for x, y, z in points]
position = FreeCAD.Placement(FreeCAD.Vector(*points[0]), FreeCAD.Rotation())
start = time.process_time()
for command in commands[1:]:
    position = simulator.ApplyCommand(position, command)
print("CPU", time.process_time() - start)
"""


def freecad(case: Case, cell: float) -> float | None:
    """CPU seconds of FreeCAD's path simulator on the same segments; None when it is not installed or fails."""
    command = shutil.which("freecadcmd") or shutil.which("FreeCADCmd")
    if command is None:
        return None
    with tempfile.TemporaryDirectory() as folder:
        script, data = Path(folder) / "simulate.py", Path(folder) / "path.txt"
        script.write_text(FREECAD.replace("sys.argv[-1]", repr(str(data))), encoding="utf-8")
        rows = [[case.cutter.diameter_m * 1e3, case.cutter.corner_radius_m * 1e3, cell * 1e3]]
        rows += [[v * 1e3 for v in case.low], [v * 1e3 for v in case.high], *(case.points * 1e3).tolist()]
        data.write_text("\n".join(" ".join(f"{v:.6f}" for v in row) for row in rows), encoding="utf-8")
        done = subprocess.run([command, str(script)], capture_output=True, text=True, timeout=900, check=False)
    found = re.search(r"CPU ([\d.e-]+)", done.stdout)
    return float(found[1]) if found else None


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--quick", action="store_true", help="smoke run: few segments, coarse cells")
    parser.add_argument("--program", type=Path, help="G-code of the ball surface instead of the generated one")
    parser.add_argument("--adaptive", type=Path, help="G-code of adaptive clearing with a flat D16 mill, a fifth case")
    parser.add_argument("--json", type=Path, help="write the figures to this file")
    options = parser.parse_args()
    n, cell, repeats = (1000, 5e-4, 1) if options.quick else (100_000, 1e-4, 3)
    rate = minimum_rate()
    print(f"minimum update in cache: {rate / 1e9:.1f} Gcell per CPU-s")
    print(f"{'case':20s} {'engagement':>10s} {'threads':>7s} {'kseg/CPU-s':>10s} {'Mcell/CPU-s':>11s} {'of bound':>8s}"
          f" {'wall s':>7s} {'x FreeCAD':>9s}")  # fmt: skip
    rows: list[dict[str, Any]] = []
    for case in cases(n, options.program, options.adaptive):
        warm = Case(case.name, case.points[:20], case.kind[:19], case.cutter, case.low, case.high)
        for engagement in (False, True):
            measure(warm, max(cell, 5e-4), engagement, 1, 1)
        events = lowered(case, cell)
        other = None if options.quick else freecad(case, cell)
        for engagement in (False, True):
            for threads in (1, 2):
                found = measure(case, cell, engagement, threads, repeats)
                bound = (events * 1e-9 if engagement else 0.0) + found["visited"] / rate
                row = {
                    "case": case.name, "engagement": engagement, "threads": threads, "segments": len(case.kind),
                    "cells_lowered": events, "cells_visited": int(found["visited"]), "cpu_s": found["cpu_s"],
                    "wall_s": found["wall_s"], "ksegments_per_cpu_s": len(case.kind) / found["cpu_s"] / 1e3,
                    "mcells_per_cpu_s": found["visited"] / found["cpu_s"] / 1e6,
                    "bound_s": bound, "share_of_bound": bound / found["cpu_s"],
                    "freecad_cpu_s": other, "times_freecad": other / found["cpu_s"] if other else None,
                    "goal_times_freecad": GOALS[case.name.split()[0]], "goal_share_of_bound": GOAL_OF_BOUND,
                }  # fmt: skip
                rows.append(row)
                times = f"{other / found['cpu_s']:9.1f}" if other else "        -"
                print(f"{case.name:20s} {'on' if engagement else 'off':>10s} {threads:7d} "
                      f"{row['ksegments_per_cpu_s']:10.1f} {row['mcells_per_cpu_s']:11.0f} "
                      f"{row['share_of_bound']:8.1%} {found['wall_s']:7.3f} {times}")  # fmt: skip
    if options.json:
        write_text(
            options.json, json.dumps({"version": 1, "minimum_rate_cells_s": rate, "rows": rows}, indent=2) + "\n"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
