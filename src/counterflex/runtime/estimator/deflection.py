"""The estimator's part of the online step: loads before the elastic model, deviations after it. Pure."""

from __future__ import annotations

import math

from counterflex.core.arrays import Float, Int
from counterflex.core.jit import kernel
from counterflex.robot.elasticity.kernels.step import OUT_C
from counterflex.runtime.estimator.fusion_kernel import SIZE as FUSION_SIZE
from counterflex.runtime.estimator.fusion_kernel import (
    TURN,
    X,
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
from counterflex.runtime.estimator.fusion_kernel import D as BENT
from counterflex.runtime.estimator.idle_torque import follow_idle, less_force
from counterflex.runtime.primitives.frames import pose_deviation
from counterflex.runtime.primitives.history import row_at
from counterflex.runtime.primitives.lag_filters import lag
from counterflex.runtime.state import layout as at
from counterflex.runtime.state.supervisor import Cause

_FORCE_STALE, _FORCE_INVALID = int(Cause.FORCE_STALE), int(Cause.FORCE_INVALID)
_FORCE_SATURATED, _FORCE_OFFSET = int(Cause.FORCE_SATURATED), int(Cause.FORCE_OFFSET)
_TRACKER_LOST = int(Cause.TRACKER_LOST)
_FROM_PLAN, _FROM_FORCE, _FROM_TRACKER, _FROM_CURRENTS = 1, 2, 4, 8
_SPAN = 4
"""Cycles over which accelerations are taken."""


@kernel("int64(int64[::1], int64[::1], int64, int64, int64)")
def sources_of(flags: Int, choices: Int, soft: int, disbelieved: int, planned: int) -> int:
    """Bits of Source that can be used in this cycle.

    Args:
        flags: Inputs of the cycle.
        choices: Of the loop.
        soft: Cause of a hold found outside of the step; one of the force sensor's means that it is not used.
        disbelieved: Tracker samples in a row that were too far off.
        planned: 1 where there is a plan.
    """
    has = flags[at.F_SOURCES]
    found = _FROM_PLAN if planned == 1 else 0
    bad = soft in (_FORCE_STALE, _FORCE_INVALID, _FORCE_SATURATED, _FORCE_OFFSET)
    if has & _FROM_FORCE and not bad and flags[at.F_FORCE_AGE] < choices[at.W_STALE]:
        found |= _FROM_FORCE
    if (
        has & _FROM_TRACKER
        and flags[at.F_TRACKER_AGE] < choices[at.W_TRACKER_STALE]
        and disbelieved < choices[at.W_DISBELIEVED]
    ):
        found |= _FROM_TRACKER
    if has & _FROM_CURRENTS and not found & _FROM_FORCE and flags[at.F_CURRENT_AGE] < choices[at.W_STALE]:
        found |= _FROM_CURRENTS
    return found


@kernel("boolean(int64[::1])")
def currents_shown(flags: Int) -> bool:
    """Whether motor currents came in this cycle, in use or not."""
    return bool(flags[at.F_SOURCES] & _FROM_CURRENTS) and flags[at.F_CURRENT_AGE] == 0


@kernel("int64(int64, int64, int64)")
def missing_cause(has: int, found: int, soft: int) -> int:
    """Why a source of the cell is not used, or 0; motor currents are not missed while there is a force."""
    missing = has & ~found
    if missing & _FROM_FORCE:
        return soft if soft in (_FORCE_INVALID, _FORCE_SATURATED, _FORCE_OFFSET) else _FORCE_STALE
    if missing & _FROM_TRACKER:
        return _TRACKER_LOST
    return 0


@kernel("void(float64[:, ::1], int64, int64, float64[::1], float64[::1])")
def answered(ring: Float, here: int, back: int, constants: Float, state: Float) -> None:
    """Correction in effect, one cycle on: what was sent ``back`` cycles ago through the robot's second-order lag.

    Args:
        ring: Of the last cycles.
        here: Row of this cycle.
        back: Cycles of dead time.
        constants: Of the loop.
        state: Of the step; changed.
    """
    sent = ring[(here - back + at.RING_ROWS) % at.RING_ROWS]
    lag(sent, at.RING_SENT, constants, at.C_ANSWER, state, at.S_ANSWER, state, at.S_IN_FORCE)


@kernel("boolean(int64)")
def of_a_sensor(soft: int) -> bool:
    """Whether a cause of a hold is the loss of one sensor, which the estimator outlives while it has another source."""
    return soft in (_FORCE_STALE, _FORCE_INVALID, _FORCE_SATURATED, _FORCE_OFFSET, _TRACKER_LOST)


@kernel(
    "void(float64[::1], int64, float64[::1], float64[::1], float64, float64[::1], float64[::1], float64[::1],"
    " float64[::1], float64[::1], float64)"
)
def _currents(
    given: Float,
    found: int,
    constants: Float,
    filtered: Float,
    cut: float,
    predicted: Float,
    direction: Float,
    jac: Float,
    state: Float,
    results: Float,
    gate: float,
) -> None:
    """Motor currents: what they show beside the force is their zero; where no force is measured, the rest tells it."""
    torque, forced = given[at.G_TORQUE : at.G_TORQUE + 6], found & _FROM_FORCE != 0
    idle, beside = state[at.S_IDLE : at.S_IDLE + 6], state[at.S_BESIDE : at.S_BESIDE + 6]
    R = constants[at.C_R_BASE_PART : at.C_R_BASE_PART + 9]
    motor, link = state[at.S_MOTOR : at.S_MOTOR + 6], state[at.S_MOTOR + 6 : at.S_MOTOR + 12]
    for k in range(6):
        beside[k] = torque[k]
        link[k] = 0.0
    less_force(filtered if forced else predicted, jac, R, link)
    if forced:
        for k in range(6):
            beside[k] += link[k]
    for k in range(6):
        motor[k] = given[at.G_Q + k] + results[at.R_AXES + k]
        link[k] = motor[k] - constants[at.C_TORSION + k] * link[k]
    known = follow_idle(motor, link, beside, cut <= 0.0 or forced, state, idle)
    if known == 0 or cut <= 0.0 or not (found & _FROM_CURRENTS and found & _FROM_PLAN):
        return
    fusion = state[at.S_FUSION : at.S_FUSION + FUSION_SIZE]
    shares(predicted, direction, fusion[BENT : BENT + 18])
    results[at.R_SURPRISE + 2] = take_torque(
        fusion, torque, idle, known, jac, R, constants[at.C_TORQUE : at.C_TORQUE + 6], gate
    )


@kernel("float64(float64[::1])")
def _swing_share(state: Float) -> float:
    """Swing of the arm by the deflection under the predicted force: by which share the force at the sensor swings."""
    square = 0.0
    for k in range(3):
        total = 0.0
        for d in range(3):
            total += state[at.S_FUSION + BENT + 6 * d + k]
        square += total * total
    return min(1.0, state[at.S_SWING] / math.sqrt(square)) if square > 0.0 else 0.0


@kernel(
    "void(float64[::1], int64, boolean, float64[::1], float64[::1], float64, float64[::1], float64[::1],"
    " float64[::1], float64[::1], float64[::1], float64[::1], float64[::1], float64[::1])"
)
def estimate_loads(
    given: Float,
    found: int,
    shown: bool,
    constants: Float,
    filtered: Float,
    cut: float,
    predicted: Float,
    late: Float,
    ahead: Float,
    direction: Float,
    jac: Float,
    state: Float,
    results: Float,
    used: Float,
) -> None:
    """Factors of the force from what is measured, and the load that the deflection is computed from.

    Args:
        given: Inputs of the cycle.
        found: Bits of Source in use.
        shown: There are motor currents in this cycle, and the robot moves; in use or not, their zero is learnt.
        constants: Of the loop.
        filtered: (6,) measured force.
        cut: Above 0 where the plan cuts.
        predicted: (6,) now; written where there is no plan, as the next two.
        late: (6,) predicted, through the filters of the measured force.
        ahead: (6,) predicted for the time at which a correction acts.
        direction: (9,) feed, across, along the tool.
        jac: (36,) rigid Jacobian of the last cycle, base axes.
        state: Of the step; changed.
        results: Of the step; factors and innovations are written.
        used: (6,) written.
    """
    fusion = state[at.S_FUSION : at.S_FUSION + FUSION_SIZE]
    growth = constants[at.C_FUSION : at.C_FUSION + 9]
    drift(fusion, growth[:3], growth[3:6], growth[6], growth[7])
    gate = growth[8]
    for k in range(3):
        results[at.R_SURPRISE + k] = 0.0
    if not found & _FROM_PLAN:
        if found & _FROM_FORCE:
            for k in range(6):
                state[at.S_REFERENCE + k] = filtered[k]
        for k in range(6):
            predicted[k] = late[k] = ahead[k] = state[at.S_REFERENCE + k]
    elif found & _FROM_FORCE and cut > 0.0:
        results[at.R_SURPRISE] = take_force(
            fusion,
            filtered,
            late,
            state[at.S_BEFORE : at.S_BEFORE + 6],
            direction,
            constants[at.C_SCALE : at.C_SCALE + 4],
            _swing_share(state),
            gate,
        )
    if shown:
        _currents(given, found, constants, filtered, cut, predicted, direction, jac, state, results, gate)
    fused_load(fusion, ahead, direction, constants[at.C_WITHOUT], used)


@kernel("void(float64[::1], float64[::1], int64, float64[:, ::1], float64[::1])")
def _swing(constants: Float, bent: Float, here: int, ring: Float, state: Float) -> None:
    """How far the arm may swing about where it should stand: ``|p''| / w^2`` of its lowest mode, dying out.

    Where it should stand is path, correction in effect and expected deflection; a tracker sees the swing, which is no
    error of the model.

    Args:
        constants: Of the loop.
        bent: (18,) D of this cycle.
        here: Row of this cycle.
        ring: Of the last cycles; this one's place and swing are written.
        state: Of the step; changed.
    """
    now, one = ring[here], ring[(here - _SPAN + at.RING_ROWS) % at.RING_ROWS]
    two = ring[(here - 2 * _SPAN + at.RING_ROWS) % at.RING_ROWS]
    square = 0.0
    for k in range(3):
        stand = now[at.RING_NOMINAL + 9 + k] + now[at.RING_IN_FORCE + k]
        for d in range(3):
            stand += (state[at.S_FUSION + X + d] + state[at.S_FUSION + X + 3 + d]) * bent[6 * d + k]
        now[at.RING_STAND + k] = stand
        square += (stand - 2.0 * one[at.RING_STAND + k] + two[at.RING_STAND + k]) ** 2
    span = _SPAN * constants[at.C_PERIOD]
    fresh = math.sqrt(square) / (span * span) * constants[at.C_SWING]
    if two[at.RING_CLOCK] <= 0.0:
        fresh = 0.0
    state[at.S_SWING] = max(fresh, state[at.S_SWING] * constants[at.C_SWING + 1])
    now[at.RING_SWING] = state[at.S_SWING]


@kernel(
    "void(float64[::1], float64[::1], int64, boolean, int64, float64[:, ::1], float64[::1], int64[::1],"
    " float64[::1], float64[::1])"
)
def _take_sample(
    given: Float,
    constants: Float,
    first: int,
    active: bool,
    here: int,
    ring: Float,
    state: Float,
    whole: Int,
    results: Float,
    deviation: Float,
) -> None:
    fusion = state[at.S_FUSION : at.S_FUSION + FUSION_SIZE]
    past = state[at.S_PAST : at.S_PAST + at.RING]
    rest, bent = state[at.S_REST : at.S_REST + 6], state[at.S_PAST_BENT : at.S_PAST_BENT + 18]
    period, growth = constants[at.C_PERIOD], constants[at.C_FUSION : at.C_FUSION + 9]
    late = given[at.G_TRACKER_LATE] if given[at.G_TRACKER_LATE] >= 0.0 else constants[at.C_TRACKER_LATE]
    clock = state[at.S_CLOCK] - late / period
    # The correction belongs to the instant of the sample, path and force to what the robot follows then.
    if not row_at(ring, here, clock, past):
        return
    for k in range(6):
        rest[k] = -past[at.RING_IN_FORCE + k]
    behind = clock - constants[at.C_FOLLOW] / period
    known = min(behind + constants[at.C_REFERENCE_LATE] / period, state[at.S_CLOCK])
    if not row_at(ring, here, known, past):
        return
    for k in range(18):
        bent[k] = past[at.RING_BENT + k]
    if not row_at(ring, here, behind, past):
        return
    pose_deviation(
        given,
        at.G_ACTUAL,
        past[at.RING_NOMINAL : at.RING_NOMINAL + 12],
        past[at.RING_CONTAINED : at.RING_CONTAINED + 6],
        deviation,
    )
    frame = past[at.RING_FRAME : at.RING_FRAME + 9]
    for k in range(6):
        rest[k] += deviation[k]
    if first == 1:
        along = deviation[0] * frame[0] + deviation[1] * frame[1] + deviation[2] * frame[2]
        for k in range(3):
            deviation[k] -= along * frame[k]
    without = constants[at.C_WITHOUT]
    largest = constants[at.C_JUMP] if active else math.inf
    if not unexplained(fusion, rest, bent, frame, first, without) <= largest:
        whole[at.N_DISBELIEVED] += 1
        return
    whole[at.N_DISBELIEVED] = 0
    square = 0.0
    for k in range(18):
        square += bent[k] * bent[k] if k % 6 < 3 else 0.0
    spread = constants[at.C_NOISE] + given[at.G_TRACKER_SIGMA] ** 2
    spread += past[at.RING_SWING] ** 2
    spread += late / period * (growth[2] + (growth[0] + growth[1]) * square)
    noise_turn = constants[at.C_NOISE + 1] + late / period * growth[6]
    results[at.R_SURPRISE + 1] = take_deviation(
        fusion, rest, bent, frame, first, without, spread, noise_turn, growth[8]
    )


@kernel(
    "void(float64[::1], int64[::1], float64[::1], int64[::1], float64[::1], float64[::1], float64[::1],"
    " float64[::1], float64[::1], boolean, float64[:, ::1], float64[::1], int64[::1], float64[::1], float64[::1])"
)
def estimate_deviation(
    given: Float,
    flags: Int,
    constants: Float,
    choices: Int,
    elastic: Float,
    nominal: Float,
    contained: Float,
    predicted: Float,
    direction: Float,
    active: bool,
    ring: Float,
    state: Float,
    whole: Int,
    results: Float,
    deviation: Float,
) -> None:
    """Remember this cycle, and take a tracker sample with what was known at its own time.

    Args:
        given: Inputs of the cycle.
        flags: Likewise.
        constants: Of the loop.
        choices: Likewise.
        elastic: Output of the elastic step.
        nominal: (12,) commanded pose.
        contained: (6,) correction that the program contains here.
        predicted: (6,) force now.
        direction: (9,).
        active: The correction acts.
        ring: Of the last cycles; changed.
        state: Of the step; changed.
        whole: Likewise.
        results: What is estimated is written.
        deviation: (6,) written where there is a sample.
    """
    fusion = state[at.S_FUSION : at.S_FUSION + FUSION_SIZE]
    bent = fusion[BENT : BENT + 18]
    shares(predicted, direction, bent)
    bend(fusion, elastic, OUT_C, constants[at.C_R_BASE_PART : at.C_R_BASE_PART + 9])
    here = whole[at.N_RING]
    now = ring[here]
    for k in range(12):
        now[at.RING_NOMINAL + k] = nominal[k]
    for k in range(6):
        now[at.RING_CONTAINED + k] = contained[k]
        now[at.RING_IN_FORCE + k] = state[at.S_IN_FORCE + k]
    for k in range(9):
        now[at.RING_FRAME + k] = direction[k]
    for k in range(18):
        now[at.RING_BENT + k] = bent[k]
    now[at.RING_CLOCK] = state[at.S_CLOCK]
    _swing(constants, bent, here, ring, state)
    first = 1 if choices[at.W_NORMAL] == 1 else 0
    if flags[at.F_SOURCES] & _FROM_TRACKER and flags[at.F_TRACKER_NEW] == 1:
        _take_sample(given, constants, first, active, here, ring, state, whole, results, deviation)
    results[at.R_UNCERTAIN] = uncertainty(fusion, bent, direction, first)
    for k in range(3):
        results[at.R_FACTOR + k] = fusion[X + k]
        results[at.R_MODEL + k] = fusion[X + 3 + k]
        results[at.R_OFFSET + k] = fusion[X + 6 + k]
        results[at.R_OFFSET + 3 + k] = fusion[TURN + k]
