"""A path with few points that stands for the whole one: for judging many poses of the part."""

from __future__ import annotations

from typing import Final

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.plan.posture.cut_path import CutPath
from counterflex.plan.posture.survey_kernel import POWER

POINTS: Final = 40
"""Points in the cut that a thinned path has at most."""


def thinned(path: CutPath, most: int = POINTS) -> tuple[CutPath, Int]:
    """Few points for many: what is cut in pieces of equal length, and the ends of the whole path.

    The cut is divided into ``most`` pieces of equal length. Of each the point stays whose force is nearest to the
    piece's power mean ``(sum ds |F|^4 / sum ds)^(1/4)``; it bears the length of the piece. Points in the air stay where
    they are the first, the last, or lie farthest along an axis of the part, so that reach is that of the whole path.

    Args:
        path: n points.
        most: Pieces of the cut.

    Returns:
        The thinned path, and its (k,) rows in the whole one, rising. The length in the cut is that of the whole path.
    """
    chosen, pieces = _in_the_cut(path, most)
    outer = np.concatenate([path.p_part.argmin(axis=0), path.p_part.argmax(axis=0), [0, len(path) - 1]])
    rows: Int = np.union1d(chosen, outer).astype(np.int64)
    weight = np.zeros(len(path))
    np.add.at(weight, chosen, pieces)
    part = CutPath(
        path.p_part[rows],
        path.axis_part[rows],
        path.w_tcp_part[rows],
        path.normals_part[rows],
        weight[rows],
        path.time_s[rows],
        path.run[rows],
    )
    return part, rows


def _in_the_cut(path: CutPath, most: int) -> tuple[Int, Float]:
    """Rows that stand for the pieces of the cut, and the lengths of these."""
    cutting = np.flatnonzero(path.weight_m > 0.0)
    weight = path.weight_m[cutting]
    force = np.linalg.norm(path.w_tcp_part[cutting, :3], axis=1)
    along = np.cumsum(weight) - 0.5 * weight
    piece = np.minimum((along / weight.sum() * most).astype(np.int64), most - 1)
    rows, lengths = [], []
    for number in np.unique(piece):
        here = np.flatnonzero(piece == number)
        mean = np.average(force[here] ** POWER, weights=weight[here]) ** (1.0 / POWER)
        rows.append(cutting[here[int(np.argmin(np.abs(force[here] - mean)))]])
        lengths.append(weight[here].sum())
    return np.array(rows, dtype=np.int64), np.array(lengths)
