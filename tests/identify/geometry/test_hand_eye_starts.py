"""Frames of tracker and target from any poses: about one axis, nearly so, few, in a plane, with gross errors."""

from __future__ import annotations

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.geometry import pose, rotation
from counterflex.identify.geometry.hand_eye import error_of, of_points, of_poses, open_offsets
from counterflex.identify.geometry.hand_eye_robust import robust_of_poses, robust_target, robust_tracker

ROBOT_M, ROBOT_RAD = 1e-3, 1.5e-3
"""What an uncalibrated arm is off by."""


def _arm(rng: np.random.Generator, kind: str, m: int) -> Float:
    R0 = rotation.exp(rng.normal(size=3))
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    turns = {
        "free": rotation.exp(rng.normal(size=(m, 3))),
        "one axis": rotation.exp(axis * rng.uniform(-2.0, 2.0, (m, 1))) @ R0,
        "small": rotation.exp(0.1 * rng.normal(size=(m, 3))) @ R0,
        "constant": np.broadcast_to(R0, (m, 3, 3)),
    }[kind]
    return pose.make(turns, rng.normal(size=(m, 3)) * 0.3 + [1.0, 0.0, 1.0])


def _seen(rng: np.random.Generator, A: Float) -> tuple[Float, Float, Float]:
    Z = pose.make(rotation.exp(3.0 * rng.normal(size=3)), 4.0 * rng.normal(size=3))
    X = pose.make(rotation.exp(3.0 * rng.normal(size=3)), 0.2 * rng.normal(size=3))
    off = np.concatenate([ROBOT_M * rng.normal(size=(len(A), 3)), ROBOT_RAD * rng.normal(size=(len(A), 3))], axis=1)
    return Z, X, pose.inverse(Z) @ pose.displaced(A, off) @ X


@pytest.mark.parametrize("kind", ["free", "one axis", "small"])
@pytest.mark.parametrize("seed", range(6))
def test_frames_far_from_nominal_are_found_whatever_the_poses(kind: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    A = _arm(rng, kind, int(rng.integers(9, 60)))
    Z, X, B = _seen(rng, A)
    noise = np.median(error_of(A, B, Z, X))
    assert np.median(error_of(A, B, *of_poses(A, B, partly=True))) < 1.2 * noise
    p = B[:, :3, 3]
    assert np.median(error_of(A, p, *of_points(A, p, partly=True))) < 1.2 * np.median(error_of(A, p, Z, X))
    B[::6, :3, 3] += [0.5, -0.2, 0.1]
    found = robust_of_poses(A, B, partly=True, trials=50)
    assert found.median_m < 1.5 * noise
    assert not np.any(found.good[::6])


def test_the_offset_along_the_only_axis_is_zero_and_told() -> None:
    rng = np.random.default_rng(1)
    A = _arm(rng, "one axis", 40)
    _, X, B = _seen(rng, A)
    (way,) = open_offsets(A)
    found = robust_of_poses(A, B, partly=True)
    np.testing.assert_allclose(np.abs(found.open), np.abs(way[None]))
    offset = found.T_tcp_target[:3, 3]
    assert abs(way @ offset) < 1e-9
    np.testing.assert_allclose(offset, X[:3, 3] - way * (way @ X[:3, 3]), atol=3e-3)
    with pytest.raises(InputError, match="two different axes"):
        robust_of_poses(A, B)


def test_one_orientation_is_refused_by_itself_and_gives_the_tracker_of_a_known_target() -> None:
    rng = np.random.default_rng(2)
    A = _arm(rng, "constant", 20)
    Z, X, B = _seen(rng, A)
    with pytest.raises(InputError, match="have one orientation"):
        of_poses(A, B, partly=True)
    B[::5, :3, 3] += 0.3
    for measured in (B, B[:, :3, 3]):
        found = robust_tracker(A, measured, X)
        np.testing.assert_allclose(found.T_base_tracker, Z, atol=0.02)
        assert not np.any(found.good[::5])
        np.testing.assert_allclose(robust_target(A, measured, Z).T_tcp_target[:3, 3], X[:3, 3], atol=3e-3)
