"""Circular deviation and radial deviation of a circular path (ISO 230-4)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from counterflex.core.arrays import Float, as_float, as_positive
from counterflex.core.errors import InputError


@dataclass(frozen=True)
class Circularity:
    """Figures of one measured circle, m."""

    g_m: float  # circular deviation G: least radial distance between two concentric circles that hold the path
    f_max_m: float  # largest radial deviation F from the nominal circle about its nominal centre; positive = outside
    f_min_m: float  # smallest (most inward) radial deviation F
    centre_offset_m: tuple[float, float]  # (2,) centre of the two circles minus the nominal centre, in the axes given
    radius_m: float  # mean of the two circles' radii


def circularity(points: Float, centre: Float, radius_m: float) -> Circularity:
    """Circular deviation G (minimum zone) and radial deviation F of a path along a circle.

    G solves ``min h - l`` with ``l <= |p_i - c| <= h`` over the centre c as a sequence of linear programs, each exact
    to second order in the step of c.

    Args:
        points: (n, 2) m, n >= 4, path in the plane of the circle, its whole turn or a part of at least 90 deg.
        centre: (2,) m nominal centre.
        radius_m: Nominal radius.

    Raises:
        InputError: Fewer than four points, points at the centre, or an arc of less than 90 deg, which fixes no centre.

    Source: ISO 230-4, definitions of circular deviation G and radial deviation F.
    """
    p = as_float("points", points, (None, 2))
    c0 = as_float("centre", centre, (2,))
    nominal = as_positive("radius_m", radius_m)
    if len(p) < 4:
        raise InputError("a circle needs at least four points", value=len(p))
    rho = np.linalg.norm(p - c0, axis=1)
    if float(rho.min()) < 0.1 * nominal:
        raise InputError("a point lies near the centre of the circle", value=float(rho.min()), limit=f"~{nominal:g} m")
    angle = np.sort(np.arctan2(p[:, 1] - c0[1], p[:, 0] - c0[0]))
    widest = float(np.max(np.diff(np.append(angle, angle[0] + 2.0 * np.pi))))
    if widest > 1.5 * np.pi + 1e-9:
        raise InputError("the arc is too short for its centre", value=f"{np.degrees(2 * np.pi - widest):.1f} deg",
                         limit=">= 90 deg")  # fmt: skip
    best = c = c0.copy()
    low, high = float(rho.min()), float(rho.max())
    for _ in range(8):
        away = p - c
        r = np.linalg.norm(away, axis=1)
        u = away / r[:, None]
        middle = float(r.mean())
        # unknowns: step of the centre (2), low and high radius about the mean
        above = np.column_stack([-u, np.zeros(len(p)), -np.ones(len(p))])
        below = np.column_stack([u, np.ones(len(p)), np.zeros(len(p))])
        result = scipy.optimize.linprog(
            [0.0, 0.0, -1.0, 1.0],
            A_ub=np.vstack([above, below]),
            b_ub=np.concatenate([-(r - middle), r - middle]) / nominal,
            bounds=[(None, None)] * 4,
            method="highs",
        )
        step = nominal * np.asarray(result.x[:2], dtype=np.float64)
        c = c + step
        r = np.linalg.norm(p - c, axis=1)
        if float(np.ptp(r)) < high - low:  # the program's tolerance may leave a step that is none
            best, low, high = c, float(r.min()), float(r.max())
        if float(np.abs(step).max()) < 1e-9 * nominal:
            break
    return Circularity(
        g_m=high - low,
        f_max_m=float(rho.max()) - nominal,
        f_min_m=float(rho.min()) - nominal,
        centre_offset_m=(float(best[0] - c0[0]), float(best[1] - c0[1])),
        radius_m=0.5 * (low + high),
    )
