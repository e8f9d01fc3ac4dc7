"""Chatter of the robot in a side cut: how much of the depth at its limit a cut uses.

The criterion is that of ``plan stability`` (:mod:`counterflex.plan.stability.criterion`), with the arc of the cut as
the engagement and the modes of the postures along the wall; the use is one over the margin. In up-milling it is the
direction normal to the wall that may lose its damping, where the radial force is small against the cutting force; at
the width without normal force it keeps it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Float
from counterflex.cutting.coefficients import ForceLaw
from counterflex.cutting.stability.modes import Modes
from counterflex.cutting.stability.process import process_of_side_cut
from counterflex.plan.stability.criterion import SharedLimits
from counterflex.plan.strategy.side_cut import SideCuts, feed_axes


@dataclass(frozen=True, eq=False)
class Standing:
    """The robot in a posture along a wall.

    Attributes:
        modes: Its modes, part axes.
        normal_part: (3,) unit normal of the wall there, out of the material.
    """

    modes: Modes
    normal_part: Float


def depth_used(cuts: SideCuts, law: ForceLaw, spindle_rad_s: Float, standings: Sequence[Standing]) -> Float:
    """Share of the limiting depth that each cut uses in each posture; above 1 it chatters.

    Args:
        cuts: (n) the cuts.
        law: The force law.
        spindle_rad_s: (n,) their spindle speeds.
        standings: k postures.

    Returns:
        (n, k).
    """
    limits = SharedLimits()
    axes = [feed_axes(cuts.up, standing.normal_part) for standing in standings]
    periods = 2.0 * math.pi / (cuts.cutter.flutes * np.asarray(spindle_rad_s))
    out = np.empty((len(cuts), len(standings)))
    for i, (entry, leave, ap, fz, T) in enumerate(
        zip(cuts.entry_rad, cuts.exit_rad, cuts.ap_m, cuts.fz_m, periods, strict=True)
    ):
        A = process_of_side_cut(cuts.cutter, law, float(entry), float(leave), float(ap), float(fz)).mean
        for k, standing in enumerate(standings):
            R = axes[k][i]
            out[i, k] = 1.0 / limits(k, standing.modes, R @ A @ R.T, float(T)).factor
    return out
