"""Place of the tracker and of its target, from robot poses, by least squares over all of them.

Robot poses ``A_i = T_base_tcp`` and measured ``B_i = T_tracker_target`` obey ``A_i X = Z B_i``: ``X = T_tcp_target``
and ``Z = T_base_tracker``. Several linear starts are refined by Gauss-Newton, and the one that leaves least is taken:

- rotations as the common null vector of ``R_A R_X - R_Z R_B = 0``, then the positions. Poses that turn about one axis
  only leave a null space of three dimensions, of which noise picks any vector;
- rotations and positions together, in 24 unknowns: the positions then fix what the rotations leave open;
- the rotation of the tracker by registration of the points alone, as if the target sat at the TCP.

Where the poses turn about one axis only, the offset of the target along it goes with the place of the tracker: it is
left at zero, and told (:func:`open_offsets`).

Source: M. Shah, J. Mechanisms Robotics 5 (2013) 031007 (separable Kronecker solution of AX = YB); A. Li, L. Wang,
D. Wu, Int. J. Phys. Sci. 5 (2010) 1530 (rotations and positions together).
"""

from __future__ import annotations

import contextlib
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, as_float
from counterflex.core.errors import InputError
from counterflex.geometry import pose, rotation
from counterflex.geometry.pose import register

FEWEST: Final = 3
LENGTH_M: Final = 0.5
"""Arm at which a rotation error counts like a position error where both are judged together."""
LEAST_TURN_RAD: Final = 0.01
"""Root mean square turn below which poses say nothing about an offset across it."""
_STEPS = 8
_AT_REST = 1e-7
_ALIKE_RAD = 0.02
_LEAST_GAP = 1e-3


def open_offsets(Ts_base_tcp: Float) -> Float:
    """Directions (k, 3) in the axes of the TCP in which poses (m, 4, 4) do not tell an offset: they hardly turn it."""
    R = Ts_base_tcp[:, :3, :3]
    _, s, vt = np.linalg.svd((R - R.mean(axis=0)).reshape(-1, 3), full_matrices=False)
    out: Float = vt[s < LEAST_TURN_RAD * np.sqrt(len(R))]
    return out


def _check_turns(A: Float, most_open: int) -> None:
    undetermined = len(open_offsets(A))
    if undetermined <= most_open:
        return
    constant = undetermined == 3
    raise InputError(
        "the poses have one orientation, so the offset of the target is not determined"
        if constant
        else "the poses do not turn the target about two different axes, so its offset is free",
        value=f"{len(A)} poses",
        limit=f"turned by {np.degrees(LEAST_TURN_RAD):.2g} deg root mean square",
        hint="Measure poses with the wrist turned by 30 deg or more about different axes"
        + (", or add data of the same target that determine it" if constant else ""),
    )


def of_poses(Ts_base_tcp: Float, Ts_tracker_target: Float, *, partly: bool = False) -> tuple[Float, Float]:
    """Tracker and target by least squares over all poses.

    Args:
        Ts_base_tcp: (m, 4, 4) robot poses, m.
        Ts_tracker_target: (m, 4, 4) measured poses.
        partly: Poses that turn about one axis only will do; the target's offset along it is zero then.

    Returns:
        T_base_tracker (4, 4), T_tcp_target (4, 4).

    Raises:
        InputError: Fewer than three poses, poses that do not turn about two different axes (with ``partly``: that keep
            one orientation).
    """
    A = as_float("Ts_base_tcp", Ts_base_tcp, (None, 4, 4))
    B = as_float("Ts_tracker_target", Ts_tracker_target, (None, 4, 4))
    if len(A) != len(B) or len(A) < FEWEST:
        raise InputError(
            "hand-eye calibration needs matching poses", value=(len(A), len(B)), limit=f"{FEWEST} or more each"
        )
    _check_turns(A, 1 if partly else 0)
    candidates = [refined(A, B, R_Z) for R_Z in _different(_tracker_rotations(A, B))]
    return min(candidates, key=lambda pair: float(np.sum(error_of(A, B, *pair) ** 2)))


def error_of(Ts_base_tcp: Float, measured: Float, T_base_tracker: Float, T_tcp_target: Float) -> Float:
    """(m,) m distance of measured (m, 4, 4) poses or (m, 3) points from prediction, rotations at :data:`LENGTH_M`.

    Frames (k, 1, 4, 4) give (k, m) distances of poses.
    """
    T = pose.inverse(T_base_tracker) @ Ts_base_tcp @ T_tcp_target
    if measured.ndim == 2:
        out: Float = np.linalg.norm(T[:, :3, 3] - measured, axis=1)
        return out
    d = pose.difference(T, measured)
    both: Float = np.sqrt(np.sum(d[..., :3] ** 2, axis=-1) + LENGTH_M**2 * np.sum(d[..., 3:] ** 2, axis=-1))
    return both


