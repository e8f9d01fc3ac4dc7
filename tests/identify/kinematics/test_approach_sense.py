"""Lost motion by the sense of approach: on the moving simulated cell with friction, in plain geometry, and in plans."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from counterflex.app.identification.cell_model import model_of
from counterflex.app.proof.truth import truth_of
from counterflex.core.arrays import Float, Int
from counterflex.core.errors import InputError
from counterflex.core.progress import silent
from counterflex.core.units import DEG, URAD
from counterflex.files.cell.cell import read_cell
from counterflex.geometry import pose, rotation
from counterflex.identify.data.changes import AxisPlay
from counterflex.identify.data.dataset import Dataset, of_arrays
from counterflex.identify.geometry.arm_parameters import ArmPriors, arm_model, with_lost_motion
from counterflex.identify.geometry.pose_residuals import PlacedFrame, TrackerResiduals
from counterflex.identify.kinematics import stages as kinematics_stages
from counterflex.identify.kinematics.approach_sense import CHANNEL, as_play, better, in_order, senses
from counterflex.identify.kinematics.held_out import approach_remarks
from counterflex.identify.kinematics.recipe import RECIPE
from counterflex.identify.kinematics.setup import propose, set_up
from counterflex.identify.recipe import Identification
from counterflex.identify.solver.holdout import HeldOut
from counterflex.identify.solver.solve import solve
from counterflex.robot.elasticity.chain import forward
from counterflex.robot.elasticity.play import lost_motion
from counterflex.twin.laboratory.laboratory import laboratory
from counterflex.twin.plant.plant import Plant
from counterflex.twin.plant.slow_move import move
from derivative_check import convergence_order

FILE = read_cell("examples/cells/kr300_d10_ball.toml")
CELL = model_of(FILE)
PLAIN = {"periodic": "off", "folds": 4}
NOISE_M, NOISE_RAD = 15e-6, 30e-6
POSES = 45


@cache
def cube(seed: int, friction: bool) -> Dataset:
    """Poses of the moving simulated cell; each axis comes from a side of its own, from 0.3 deg away."""
    truth, lab = truth_of(FILE, seed), laboratory(seed)
    columns = propose(CELL, POSES, {"seed": seed}).columns
    q = np.stack([columns[f"q{i + 1}_rad"] for i in range(6)], axis=1)
    rng = np.random.default_rng(seed)
    approach = 0.3 * DEG * rng.choice([-1.0, 1.0], q.shape)
    plant = Plant(truth, friction=friction)
    T = np.empty((len(q), 4, 4))
    for i in range(len(q)):
        if not friction:
            T[i] = plant.equilibrium(q[i])
            continue
        plant.reset(q[i] + approach[i])
        move(plant, q[i], move_s=0.3, rest_s=0.2)
        T[i] = plant.tcp_pose()
    return measured(q, pose.inverse(lab.T_base_tracker) @ T @ lab.T_tcp_target, approach, rng)


def measured(q: Float, T: Float, approach: Float | None, rng: np.random.Generator) -> Dataset:
    arrays = {
        "q": q,
        "p_tracker_target": T[:, :3, 3] + NOISE_M * rng.standard_normal((len(q), 3)),
        "R_tracker_target": T[:, :3, :3] @ rotation.exp(NOISE_RAD * rng.standard_normal((len(q), 3))),
    }
    if approach is not None:
        arrays[CHANNEL] = approach
    return of_arrays("poses", "tracker_poses", arrays, {"p_tracker_target": NOISE_M, "R_tracker_target": NOISE_RAD})


@cache
def found(seed: int, friction: bool, play: str) -> Identification:
    return RECIPE.identify(CELL, [cube(seed, friction)], [], {**PLAIN, "play": play}, silent)


def mean_mm(result: Identification) -> float:
    return next(f.value for f in result.headline if f.name == "holdout_mean_mm")


def plays(result: Identification) -> dict[int, AxisPlay]:
    return {c.axis: c for c in result.changes if isinstance(c, AxisPlay)}


@pytest.mark.long
def test_poses_held_out_are_met_better_where_there_is_friction_and_as_well_where_there_is_none() -> None:
    """The pair, on seeds that nothing was set by."""
    assert mean_mm(found(41, True, "known")) < 0.8 * mean_mm(found(41, True, "off"))
    without = found(41, False, "known")
    assert plays(without) == {}
    assert mean_mm(without) == pytest.approx(mean_mm(found(41, False, "off")), rel=1e-9)


@pytest.mark.long
def test_what_is_not_fitted_is_said_with_its_size() -> None:
    """Where nothing says from which side the axes came, the order of the rows is tried, and only named."""
    bare = {k: c for k, c in cube(41, True).channels.items() if k != CHANNEL}
    d = cube(41, True)
    remark = said(d)
    assert "axis 1 +-" in remark
    assert "--set play=known" in remark
    size = float(remark.split("axis 1 +-")[1].split(" ")[0]) * URAD
    known = plays(found(41, True, "known"))[0].play
    soft = CELL.chain.compliance[CELL.chain.torsion[0], 5]
    assert size == pytest.approx(known.friction_nm[0] * soft, rel=0.25)
    assert said(cube(41, False)) == ""
    assert said(replace(d, channels=bare)) == ""  # these rows do not stand in the order of the moves
    changed = replace(d, channels={**d.channels, CHANNEL: replace(d.channel(CHANNEL), values=-d.values(CHANNEL))})
    assert "axis 1" not in said(changed)


@pytest.mark.long
def test_rows_in_their_order_tell_and_chance_does_not() -> None:
    """Links that stay behind by 50 urad in one axis, and clean arms: 40 orders of the rows, no false finding."""
    d = cube(42, False)
    q = d.values("q")
    sense = senses(replace(d, channels={**d.channels, CHANNEL: in_order(d)}))
    assert sense is not None
    behind = q.copy()
    behind[:, 1] -= 50.0 * URAD * sense[:, 1]
    shown = moved_by(d, forward(CELL.chain, behind) @ pose.inverse(forward(CELL.chain, q)))
    bare = replace(shown, channels={k: c for k, c in shown.channels.items() if k != CHANNEL})
    remark = said(bare)
    assert "axis 2 +-" in remark
    assert "(if the rows stand in the order in which they were measured)" in remark
    assert "--set play=order" in remark
    clean = replace(d, channels={k: c for k, c in d.channels.items() if k != CHANNEL})
    rng = np.random.default_rng(3)
    assert sum(said(in_another_order(clean, rng.permutation(len(q)))) != "" for _ in range(40)) == 0


def said(d: Dataset) -> str:
    """What is said of a dataset whose lost motion is not fitted."""
    model = kinematics_stages.model_of_data(
        CELL, [d], kinematics_stages.priors_of(RECIPE.settings), "masses", tied=False
    )
    setup = set_up(CELL, model, [d])
    return " ".join(approach_remarks(setup, solve(setup.parameters, setup.blocks), [d]))


def moved_by(d: Dataset, D: Float) -> Dataset:
    """The measured poses with the tool displaced by (m, 4, 4) in the base."""
    T = laboratory(42).T_base_tracker
    measured_ = pose.inverse(T) @ D @ T @ pose.make(d.values("R_tracker_target"), d.values("p_tracker_target"))
    out = {
        "p_tracker_target": replace(d.channel("p_tracker_target"), values=measured_[:, :3, 3]),
        "R_tracker_target": replace(d.channel("R_tracker_target"), values=measured_[:, :3, :3]),
    }
    return replace(d, channels={**d.channels, **out})


def in_another_order(d: Dataset, order: Int) -> Dataset:
    channels = {
        k: replace(c, values=c.values[order], sigma=None if c.sigma is None else c.sigma[order])
        for k, c in d.channels.items()
    }
    return replace(d, channels=channels)


def test_the_plans_model_then_loses_what_the_cell_loses() -> None:
    """Up and down over a pose of the moving cell, axis by axis: the loop of the tool's place about each axis."""
    result = found(41, True, "known")
    found_plays = plays(result)
    axes = [a for a in (0, 1, 2) if a in found_plays]
    assert len(axes) >= 2
    play = tuple(found_plays[a].play if a in found_plays else None for a in range(6))
    chain = replace(CELL.chain, play=play)
    plant = Plant(truth_of(FILE, 41))
    q = np.array([10.0, -85.0, 110.0, 20.0, 40.0, 10.0]) * DEG
    for axis in axes:
        ends, step = [], 0.3 * DEG * np.eye(6)[axis]
        for side in (-1.0, 1.0):
            plant.reset(q + side * step)
            move(plant, q, move_s=0.4, rest_s=0.3)
            ends.append(float(plant.q_link()[axis]))
        path = np.stack([q + k * step / 20.0 for k in [*range(21), *range(19, -1, -1)]])
        lost = lost_motion(chain, path)[:, axis]
        assert lost[-1] - lost[20] == pytest.approx(ends[1] - ends[0], rel=0.5)


