"""Scale of a correction whose size is not certain.

A correction c of what arm and drives yield to the cut is right for the cell that the file describes; the cell at hand
needs ``x_r = c + d_r``, with d_r drawn from what is not known of it. What is corrected of own weight, geometry, play and
friction does not grow with the force and is never scaled. Commanded is ``s c`` with the s that an aim asks for, everything across the feed, points
weighted by path length:

- ``share``: least mean of ``|x_r - s c|^2 / |x_r|^2``, the square of the share that is left.
  ``s = sum_r (x_r . c / |x_r|^2) / sum_r (c . c / |x_r|^2)``: below 1 in proportion to the square of the spread, since
  a stiff cell that is corrected too much loses more than a soft one gains.
- ``square``: least mean of ``|x_r - s c|^2``: ``s = mean(x_r) . c / c . c``; soft cells count most.
- ``percentile_95``: least share that 95 % of the cells stay below, on a grid of :data:`STEP`.
- ``full``: 1.

Without a spread every aim gives 1. One scale serves all directions: of a groove at catalogue level the best ones of two
directions differ by 0.007.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final, Literal

import numpy as np

from counterflex.core.arrays import Float
from counterflex.plan.plan import Plan

Aim = Literal["share", "square", "percentile_95", "full"]
STEP: Final = 0.01
MOST: Final = 1.5
"""Largest scale: more is no correction of what was planned."""


def scale_for(aim: Aim, requested: Float, displacements: Float, weight_m: Float) -> float:
    """The scale of a correction.

    Args:
        aim: What it makes small.
        requested: (n, 3) m, what the correction takes back, across the feed: c.
        displacements: (draws, n, 3) m, what the cells need beyond it: d.
        weight_m: (n,) m, length of path that each point stands for.

    Returns:
        0 to :data:`MOST`; 1 where nothing is corrected.
    """
    weighted = weight_m[:, None] * requested
    own = float(np.sum(weighted * requested))  # c . c
    if aim == "full" or own == 0.0:
        return 1.0
    extra = np.einsum("rnk,nk->r", displacements, weighted)  # d . c
    needed = own + 2.0 * extra + np.einsum("rnk,rnk,n->r", displacements, displacements, weight_m)  # |x|^2
    if aim == "square":
        best = 1.0 + float(np.mean(extra)) / own
    elif aim == "share":
        best = 1.0 + float(np.sum(extra / needed) / np.sum(own / needed))
    else:
        s = np.arange(0.0, MOST + 0.5 * STEP, STEP)[:, None]
        left = np.quantile(1.0 + (s * s * own - 2.0 * s * (own + extra)) / needed, 0.95, axis=1)
        nearest = np.abs(s[:, 0] - 1.0)  # of equal ones the scale nearest to 1
        best = float(s[np.lexsort((nearest, np.round(left, 12)))[0], 0])
    return min(max(best, 0.0), MOST)


def scaled(plan: Plan, scale: float) -> Plan:
    """The plan with a scale of the correction for what yields, and what the prediction expects of it."""
    if scale == 1.0:
        return replace(plan, scale=scale)
    rigid = plan.correction_part - yielding_part(plan)
    gained = plan.deviation_nominal_part - plan.deviation_compensated_part + rigid
    return replace(
        plan,
        correction_part=rigid + scale * yielding_part(plan),
        rotvec_part=scale * plan.rotvec_part,
        deviation_compensated_part=plan.deviation_compensated_part + (1.0 - scale) * gained,
        scale=scale,
    )


def yielding_part(plan: Plan) -> Float:
    """(n, 3) m, part axes, part of the correction that takes back how far arm and drives yield to the cut."""
    return plan.correction_part if plan.rigid_part is None else plan.correction_part - plan.rigid_part
