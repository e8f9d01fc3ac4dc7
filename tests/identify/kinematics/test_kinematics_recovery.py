"""Recipe kinematics on the simulated cell: held-out poses, mixed data, use of the result, and bad data."""

from __future__ import annotations

import contextlib
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from counterflex.app.identification.cell_model import model_of
from counterflex.app.proof.truth import truth_of
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError, ReachError
from counterflex.core.progress import silent
from counterflex.files.cell.cell import read_cell
from counterflex.geometry import rotation
from counterflex.identify.data.changes import BodyMass, Calibration
from counterflex.identify.data.dataset import Dataset, of_arrays
from counterflex.identify.design.pose_candidates import measurable, seen
from counterflex.identify.kinematics.recipe import RECIPE
from counterflex.identify.kinematics.setup import propose
from counterflex.identify.recipe import Identification
from counterflex.robot.elasticity.chain import ElasticChain, forward
from counterflex.robot.kinematics.inverse import inverse
from counterflex.robot.model.calibration import calibrated
from counterflex.twin.laboratory import (
    distances as measure_distances,
    planes as measure_planes,
    tracker_points as measure_tracker_points,
    tracker_poses as measure_tracker_poses,
)
from counterflex.twin.laboratory.laboratory import Measured, laboratory
from counterflex.twin.plant.plant import Plant

FILE = read_cell("examples/cells/kr300_d10_ball.toml")
CELL = model_of(FILE)


def _dataset(kind: str, measured: Measured) -> Dataset:
    arrays = {k: rotation.exp(v) if k.startswith("R_") else v for k, v in measured.channels.items()}
    return of_arrays(kind, kind, arrays, measured.sigma, group=measured.group, settings=measured.settings)


@cache
def _poses(seed: int, count: int = 45) -> Dataset:
    request = propose(CELL, count, {"seed": seed}).columns
    return _dataset(
        "tracker_poses", measure_tracker_poses.measure(truth_of(FILE, seed), laboratory(seed), request, {}, silent)
    )


@cache
def _found(seed: int) -> Identification:
    return RECIPE.identify(CELL, [_poses(seed)], [], {"folds": 3}, silent)


def _chain(found: Identification) -> ElasticChain:
    """The elastic chain with what was found."""
    masses = {c.segment: c.mass_kg for c in found.changes if isinstance(c, BodyMass)}
    moves = {c.segment: c.displacement for c in found.changes if isinstance(c, Calibration)}
    robot, end_effector = calibrated(CELL.nominal_robot, CELL.nominal_end_effector, moves)
    return ElasticChain.build(
        replace(robot, segments=tuple(replace(s, mass_kg=masses.get(s.name, s.mass_kg)) for s in robot.segments)),
        replace(
            end_effector,
            segments=tuple(replace(s, mass_kg=masses.get(s.name, s.mass_kg)) for s in end_effector.segments),
        ),
    )


@cache
def _near_part(count: int) -> Float:
    """Joint angles with the tool within 0.4 m and 45 deg of the part."""
    return measurable(CELL, count, np.random.default_rng(11), around_part=1.0)


@pytest.mark.long
@pytest.mark.parametrize("seed", [0, 1])
def test_poses_not_used_are_predicted_near_what_play_and_friction_leave(seed: int) -> None:
    mean = _found(seed).headline[0]
    assert mean.name == "holdout_mean_mm"
    assert mean.nominal is not None
    # Friction and play move the tool of this truth by 0.1 to 0.2 mm between two approaches of a pose.
    assert mean.value < 0.25
    assert mean.value < 0.5 * mean.nominal


@pytest.mark.parametrize("seed", [0, 1])
def test_commands_by_the_calibrated_inverse_meet_their_poses_better(seed: int) -> None:
    chain, truth = _chain(_found(seed)), truth_of(FILE, seed)
    plant = Plant(truth, friction=False)
    errors: dict[str, list[Float]] = {"nominal": [], "calibrated": []}
    for near in _near_part(12):
        target = forward(CELL.nominal_chain, near)
        for name, arm, gravity in (("nominal", CELL.nominal_chain, False), ("calibrated", chain, True)):
            q = inverse(arm, target, near, gravity=gravity).q
            errors[name].append(plant.equilibrium(q)[:3, 3] - target[:3, 3])
    # A constant offset of base and tool is not seen with free frames: what is judged is the change over the poses.
    left = {name: np.linalg.norm(np.array(e) - np.mean(e, axis=0), axis=1).mean() for name, e in errors.items()}
    assert left["calibrated"] < 0.6 * left["nominal"]
    whole = {name: np.linalg.norm(np.array(e), axis=1).mean() for name, e in errors.items()}
    assert whole["calibrated"] < 0.4 * whole["nominal"]