def test_the_order_of_the_rows_says_the_same_as_the_channel() -> None:
    rng = np.random.default_rng(1)
    q = rng.uniform(-0.5, 0.5, (6, 6))
    q[2, 0] = q[1, 0] + 0.001 * DEG  # too short to turn anything round
    data = measured(q, np.tile(np.eye(4), (6, 1, 1)), None, rng)
    channel = in_order(data)
    s = senses(replace(data, channels={**data.channels, CHANNEL: channel}))
    assert s is not None
    np.testing.assert_array_equal(s[0], 0.0)
    np.testing.assert_array_equal(s[1], np.sign(q[1] - q[0]))
    assert s[2, 0] == s[1, 0]
    assert senses(data) is None


def test_nobody_knows_the_sense() -> None:
    data = cube(41, True)
    bare = replace(data, channels={k: c for k, c in data.channels.items() if k != CHANNEL})
    with pytest.raises(InputError, match="direction of approach"):
        RECIPE.identify(CELL, [bare], [], {**PLAIN, "play": "known"}, silent)
    with pytest.raises(InputError, match="off, known, order"):
        RECIPE.identify(CELL, [bare], [], {**PLAIN, "play": "yes"}, silent)
    with pytest.raises(InputError, match="row order"):
        RECIPE.identify(CELL, [replace(bare, settings={"approach": "down"})], [], {**PLAIN, "play": "known"}, silent)


