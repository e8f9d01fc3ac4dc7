"""Circles through three points, and places on them by an angle."""

from __future__ import annotations

import math

import numpy as np

from counterflex.core.arrays import Float

_FLAT = 1e-9


def circle(p_start: Float, p_auxiliary: Float, p_end: Float) -> tuple[Float, Float] | None:
    """Centre and unit normal of the circle through three points, right-handed from the first via the second.

    Args:
        p_start: (3,) m.
        p_auxiliary: (3,) m.
        p_end: (3,) m.

    Returns:
        (3,) m and (3,), or None where the points lie on a line.
    """
    a, b = p_auxiliary - p_start, p_end - p_start
    across = np.cross(a, b)
    size = float(np.linalg.norm(across))
    if size < _FLAT * max(float(np.linalg.norm(a)) * float(np.linalg.norm(b)), 1e-12):
        return None
    normal: Float = across / size
    to_centre = (float(a @ a) * np.cross(b, across) + float(b @ b) * np.cross(across, a)) / (2.0 * size * size)
    return p_start + to_centre, normal


def angle_to(p_start: Float, p: Float, centre: Float, normal: Float) -> float:
    """Angle from the start to a point of the circle, right-handed about the normal, 0 to 2 pi."""
    spoke, other = p_start - centre, p - centre
    angle = math.atan2(float(np.cross(spoke, other) @ normal), float(spoke @ other))
    return angle if angle > 0.0 else angle + 2.0 * math.pi


def turned(p_start: Float, centre: Float, normal: Float, angle_rad: float) -> Float:
    """(3,) m, the start turned about the circle's axis."""
    spoke = p_start - centre
    out: Float = centre + math.cos(angle_rad) * spoke + math.sin(angle_rad) * np.cross(normal, spoke)
    return out
