"""Own weight: loads against an independent dynamics library, counterbalance against its work, sag in closed form."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pinocchio
import pytest

import elastic_equations as equations
from counterflex.core.arrays import Float
from counterflex.geometry import pose, rotation
from counterflex.robot.elasticity.chain import ElasticChain, forward, forward_elastic
from counterflex.robot.elasticity.compliance import cartesian_compliance, deflection, element_loads
from counterflex.robot.elasticity.gravity import sag, weight_loads
from counterflex.robot.model import catalog
from counterflex.robot.model.description import Counterbalance, EndEffector, Robot, Segment


@pytest.mark.parametrize("name", ["heavy", "crooked"])
def test_drive_moments_equal_pinocchio(name: str, poses: Float, request: pytest.FixtureRequest) -> None:
    chain: ElasticChain = request.getfixturevalue(name)
    model = pinocchio.Model()
    parent, placement = 0, pinocchio.SE3.Identity()
    for i in range(chain.n):
        placement = placement * pinocchio.SE3(chain.fixed[i])
        if chain.joint[i] >= 0:
            parent = model.addJoint(parent, pinocchio.JointModelRZ(), placement, f"drive{i}")
            placement = pinocchio.SE3.Identity()
        model.appendBodyToJoint(
            parent, pinocchio.Inertia(float(chain.mass[i]), chain.com[i], np.zeros((3, 3))), placement
        )
    model.gravity.linear = chain.gravity
    data = model.createData()
    driven = np.flatnonzero(chain.joint >= 0)
    loads = weight_loads(replace(chain, counterbalance=None), poses[:20])
    for q, load in zip(poses[:20], loads, strict=True):
        theta = chain.sign[driven] * q[chain.joint[driven]] + chain.offset[driven]
        holding = pinocchio.computeGeneralizedGravity(model, data, theta)
        np.testing.assert_allclose(load[driven, 5], -holding, rtol=1e-10, atol=1e-9)


def test_weight_at_the_tcp_is_a_force_at_the_tcp(haehn: ElasticChain, poses: Float) -> None:
    mass = haehn.mass.copy()
    mass[:] = 0.0
    mass[-1] = 40.0
    com = haehn.com.copy()
    com[-1] = haehn.T_last_tcp[:3, 3]
    only = replace(haehn, mass=mass, com=com, counterbalance=None)
    w = np.concatenate([40.0 * only.gravity, np.zeros(3)])
    np.testing.assert_allclose(weight_loads(only, poses), element_loads(only, poses, w), atol=1e-10)
    np.testing.assert_allclose(sag(only, poses, equilibrium=False), deflection(only, poses, w), atol=1e-14)


def test_counterbalance_is_the_slope_of_the_gas_work() -> None:
    """Isothermal gas: stored work -Z R T m ln(V_max - dl A); the published pressures lie within 4 %."""
    balance = catalog.load("kuka_kr300_r2500_ultra").counterbalance
    assert balance is not None

    def work(q: Float) -> Float:
        d = q - balance.q_min_force_rad
        long, short = balance.anchor_column_m, balance.anchor_arm_m
        stroke = np.sqrt(long**2 + short**2 - 2 * long * short * np.cos(d)) - (long - short)
        out: Float = -balance.gas_constant_j * np.log(balance.gas_volume_max_m3 - stroke * balance.piston_area_m2)
        return out

    q = np.radians(np.linspace(-140.0, -5.0, 28))
    h = 1e-5
    slope = (work(q + h) - work(q - h)) / (2 * h)
    np.testing.assert_allclose(balance.torque(q), -slope, rtol=1e-7, atol=1e-3)
    assert balance.torque(balance.q_min_force_rad) == pytest.approx(0.0, abs=1e-9)
    assert balance.torque(np.radians(-40.0)) < 0.0 < balance.torque(np.radians(-130.0))
    measured_bar = {-120: 170, -110: 167, -90: 162, -60: 180, -40: 200}
    for angle, bar in measured_bar.items():
        d = np.radians(angle) - balance.q_min_force_rad
        stroke = np.sqrt(0.8**2 + 0.2**2 - 0.32 * np.cos(d)) - 0.6
        pressure = balance.gas_constant_j / (balance.gas_volume_max_m3 - stroke * balance.piston_area_m2)
        assert pressure * 1e-5 == pytest.approx(bar, rel=0.045)


def test_counterbalance_relieves_axis_2_alone(haehn: ElasticChain, poses: Float) -> None:
    with_it, without = weight_loads(haehn, poses), weight_loads(replace(haehn, counterbalance=None), poses)
    difference = with_it - without
    axis2 = haehn.names.index("axis2")
    assert haehn.counterbalance is not None
    np.testing.assert_allclose(difference[:, axis2, 5], haehn.sign[axis2] * haehn.counterbalance.torque(poses[:, 1]))
    difference[:, axis2, 5] = 0.0
    np.testing.assert_array_equal(difference, 0.0)
    forward_leaning = poses[:, 1] > haehn.counterbalance.q_min_force_rad + 0.1
    assert np.all(np.abs(with_it[forward_leaning, axis2, 5]) < np.abs(without[forward_leaning, axis2, 5]))


@pytest.mark.parametrize("joint", range(6))
def test_kernels_carry_the_same_loads(joint: int, crooked: ElasticChain, poses: Float, wrenches: Float) -> None:
    """Weight, wrench and a counterbalance on axes of either sign, put into the composition of the specification."""
    balance = Counterbalance(joint, 0.8, 0.2, 0.3, 2e-3, 1.5e4, 1e-3)
    chain = replace(crooked, counterbalance=balance)
    for q, w in zip(poses[:5], wrenches[:5], strict=True):
        delta = chain.compliance * (weight_loads(chain, q) + element_loads(chain, q, w))
        Rs, ps = equations.walk(chain, q, delta, equations.DOUBLE)
        T = forward_elastic(chain, q, w, gravity=True)
        np.testing.assert_allclose(T[:3, 3], ps[-1].astype(float), atol=1e-14)
        np.testing.assert_allclose(T[:3, :3], Rs[-1].astype(float), atol=1e-14)
    stiff = replace(chain, compliance=chain.compliance * 1e-4)
    np.testing.assert_allclose(
        sag(stiff, poses, equilibrium=True), sag(stiff, poses, equilibrium=False), rtol=1e-2, atol=1e-10
    )
    without = sag(replace(stiff, counterbalance=None), poses)
    assert np.max(np.abs(without - sag(stiff, poses))) > 1e-9


def test_sag_of_a_horizontal_arm_in_closed_form() -> None:
    """One hinge, mass m at L: theta = c m g L cos(theta) at equilibrium, c m g L on the rigid geometry."""
    c, mass, length = 1e-5, 50.0, 1.5
    drives = tuple(Segment(f"axis{i}", np.eye(4), joint=i) for i in range(6))
    body = Segment(
        "arm", pose.make(), compliance=np.array([0, 0, 0, 0, c, 0.0]), mass_kg=mass, p_seg_com=np.array([length, 0, 0])
    )
    tool = EndEffector((body,), pose.make(p=np.array([length, 0.0, 0.0])))
    chain = ElasticChain.build(Robot("arm", drives, np.eye(4), np.array([[-3.0, 3.0]] * 6)), tool)
    torque = c * mass * 9.80665 * length
    theta = torque
    for _ in range(100):
        theta = torque * np.cos(theta)
    q = np.zeros(6)
    np.testing.assert_allclose(sag(chain, q, equilibrium=False)[4], torque, rtol=1e-12)
    settled = sag(chain, q)
    np.testing.assert_allclose(settled[4], theta, rtol=1e-12)
    np.testing.assert_allclose(settled[2], -length * np.sin(theta), rtol=1e-12)
    np.testing.assert_allclose(settled[0], length * (np.cos(theta) - 1.0), rtol=1e-9)


def test_gravity_states(heavy: ElasticChain, poses: Float, wrenches: Float) -> None:
    q, w = poses[:50], wrenches[:50]
    for equilibrium in (False, True):
        unloaded = forward_elastic(heavy, q, gravity=True, equilibrium=equilibrium)
        loaded = forward_elastic(heavy, q, w, gravity=True, equilibrium=equilibrium)
        np.testing.assert_allclose(
            sag(heavy, q, equilibrium=equilibrium), pose.difference(forward(heavy, q), unloaded), atol=1e-14
        )
        np.testing.assert_allclose(
            deflection(heavy, q, w, gravity=True, equilibrium=equilibrium),
            pose.difference(unloaded, loaded),
            atol=1e-14,
        )
    weightless = replace(heavy, mass=np.zeros(heavy.n), counterbalance=None)
    np.testing.assert_allclose(sag(weightless, q), 0.0, atol=1e-15)


def test_the_order_of_the_second_order_effects(heavy: ElasticChain, poses: Float, wrenches: Float) -> None:
    """Millimetres of sag; taking loads on the deflected geometry changes it and the deflection by microns only."""
    rigid, settled = sag(heavy, poses, equilibrium=False), sag(heavy, poses)
    size = np.linalg.norm(settled[:, :3], axis=1)
    assert 5e-4 < np.median(size) < 6e-3
    assert np.max(np.linalg.norm((rigid - settled)[:, :3], axis=1) / size) < 0.02
    plain, weighed = (
        deflection(heavy, poses, wrenches),
        deflection(heavy, poses, wrenches, gravity=True, equilibrium=True),
    )
    assert np.max(np.linalg.norm((plain - weighed)[:, :3], axis=1)) < 3e-5


def mjcf(chain: ElasticChain) -> str:
    """The chain as MuJoCo bodies with locked drives and the rotational elements as spring hinges z, y', x''."""

    def text(values: Any) -> str:
        return " ".join(f"{v:.17g}" for v in np.ravel(values))

    opened, closing = [], 0
    for i in range(chain.n):
        T = chain.fixed[i]
        opened.append(f'<body pos="{text(T[:3, 3])}" quat="{text(rotation.quat_wxyz(T[:3, :3]))}">')
        if chain.joint[i] >= 0:
            opened.append(
                f'<inertial pos="0 0 0" mass="1e-9" diaginertia="1e-6 1e-6 1e-6"/><joint name="drive{i}" axis="0 0 1"/>'
            )
            opened.append("<body>")
            closing += 1
        for d, axis in ((5, "0 0 1"), (4, "0 1 0"), (3, "1 0 0")):
            if chain.compliance[i, d] > 0.0:
                opened.append(
                    f'<joint name="spring{i}_{d}" axis="{axis}" stiffness="{1.0 / chain.compliance[i, d]:.17g}"/>'
                )
        mass = max(float(chain.mass[i]), 1e-9)
        opened.append(f'<inertial pos="{text(chain.com[i])}" mass="{mass:.17g}" diaginertia="1 1 1"/>')
        closing += 1
    T = chain.T_last_tcp
    opened.append(f'<site name="tcp" pos="{text(T[:3, 3])}" quat="{text(rotation.quat_wxyz(T[:3, :3]))}"/>')
    return (
        f'<mujoco><compiler angle="radian"/><option gravity="{text(chain.gravity)}"/><worldbody>'
        + "".join(opened) + "</body>" * closing + "</worldbody></mujoco>"
    )  # fmt: skip