def test_from_one_side_only_nothing_is_found() -> None:
    data = cube(41, True)
    one = replace(data.channels[CHANNEL], values=np.abs(data.values(CHANNEL)))
    changed = replace(data, channels={**data.channels, CHANNEL: one})
    result = RECIPE.identify(CELL, [changed], [], {**PLAIN, "play": "known"}, silent)
    assert any("not visible in any axis" in r for r in result.remarks)


def errors(values: Float, gross: int | None = None) -> HeldOut:
    n = len(values)
    zero = np.zeros(n, dtype=np.int64)
    left_out = np.arange(n) == (-1 if gross is None else gross)
    return HeldOut(zero, np.arange(n), zero, values, values, left_out, ())


def test_better_is_judged_pose_by_pose_and_beyond_chance() -> None:
    rng = np.random.default_rng(3)
    before = rng.uniform(0.5e-4, 5e-4, 200)
    assert better(errors(before - 2e-6), errors(before))[0]
    assert not better(errors(before + 2e-6), errors(before))[0]
    assert not better(errors(before - 2e-6 + 1e-4 * np.tile([1.0, -1.0], 100)), errors(before))[0]
    worse = before - 2e-6
    worse[7] += 1.0
    assert better(errors(worse, gross=7), errors(before))[0]


@pytest.mark.long
def test_what_poses_held_out_do_not_bear_out_is_told_and_left(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kinematics_stages, "better", lambda *_: (False, "no better"))
    result = RECIPE.identify(CELL, [cube(41, True)], [], {**PLAIN, "play": "known"}, silent)
    assert plays(result) == {}
    assert mean_mm(result) == pytest.approx(mean_mm(found(41, True, "off")), rel=1e-9)
    assert sum("was not kept" in r and "no better" in r for r in result.remarks) == 1


def test_derivatives_are_exact() -> None:
    rng = np.random.default_rng(2)
    priors = ArmPriors(length_m=1e-3, angle_rad=1e-3, mass=0.1, periodic_rad=1e-4, sag_rad=1e-3)
    model = with_lost_motion(arm_model(CELL, priors, sag="off"), (0, 2, 5), 1e-4)
    q = rng.uniform(-0.5, 0.5, (5, 6)) + np.array([0.0, -1.5, 1.7, 0.0, 0.8, 0.0])
    arm = model.at(q, rng.choice([-1.0, 0.0, 1.0], q.shape))
    frame = PlacedFrame(np.eye(4), np.full(6, -1, dtype=np.int64))
    T = forward(CELL.nominal_chain, q)
    block = TrackerResiduals(
        "b", np.arange(5), np.full((5, 6), 1e-4), arm, frame, frame, T[:, :3, 3] + 1e-4, T[:, :3, :3]
    )
    x = model.parameters.nominal + 1e-4 * rng.standard_normal(len(model.parameters))
    assert np.all(convergence_order(block, x, 1e-2)[-3:] > 1.5)


@pytest.mark.parametrize("compliance", [2e-7, 0.0])
def test_what_is_written_loses_half_to_either_side(compliance: float) -> None:
    """Axis 1 stands upright: no weight leans on it, whatever it is made of."""
    chain = CELL.chain
    axis1 = chain.names.index("axis1")
    soft = np.array(chain.compliance)
    soft[axis1, 5] = compliance
    q = np.tile([0.0, -1.5, 1.7, 0.0, 0.8, 0.0], (41, 1))
    q[:, 0] = 1e-3 * np.array([*range(21), *range(19, -1, -1)])
    own = as_play(replace(chain, compliance=soft), 0, 40.0 * URAD, compliance, q)
    assert own is not None
    lost = lost_motion(replace(chain, compliance=soft, play=(own.play, *(None,) * 5)), q)[:, 0]
    assert lost[20] == pytest.approx(-40.0 * URAD, rel=1e-3)
    assert lost[40] == pytest.approx(40.0 * URAD, rel=1e-3)


def test_a_rigid_axis_under_weight_has_no_place_for_it() -> None:
    q = np.array([[0.0, -1.0, 1.0, 0.0, 0.8, 0.0]])
    assert as_play(CELL.chain, 1, 40.0 * URAD, 0.0, q) is None
