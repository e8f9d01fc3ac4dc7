"""The estimator's part of the online step: loads before the elastic model, deviations after it. Pure."""

from __future__ import annotations

import math

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.core.records import Record, Records
from counterflex.runtime.estimator.fusion_kernel import (
    bend,
    drift,
    fused_load,
    shares,
    take_deviation,
    take_force,
    take_torque,
    uncertainty,
    unexplained,
)
from counterflex.runtime.estimator.idle_torque import follow_idle, less_force
from counterflex.runtime.primitives.causes import of_the_force
from counterflex.runtime.primitives.frames import lag, pose_deviation
from counterflex.runtime.primitives.history import row_at, row_back
from counterflex.runtime.primitives.loop_types import LOOP_TYPES
from counterflex.runtime.state.supervisor import Cause, State

_FORCE_STALE, _FORCE_INVALID = int(Cause.FORCE_STALE), int(Cause.FORCE_INVALID)
_FORCE_SATURATED, _FORCE_OFFSET = int(Cause.FORCE_SATURATED), int(Cause.FORCE_OFFSET)
_TRACKER_LOST = int(Cause.TRACKER_LOST)
_READY = int(State.READY)
_FROM_PLAN, _FROM_FORCE, _FROM_TRACKER, _FROM_CURRENTS = 1, 2, 4, 8
_SPAN = 4
"""Cycles over which accelerations are taken."""


@kernel("int64(Given, Settings, int64, int64, int64)", **LOOP_TYPES)
def sources_of(given: Record, settings: Record, soft: int, disbelieved: int, planned: int) -> int:
    """Bits of Source that can be used in this cycle.

    Args:
        given: Inputs of the cycle.
        soft: Cause of a hold found outside of the step; one of the force sensor's means that it is not used.
        disbelieved: Tracker samples in a row that were too far off.
        planned: 1 where there is a plan.
    """
    has = given.sources
    usable = _FROM_PLAN if planned == 1 else 0
    if has & _FROM_FORCE and not of_the_force(soft) and given.force_age < settings.stale:
        usable |= _FROM_FORCE
    if has & _FROM_TRACKER and given.tracker_age < settings.tracker_stale and disbelieved < settings.disbelieved:
        usable |= _FROM_TRACKER
    if has & _FROM_CURRENTS and not usable & _FROM_FORCE and given.current_age < settings.stale:
        usable |= _FROM_CURRENTS
    return usable


@kernel("boolean(Given)", **LOOP_TYPES)
def currents_shown(given: Record) -> bool:
    """Return whether motor currents came in this cycle, in use or not."""
    return bool(given.sources & _FROM_CURRENTS) and given.current_age == 0


@kernel("int64(int64, int64, int64)")
def missing_cause(has: int, usable: int, soft: int) -> int:
    """Cause for which a source of the cell is not used, or 0; motor currents are not missed while there is a force."""
    missing = has & ~usable
    if missing & _FROM_FORCE:
        return soft if soft in (_FORCE_INVALID, _FORCE_SATURATED, _FORCE_OFFSET) else _FORCE_STALE
    if missing & _FROM_TRACKER:
        return _TRACKER_LOST
    return 0


@kernel("void(Past[::1], int64, int64, Settings, State)", **LOOP_TYPES)
def answered(ring: Records, here: int, back: int, settings: Record, state: Record) -> None:
    """Correction in effect, one cycle on: what was sent ``back`` cycles ago through the robot's second-order lag.

    ``back``: cycles of dead time.
    """
    sent = ring[row_back(here, back)]
    lag(sent.sent[:], settings.answer[:], state.answer_filter[:], state.in_effect[:])