@pytest.mark.parametrize("gravity", [False, True])
def test_static_equilibrium_of_mujoco(gravity: bool, haehn: ElasticChain, poses: Float, wrenches: Float) -> None:
    mass = haehn.mass.copy()
    mass[-1] = 75.0
    chain = replace(haehn, mass=mass, counterbalance=None)
    model = mujoco.MjModel.from_xml_string(mjcf(chain))
    if not gravity:
        model.opt.gravity[:] = 0.0
    data = mujoco.MjData(model)
    springs = np.array([k for k in range(model.njnt) if model.joint(k).name.startswith("spring")])
    drives = [k for k in range(model.njnt) if model.joint(k).name.startswith("drive")]
    stiffness = model.jnt_stiffness[springs]
    driven = np.flatnonzero(chain.joint >= 0)
    site = model.site("tcp").id
    for q, w in zip(poses[:4], wrenches[:4], strict=True):
        data.qpos[:] = 0.0
        data.qpos[drives] = chain.sign[driven] * q[chain.joint[driven]] + chain.offset[driven]
        jacp, jacr = np.zeros((3, model.nv)), np.zeros((3, model.nv))
        for _ in range(30):
            mujoco.mj_forward(model, data)
            mujoco.mj_jacSite(model, data, jacp, jacr, site)
            torque = jacp.T @ w[:3] + jacr.T @ w[3:] - data.qfrc_bias
            data.qpos[springs] = torque[springs] / stiffness
        mujoco.mj_forward(model, data)
        T = forward_elastic(chain, q, w, gravity=gravity, equilibrium=True)
        np.testing.assert_allclose(data.site_xpos[site], T[:3, 3], atol=1e-9)
        np.testing.assert_allclose(data.site_xmat[site].reshape(3, 3), T[:3, :3], atol=1e-9)
        np.testing.assert_allclose(
            data.site_xpos[site], forward_elastic(chain, q, w, gravity=gravity)[:3, 3], atol=5e-5
        )


def test_compliance_does_not_know_gravity(heavy: ElasticChain, poses: Float) -> None:
    other = replace(heavy, gravity=np.zeros(3))
    np.testing.assert_array_equal(cartesian_compliance(heavy, poses), cartesian_compliance(other, poses))
