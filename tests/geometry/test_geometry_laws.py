"""Geometry by its laws, over three regimes of angle: uniform, small, and 1e-7 from identity."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.geometry import pose, rotation, wrench
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
    rng = np.random.default_rng(seed)
    T_a_b = _pose(seed)
    w_b, twist_b = rng.normal(size=6), rng.normal(size=6)
    w_a, twist_a = wrench.carry(T_a_b, w_b), adjoint(T_a_b) @ twist_b
    assert w_a @ twist_a == pytest.approx(w_b @ twist_b, rel=1e-12, abs=1e-12)
    np.testing.assert_allclose(w_a, np.linalg.inv(adjoint(T_a_b)).T @ w_b, atol=1e-12)


def test_force_beside_the_point_makes_a_moment() -> None:
    w = wrench.shift(np.array([0.0, 100.0, 0.0, 0.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]))
    np.testing.assert_allclose(w, [0, 100, 0, 0, 0, 100])


@given(seeds)
def test_registration_recovers_a_known_pose(seed: int) -> None:
    T_a_b = _pose(seed)
    points_b = np.random.default_rng(seed).normal(size=(5, 3))
    found, residuals = pose.register(pose.transform(T_a_b, points_b), points_b)
    np.testing.assert_allclose(found, T_a_b, atol=1e-10)
    assert np.max(np.abs(residuals)) < 1e-10


def test_registration_refuses_points_on_a_line() -> None:
    line = np.outer(np.arange(4.0), [1.0, 2.0, 3.0])
    with pytest.raises(InputError, match="one line"):
        pose.register(line, line)


def test_the_fast_cross_product_is_numpys_bit_for_bit() -> None:
    a, b = np.random.default_rng(8).standard_normal((2, 200, 3))
    np.testing.assert_array_equal(wrench.cross(a, b), np.cross(a, b))
    np.testing.assert_array_equal([wrench.cross(x, y) for x, y in zip(a, b, strict=True)], np.cross(a, b))
    np.testing.assert_array_equal(wrench.cross(a[0], b), np.cross(a[0], b))
