"""What part of the deflection swings with the arm: corrections are commanded ahead of time accordingly."""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float
from counterflex.geometry import wrench
from counterflex.robot import compliance
from counterflex.robot.chain import ElasticChain


def arm_share(chain: ElasticChain, T_base_part: Float, q: Float, w_part: Float) -> float:
    """Share of the deflection that the robot's arm makes, the rest being made by what it carries.

    Median over the rows under load of ``d_arm . d / d . d``, translations only, linear.

    Args:
        chain: Robot and end effector.
        T_base_part: (4, 4).
        q: (n, 6) rad.
        w_part: (n, 6) N, N m, on the tool about its tip, part axes.

    Returns:
        0..1; 1 where nothing is loaded or nothing gives way.
    """
    rows = np.flatnonzero(np.any(w_part != 0.0, axis=1))
    if len(rows) == 0:
        return 1.0
    own = compliance.shares(chain, q[rows], wrench.rotate(T_base_part[:3, :3], w_part[rows]))[..., :3]
    total = np.sum(own, axis=1)
    arm = np.sum(own[:, : chain.flange_segment + 1], axis=1)
    square = np.sum(total * total, axis=1)
    if not np.any(square > 0.0):
        return 1.0
    kept = square > 0.0
    return float(np.clip(np.median(np.sum(arm * total, axis=1)[kept] / square[kept]), 0.0, 1.0))
