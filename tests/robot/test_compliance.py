"""Compliance and deflection: laws, closed forms, independent chains of real joints, many digits."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace
from typing import Any

import mpmath
import numpy as np
import pinocchio
import pytest
from hypothesis import given, settings, strategies as st

import elastic_equations as equations
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError, ModelError
from counterflex.geometry import pose, rotation
from counterflex.robot.elasticity.chain import ElasticChain, forward, forward_elastic, jacobian
from counterflex.robot.elasticity.compliance import (
    LANES_FROM,
    cartesian_compliance,
    deflection,
    element_jacobians,
    element_loads,
    linear_gap,
    shares,
)
from counterflex.robot.elasticity.kernels.lanes import deflection_lanes
from counterflex.robot.elasticity.kernels.step import CLAMPED, DAMPED, DAMPING_BELOW, REFUSE_BELOW, REFUSED
from counterflex.robot.model.description import EndEffector, Robot, Segment
from online_step import ElasticStep, steps
from twists import adjoint

CHAINS = ("haehn", "heavy", "crooked")
LIMITS = np.array([[-3.0, 3.0]] * 6)


@pytest.fixture(params=CHAINS)
def chain(request: pytest.FixtureRequest) -> ElasticChain:
    found: ElasticChain = request.getfixturevalue(request.param)
    return found


def beam(compliances: list[Float], lengths: list[float]) -> ElasticChain:
    """Undriven elastic bodies along x behind six rigid drives at the origin, TCP at the end of the last."""
    drives = tuple(Segment(f"axis{i}", np.eye(4), joint=i) for i in range(6))
    bodies = []
    before = 0.0
    for i, (c, length) in enumerate(zip(compliances, lengths, strict=True)):
        bodies.append(Segment(f"body{i}", pose.make(p=np.array([before, 0.0, 0.0])), compliance=c))
        before = length
    tool = EndEffector(tuple(bodies), pose.make(p=np.array([before, 0.0, 0.0])))
    return ElasticChain.build(Robot("beam", drives, np.eye(4), LIMITS), tool)


def test_sign_of_the_whole_chain() -> None:
    segments = [Segment(f"axis{i + 1}", np.eye(4), joint=i) for i in range(6)]
    segments[0] = replace(segments[0], compliance=np.array([0, 0, 0, 0, 0, 1.0 / 1.2e7]))
    robot = Robot("one joint", tuple(segments), pose.make(p=np.array([1.0, 0.0, 0.0])), LIMITS)
    one = ElasticChain.build(robot)
    for nonlinear in (False, True):
        d = deflection(one, np.zeros(6), np.array([0.0, 100.0, 0, 0, 0, 0]), nonlinear=nonlinear)
        assert d[1] * 1e6 == pytest.approx(8.3333333, abs=1e-6)
        assert d[5] * 1e6 == pytest.approx(8.3333333, abs=1e-6)
    step = ElasticStep(one)
    assert (
        step(np.zeros(6), np.array([0.0, 100.0, 0, 0, 0, 0])) == REFUSED
    )  # six joints in one point cannot correct anything


def test_compliance_is_symmetric_and_positive_semidefinite(chain: ElasticChain, poses: Float) -> None:
    C = cartesian_compliance(chain, poses)
    np.testing.assert_array_equal(C, np.swapaxes(C, -1, -2))
    eigen = np.linalg.eigvalsh(C)
    assert np.all(eigen >= -1e-13 * eigen[:, -1:])


def test_springs_in_series_add(chain: ElasticChain, poses: Float) -> None:
    q = poses[:20]
    total = np.zeros((20, 6, 6))
    for i in range(chain.n):
        alone = np.zeros_like(chain.compliance)
        alone[i] = chain.compliance[i]
        total += cartesian_compliance(replace(chain, compliance=alone), q)
    np.testing.assert_allclose(total, cartesian_compliance(chain, q), rtol=1e-12, atol=1e-20)


def test_denkena_form_with_inverted_jacobians(crooked: ElasticChain, poses: Float) -> None:
    """Equations 1-7 as printed: ``sum J^-1 k^-1 J^-T`` with J the map of a TCP twist to the joint's frame."""
    from counterflex.robot.elasticity.chain import frames

    q = poses[0]
    T_base_tcp = forward(crooked, q)
    R6 = np.kron(np.eye(2), T_base_tcp[:3, :3])
    C_tcp = np.zeros((6, 6))
    for T_base_seg, c in zip(frames(crooked, q), crooked.compliance, strict=True):
        J = adjoint(pose.inverse(T_base_seg) @ T_base_tcp)
        C_tcp += np.linalg.inv(J) @ np.diag(c) @ np.linalg.inv(J).T
    np.testing.assert_allclose(cartesian_compliance(crooked, q), R6 @ C_tcp @ R6.T, rtol=1e-11, atol=1e-18)


