"""Cornering deviations: round-off error CR and overshoot CO (ISO 9283:1998, 8.5)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Float
from counterflex.evaluate.iso9283.commanded_path import ZONE, CommandedPath
from counterflex.evaluate.iso9283.path_cycles import Cycle


@dataclass(frozen=True, eq=False)
class Corner:
    """Cornering deviations at one corner.

    Attributes:
        point: Of the commanded path, index.
        length_m: Along the path.
        turn_rad: How much the path turns there.
        cr_m: (n,) least distance of each attained path from the corner.
        co_m: (n,) largest deviation of each from the second path, outward; 0 where there is none.
    """

    point: int
    length_m: float
    turn_rad: float
    cr_m: Float
    co_m: Float


def corners(path: CommandedPath, cycles: Sequence[Cycle]) -> list[Corner]:
    """CR and CO at every corner of the commanded path; the figures are the largest over the cycles.

    ``CR_j`` is the least distance between the corner and attained path j. ``CO_j`` is the largest distance of attained
    path j from the second commanded path once it runs along that, counted only on the outer side, where the first path
    would have gone on; up to the end of the straight second path, less a tenth before the next corner.

    Source: ISO 9283:1998, 8.5.2 and 8.5.3 (three cycles).
    """
    out = []
    ends = [0, *path.corners.tolist(), len(path.p) - 1]
    for before, k, after in zip(ends, ends[1:], ends[2:], strict=False):
        a, b = path.p[k] - path.p[k - 1], path.p[k + 1] - path.p[k]
        t1, t2 = a / np.linalg.norm(a), b / np.linalg.norm(b)
        outward = t1 - (t1 @ t2) * t2
        size = float(np.linalg.norm(outward))
        length = path.length
        straight = k + 1
        while straight < after and float(np.linalg.norm(np.cross(path.p[straight + 1] - path.p[k], t2))) < 1e-6:
            straight += 1
        end = length[straight] - ZONE * (length[after] - length[k])
        cr, co = np.empty(len(cycles)), np.zeros(len(cycles))
        for j, cycle in enumerate(cycles):
            near = (cycle.length_m >= 0.5 * (length[before] + length[k])) & (
                cycle.length_m <= 0.5 * (length[k] + length[after])
            )
            cr[j] = _least_distance(cycle.p[near], path.p[k])
            if size < 1e-9:
                continue
            d = cycle.p - path.p[k]
            along = d @ t2
            second = (cycle.length_m >= length[k] - 1e-9) & (along >= 0.0) & (along <= end - length[k])
            across = d - along[:, None] * t2
            outer = second & (across @ (outward / size) > 0.0)
            co[j] = float(np.linalg.norm(across[outer], axis=1).max()) if outer.any() else 0.0
        turn = float(np.arccos(np.clip(t1 @ t2, -1.0, 1.0)))
        out.append(Corner(k, float(length[k]), turn, cr, co))
    return out


def _least_distance(p: Float, point: Float) -> float:
    """Distance of a point from a polyline, m."""
    if len(p) < 2:
        return float(np.linalg.norm(p - point, axis=1).min()) if len(p) else float("nan")
    step = np.diff(p, axis=0)
    share = np.clip(np.sum((point - p[:-1]) * step, axis=1) / np.maximum(np.sum(step * step, axis=1), 1e-18), 0.0, 1.0)
    return float(np.linalg.norm(p[:-1] + share[:, None] * step - point, axis=1).min())