@kernel("void(Given, int64, Settings, float64[::1], State, Cycle, Result, float64)", **LOOP_TYPES)
def _currents(
    given: Record,
    usable: int,
    settings: Record,
    jac: Float,
    state: Record,
    cycle: Record,
    result: Record,
    gate: float,
) -> None:
    """Motor currents: what they show beside the force is their zero; where no force is measured, the rest tells it."""
    torque, forced = given.torque[:], usable & _FROM_FORCE != 0
    idle, torque_residual = state.idle[:], state.torque_residual[:]
    R = settings.R_base_part[:]
    motor, link = state.motor[:], state.link[:]
    for k in range(6):
        torque_residual[k] = torque[k]
        link[k] = 0.0
    less_force(result.measured[:] if forced else cycle.predicted[:], jac, R, link)
    if forced:
        for k in range(6):
            torque_residual[k] += link[k]
    for k in range(6):
        motor[k] = given.q[k] + result.axes[k]
        link[k] = motor[k] - settings.torsion[k] * link[k]
    known = follow_idle(motor, link, torque_residual, cycle.cut <= 0.0 or forced, state, idle)
    if known == 0 or cycle.cut <= 0.0 or not (usable & _FROM_CURRENTS and usable & _FROM_PLAN):
        return
    fusion = state.fusion
    shares(cycle.predicted[:], cycle.direction[:], fusion.bent[:])
    result.surprise[2] = take_torque(fusion, torque, idle, known, jac, R, settings.torque_variance[:], gate)


@kernel("float64(State)", **LOOP_TYPES)
def _swing_share(state: Record) -> float:
    """Swing of the arm by the deflection under the predicted force: by which share the force at the sensor swings."""
    square = 0.0
    for k in range(3):
        total = 0.0
        for d in range(3):
            total += state.fusion.bent[6 * d + k]
        square += total * total
    return min(1.0, state.swing / math.sqrt(square)) if square > 0.0 else 0.0


@kernel("void(Given, int64, boolean, Settings, float64[::1], State, Cycle, Result)", **LOOP_TYPES)
def estimate_loads(
    given: Record,
    usable: int,
    shown: bool,
    settings: Record,
    jac: Float,
    state: Record,
    cycle: Record,
    result: Record,
) -> None:
    """Factors of the force from what is measured, and the load that the deflection is computed from.

    Args:
        given: Inputs of the cycle.
        usable: Bits of Source in use.
        shown: There are motor currents in this cycle, and the robot moves; in use or not, their zero is learnt.
        jac: (36,) rigid Jacobian of the last cycle, base axes.
        state: Of the step; changed.
        cycle: The used wrench is written, without a plan the predicted ones too.
        result: Of the step, with the measured force; factors and innovations are written.
    """
    fusion = state.fusion
    growth = settings.fusion[:]
    drift(fusion, growth[:3], growth[3:6], growth[6], growth[7])
    gate = growth[8]
    for k in range(3):
        result.surprise[k] = 0.0
    if not usable & _FROM_PLAN:
        if usable & _FROM_FORCE:
            for k in range(6):
                state.reference[k] = result.measured[k]
        for k in range(6):
            cycle.predicted[k] = cycle.late[k] = cycle.ahead[k] = state.reference[k]
    elif usable & _FROM_FORCE and cycle.cut > 0.0:
        result.surprise[0] = take_force(
            fusion,
            result.measured[:],
            cycle.late[:],
            state.predicted_before[:],
            cycle.direction[:],
            settings.scale[:],
            _swing_share(state),
            gate,
        )
    if shown:
        _currents(given, usable, settings, jac, state, cycle, result, gate)
    fused_load(fusion, cycle.ahead[:], cycle.direction[:], settings.contained, cycle.used[:])


@kernel("void(Settings, float64[::1], int64, Past[::1], State)", **LOOP_TYPES)
def _swing(settings: Record, bent: Float, here: int, ring: Records, state: Record) -> None:
    """Amplitude with which the arm may swing: ``|p''| / w^2`` of its lowest mode, dying out."""
    # Where it should stand is path, correction in effect and expected deflection; a tracker sees the swing, which is no
    # error of the model.
    later, earlier = row_back(here, _SPAN), row_back(here, 2 * _SPAN)
    now, one, two = ring[here], ring[later], ring[earlier]
    square = 0.0
    for k in range(3):
        stand = now.nominal[9 + k] + now.in_effect[k]
        for d in range(3):
            stand += (state.fusion.estimate[d] + state.fusion.estimate[3 + d]) * bent[6 * d + k]
        now.stand[k] = stand
        square += (stand - 2.0 * one.stand[k] + two.stand[k]) ** 2
    span = _SPAN * settings.period
    fresh = math.sqrt(square) / (span * span) * settings.swing[0]
    if two.clock <= 0.0:
        fresh = 0.0
    state.swing = max(fresh, state.swing * settings.swing[1])
    now.swing = state.swing