def quick_of_samples(Ts_base_tcp: Float, Ts_tracker_target: Float, partly: bool) -> tuple[Float, Float]:
    """Frames of many small samples, not refined: rotations first where they tell, else together with the positions.

    ``Ts_base_tcp``: (t, s, 4, 4) robot poses, m, of t samples. ``Ts_tracker_target``: (t, s, 4, 4) measured poses, m.
    Returns T_base_tracker and T_tcp_target of the samples that turn enough, each (k, 4, 4).
    """
    count = Ts_base_tcp.shape[1]
    R = Ts_base_tcp[:, :, :3, :3]
    turns = np.linalg.svd((R - R.mean(axis=1, keepdims=True)).reshape(len(R), -1, 3), compute_uv=False)
    determined = np.sum(turns < LEAST_TURN_RAD * np.sqrt(count), axis=1) <= (1 if partly else 0)
    A, B = Ts_base_tcp[determined], Ts_tracker_target[determined]
    RA, RB = A[:, :, :3, :3], B[:, :, :3, :3]
    u, s, _ = np.linalg.svd(np.einsum("tmab,tmcd->tacbd", RB, RA).reshape(-1, 9, 9) / count)
    M = np.swapaxes(u[:, :, 0].reshape(-1, 3, 3), 1, 2)
    R_Z = _proper(np.where(np.linalg.det(M) < 0.0, -1.0, 1.0)[:, None, None] * M)
    for k in np.flatnonzero(s[:, 1] >= 1.0 - _LEAST_GAP):
        R_Z[k] = _together(A[k], B[k])
    R_X = _proper(np.einsum("tmji,tjk,tmkl->til", RA, R_Z, RB))
    rows = np.concatenate([RA, np.broadcast_to(-np.eye(3), RA.shape)], axis=-1).reshape(-1, 3 * count, 6)
    right = B[:, :, :3, 3] @ np.swapaxes(R_Z, 1, 2) - A[:, :, :3, 3]
    u, s, vt = np.linalg.svd(rows, full_matrices=False)
    use = s > LEAST_TURN_RAD * np.sqrt(count)
    along = np.einsum("trk,tr->tk", u, right.reshape(-1, 3 * count))
    t = np.einsum("tkj,tk->tj", vt, np.where(use, along / np.where(use, s, 1.0), 0.0))
    return pose.make(R_Z, t[:, 3:]), pose.make(R_X, t[:, :3])


def _tracker_rotations(A: Float, B: Float) -> list[Float]:
    """Starts for R_base_tracker, each by another linear way."""
    out = [_by_rotations(A, B)[0], _together(A, B)]
    with contextlib.suppress(InputError):  # points on one line: the other ways remain
        out.append(register(A[:, :3, 3], B[:, :3, 3])[0][:3, :3])
    return out


def _by_rotations(A: Float, B: Float) -> tuple[Float, bool]:
    """R_base_tracker from rotations alone, and whether they tell it: the poses turn about two different axes."""
    # R_A R_X = R_Z R_B  <=>  sum over i of kron(R_B, R_A) carries vec(R_X) to n vec(R_Z): its largest singular pair.
    u, s, _ = np.linalg.svd(np.einsum("mab,mcd->acbd", B[:, :3, :3], A[:, :3, :3]).reshape(9, 9) / len(A))
    M = u[:, 0].reshape(3, 3).T
    # A singular vector has no sign: of R and -R only one is a rotation.
    turned = -1.0 if np.linalg.det(M) < 0.0 else 1.0
    return _proper(turned * M), bool(s[1] < 1.0 - _LEAST_GAP)


def _together(A: Float, B: Float) -> Float:
    """R_base_tracker with rotations and positions together."""
    RA, RB, m = A[:, :3, :3], B[:, :3, :3], len(A)
    # Unknowns: R_X column by column, then those of the points; orientations count at LENGTH_M.
    turn = np.zeros((m, 3, 3, 24))  # rows and columns of the equation
    for c in range(3):
        turn[:, :, c, 3 * c : 3 * c + 3] = RA
        for k in range(3):
            turn[:, :, c, 9 + 3 * k : 12 + 3 * k] = -RB[:, k, c, None, None] * np.eye(3)
    place, right = _point_rows(A, B[:, :3, 3])
    rows = np.concatenate([LENGTH_M * turn.reshape(-1, 24), np.pad(place, ((0, 0), (9, 0)))])
    x, *_ = np.linalg.lstsq(rows, np.concatenate([np.zeros(9 * m), right]), rcond=None)
    return _proper(x[9:18].reshape(3, 3).T)


