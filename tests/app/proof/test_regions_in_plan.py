"""A cell whose compliance depends on posture, machined: the plan that knows the region leaves less than the mean."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import tomli_w

from counterflex.app.compensation.compensate import compensate
from counterflex.app.inputs import read_job
from counterflex.app.proof import simulate
from counterflex.app.proof.judge import judge, reference_of
from counterflex.app.proof.truth import truth_of
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.twin.truth.other import GearCurve, OtherPhysics
from counterflex.twin.truth.truth import Truth

ProgramFile = Callable[..., Path]
SHORT = "G21 G17 G90\nM6 T1\nM3 S13000\nG0 X-12 Y15 Z42\nG0 Z36\nG1 X52 F1500\nG0 Z42\nM5\nM2\n"
SMALL = Path(__file__).resolve().parents[2] / "data" / "cells" / "small.toml"


def cell_of(folder: Path, name: str, rows: list[dict[str, object]], key: str = "elastic_region") -> Cell:
    data = tomllib.loads(SMALL.read_text())
    if rows:
        data["robot"][key] = rows
    file = folder / f"{name}.toml"
    file.write_text(tomli_w.dumps(data))
    return read_cell(file)


KNOWN: list[dict[str, object]] = [
    {"segment": "axis1", "direction": "rz", "axis": 1, "angles_deg": [-60, 60], "factors": [2.4, 2.2]},
    {"segment": "spindle", "direction": "rx", "axis": 2, "angles_deg": [-120, -80], "factors": [2.2, 1.6]},
    {"segment": "spindle", "direction": "ry", "axis": 2, "angles_deg": [-120, -80], "factors": [2.2, 1.6]},
    {"segment": "spindle", "direction": "rz", "axis": 2, "angles_deg": [-120, -80], "factors": [2.2, 1.6]},
]


def left(folder: Path, program: Path, cell: Cell, truth: Truth) -> float:
    """99.7 % of the path's error once the compensated program is machined on a truth, m."""
    plan = compensate(program, cell, predict=False)
    file = folder / f"{cell.path.stem}.ngc"
    file.write_text(next(iter(plan.files.values())), encoding="ascii")
    record = simulate.machine(read_job(file, cell), cell, truth)
    found = judge(reference_of(read_job(program, cell), cell), record, record.stock)
    return found.variant.path.path.p997_m


@pytest.mark.long
def test_the_plan_with_the_regions_leaves_less(tmp_path: Path, program: ProgramFile) -> None:
    """Seeds 201 to 208: 0.58 to 0.78 of the error, mean 0.67; the cells are off by more than regions.

    Each is better; the mean of three is below 0.8, above 2 standard deviations of what is expected (0.09 of one seed),
    and below the 0.83 that half the effect would leave.
    """
    file = program(SHORT)
    plain, known = cell_of(tmp_path, "plain", []), cell_of(tmp_path, "known", KNOWN)
    regions = tuple(row.region() for row in known.tables.robot.elastic_region)
    shares = []
    for seed in (33, 34, 35):
        truth = replace(truth_of(plain, seed), regions=regions)
        error = {cell.path.stem: left(tmp_path, file, cell, truth) for cell in (plain, known)}
        shares.append(error["known"] / error["plain"])
    assert max(shares) < 0.9
    assert sum(shares) < 0.8 * len(shares)


GEARS = tuple(GearCurve(axis, (500.0, 2500.0), (0.5, 1.0, 1.2), 0.0, 0.0, 1e-5) for axis in (0, 1, 2))
"""Softer below 500 N m, as the torque of axis 1 is in these cuts."""
CURVES: list[dict[str, object]] = [
    {
        "segment": f"axis{gear.axis + 1}",
        "direction": "rz",
        "loads_nm": [-2501, -2500, -501, -500, 500, 501, 2500, 2501],
        "factors": [1 / 1.2, 1.0, 1.0, 2.0, 2.0, 1.0, 1.0, 1 / 1.2],
    }
    for gear in GEARS
]


@pytest.mark.long
def test_the_plan_with_the_curves_of_the_gears_leaves_less(
    tmp_path: Path, program: ProgramFile, monkeypatch: pytest.MonkeyPatch
) -> None:
    """0.73 to 0.77 of the error that the mean compliances leave; the cells are off by more than gears.

    Both plans take the drives as rigid. With those of the class the mean compliances leave 0.42, 0.28 and 0.25 instead
    of 0.55, 0.40 and 0.38 mm, and the curves 0.84, 0.74 and 0.90 of that: both plans err in the drives, not the gears.
    """
    monkeypatch.setattr(Cell, "class_drives", None)
    file = program(SHORT)
    plain, known = cell_of(tmp_path, "plain", []), cell_of(tmp_path, "known", CURVES, "compliance_curve")
    shares = []
    for seed in (33, 34, 35):
        truth = replace(truth_of(plain, seed), other=OtherPhysics(gears=GEARS))
        error = {cell.path.stem: left(tmp_path, file, cell, truth) for cell in (plain, known)}
        shares.append(error["known"] / error["plain"])
    assert max(shares) < 0.9
