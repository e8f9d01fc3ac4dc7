"""The online step: one cycle from what robot, force sensor and tracker say to a correction within its limits. Pure.

Order, fixed: counters, place on the plan, force, deflection, tracker, correction wanted, causes, supervisor, limits,
finite check. Everything in the part frame, SI. The same inputs give the same outputs bit for bit.
"""

from __future__ import annotations

import math

from counterflex.core.arrays import Float, Int
from counterflex.core.jit import kernel
from counterflex.robot.elasticity.kernels.step import OUT_D, OUT_SIGMA, REFUSED, deflect
from counterflex.runtime.estimator.deflection import (
    answered,
    currents_shown,
    estimate_deviation,
    estimate_loads,
    missing_cause,
    of_a_sensor,
    sources_of,
)
from counterflex.runtime.estimator.force import blend, learn_scale, met_share, scaled
from counterflex.runtime.estimator.fusion import Source
from counterflex.runtime.primitives.frames import across, directions, pose_deviation, size_of, turn, turn_back
from counterflex.runtime.primitives.history import moves, row_at, stands
from counterflex.runtime.primitives.lag_filters import lag
from counterflex.runtime.primitives.localize import PLAN_W, contained_at, follow, seek, wrench_at
from counterflex.runtime.state import layout as at
from counterflex.runtime.state.supervisor import (
    AT_CAUSE,
    AT_CYCLES,
    AT_FEED_HOLD,
    AT_RISE,
    AT_STATE,
    AT_STOP,
    SET_RISE_CYCLES,
    SET_STOP_CYCLES,
    Cause,
    State,
    risen,
)
from counterflex.runtime.step.direction_gains import control
from counterflex.runtime.step.feed_forward import known_ahead
from counterflex.runtime.step.limit_and_supervise import (
    FAULT_LOST,
    KEPT,
    NOTHING,
    as_axes,
    ask_supervisor,
    cuts_here,
    in_force,
    limit,
    remember,
)
from counterflex.runtime.step.tracker import designed, designed_correction, observe, sum_up
from counterflex.signals.filters import smooth

MOST_ELAPSED = 4
"""Cycles that are made up for at most after telegrams were lost."""
_PROCESS = int(Source.FORCE | Source.CURRENTS)
_MEASURED, _PILOT, _SCALE, _FUSED = 1, 2, 3, 4
_INTEGRATOR, _OBSERVER, _DESIGNED = 1, 2, 3
_READY, _ARMED, _ACTIVE = int(State.READY), int(State.ARMED), int(State.ACTIVE)
_HOLD, _FAULT = int(State.HOLD), int(State.FAULT)
_LATE, _STOPPED, _FORCE_STALE = int(Cause.TELEGRAMS_LATE), int(Cause.TELEGRAMS_STOPPED), int(Cause.FORCE_STALE)
_TRACKER_LOST, _SOFT_LIMIT, _HARD_LIMIT = int(Cause.TRACKER_LOST), int(Cause.LIMIT_SOFT), int(Cause.LIMIT_HARD)
_SESSION = int(Cause.SESSION_RESTARTED)
_NOT_FINITE, _OFF_PATH, _SINGULAR = int(Cause.NOT_FINITE), int(Cause.OFF_PATH), int(Cause.SINGULAR)


