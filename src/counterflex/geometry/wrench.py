"""Wrenches and twists, linear part first: wrench (f, m) in N, N m; twist or small displacement (v, omega).

A wrench is always what the surroundings do to the tool, named by the point it is taken about and the axes it is
written in: ``w_tcp_base`` is about the TCP in base axes.
"""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float


def cross(a: Float, b: Float) -> Float:
    """Cross product ``a x b``, (..., 3); single vectors some forty times faster than NumPy's, bit for bit the same."""
    if a.ndim > 1 or b.ndim > 1:
        out: Float = np.cross(a, b)
        return out
    ax, ay, az = a.tolist()
    bx, by, bz = b.tolist()
    return np.array((ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx))


def carry(T_a_b: Float, w_b: Float) -> Float:
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


def shift(w: Float, lever: Float) -> Float:
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


def rotate(R_a_b: Float, w_b: Float) -> Float:
    """The same wrench or twist about the same point, written in axes a instead of b."""
    w_b = np.asarray(w_b, dtype=np.float64)
    return np.concatenate([(R_a_b @ w_b[..., :3, None])[..., 0], (R_a_b @ w_b[..., 3:, None])[..., 0]], axis=-1)
