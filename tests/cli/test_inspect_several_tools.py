"""``inspect`` of a part with two grooves, a pocket and two tools: each feature with its tool's radius."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from counterflex.core.arrays import Float
from counterflex.geometry import rotation

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
PROGRAM, CELL = EXAMPLES / "programs" / "pocket_grooves.ngc", EXAMPLES / "cells" / "kr300_d16_small.toml"
R_TILT = rotation.exp(np.radians(15.0) * np.array([1.0, 2.0, 2.0]) / 3.0)
MADE = {
    ("groove 1", "width"): 16.10,
    ("groove 1", "wall left"): 8.15,
    ("groove 1", "wall right"): 7.95,
    ("groove 1", "depth"): 4.08,
    ("groove 2", "width"): 9.94,
    ("groove 2", "wall left"): 4.89,
    ("groove 2", "wall right"): 5.05,
    ("groove 2", "depth"): 2.95,
    ("pocket 1", "diameter"): 24.20,
    ("pocket 1", "centre"): 0.05,
    ("pocket 1", "depth"): 3.06,
}
"""Of the part as made, mm."""


def points() -> Float:
    """Points all over the part but its bottom, with noise, from solids by a library."""
    block = trimesh.creation.box(bounds=[[0.0, 0.0, 0.0], [60.0, 60.0, 40.0]])
    first = trimesh.creation.box(bounds=[[-1.0, 11.0 - 7.95, 40.0 - 4.08], [61.0, 11.0 + 8.15, 50.0]])
    # the second runs along +y: its left is towards -x
    second = trimesh.creation.box(bounds=[[53.0 - 4.89, -1.0, 40.0 - 2.95], [53.0 + 5.05, 61.0, 50.0]])
    pocket = trimesh.creation.cylinder(12.1, 20.0, sections=720)
    pocket.apply_translation([30.03, 38.04, 40.0 - 3.06 + 10.0])
    made = trimesh.boolean.difference([block, first, second, pocket])
    on, _ = trimesh.sample.sample_surface(made, 150_000, seed=1)
    on = on[on[:, 2] > 0.3]
    out: Float = on + np.random.default_rng(1).normal(scale=0.01, size=on.shape)
    return out


@pytest.mark.long
def test_grooves_and_pocket_of_two_tools_come_back(folder: Path, counterflex: Callable[..., Any]) -> None:
    seen = points() @ R_TILT.T + np.array([20.0, -20.0, 10.0])
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(seen)}\n"
    head += "property float x\nproperty float y\nproperty float z\nend_header\n"
    (folder / "scan.ply").write_bytes(head.encode() + (seen / 25.4).astype("<f4").tobytes())
    ended = counterflex(
        "inspect", str(PROGRAM), "--cell", str(CELL), "--scan", "scan.ply", "--out", "inspected", "--json"
    )  # fmt: skip
    assert ended.status == 0, ended.err
    summary = json.loads(ended.out)
    rows = {(row["feature"], row["quantity"]): row for row in summary["features"]}
    assert {name for name, _ in rows} == {"groove 1", "groove 2", "pocket 1"}
    nominal = {key: row["nominal_mm"] for key, row in rows.items()}
    assert (nominal["groove 1", "width"], nominal["groove 2", "width"], nominal["pocket 1", "diameter"]) == (16, 10, 24)
    for key, value in MADE.items():
        mean = rows[key]["part"]["mean_mm"]
        assert abs(mean - value) < 0.01, (key, mean, value)
