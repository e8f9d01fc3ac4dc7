"""When a correction has to be there: what part of the deflection swings with the arm, and when the tool arrives."""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float
from counterflex.robot.elasticity import compliance
from counterflex.robot.elasticity.chain import ElasticChain


def arm_share(chain: ElasticChain, q: Float, w_base: Float) -> float:
    """Share of the deflection that the robot's arm makes, the rest being made by what it carries.

    Median over the rows under load of ``d_arm . d / d . d``, translations only, linear.

    Args:
        chain: Robot and end effector.
        q: (n, 6) rad.
        w_base: (n, 6) N, N m, on the robot's hand about its origin, base axes.

    Returns:
        0..1; 1 where nothing is loaded or nothing yields.
    """
    rows = np.flatnonzero(np.any(w_base != 0.0, axis=1))
    if len(rows) == 0:
        return 1.0
    own = compliance.shares(chain, q[rows], w_base[rows])[..., :3]
    total = np.sum(own, axis=1)
    arm = np.sum(own[:, : chain.flange_segment + 1], axis=1)
    square = np.sum(total * total, axis=1)
    if not np.any(square > 0.0):
        return 1.0
    selected = square > 0.0
    return float(np.clip(np.median(np.sum(arm * total, axis=1)[selected] / square[selected]), 0.0, 1.0))


def arrival(p_part: Float, time_s: Float, deflection_part: Float) -> Float:
    """When a tool that the force pushes back along the feed comes to the points of a program.

    ``t - d . u / v`` with u the direction and v the speed of the feed: at 25 mm/s a force that bends the robot by 0.4
    mm against the feed makes the tool leave 16 ms late, unless the deflection along the feed is corrected too.

    Args:
        p_part: (n, 3) m, points of the program.
        time_s: (n,) s, when it commands them, not decreasing.
        deflection_part: (n, 3) m at the points.

    Returns:
        (n,) s, not decreasing.
    """
    step = np.diff(p_part, axis=0, prepend=p_part[:1])
    passed = np.diff(time_s, prepend=time_s[:1])
    square = np.sum(step * step, axis=1)
    moves = square > 0.0
    along = np.sum(deflection_part * step, axis=1)
    late = np.where(moves, -along * passed / np.where(moves, square, 1.0), 0.0)
    out: Float = np.maximum.accumulate(time_s + late)
    return out
