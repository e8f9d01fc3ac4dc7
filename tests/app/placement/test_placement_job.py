"""The place of a program through files: what is written, what it gains on the twin, what is refused."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from counterflex.app.inputs import read_job
from counterflex.app.placement import placement
from counterflex.app.placement.region import Wish
from counterflex.app.proof import simulate
from counterflex.app.proof.judge import judge, reference_of
from counterflex.app.proof.truth import truth_of
from counterflex.core.errors import InputError, ReachError
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.twin.truth.family import FAMILIES

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
CELL, GROOVE = EXAMPLES / "cells" / "kr300_d16_small.toml", EXAMPLES / "programs" / "groove.ngc"
SEEDS = (203, 204)
"""The stiffest and the softest of the tuning seeds 200 to 205."""


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("placement") / "out"
    placement.run(GROOVE, CELL, out, count=64)
    return out


@pytest.mark.long
def test_the_cell_file_has_the_place_and_all_else_of_before(done: Path) -> None:
    summary = json.loads((done / "summary.json").read_text())
    cell, chosen = read_cell(done / "cell.toml"), summary["chosen"]
    assert [cell.part.x_mm, cell.part.y_mm, cell.part.z_mm] == [chosen[key] for key in ("x_mm", "y_mm", "z_mm")]
    assert cell.part.a_deg == chosen["a_deg"]
    assert cell.tables.posture.branch == chosen["branch"]
    assert cell.part.stock == read_cell(CELL).part.stock
    rows = list(csv.DictReader((done / placement.TABLE).read_text().splitlines()))
    assert len(rows) == summary["candidates"] == 64
    assert sum(row["pareto"] == "yes" for row in rows) == summary["pareto"] > 0
    assert sum(row["refused"] != "" for row in rows) == sum(summary["refused"].values())


def test_the_place_takes_two_fifths_off_the_path_error_on_simulated_cells(done: Path) -> None:
    def error_m(cell: Cell) -> float:
        job, total = read_job(GROOVE, cell), 0.0
        for seed in SEEDS:
            record = simulate.machine(job, cell, truth_of(read_cell(CELL), seed, FAMILIES["wide"]))
            total += judge(reference_of(job, cell), record, record.stock).variant.path.path.p997_m
        return total

    assert error_m(read_cell(done / "cell.toml")) < 0.6 * error_m(read_cell(CELL))


def test_a_region_out_of_reach_says_what_refused_how_many(tmp_path: Path) -> None:
    wish = Wish((6000.0, 7000.0, 0.0, 100.0, 0.0, 100.0))
    with pytest.raises(ReachError, match="none of the places") as caught:
        placement.run(GROOVE, CELL, tmp_path / "out", count=64, wish=wish)
    assert "of 64 refused: 64 out of reach" in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_an_empty_region_is_refused(tmp_path: Path) -> None:
    wish = Wish((1000.0, 900.0, 0.0, 100.0, 0.0, 100.0))
    with pytest.raises(InputError, match="empty along x"):
        placement.run(GROOVE, CELL, tmp_path / "out", wish=wish)
