"""Second stage of the online step: which wrench the correction is computed from, by the mode of the force. Pure."""

from __future__ import annotations

from typing import Any, Final

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.core.records import Record, Records
from counterflex.runtime.estimator.deflection import currents_shown, estimate_loads, missing_cause, sources_of
from counterflex.runtime.estimator.force import blend, learn_scale, met_share, scaled
from counterflex.runtime.estimator.fusion import Source
from counterflex.runtime.primitives.causes import can_yield
from counterflex.runtime.primitives.frames import directions, lag
from counterflex.runtime.primitives.history import moves
from counterflex.runtime.primitives.loop_types import LOOP_TYPES
from counterflex.runtime.state.supervisor import Cause
from counterflex.signals.filters import smooth

FILTER: Final = "Tuple((float64[::1], float64[:, ::1], float64[:, ::1], int64[::1]))"
"""Coefficients, memory, ring and place of a :class:`counterflex.signals.filters.Smoother`."""
MEASURED, PILOT, SCALE, FUSED = 1, 2, 3, 4
"""ForceMode."""
_PROCESS = int(Source.FORCE | Source.CURRENTS)
_FORCE_STALE, _NOT_FINITE = int(Cause.FORCE_STALE), int(Cause.NOT_FINITE)


@kernel(f"void(Settings, State, Cycle, Result, {FILTER}, {FILTER})", **LOOP_TYPES)
def _filter_forces(
    settings: Record, state: Record, cycle: Record, result: Record, measured: Any, predicted: Any
) -> None:
    """Measured and planned force through the same filters; the planned one first through that of the sensor's mass."""
    if cycle.hard == _NOT_FINITE:
        return
    coefficients, memory, ring, place = measured
    smooth(state.believed[:], result.measured[:], coefficients, memory, ring, place)
    lag(cycle.behind[:], settings.inertia[:], state.inertia_filter[:], cycle.behind[:])
    for k in range(6):
        state.predicted_late[k] = cycle.behind[k]
    coefficients, memory, ring, place = predicted
    smooth(cycle.behind[:], cycle.late[:], coefficients, memory, ring, place)


@kernel("void(Given, Settings, State, Cycle)", **LOOP_TYPES)
def _find_sources(given: Record, settings: Record, state: Record, cycle: Record) -> None:
    """Find the estimator's sources of this cycle; the loss of one sensor is no cause while it has another."""
    cycle.sources = sources_of(given, settings, given.soft, state.disbelieved, cycle.planned)
    cycle.degraded = missing_cause(given.sources, cycle.sources, given.soft)
    if cycle.sources == 0 and cycle.soft == 0:
        cycle.soft = cycle.degraded if cycle.degraded != 0 else _FORCE_STALE
    elif cycle.sources != 0 and can_yield(settings, cycle.soft):
        cycle.soft = 0


@kernel("void(Settings, Cycle, Result)", **LOOP_TYPES)
def _use_measured(settings: Record, cycle: Record, result: Record) -> None:
    """The measured force, less what the program contains the correction of."""
    for k in range(6):
        cycle.used[k] = result.measured[k]
    if settings.compensated == 1:
        for k in range(6):
            cycle.used[k] -= cycle.late[k]


@kernel("void(Given, Settings, State, Cycle, Result, float64[::1])", **LOOP_TYPES)
def _use_blend(given: Record, settings: Record, state: Record, cycle: Record, result: Record, work: Float) -> None:
    """Measured and planned force blended (pilot control)."""
    fresh = given.force_age < settings.stale
    # No cause for a hold here: the plan alone is what pilot control falls back to for ``bridge`` cycles.
    threshold = settings.threshold if fresh else 0.0  # without a force the plan is blended in
    share = blend(result.measured[:], state.preview[:], state.plan_share, threshold, settings.blend)
    state.plan_share = share
    forward = settings.reads_ahead == 1
    met = met_share(result.measured[:], cycle.late[:]) if forward else 0.0
    measured, ahead, late = result.measured[:], cycle.ahead[:], cycle.late[:]
    # In a row of its own the sum of two products rounds as in logs of before, see docs/adr/0004-kernels.md.
    for k in range(6):
        trusted = measured[k] + met * (ahead[k] - late[k])
        work[k] = (1.0 - share) * trusted + share * ahead[k]
        if settings.compensated == 1:
            work[k] -= (1.0 - share) * (ahead[k] if forward else late[k]) + share * ahead[k]
    for k in range(6):
        cycle.used[k] = work[k]


@kernel("void(Given, Settings, State, Cycle, Result)", **LOOP_TYPES)
def _use_scaled(given: Record, settings: Record, state: Record, cycle: Record, result: Record) -> None:
    """The planned force with learnt factors."""
    if given.force_age < settings.stale and cycle.cut > 0.0 and cycle.moving == 1:
        learn_scale(
            result.measured[:],
            cycle.late[:],
            state.predicted_before[:],
            cycle.direction[:],
            settings.scale[:],
            state.scale[:],
            state.scale_variance[:],
        )
    scaled(cycle.ahead[:], cycle.direction[:], state.scale[:], cycle.used[:])
    if settings.compensated == 1:
        for k in range(6):
            cycle.used[k] -= cycle.ahead[k]


@kernel(
    f"void(Given, Settings, State, Past[::1], Plan[::1], ElasticWork, Cycle, Result, {FILTER}, {FILTER})", **LOOP_TYPES
)
def find_load(
    given: Record,
    settings: Record,
    state: Record,
    ring: Records,
    plan: Records,
    work: Record,
    cycle: Record,
    result: Record,
    measured: Any,
    predicted: Any,
) -> None:
    """Wrench whose deflection is to be corrected.

    Args:
        given: Inputs of the cycle.
        state: Of the step; changed.
        ring: Past cycles.
        plan: (n,) PLAN.
        work: Of the elastic step, with the rigid Jacobian of the last cycle, base axes.
        cycle: Written.
        result: Measured, used and predicted wrench are written.
        measured: Coefficients, memory, ring and place of the filter of the measured force; changed.
        predicted: Likewise of the predicted force.
    """
    mode, finite = settings.force, cycle.hard != _NOT_FINITE
    _filter_forces(settings, state, cycle, result, measured, predicted)
    cycle.moving = 1 if cycle.planned == 0 or moves(ring, state.ring_row, given.nominal[:]) else 0
    if mode == FUSED:
        _find_sources(given, settings, state, cycle)
    elif mode != 0 and given.force_age >= settings.bridge and cycle.soft == 0:
        cycle.soft = _FORCE_STALE
    directions(plan, cycle.row, given.nominal[:], cycle.direction[:])
    if mode == MEASURED:
        _use_measured(settings, cycle, result)
    elif mode == PILOT:
        _use_blend(given, settings, state, cycle, result, work.move[:])
    elif mode == SCALE:
        _use_scaled(given, settings, state, cycle, result)
    elif mode == FUSED and finite:
        # A program that stands cuts nothing: what is then measured beside the plan would be learnt as a factor of none.
        known = cycle.sources if cycle.moving == 1 else cycle.sources & ~_PROCESS
        estimate_loads(
            given, known, cycle.moving == 1 and currents_shown(given), settings, work.jacobian[:], state, cycle, result
        )
    for k in range(6):
        state.predicted_before[k] = cycle.late[k]
        result.wrench[k] = cycle.used[k]
        result.predicted[k] = cycle.ahead[k]
