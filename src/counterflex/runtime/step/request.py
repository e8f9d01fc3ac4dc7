"""Fifth stage of the online step: the correction that is wanted, before limits. Pure."""

from __future__ import annotations

import math

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.core.records import Record, Records
from counterflex.runtime.primitives.frames import across, size_of
from counterflex.runtime.primitives.loop_types import LOOP_TYPES
from counterflex.runtime.state.supervisor import Cause
from counterflex.runtime.step.deviation import DESIGNED, INTEGRATOR, OBSERVER
from counterflex.runtime.step.load import FUSED
from counterflex.runtime.step.tracker import designed_correction


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


_SOFT_LIMIT, _HARD_LIMIT, _NOT_FINITE = int(Cause.LIMIT_SOFT), int(Cause.LIMIT_HARD), int(Cause.NOT_FINITE)


@kernel("void(Settings, State, Plan[::1], Cycle, Result)", **LOOP_TYPES)
def request_correction(settings: Record, state: Record, plan: Records, cycle: Record, result: Record) -> None:
    """Correction of the deflection, and of what the tracker shows.

    ``state``: of the step; sum and last deflection are changed.
    """
    requested, extra = result.wanted[:], cycle.vector[:]
    control(
        result.deflection[:],
        cycle.direction[:],
        settings.gains[:],
        cycle.active,
        state.integral[:],
        state.deflection_before[:],
        requested,
    )
    size = 6 if settings.orientation == 1 else 3
    for k in range(size, 6):
        requested[k] = 0.0
    if settings.force == FUSED:
        for k in range(6):
            extra[k] = result.offset[k]
        if settings.normal_only == 1 and cycle.planned == 1:
            across(extra, 0, plan, cycle.row)
        for k in range(size):
            requested[k] -= extra[k]
    if settings.tracker == INTEGRATOR:
        for k in range(size):
            requested[k] += state.tracker_integral[k]
    elif settings.tracker == DESIGNED:
        for k in range(6):
            extra[k] = 0.0
        designed_correction(settings, state, extra)
        for k in range(size):
            requested[k] += extra[k]
    elif settings.tracker == OBSERVER:
        for k in range(size):
            requested[k] -= state.offset[k]


@kernel("void(Settings, float64[::1], Cycle)", **LOOP_TYPES)
def check_reach(settings: Record, requested: Float, cycle: Record) -> None:
    """Causes by the wanted correction: not a number, beyond the limits, or far beyond.

    ``requested``: (6,) m and rotation vector.
    """
    for k in range(6):
        if not math.isfinite(requested[k]) and cycle.hard == 0:
            cycle.hard = _NOT_FINITE
    reach = max(size_of(requested, 0) / settings.translation[0], size_of(requested, 3) / settings.rotation[0])
    acts = cycle.active == 1 or cycle.held == 1
    if reach > settings.hard_factor and cycle.hard == 0 and acts:
        cycle.hard = _HARD_LIMIT
    elif reach > 1.0 and cycle.soft == 0 and acts:
        cycle.soft = _SOFT_LIMIT
