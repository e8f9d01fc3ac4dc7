"""Rotations as 3x3 matrices, single or in batches (leading axes), and their logarithm.

Frame names: ``R_a_b`` holds the axes of frame b in frame a as columns, so ``v_a = R_a_b v_b``.

Derivatives of the rotation vector: what a change of its components turns.

``Exp(r + dr) = Exp(J_l(r) dr) Exp(r)`` to first order, and ``log(Exp(w) Exp(r)) = r + J_l(r)^-1 w``.

Source: T. Barfoot, State Estimation for Robotics, 2017, eq. 7.76 and 7.77 (left Jacobian of SO(3) and its inverse).
"""

from __future__ import annotations

import math

import numpy as np

from counterflex.core.arrays import Float

_SMALL = 1e-4  # rad; below this the Taylor series is exact to double precision
_UNIT = np.eye(3)
_UNIT.flags.writeable = False


def skew(v: Float) -> Float:
    """Cross-product matrix ``[v]x`` with ``[v]x u = v x u``.

    Args:
        v: (..., 3).

    Returns:
        (..., 3, 3).
    """
    v = np.asarray(v, dtype=np.float64)
    out = np.zeros((*v.shape[:-1], 3, 3))
    out[..., 0, 1], out[..., 0, 2] = -v[..., 2], v[..., 1]
    out[..., 1, 0], out[..., 1, 2] = v[..., 2], -v[..., 0]
    out[..., 2, 0], out[..., 2, 1] = -v[..., 1], v[..., 0]
    return out


def cross(a: Float, b: Float) -> Float:
    """Cross product ``a x b``, to the bit that of :func:`numpy.cross`, in a third of its time for short arrays.

    Args:
        a: (..., 3).
        b: (..., 3); leading axes broadcast.

    Returns:
        (..., 3).
    """
    a0, a1, a2 = a[..., 0], a[..., 1], a[..., 2]
    b0, b1, b2 = b[..., 0], b[..., 1], b[..., 2]
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    out[..., 0], out[..., 1], out[..., 2] = a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0
    return out


def exp(rotvec: Float) -> Float:
    """Rotation matrix of a rotation vector (Rodrigues).

    ``R = 1 + sin(t)/t [v]x + (1-cos(t))/t^2 [v]x^2`` with ``t = |v|``.

    Args:
        rotvec: (..., 3) rad.

    Returns:
        (..., 3, 3).
    """
    v = np.asarray(rotvec, dtype=np.float64)
    if v.ndim == 1:
        return _exp_of_one(*v.tolist())
    t = np.linalg.norm(v, axis=-1)
    t2 = t * t
    small = t < _SMALL
    safe = np.where(small, 1.0, t)
    a = np.where(small, 1.0 - t2 / 6.0, np.sin(safe) / safe)
    b = np.where(small, 0.5 - t2 / 24.0, (1.0 - np.cos(safe)) / (safe * safe))
    k = skew(v)
    out: Float = np.eye(3) + a[..., None, None] * k + b[..., None, None] * (k @ k)
    return out


def _exp_of_one(x: float, y: float, z: float) -> Float:
    """As :func:`exp`, to the bit, for one vector: a robot that is guided takes several in every cycle."""
    t = math.sqrt(x * x + y * y + z * z)
    if t < _SMALL:
        a, b = 1.0 - t * t / 6.0, 0.5 - t * t / 24.0
    else:  # of NumPy, whose last bit need not be that of the library of C
        a, b = np.sin(t) / t, (1.0 - np.cos(t)) / (t * t)
    k: Float = np.array(((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)))
    out: Float = _UNIT + a * k + b * (k @ k)
    return out


def log(R: Float) -> Float:
    """Rotation vector of a rotation matrix; the inverse of :func:`exp` for angles up to pi.

    Goes through the unit quaternion, so it is accurate near zero and near a half turn. At exactly a half turn the
    sign of the axis is free; the one with the first non-zero component positive is returned.

    Args:
        R: (..., 3, 3).

    Returns:
        (..., 3) rad, norm in 0..pi.
    """
    q = quat_wxyz(R)
    if q.ndim == 1:
        return _log_of_one(*q.tolist())
    w, v = q[..., 0], q[..., 1:]
    s = np.linalg.norm(v, axis=-1)
    angle = 2.0 * np.arctan2(s, w)
    small = s < 1e-9
    scale = np.where(small, 2.0 / np.where(w == 0.0, 1.0, w), angle / np.where(small, 1.0, s))
    out: Float = v * scale[..., None]
    return out


