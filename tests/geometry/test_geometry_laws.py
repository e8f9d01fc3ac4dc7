"""Geometry by its laws, over three regimes of angle: uniform, small, and 1e-7 from identity."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, strategies as st
from scipy.spatial.transform import Rotation

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.geometry import pose, rotation
from counterflex.geometry.circle import angle_to, circle, turned
from counterflex.geometry.rotation import inverse_left_jacobian, left_jacobian
from twists import adjoint

seeds = st.integers(0, 2**32 - 1)
regimes = st.sampled_from([3.0, 0.1, 1e-4, 1e-7])


def _rotvec(seed: int, scale: float) -> Float:
    rng = np.random.default_rng(seed)
    v = rng.normal(size=3)
    out: Float = v / np.linalg.norm(v) * scale * rng.uniform(0.1, 1.0)
    return out


def _pose(seed: int, scale: float = 3.0) -> Float:
    return pose.make(rotation.exp(_rotvec(seed, scale)), np.random.default_rng(seed + 1).normal(size=3))


@given(seeds, regimes)
def test_exp_is_scipys_and_log_undoes_it(seed: int, scale: float) -> None:
    v = _rotvec(seed, scale)
    R = rotation.exp(v)
    np.testing.assert_allclose(R, Rotation.from_rotvec(v).as_matrix(), atol=1e-14)
    np.testing.assert_allclose(rotation.log(R), v, rtol=1e-8, atol=1e-15)


@given(seeds)
def test_log_near_half_turn_is_exact(seed: int) -> None:
    axis = _rotvec(seed, 1.0)
    axis /= np.linalg.norm(axis)
    v = axis * (np.pi - 1e-9)
    np.testing.assert_allclose(rotation.exp(rotation.log(rotation.exp(v))), rotation.exp(v), atol=1e-14)


@given(seeds)
def test_batches_equal_singles(seed: int) -> None:
    v = np.stack([_rotvec(seed + i, s) for i, s in enumerate([3.0, 0.1, 1e-7, 1e-4])])
    R = rotation.exp(v)
    for i in range(4):
        np.testing.assert_array_equal(R[i], rotation.exp(v[i]))
        np.testing.assert_allclose(rotation.log(R)[i], rotation.log(R[i]), atol=1e-16)


@given(seeds)
def test_zyx_angles_and_quaternion_round_trip(seed: int) -> None:
    R = rotation.exp(_rotvec(seed, 3.1))
    np.testing.assert_allclose(rotation.from_zyx(rotation.to_zyx(R)), R, atol=1e-14)
    q = rotation.quat_wxyz(R)
    assert q[0] >= 0.0
    np.testing.assert_allclose(rotation.from_quat_wxyz(q), R, atol=1e-14)
    abc = np.array([0.3, 0.2, 0.1])
    np.testing.assert_allclose(rotation.from_zyx(abc), Rotation.from_euler("ZYX", abc).as_matrix(), atol=1e-15)


@pytest.mark.parametrize("b", [np.pi / 2, -np.pi / 2])
def test_zyx_at_gimbal_lock_still_gives_the_rotation(b: float) -> None:
    R = rotation.from_zyx(np.array([0.7, b, -0.4]))
    np.testing.assert_allclose(rotation.from_zyx(rotation.to_zyx(R)), R, atol=1e-12)


@given(seeds)
def test_pose_group_axioms(seed: int) -> None:
    T_a_b, T_b_c, T_c_d = _pose(seed), _pose(seed + 7), _pose(seed + 9)
    np.testing.assert_allclose((T_a_b @ T_b_c) @ T_c_d, T_a_b @ (T_b_c @ T_c_d), atol=1e-13)
    np.testing.assert_allclose(T_a_b @ pose.inverse(T_a_b), np.eye(4), atol=1e-14)


@given(seeds, regimes)
def test_difference_and_displaced_are_inverse(seed: int, scale: float) -> None:
    T_a_b, T_a_c = _pose(seed), _pose(seed + 3)
    np.testing.assert_allclose(pose.displaced(T_a_b, pose.difference(T_a_b, T_a_c)), T_a_c, atol=1e-12)
    step = np.concatenate([_rotvec(seed, 1.0), _rotvec(seed + 5, min(scale, 3.0))])
    np.testing.assert_allclose(pose.difference(T_a_b, pose.displaced(T_a_b, step)), step, atol=1e-12)


@given(seeds)
def test_wrench_carries_with_unchanged_power_and_against_the_adjoint(seed: int) -> None:
    rng = np.random.default_rng(seed + 2)  # another seed than the pose's: a force along its axis would not be turned
    T_a_b = _pose(seed)
    w_b, twist_b = rng.normal(size=6), rng.normal(size=6)
    w_a, twist_a = pose.carry_wrench(T_a_b, w_b), adjoint(T_a_b) @ twist_b
    assert w_a @ twist_a == pytest.approx(w_b @ twist_b, rel=1e-12, abs=1e-12)
    np.testing.assert_allclose(w_a, np.linalg.inv(adjoint(T_a_b)).T @ w_b, atol=1e-12)


def test_force_beside_the_point_makes_a_moment() -> None:
    w = pose.shift_wrench(np.array([0.0, 100.0, 0.0, 0.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]))
    np.testing.assert_allclose(w, [0, 100, 0, 0, 0, 100])


@given(seeds)
def test_registration_recovers_a_known_pose(seed: int) -> None:
    T_a_b = _pose(seed)
    points_b = np.random.default_rng(seed).normal(size=(5, 3))
    found, residuals = pose.register(pose.transform(T_a_b, points_b), points_b)
    np.testing.assert_allclose(found, T_a_b, atol=1e-10)
    assert np.max(np.abs(residuals)) < 1e-10


@given(seeds)
def test_points_that_mirror_each_other_are_laid_on_by_a_rotation(seed: int) -> None:
    """No reflection is returned, and no rotation among 200 lies nearer."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(8, 3))
    found, residuals = pose.register(points * [1.0, 1.0, -1.0], points)
    assert np.linalg.det(found[:3, :3]) == pytest.approx(1.0)
    centred = points - points.mean(axis=0)
    goal = centred * [1.0, 1.0, -1.0]
    others = Rotation.random(200, rng=rng).as_matrix()
    nearest = min(float(np.sum((goal - centred @ R.T) ** 2)) for R in others)
    assert float(np.sum(residuals**2)) <= nearest + 1e-12


