"""The posture of a program through files: what is written, who takes it from there, what it gains on the twin."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from counterflex.app import posture
from counterflex.app.inputs import read_job, setting_of
from counterflex.app.proof import simulate
from counterflex.app.proof.judge import judge, reference_of
from counterflex.app.proof.truth import truth_of
from counterflex.core.errors import InputError, ReachError
from counterflex.core.units import DEG
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.twin.truth.family import FAMILIES

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
CELL, GROOVE = EXAMPLES / "cells" / "kr300_d16_small.toml", EXAMPLES / "programs" / "groove.ngc"
SEED = 203
"""Of the tuning seeds 200 to 204 the one on which the posture gains least."""


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("posture") / "out"
    posture.run(GROOVE, CELL, out)
    return out


def test_the_cell_file_has_the_posture_and_all_else_of_before(done: Path) -> None:
    summary = json.loads((done / "summary.json").read_text())
    setting = setting_of(read_cell(done / "cell.toml"))
    chosen = summary["chosen"]
    assert setting.branch == chosen["branch"]
    assert setting.rotation_about_tool_rad == pytest.approx(chosen["rotation_about_tool_deg"] * DEG)
    assert chosen["deflection_um"] < summary["present"]["deflection_um"]
    before, after = (path.read_text().splitlines() for path in (CELL, done / "cell.toml"))
    changed = [line for line, other in zip(before, after, strict=True) if line != other]
    assert all(line.split(" ")[0] in ("shoulder", "elbow", "wrist", "rotation_about_tool_deg") for line in changed)


def test_the_map_has_the_chosen_posture_in_it(done: Path) -> None:
    summary = json.loads((done / "summary.json").read_text())
    rows = [line.split(",") for line in (done / posture.MAP).read_text().splitlines()]
    column = rows[0].index(f"{summary['chosen']['branch']} um")
    by_rotation = {float(row[0]): row[column] for row in rows[1:]}
    assert len(by_rotation) == 72
    assert float(by_rotation[summary["chosen"]["rotation_about_tool_deg"]]) >= summary["bound_um"]


def _path_error_m(cell: Cell) -> float:
    job, truth = read_job(GROOVE, cell), truth_of(read_cell(CELL), SEED, FAMILIES["wide"])
    record = simulate.machine(job, cell, truth)
    return judge(reference_of(job, cell), record, record.stock).variant.path.path.p997_m


def test_the_uncompensated_program_is_more_accurate_in_the_chosen_posture(done: Path) -> None:
    """On the simulated cell, of which the choice knows what the catalogue says."""
    assert _path_error_m(read_cell(done / "cell.toml")) < 0.9 * _path_error_m(read_cell(CELL))


def test_a_program_that_cuts_nothing_has_no_posture(tmp_path: Path) -> None:
    program = tmp_path / "air.ngc"
    program.write_text("G21 G90\nT1 M6\nM3 S13000\nG0 X0 Y0 Z100\nG1 X10 F1000\nM2\n")
    with pytest.raises(InputError, match="cuts nothing"):
        posture.run(program, CELL, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_part_out_of_reach_says_the_line_of_the_program(tmp_path: Path) -> None:
    far = tmp_path / "cell.toml"
    far.write_text(CELL.read_text().replace("x_mm = 1350", "x_mm = 3350"))
    with pytest.raises(ReachError, match=r"groove\.ngc:\d+, at .*no posture reaches the point"):
        posture.run(GROOVE, far, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_walls_and_floors_are_judged_by_their_own_deflection() -> None:
    cell = read_cell(CELL)
    both, wall, floor = (
        posture.PostureOf.of(GROOVE, cell, surface=surface).chosen.best.deflection_m
        for surface in ("both", "wall", "floor")
    )
    assert np.max(wall) <= np.max(both) * 1.2
    assert np.max(floor) < np.max(both)
