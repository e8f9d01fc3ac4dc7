"""What instruments on the simulated cell see: poses of bodies, loads through sections, slow motions to rest."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.geometry import pose, rotation
from counterflex.twin.laboratory.laboratory import Measured, Measurement, laboratory
from counterflex.twin.laboratory.measurements import MODULES, measurement
from counterflex.twin.plant.plant import Plant
from counterflex.twin.plant.slow_move import move
from counterflex.twin.truth.truth import Truth

SENSOR = "haehn2020_sensor"
LOAD = np.array([120.0, -340.0, 260.0, 14.0, -22.0, 9.0])


def rigid_frames(truth: Truth, q: Float) -> dict[str, Float]:
    frames, T = {}, np.eye(4)
    for body in truth.bodies:
        angle = body.offset_rad + (body.sign * q[body.joint] if body.joint is not None else 0.0)
        T = T @ body.T_prev_seg @ pose.make(rotation.about_z(angle))
        frames[body.name] = T
    return frames


def by_statics(truth: Truth, plant: Plant, name: str, load: Float) -> Float:
    """Weight of every body from here on and the load on the tip, about the body's origin in its axes."""
    here = plant.body_pose(name)
    origin, R = here[:3, 3], here[:3, :3]
    names = [b.name for b in truth.bodies]
    force, moment = load[:3].copy(), load[3:] + np.cross(plant.tcp_pose()[:3, 3] - origin, load[:3])
    for body in truth.bodies[names.index(name) :]:
        weight = body.mass_kg * truth.gravity_base
        com = (plant.body_pose(body.name) @ np.append(body.p_seg_com, 1.0))[:3]
        force, moment = force + weight, moment + np.cross(com - origin, weight)
    return np.concatenate([R.T @ force, R.T @ moment])


def test_a_stiff_chain_stands_where_rigid_kinematics_has_it(truth: Truth, poses_rad: Float) -> None:
    stiff = replace(truth, bodies=tuple(replace(b, compliance=1e-6 * b.compliance) for b in truth.bodies))
    drives = tuple(replace(d, dead_band_rad=0.0) for d in truth.drives)
    plant = Plant(replace(stiff, drives=drives))
    for q in poses_rad:
        plant.equilibrium(q, LOAD)
        for name, T in rigid_frames(stiff, q).items():
            np.testing.assert_allclose(plant.body_pose(name), T, atol=2e-8)


def test_section_wrench_at_rest_is_load_and_weight(truth: Truth, poses_rad: Float) -> None:
    plant = Plant(truth)
    for q in poses_rad:
        for load in (np.zeros(6), LOAD):
            plant.equilibrium(q, load)
            for body in truth.bodies:
                np.testing.assert_allclose(
                    plant.section_wrench(body.name), by_statics(truth, plant, body.name, load), rtol=1e-6, atol=1e-4
                )


def test_section_wrench_after_a_slow_load_is_that_of_rest(truth: Truth, poses_rad: Float) -> None:
    plant = Plant(truth)
    plant.reset(poses_rad[2])
    move(plant, poses_rad[2], LOAD, move_s=1.0, rest_s=0.5)
    found = plant.section_wrench(SENSOR)
    np.testing.assert_allclose(found, by_statics(truth, plant, SENSOR, LOAD), rtol=1e-3, atol=0.2)