def _log_of_one(w: float, x: float, y: float, z: float) -> Float:
    """Rotation vector of one unit quaternion, to the bit that of many."""
    s = math.sqrt(x * x + y * y + z * z)
    scale = 2.0 / (w if w != 0.0 else 1.0) if s < 1e-9 else 2.0 * np.arctan2(s, w) / s
    return np.array((x * scale, y * scale, z * scale))


def quat_wxyz(R: Float) -> Float:
    """Unit quaternion (w, x, y, z) with w >= 0 of a rotation matrix (Shepperd's method).

    Args:
        R: (..., 3, 3).

    Returns:
        (..., 4).
    """
    R = np.asarray(R, dtype=np.float64)
    if R.ndim == 2 and not np.isnan(R.sum()):
        return np.array(_quat_of_one(*R.ravel().tolist()))
    d0, d1, d2 = R[..., 0, 0], R[..., 1, 1], R[..., 2, 2]
    wx, wy, wz = R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]
    xy, yz, zx = R[..., 1, 0] + R[..., 0, 1], R[..., 2, 1] + R[..., 1, 2], R[..., 0, 2] + R[..., 2, 0]
    ways = np.empty((*d0.shape, 4, 4))  # the quaternion times four of its numbers each
    ways[..., 0, 0], ways[..., 1, 1] = 1 + d0 + d1 + d2, 1 + d0 - d1 - d2
    ways[..., 2, 2], ways[..., 3, 3] = 1 - d0 + d1 - d2, 1 - d0 - d1 + d2
    ways[..., 0, 1] = ways[..., 1, 0] = wx
    ways[..., 0, 2] = ways[..., 2, 0] = wy
    ways[..., 0, 3] = ways[..., 3, 0] = wz
    ways[..., 1, 2] = ways[..., 2, 1] = xy
    ways[..., 1, 3] = ways[..., 3, 1] = zx
    ways[..., 2, 3] = ways[..., 3, 2] = yz
    best = np.argmax(np.diagonal(ways, axis1=-2, axis2=-1), axis=-1)
    q = np.take_along_axis(ways, best[..., None, None], axis=-2)[..., 0, :]
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    first = np.take_along_axis(q, np.argmax(np.abs(q) > 1e-12, axis=-1)[..., None], axis=-1)
    out: Float = np.where(first < 0.0, -q, q)
    return out


def _quat_of_one(
    d0: float, r01: float, r02: float, r10: float, d1: float, r12: float, r20: float, r21: float, d2: float
) -> tuple[float, ...]:
    """As :func:`quat_wxyz`, to the bit, for one matrix by rows: 16 times as fast (83 and 5 us)."""
    four = (1.0 + d0 + d1 + d2, 1.0 + d0 - d1 - d2, 1.0 - d0 + d1 - d2, 1.0 - d0 - d1 + d2)
    best = four.index(max(four))
    wx, wy, wz = r21 - r12, r02 - r20, r10 - r01
    xy, yz, zx = r10 + r01, r21 + r12, r02 + r20
    w, x, y, z = (
        (four[0], wx, wy, wz),
        (wx, four[1], xy, zx),
        (wy, xy, four[2], yz),
        (wz, zx, yz, four[3]),
    )[best]
    size = math.sqrt(w * w + x * x + y * y + z * z)
    q = (w / size, x / size, y / size, z / size)
    first = next((c for c in q if abs(c) > 1e-12), q[0])
    return tuple(-c for c in q) if first < 0.0 else q


def from_quat_wxyz(q: Float) -> Float:
    """Rotation matrix of a quaternion (w, x, y, z); the quaternion is normalised first.

    Args:
        q: (..., 4).

    Returns:
        (..., 3, 3).
    """
    q = np.asarray(q, dtype=np.float64)
    if q.ndim == 1:
        return _of_one_quat(*q.tolist())
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    k = skew(q[..., 1:])
    return np.eye(3) + 2.0 * q[..., :1, None] * k + 2.0 * (k @ k)


