"""Rigid registration: the pose that best carries one set of points onto another."""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float, as_float
from counterflex.core.errors import InputError
from counterflex.geometry import pose


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
    T_a_b = pose.make(R_a_b, centre_a - R_a_b @ centre_b)
    return T_a_b, a - pose.transform(T_a_b, b)
