"""``inspect`` measures pockets, islands, steps, walls, bosses and free forms whose size is known by solid geometry."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from counterflex.core.arrays import Float

HEAD = "G17 G54 G40 G49 G80 G90 G21\nM6 T1\nM3 S13000\nG0 Z40\n"
TAIL = "G0 Z40\nM2\n"
R = 8.0
COMMAND = ("inspect", "part.ngc", "--cell", "cell.toml", "--scan", "s.ply", "--aligned", "--unit", "mm", "--out", "out")


def loop(low: tuple[float, float], high: tuple[float, float], z: float) -> str:
    """The tool once around a rectangle."""
    (a, b), (c, d) = low, high
    corners = [(c, b), (c, d), (a, d), (a, b)]
    return f"G0 X{a} Y{b}\nG0 Z22\nG1 Z{z} F600\n" + "".join(f"G1 X{x} Y{y} F1500\n" for x, y in corners)


def block() -> Any:
    return trimesh.creation.box(bounds=[[0.0, 0.0, 0.0], [40.0, 30.0, 20.0]])


def rounded(low: tuple[float, float], high: tuple[float, float], radius: float, z: float) -> Any:
    """Return what a tool of a radius clears around and within a rectangle, from z upwards."""
    posts = []
    for x in (low[0], high[0]):
        for y in (low[1], high[1]):
            post = trimesh.creation.cylinder(radius, 40.0, sections=256)
            post.apply_translation([x, y, z + 20.0])
            posts.append(post)
    return trimesh.util.concatenate(posts).convex_hull


def sampled(solid: Any, count: int = 50_000) -> Float:
    """Points all over a solid but its bottom, with noise of 5 um."""
    points, _ = trimesh.sample.sample_surface(solid, count, seed=3)
    points = points[points[:, 2] > 0.3]
    out: Float = points + np.random.default_rng(1).normal(scale=0.005, size=points.shape)
    return out


def pocket() -> tuple[str, Float, dict[tuple[str, str], tuple[float, float]]]:
    """30 x 24, 4 deep; made with a tool 0.03 larger in radius, 0.05 to the right and 0.02 down, 4.1 deep."""
    wide, x, y = R + 0.03, 0.05, -0.02
    made = trimesh.boolean.difference([block(), rounded((13 + x, 11 + y), (27 + x, 19 + y), wide, 15.9)])
    name = "rectangular pocket 1"
    return (
        HEAD + loop((13.0, 11.0), (27.0, 19.0), 16.0) + TAIL,
        sampled(made),
        {
            (name, "length"): (30.0, 30.06),
            (name, "width"): (24.0, 24.06),
            (name, "wall x+"): (15.0, 15.08),
            (name, "wall x-"): (15.0, 14.98),
            (name, "wall y+"): (12.0, 12.01),
            (name, "wall y-"): (12.0, 12.05),
            (name, "depth"): (4.0, 4.1),
            (name, "corners"): (0.0, -0.03),
        },
    )


def island() -> tuple[str, Float, dict[tuple[str, str], tuple[float, float]]]:
    """10 x 8, 5 high; made 0.04 too thick in x and 0.06 in y, its floor 0.07 too high."""
    cleared = trimesh.creation.box(bounds=[[-1.0, -1.0, 15.07], [41.0, 31.0, 30.0]])
    kept = trimesh.creation.box(bounds=[[14.98, 10.97, 10.0], [25.02, 19.03, 20.0]])
    made = trimesh.boolean.difference([block(), trimesh.boolean.difference([cleared, kept])])
    name = "island 1"
    return (
        HEAD + loop((7.0, 3.0), (33.0, 27.0), 15.0) + TAIL,
        sampled(made),
        {
            (name, "length"): (10.0, 10.04),
            (name, "width"): (8.0, 8.06),
            (name, "wall x+"): (5.0, 5.02),
            (name, "wall y-"): (4.0, 4.03),
            (name, "height"): (5.0, 4.93),
        },
    )


def step() -> tuple[str, Float, dict[tuple[str, str], tuple[float, float]]]:
    """A shoulder at y = 6, 5 deep; made 0.08 too narrow, 0.03 too deep."""
    cleared = trimesh.creation.box(bounds=[[-1.0, -1.0, 14.97], [41.0, 5.92, 30.0]])
    made = trimesh.boolean.difference([block(), cleared])
    path = "G0 X-12 Y-2\nG0 Z22\nG1 Z15 F3000\nG1 X52 F1500\n"
    return (
        HEAD + path + TAIL,
        sampled(made),
        {("step 1", "wall y+"): (6.0, 5.92), ("step 1", "depth"): (5.0, 5.03)},
    )


def wall() -> tuple[str, Float, dict[tuple[str, str], tuple[float, float]]]:
    """The side y = 4 trimmed through the whole blank; made at 4.06."""
    made = trimesh.boolean.difference([block(), trimesh.creation.box(bounds=[[-1.0, -1.0, -1.0], [41.0, 4.06, 30.0]])])
    path = "G0 X-12 Y-4\nG0 Z22\nG1 Z-1 F3000\nG1 X52 F1500\n"
    return HEAD + path + TAIL, sampled(made), {("wall 1", "wall y+"): (4.0, 4.06)}


def boss() -> tuple[str, Float, dict[tuple[str, str], tuple[float, float]]]:
    """A round island of 12 mm left by the tool around it; made 12.1, 0.04 to the right."""
    cleared = trimesh.creation.box(bounds=[[-1.0, -1.0, 15.0], [41.0, 31.0, 30.0]])
    post = trimesh.creation.cylinder(6.05, 20.0, sections=512)
    post.apply_translation([20.04, 15.0, 10.0])
    made = trimesh.boolean.difference([block(), trimesh.boolean.difference([cleared, post])])
    path = loop((-2.0, -2.0), (42.0, 32.0), 15.0) + "G0 Z22\nG0 X6 Y15\nG1 Z15 F600\nG2 X6 Y15 I14 J0 F1500\n"
    return HEAD + path + TAIL, sampled(made), {("boss 1", "diameter"): (12.0, 12.1), ("boss 1", "centre"): (0.0, 0.04)}


def incline() -> tuple[str, Float, dict[tuple[str, str], tuple[float, float]]]:
    """A slope in passes beside each other, with the cusps that they leave; made 0.06 too high."""
    slope, rows = 4.0 / 60.0, np.arange(-4.0, 35.0, 6.0)
    path = "".join(f"G0 X-12 Y{y}\nG0 Z19\nG1 Z18 F3000\nG1 X52 Z{18 - 64 * slope:.6f} F1500\nG0 Z40\n" for y in rows)
    rng = np.random.default_rng(2)
    xy = rng.uniform([0.0, 0.0], [40.0, 30.0], (30_000, 2))
    off = xy[:, 1:] - rows
    behind = np.where(np.abs(off) < R, np.sqrt(np.maximum(R * R - off * off, 0.0)), np.nan)
    z = np.nanmin(18.0 - slope * (xy[:, :1] + behind + 12.0), axis=1)
    sides = sampled(block(), 20_000)
    sides = sides[(sides[:, 2] < 12.0)]
    points = np.concatenate([np.column_stack([xy, z + 0.06]), sides])
    return HEAD + path + TAIL, points, {("surface 1", "profile"): (0.0, 0.06)}


PARTS = {one.__name__: one for one in (pocket, island, step, wall, boss, incline)}


def write(path: Path, points: Float) -> None:
    """Points as binary PLY."""
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
    head += "property float x\nproperty float y\nproperty float z\nend_header\n"
    path.write_bytes(head.encode() + points.astype("<f4").tobytes())


@pytest.mark.by_turn
@pytest.mark.parametrize("name", PARTS)
def test_a_part_gives_its_sizes(folder: Path, counterflex: Callable[..., Any], name: str) -> None:
    program, points, expected = PARTS[name]()
    (folder / "part.ngc").write_text(program)
    write(folder / "s.ply", points)
    (folder / "t.csv").write_text("feature,quantity,tolerance_mm\n" + "".join(f"{f},{q},0.045\n" for f, q in expected))
    ended = counterflex(*COMMAND, "--tolerances", "t.csv", "--json")
    assert ended.status == 0, ended.err
    summary = json.loads(ended.out)
    rows = {(row["feature"], row["quantity"]): row for row in summary["features"]}
    areas = summary["parts"]["part"]["coverage"]["features"]
    for key, (nominal, size) in expected.items():
        row = rows[key]
        assert abs(row["nominal_mm"] - nominal) < 0.002, (key, row)
        assert abs(row["part"]["mean_mm"] - size) < 0.006, (key, row)
        assert row["part"]["measured_share"] > 0.9, (key, row)
        assert row["tolerance_mm"] == 0.045
        assert row["part"]["within"] == (abs(row["part"]["worst_mm"] - nominal) <= 0.045)
        assert areas[key[0]]["judged_mm2"] > 0.85 * areas[key[0]]["machined_mm2"]