def test_rigid_limit(chain: ElasticChain, poses: Float, wrenches: Float) -> None:
    rigid = replace(chain, compliance=np.zeros_like(chain.compliance))
    np.testing.assert_array_equal(cartesian_compliance(rigid, poses), 0.0)
    np.testing.assert_allclose(deflection(rigid, poses, wrenches), 0.0, atol=1e-15)
    for factor in (1e-3, 1e-6):
        stiff = replace(chain, compliance=chain.compliance * factor)
        np.testing.assert_allclose(
            deflection(stiff, poses, wrenches, nonlinear=False),
            factor * deflection(chain, poses, wrenches, nonlinear=False),
            rtol=1e-9,
            atol=1e-18,
        )


def test_superposition_and_energy(chain: ElasticChain, poses: Float, wrenches: Float) -> None:
    q, v, w = poses[:50], wrenches[:50], wrenches[50:100]
    both = deflection(chain, q, v + w, nonlinear=False)
    parts = deflection(chain, q, v, nonlinear=False) + deflection(chain, q, w, nonlinear=False)
    np.testing.assert_allclose(both, parts, rtol=1e-10, atol=1e-16)
    work = 0.5 * np.sum(w * deflection(chain, q, w, nonlinear=False), axis=-1)
    stored = 0.5 * np.sum(chain.compliance * element_loads(chain, q, w) ** 2, axis=(-2, -1))
    np.testing.assert_allclose(work, stored, rtol=1e-12)
    assert np.all(work > 0.0)
    reciprocal = np.sum(v * deflection(chain, q, w, nonlinear=False), axis=-1)
    np.testing.assert_allclose(reciprocal, np.sum(w * deflection(chain, q, v, nonlinear=False), axis=-1), atol=1e-12)


def test_shares_add_up_to_the_linear_deflection(chain: ElasticChain, poses: Float, wrenches: Float) -> None:
    parts = shares(chain, poses, wrenches)
    assert parts.shape == (len(poses), chain.n, 6)
    np.testing.assert_allclose(
        parts.sum(axis=1), deflection(chain, poses, wrenches, nonlinear=False), rtol=1e-9, atol=1e-15
    )
    columns = element_jacobians(chain, poses[0])
    np.testing.assert_allclose(
        np.einsum("nij,nj,nkj->ik", columns, chain.compliance, columns),
        cartesian_compliance(chain, poses[0]),
        rtol=1e-11,
        atol=1e-19,
    )


def test_shares_of_many_poses_are_those_of_each_and_take_little_memory(haehn: ElasticChain) -> None:
    """Beside the result only a batch of Jacobians is held, not those of all poses."""
    rng = np.random.default_rng(5)
    q = rng.uniform(-1.0, 1.0, (20_000, 6)) * 0.3 + np.array([0.0, -1.5, 2.0, 0.0, 0.6, 0.0])
    w = rng.normal(size=q.shape) * 100.0
    tracemalloc.start()
    found = shares(haehn, q, w)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 2.5 * found.nbytes
    for row in (0, 1023, 1024, 19_999):
        np.testing.assert_array_equal(found[row], shares(haehn, q[row], w[row]))


