"""Scan of a part that is milled with a tilted tool: it is measured, kept and corrected in the axes of the part."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

from counterflex.core.arrays import Float
from counterflex.core.units import DEG, MM, UM
from counterflex.files.part_deviations import read_part_deviations
from counterflex.geometry.rotation import exp

CELL = Path(__file__).parents[2] / "examples" / "cells" / "kr300_bc_table.toml"
TILT = -15.0 * DEG  # of the tool in the part: B turns the table, the other way round
PROGRAM = (
    "G17 G54 G40 G49 G80 G90\nG21\nM6 T1\nM3 S13000\nG0 B15 C0\nG43.4 H1\nG0 X20 Y-12 Z60\nG0 Z42\nG1 Z30 F3000\n"
    "G1 Y72 F1500\nG0 Z60\nM5\nM30\n"
)
LEFT_UM = 80.0


def floor(R_part_tool: Float) -> Float:
    """Points of the floor, mm, part frame: through the path, square to the tool, with material left."""
    across, along = np.meshgrid(np.arange(-7.0, 7.01, 0.1), np.arange(2.0, 28.0, 0.1))
    in_tool = np.stack([across.ravel(), np.zeros(across.size), np.full(across.size, LEFT_UM * UM / MM)], axis=1)
    out: Float = np.array([20.0, 0.0, 30.0]) + in_tool @ R_part_tool.T + along.reshape(-1, 1) * [0.0, 1.0, 0.0]
    return out


def sides() -> Float:
    """Points of the sides of the blank that a tilt about y leaves square, mm, part frame."""
    x, z = (one.ravel() for one in np.meshgrid(np.arange(36.0, 58.0, 0.15), np.arange(4.0, 30.0, 0.15)))
    return np.concatenate([np.stack([x, np.full(x.shape, y), z], axis=1) for y in (0.0, 60.0)])


def test_an_aligned_scan_is_in_the_axes_of_the_part(tmp_path: Path, counterflex: Callable[..., Any]) -> None:
    R_part_tool = exp(np.array([0.0, TILT, 0.0]))
    (tmp_path / "tilted.ngc").write_text(PROGRAM, encoding="ascii")
    points = np.concatenate([floor(R_part_tool), sides()])
    pl.DataFrame(points).write_csv(tmp_path / "floor.xyz", include_header=False, separator=" ", float_precision=6)
    out = tmp_path / "out"
    scan, program = str(tmp_path / "floor.xyz"), str(tmp_path / "tilted.ngc")
    ended = counterflex("inspect", program, "--cell", str(CELL), "--scan", scan, "--aligned", "--out", str(out))
    assert ended.status == 0, ended.err
    deviations, _ = read_part_deviations(out / "deviations.parquet")
    on_floor = deviations.face == 0
    np.testing.assert_allclose(deviations.normals[on_floor], np.tile(R_part_tool[:, 2], (on_floor.sum(), 1)), atol=1e-6)
    assert np.median(deviations.deviation_m[on_floor]) == pytest.approx(LEFT_UM * UM, abs=2 * UM)
    assert deviations.points[on_floor, 1].max() > 25 * MM
