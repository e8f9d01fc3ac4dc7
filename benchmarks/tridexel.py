"""Cost of the surface of a part from lines along three axes, beside the height map, and of a five-axis path.

Paths of three axes are cut on the height map, which is what lines along z are; the lines along x and y are worked out
once, at the end. So the cost of a part in three directions is that of the map and of the surface. The second table cuts
the same tips in columns, with an upright, a tilted and a swaying tool, and an impeller: channels between twisted
blades, five axes moving at once. Beside it is the map's cost along the same tips with an upright tool, and as the bound
the columns looked at at the rate at which this machine takes minima in its cache. The last figure is a roughing of
10 000 moves: channels in ten levels with a ball of 6 mm tilted by 20 degrees, which leaves ridges one over the other.

Run ``python benchmarks/tridexel.py``; ``--quick`` is a smoke run, ``--json FILE`` writes the figures.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from counterflex.core.arrays import Float, Int
from counterflex.core.atomic import write_text
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.removal import RemovalResult, remove_path
from counterflex.cutting.stock import HeightMap
from counterflex.cutting.tridexel.columns import ColumnStock, remove_turning
from counterflex.cutting.tridexel.cut_log import CutLog
from counterflex.cutting.tridexel.surface import surface, wall_points
from counterflex.path import FEED
from removal import Case, cases, minimum_rate

GOAL_TIMES_MAP = 6.0
TOP_M = 0.06
TILT_RAD = np.radians(20.0)


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


def roughing(moves: int, levels: int = 10, blades: int = 7) -> tuple[Float, Float]:
    """Channels of a hub in levels with a tool tilted outwards by 20 degrees: tips (n, 3) m and tool axes (n, 3)."""
    tips, axes = [], []
    points = max(2, round(moves / (levels * blades)) - 1)
    share = np.linspace(0.0, 1.0, points)
    for blade in range(blades):
        around = 2.0 * np.pi * blade / blades + 0.9 * share
        outward = np.stack([np.cos(around), np.sin(around), np.zeros(points)], axis=1)
        axis = np.array([0.0, 0.0, np.cos(TILT_RAD)]) + np.sin(TILT_RAD) * outward
        for level in range(levels):
            height = -0.002 * (level + 1) - 0.022 * share**1.5 * (level + 1) / levels
            tip = (0.018 + 0.042 * share)[:, None] * outward + height[:, None] * [0.0, 0.0, 1.0]
            over = np.array([0.0, 0.0, 0.05])
            tips.append(np.concatenate([tip[:1] + over, tip, tip[-1:] + over]))
            axes.append(np.concatenate([axis[:1], axis, axis[-1:]]))
    return np.concatenate(tips), np.concatenate(axes)


def many_moves(moves: int, cell: float) -> dict[str, Any]:
    """CPU time of a roughing, memory of its columns at the end, and the most stretches that one of them holds."""
    tips, axes = roughing(moves)
    stock = ColumnStock.of(HeightMap.from_box((-0.07, -0.07, -0.06), (0.07, 0.07, 0.0), cell))
    before = stock.low.nbytes + stock.high.nbytes + stock.count.nbytes
    start = time.process_time()
    removed = remove_turning(
        stock, tips, axes, np.full(len(tips) - 1, FEED, dtype=np.int64), Cutter(0.006, 0.003), top_m=TOP_M
    )
    seconds = time.process_time() - start
    after = stock.low.nbytes + stock.high.nbytes + stock.count.nbytes
    return {"moves": len(tips) - 1, "cell_mm": cell * 1e3, "seconds": seconds, "stretches": int(stock.count.max()),
            "memory_mb": [before / 1e6, after / 1e6], "columns": stock.count.size,
            "volume_cm3": float(removed.volume_m3.sum()) * 1e6}  # fmt: skip


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


def axes_for(case: Case, how: str) -> Float:
    """Tool axes along a path: upright, tilted by 15 degrees, or swaying by 15 degrees once in 60 mm, (n, 3)."""
    n = len(case.points)
    if how == "upright":
        return np.tile([0.0, 0.0, 1.0], (n, 1))
    lean = np.full(n, 0.27)
    if how == "turning":
        way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(case.points, axis=0), axis=1))])
        lean = 0.27 * np.sin(2.0 * np.pi * way / 0.06)
    axis = np.stack([np.sin(lean), 0.3 * np.sin(lean), np.cos(lean)], axis=1)
    out: Float = axis / np.linalg.norm(axis, axis=1, keepdims=True)
    return out


def least_time(
    job: Callable[[Any], RemovalResult], stock: Callable[[], Any], rounds: int
) -> tuple[float, RemovalResult]:
    """Smallest CPU time of a job on a fresh stock, s, and what it returned."""
    best = np.inf
    for _ in range(rounds):
        fresh = stock()
        start = time.process_time()
        found = job(fresh)
        best = min(best, time.process_time() - start)
    return best, found


def against_map(
    name: str, tips: Float, axes: Float, kind: Int, cutter: Cutter, block: Callable[[], HeightMap], rounds: int
) -> dict[str, Any]:
    """CPU time of columns, engagement booked, and of the height map along the same tips with an upright tool."""
    n = len(kind)
    mapped_s, mapped = least_time(lambda stock: remove_path(stock, tips, kind, cutter), block, rounds)
    columns_s, found = least_time(
        lambda stock: remove_turning(stock, tips, axes, kind, cutter, top_m=TOP_M),
        lambda: ColumnStock.of(block()),
        rounds,
    )
    return {"case": name, "segments": n, "cell_mm": block().cell_m * 1e3, "map_us": mapped_s / n * 1e6,
            "us": columns_s / n * 1e6, "times_map": columns_s / mapped_s, "columns": found.cells_visited / n,
            "bound_us": found.cells_visited / n / minimum_rate() * 1e6, "cm3": float(found.volume_m3.sum()) * 1e6,
            "map_cm3": float(mapped.volume_m3.sum()) * 1e6}  # fmt: skip


def hub(cell: float, points: int) -> tuple[Float, Float, Int, Callable[[], HeightMap]]:
    """Tips, axes, kinds and block of the impeller."""
    tips, axes = sampled(*impeller(7, 5, points))
    kind = np.full(len(tips) - 1, FEED, dtype=np.int64)
    return tips, axes, kind, lambda: HeightMap.from_box((-0.07, -0.07, -0.05), (0.07, 0.07, 0.0), cell)


def five_axis(cell: float, points: int) -> dict[str, Any]:
    """CPU time and mesh of the impeller."""
    tips, axes, kind, block = hub(cell, points)
    stock, cutter = ColumnStock.of(block()), Cutter(0.008, 0.004)
    removed = remove_turning(stock, tips, axes, kind, cutter, top_m=TOP_M)
    start = time.process_time()
    log = CutLog.of(tips, axes, cutter, top_m=TOP_M)
    found = surface(stock, log)
    finish = time.process_time() - start
    mesh = trimesh.Trimesh(found.vertices, found.triangles, process=False)
    return {"segments": len(kind), "surface_s": finish, "points": len(found.points),
            "volume_cm3": float(removed.volume_m3.sum()) * 1e6, "stretches": int(stock.count.max()),
            "triangles": len(found.triangles), "closed": bool(mesh.is_watertight),
            "oriented": bool(mesh.is_winding_consistent), "mesh_cm3": float(mesh.volume) * 1e6,
            "stock_cm3": stock.volume_m3 * 1e6, "surface": found, "log": log}  # fmt: skip


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--quick", action="store_true", help="smoke run: few segments, coarse cells")
    parser.add_argument("--json", type=Path, help="write the figures to this file")
    parser.add_argument("--columns", action="store_true", help="only the second table and the impeller")
    parser.add_argument("--roughing", action="store_true", help="only the roughing of 10 000 moves")
    parser.add_argument("--mesh", type=Path, help="write the impeller to this .stl or .ply file")
    options = parser.parse_args()
    n, cell, points = (1000, 4e-4, 8) if options.quick else (100_000, 1e-4, 120)
    few = 200 if options.quick else 1000
    if options.roughing:
        _print_roughing(options.quick)
        return 0
    if not options.columns:
        for case in cases(200, None):  # compile
            three_axis(case, 2e-3)
    for how in ("upright", "tilted", "turning"):
        for case in cases(60, None):
            block = _block(case, 2e-3)
            against_map(how, case.points, axes_for(case, how), case.kind, case.cutter, block, 1)
    rows = [] if options.columns else [three_axis(case, cell) for case in cases(n, None)]
    if rows:
        _print_upright(rows, cell)
    turned = []
    print("| columns, engagement booked | cell, mm | map, upright, us a segment | columns, us | times the map "
          "| columns looked at | bound, us | volume, map's, cm^3 |")  # fmt: skip
    print("|---|---|---|---|---|---|---|---|")
    for side in (5.0 * cell, cell):
        jobs = [
            (f"{case.name}, {how}", case.points, axes_for(case, how), case.kind, case.cutter, _block(case, side))
            for how in ("upright", "tilted", "turning")
            for case in cases(few, None)
        ]
        tips, axes, kind, block = hub(side, points)
        jobs += [(f"impeller, {name}", tips, axes, kind, Cutter(0.008, r), block)
                 for name, r in (("ball D8", 0.004), ("flat D8", 0.0), ("bull nose D8", 0.001))]  # fmt: skip
        for job in jobs:
            if options.quick and "bull" in job[0]:
                continue
            row = against_map(*job, 1 if options.quick or "impeller" in job[0] else 2)
            turned.append(row)
            print(f"| {row['case']} | {row['cell_mm']:g} | {row['map_us']:.1f} | {row['us']:.1f} "
                  f"| {row['times_map']:.1f} | {row['columns']:.0f} | {row['bound_us']:.2f} "
                  f"| {row['cm3']:.3f}, {row['map_cm3']:.3f} |", flush=True)  # fmt: skip
        if options.quick:
            break
    missed = sum(row["times_map"] > GOAL_TIMES_MAP for row in turned)
    print(f"\nAt most {GOAL_TIMES_MAP:g} times the map: {len(turned) - missed} of {len(turned)}.")
    five = five_axis(5 * cell, points)
    print(f"\nImpeller: {five['segments']} segments, {five['volume_cm3']:.1f} cm^3, {five['stretches']} stretches in a "
          f"column at most; surface of {five['points']} points, {five['triangles']} triangles: "
          f"{five['surface_s']:.1f} s, closed: {five['closed']}, oriented: {five['oriented']}, "
          f"{five['mesh_cm3']:.2f} cm^3 (columns {five['stock_cm3']:.2f}).")  # fmt: skip
    rough = _print_roughing(options.quick)
    if options.mesh:
        five["surface"].save(options.mesh)
    if options.json:
        del five["surface"], five["log"]
        write_text(options.json, json.dumps({"version": 3, "rows": rows, "columns": turned, "impeller": five,
                                             "roughing": rough}) + "\n")  # fmt: skip
    return 0


def _print_roughing(quick: bool) -> dict[str, Any]:
    moves, cell = (300, 1e-3) if quick else (10_000, 2e-4)
    many_moves(100, 1e-3)  # compile
    found = many_moves(moves, cell)
    before, after = found["memory_mb"]
    print(f"\nRoughing in ten levels, ball D6 tilted by 20 deg: {found['moves']} moves in {found['seconds']:.1f} s on "
          f"{found['columns']} columns of {found['cell_mm']:g} mm, {found['stretches']} stretches in a column at most; "
          f"columns of {before:.0f} MB grew to {after:.0f} MB; {found['volume_cm3']:.1f} cm^3.")  # fmt: skip
    return found


def _print_upright(rows: list[dict[str, Any]], cell: float) -> None:
    print(f"| upright path, {cell * 1e3:g} mm cells | map, us a segment | walls, us | times the map | points | off |")
    print("|---|---|---|---|---|---|")
    for row in rows:
        print(f"| {row['case']} | {row['map_us']:.0f} | {row['walls_us']:.1f} | {row['times_map']:.2f} "
              f"| {row['points']} | {row['worst_um']:.4f} um |")  # fmt: skip
    met = "met" if max(row["times_map"] for row in rows) <= GOAL_TIMES_MAP else "missed"
    print(f"\nAt most {GOAL_TIMES_MAP:g} times the map: {met}.\n")


def _block(case: Case, cell: float) -> Callable[[], HeightMap]:
    return lambda: HeightMap.from_box(case.low, case.high, cell)


if __name__ == "__main__":
    sys.exit(main())