def _of_one_quat(w: float, x: float, y: float, z: float) -> Float:
    """As :func:`from_quat_wxyz`, to the bit, for one; not a number where it has no length."""
    size = math.sqrt(w * w + x * x + y * y + z * z) or math.nan
    w, x, y, z = w / size, x / size, y / size, z / size
    k: Float = np.array(((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)))
    out: Float = _UNIT + 2.0 * w * k + 2.0 * (k @ k)
    return out


def about_x(angle: Float | float) -> Float:
    """Rotation about x. ``angle`` (...) rad -> (..., 3, 3)."""
    return _about(0, angle)


def about_y(angle: Float | float) -> Float:
    """Rotation about y. ``angle`` (...) rad -> (..., 3, 3)."""
    return _about(1, angle)


def about_z(angle: Float | float) -> Float:
    """Rotation about z. ``angle`` (...) rad -> (..., 3, 3)."""
    return _about(2, angle)


def _about(axis: int, angle: Float | float) -> Float:
    a = np.asarray(angle, dtype=np.float64)
    c, s = np.cos(a), np.sin(a)
    out = np.zeros((*a.shape, 3, 3))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    out[..., axis, axis] = 1.0
    out[..., i, i], out[..., j, j] = c, c
    out[..., j, i], out[..., i, j] = s, -s
    return out


def from_zyx(angles: Float) -> Float:
    """Rotation of intrinsic z-y'-x'' angles, ``R = Rz(a) Ry(b) Rx(c)`` (KUKA A, B, C).

    Args:
        angles: (..., 3) rad in the order a (about z), b (about y'), c (about x'').

    Returns:
        (..., 3, 3).
    """
    angles = np.asarray(angles, dtype=np.float64)
    return about_z(angles[..., 0]) @ about_y(angles[..., 1]) @ about_x(angles[..., 2])


def to_zyx(R: Float) -> Float:
    """Intrinsic z-y'-x'' angles (a, b, c) of a rotation; b in -pi/2..pi/2.

    Where b is +-90 deg only a -+ c is determined; c is then returned as zero.

    Args:
        R: (..., 3, 3).

    Returns:
        (..., 3) rad.
    """
    R = np.asarray(R, dtype=np.float64)
    cb = np.hypot(R[..., 0, 0], R[..., 1, 0])
    b = np.arctan2(-R[..., 2, 0], cb)
    locked = cb < 1e-12
    a = np.where(locked, np.arctan2(-R[..., 0, 1], R[..., 1, 1]), np.arctan2(R[..., 1, 0], R[..., 0, 0]))
    c = np.where(locked, 0.0, np.arctan2(R[..., 2, 1], R[..., 2, 2]))
    return np.stack([a, b, c], axis=-1)


def left_jacobian(rotvec: Float) -> Float:
    """Left Jacobian ``1 + (1-cos t)/t^2 [r]x + (t - sin t)/t^3 [r]x^2``.

    Args:
        rotvec: (..., 3) rad.

    Returns:
        (..., 3, 3).
    """
    r = np.asarray(rotvec, dtype=np.float64)
    t2 = np.sum(r * r, axis=-1)
    small = t2 < _SMALL**2
    safe = np.where(small, 1.0, t2)
    t = np.sqrt(safe)
    a = np.where(small, 0.5 - t2 / 24.0, (1.0 - np.cos(t)) / safe)
    b = np.where(small, 1.0 / 6.0 - t2 / 120.0, (t - np.sin(t)) / (safe * t))
    k = skew(r)
    out: Float = np.eye(3) + a[..., None, None] * k + b[..., None, None] * (k @ k)
    return out


def inverse_left_jacobian(rotvec: Float) -> Float:
    """Inverse of :func:`left_jacobian`: ``1 - [r]x / 2 + (1/t^2 - (1 + cos t) / (2 t sin t)) [r]x^2``.

    Args:
        rotvec: (..., 3) rad, shorter than a full turn.

    Returns:
        (..., 3, 3).
    """
    r = np.asarray(rotvec, dtype=np.float64)
    t2 = np.sum(r * r, axis=-1)
    small = t2 < _SMALL**2
    safe = np.where(small, 1.0, t2)
    half = 0.5 * np.sqrt(safe)
    b = np.where(small, 1.0 / 12.0 + t2 / 720.0, (1.0 - half * np.cos(half) / np.sin(half)) / safe)
    k = skew(r)
    out: Float = np.eye(3) - 0.5 * k + b[..., None, None] * (k @ k)
    return out