@settings(max_examples=25, deadline=None)
@given(st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3), st.lists(st.floats(-2.0, 2.0), min_size=3, max_size=3))
def test_moving_the_base_frame_moves_the_answer_with_it(turn: list[float], shift: list[float]) -> None:
    rng = np.random.default_rng(1)
    segments = [
        Segment(f"axis{i}", pose.make(rotation.exp(rng.normal(size=3)), rng.uniform(-0.5, 0.5, 3)), joint=i,
                compliance=rng.uniform(0, 1, 6) * [1e-8, 1e-8, 1e-8, 1e-6, 1e-6, 1e-6])
        for i in range(6)
    ]  # fmt: skip
    T_new_old = pose.make(rotation.exp(np.array(turn)), np.array(shift))
    moved = [replace(segments[0], T_prev_seg=T_new_old @ segments[0].T_prev_seg), *segments[1:]]
    a, b = (ElasticChain.build(Robot("r", tuple(s), np.eye(4), LIMITS)) for s in (segments, moved))
    q, w = rng.uniform(-2, 2, 6), rng.normal(size=6) * 100.0
    R6 = np.kron(np.eye(2), T_new_old[:3, :3])
    np.testing.assert_allclose(
        cartesian_compliance(b, q), R6 @ cartesian_compliance(a, q) @ R6.T, rtol=1e-9, atol=1e-17
    )
    for equilibrium in (False, True):
        np.testing.assert_allclose(
            deflection(b, q, R6 @ w, equilibrium=equilibrium),
            R6 @ deflection(a, q, w, equilibrium=equilibrium),
            atol=1e-14,
        )


def test_cantilever_of_many_springs_converges_to_the_beam_formula() -> None:
    """F L^3 / 3 EI, F L^2 / 2 EI and M L / EI: n rotational springs approach them with order two."""
    EI, GJ, EA, L = 2.0e5, 1.5e5, 4.0e8, 0.8
    errors = []
    for n in (20, 40):
        h = L / n
        rows = [np.array([h / EA, 0.0, 0.0, h / GJ, h / EI, h / EI]) for _ in range(n)]
        drives = tuple(Segment(f"axis{i}", np.eye(4), joint=i) for i in range(6))
        bodies = tuple(
            Segment(f"b{k}", pose.make(p=np.array([h / 2 if k == 0 else h, 0, 0])), compliance=row)
            for k, row in enumerate(rows)
        )
        tool = EndEffector(bodies, pose.make(p=np.array([h / 2, 0.0, 0.0])))
        chain = ElasticChain.build(Robot("beam", drives, np.eye(4), LIMITS), tool)
        C = cartesian_compliance(chain, np.zeros(6))
        errors.append(abs(C[1, 1] / (L**3 / (3 * EI)) - 1.0))
        assert C[0, 0] == pytest.approx(L / EA, rel=1e-12)
        assert C[3, 3] == pytest.approx(L / GJ, rel=1e-12)
        assert C[5, 5] == pytest.approx(L / EI, rel=1e-12)
        assert C[5, 1] == pytest.approx(L**2 / (2 * EI), rel=1e-12)
        assert C[4, 2] == pytest.approx(-(L**2) / (2 * EI), rel=1e-12)
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.02)
    assert errors[1] < 2e-4


def test_two_links_in_closed_form() -> None:
    """Bending at 0 and at a: y = F (l^2 c1 + (l - a)^2 c2); a pure moment turns by the sum of the compliances."""
    c1, c2, a, length = 3e-7, 5e-7, 0.4, 1.0
    chain = beam([np.array([0, 0, 0, 0, 0, c1]), np.array([0, 0, 0, 0, 0, c2])], [a, length - a])
    d = deflection(chain, np.zeros(6), np.array([0.0, 1000.0, 0, 0, 0, 0]), nonlinear=False)
    assert d[1] == pytest.approx(1000.0 * (length**2 * c1 + (length - a) ** 2 * c2), rel=1e-12)
    d = deflection(chain, np.zeros(6), np.array([0, 0, 0, 0, 0, 100.0]))
    assert d[5] == pytest.approx(100.0 * (c1 + c2), rel=1e-12)
    angle = 100.0 * c1
    assert d[1] == pytest.approx(a * np.sin(angle) + (length - a) * np.sin(angle + 100.0 * c2), rel=1e-9)


def test_nonlinear_form_approaches_the_linear_one_with_order_two(
    chain: ElasticChain, poses: Float, wrenches: Float
) -> None:
    q, w = poses[3], wrenches[3]
    for options in ({}, {"equilibrium": True}):
        gaps = [np.linalg.norm(linear_gap(chain, q, w * k, **options)) for k in (4.0, 2.0, 1.0)]
        assert np.log2(gaps[0] / gaps[1]) == pytest.approx(2.0, abs=0.1)
        assert np.log2(gaps[1] / gaps[2]) == pytest.approx(2.0, abs=0.1)
    columns = [deflection(chain, q, e) - deflection(chain, q, -e) for e in np.eye(6)]
    np.testing.assert_allclose(np.stack(columns, axis=1) / 2.0, cartesian_compliance(chain, q), rtol=1e-5, atol=1e-14)


