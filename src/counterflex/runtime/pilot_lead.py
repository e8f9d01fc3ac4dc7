"""How much ahead pilot control has to read a plan: found by blending over the plan, for every lead that is possible.

Blending takes time and begins only where the difference of forces exceeds the threshold, so what is blended in comes
late by an amount that depends on how fast the force changes. The plan says how fast.
"""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.jit import kernel
from counterflex.runtime.force_kernel import blend
from counterflex.signals.filters import Smoother, Smoothing, smooth


@kernel(
    "float64(float64[:, ::1], float64[:, ::1], int64, float64, float64, float64[::1], float64[::1], float64[:, ::1],"
    " float64[:, ::1], int64[::1])"
)
def _left(
    w: Float,
    ahead: Float,
    lead: int,
    threshold_n: float,
    step: float,
    answer: Float,
    coefficients: Float,
    memory: Float,
    ring: Float,
    place: Int,
) -> float:
    """Largest force whose deflection stays, after the robot's answer, with one lead in cycles."""
    n = w.shape[0]
    filtered, used = np.zeros(6), np.zeros(6)
    x, y = np.zeros((2, 3)), np.zeros((2, 3))
    share = largest = 0.0
    for i in range(n):
        smooth(w[i], filtered, coefficients, memory, ring, place)
        share = blend(filtered, ahead[min(n - 1, i + lead)], share, threshold_n, step, used)
        square = 0.0
        for k in range(3):
            e = used[k] - ahead[i, k]
            out = answer[0] * e + answer[1] * x[0, k] + answer[2] * x[1, k] - answer[3] * y[0, k] - answer[4] * y[1, k]
            x[1, k], x[0, k] = x[0, k], e
            y[1, k], y[0, k] = y[0, k], out
            square += out * out
        largest = max(largest, square)
    return float(np.sqrt(largest))


def pilot_lead(
    time_s: Float,
    w_part: Float,
    w_ahead_part: Float,
    smoothing: Smoothing,
    threshold_n: float,
    blend_s: float,
    answer: Float,
    *,
    most_s: float,
) -> float:
    """The lead with which blending leaves least, in whole cycles.

    Run over the plan as if the predicted force were measured: filtered, compared with the prediction ahead, blended,
    and passed through the robot's answer; what remains is compared by its largest value.

    Args:
        time_s: (n,) planned time.
        w_part: (n, 6) predicted wrench.
        w_ahead_part: (n, 6) wrench to be commanded at each place, see :class:`counterflex.runtime.loop.LoopPlan`.
        smoothing: Filters of the measured force; its period is the cycle.
        threshold_n: Of pilot control.
        blend_s: Likewise.
        answer: (5,) of :func:`counterflex.runtime.settings.robot_answer`.
        most_s: Longest lead that is looked at.

    Returns:
        s, 0 .. ``most_s``; 0 where nothing is ever blended.
    """
    T = smoothing.period_s
    grid = np.arange(time_s[0], time_s[-1] + T, T)
    w, ahead = (
        np.ascontiguousarray(np.stack([np.interp(grid, time_s, c) for c in values.T], axis=1))
        for values in (w_part, w_ahead_part)
    )
    best, least = 0, np.inf
    for lead in range(round(most_s / T) + 1):
        smoother = Smoother(smoothing, 6)
        left = _left(
            w, ahead, lead, threshold_n, T / blend_s, answer, smoother.coefficients, smoother.memory, smoother.ring,
            smoother.place,
        )  # fmt: skip
        if left < least:
            best, least = lead, left
    return best * T
