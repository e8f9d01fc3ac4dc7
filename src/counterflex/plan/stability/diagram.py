"""Lobe diagram of a stretch: limit of the axial depth over the spindle speed, at the engagement and feed per tooth."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Float
from counterflex.core.progress import Progress, silent
from counterflex.cutting.stability import lobes, semi_discretisation
from counterflex.cutting.stability.modes import TipModes
from counterflex.plan.stability.along import Margin, Structure, all_modes
from counterflex.plan.stability.criterion import robot_limit

SPEEDS: Final = (0.2, 1.6)
"""Range of the diagram, as a share of the programmed speed."""
COUNT: Final = 281
CHECKED: Final = 15
"""Speeds at which semi-discretisation is computed beside the lobes."""


@dataclass(frozen=True, eq=False)
class Diagram:
    """Limits of the depth over the spindle speed, all modes together."""

    spindle_rad_s: Float
    zeroth: Float  # (m,) factor on the depth; inf without a limit
    checked_rad_s: Float  # (c,) speeds of the next
    semi_discretisation: Float  # (c,) factor, inf above 1.5 times the lobes and the programmed depth


def diagram(at: Margin, structure: Structure, *, progress: Progress = silent) -> Diagram:
    """Limits around the programmed speed of a stretch.

    Args:
        structure: What swings.
        progress: Progress callback, fraction 0 to 1.
    """
    modes, teeth = all_modes(at, structure), at.process.teeth
    programmed = 2.0 * math.pi / (teeth * at.stretch.period_s)
    speeds = programmed * np.linspace(*SPEEDS, COUNT)
    A = at.process.mean
    omega = lobes.frequencies_for(modes)
    zeroth, _ = lobes.limits(A, modes.response(omega), omega, 2.0 * math.pi / (teeth * speeds))
    checked = programmed * np.linspace(*SPEEDS, CHECKED)
    factors = np.empty(CHECKED)
    for i, speed in enumerate(checked):
        # Between two lobes the limit may be inf, which would make each guess beside it so.
        guess = float(np.interp(speed, speeds, np.minimum(zeroth, 1e3)))
        factors[i] = semi_discretisation.limit(
            modes, at.process, 2.0 * math.pi / (teeth * speed), most=1.5 * guess, least=0.5 * guess, tolerance=5e-3
        )
        progress((i + 1) / CHECKED)
    return Diagram(speeds, zeroth, checked, factors)


def needed_damping(at: Margin) -> float:
    """Damping ratio of the robot's modes from which a stretch is stable: where their limit is the programmed depth.

    Returns:
        The ratio; 0 where the cut is stable with hardly any damping, inf where it is not with 0.5.
    """
    A = at.R_part_feed @ at.process.mean @ at.R_part_feed.T
    low, high = 1e-3, 0.5
    if len(at.robot) == 0 or _reserve(low, at, A) >= 0.0:
        return 0.0
    if _reserve(high, at, A) < 0.0:
        return math.inf
    return float(scipy.optimize.brentq(_reserve, low, high, args=(at, A), xtol=1e-4))


def _reserve(ratio: float, at: Margin, A: Float) -> float:
    """Factor of the depth that the robot's modes allow with a damping ratio, less 1."""
    modes = TipModes(at.robot.omega_rad_s, np.full(len(at.robot), ratio), at.robot.shape)
    return min(robot_limit(modes, A, at.stretch.period_s).factor, 1e3) - 1.0