def test_kuka_gap_between_linear_and_nonlinear_is_microns(haehn: ElasticChain, poses: Float, wrenches: Float) -> None:
    gap = np.linalg.norm(linear_gap(haehn, poses, wrenches)[:, :3], axis=1)
    size = np.linalg.norm(deflection(haehn, poses, wrenches)[:, :3], axis=1)
    assert 1e-6 < np.median(gap) < 1e-5
    assert np.max(gap / size) < 1e-2


def virtual_model(chain: ElasticChain) -> tuple[Any, list[list[int]], Float]:
    """Pinocchio chain in which every elastic direction is a real joint; drives frozen at q later by configuration."""
    model = pinocchio.Model()
    parent, placement = 0, pinocchio.SE3.Identity()
    kinds = (pinocchio.JointModelPX, pinocchio.JointModelPY, pinocchio.JointModelPZ,
             pinocchio.JointModelRZ, pinocchio.JointModelRY, pinocchio.JointModelRX)  # fmt: skip
    order = (0, 1, 2, 5, 4, 3)
    drives, springs, soft = [], [], []
    for i in range(chain.n):
        placement = placement * pinocchio.SE3(chain.fixed[i])
        if chain.joint[i] >= 0:
            parent = model.addJoint(parent, pinocchio.JointModelRZ(), placement, f"drive{i}")
            placement = pinocchio.SE3.Identity()
            drives.append(model.idx_vs[parent])
        for kind, d in zip(kinds, order, strict=True):
            parent = model.addJoint(parent, kind(), placement, f"{i}.{d}")
            placement = pinocchio.SE3.Identity()
            springs.append(model.idx_vs[parent])
            soft.append(chain.compliance[i, d])
        model.appendBodyToJoint(
            parent, pinocchio.Inertia(float(chain.mass[i]), chain.com[i], np.zeros((3, 3))), placement
        )
    tip = placement * pinocchio.SE3(chain.T_last_tcp)
    model.addFrame(pinocchio.Frame("tcp", parent, tip, pinocchio.FrameType.OP_FRAME))
    model.gravity.linear = chain.gravity
    return model, [drives, springs], np.array(soft)


@pytest.mark.parametrize("gravity", [False, True])
def test_equilibrium_equals_a_chain_of_real_spring_joints(
    chain: ElasticChain, gravity: bool, poses: Float, wrenches: Float
) -> None:
    chain = replace(chain, counterbalance=None)
    model, (drives, springs), soft = virtual_model(chain)
    data = model.createData()
    frame = model.getFrameId("tcp")
    driven = np.flatnonzero(chain.joint >= 0)
    for q, w in zip(poses[:6], wrenches[:6], strict=True):
        x = pinocchio.neutral(model)
        x[drives] = chain.sign[driven] * q[chain.joint[driven]] + chain.offset[driven]
        for _ in range(40):
            J = pinocchio.computeFrameJacobian(model, data, x, frame, pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED)
            torque = J.T @ w
            if gravity:
                torque = torque - pinocchio.computeGeneralizedGravity(model, data, x)
            x[springs] = soft * torque[springs]
        pinocchio.framesForwardKinematics(model, data, x)
        T = forward_elastic(chain, q, w, gravity=gravity, equilibrium=True)
        np.testing.assert_allclose(T, data.oMf[frame].homogeneous, atol=1e-12)


def test_rigid_geometry_form_equals_pinocchio_virtual_joints(
    chain: ElasticChain, poses: Float, wrenches: Float
) -> None:
    model, (drives, springs), soft = virtual_model(chain)
    data = model.createData()
    frame = model.getFrameId("tcp")
    driven = np.flatnonzero(chain.joint >= 0)
    for q, w in zip(poses[:20], wrenches[:20], strict=True):
        x = pinocchio.neutral(model)
        x[drives] = chain.sign[driven] * q[chain.joint[driven]] + chain.offset[driven]
        J = pinocchio.computeFrameJacobian(model, data, x, frame, pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED)
        Js = J[:, springs]
        np.testing.assert_allclose(cartesian_compliance(chain, q), Js @ np.diag(soft) @ Js.T, rtol=1e-9, atol=1e-18)
        x[springs] = soft * (Js.T @ w)
        pinocchio.framesForwardKinematics(model, data, x)
        np.testing.assert_allclose(forward_elastic(chain, q, w), data.oMf[frame].homogeneous, atol=1e-12)


