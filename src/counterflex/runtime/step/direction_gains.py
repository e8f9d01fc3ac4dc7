"""PID on the deflection, with gains of their own along the feed, across it and along the tool."""

from __future__ import annotations

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel


@kernel("void(float64[::1], float64[::1], float64[::1], int64, float64[::1], float64[::1], float64[::1])")
def control(
    bent: Float, frame: Float, gains: Float, active: int, integral: Float, last: Float, correction: Float
) -> None:
    """Correction of a deflection, ``-(Kp d + sum Ki d T + Kd (d - d_before) / T)``.

    The gains hold along three directions that turn with the path; what is summed up stays in part axes, so it does not
    turn with them. The orientation takes the mean of the proportional gains. With three equal gains the directions do
    not matter.

    Args:
        bent: (6,) deflection, m and rad, part axes.
        frame: (9,) rows: unit vectors feed, across, along the tool.
        gains: (9,) Kp (3), Ki times the period (3), Kd by the period (3).
        active: 0 leaves the sum as it is.
        integral: (3,) sum, part axes; changed.
        last: (3,) deflection of the last cycle; changed.
        correction: (6,) written.

    Source: Haehn2020 section 2.8 (PID per direction).
    """
    for k in range(3):
        correction[k] = 0.0
    for d in range(3):
        a, b, c = frame[3 * d], frame[3 * d + 1], frame[3 * d + 2]
        here = a * bent[0] + b * bent[1] + c * bent[2]
        change = here - (a * last[0] + b * last[1] + c * last[2])
        now = gains[d] * here + gains[6 + d] * change
        for k in range(3):
            correction[k] -= now * frame[3 * d + k]
            if active == 1:
                integral[k] += gains[3 + d] * here * frame[3 * d + k]
    mean = (gains[0] + gains[1] + gains[2]) / 3.0
    for k in range(3):
        correction[k] -= integral[k]
        correction[3 + k] = -mean * bent[3 + k]
        last[k] = bent[k]