@given(seeds, regimes)
def test_left_jacobian_is_what_a_change_of_the_vector_turns(seed: int, scale: float) -> None:
    """Exp(r + dr) = Exp(J dr) Exp(r) to first order, by a central difference; its inverse undoes it."""
    r = _rotvec(seed, scale)
    J, step = left_jacobian(r), 1e-5
    for k in range(3):
        dr = step * np.eye(3)[k]
        change = rotation.log(rotation.exp(r + dr) @ rotation.exp(r - dr).T) / (2.0 * step)
        np.testing.assert_allclose(J[:, k], change, atol=1e-8)
    np.testing.assert_allclose(inverse_left_jacobian(r) @ J, np.eye(3), atol=1e-10)
    size = float(np.linalg.norm(r))  # at a small angle the skew part alone tells it from the right Jacobian
    skew_part = rotation.skew(r) * (2.0 * np.sin(0.5 * size) / size) ** 2
    np.testing.assert_allclose(J - J.T, skew_part, rtol=1e-6, atol=1e-15)


@given(seeds, st.floats(0.05, 6.2), st.floats(0.05, 0.95), st.floats(1e-3, 2.0))
def test_a_circle_is_found_by_any_three_of_its_points(seed: int, turn: float, share: float, radius: float) -> None:
    """The auxiliary point stands anywhere between, and the arc may be longer than half of the circle."""
    R, centre = rotation.exp(_rotvec(seed, 3.0)), np.random.default_rng(seed + 4).normal(size=3)
    start, auxiliary, end = (
        centre + radius * (R @ np.array([np.cos(a), np.sin(a), 0.0])) for a in (0.0, share * turn, turn)
    )
    assume(min(share * turn, (1.0 - share) * turn, 2.0 * np.pi - turn) > 0.02)
    found = circle(start, auxiliary, end)
    assert found is not None
    np.testing.assert_allclose(found[0], centre, atol=1e-9 + 1e-7 * radius)
    np.testing.assert_allclose(found[1], R[:, 2], atol=1e-6)
    assert angle_to(start, end, centre, R[:, 2]) == pytest.approx(turn, abs=1e-9)
    assert angle_to(start, auxiliary, centre, R[:, 2]) == pytest.approx(share * turn, abs=1e-9)
    assert angle_to(start, end, centre, -R[:, 2]) == pytest.approx(2.0 * np.pi - turn, abs=1e-9)
    np.testing.assert_allclose(turned(start, centre, R[:, 2], turn), end, atol=1e-12 + 1e-9 * radius)


def test_points_on_a_line_make_no_circle() -> None:
    line = np.outer([0.0, 1.0, 3.0], [1.0, 2.0, 3.0])
    assert circle(*line) is None


def test_registration_refuses_points_on_a_line() -> None:
    line = np.outer(np.arange(4.0), [1.0, 2.0, 3.0])
    with pytest.raises(InputError, match="one line"):
        pose.register(line, line)


def test_the_fast_cross_product_is_numpys_bit_for_bit() -> None:
    a, b = np.random.default_rng(8).standard_normal((2, 200, 3))
    np.testing.assert_array_equal(pose.cross(a, b), np.cross(a, b))
    np.testing.assert_array_equal([pose.cross(x, y) for x, y in zip(a, b, strict=True)], np.cross(a, b))
    np.testing.assert_array_equal(pose.cross(a[0], b), np.cross(a[0], b))


@given(seeds)
def test_a_batch_of_wrenches_is_moved_as_each_of_them(seed: int) -> None:
    """About another point, into another frame and into other axes: every row by its own lever, pose and rotation."""
    rng = np.random.default_rng(seed)
    w, lever = rng.normal(size=(4, 6)), rng.normal(size=(4, 3))
    T = pose.make(rotation.exp(rng.normal(size=(4, 3))), rng.normal(size=(4, 3)))
    for k in range(4):
        np.testing.assert_allclose(pose.shift_wrench(w, lever)[k], pose.shift_wrench(w[k], lever[k]), atol=1e-12)
        np.testing.assert_allclose(pose.carry_wrench(T, w)[k], pose.carry_wrench(T[k], w[k]), atol=1e-12)
        np.testing.assert_allclose(
            pose.rotate_wrench(T[:, :3, :3], w)[k],
            pose.rotate_wrench(T[k, :3, :3], w[k]),
            atol=1e-12,
        )
        np.testing.assert_allclose(pose.difference(T, T[::-1])[k], pose.difference(T[k], T[3 - k]), atol=1e-12)
        np.testing.assert_allclose(pose.shift_wrench(pose.shift_wrench(w, lever), -lever)[k], w[k], atol=1e-12)