def test_kernels_equal_the_equations(chain: ElasticChain, poses: Float, wrenches: Float) -> None:
    step = ElasticStep(chain)
    for q, w in zip(poses[:12], wrenches[:12], strict=True):
        want = equations.step(chain, q, w, equations.DOUBLE)
        assert step(q, w) == want.status
        np.testing.assert_allclose(step.C, want.C.astype(float), rtol=1e-11, atol=1e-18)
        np.testing.assert_allclose(step.d, want.d.astype(float), atol=1e-14)
        np.testing.assert_allclose(step.Tc[:3, 3], want.p_c.astype(float), atol=1e-12)
        np.testing.assert_allclose(step.residual, want.residual.astype(float), atol=1e-12)
        assert step.sigma == pytest.approx(float(want.sigma), rel=1e-9)


def test_agreement_with_forty_digits(chain: ElasticChain, poses: Float, wrenches: Float) -> None:
    """1e-11 mm is 1e-14 m."""
    digits = equations.Arithmetic(mpmath.mpf, mpmath.cos, mpmath.sin, mpmath.sqrt, mpmath.atan2)
    step = ElasticStep(chain)
    regular = np.flatnonzero(steps(chain, poses, wrenches).sigma > 0.05)[:3]
    with mpmath.workdps(40):
        for q, w in zip(poses[regular], wrenches[regular], strict=True):
            want = equations.step(chain, q, w, digits)
            assert step(q, w) == want.status == 0
            np.testing.assert_allclose(step.d, want.d.astype(float), rtol=0, atol=1e-14)
            np.testing.assert_allclose(step.Tc[:3, 3], want.p_c.astype(float), rtol=0, atol=1e-14)
            np.testing.assert_allclose(step.residual, want.residual.astype(float), rtol=0, atol=1e-14)
            np.testing.assert_allclose(step.q_c, want.q_c.astype(float), rtol=0, atol=1e-13)
            np.testing.assert_allclose(step.C, want.C.astype(float), rtol=1e-12, atol=1e-19)


def by_lanes(chain: ElasticChain, q: Float, w: Float) -> tuple[Float, int]:
    """The lane kernel, below the size at which the public function chooses it; points left to the scalar kernel."""
    out = np.empty((len(q), 6))
    return out, deflection_lanes(chain.compact, q, w, out)


def test_lanes_equal_scalar_kernels(chain: ElasticChain, poses: Float, wrenches: Float) -> None:
    for n in (1, 15, 16, 17, 399):  # incomplete blocks too
        q, w = poses[:n].copy(), wrenches[:n].copy()
        out, _ = by_lanes(chain, q, w)
        np.testing.assert_allclose(out, deflection(chain, q, w), rtol=0, atol=1e-14)


def test_lanes_leave_the_irregular_to_the_scalar_kernels(haehn: ElasticChain, poses: Float) -> None:
    q, w = poses[:32].copy(), np.zeros((32, 6))
    w[5] = [0.0, 3e4, 0.0, 0.0, 0.0, 0.0]
    out, bent = by_lanes(haehn, q, w)
    assert bent == 1
    np.testing.assert_allclose(out[5], deflection(haehn, q[5], w[5]), rtol=0, atol=1e-15)


def test_large_batches_take_the_lanes_and_agree(haehn: ElasticChain, poses: Float, wrenches: Float) -> None:
    times = LANES_FROM // len(poses) + 1
    q, w = np.tile(poses, (times, 1)), np.tile(wrenches, (times, 1))
    np.testing.assert_allclose(deflection(haehn, q, w)[-400:], deflection(haehn, poses, wrenches), rtol=0, atol=1e-14)