@pytest.mark.long
def test_points_of_three_reflectors_do_nearly_as_well_as_poses() -> None:
    request = propose(CELL, 45, {"seed": 0}).columns
    measured = measure_tracker_points.measure(truth_of(FILE, 0), laboratory(0), request, {"reflectors": 3}, silent)
    found = RECIPE.identify(CELL, [_dataset("tracker_points", measured)], [], {"folds": 3}, silent)
    assert found.headline[0].nominal is not None
    assert found.headline[0].value < 0.6 * found.headline[0].nominal


@pytest.mark.long
def test_distances_and_planes_alone_and_mixed_with_poses() -> None:
    truth, lab = truth_of(FILE, 0), laboratory(0)
    request = {k: v[:46] for k, v in propose(CELL, 60, {"seed": 3}).columns.items()}
    bar = _dataset("distances", measure_distances.measure(truth, lab, request, {}, silent))
    z = float(CELL.T_base_part[2, 3]) + 0.1
    q = []
    for near in _near_part(20):
        target = forward(CELL.nominal_chain, near)
        target[2, 3] = z
        with contextlib.suppress(ReachError):
            q.append(inverse(CELL.nominal_chain, target, near).q)
    assert len(q) >= 12
    table = {"planes": [[0.0, 0.0, z, 0.0, 0.0, 1.0]]}
    touched = measure_planes.measure(truth, lab, {f"q{i + 1}_rad": np.array(q)[:, i] for i in range(6)}, table, silent)
    plane = _dataset("planes", touched)
    alone = RECIPE.identify(CELL, [bar, plane], [], {"folds": 3}, silent)
    assert alone.headline[0].nominal is not None
    assert alone.headline[0].value < alone.headline[0].nominal
    both = RECIPE.identify(CELL, [_poses(0), bar, plane], [], {"folds": 3}, silent)
    assert both.headline[0].nominal is not None
    assert both.headline[0].value < 0.6 * both.headline[0].nominal
    assert {c.segment for c in both.changes if isinstance(c, Calibration)} >= {"axis1", "axis6", "tcp"}


def test_gross_errors_in_a_twentieth_of_the_poses_do_no_harm_and_are_named() -> None:
    data = _poses(0)
    p = data.values("p_tracker_target").copy()
    p[::20] += np.array([0.3, -0.3, 0.26])
    old = data.channel("p_tracker_target")
    bad = replace(data, channels={**data.channels, "p_tracker_target": replace(old, values=p)})
    found = RECIPE.identify(CELL, [bad], [], {"folds": 3}, silent)
    assert found.headline[0].value < 1.3 * _found(0).headline[0].value + 0.02
    assert sum("is off by" in r for r in found.remarks) >= 3
    assert {o.row for o in found.fits["kinematics"].outliers[:3]} == {0, 20, 40}


def test_repeated_and_too_few_poses_are_refused() -> None:
    data = _poses(0)
    one = data.rows(np.arange(len(data)) < 3)
    with pytest.raises(InputError, match="too few different poses"):
        RECIPE.identify(CELL, [one], [], {}, silent)
    with pytest.raises(InputError, match="unknown treatment"):
        RECIPE.identify(CELL, [data], [], {"sag": "much"}, silent)
    with pytest.raises(InputError, match="free or known"):
        RECIPE.identify(CELL, [data], [], {"frames": "held"}, silent)


def test_proposed_poses_are_within_limits_seen_and_better_than_random() -> None:
    lab = laboratory(0)
    rng = np.random.default_rng(0)
    tracker = lab.T_base_tracker[:3, 3]
    q = measurable(CELL, 40, rng, tracker=tracker, p_tcp_target=lab.T_tcp_target[:3, 3])
    limits = CELL.nominal_chain.joint_limits_rad
    assert np.all((q >= limits[:, 0]) & (q <= limits[:, 1]))
    assert np.all(seen(CELL.nominal_chain, q, tracker, lab.T_tcp_target[:3, 3]))
    tip = forward(CELL.nominal_chain, q)[:, :3, 3]
    assert np.all(tip[:, 2] > 0.2)
    few, many = propose(CELL, 15, {}).expected, propose(CELL, 45, {}).expected
    assert all(many[name] <= few[name] * 1.001 for name in few)
    with pytest.raises(InputError, match="too few poses"):
        propose(CELL, 3, {})


def test_a_tracker_behind_the_arm_sees_nothing() -> None:
    q = np.array([[0.0, -1.5, 1.5, 0.0, 0.6, 0.0]])
    tip = forward(CELL.nominal_chain, q)[0, :3, 3]
    behind = np.array([-3.0, 0.0, 1.2])
    beside = tip + np.array([2.0, 2.0, 0.5])
    assert not seen(CELL.nominal_chain, q, behind, np.zeros(3))[0]
    assert seen(CELL.nominal_chain, q, beside, np.zeros(3))[0]
