"""Growth of the cutting force with the length cut: tool wear seen in repeated reference cuts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from counterflex.core.arrays import Float, Int
from counterflex.identify.cutting.residuals import SlotResiduals
from counterflex.identify.solver.fit import Fit

_SAME = 0.01
_LEAST = 3


@dataclass(frozen=True)
class Wear:
    """Trend of the force.

    Attributes:
        per_m: Relative growth of the force per metre of cut.
        sigma_per_m: Its standard deviation.
        chance: Two-sided probability of a slope as large without any wear.
        cuts: Number of repeated cuts it rests on.
        span_m: Length of cut they span.
    """

    per_m: float
    sigma_per_m: float
    chance: float
    cuts: int
    span_m: float


def trend(relative_force: Float, run_m: Float, group: Int) -> Wear | None:
    """Common slope of groups of repeated cuts, each with a level of its own.

    Args:
        relative_force: (n,) measured over expected force of each cut.
        run_m: (n,) m, length the tool had cut before.
        group: (n,) which cuts repeat one another.

    Returns:
        The trend, or None where no group spans any length or nothing is left to judge the scatter by.
    """
    force, run = np.array(relative_force, dtype=np.float64), np.array(run_m, dtype=np.float64)
    groups = np.unique(group)
    for g in groups:
        mine = group == g
        force[mine] /= force[mine].mean()
        force[mine] -= 1.0
        run[mine] -= run[mine].mean()
    dof = len(force) - len(groups) - 1
    square = float(run @ run)
    if dof < 1 or square <= 0.0:
        return None
    slope = float(run @ force) / square
    rest = force - slope * run
    sigma = float(np.sqrt(rest @ rest / dof / square))
    chance = float(2.0 * scipy.stats.t.sf(abs(slope) / sigma, dof)) if sigma > 0.0 else float(slope == 0.0)
    return Wear(slope, sigma, chance, len(force), float(np.ptp(run_m)))


def wear_trend(block: SlotResiduals, fit: Fit) -> Wear | None:
    """Wear from the cuts of a block that repeat one another: same feed, depth, width and speed within 1 %.

    Args:
        block: The pieces that were fitted.
        fit: Their fit; each measured force is put in relation to its prediction, so that what depth and give explain
            does not count as wear.

    Returns:
        The trend, or None where no condition was cut three times or more.
    """
    pieces = block.pieces
    if float(np.ptp(pieces.run_m)) <= 0.0:
        return None
    predicted = block.predict(fit.values)
    relative = np.sum(pieces.force * predicted, axis=1) / np.sum(predicted**2, axis=1)
    keys = np.column_stack(
        [
            np.round(np.log(pieces.feed_tooth_m) / _SAME),
            np.round(np.log(np.maximum(pieces.depth_m, 1e-9)) / _SAME),
            np.round(pieces.left_m / (_SAME * block.cutter.radius_m)),
            np.round(pieces.right_m / (_SAME * block.cutter.radius_m)),
            np.round(1e4 * pieces.drop_tooth_m / pieces.feed_tooth_m),
        ]
    )
    _, group, count = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
    group = np.asarray(group, dtype=np.int64).reshape(-1)
    often = count[group] >= _LEAST
    cuts = np.array([len(np.unique(pieces.cut[group == g])) >= _LEAST for g in range(len(count))])
    often &= cuts[group]
    if not np.any(often):
        return None
    return trend(relative[often], pieces.run_m[often], group[often])
