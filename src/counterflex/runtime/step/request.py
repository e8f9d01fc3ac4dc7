"""Fifth stage of the online step: the correction that is wanted, before limits. Pure."""

from __future__ import annotations

import math

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.core.records import Record, Records
from counterflex.runtime.primitives.frames import across, size_of
from counterflex.runtime.state.chosen import SETTINGS
from counterflex.runtime.state.cycle import CYCLE
from counterflex.runtime.state.memory import STATE
from counterflex.runtime.state.planned import PLAN
from counterflex.runtime.state.result import RESULT
from counterflex.runtime.state.supervisor import Cause
from counterflex.runtime.step.deviation import DESIGNED, INTEGRATOR, OBSERVER
from counterflex.runtime.step.direction_gains import control
from counterflex.runtime.step.load import FUSED
from counterflex.runtime.step.tracker import designed_correction

_SOFT_LIMIT, _HARD_LIMIT, _NOT_FINITE = int(Cause.LIMIT_SOFT), int(Cause.LIMIT_HARD), int(Cause.NOT_FINITE)


@kernel(
    "void(Settings, State, Plan[::1], Cycle, Result)",
    Settings=SETTINGS,
    State=STATE,
    Cycle=CYCLE,
    Result=RESULT,
    Plan=PLAN,
)
def request_correction(settings: Record, state: Record, plan: Records, cycle: Record, result: Record) -> None:
    """Correction of the deflection, and of what the tracker shows.

    Args:
        settings: Of the loop.
        state: Of the step; sum and last deflection are changed.
        plan: (n,) PLAN.
        cycle: With what was found before.
        result: With the deflection; the wanted correction is written.
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


@kernel("void(Settings, float64[::1], Cycle)", Settings=SETTINGS, Cycle=CYCLE)
def check_reach(settings: Record, requested: Float, cycle: Record) -> None:
    """Causes by the wanted correction: not a number, beyond the limits, or far beyond.

    Args:
        settings: Of the loop.
        requested: (6,) m and rotation vector.
        cycle: Causes are written.
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
