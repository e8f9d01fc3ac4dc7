"""A pose over the part, for measurements that are about time and not about place."""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import ReachError
from counterflex.core.units import DEG, MM
from counterflex.geometry import pose, rotation
from counterflex.identify.data.model import CellModel
from counterflex.robot.kinematics.inverse import Solution, inverse

_ABOVE_M = 150.0 * MM
_TURNS = 24


def over_part(cell: CellModel) -> Float:
    """Joint angles with the tool over the part's zero, in the cell's posture.

    Of the turns about the tool the one with the largest distance from singularities within the joint limits.

    Returns:
        (6,) rad.

    Raises:
        ReachError: No turn about the tool is reachable.
    """
    chain = cell.nominal_chain
    down = cell.T_base_part @ pose.make(rotation.about_x(np.pi), np.array([0.0, 0.0, _ABOVE_M]))
    limits = chain.joint_limits_rad + cell.joint_margin_rad * np.array([1.0, -1.0])
    best: Solution | None = None
    for k in range(_TURNS):
        target = down @ pose.make(rotation.about_z(k * 360.0 / _TURNS * DEG))
        try:
            solution = inverse(chain, target, cell.branch)
        except ReachError:
            continue
        inside = bool(np.all((solution.q > limits[:, 0]) & (solution.q < limits[:, 1])))
        if inside and (best is None or solution.sigma_min > best.sigma_min):
            best = solution
    if best is None:
        raise ReachError(
            "no pose over the part is reachable in the cell's posture",
            value=cell.branch,
            hint="Move the part, or choose another posture",
        )
    out: Float = best.q
    return out
