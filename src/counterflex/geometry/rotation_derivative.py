"""Derivatives of the rotation vector: what a change of its components turns.

``Exp(r + dr) = Exp(J_l(r) dr) Exp(r)`` to first order, and ``log(Exp(w) Exp(r)) = r + J_l(r)^-1 w``.

Source: T. Barfoot, State Estimation for Robotics, 2017, eq. 7.76 and 7.77 (left Jacobian of SO(3) and its inverse).
"""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float
from counterflex.geometry import rotation

_SMALL = 1e-4


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
    k = rotation.skew(r)
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
    k = rotation.skew(r)
    out: Float = np.eye(3) - 0.5 * k + b[..., None, None] * (k @ k)
    return out