@kernel("void(Given, Settings, int64, boolean, int64, Past[::1], State, Result, float64[::1])", **LOOP_TYPES)
def _take_sample(
    given: Record,
    settings: Record,
    first: int,
    active: bool,
    here: int,
    ring: Records,
    state: Record,
    result: Record,
    deviation: Float,
) -> None:
    fusion = state.fusion
    past = state.past
    rest, bent = state.residual[:], state.past_bent[:]
    period, growth = settings.period, settings.fusion[:]
    late = given.tracker_late if given.tracker_late >= 0.0 else settings.tracker_late
    clock = state.clock - late / period
    # The correction belongs to the instant of the sample, path and force to what the robot follows then.
    if not row_at(ring, here, clock, past):
        return
    for k in range(6):
        rest[k] = -past.in_effect[k]
    lagged_clock = clock - settings.follow / period
    known = min(lagged_clock + settings.reference_late / period, state.clock)
    if not row_at(ring, here, known, past):
        return
    for k in range(18):
        bent[k] = past.bent[k]
    if not row_at(ring, here, lagged_clock, past):
        return
    pose_deviation(
        given.actual[:],
        0,
        past.nominal[:],
        past.contained[:],
        deviation,
    )
    frame = past.frame[:]
    for k in range(6):
        rest[k] += deviation[k]
    if first == 1:
        along = deviation[0] * frame[0] + deviation[1] * frame[1] + deviation[2] * frame[2]
        for k in range(3):
            deviation[k] -= along * frame[k]
    without = settings.contained
    largest = settings.largest_jump if active else math.inf
    if not unexplained(fusion, rest, bent, frame, first, without) <= largest:
        state.disbelieved += 1
        return
    state.disbelieved = 0
    square = 0.0
    for k in range(18):
        square += bent[k] * bent[k] if k % 6 < 3 else 0.0
    spread = settings.noise[0] + given.tracker_sigma**2
    spread += past.swing**2
    spread += late / period * (growth[2] + (growth[0] + growth[1]) * square)
    noise_turn = settings.noise[1] + late / period * growth[6]
    # While nothing is corrected a lasting change is followed at once: a frame that was put right must not be asked for.
    gate = growth[8] if state.supervisor.state > _READY else math.inf
    result.surprise[1] = take_deviation(fusion, rest, bent, frame, first, without, spread, noise_turn, gate)


@kernel("void(Given, Settings, float64[::1], State, Past[::1], Cycle, Result)", **LOOP_TYPES)
def estimate_deviation(
    given: Record, settings: Record, C: Float, state: Record, ring: Records, cycle: Record, result: Record
) -> None:
    """Remember this cycle, and take a tracker sample with what was known at its own time.

    ``C``: (36,) compliance of the arm at the tip, base axes, by rows; ``cycle``: the deviation is written where there
    is a sample.
    """
    fusion = state.fusion
    bent = fusion.bent[:]
    shares(cycle.predicted[:], cycle.direction[:], bent)
    bend(fusion, C, settings.R_base_part[:])
    here = state.ring_row
    now = ring[here]
    for k in range(6):
        now.contained[k] = cycle.contained[k]
        now.in_effect[k] = state.in_effect[k]
    for k in range(9):
        now.frame[k] = cycle.direction[k]
    for k in range(18):
        now.bent[k] = bent[k]
    now.clock = state.clock
    _swing(settings, bent, here, ring, state)
    first = 1 if settings.normal_only == 1 else 0
    if given.sources & _FROM_TRACKER and given.tracker_new == 1:
        _take_sample(given, settings, first, cycle.active == 1, here, ring, state, result, cycle.deviation[:])
    result.uncertain = uncertainty(fusion, bent, cycle.direction[:], first)
    for k in range(3):
        result.factor[k] = fusion.estimate[k]
        result.model[k] = fusion.estimate[3 + k]
        result.offset[k] = fusion.estimate[6 + k]
        result.offset[3 + k] = fusion.turn[k]
