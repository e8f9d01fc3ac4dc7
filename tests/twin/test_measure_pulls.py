"""Pulls and cubes at the simulated cell: what is measured, its noise, and that the motion's history shows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from counterflex.core.errors import InputError
from counterflex.geometry import pose
from counterflex.robot.model.description import EndEffector, Robot
from counterflex.twin.laboratory import cubes as measure_cubes, pulls as measure_pulls
from counterflex.twin.laboratory.laboratory import laboratory
from counterflex.twin.laboratory.measurements import measurement
from counterflex.twin.plant.plant import Plant
from counterflex.twin.truth.nominal import nominal_truth
from counterflex.twin.truth.perturb import perturbed
from counterflex.twin.truth.truth import CuttingTruth, Truth

Q = np.array([[0.2, -1.3, 1.6, 0.4, 0.9, 0.3], [-0.3, -1.1, 1.7, -0.5, 0.8, -0.2]])
F = np.array([[0.0, 700.0, 0.0], [500.0, 0.0, -400.0]])
REQUEST = {f"q{i + 1}_rad": Q[:, i] for i in range(6)} | {f"f{c}_n": F[:, i] for i, c in enumerate("xyz")}


@pytest.fixture(scope="module")
def truth(robot: Robot, end_effector: EndEffector, cutting: CuttingTruth) -> Truth:
    return perturbed(nominal_truth(robot, end_effector, cutting), 3)


def test_registered() -> None:
    assert measurement("pulls") is measure_pulls.measure
    assert measurement("cubes") is measure_cubes.measure


def test_quiet_pull_is_the_difference_of_two_equilibria(truth: Truth) -> None:
    quiet = replace(laboratory(0), tracker_m=0.0, tracker_rad=0.0)
    got = measure_pulls.measure(truth, quiet, REQUEST, {"history": "relaxed", "axes": "base"})
    plant = Plant(truth)
    for row in range(2):
        load = np.concatenate([F[row], np.zeros(3)])
        wanted = pose.difference(plant.equilibrium(Q[row]), plant.equilibrium(Q[row], load))
        # The cable pulls with what a weight really weighs: 0.2 % beside what was noted down.
        np.testing.assert_allclose(got.channels["d_tcp_base"][row], wanted, rtol=0.02, atol=5e-6)
        assert got.channels["d_tcp_base"][row, :3] @ F[row] > 0.0


def test_target_in_the_axes_of_the_tracker(truth: Truth) -> None:
    lab = replace(laboratory(5), tracker_m=0.0, tracker_rad=0.0)
    base = measure_pulls.measure(truth, lab, REQUEST, {"history": "relaxed", "axes": "base"}).channels["d_tcp_base"]
    seen = measure_pulls.measure(truth, lab, REQUEST, {"history": "relaxed"}).channels["d_tracker_target"]
    R = lab.T_base_tracker[:3, :3]
    np.testing.assert_allclose(seen[:, 3:] @ R.T, base[:, 3:], atol=1e-9)
    assert np.max(np.abs(seen[:, :3] @ R.T - base[:, :3])) > 5e-6  # the target sits beside the tool tip
    np.testing.assert_allclose(seen[:, :3] @ R.T, base[:, :3], atol=3e-4)


def test_noise_is_as_stated_and_of_the_session(truth: Truth) -> None:
    many = {key: np.tile(values[:1], 300) for key, values in REQUEST.items()}
    still = {"history": "relaxed", "readings": 4}
    lab = laboratory(1)
    got = measure_pulls.measure(truth, lab, many, still)
    spread = np.std(got.channels["d_tracker_target"], axis=0)
    sigma = np.asarray(got.sigma["d_tracker_target"])
    np.testing.assert_allclose(sigma[0], lab.tracker_m / np.sqrt(2.0))
    np.testing.assert_allclose(spread[3:], sigma[3:], rtol=0.2)
    other = measure_pulls.measure(truth, replace(lab, session="b"), many, still)
    assert not np.allclose(other.channels["d_tracker_target"], got.channels["d_tracker_target"], atol=1e-9)
    assert len(np.unique(got.group)) == 1


def test_approaching_again_takes_out_friction(truth: Truth) -> None:
    """The pair: held still, the arm looks stiffer by what dry friction holds; approached again it does not."""
    slack = tuple(replace(d, dead_band_rad=0.0) for d in truth.drives)
    dry = replace(truth, drives=slack)
    quiet = replace(laboratory(0), tracker_m=0.0, tracker_rad=0.0)
    one = {key: values[:1] for key, values in REQUEST.items()}
    found = {
        history: measure_pulls.measure(dry, quiet, one, {"history": history, "axes": "base"}).channels["d_tcp_base"][0]
        for history in measure_pulls.HISTORIES
    }
    again, held = (np.linalg.norm((found[h] - found["relaxed"])[:3]) for h in ("approached again", "held"))
    assert held > 20e-6
    assert again < 0.3 * held


def test_cubes_move_as_their_bodies_do(truth: Truth) -> None:
    pairs = ["base/axis1", f"axis1/{truth.bodies[-1].name}"]
    got = measure_cubes.measure(truth, laboratory(0), REQUEST, {"history": "relaxed", "pairs": pairs})
    assert got.settings["pairs"] == pairs
    assert got.channels["pair"][:, 0].tolist() == [1.0, 2.0, 1.0, 2.0]
    assert np.all(got.channels["d_before_base"][::2] == 0.0)  # the foundation stands still
    assert np.linalg.norm(got.channels["d_after_base"][1, :3]) > 5.0 * np.linalg.norm(
        got.channels["d_after_base"][0, :3]
    )
    assert got.group.tolist() == [got.group[0]] * 2 + [got.group[2]] * 2


def test_bad_requests_are_refused(truth: Truth) -> None:
    with pytest.raises(InputError, match="lacks a column"):
        measure_pulls.measure(truth, laboratory(0), {"q1_rad": np.zeros(1)}, {})
    with pytest.raises(InputError, match="setting of the pulls"):
        measure_pulls.measure(truth, laboratory(0), REQUEST, {"history": "yesterday"})
    with pytest.raises(InputError, match="pair of cubes"):
        measure_cubes.measure(truth, laboratory(0), REQUEST, {"history": "relaxed", "pairs": ["axis2/axis1"]})
