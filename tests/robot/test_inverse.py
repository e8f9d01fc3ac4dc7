"""Inverse kinematics: round trips, branches, limits, singularities, reach, loads, paths."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import assume, given, settings, strategies as st

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError, ReachError
from counterflex.core.units import DEG
from counterflex.geometry import pose, rotation
from counterflex.robot.elasticity.chain import ElasticChain, forward, forward_elastic, frames, jacobian
from counterflex.robot.kinematics import inverse_kernel
from counterflex.robot.kinematics.inverse import SIGMA_FLOOR, inverse, inverse_all, inverse_path
from counterflex.robot.kinematics.inverse_seeds import arm_length, branch_of
from counterflex.robot.model import catalog, opw
from counterflex.robot.model.description import EndEffector, Opw, Robot, Segment

KR300 = "kuka_kr300_r2500_ultra"
FANUC_OFFSETS = (0.0, 0.0, -math.pi / 2, 0.0, 0.0, -math.pi)
FANUC = catalog.from_opw(
    "fanuc_convention",
    Opw(0.312, -0.225, 0.0, 0.67, 1.075, 1.28, 0.215, FANUC_OFFSETS, (1, 1, -1, -1, -1, -1)),
    np.array([[-183, 183], [-57, 74], [-132, 172], [-355, 355], [-115, 115], [-355, 355]]) * DEG,
)  # fmt: skip
ROBOTS: dict[str, Robot] = {
    "kuka": catalog.load(KR300),
    "kuka_generation_2": catalog.load("kuka_kr210_r2700_2"),
    "abb": catalog.load("abb_irb6700_235_265"),
    "staubli_with_lateral_offset": catalog.load("staubli_tx2_90l"),
    "fanuc": FANUC,
}
TOOL = EndEffector((), pose.from_xyz_zyx(np.array([0.16, 0.02, 0.21]), np.array([0.3, 1.2, -0.2])))
CHAINS = {name: ElasticChain.build(robot, TOOL) for name, robot in ROBOTS.items()}
KUKA = CHAINS["kuka"]
Q = np.array([30.0, -70.0, 100.0, 40.0, 50.0, -60.0]) * DEG
W = np.array([500.0, 300.0, -400.0, 20.0, 30.0, 10.0])
unit = st.tuples(*[st.floats(0.001, 0.999)] * 6)


def within(chain: ElasticChain, share: tuple[float, ...]) -> Float:
    low, high = chain.joint_limits_rad.T
    out: Float = low + (high - low) * np.array(share)
    return out


def scaled_sigma(chain: ElasticChain, q: Float) -> float:
    J = jacobian(chain, q)
    J[:3] /= arm_length(chain) / 2.0
    return float(np.linalg.svd(J, compute_uv=False)[-1])


def circle(n: int, turns: float = 1.0, radius: float = 0.15) -> Float:
    """A path round the pose of Q."""
    Ts = np.repeat(forward(KUKA, Q)[None], n, axis=0)
    u = np.linspace(0.0, 2.0 * math.pi * turns, n)
    Ts[:, 0, 3] += radius * (np.cos(u) - 1.0)
    Ts[:, 1, 3] += radius * np.sin(u)
    return Ts


@pytest.mark.parametrize("name", ROBOTS)
@settings(max_examples=40, deadline=None)
@given(share=unit)
def test_every_solution_reaches_the_pose_and_the_given_one_is_among_them(name: str, share: tuple[float, ...]) -> None:
    chain = CHAINS[name]
    q = within(chain, share)
    assume(scaled_sigma(chain, q) > 0.01)
    T = forward(chain, q)
    solutions = inverse_all(chain, T)
    for s in solutions:
        np.testing.assert_allclose(forward(chain, s.q), T, rtol=0, atol=1e-10)
        room = np.minimum(s.q - chain.joint_limits_rad[:, 0], chain.joint_limits_rad[:, 1] - s.q)
        assert s.limit_margin_rad == pytest.approx(room.min(), abs=1e-12)
        assert s.limit_margin_rad >= -opw.LIMIT_SLACK_RAD
        assert s.limit_axis == int(np.argmin(room))
        assert s.sigma_min == pytest.approx(scaled_sigma(chain, s.q), rel=2e-4, abs=1e-7)
        assert s.branch == branch_of(chain, s.q)
    margins = [s.limit_margin_rad for s in solutions]
    assert margins == sorted(margins, reverse=True)
    angles = np.array([s.q for s in solutions])
    gaps = np.abs(angles[:, None] - angles[None]).max(axis=-1) + np.eye(len(angles))
    assert gaps.min() > 1e-6
    assert np.abs(inverse(chain, T, q).q - q).max() < 1e-8


@pytest.mark.parametrize("name", ROBOTS)
def test_closed_form_branches_agree_with_the_segment_chain(name: str) -> None:
    """200 random poses: every branch that exists reaches the pose, its slot is its name, the given angles are found."""
    robot = ROBOTS[name]
    assert robot.opw is not None
    chain = ElasticChain.build(robot, None)
    rng = np.random.default_rng(7)
    q = rng.uniform(robot.joint_limits_rad[:, 0], robot.joint_limits_rad[:, 1], (200, 6))
    Ts = forward(chain, q)
    rows = opw.branches(robot.opw, Ts)
    exists = np.isfinite(rows[..., 0])
    assert exists.any(axis=1).all()
    for i, slot in np.argwhere(exists):
        np.testing.assert_allclose(forward(chain, rows[i, slot]), Ts[i], rtol=0, atol=1e-11)
        assert opw.slots_of(robot.opw, rows[i, slot][None]) == [slot]
    slots = opw.slots_of(robot.opw, q)
    gap = rows[np.arange(200), slots] - q
    assert np.abs(gap - 2 * np.pi * np.round(gap / (2 * np.pi))).max() < 1e-9
    for slot in range(8):
        reserve = opw.extension(robot.opw, Ts, back=opw.BRANCHES[slot].startswith("back"))
        np.testing.assert_array_equal(exists[:, slot], reserve >= 0.0)


def test_branch_names_describe_the_arm() -> None:
    """Up: the elbow above the line from shoulder to wrist; front: the wrist ahead of axis 1."""
    chain = ElasticChain.build(ROBOTS["kuka"], None)
    T = forward(chain, np.array([20.0, -80.0, 95.0, 30.0, 40.0, 10.0]) * DEG)
    seen = set()
    for s in inverse_all(chain, T, within_limits=False):
        Ts = frames(chain, s.q)
        place = {segment: Ts[i, :3, 3] for i, segment in enumerate(chain.names)}
        shoulder, elbow, wrist = place["axis2"], place["axis3"], place["axis5"]
        chord = wrist - shoulder
        share = float((elbow - shoulder) @ chord / (chord @ chord))
        above = elbow[2] > (shoulder + share * chord)[2]
        ahead = float((wrist - place["axis1"])[:2] @ shoulder[:2]) > 0.0
        assert s.branch.split()[:2] == ["front" if ahead else "back", "up" if above else "down"]
        seen.add(s.branch)
    assert seen == set(opw.BRANCHES)


def test_every_full_turn_within_limits_is_listed() -> None:
    solutions = inverse_all(KUKA, forward(KUKA, Q))
    same_wrist = [s.q for s in solutions if s.branch == "front up noflip"]
    turned = {tuple(np.round((q - Q) / (2 * np.pi)).astype(int)) for q in same_wrist}
    assert turned == {(0, 0, 0, i, 0, j) for i in (0, -1) for j in (0, 1)}  # A4 = 40, -320; A6 = -60, 300 deg


def test_loaded_chain_meets_the_pose_with_its_load() -> None:
    T = forward(KUKA, Q)
    solution = inverse(KUKA, T, Q, w_tcp_base=W, gravity=True)
    np.testing.assert_allclose(forward_elastic(KUKA, solution.q, W, gravity=True), T, rtol=0, atol=2e-11)
    assert 1e-5 < np.abs(solution.q - Q).max() < 5e-3
    for s in inverse_all(KUKA, T, w_tcp_base=W, gravity=True):
        np.testing.assert_allclose(forward_elastic(KUKA, s.q, W, gravity=True), T, rtol=0, atol=2e-11)


@settings(max_examples=25, deadline=None)
@given(share=unit, seed=st.integers(0, 1000))
def test_identified_geometry_off_the_closed_form_is_polished(share: tuple[float, ...], seed: int) -> None:
    """Every link moved by about 1 mm and 1 mrad: the closed form alone misses, the result does not."""
    rng = np.random.default_rng(seed)
    robot = ROBOTS["kuka"]
    moved = tuple(
        dataclasses.replace(s, T_prev_seg=s.T_prev_seg @ pose.displaced(np.eye(4), rng.normal(0.0, 1e-3, 6)))
        for s in robot.segments
    )
    chain = ElasticChain.build(dataclasses.replace(robot, segments=moved), TOOL)
    q = within(chain, share)
    assume(scaled_sigma(chain, q) > 0.02)
    T = forward(chain, q)
    assert np.abs(inverse(chain, T, q).q - q).max() < 1e-8


def test_geometry_without_closed_form_is_solved_from_many_starts() -> None:
    """A wrist with 30 mm between axes 5 and 6 has no closed form."""
    robot = ROBOTS["kuka"]
    last = robot.segments[-1]
    shifted = last.T_prev_seg.copy()
    shifted[0, 3] += 0.03
    segments = (*robot.segments[:-1], dataclasses.replace(last, T_prev_seg=shifted))
    chain = ElasticChain.build(dataclasses.replace(robot, segments=segments, opw=None), TOOL)
    T = forward(chain, Q)
    solutions = inverse_all(chain, T)
    assert {s.branch for s in solutions} >= {"front up noflip", "front up flip"}
    assert min(np.abs(s.q - Q).max() for s in solutions) < 1e-8
    assert all(s.extension_m is None for s in solutions)
    for s in solutions:
        np.testing.assert_allclose(forward(chain, s.q), T, rtol=0, atol=1e-10)
    path = inverse_path(chain, np.stack([T, pose.displaced(T, np.array([0.1, 0, 0, 0, 0, 0]))]), Q)
    assert path.extension_m is None


def test_singular_wrist_is_reported_and_refused() -> None:
    home = np.array([0.0, -90.0, 90.0, 0.0, 0.0, 0.0]) * DEG
    T = forward(KUKA, home)
    solutions = inverse_all(KUKA, T)
    wrist = [s for s in solutions if s.branch.startswith("front up")]
    assert wrist
    assert all(s.wrist < 1e-6 and s.sigma_min < 1e-6 for s in wrist)
    for s in solutions:
        np.testing.assert_allclose(forward(KUKA, s.q), T, rtol=0, atol=1e-9)
    with pytest.raises(ReachError, match="axis 5 near zero"):
        inverse(KUKA, T, home)
    for a5 in (1e-9, 1e-8, 1e-6, 1e-3):  # nearly straight: every branch is still there, to rounding
        bent = np.array([*home[:3], 0.5, a5, 0.3])
        assert {s.branch for s in inverse_all(KUKA, forward(KUKA, bent))} >= {"front up noflip", "front up flip"}
        np.testing.assert_allclose(inverse(KUKA, forward(KUKA, bent), bent, sigma_floor=0.0).q[:3], bent[:3], atol=1e-9)
    turned = home + np.array([0.0, 0.0, 0.0, 0.4, 0.0, -0.4])
    near = inverse(KUKA, T, turned, sigma_floor=0.0)
    np.testing.assert_allclose(near.q, turned, atol=1e-9)


def test_pose_out_of_reach_says_by_how_much() -> None:
    chain = ElasticChain.build(ROBOTS["kuka"], None)
    T = forward(chain, np.array([0.0, -45.0, 45.0, 0.0, 30.0, 0.0]) * DEG)
    arm = math.hypot(0.041, 1.0) + 1.15
    away = np.array([math.cos(0.3), 0.0, math.sin(0.3)])
    wrist = np.array([0.35, 0.0, 0.675]) + (arm + 0.25) * away
    T[:3, 3] = wrist + 0.24 * T[:3, 2]
    with pytest.raises(ReachError, match=r"250\.0 mm beyond"):
        inverse_all(chain, T)


def test_pose_reached_only_outside_the_limits_names_the_axis() -> None:
    limits = KUKA.joint_limits_rad.copy()
    limits[0] = [-10 * DEG, 10 * DEG]
    chain = dataclasses.replace(KUKA, joint_limits_rad=limits)
    with pytest.raises(ReachError, match=r"axis 1 is out; got -?\d+.*expected -10.000..10.000 deg"):
        inverse_all(chain, forward(chain, Q))
    outside = inverse_all(chain, forward(chain, Q), within_limits=False)
    assert {s.branch for s in outside} >= {"front up noflip"}
    assert all(s.limit_margin_rad < 0.0 for s in outside)


def test_path_is_followed_on_one_branch() -> None:
    Ts = circle(3000, turns=3.0)
    path = inverse_path(KUKA, Ts, Q)
    np.testing.assert_allclose(forward(KUKA, path.q), Ts, rtol=0, atol=1e-10)
    assert np.abs(np.diff(path.q, axis=0)).max() < 0.01
    assert path.branch == "front up noflip"
    room = np.minimum(path.q - KUKA.joint_limits_rad[:, 0], KUKA.joint_limits_rad[:, 1] - path.q)
    np.testing.assert_allclose(path.limit_margin_rad, room.min(axis=1), atol=1e-12)
    np.testing.assert_array_equal(path.limit_axis, room.argmin(axis=1))
    np.testing.assert_allclose(path.wrist, np.abs(np.sin(path.q[:, 4])), atol=1e-9)
    assert path.sigma_min[1500] == pytest.approx(scaled_sigma(KUKA, path.q[1500]), rel=2e-4)
    assert path.extension_m is not None
    single = inverse(KUKA, Ts[700], path.q[699])
    assert path.extension_m[700] == pytest.approx(single.extension_m)
    np.testing.assert_allclose(single.q, path.q[700], atol=1e-9)


def test_loaded_path_meets_every_pose_under_its_own_load() -> None:
    Ts = circle(500)
    ws = W * np.linspace(-1.0, 1.0, 500)[:, None]
    path = inverse_path(KUKA, Ts, Q, w_tcp_base=ws, gravity=True)
    np.testing.assert_allclose(forward_elastic(KUKA, path.q, ws, gravity=True), Ts, rtol=0, atol=2e-11)


def test_coarse_path_ends_on_the_same_turn_as_a_fine_one() -> None:
    """Half a metre and a third of a turn between points: the way between is a linear move."""
    T0 = forward(KUKA, Q)
    step = np.array([0.1, 0.4, -0.2, 0.3, -0.5, 1.8])
    fine = np.array([pose.displaced(T0, f * step) for f in np.linspace(0.0, 1.0, 4000)])
    fine[:, :3, :3] = rotation.exp(np.linspace(0.0, 1.0, 4000)[:, None] * step[3:]) @ T0[:3, :3]
    dense = inverse_path(KUKA, fine, Q)
    sparse = inverse_path(KUKA, fine[[0, -1]], Q)
    np.testing.assert_allclose(sparse.q[-1], dense.q[-1], atol=1e-8)
    assert sparse.sigma_min[-1] == pytest.approx(dense.sigma_min.min(), rel=0.2)


def test_path_names_the_first_point_that_leaves_the_limits() -> None:
    limits = KUKA.joint_limits_rad.copy()
    limits[0] = [25 * DEG, 33 * DEG]
    chain = dataclasses.replace(KUKA, joint_limits_rad=limits)
    Ts = circle(2000)
    free = inverse_path(KUKA, Ts, Q).q[:, 0]
    first = int(np.argmax((free < limits[0, 0]) | (free > limits[0, 1])))
    assert first > 0
    with pytest.raises(ReachError, match=rf"path point {first}: axis 1 leaves its range") as caught:
        inverse_path(chain, Ts, Q)
    assert caught.value.data["point"] == first
    assert caught.value.data["axis"] == 0
    measured = inverse_path(chain, Ts, Q, enforce_limits=False)
    assert int(np.argmax(measured.limit_margin_rad < 0.0)) == first
    assert inverse_path(chain, Ts[:first], Q).q.shape == (first, 6)


def test_path_through_the_wrist_singularity_is_refused_dense_or_coarse() -> None:
    bare = ElasticChain.build(ROBOTS["kuka"], None)
    start = np.array([0.0, -80.0, 100.0, 0.5, 8.0, 0.0]) * DEG
    T = forward(bare, start)
    for points in (2, 30, 2000):
        swing = np.linspace(0.0, 16.0 * DEG, points)  # tips the flange through axis 4, missing it by a little
        Ts = np.repeat(T[None], points, axis=0)
        Ts[:, :3, :3] = rotation.exp(swing[:, None] * np.array([0.0, -1.0, 0.0])) @ T[:3, :3]
        wrist = T[:3, 3] - 0.24 * T[:3, 2]
        Ts[:, :3, 3] = wrist + 0.24 * Ts[:, :3, 2]
        with pytest.raises(ReachError, match="singularity") as caught:
            inverse_path(bare, Ts, start)
        assert "path point" in str(caught.value)


def test_path_out_of_reach_names_the_point() -> None:
    Ts = np.repeat(forward(KUKA, Q)[None], 100, axis=0)
    Ts[:, 0, 3] += np.linspace(0.0, 2.0, 100)
    with pytest.raises(ReachError, match=r"path point \d+") as caught:
        inverse_path(KUKA, Ts, Q, enforce_limits=False, sigma_floor=0.0)
    assert inverse_path(KUKA, Ts[: caught.value.data["point"]], Q, enforce_limits=False, sigma_floor=0.0).q.size
    with pytest.raises(ReachError, match="path point 0"):
        inverse_path(KUKA, Ts[::-1])


def test_path_without_a_start_finds_a_branch_that_carries_through() -> None:
    """The first point leaves most room in a branch that later runs out of it."""
    Ts = circle(400, radius=0.3)
    options = {s.branch: inverse_path(KUKA, Ts, s.q, enforce_limits=False) for s in inverse_all(KUKA, Ts[0])}
    lasting, leaving = (
        options[name].q[:, 3] - 2 * np.pi * np.round((options[name].q[0, 3] - middle * DEG) / (2 * np.pi))
        for name, middle in (("front up noflip", 40.0), ("front up flip", 220.0))
    )
    up = leaving.max() - leaving[0]
    limits = KUKA.joint_limits_rad.copy()
    limits[3] = [
        lasting.min() - 0.001,
        leaving[0] + 0.9 * up,
    ]  # axis 4 of the leaving branch starts with 0.9 up to spare
    assert lasting[0] - limits[3, 0] < 0.9 * up  # the lasting one with less, at the other end
    chain = dataclasses.replace(KUKA, joint_limits_rad=limits)
    first = inverse_all(chain, Ts[0])[0]
    assert first.branch == "front up flip"
    with pytest.raises(ReachError, match="axis 4 leaves its range"):
        inverse_path(chain, Ts, first.q)
    chosen = inverse_path(chain, Ts)
    np.testing.assert_allclose(forward(chain, chosen.q), Ts, rtol=0, atol=1e-10)
    assert chosen.limit_margin_rad.min() >= 0.0
    named = inverse_path(KUKA, Ts, "front up flip")
    assert named.branch == "front up flip"


@settings(max_examples=200, deadline=None)
@given(
    direction=st.tuples(*[st.floats(-1.0, 1.0)] * 3),
    size=st.one_of(st.floats(0.0, 3.14), st.just(math.pi), st.floats(0.0, 1e-6)),
)
def test_compiled_rotation_vector_is_the_logarithm(direction: tuple[float, float, float], size: float) -> None:
    norm = float(np.linalg.norm(direction))
    assume(norm > 0.1)
    v = np.array(direction) / norm * size
    out = np.empty(3)
    inverse_kernel.rotation_vector(rotation.exp(v), out)
    np.testing.assert_allclose(rotation.exp(out), rotation.exp(v), atol=1e-7 if size > 3.1 else 1e-13)


def test_bad_input_is_refused() -> None:
    T = forward(KUKA, Q)
    skewed = T.copy()
    skewed[0, 0] += 0.01
    mirrored = T.copy()
    mirrored[:3, 2] *= -1.0
    for bad in (skewed, mirrored):
        with pytest.raises(InputError, match="proper rotation"):
            inverse_all(KUKA, bad)
    with pytest.raises(InputError, match="pose 1"):
        inverse_path(KUKA, np.stack([T, skewed]), Q)
    with pytest.raises(InputError, match="finite"):
        inverse_all(KUKA, T * np.nan)
    with pytest.raises(InputError, match="shape"):
        inverse_all(KUKA, T[:3])
    with pytest.raises(InputError, match="unknown branch"):
        inverse(KUKA, T, "elbow left")
    with pytest.raises(InputError, match="unknown branch"):
        inverse_path(KUKA, T[None], "elbow left")
    with pytest.raises(InputError, match="no points"):
        inverse_path(KUKA, np.empty((0, 4, 4)), Q)
    with pytest.raises(InputError, match="shape"):
        inverse_path(KUKA, T[None], Q, w_tcp_base=np.zeros((3, 6)))
    with pytest.raises(ReachError, match="not reached in branch"):
        inverse(KUKA, T, "back up noflip")
    assert SIGMA_FLOOR > 0.0


def test_segment_defaults_make_a_rigid_massless_body() -> None:
    assert not np.any(Segment("plate", np.eye(4)).compliance)