@pytest.mark.parametrize("asked", [{"gravity": True}, {"equilibrium": True}, {"gravity": True, "equilibrium": True}])
def test_large_batches_with_gravity_or_equilibrium_equal_small_ones(
    asked: dict[str, bool], heavy: ElasticChain, poses: Float, wrenches: Float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The lanes know neither: however many points there are, they must not be taken."""
    monkeypatch.setattr("counterflex.robot.elasticity.compliance.LANES_FROM", 300)
    q, w = np.tile(poses[:40], (8, 1)), np.tile(wrenches[:40], (8, 1))
    assert len(q) > 300
    few = deflection(heavy, poses[:40], wrenches[:40], **asked)
    np.testing.assert_allclose(deflection(heavy, q, w, **asked), np.tile(few, (8, 1)), rtol=0, atol=1e-14)
    if asked == {"gravity": True}:
        plain, heavier = (steps(heavy, poses[:40], wrenches[:40], gravity=weighs).d for weighs in (False, True))
        assert np.abs(heavier - plain).max() > 1e-5  # the weight is not small here


def test_correction_undoes_the_deflection(chain: ElasticChain, poses: Float, wrenches: Float) -> None:
    for gravity in (False, True):
        fix = steps(chain, poses, wrenches, gravity=gravity)
        good = (fix.status == 0) & (fix.sigma > 0.05)
        assert np.mean(good) > 0.5
        q, w = poses[good], wrenches[good]
        after = pose.difference(forward(chain, q), forward_elastic(chain, fix.q_c[good], w, gravity=gravity))
        np.testing.assert_allclose(after, fix.residual[good], atol=1e-12)
        before = np.linalg.norm(fix.d[good, :3], axis=1)
        assert np.all(np.linalg.norm(after[:, :3], axis=1) < 0.02 * before + 1e-9)
        moved = pose.difference(forward(chain, q), forward(chain, fix.q_c[good]))[:, :3]
        assert np.all(np.sum(moved * fix.d[good, :3], axis=1) < 0.0)  # correction opposes deflection


def test_step_near_a_singularity_damps_clamps_and_refuses(haehn: ElasticChain, poses: Float) -> None:
    step = ElasticStep(haehn)
    w = np.array([200.0, -300.0, 250.0, 5.0, 5.0, 5.0])
    q = poses[0].copy()
    seen = 0
    for bend in np.geomspace(0.5, 1e-4, 120):
        q[4] = bend
        status = step(q, w)
        seen |= status
        assert np.all(np.isfinite(step.q_c))
        assert np.max(np.abs(step.q_c - q)) <= 0.2 + 1e-12
        assert bool(status & REFUSED) == (step.sigma < REFUSE_BELOW)
        assert bool(status & DAMPED) == (REFUSE_BELOW <= step.sigma < DAMPING_BELOW)
        smallest = np.linalg.svd(jacobian(haehn, q), compute_uv=False)[-1]
        assert smallest / np.sqrt(6.0) <= step.sigma * (1 + 1e-6)
        assert step.sigma <= smallest * (1 + 1e-6)
        if status & REFUSED:
            np.testing.assert_array_equal(step.q_c, q)
            np.testing.assert_array_equal(step.residual, step.d)
    assert seen & REFUSED
    assert seen & DAMPED
    assert not seen & ~(REFUSED | DAMPED | CLAMPED)


def test_step_takes_anything_numpy_copies_and_refuses_nan(haehn: ElasticChain, poses: Float, wrenches: Float) -> None:
    step = ElasticStep(haehn)
    q, w = poses[0], wrenches[0]
    step(q, w)
    want = step.q_c.copy()
    for form in (list(q), tuple(q), q[::-1].copy()[::-1], np.asfortranarray(q)):
        step(form, list(w))  # type: ignore[arg-type]
        np.testing.assert_array_equal(step.q_c, want)
    step.q[:] = q
    step.w[:] = w
    step.run()
    np.testing.assert_array_equal(step.q_c, want)
    np.testing.assert_allclose(step.T0, forward(haehn, q), atol=1e-15)
    np.testing.assert_allclose(step.Te, forward_elastic(haehn, q, w), atol=1e-15)
    with pytest.raises(InputError):
        step(q[:5], w)
    assert step(np.full(6, np.nan), w) == REFUSED


def test_bad_requests(haehn: ElasticChain, poses: Float, wrenches: Float) -> None:
    q, w = poses[0], wrenches[0]
    with pytest.raises(InputError, match="nonlinear"):
        deflection(haehn, q, w, nonlinear=False, gravity=True)
    with pytest.raises(InputError, match="w_tcp_base"):
        deflection(haehn, q, w[:3])
    with pytest.raises(InputError, match="finite"):
        deflection(haehn, q, w * np.nan)
    with pytest.raises(InputError, match="match"):
        deflection(haehn, poses[:3], wrenches[:4])
    with pytest.raises(ModelError, match="unit"):
        deflection(haehn, q, w * 1e4)
    with pytest.raises(ModelError):
        forward_elastic(haehn, q, w * 1e6, equilibrium=True)
