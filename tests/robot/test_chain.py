"""The chain: checks of the description, rigid kinematics against closed forms, other libraries and differences."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio
import pytest

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError, ModelError
from counterflex.geometry import pose, rotation
from counterflex.robot.elasticity.chain import ElasticChain, flange, forward, frames, jacobian
from counterflex.robot.elasticity.compliance import cartesian_compliance, deflection
from counterflex.robot.elasticity.gravity import sag
from counterflex.robot.model import catalog
from counterflex.robot.model.description import Counterbalance, EndEffector, Robot, Segment

CHAINS = ("haehn", "heavy", "crooked")


def robot_of(**changes: Any) -> Robot:
    """Six revolute segments; ``changes`` go to the second one."""
    segments = [Segment(f"axis{i + 1}", pose.make(p=np.array([0.1, 0.0, 0.2])), joint=i) for i in range(6)]
    segments[1] = replace(segments[1], **changes)
    return Robot("six", tuple(segments), np.eye(4), np.array([[-3.0, 3.0]] * 6))


@pytest.mark.parametrize(
    "changes",
    [
        {"compliance": np.array([0, 0, 0, 0, 0, -1e-7])},
        {"compliance": np.array([0, 0, 0, 0, 0, np.nan])},
        {"compliance": np.array([0, 0, 0, 0, 0, 1e7])},
        {"compliance": np.array([1e-2, 0, 0, 0, 0, 0])},
        {"compliance": np.zeros(3)},
        {"mass_kg": -1.0},
        {"mass_kg": float("inf")},
        {"mass_kg": 1e6},
        {"sign": 0.5},
        {"offset_rad": float("nan")},
        {"joint": 0},
        {"joint": None},
        {"joint": 6},
        {"T_prev_seg": np.diag([1.0, 1.0, -1.0, 1.0])},
        {"T_prev_seg": np.eye(4) * 2.0},
        {"T_prev_seg": np.eye(3)},
        {"T_prev_seg": pose.make(p=np.array([675.0, 0.0, 0.0]))},
        {"p_seg_com": np.array([0.0, 0.0, 300.0])},
        {"p_seg_com": "middle"},
    ],
)
def test_build_refuses_what_no_robot_is(changes: dict[str, Any]) -> None:
    with pytest.raises(ModelError):
        ElasticChain.build(robot_of(**changes))


def test_build_refuses_wrong_order_limits_and_gravity() -> None:
    good = robot_of()
    swapped = (good.segments[1], good.segments[0], *good.segments[2:])
    with pytest.raises(ModelError, match="from the base outward"):
        ElasticChain.build(replace(good, segments=swapped))
    with pytest.raises(ModelError, match="limit"):
        ElasticChain.build(replace(good, joint_limits_rad=np.array([[3.0, -3.0]] * 6)))
    with pytest.raises(ModelError, match="rad"):
        ElasticChain.build(replace(good, joint_limits_rad=np.array([[-185000.0, 185000.0]] * 6)))
    with pytest.raises(ModelError, match="speed"):
        ElasticChain.build(replace(good, joint_speeds_rad_s=np.zeros(6)))
    with pytest.raises(ModelError, match="gravity"):
        ElasticChain.build(good, gravity_base=(0.0, 0.0, -9806.65))
    with pytest.raises(ModelError, match="driven"):
        ElasticChain.build(good, EndEffector((Segment("spindle", np.eye(4), joint=3),), np.eye(4)))
    with pytest.raises(ModelError, match="stroke"):
        ElasticChain.build(replace(good, counterbalance=Counterbalance(1, 0.8, 0.2, 0.0, 1.0, 1e4, 1e-3)))


@pytest.mark.parametrize("q", [np.zeros(5), 0.0, np.full(6, np.nan), "home", np.zeros((2, 7))])
def test_angles_are_checked(haehn: ElasticChain, q: Any) -> None:
    with pytest.raises(InputError):
        forward(haehn, q)


def test_catalogue_check_poses() -> None:
    entry = catalog.entry("kuka_kr300_r2500_ultra")
    chain = ElasticChain.build(catalog.load("kuka_kr300_r2500_ultra"))
    for check in entry.checks:
        T = forward(chain, np.radians(check.q_deg))
        np.testing.assert_allclose(T[:3, 3] * 1e3, check.position_mm, atol=1e-5)
        np.testing.assert_allclose(T[:3, :3], check.rotation, atol=1e-8)


def oracle(chain: ElasticChain, virtual: bool) -> Any:
    """The chain as a Pinocchio model; with ``virtual`` every segment gets slides x y z and hinges z y x."""
    model = pinocchio.Model()
    parent, placement = 0, pinocchio.SE3.Identity()
    axes = (pinocchio.JointModelPX, pinocchio.JointModelPY, pinocchio.JointModelPZ)
    hinges = (pinocchio.JointModelRZ, pinocchio.JointModelRY, pinocchio.JointModelRX)
    for i in range(chain.n):
        placement = placement * pinocchio.SE3(chain.fixed[i])
        if chain.joint[i] >= 0:
            parent = model.addJoint(parent, pinocchio.JointModelRZ(), placement, f"drive{i}")
            placement = pinocchio.SE3.Identity()
        if virtual:
            for name, kind in zip("xyzcba", (*axes, *hinges), strict=True):
                parent = model.addJoint(parent, kind(), placement, f"{name}{i}")
                placement = pinocchio.SE3.Identity()
        mass = float(chain.mass[i])
        if mass > 0.0:
            inertia = pinocchio.Inertia(mass, chain.com[i], np.eye(3) * 0.0)
            model.appendBodyToJoint(parent, inertia, placement)
    tip = placement * pinocchio.SE3(chain.T_last_tcp)
    model.addFrame(pinocchio.Frame("tcp", parent, tip, pinocchio.FrameType.OP_FRAME))
    model.gravity.linear = chain.gravity
    return model


def drive_angles(chain: ElasticChain, q: Float) -> Float:
    """Angles theta of the driven segments."""
    driven = np.flatnonzero(chain.joint >= 0)
    theta: Float = chain.sign[driven] * q[chain.joint[driven]] + chain.offset[driven]
    return theta


@pytest.mark.parametrize("name", CHAINS)
def test_forward_and_jacobian_equal_pinocchio(name: str, poses: Float, request: pytest.FixtureRequest) -> None:
    chain: ElasticChain = request.getfixturevalue(name)
    model = oracle(chain, virtual=False)
    data = model.createData()
    for q in poses[:40]:
        theta = drive_angles(chain, q)
        pinocchio.framesForwardKinematics(model, data, theta)
        np.testing.assert_allclose(forward(chain, q), data.oMf[model.getFrameId("tcp")].homogeneous, atol=1e-13)
        J = pinocchio.computeFrameJacobian(
            model, data, theta, model.getFrameId("tcp"), pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED
        )
        np.testing.assert_allclose(jacobian(chain, q), J * chain.sign[chain.joint >= 0], atol=1e-13)


def test_batches_equal_single_points_and_keep_their_shape(heavy: ElasticChain, poses: Float) -> None:
    grid = poses.reshape(4, 100, 6)
    T, J, Ts = forward(heavy, grid), jacobian(heavy, grid), frames(heavy, grid)
    assert T.shape == (4, 100, 4, 4)
    assert J.shape == (4, 100, 6, 6)
    assert Ts.shape == (4, 100, heavy.n, 4, 4)
    for index in ((0, 0), (1, 17), (3, 99)):
        np.testing.assert_allclose(T[index], forward(heavy, grid[index]), atol=1e-15)
        np.testing.assert_allclose(J[index], jacobian(heavy, grid[index]), atol=1e-15)
        np.testing.assert_allclose(Ts[index][-1] @ heavy.T_last_tcp, T[index], atol=1e-14)
        np.testing.assert_allclose(flange(heavy, grid[index]) @ heavy.T_flange_tcp, T[index], atol=1e-14)
    assert forward(heavy, np.empty((0, 6))).shape == (0, 4, 4)


@pytest.mark.parametrize("name", CHAINS)
def test_central_differences_approach_the_jacobian_with_order_two(
    name: str, poses: Float, request: pytest.FixtureRequest
) -> None:
    chain: ElasticChain = request.getfixturevalue(name)
    q = poses[5]
    J = jacobian(chain, q)
    gaps = []
    for h in (4e-2, 2e-2, 1e-2):
        columns = [pose.difference(forward(chain, q - h * e), forward(chain, q + h * e)) / (2 * h) for e in np.eye(6)]
        gaps.append(np.max(np.abs(np.stack(columns, axis=1) - J)))
    assert np.log2(gaps[0] / gaps[1]) == pytest.approx(2.0, abs=0.05)
    assert np.log2(gaps[1] / gaps[2]) == pytest.approx(2.0, abs=0.05)


def test_splitting_rigid_bodies_changes_nothing(heavy: ElasticChain, poses: Float, wrenches: Float) -> None:
    robot = catalog.load("kuka_kr300_r2500_ultra")
    first, second = robot.segments[0], robot.segments[1]
    stub = pose.make(rotation.exp(np.array([0.2, 0.1, -0.4])), np.array([0.1, 0.2, 0.3]))
    foot = Segment("foot", stub, mass_kg=200.0)
    half = Segment("half", stub, mass_kg=0.0)
    split = (
        foot,
        replace(first, T_prev_seg=pose.inverse(stub) @ first.T_prev_seg),
        half,
        replace(second, T_prev_seg=pose.inverse(stub) @ second.T_prev_seg),
        *robot.segments[2:],
    )
    whole, cut = ElasticChain.build(robot), ElasticChain.build(replace(robot, segments=split))
    assert cut.n == whole.n + 2
    assert len(cut.compact.stations) == len(whole.compact.stations)
    for q, w in zip(poses[:5], wrenches[:5], strict=True):
        np.testing.assert_allclose(forward(cut, q), forward(whole, q), atol=1e-14)
        np.testing.assert_allclose(deflection(cut, q, w), deflection(whole, q, w), atol=1e-15)
        np.testing.assert_allclose(cartesian_compliance(cut, q), cartesian_compliance(whole, q), rtol=1e-10, atol=1e-20)
        np.testing.assert_allclose(sag(cut, q), sag(whole, q), atol=1e-15)