@kernel(
    "void(float64[::1], int64[::1], float64[::1], int64[::1], int64[::1], float64[:, ::1], float64[:, ::1],"
    " int64[:, ::1], float64[::1], int64[::1], float64[:, ::1], float64[::1], float64[:, ::1], float64[:, ::1],"
    " int64[::1], float64[:, ::1], float64[:, ::1], int64[::1], float64[::1], float64[:, ::1], float64[:, ::1],"
    " float64[:, ::1], float64[::1], float64[::1], int64[::1], float64[:, ::1])"
)
def step(
    given: Float,
    flags: Int,
    constants: Float,
    choices: Int,
    supervisor_settings: Int,
    plan: Float,
    real: Float,
    kind: Int,
    state: Float,
    whole: Int,
    ring: Float,
    coefficients: Float,
    measured_memory: Float,
    measured_ring: Float,
    measured_place: Int,
    predicted_memory: Float,
    predicted_ring: Float,
    predicted_place: Int,
    elastic: Float,
    frame: Float,
    delta: Float,
    scratch: Float,
    load: Float,
    results: Float,
    outcome: Int,
    work: Float,
) -> None:
    """One cycle; see the module and :class:`counterflex.runtime.loop.Loop`, which owns the arrays.

    Args:
        given: (at.GIVEN,) of :mod:`counterflex.runtime.state.layout`.
        flags: (at.FLAGS,).
        constants: (at.CONSTANTS,).
        choices: (at.CHOICES,).
        supervisor_settings: (6,).
        plan: (n, PLAN_COLUMNS), or two rows that mean nothing without a plan.
        real: Compact chain.
        kind: Likewise.
        state: (at.STATE,); changed.
        whole: (at.WHOLE,); changed.
        ring: (at.RING_ROWS, at.RING) of the last cycles; changed.
        coefficients: (5,) of the force filters.
        measured_memory: (4, 6) of the filter of the measured wrench; changed, as all filter arrays.
        measured_ring: (n, 6).
        measured_place: (1,).
        predicted_memory: As for the measured one.
        predicted_ring: Likewise.
        predicted_place: Likewise.
        elastic: (OUT_SIZE,) output of the elastic step.
        frame: Its work arrays.
        delta: Likewise.
        scratch: Likewise.
        load: (12,) its input.
        results: (at.RESULTS,) written.
        outcome: (at.OUTCOME,) written.
        work: (11, 12) work space.
    """
    period = constants[at.C_PERIOD]
    elapsed = min(max(flags[at.F_ELAPSED], 0), MOST_ELAPSED)
    lost = flags[at.F_ELAPSED] - 1 if flags[at.F_ELAPSED] > 0 else whole[at.N_LATE] + 1
    whole[at.N_LATE] = 0 if flags[at.F_ELAPSED] > 0 else whole[at.N_LATE] + 1
    whole[at.N_CYCLES] += 1
    state[at.S_CLOCK] += flags[at.F_ELAPSED]
    soft, hard = flags[at.F_SOFT], flags[at.F_HARD]
    if lost >= FAULT_LOST and hard == 0:
        hard = _STOPPED
    elif lost >= choices[at.W_LOST] and soft == 0:
        soft = _LATE
    for k in range(at.G_REPORTED):
        unused = flags[at.F_TRACKER_NEW] == 0 and at.G_ACTUAL <= k < at.G_TORQUE
        if not (unused or math.isfinite(given[k])):
            hard = _NOT_FINITE if hard == 0 else hard
    force_mode, tracker_mode = choices[at.W_FORCE], choices[at.W_TRACKER]
    nominal = work[0]
    for k in range(12):
        nominal[k] = given[at.G_NOMINAL + k]
    measured, predicted, ahead, used = work[1], work[2], work[3], work[4]
    contained, direction, deviation, behind = work[5], work[6], work[7], work[8]
    for k in range(12):
        measured[k] = predicted[k] = ahead[k] = used[k] = contained[k] = deviation[k] = behind[k] = 0.0
    row = 0
    distance, cut = 0.0, 0.0
    planned = choices[at.W_PLAN] == 1 and hard != _NOT_FINITE
    if planned:
        if whole[AT_STATE] <= _READY and state[at.S_PLACE] >= 0.0:
            seek(plan, state[at.S_PLACE :], state[at.S_SWEEP :], nominal[9], nominal[10], nominal[11])
        distance = follow(plan, state[at.S_PLACE :], nominal[9], nominal[10], nominal[11], choices[at.W_WINDOW])
        row = int(state[at.S_PLACE])
        # The plan's time runs slower where less speed is asked for, and its forces are smaller.
        speed = state[at.S_SPEED]
        cut = wrench_at(plan, state[at.S_PLACE :], 0.0, PLAN_W, predicted[:6])
        lead = speed * (constants[at.C_LEAD] - constants[at.C_FOLLOW])
        wrench_at(plan, state[at.S_PLACE :], lead, choices[at.W_AHEAD], ahead[:6])
        wrench_at(plan, state[at.S_PLACE :], -speed * constants[at.C_FOLLOW], PLAN_W, behind[:6])
        soon = state[at.S_SOON : at.S_SOON + 6]
        wrench_at(plan, state[at.S_PLACE :], speed * constants[at.C_SOON], PLAN_W, soon)
        for k in range(6):
            soon[k] *= state[at.S_SLOWER]
            predicted[k] *= state[at.S_SLOWER]
            ahead[k] *= state[at.S_SLOWER]
            behind[k] *= state[at.S_SLOWER]
        contained_at(plan, state[at.S_PLACE :], contained[:6])
        if distance > constants[at.C_OFF_PATH] and soft == 0:
            soft = _OFF_PATH
    # Force.
    filtered = results[at.R_MEASURED : at.R_MEASURED + 6]
    if hard != _NOT_FINITE:
        believed = state[at.S_BELIEVED : at.S_BELIEVED + 6]
        smooth(believed, filtered, coefficients, measured_memory, measured_ring, measured_place)
        lag(behind, 0, constants, at.C_INERTIA, state, at.S_INERTIA, behind, 0)
        for k in range(6):
            state[at.S_LATE + k] = behind[k]
        smooth(behind[:6], measured[6:12], coefficients, predicted_memory, predicted_ring, predicted_place)
    late_prediction = measured[6:12]
    tells = not planned or moves(ring, whole[at.N_RING], nominal)
    force_good = flags[at.F_FORCE_AGE] < choices[at.W_STALE]
    if force_mode not in (0, _FUSED) and flags[at.F_FORCE_AGE] >= choices[at.W_BRIDGE] and soft == 0:
        soft = _FORCE_STALE
    sources = degraded = 0
    if force_mode == _FUSED:
        sources = sources_of(flags, choices, soft, whole[at.N_DISBELIEVED], 1 if planned else 0)
        degraded = missing_cause(flags[at.F_SOURCES], sources, soft)
        if sources == 0 and soft == 0:
            soft = degraded if degraded != 0 else _FORCE_STALE
        elif sources != 0 and of_a_sensor(soft) and not (soft == _TRACKER_LOST and choices[at.W_TRACKER_LOST] == 1):
            soft = 0
    directions(plan, row, nominal, direction)
    if force_mode == _MEASURED:
        for k in range(6):
            used[k] = filtered[k]
        if choices[at.W_COMPENSATED] == 1:
            for k in range(6):
                used[k] -= late_prediction[k]
    elif force_mode == _PILOT:
        threshold = constants[at.C_THRESHOLD] if force_good else 0.0  # without a force the plan is blended in
        soon = state[at.S_SOON : at.S_SOON + 6]
        share = blend(filtered, soon, state[at.S_SHARE], threshold, constants[at.C_BLEND])
        state[at.S_SHARE] = share
        forward = choices[at.W_AHEAD] != PLAN_W
        met = met_share(filtered, late_prediction) if forward else 0.0
        for k in range(6):
            trusted = filtered[k] + met * (ahead[k] - late_prediction[k])
            used[k] = (1.0 - share) * trusted + share * ahead[k]
            if choices[at.W_COMPENSATED] == 1:
                used[k] -= (1.0 - share) * (ahead[k] if forward else late_prediction[k]) + share * ahead[k]
    elif force_mode == _SCALE:
        if force_good and cut > 0.0 and tells:
            learn_scale(
                filtered,
                late_prediction,
                state[at.S_BEFORE : at.S_BEFORE + 6],
                direction[:9],
                constants[at.C_SCALE : at.C_SCALE + 4],
                state[at.S_SCALE : at.S_SCALE + 3],
                state[at.S_VARIANCE : at.S_VARIANCE + 3],
            )
        scaled(ahead[:6], direction[:9], state[at.S_SCALE : at.S_SCALE + 3], used[:6])
        if choices[at.W_COMPENSATED] == 1:
            for k in range(6):
                used[k] -= ahead[k]
    elif force_mode == _FUSED and hard != _NOT_FINITE:
        estimate_loads(
            given, sources if tells else sources & ~_PROCESS, tells and currents_shown(flags), constants, filtered,
            cut, predicted[:6], late_prediction, ahead[:6], direction[:9], scratch[1], state, results, used[:6],
        )  # fmt: skip
    for k in range(6):
        state[at.S_BEFORE + k] = late_prediction[k]
        results[at.R_WRENCH + k] = used[k]
        results[at.R_PREDICTED + k] = ahead[k]
    # Deflection under it, part axes.
    elastic_status = 0
    bent = results[at.R_DEFLECTION : at.R_DEFLECTION + 6]
    for k in range(6):
        load[k] = given[at.G_Q + k]
        load[6 + k] = used[k]
        bent[k] = 0.0
    if hard != _NOT_FINITE:
        turn(constants, at.C_R_BASE_PART, load, 6)
        turn(constants, at.C_R_BASE_PART, load, 9)
        elastic_status = deflect(real, kind, load, elastic, frame, delta, scratch, 0)
        for k in range(6):
            bent[k] = elastic[OUT_D + k]
        turn_back(constants, at.C_R_BASE_PART, bent, 0)
        turn_back(constants, at.C_R_BASE_PART, bent, 3)
    if elastic_status & REFUSED and soft == 0:
        soft = _SINGULAR
    if choices[at.W_NORMAL] == 1 and planned:
        across(bent, 0, plan, row)
    # Tracker.
    active = whole[AT_STATE] == _ACTIVE
    here = whole[at.N_RING]
    if force_mode == _FUSED:
        answered(ring, here, max(1, choices[at.W_CORRECTION_BACK]), constants, state)
    if force_mode == _FUSED and hard != _NOT_FINITE:
        estimate_deviation(
            given, flags, constants, choices, elastic, nominal, contained[:6], predicted[:6], direction[:9],
            active, ring, state, whole, results, deviation[:6],
        )  # fmt: skip
    forward_share = 1.0
    if tracker_mode == _DESIGNED and hard != _NOT_FINITE:
        for k in range(12):
            ring[here, at.RING_NOMINAL + k] = nominal[k]
        ring[here, at.RING_CLOCK] = state[at.S_CLOCK]
        for k in range(12):
            work[10, k] = 0.0
        forward_share = known_ahead(
            plan, ring, here, nominal, constants, choices, 1 if planned and soft == 0 else 0, state, work[9], work[10]
        )
        if flags[at.F_TRACKER_NEW] == 1:
            late = given[at.G_TRACKER_LATE] if given[at.G_TRACKER_LATE] >= 0.0 else constants[at.C_TRACKER_LATE]
            past = state[at.S_PAST : at.S_PAST + at.RING]
            if row_at(ring, here, state[at.S_CLOCK] - late / period, past):
                pose_deviation(given, at.G_ACTUAL, past[:12], contained[:6], deviation[:6])
                if choices[at.W_NORMAL] == 1 and planned:
                    across(deviation, 0, plan, row)
                agrees = size_of(deviation, 0) <= constants[at.C_JUMP] or not active
                if agrees:
                    designed(deviation[:6], active and forward_share == 1.0, constants, state)
                elif soft == 0:
                    soft = _TRACKER_LOST
    elif tracker_mode != 0 and flags[at.F_TRACKER_NEW] == 1 and hard != _NOT_FINITE:
        back = (here - choices[at.W_NOMINAL_BACK] + at.RING_ROWS) % at.RING_ROWS
        past = ring[back, at.RING_NOMINAL : at.RING_NOMINAL + 12]
        if choices[at.W_NOMINAL_BACK] == 0:
            past = nominal
        pose_deviation(given, at.G_ACTUAL, past, contained[:6], deviation[:6])
        if choices[at.W_NORMAL] == 1 and planned:
            across(deviation, 0, plan, row)
        if tracker_mode == _INTEGRATOR:
            if active:
                sum_up(deviation[:6], constants[at.C_GAIN], constants[at.C_SATURATION : at.C_SATURATION + 2], state)
        else:
            then = (here - choices[at.W_DEFLECTION_BACK] + at.RING_ROWS) % at.RING_ROWS
            agrees = observe(
                deviation,
                ring[then, at.RING_DEFLECTION : at.RING_DEFLECTION + 6],
                constants[at.C_NOISE : at.C_NOISE + 2],
                constants[at.C_JUMP] if active else math.inf,
                state,
            )
            if not agrees and soft == 0:
                soft = _TRACKER_LOST
    if tracker_mode == _OBSERVER:
        for part in range(2):
            state[at.S_OFFSET_VARIANCE + part] += constants[at.C_DRIFT + part]
    if tracker_mode != 0 and force_mode == 0 and flags[at.F_TRACKER_AGE] >= choices[at.W_STALE] and soft == 0:
        soft = _TRACKER_LOST
    for k in range(6):
        results[at.R_DEVIATION + k] = deviation[k]
    # Correction wanted.
    wanted = results[at.R_WANTED : at.R_WANTED + 6]
    control(
        bent,
        direction[:9],
        constants[at.C_KP : at.C_KP + 9],
        1 if active else 0,
        state[at.S_INTEGRAL : at.S_INTEGRAL + 3],
        state[at.S_LAST : at.S_LAST + 3],
        wanted,
    )
    if choices[at.W_ORIENTATION] == 0:
        wanted[3] = wanted[4] = wanted[5] = 0.0
    if force_mode == _FUSED:
        offset = load[:6]
        for k in range(6):
            offset[k] = results[at.R_OFFSET + k]
        if choices[at.W_NORMAL] == 1 and planned:
            across(offset, 0, plan, row)
        for k in range(6):
            wanted[k] -= offset[k] if k < 3 or choices[at.W_ORIENTATION] == 1 else 0.0
    if tracker_mode == _INTEGRATOR:
        for k in range(6):
            wanted[k] += state[at.S_SUM + k] if k < 3 or choices[at.W_ORIENTATION] == 1 else 0.0
    elif tracker_mode == _DESIGNED:
        offset = load[:6]
        for k in range(6):
            offset[k] = 0.0
        designed_correction(constants, state, offset)
        for k in range(6):
            wanted[k] += offset[k] if k < 3 or choices[at.W_ORIENTATION] == 1 else 0.0
    elif tracker_mode == _OBSERVER:
        for k in range(6):
            wanted[k] -= state[at.S_OFFSET + k] if k < 3 or choices[at.W_ORIENTATION] == 1 else 0.0
    for k in range(6):
        if not math.isfinite(wanted[k]) and hard == 0:
            hard = _NOT_FINITE
    share = risen(whole[AT_RISE], supervisor_settings[SET_RISE_CYCLES])
    reach = max(size_of(wanted, 0) / constants[at.C_TRANSLATION], size_of(wanted, 3) / constants[at.C_ROTATION])
    if reach > constants[at.C_HARD] and hard == 0 and (active or whole[AT_STATE] == _HOLD):
        hard = _HARD_LIMIT
    elif reach > 1.0 and soft == 0 and (active or whole[AT_STATE] == _HOLD):
        soft = _SOFT_LIMIT
    # Who may act, and how far.
    held = whole[AT_STATE] == _HOLD
    standing = 1 if stands(ring, here, nominal) else 0
    session = KEPT
    if flags[at.F_HARD] == _SESSION:
        session = in_force(given, flags, ring, here, state) if whole[AT_STATE] > _ARMED else NOTHING
    near = planned and distance <= constants[at.C_OFF_PATH]
    cuts = cuts_here(planned, near, cut, size_of(filtered, 0) if force_mode != 0 else 0.0, whole[AT_STATE])
    now = ask_supervisor(flags, soft, hard, standing, cuts, period, session, supervisor_settings, state, whole, outcome)
    limits = limit(now, 1 if held else 0, share, wanted, elapsed, constants, state, results)
    remember(here, hard, nominal, bent, choices, constants, state, whole, ring)
    # Where axis angles cannot be computed they stay as they were: a fault holds, also in the axes.
    for k in range(6):
        results[at.R_AXES + k] = state[at.S_AXES + k]
    if hard != _NOT_FINITE and not elastic_status & REFUSED:
        elastic_status |= as_axes(elastic_status, constants, state, scratch, load, results)
    results[at.R_PATH], results[at.R_SIGMA], results[at.R_CUT] = distance, elastic[OUT_SIGMA], cut
    outcome[at.O_SOURCES], outcome[at.O_DEGRADED] = sources, degraded
    outcome[at.O_STATE], outcome[at.O_CAUSE] = now, whole[AT_CAUSE]
    if now <= _READY and soft != 0 and whole[AT_FEED_HOLD] == 0:
        outcome[at.O_CAUSE] = soft  # why it cannot be armed now, not what once was
    outcome[at.O_FEED_HOLD] = whole[AT_FEED_HOLD]
    silent = whole[AT_CYCLES] >= supervisor_settings[SET_STOP_CYCLES] or whole[at.N_SESSION] == 1
    outcome[at.O_STOP] = 1 if (now == _FAULT and not silent) or whole[AT_STOP] > 0 else 0
    outcome[at.O_SILENT] = 1 if now == _FAULT and silent else 0
    outcome[at.O_LIMITS], outcome[at.O_ELASTIC], outcome[at.O_SOFT], outcome[at.O_HARD] = (
        limits,
        elastic_status,
        soft,
        hard,
    )
