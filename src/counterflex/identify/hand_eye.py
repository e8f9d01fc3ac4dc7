"""Where the tracker stands and where its target sits, from robot poses: closed form, and robust to gross errors.

Robot poses ``A_i = T_base_tcp`` and measured ``B_i = T_tracker_target`` obey ``A_i X = Z B_i``: ``X = T_tcp_target``
and ``Z = T_base_tracker``. The rotations are the common null vector of ``R_A R_X - R_Z R_B = 0``, a linear system in
their 18 entries; then the positions are linear. From points alone the rotation comes from rigid registration, in turns
with the reflector's offset.

Source: M. Shah, J. Mechanisms Robotics 5 (2013) 031007 (separable Kronecker solution of AX = YB).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int, as_float
from counterflex.core.errors import InputError
from counterflex.geometry import pose

FEWEST: Final = 3
TRIALS: Final = 200
LENGTH_M: Final = 0.5
"""Arm at which a rotation error counts like a position error where both are judged together."""
_SAMPLE = 5
_POINT_SAMPLE = 8
_LEAST_TURN = 1e-3
_INLIER = 6.0


@dataclass(frozen=True, eq=False)
class HandEye:
    """Frames found.

    Attributes:
        T_base_tracker: (4, 4).
        T_tcp_target: (4, 4); its rotation is identity where only points were measured.
        error_m: (m,) distance of each measurement from its prediction, rotations counted at :data:`LENGTH_M`.
        good: (m,) measurements that are no gross errors.
    """

    T_base_tracker: Float
    T_tcp_target: Float
    error_m: Float
    good: Bool

    @property
    def median_m(self) -> float:
        """Median of the errors."""
        return float(np.median(self.error_m))


def of_poses(Ts_base_tcp: Float, Ts_tracker_target: Float) -> tuple[Float, Float]:
    """Tracker and target by least squares over all poses.

    Args:
        Ts_base_tcp: (m, 4, 4) robot poses, m.
        Ts_tracker_target: (m, 4, 4) measured poses.

    Returns:
        T_base_tracker (4, 4), T_tcp_target (4, 4).

    Raises:
        InputError: Fewer than three poses, or poses that do not turn about two different axes.
    """
    A = as_float("Ts_base_tcp", Ts_base_tcp, (None, 4, 4))
    B = as_float("Ts_tracker_target", Ts_tracker_target, (None, 4, 4))
    if len(A) != len(B) or len(A) < FEWEST:
        raise InputError(
            "hand-eye calibration needs matching poses", value=(len(A), len(B)), limit=f"{FEWEST} or more each"
        )
    RA, RB = A[:, :3, :3], B[:, :3, :3]
    # R_A R_X = R_Z R_B  <=>  sum over i of kron(R_B, R_A) carries vec(R_X) to n vec(R_Z): its largest singular pair.
    K = np.einsum("mab,mcd->acbd", RB, RA).reshape(9, 9) / len(A)
    u, s, vt = np.linalg.svd(K)
    if s[1] > 1.0 - _LEAST_TURN**2:
        raise InputError(
            "the poses do not turn the target about two different axes, so its offset is free",
            value=f"{len(A)} poses",
            hint="Measure poses with the wrist turned by 30 deg or more about different axes",
        )
    R_X, R_Z = _proper(vt[0].reshape(3, 3).T), _proper(u[:, 0].reshape(3, 3).T)
    if np.linalg.det(vt[0].reshape(3, 3)) < 0.0:
        R_X, R_Z = _proper(-vt[0].reshape(3, 3).T), _proper(-u[:, 0].reshape(3, 3).T)
    m = len(A)
    left = np.concatenate([RA, np.broadcast_to(-np.eye(3), (m, 3, 3))], axis=-1).reshape(-1, 6)
    right = (B[:, :3, 3] @ R_Z.T - A[:, :3, 3]).reshape(-1)
    t, *_ = np.linalg.lstsq(left, right, rcond=None)
    return pose.make(R_Z, t[3:]), pose.make(R_X, t[:3])


def _proper(M: Float) -> Float:
    u, _, vt = np.linalg.svd(M)
    out: Float = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    return out


def of_points(Ts_base_tcp: Float, p_tracker_target: Float, p_tcp_target: Float | None = None) -> tuple[Float, Float]:
    """Tracker and offset of a reflector by least squares, in turns.

    Args:
        Ts_base_tcp: (m, 4, 4) robot poses, m.
        p_tracker_target: (m, 3) measured points.
        p_tcp_target: (3,) first guess of the offset; None is the tool centre point.

    Returns:
        T_base_tracker (4, 4), T_tcp_target (4, 4) without rotation.

    Raises:
        InputError: Fewer than four points, points on one line.
    """
    from counterflex.geometry.registration import register

    A, p = as_float("Ts_base_tcp", Ts_base_tcp, (None, 4, 4)), as_float("p_tracker_target", p_tracker_target, (None, 3))
    if len(A) != len(p) or len(A) <= FEWEST:
        raise InputError("a reflector's offset needs matching poses", value=(len(A), len(p)), limit="4 or more each")
    offset = np.zeros(3) if p_tcp_target is None else np.array(p_tcp_target, dtype=np.float64)
    T_base_tracker = np.eye(4)
    RA = A[:, :3, :3]
    for _ in range(30):
        T_base_tracker, _ = register(pose.transform(A, offset), p)
        # Position of the tracker and offset together, its rotation held; then once more.
        left = np.concatenate([RA, np.broadcast_to(-np.eye(3), (len(A), 3, 3))], axis=-1).reshape(-1, 6)
        right = (p @ T_base_tracker[:3, :3].T - A[:, :3, 3]).reshape(-1)
        t, *_ = np.linalg.lstsq(left, right, rcond=None)
        change = float(np.max(np.abs(t[:3] - offset)))
        offset = t[:3]
        T_base_tracker = pose.make(T_base_tracker[:3, :3], t[3:])
        if change < 1e-7:
            break
    return T_base_tracker, pose.make(p=offset)


def robust_of_poses(Ts_base_tcp: Float, Ts_tracker_target: Float, *, seed: int = 0, trials: int = TRIALS) -> HandEye:
    """:func:`of_poses` that survives up to about 40 % of gross errors: the best of many small samples, then refined.

    Args:
        Ts_base_tcp: (m, 4, 4) robot poses, m.
        Ts_tracker_target: (m, 4, 4) measured poses.
        seed: Of the samples.
        trials: Samples; 0 is plain least squares, then refined.

    Raises:
        InputError: As :func:`of_poses`.
    """

    def error(Z: Float, X: Float) -> Float:
        T = pose.inverse(Z) @ Ts_base_tcp @ X
        d = pose.difference(T, Ts_tracker_target)
        out: Float = np.sqrt(np.sum(d[:, :3] ** 2, axis=1) + LENGTH_M**2 * np.sum(d[:, 3:] ** 2, axis=1))
        return out

    return _best(
        len(Ts_base_tcp),
        _SAMPLE,
        lambda rows: of_poses(Ts_base_tcp[rows], Ts_tracker_target[rows]),
        error,
        seed,
        trials,
    )


def robust_of_points(
    Ts_base_tcp: Float,
    p_tracker_target: Float,
    p_tcp_target: Float | None = None,
    *,
    seed: int = 0,
    trials: int = TRIALS,
) -> HandEye:
    """:func:`of_points` that survives gross errors. Arguments and errors as there."""

    def error(Z: Float, X: Float) -> Float:
        p = pose.transform(pose.inverse(Z), pose.transform(Ts_base_tcp, X[:3, 3]))
        out: Float = np.linalg.norm(p - p_tracker_target, axis=1)
        return out

    def fit(rows: Int | Bool) -> tuple[Float, Float]:
        return of_points(Ts_base_tcp[rows], p_tracker_target[rows], p_tcp_target)

    return _best(len(Ts_base_tcp), _POINT_SAMPLE, fit, error, seed, trials)


def _best(
    count: int,
    sample: int,
    fit: Callable[[Int | Bool], tuple[Float, Float]],
    error: Callable[[Float, Float], Float],
    seed: int,
    trials: int,
) -> HandEye:
    """Least median of errors over random samples, then least squares over what agrees with the best."""
    Z, X = fit(np.ones(count, dtype=np.bool_))
    best = error(Z, X)
    rng = np.random.default_rng(seed)
    for _ in range(trials if count > sample else 0):
        try:
            trial = fit(rng.choice(count, sample, replace=False).astype(np.int64))
        except InputError:  # a sample that does not turn enough says nothing
            continue
        errors = error(*trial)
        if np.median(errors) < np.median(best):
            (Z, X), best = trial, errors
    for _ in range(5):
        good = best <= _INLIER * max(float(np.median(best)), 1e-12)
        try:
            trial = fit(good)
        except InputError:
            break
        errors = error(*trial)
        if np.median(errors) > 1.2 * np.median(best):
            break
        (Z, X), best = trial, errors
    return HandEye(Z, X, best, best <= _INLIER * max(float(np.median(best)), 1e-12))
