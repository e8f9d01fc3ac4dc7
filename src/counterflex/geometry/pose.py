"""Poses as 4x4 homogeneous matrices, single or in batches (leading axes).

``T_a_b`` is the pose of frame b in frame a: it maps b-coordinates to a-coordinates, ``p_a = T_a_b p_b``, and poses
chain when neighbouring names match: ``T_a_c = T_a_b @ T_b_c``.
"""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float
from counterflex.geometry import rotation


def make(R: Float | None = None, p: Float | None = None) -> Float:
    """Pose of a rotation (..., 3, 3) and a position (..., 3) in m; what is left out is identity or zero."""
    R = np.eye(3) if R is None else np.asarray(R, dtype=np.float64)
    p = np.zeros(3) if p is None else np.asarray(p, dtype=np.float64)
    lead = np.broadcast_shapes(R.shape[:-2], p.shape[:-1])
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