def _place_rows(RA: Float) -> Float:
    """Rows (3 m, 6) of the offset of the target and the place of the tracker."""
    out: Float = np.concatenate([RA, np.broadcast_to(-np.eye(3), RA.shape)], axis=-1).reshape(-1, 6)
    return out


def _point_rows(A: Float, p: Float) -> tuple[Float, Float]:
    """Rows (3 m, 15) and right side of ``R_A t_X + t_A = R_Z p + t_Z``, linear in R_Z (by columns), t_X, t_Z."""
    eye = np.eye(3)
    place = np.zeros((len(A), 3, 15))
    for k in range(3):
        place[:, :, 3 * k : 3 * k + 3] = -p[:, k, None, None] * eye
    place[:, :, 9:12], place[:, :, 12:] = A[:, :3, :3], -eye
    return place.reshape(-1, 15), -A[:, :3, 3].reshape(-1)


def _different(starts: list[Float]) -> list[Float]:
    """Rotations that differ from those before them."""
    out: list[Float] = []
    for R in starts:
        if all(float(np.trace(R.T @ other)) < 1.0 + 2.0 * np.cos(_ALIKE_RAD) for other in out):
            out.append(R)
    return out


def refined(Ts_base_tcp: Float, measured: Float, R_base_tracker: Float) -> tuple[Float, Float]:
    """All numbers by Gauss-Newton from a rotation of the tracker; what the measurements do not see is not moved.

    Args:
        Ts_base_tcp: (m, 4, 4) robot poses, m.
        measured: (m, 4, 4) poses or (m, 3) m points of the target as the tracker sees them.
        R_base_tracker: (3, 3), where to start.

    Returns:
        T_base_tracker and T_tcp_target, each (4, 4).
    """
    A = Ts_base_tcp
    RA, m, whole = A[:, :3, :3], len(A), measured.ndim == 3
    p = measured[:, :3, 3] if whole else measured
    RB = measured[:, :3, :3] if whole else None
    R_Z, R_X = R_base_tracker, np.eye(3)
    if RB is not None:
        R_X = _proper(np.einsum("mji,jk,mkl->il", RA, R_Z, RB))
    eye, none = np.broadcast_to(np.eye(3), (m, 3, 3)), np.zeros((m, 3, 3))
    t = _least(_place_rows(RA), (p @ R_Z.T - A[:, :3, 3]).reshape(-1), m)
    for _ in range(_STEPS):
        seen = p @ R_Z.T
        rows = [np.concatenate([RA, -eye, none, rotation.skew(seen)], axis=-1)]
        off = [np.einsum("mij,j->mi", RA, t[:3]) + A[:, :3, 3] - seen - t[3:]]
        if RB is not None:
            rows.append(LENGTH_M * np.concatenate([none, none, RA, -eye], axis=-1))
            off.append(LENGTH_M * rotation.log(RA @ R_X @ np.swapaxes(R_Z @ RB, -1, -2)))
        step = _least(np.concatenate(rows, axis=1).reshape(-1, 12), -np.concatenate(off, axis=1).reshape(-1), m)
        t = t + step[:6]
        R_X, R_Z = rotation.exp(step[6:9]) @ R_X, rotation.exp(step[9:]) @ R_Z
        if float(np.max(np.abs(step))) < _AT_REST:
            break
    for way in open_offsets(A):  # what goes with the place of the tracker is put there
        far = way * (way @ t[:3])
        t = t - np.concatenate([far, RA.mean(axis=0) @ far])
    return pose.make(R_Z, t[3:]), pose.make(R_X, t[:3])


def _least(rows: Float, right: Float, count: int) -> Float:
    """Least squares that leaves alone what ``count`` poses move by less than :data:`LEAST_TURN_RAD`."""
    u, s, vt = np.linalg.svd(rows, full_matrices=False)
    # Singular values below what the poses turn by are noise: along them a step would throw the target metres away.
    use = s > LEAST_TURN_RAD * np.sqrt(count)
    out: Float = vt[use].T @ ((u[:, use].T @ right) / s[use])
    return out


