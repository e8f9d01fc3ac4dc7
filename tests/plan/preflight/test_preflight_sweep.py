"""Rows that the check of collisions leaves out: the result is that of all rows, and few are looked at on a raster."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from counterflex.app import preflight as job
from counterflex.files.cell.cell import Cell, resolve
from counterflex.files.cell.tables import CellTables
from counterflex.files.schema import parse
from counterflex.plan.preflight import collision
from counterflex.plan.preflight.collision import HOLDER, NEAR_M, ROBOT
from counterflex.plan.preflight.sweep import JointSweep

SMALL = Path(__file__).resolve().parents[2] / "data" / "cells" / "small.toml"


def raster(step_mm: float, depth_mm: float = 8.0) -> str:
    """Parallel passes over the blank, deeper and deeper towards its middle; points every millimetre."""
    lines = ["G21 G90 G17 G94", "M6 T1", "G43 H1", "M3 S13000", "G0 Z60", "G0 X-12 Y0"]
    for k, y in enumerate(np.arange(0.0, 30.0, step_mm)):
        z = 40.0 - depth_mm * np.sin(np.pi * y / 30.0)
        xs = np.arange(-12.0, 53.0) if k % 2 == 0 else np.arange(52.0, -13.0, -1.0)
        lines += [f"G1 X{x:.3f} Y{y:.3f} Z{z + 0.3 * np.sin(x):.3f} F3000" for x in xs]
    return "\n".join([*lines, "G0 Z60", "M5", "M30"]) + "\n"


def cell() -> Cell:
    data = tomllib.loads(SMALL.read_text(encoding="utf-8"))
    data["tools"][0] |= {"overhang_mm": 40, "holder_mm": [[5, 20], [40, 30]]}
    return resolve(parse(CellTables, data, where="test"), SMALL)


def checked(folder: Path, program: str) -> dict[str, Any]:
    (folder / "part.ngc").write_text(program)
    return {row["check"]: row for row in job.check(folder / "part.ngc", cell()).summary["checks"]}


@pytest.mark.long
def test_rows_that_are_left_out_are_farther_away(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    quick = checked(tmp_path, raster(3.0))
    monkeypatch.setattr(JointSweep, "skips", lambda *_: False)
    monkeypatch.setattr(JointSweep, "next_row", lambda _, row: row + 1)
    every = checked(tmp_path, raster(3.0))
    for check in (ROBOT, HOLDER, "tool to surroundings", "spindle to arm"):
        assert quick[check]["verdict"] == every[check]["verdict"]
        assert 0.0 <= quick[check]["value"] - every[check]["value"] <= 1e3 * NEAR_M + 0.05
    assert every[HOLDER]["verdict"] == "fail"  # the machined stock is what counts


@pytest.mark.long
def test_passes_close_to_each_other_are_not_looked_at_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Four times as many passes over the same place cost fewer than three times as many looks."""
    looks: list[int] = []
    original = collision.PlacedBody.closest

    def counted(self: collision.PlacedBody, *args: Any) -> Any:
        looks.append(1)
        return original(self, *args)

    monkeypatch.setattr(collision.PlacedBody, "closest", counted)
    counts = []
    for step in (2.0, 0.5):
        looks.clear()
        checked(tmp_path, raster(step))
        counts.append(len(looks))
    assert counts[1] < 3 * counts[0]


def test_a_distance_bounds_nothing_with_another_tool() -> None:
    place, tool = np.zeros((4, 3)), np.array([1, 1, 2, 2])
    sweep = JointSweep(place, np.tile(np.eye(3), (4, 1, 1)), 0.1, tool)
    sweep.take(0, 1.0, 0.0)
    assert sweep.next_row(0) == 2
    assert sweep.skips(1, 0.0)
    assert not sweep.skips(2, 0.0)