def test_section_wrench_feels_inertia(truth: Truth, poses_rad: Float) -> None:
    """Newton's law for what hangs behind the flange sensor, against the acceleration of its centres of gravity."""
    plant = Plant(truth)
    q = poses_rad[1]
    plant.reset(q)
    behind = truth.bodies[[b.name for b in truth.bodies].index(SENSOR) :]

    def momentum_places() -> Float:
        return np.array([(plant.body_pose(b.name) @ np.append(b.p_seg_com, 1.0))[:3] for b in behind])

    places, wrenches, frames = [], [], []
    for k in range(240):
        t = k * plant.step_s
        ref = q + 0.02 * np.array([1.0, 0, 0, 0, 0, 0]) * (1.0 - np.cos(2 * np.pi * 5.0 * t))
        rate = 0.02 * np.array([1.0, 0, 0, 0, 0, 0]) * 2 * np.pi * 5.0 * np.sin(2 * np.pi * 5.0 * t)
        plant.step(ref, rate, np.zeros(6))
        places.append(momentum_places())
        wrenches.append(plant.section_wrench(SENSOR)[:3])
        frames.append(plant.body_pose(SENSOR)[:3, :3])
    accelerations = np.diff(np.array(places), 2, axis=0) / plant.step_s**2
    weights = np.array([b.mass_kg for b in behind])
    expected = np.einsum("b,kbi->ki", weights, truth.gravity_base - accelerations)
    shown = np.einsum("kij,kj->ki", np.array(frames), np.array(wrenches))[1:-1]
    swing = np.ptp(expected[20:], axis=0).max()
    assert swing > 300.0
    # a central second difference sits half a step beside the acceleration of the last step
    assert np.max(np.abs(shown[20:] - expected[20:])) < 0.05 * swing


def test_a_slow_move_leaves_the_lost_motion_of_play_and_friction(truth: Truth, poses_rad: Float) -> None:
    """The axis comes to the same command from both sides and stands 2 b + friction's part apart on the link side."""
    free = replace(truth, gravity_base=np.zeros(3), counterbalance=None)
    plant = Plant(free)
    q = poses_rad[2]
    stands = []
    for side in (+1.0, -1.0):
        plant.reset(q + side * np.array([2e-3, 0, 0, 0, 0, 0]))
        move(plant, q - side * np.array([2e-3, 0, 0, 0, 0, 0]))
        move(plant, q)
        stands.append(plant.q_link()[0])
    drive, body = free.drives[0], free.bodies[0]
    limit = 2.0 * (drive.dead_band_rad + sum(drive.link_friction_nm) * body.compliance[5])
    lost = abs(stands[0] - stands[1])
    assert 0.4 * limit < lost < 1.05 * limit
    smooth = Plant(free, friction=False)
    ends = []
    for side in (+1.0, -1.0):
        smooth.reset(q + side * np.array([2e-3, 0, 0, 0, 0, 0]))
        move(smooth, q, rest_s=1.5)
        ends.append(smooth.q_link()[0])
    assert abs(ends[0] - ends[1]) < 0.02 * limit


def test_bodies_and_measurements_that_are_not_there(truth: Truth) -> None:
    plant = Plant(truth)
    with pytest.raises(InputError, match="no such body.*axis1"):
        plant.body_pose("nose")
    with pytest.raises(InputError, match="cannot measure"):
        measurement("weather")
    for kind in MODULES:
        assert callable(measurement(kind))


@pytest.mark.parametrize(
    ("request_of", "said"),
    [
        ({"fx_n": np.ones(2), "fy_n": np.ones(2)}, "lacks a column"),
        ({"fx_n": np.ones(0), "fy_n": np.ones(0), "fz_n": np.ones(0)}, "no rows"),
        ({"fx_n": np.ones(2), "fy_n": np.ones(3), "fz_n": np.ones(2)}, "fy_n"),
        ({"fx_n": np.ones(2), "fy_n": np.full(2, np.nan), "fz_n": np.ones(2)}, "fy_n"),
    ],
)
def test_the_columns_of_a_request_are_read_in_one_place_and_refused_there(
    request_of: dict[str, Float], said: str
) -> None:
    take = Measurement(lambda order: cast(Measured, order.force))
    with pytest.raises(InputError, match=said):
        take(cast(Truth, None), laboratory(0), request_of, {})


@pytest.mark.parametrize("kind", MODULES)
def test_every_kind_of_measurement_has_the_same_head(kind: str) -> None:
    assert isinstance(measurement(kind), Measurement)