def tracker_of_poses(Ts_base_tcp: Float, measured: Float, T_tcp_target: Float, weight: Float | None = None) -> Float:
    """T_base_tracker (4, 4) by least squares where the target is known.

    Args:
        Ts_base_tcp: (m, 4, 4) robot poses, m.
        measured: (m, 4, 4) T_tracker_target, or (m, 3) p_tracker_target.
        T_tcp_target: (4, 4).
        weight: (m,) of each row; None is 1.

    Raises:
        InputError: Points alone that are too few or on one line.
    """
    T = Ts_base_tcp @ T_tcp_target
    w = np.ones(len(T)) if weight is None else weight
    p = measured if measured.ndim == 2 else measured[:, :3, 3]
    share = w[:, None] / np.sum(w)
    centre, seen = np.sum(share * T[:, :3, 3], axis=0), np.sum(share * p, axis=0)
    M: Float = np.einsum("m,mi,mj->ij", w, T[:, :3, 3] - centre, p - seen)
    if measured.ndim == 3:
        M += LENGTH_M**2 * np.einsum("m,mik,mjk->ij", w, T[:, :3, :3], measured[:, :3, :3])
    elif np.sum(w > 0.0) < FEWEST or np.linalg.svd(M, compute_uv=False)[1] < 1e-12 * np.trace(M.T @ M) ** 0.5:
        raise InputError(
            "the points lie on one line, so the rotation about it is free", hint="Add a point off that line"
        )
    R = _proper(np.asarray(M, dtype=np.float64))
    return pose.make(R, centre - R @ seen)


def target_of_poses(Ts_base_tcp: Float, measured: Float, T_base_tracker: Float, weight: Float | None = None) -> Float:
    """T_tcp_target (4, 4) by least squares where the tracker is known; points give no rotation.

    Args:
        Ts_base_tcp: (m, 4, 4) robot poses, m.
        measured: (m, 4, 4) T_tracker_target, or (m, 3) p_tracker_target.
        T_base_tracker: (4, 4).
        weight: (m,) of each row; None is 1.
    """
    w = np.ones(len(Ts_base_tcp)) if weight is None else weight
    back = pose.inverse(Ts_base_tcp) @ T_base_tracker
    p = np.average(pose.transform(back, measured if measured.ndim == 2 else measured[:, :3, 3]), axis=0, weights=w)
    if measured.ndim == 2:
        return pose.make(p=p)
    turned: Float = np.einsum("m,mik,mkj->ij", w, back[:, :3, :3], measured[:, :3, :3])
    return pose.make(_proper(np.asarray(turned, dtype=np.float64)), p)


def _proper(M: Float) -> Float:
    """The rotation nearest to a matrix (..., 3, 3)."""
    u, _, vt = np.linalg.svd(M)
    # The nearest orthogonal matrix may be a reflection: the weakest axis is turned round to make it a rotation.
    u[..., 2] *= np.sign(np.linalg.det(u @ vt))[..., None]
    out: Float = u @ vt
    return out


def of_points(Ts_base_tcp: Float, p_tracker_target: Float, *, partly: bool = False) -> tuple[Float, Float]:
    """Tracker and offset of a reflector by least squares.

    ``Ts_base_tcp``: (m, 4, 4) robot poses, m. ``p_tracker_target``: (m, 3) measured points. Returns T_base_tracker (4,
    4), T_tcp_target (4, 4) without rotation; what the poses do not tell of the offset is zero. Raises InputError: fewer
    than four points, points on one line, poses that do not turn, as for :func:`of_poses`.
    """
    A, p = as_float("Ts_base_tcp", Ts_base_tcp, (None, 4, 4)), as_float("p_tracker_target", p_tracker_target, (None, 3))
    if len(A) != len(p) or len(A) <= FEWEST:
        raise InputError("a reflector's offset needs matching poses", value=(len(A), len(p)), limit="4 or more each")
    _check_turns(A, 1 if partly else 0)
    rows, right = _point_rows(A, p)
    x, *_ = np.linalg.lstsq(rows, right, rcond=None)
    starts = [register(A[:, :3, 3], p)[0][:3, :3], _proper(np.asarray(x[:9], dtype=np.float64).reshape(3, 3).T)]
    candidates = [refined(A, p, R_Z) for R_Z in _different(starts)]
    return min(candidates, key=lambda pair: float(np.sum(error_of(A, p, *pair) ** 2)))
