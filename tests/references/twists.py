"""Twists carried from frame to frame by a matrix: what the map of wrenches is judged by."""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float
from counterflex.geometry.rotation import skew


def adjoint(T_a_b: Float) -> Float:
    """6x6 map that carries a twist given at and in b to one at and in a.

    ``Ad = [[R, [p]x R], [0, R]]`` for linear-first twists.

    Args:
        T_a_b: (..., 4, 4).

    Returns:
        (..., 6, 6).
    """
    R, p = T_a_b[..., :3, :3], T_a_b[..., :3, 3]
    out = np.zeros((*T_a_b.shape[:-2], 6, 6))
    out[..., :3, :3] = R
    out[..., 3:, 3:] = R
    out[..., :3, 3:] = skew(p) @ R
    return out
