"""Cost of the surface of a part from lines along three axes, beside the height map, and of a five-axis path.

Paths of three axes are cut on the height map, which is what lines along z are; the lines along x and y are worked out
once, at the end. So the cost of a part in three directions is that of the map and of the surface. The second table cuts
the same upright paths with the kernel for turning tools, and an impeller: channels between twisted blades, five axes
moving at once.

Run ``python benchmarks/tridexel.py``; ``--quick`` is a smoke run, ``--json FILE`` writes the figures.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.atomic import write_text
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.removal import remove_path
from counterflex.cutting.stock import HeightMap
from counterflex.cutting.tridexel.columns import ColumnStock, remove_turning
from counterflex.cutting.tridexel.cut_log import CutLog
from counterflex.cutting.tridexel.surface import surface, wall_points
from counterflex.path import FEED
from removal import Case, cases

GOAL_TIMES_MAP = 6.0
TOP_M = 0.06


def impeller(blades: int, passes: int, points: int) -> tuple[Float, Float]:
    """Channels of a hub: from the shaft outwards and down, the tool leaning outwards and along the blade as it goes.

    Returns:
        Tips (n, 3) m and tool axes (n, 3).
    """
    tips, axes = [], []
    share = np.linspace(0.0, 1.0, points)
    for blade in range(blades):
        for level in range(passes):
            around = 2.0 * np.pi * blade / blades + 0.9 * share
            radius = 0.018 + 0.042 * share
            height = -0.004 * (level + 1) - 0.022 * share**1.5 * (level + 1) / passes
            x, y = radius * np.cos(around), radius * np.sin(around)
            lean, twist = 0.15 + 0.45 * share, 0.25 * np.sin(np.pi * share)
            outward = np.stack([np.cos(around), np.sin(around), np.zeros(points)], axis=1)
            along = np.stack([-np.sin(around), np.cos(around), np.zeros(points)], axis=1)
            axis = np.array([0.0, 0.0, 1.0]) + np.tan(lean)[:, None] * outward + np.tan(twist)[:, None] * along
            axis /= np.linalg.norm(axis, axis=1, keepdims=True)
            tip = np.stack([x, y, height], axis=1)
            over = np.array([0.0, 0.0, 0.05])
            tips.append(np.concatenate([tip[:1] + over, tip, tip[-1:] + over]))
            axes.append(np.concatenate([axis[:1], axis, axis[-1:]]))
    return np.concatenate(tips), np.concatenate(axes)


def sampled(tips: Float, axes: Float, turn_rad: float = 0.02) -> tuple[Float, Float]:
    """The path with points between where the axis turns by more than an angle."""
    between = np.arccos(np.clip(np.sum(axes[1:] * axes[:-1], axis=1), -1.0, 1.0))
    n = np.maximum(1, np.ceil(between / turn_rad)).astype(np.int64)
    at = np.concatenate([[0.0], np.repeat(np.arange(len(n)), n) + np.concatenate([np.arange(1, k + 1) / k for k in n])])
    row = np.arange(len(tips))
    out = [np.stack([np.interp(at, row, part[:, c]) for c in range(3)], axis=1) for part in (tips, axes)]
    return out[0], out[1] / np.linalg.norm(out[1], axis=1, keepdims=True)


def three_axis(case: Case, cell: float) -> dict[str, Any]:
    """CPU time of the map with engagement, and of the surface after it."""
    stock = HeightMap.from_box(case.low, case.high, cell)
    start = time.process_time()
    remove_path(stock, case.points, case.kind, case.cutter, threads=1)
    cut = time.process_time() - start
    start = time.process_time()
    log = CutLog.of(case.points, np.tile([0.0, 0.0, 1.0], (len(case.points), 1)), case.cutter, top_m=TOP_M)
    points = wall_points(ColumnStock.of(stock), log)
    finish = time.process_time() - start
    worst = float(np.nanmax(np.abs(log.distance(points[::50])), initial=0.0))
    return {"case": case.name, "segments": len(case.kind), "map_us": cut / len(case.kind) * 1e6,
            "walls_us": finish / len(case.kind) * 1e6, "times_map": 1.0 + finish / cut, "points": len(points),
            "worst_um": worst * 1e6}  # fmt: skip


def turning(case: Case, cell: float) -> dict[str, Any]:
    """CPU time of the kernel for turning tools on the same upright path."""
    upright = np.tile([0.0, 0.0, 1.0], (len(case.points), 1))
    stock = HeightMap.from_box(case.low, case.high, cell)
    columns = ColumnStock.of(stock)
    start = time.process_time()
    mapped = remove_path(stock, case.points, case.kind, case.cutter, threads=1)
    cut = time.process_time() - start
    start = time.process_time()
    found = remove_turning(columns, case.points, upright, case.kind, case.cutter, top_m=TOP_M)
    own = time.process_time() - start
    return {"case": case.name, "segments": len(case.kind), "us": own / len(case.kind) * 1e6, "times_map": own / cut,
            "volume": float(found.volume_m3.sum() / mapped.volume_m3.sum() - 1.0)}  # fmt: skip


def five_axis(cell: float, points: int) -> dict[str, Any]:
    """CPU time and mesh of the impeller."""
    tips, axes = sampled(*impeller(7, 5, points))
    stock = ColumnStock.of(HeightMap.from_box((-0.07, -0.07, -0.05), (0.07, 0.07, 0.0), cell))
    cutter = Cutter(0.008, 0.004)
    kind = np.full(len(tips) - 1, FEED, dtype=np.int64)
    start = time.process_time()
    removed = remove_turning(stock, tips, axes, kind, cutter, top_m=TOP_M)
    cut = time.process_time() - start
    start = time.process_time()
    log = CutLog.of(tips, axes, cutter, top_m=TOP_M)
    found = surface(stock, log)
    finish = time.process_time() - start
    return {"segments": len(kind), "us": cut / len(kind) * 1e6, "surface_s": finish, "points": len(found.points),
            "volume_cm3": float(removed.volume_m3.sum()) * 1e6, "stretches": int(stock.count.max()),
            "triangles": len(found.triangles), "surface": found, "log": log}  # fmt: skip


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--quick", action="store_true", help="smoke run: few segments, coarse cells")
    parser.add_argument("--json", type=Path, help="write the figures to this file")
    parser.add_argument("--mesh", type=Path, help="write the impeller to this .stl or .ply file")
    options = parser.parse_args()
    n, cell, points = (1000, 4e-4, 20) if options.quick else (100_000, 1e-4, 120)
    few = 1000 if options.quick else 3000
    for case in cases(200, None):  # compile
        three_axis(case, 2e-3)
        turning(case, 2e-3)
    rows = [three_axis(case, cell) for case in cases(n, None)]
    print(f"| upright path, {cell * 1e3:g} mm cells | map, us a segment | walls, us | times the map | points | off |")
    print("|---|---|---|---|---|---|")
    for row in rows:
        print(f"| {row['case']} | {row['map_us']:.0f} | {row['walls_us']:.1f} | {row['times_map']:.2f} "
              f"| {row['points']} | {row['worst_um']:.4f} um |")  # fmt: skip
    met = "met" if max(row["times_map"] for row in rows) <= GOAL_TIMES_MAP else "missed"
    print(f"\nAt most {GOAL_TIMES_MAP:g} times the map: {met}.\n")
    turned = [turning(case, 5 * cell) for case in cases(few, None)]
    print("| upright path, kernel for turning tools | us a segment | times the map | volume |")
    print("|---|---|---|---|")
    for row in turned:
        print(f"| {row['case']} | {row['us']:.0f} | {row['times_map']:.1f} | {row['volume']:+.1e} |")
    five = five_axis(5 * cell, points)
    print(f"\nImpeller, five axes: {five['segments']} segments, {five['us']:.0f} us each, "
          f"{five['volume_cm3']:.1f} cm^3, {five['stretches']} stretches in a column at most; "
          f"surface of {five['points']} points, {five['triangles']} triangles: {five['surface_s']:.1f} s.")  # fmt: skip
    if options.mesh:
        five["surface"].save(options.mesh)
    if options.json:
        del five["surface"], five["log"]
        write_text(options.json, json.dumps({"version": 1, "rows": rows, "turning": turned, "impeller": five}) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
