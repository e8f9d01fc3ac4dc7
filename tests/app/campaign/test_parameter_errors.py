"""The comparison with the truth: zero where the cell file is the truth, blind to what any use sets up anew."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from counterflex.app.campaign.parameter_errors import parameter_errors, placement_error, true_edge_force
from counterflex.app.proof.truth import cutting_truth, knowing, truth_of
from counterflex.core.arrays import Float
from counterflex.core.units import MM, UM
from counterflex.cutting.coefficients import edge_force
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.geometry import pose, rotation


@pytest.fixture(scope="module")
def cell(small: Path) -> Cell:
    return read_cell(small)


@pytest.fixture(scope="module")
def joints() -> Float:
    rng = np.random.default_rng(2)
    centre = np.array([0.0, -95.0, 118.0, -170.0, 35.0, 165.0])
    return np.radians(centre + rng.uniform(-12.0, 12.0, (10, 6)))


def test_a_truth_that_agrees_leaves_nothing(cell: Cell, joints: Float) -> None:
    rows = {row.name: row for row in parameter_errors(cell, cell, truth_of(cell, None), joints)}
    share, worst, place = (row for row in rows.values() if row.group == "use")
    assert share.before == share.identified < 0.5
    assert worst.identified < 10.0
    assert place.identified < 15.0
    for row in rows.values():
        if row.true is not None:
            assert row.before == pytest.approx(row.true, rel=1e-9)


def test_a_cell_that_was_told_the_truth_is_nearer_to_it(cell: Cell, joints: Float) -> None:
    truth = truth_of(cell, 3)
    chain, law = knowing(cell, truth)
    told = replace(cell, chain=chain)
    told.__dict__["force_law"] = law
    rows = parameter_errors(cell, told, truth, joints)
    for row in rows:
        if row.group == "use":
            assert row.identified < 0.3 * row.before
        if row.name == "kc1.1":
            assert row.identified == pytest.approx(row.true)
            assert row.before != pytest.approx(row.true)


def test_places_forgive_a_moved_base_and_another_tool() -> None:
    rng = np.random.default_rng(4)
    turns = rotation.exp(rng.uniform(-1.0, 1.0, (20, 3)))
    Ts = np.tile(np.eye(4), (20, 1, 1))
    Ts[:, :3, :3], Ts[:, :3, 3] = turns, rng.uniform(-1.0, 1.0, (20, 3))
    T_moved = pose.make(rotation.exp(np.array([0.01, -0.02, 0.015])), np.array([0.003, 0.001, -0.002]))
    tool = pose.make(p=np.array([0.002, -0.001, 0.004]))
    assert placement_error(Ts, T_moved @ Ts @ tool) < 0.02 * UM
    bent = T_moved @ Ts @ tool
    noise = 0.1 * MM * rng.standard_normal((20, 3))
    bent[:, :3, 3] += noise
    found = placement_error(Ts, bent)
    assert 0.4 * MM * 0.1 < found <= float(np.mean(np.linalg.norm(noise, axis=1)))


def test_true_force_is_the_law_without_ploughing(cell: Cell) -> None:
    chips = np.array([0.01, 0.05, 0.2]) * MM
    truth = cutting_truth(cell.force_law)
    np.testing.assert_allclose(true_edge_force(truth, chips), edge_force(cell.force_law, chips), rtol=1e-12)
    ploughing = replace(truth, edge_n_m=(2000.0, 1000.0, 0.0), edge_onset_m=1e-6)
    more = true_edge_force(ploughing, chips) - true_edge_force(truth, chips)
    np.testing.assert_allclose(more, np.tile([2000.0, 1000.0, 0.0], (3, 1)), rtol=1e-4)
