"""A log fitted to the program's path: the frame that leaves least across the path, and how well that is known."""

from __future__ import annotations

from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float
from counterflex.core.errors import InputError
from counterflex.core.units import MM, UM
from counterflex.evaluate.inspection.registration import FREEDOMS, LEAST_EIGENVALUE, Registration
from counterflex.evaluate.path_deviation import PathDeviation
from counterflex.geometry import pose, rotation

SCALE: Final = 5e-4
"""A log of another scale than this is refused where the scale explains most of what is left."""
LEAST: Final = 20
"""Stations that a frame can be fitted to."""
_LEAST: Final = 1e-5
_PATCH_M: Final = 8.0 * MM
_TUKEY: Final = 4.685


def fitted(deviation: PathDeviation, T_part_log: Float, where: str, left_out: Bool | None = None) -> Registration:
    """One step of the fit: the frame moved so that robust squares of the deviations across the path are least.

    ``r = n . d`` of both normals n to the path at each station; along the path nothing is asked. The covariance adds
    residuals up in stretches of 8 mm (sandwich estimator): what deviates over a stretch counts as one.

    Args:
        deviation: Of the log in the frame so far; fit again with the path matched anew until it stands still.
        T_part_log: (4, 4), that frame.
        left_out: (k,) stations that do not count, or None.

    Raises:
        InputError: The path leaves freedoms of the frame open, or the log is of another scale.
    """
    rows = np.linalg.norm(deviation.p_part_actual - deviation.p_part_nominal, axis=1) < 2.0 * MM
    if left_out is not None:
        rows &= ~left_out
    if np.count_nonzero(rows) < LEAST:
        raise InputError(
            "hardly a reading lies on the path that the frame is fitted to", where=where, value=int(rows.sum())
        )
    p = deviation.p_part_actual[rows]
    axis = np.cross(deviation.feed_direction, deviation.left)
    normals = np.concatenate([deviation.left[rows], axis[rows]])
    r = np.concatenate([deviation.across_left_m[rows], deviation.across_axis_m[rows]])
    centre = 0.5 * (p.min(axis=0) + p.max(axis=0))
    arm = np.concatenate([p, p]) - centre
    J = np.concatenate([normals, np.cross(arm, normals)], axis=1)
    stretch = np.floor(deviation.length_m[rows] / _PATCH_M).astype(np.int64)
    scale = max(1.4826 * float(np.median(np.abs(r))), 1.0 * UM)
    weight = np.maximum(0.0, 1.0 - (r / (_TUKEY * scale)) ** 2) ** 2
    H, condition = _information(J, weight, 0.5 * float(np.linalg.norm(np.ptp(p, axis=0))), where)
    step = -np.linalg.solve(H, J.T @ (weight * r))
    left = r + J @ step
    _check_scale(J, weight, r, left, np.sum(arm * normals, axis=1), where)
    R = rotation.exp(step[3:])
    T = pose.make(R, centre + step[:3] - R @ centre) @ T_part_log
    residual = float(np.sqrt(np.average(left * left, weights=np.maximum(weight, 1e-12))))
    both = np.concatenate([stretch, stretch])
    _, patch = np.unique(both, return_inverse=True)
    count = int(patch.max()) + 1
    sums = np.stack([np.bincount(patch, J[:, k] * weight * left, count) for k in range(6)], axis=1)
    inverse = np.linalg.inv(H)
    covariance = inverse @ (sums.T @ sums) @ inverse * (count / max(count - 6.0, 1.0))
    return Registration(T, covariance, centre, (), {"path": int(rows.sum())}, {}, residual, condition)


def _information(J: Float, weight: Float, size_m: float, where: str) -> tuple[Float, float]:
    """Normal matrix and its condition; refuses freedoms that the path leaves open."""
    H = (J * weight[:, None]).T @ J
    length = np.array([1.0, 1.0, 1.0, *[1.0 / max(size_m, 1e-6)] * 3])
    values, vectors = np.linalg.eigh(H * np.outer(length, length))
    open_ = values < min(LEAST_EIGENVALUE, _LEAST) * values[-1]
    if open_.any():
        share = np.sum(vectors[:, open_] ** 2, axis=1)
        free = [name for name, part in zip(FREEDOMS, share, strict=True) if part > 0.3]
        raise InputError(
            f"the path leaves {int(open_.sum())} of six freedoms of the frame open",
            where=where,
            value=", ".join(free),
            limit="a path that runs in two directions at least",
            hint="Say where the tracker stood: --frame with a cell file or X,Y,Z,A,B,C",
        )
    return H, float(values[-1] / values[0])


def _check_scale(J: Float, weight: Float, r: Float, left: Float, by_scale: Float, where: str) -> None:
    """Refuse a log that is larger or smaller than the path, where that explains most of what the frame leaves."""
    wide = np.column_stack([J, by_scale])
    H = (wide * weight[:, None]).T @ wide
    if np.linalg.cond(H / np.sqrt(np.outer(np.diag(H), np.diag(H)))) > 1e8:
        return
    solution = np.linalg.solve(H, wide.T @ (weight * r))
    better = r - wide @ solution
    before, after = (float(np.sum(weight * one * one)) for one in (left, better))
    if abs(solution[6]) > SCALE and after < 0.25 * before:
        raise InputError(
            "the scale of the log is wrong",
            where=where,
            value=f"{1.0 + float(solution[6]):.5f} times the size of the program's path",
            limit=f"1 within {SCALE:g}",
            hint="Calibrate the tracker, or export without a scale factor",
        )
