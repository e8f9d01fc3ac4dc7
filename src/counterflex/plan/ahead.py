"""The predicted wrench as a loop has to command against it: ahead of time, and shaped for what corrections pass."""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float, as_float
from counterflex.geometry import wrench
from counterflex.robot import compliance
from counterflex.robot.chain import ElasticChain
from counterflex.signals.preview import Mode, Shaping, command_for


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


def ahead_wrench(w_part: Float, time_s: Float, share: float, modes: tuple[Mode, ...], shaping: Shaping) -> Float:
    """Wrench whose static deflection, sent as a correction, undoes that of the predicted wrench in time.

    Deflection under a force comes in two parts: that of the arm swings through its mode, the rest follows at once. A
    correction passes dead time, the controller's own lag and the arm's mode. The compliance changes little over the
    time of all that, so the shaping is done on the wrench, by :func:`counterflex.signals.preview.command_for`.

    Args:
        w_part: (n, 6) predicted, N, N m, part axes.
        time_s: (n,) planned time.
        share: Of the deflection that the arm makes, see :func:`arm_share`.
        modes: What corrections pass, the arm's first.
        shaping: Smoothing and dead time.

    Returns:
        (n, 6).
    """
    w = as_float("w_part", w_part, (None, 6))
    return command_for((1.0 - share) * w, time_s, modes, shaping, share * w)
