"""Poses as 4x4 homogeneous matrices, single or in batches (leading axes).

``T_a_b`` is the pose of frame b in frame a: it maps b-coordinates to a-coordinates, ``p_a = T_a_b p_b``, and poses
chain when neighbouring names match: ``T_a_c = T_a_b @ T_b_c``.

Wrenches and twists, linear part first: wrench (f, m) in N, N m; twist or small displacement (v, omega).

A wrench is always what the surroundings do to the tool, named by the point it is taken about and the axes it is
written in: ``w_tcp_base`` is about the TCP in base axes.
"""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float, as_float
from counterflex.core.errors import InputError
from counterflex.geometry import rotation


def cross(a: Float, b: Float) -> Float:
    """Cross product ``a x b``, (..., 3); single vectors some forty times faster than NumPy's, bit for bit the same."""
    if a.ndim > 1 or b.ndim > 1:
        out: Float = np.cross(a, b)
        return out
    ax, ay, az = a.tolist()
    bx, by, bz = b.tolist()
    return np.array((ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx))


def carry_wrench(T_a_b: Float, w_b: Float) -> Float:
    """Carry a wrench from frame b (about its origin, in its axes) to frame a.

    ``f_a = R f_b``, ``m_a = R m_b + p x (R f_b)``; power is unchanged.

    Args:
        T_a_b: (..., 4, 4).
        w_b: (..., 6) N, N m.

    Returns:
        (..., 6) N, N m.
    """
    w_b = np.asarray(w_b, dtype=np.float64)
    R, p = T_a_b[..., :3, :3], T_a_b[..., :3, 3]
    f = (R @ w_b[..., :3, None])[..., 0]
    m = (R @ w_b[..., 3:, None])[..., 0] + cross(p, f)
    return np.concatenate([f, m], axis=-1)


def shift_wrench(w: Float, lever: Float) -> Float:
    """The same wrench, in the same axes, taken about another point.

    Args:
        w: (..., 6) about point P.
        lever: (..., 3) m from the new point to P.

    Returns:
        (..., 6).
    """
    w = np.asarray(w, dtype=np.float64)
    f = w[..., :3]
    return np.concatenate([f, w[..., 3:] + cross(np.asarray(lever, dtype=np.float64), f)], axis=-1)


def rotate_wrench(R_a_b: Float, w_b: Float) -> Float:
    """The same wrench or twist about the same point, written in axes a instead of b."""
    w_b = np.asarray(w_b, dtype=np.float64)
    return np.concatenate([(R_a_b @ w_b[..., :3, None])[..., 0], (R_a_b @ w_b[..., 3:, None])[..., 0]], axis=-1)


def register(points_a: Float, points_b: Float) -> tuple[Float, Float]:
    """Least-squares pose ``T_a_b`` with ``p_a = T_a_b p_b`` (Kabsch, proper rotations only).

    Args:
        points_a: (n, 3) m, in frame a.
        points_b: (n, 3) m, the same points in frame b.

    Returns:
        T_a_b (4, 4) and the residuals ``points_a - T_a_b points_b`` (n, 3) m.

    Raises:
        InputError: Fewer than three points, or points on one line.

    Source: W. Kabsch, Acta Cryst. A 32 (1976) 922.
    """
    a = as_float("points_a", points_a, (None, 3))
    b = as_float("points_b", points_b, (None, 3))
    if len(a) != len(b) or len(a) < 3:
        raise InputError("rigid registration needs matching points", value=(len(a), len(b)), limit="3 or more each")
    centre_a, centre_b = a.mean(axis=0), b.mean(axis=0)
    spread = np.linalg.svd(b - centre_b, compute_uv=False)
    if spread[1] <= 1e-6 * spread[0] or spread[0] == 0.0:
        raise InputError("the points lie on one line, so the rotation about it is free", hint="Add a point beside it")
    u, _, vt = np.linalg.svd((a - centre_a).T @ (b - centre_b))
    sign = np.sign(np.linalg.det(u @ vt))
    R_a_b = u @ np.diag([1.0, 1.0, sign]) @ vt
    T_a_b = make(R_a_b, centre_a - R_a_b @ centre_b)
    return T_a_b, a - transform(T_a_b, b)


def make(R: Float | None = None, p: Float | None = None) -> Float:
    """Pose of a rotation (..., 3, 3) and a position (..., 3) in m; what is left out is identity or zero."""
    R = np.eye(3) if R is None else np.asarray(R, dtype=np.float64)
    p = np.zeros(3) if p is None else np.asarray(p, dtype=np.float64)
    lead = () if R.ndim == 2 and p.ndim == 1 else np.broadcast_shapes(R.shape[:-2], p.shape[:-1])
    T = np.zeros((*lead, 4, 4))
    T[..., :3, :3] = R
    T[..., :3, 3] = p
    T[..., 3, 3] = 1.0
    return T


def inverse(T_a_b: Float) -> Float:
    """``T_b_a`` of ``T_a_b`` (..., 4, 4), by transposing the rotation."""
    R_b_a = np.swapaxes(T_a_b[..., :3, :3], -1, -2)
    return make(R_b_a, -(R_b_a @ T_a_b[..., :3, 3, None])[..., 0])


def transform(T_a_b: Float, p_b: Float) -> Float:
    """Map points from b- to a-coordinates.

    Args:
        T_a_b: (..., 4, 4).
        p_b: (..., 3) m.

    Returns:
        (..., 3) m.
    """
    out: Float = (T_a_b[..., :3, :3] @ np.asarray(p_b, dtype=np.float64)[..., None])[..., 0] + T_a_b[..., :3, 3]
    return out


def difference(T_a_b: Float, T_a_c: Float) -> Float:
    """Six components that lead from pose b to pose c, in axes a: position difference, then rotation vector.

    ``[p_a_c - p_a_b, log(R_a_c R_b_a)]``.

    Args:
        T_a_b: (..., 4, 4) from.
        T_a_c: (..., 4, 4) to.

    Returns:
        (..., 6): m, rad.
    """
    R = T_a_c[..., :3, :3] @ np.swapaxes(T_a_b[..., :3, :3], -1, -2)
    return np.concatenate([T_a_c[..., :3, 3] - T_a_b[..., :3, 3], rotation.log(R)], axis=-1)


def displaced(T_a_b: Float, step_a: Float) -> Float:
    """Pose moved by six components in axes a, the inverse of :func:`difference`.

    Args:
        T_a_b: (..., 4, 4).
        step_a: (..., 6) m, rad: translation and rotation vector in axes a about the origin of b.

    Returns:
        (..., 4, 4).
    """
    step_a = np.asarray(step_a, dtype=np.float64)
    return make(rotation.exp(step_a[..., 3:]) @ T_a_b[..., :3, :3], T_a_b[..., :3, 3] + step_a[..., :3])


def from_xyz_zyx(p: Float, angles: Float) -> Float:
    """Pose of a position (..., 3) m and intrinsic z-y'-x'' angles (..., 3) rad (KUKA X Y Z A B C)."""
    return make(rotation.from_zyx(angles), p)
