"""Statics of the twin against closed forms written here, and against Pinocchio."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from counterflex.core.arrays import Float
from counterflex.geometry import pose, rotation
from counterflex.twin.plant.mjcf import MOTOR, coordinates
from counterflex.twin.plant.plant import Plant
from counterflex.twin.truth.truth import Body, CuttingTruth, Truth


def cartesian_compliance(truth: Truth, q: Float) -> Float:
    """``C = sum_i J_i diag(c_i) J_i^T`` (6, 6) at the tip in base axes, from the undeformed chain."""
    frames, T = [], np.eye(4)
    for body in truth.bodies:
        angle = body.offset_rad + (body.sign * q[body.joint] if body.joint is not None else 0.0)
        T = T @ body.T_prev_seg @ pose.make(rotation.about_z(angle))
        frames.append(T)
    tip = (T @ truth.T_last_tcp)[:3, 3]
    C = np.zeros((6, 6))
    for body, frame in zip(truth.bodies, frames, strict=True):
        R = frame[:3, :3]
        arm = tip - (frame @ np.append(body.p_seg_bearing, 1.0))[:3]
        J = np.zeros((6, 6))
        J[:3, :3] = R
        J[:3, 3:] = np.cross(R.T, arm).T
        J[3:, 3:] = R
        C += J @ np.diag(body.compliance) @ J.T
    return C


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_deflection_agrees_with_the_closed_form(weightless: Truth, poses_rad: Float, axis: int) -> None:
    plant = Plant(weightless, friction=False)
    w = np.zeros(6)
    w[axis] = 750.0
    for q in poses_rad:
        unloaded, loaded = plant.equilibrium(q), plant.equilibrium(q, w)
        expected = cartesian_compliance(weightless, q) @ w
        found = pose.difference(unloaded, loaded)
        assert np.linalg.norm(found[:3] - expected[:3]) < 0.01 * np.linalg.norm(expected[:3])
        assert np.linalg.norm(found[3:] - expected[3:]) < 0.02 * np.linalg.norm(expected[3:])


def test_deflection_with_translations_and_moved_bearings(weightless: Truth, poses_rad: Float) -> None:
    soft = tuple(
        replace(
            b,
            compliance=b.compliance + np.array([4e-9, 3e-9, 2e-9, 0, 0, 0]),
            p_seg_bearing=np.array([0.02, -0.01, 0.03]),
        )
        for b in weightless.bodies
    )
    truth = replace(weightless, bodies=soft)
    plant = Plant(truth, friction=False)
    w = np.array([100.0, -200.0, 150.0, 20.0, -10.0, 5.0])
    for q in poses_rad:
        found = pose.difference(plant.equilibrium(q), plant.equilibrium(q, w))
        expected = cartesian_compliance(truth, q) @ w
        assert np.linalg.norm(found[:3] - expected[:3]) < 0.01 * np.linalg.norm(expected[:3])


def test_settled_motion_reaches_the_static_deflection(weightless: Truth, poses_rad: Float) -> None:
    plant = Plant(weightless, friction=False)
    q, w, rest = poses_rad[1], np.array([0.0, 500.0, 0.0, 0.0, 0.0, 0.0]), np.zeros(6)
    start = plant.equilibrium(q)
    for _ in range(3000):
        plant.step(q, rest, w)
    plant.check()
    moved = pose.difference(start, plant.tcp_pose())[:3]
    expected = (cartesian_compliance(weightless, q) @ w)[:3]
    assert np.linalg.norm(moved - expected) < 0.015 * np.linalg.norm(expected)


def test_unloaded_without_gravity_is_the_rigid_chain(weightless: Truth, poses_rad: Float) -> None:
    plant = Plant(weightless, friction=False)
    for q in poses_rad:
        np.testing.assert_allclose(plant.equilibrium(q), weightless.rigid_tcp(q), atol=1e-12)


def test_sign_of_the_whole_chain(truth: Truth) -> None:
    """Joint about z, tool at +x 1 m, 100 N in +y on the tool, k = 1.2e7 N m/rad: +8.33 um in +y."""
    plain = Body(
        name="a", T_prev_seg=np.eye(4), joint=0, sign=-1.0, offset_rad=0.0,
        compliance=np.array([0, 0, 0, 0, 0, 1 / 1.2e7]), damping_s=1e-3, p_seg_bearing=np.zeros(3), mass_kg=10.0,
        p_seg_com=np.zeros(3), inertia_kg_m2=np.array([1.0, 1, 1, 0, 0, 0]),
    )  # fmt: skip
    stiff = tuple(replace(plain, name=f"s{j}", joint=j, compliance=np.zeros(6)) for j in range(1, 6))
    drives = tuple(replace(d, dead_band_rad=0.0) for d in truth.drives)
    arm = Truth(
        "arm", (plain, *stiff), pose.make(p=np.array([1.0, 0, 0])), drives, CuttingTruth((1.0, 1, 1), (0, 0, 0))
    )
    plant = Plant(arm)
    w = np.array([0.0, 100.0, 0, 0, 0, 0])
    moved = pose.difference(plant.equilibrium(np.zeros(6)), plant.equilibrium(np.zeros(6), w))
    assert moved[1] == pytest.approx(100.0 / 1.2e7, rel=1e-9)
    turned = plant.equilibrium(np.array([0.1, 0, 0, 0, 0, 0]))
    assert turned[1, 3] == pytest.approx(-np.sin(0.1))


def pinocchio_of(truth: Truth) -> pin.Model:
    """The same chain in Pinocchio, joint by joint."""
    model = pin.Model()
    model.gravity.linear = np.array(truth.gravity_base)
    parent, T = 0, np.eye(4)
    for body in truth.bodies:
        T = T @ body.T_prev_seg @ pose.make(rotation.about_z(body.offset_rad))
        axes: list[tuple[Float, bool, Float, float]] = []
        if body.joint is not None:
            rotor = truth.drives[body.joint].rotor_inertia_kg_m2
            axes.append((np.array([0.0, 0.0, body.sign]), True, np.zeros(3), rotor))
        axes += [
            (np.eye(3)[kind % 3], kind >= 3, body.p_seg_bearing, 0.0)
            for kind in (0, 1, 2, 5, 4, 3)
            if body.compliance[kind] > 0.0
        ]
        back = np.zeros(3)
        for axis, hinge, point, rotor in axes:
            joint = pin.JointModelRevoluteUnaligned(axis) if hinge else pin.JointModelPrismaticUnaligned(axis)
            place = T @ pose.make(p=point - back)
            parent = model.addJoint(parent, joint, pin.SE3(place), f"{body.name}{model.njoints}")
            model.armature[model.nv - 1] = rotor
            back, T = point, np.eye(4)
        xx, yy, zz, xy, xz, yz = body.inertia_kg_m2
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        model.appendBodyToJoint(parent, pin.Inertia(body.mass_kg, body.p_seg_com - back, tensor), pin.SE3(T))
        T = T @ pose.make(p=-back)
    return model


def test_inertia_and_bias_agree_with_pinocchio(truth: Truth, poses_rad: Float) -> None:
    moved = replace(truth, bodies=tuple(replace(b, p_seg_bearing=np.array([0.01, 0.02, -0.01])) for b in truth.bodies))
    plant, model = Plant(moved), pinocchio_of(moved)
    data = model.createData()
    c = coordinates(moved)
    assert model.nv == len(c.kind)
    assert np.count_nonzero(c.kind == MOTOR) == 6
    for q in poses_rad:
        plant.reset(q)
        position, _ = plant.state()
        M = pin.crba(model, data, position)
        M = np.triu(M) + np.triu(M, 1).T
        np.testing.assert_allclose(plant.mass_matrix(), M, atol=1e-9 * np.abs(M).max())
        expected = pin.rnea(model, data, position, np.zeros(model.nv), np.zeros(model.nv))
        np.testing.assert_allclose(plant.bias(), expected, atol=1e-9 * np.abs(expected).max())


def test_sag_is_where_springs_carry_the_weight(truth: Truth, poses_rad: Float) -> None:
    free = replace(truth, counterbalance=None, drives=tuple(replace(d, dead_band_rad=0.0) for d in truth.drives))
    plant, model = Plant(free, friction=False), pinocchio_of(free)
    data, c = model.createData(), coordinates(free)
    for q in poses_rad:
        T = plant.equilibrium(q)
        position, _ = plant.state()
        weight = pin.computeGeneralizedGravity(model, data, position)
        elastic = c.kind >= 0
        np.testing.assert_allclose((c.stiffness * position + weight)[elastic], 0.0, atol=1e-4)
        assert 1e-3 < free.rigid_tcp(q)[2, 3] - T[2, 3] < 10e-3


def test_counterbalance_relieves_axis_two(truth: Truth) -> None:
    q = np.radians([0, -60, 90, 0, 0, 0])
    bare = Plant(replace(truth, counterbalance=None))
    bare.reset(q)
    held = Plant(truth)
    held.reset(q)
    assert 0.0 < abs(held.drive_torque[1]) < abs(bare.drive_torque[1])


def test_friction_and_play_keep_the_published_lost_motion(truth: Truth, poses_rad: Float) -> None:
    """750 N applied slowly, with friction and play: 0.063 mm mean and 0.17 mm largest off the linear closed form."""
    plant, rest, gaps = Plant(truth), np.zeros(6), []
    for q in poses_rad:
        for axis in range(3):
            w = np.zeros(6)
            start = plant.equilibrium(q)[:3, 3]
            for k in range(2000):
                w[axis] = 375.0 * (1.0 - np.cos(np.pi * min(k / 1200, 1.0)))
                plant.step(q, rest, w)
            moved = plant.tcp_pose()[:3, 3] - start
            gaps.append(float(np.linalg.norm(moved - (cartesian_compliance(truth, q) @ w)[:3])))
    plant.check()
    assert 0.04e-3 < np.mean(gaps) < 0.09e-3
    assert max(gaps) < 0.20e-3
