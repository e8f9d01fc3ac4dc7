"""The online step: one cycle from what robot, force sensor and tracker say to a correction within its limits. Pure.

Order, fixed: counters, place on the plan, force, deflection, tracker, correction wanted, causes, supervisor, limits,
finite check. Everything in the part frame, SI. The same inputs give the same outputs bit for bit.
"""

from __future__ import annotations

import math

from counterflex.core.arrays import Float, Int
from counterflex.core.jit import kernel
from counterflex.robot.kernels_step import (
    OUT_D,
    OUT_SIGMA,
    REFUSED,
    cholesky_inverse,
    newton_step,
)
from counterflex.robot.kernels_step import step as elastic_step
from counterflex.runtime.follow_kernel import PLAN_V, contained_at, follow, wrench_at
from counterflex.runtime.force_kernel import blend, learn_scale, scaled
from counterflex.runtime.layout import (
    C_ANSWER,
    C_BLEND,
    C_DRIFT,
    C_GAIN,
    C_HARD,
    C_JUMP,
    C_KD,
    C_KI,
    C_KP,
    C_LEAD,
    C_NOISE,
    C_OFF_PATH,
    C_PERIOD,
    C_R_BASE_PART,
    C_RAMP,
    C_RAMP_ROTATION,
    C_ROTATION,
    C_SATURATION,
    C_SCALE,
    C_THRESHOLD,
    C_TRANSLATION,
    F_ARM,
    F_ELAPSED,
    F_ENABLE,
    F_FORCE_AGE,
    F_HARD,
    F_HEALTHY,
    F_RESET,
    F_SOFT,
    F_STOP,
    F_TRACKER_AGE,
    F_TRACKER_NEW,
    G_ACTUAL,
    G_NOMINAL,
    G_Q,
    G_W,
    GIVEN,
    N_CYCLES,
    N_INPUTS,
    N_LATE,
    N_RING,
    O_CAUSE,
    O_ELASTIC,
    O_FEED_HOLD,
    O_HARD,
    O_LIMITS,
    O_SILENT,
    O_SOFT,
    O_STATE,
    O_STOP,
    R_AXES,
    R_CORRECTION,
    R_CUT,
    R_DEFLECTION,
    R_DEVIATION,
    R_MEASURED,
    R_PATH,
    R_PREDICTED,
    R_SIGMA,
    R_WANTED,
    R_WRENCH,
    RING_DEFLECTION,
    RING_NOMINAL,
    RING_ROWS,
    RING_SENT,
    S_ANSWER,
    S_BEFORE,
    S_HELD,
    S_IN_FORCE,
    S_INTEGRAL,
    S_LAST,
    S_OFFSET,
    S_OFFSET_VARIANCE,
    S_PLACE,
    S_SCALE,
    S_SHARE,
    S_SUM,
    S_V,
    S_VARIANCE,
    S_Y,
    W_COMPENSATED,
    W_CORRECTION_BACK,
    W_DEFLECTION_BACK,
    W_FORCE,
    W_LOST,
    W_NOMINAL_BACK,
    W_NORMAL,
    W_ORIENTATION,
    W_PLAN,
    W_STALE,
    W_TRACKER,
    W_WINDOW,
)
from counterflex.runtime.supervisor import (
    AT_CYCLES,
    AT_RISE,
    AT_STATE,
    IN_ARM,
    IN_AT_ZERO,
    IN_ENABLE,
    IN_HARD,
    IN_HEALTHY,
    IN_NEAR,
    IN_RESET,
    IN_SOFT,
    IN_STOP,
    IN_TELEGRAM,
    SET_RISE_CYCLES,
    SET_STOP_CYCLES,
    Cause,
    State,
    risen,
    supervise,
)
from counterflex.signals.filters import smooth
from counterflex.signals.limiter import limited_step

MOST_ELAPSED = 4
"""Cycles that are made up for at most after telegrams were lost."""
_NEAR_M = 0.05e-3
_AT_ZERO_M = 1e-7
_AT_ZERO_RAD = 1e-7
_FAULT_LOST = 10
_MEASURED, _PILOT, _SCALE = 1, 2, 3
_INTEGRATOR, _OBSERVER = 1, 2
_ACTIVE, _HOLD, _RAMP_OUT, _FAULT = int(State.ACTIVE), int(State.HOLD), int(State.RAMP_OUT), int(State.FAULT)
_LATE, _STOPPED, _FORCE_STALE = int(Cause.TELEGRAMS_LATE), int(Cause.TELEGRAMS_STOPPED), int(Cause.FORCE_STALE)
_TRACKER_LOST, _SOFT_LIMIT, _HARD_LIMIT = int(Cause.TRACKER_LOST), int(Cause.LIMIT_SOFT), int(Cause.LIMIT_HARD)
_NOT_FINITE, _OFF_PATH, _SINGULAR = int(Cause.NOT_FINITE), int(Cause.OFF_PATH), int(Cause.SINGULAR)


@kernel("void(float64[::1], int64, float64[::1], int64)")
def _turn_back(R: Float, at: int, x: Float, begin: int) -> None:
    """``x[begin:begin+3] = R^T x`` with R (9,) from ``at`` on, in place."""
    a, b, c = x[begin], x[begin + 1], x[begin + 2]
    for k in range(3):
        x[begin + k] = R[at + k] * a + R[at + 3 + k] * b + R[at + 6 + k] * c


@kernel("void(float64[::1], int64, float64[::1], int64)")
def _turn(R: Float, at: int, x: Float, begin: int) -> None:
    """``x[begin:begin+3] = R x``, in place."""
    a, b, c = x[begin], x[begin + 1], x[begin + 2]
    for k in range(3):
        x[begin + k] = R[at + 3 * k] * a + R[at + 3 * k + 1] * b + R[at + 3 * k + 2] * c


@kernel("void(float64[::1], int64, float64[::1], float64[::1], float64[::1])")
def pose_deviation(actual: Float, at: int, nominal: Float, contained: Float, out: Float) -> None:
    """Deviation of a pose from a commanded one whose program contains a correction already.

    Translation difference, and the logarithm of the relative rotation (small: ``(R - R^T) / 2`` with its scale).

    Args:
        actual: Array that holds the pose (12) from ``at`` on.
        at: See above.
        nominal: (12,) commanded pose.
        contained: (6,) correction it contains.
        out: (6,) written, m and rad, part axes.
    """
    for k in range(3):
        out[k] = actual[at + 9 + k] - (nominal[9 + k] - contained[k])
    m01 = m02 = m12 = m10 = m20 = m21 = trace = 0.0
    for j in range(3):
        a0, a1, a2 = actual[at + j], actual[at + 3 + j], actual[at + 6 + j]
        n0, n1, n2 = nominal[j], nominal[3 + j], nominal[6 + j]
        m01 += a0 * n1
        m02 += a0 * n2
        m12 += a1 * n2
        m10 += a1 * n0
        m20 += a2 * n0
        m21 += a2 * n1
        trace += a0 * n0 + a1 * n1 + a2 * n2
    x, y, z = 0.5 * (m21 - m12), 0.5 * (m02 - m20), 0.5 * (m10 - m01)
    s = math.sqrt(x * x + y * y + z * z)
    scale = math.atan2(s, 0.5 * (trace - 1.0)) / s if s > 1e-12 else 1.0
    out[3], out[4], out[5] = scale * x + contained[3], scale * y + contained[4], scale * z + contained[5]


@kernel("void(float64[::1], int64, float64[:, ::1], int64)")
def _across(x: Float, begin: int, plan: Float, row: int) -> None:
    """Take the component along the feed out of ``x[begin:begin+3]`` (Haehn2020 eq. 10-11)."""
    a, b, c = plan[row, PLAN_V], plan[row, PLAN_V + 1], plan[row, PLAN_V + 2]
    along = x[begin] * a + x[begin + 1] * b + x[begin + 2] * c
    x[begin] -= along * a
    x[begin + 1] -= along * b
    x[begin + 2] -= along * c


@kernel("void(float64[:, ::1], int64, float64[::1], float64[::1])")
def _directions(plan: Float, row: int, nominal: Float, frame: Float) -> None:
    """Unit vectors (9,): feed, tool axis cross feed, tool axis; part axes themselves where nothing moves."""
    vx, vy, vz = plan[row, PLAN_V], plan[row, PLAN_V + 1], plan[row, PLAN_V + 2]
    ax, ay, az = nominal[2], nominal[5], nominal[8]
    nx, ny, nz = ay * vz - az * vy, az * vx - ax * vz, ax * vy - ay * vx
    size = math.sqrt(nx * nx + ny * ny + nz * nz)
    for k in range(9):
        frame[k] = 1.0 if k % 4 == 0 else 0.0
    if size < 1e-3:
        return
    nx, ny, nz = nx / size, ny / size, nz / size
    frame[0], frame[1], frame[2] = ny * az - nz * ay, nz * ax - nx * az, nx * ay - ny * ax
    frame[3], frame[4], frame[5] = nx, ny, nz
    frame[6], frame[7], frame[8] = ax, ay, az


@kernel("float64(float64[::1], int64)")
def _size(x: Float, at: int) -> float:
    return math.sqrt(x[at] * x[at] + x[at + 1] * x[at + 1] + x[at + 2] * x[at + 2])


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
        given: (GIVEN,) of :mod:`counterflex.runtime.layout`.
        flags: (FLAGS,).
        constants: (CONSTANTS,).
        choices: (CHOICES,).
        supervisor_settings: (4,).
        plan: (n, 20), or two rows that mean nothing without a plan.
        real: Compact chain.
        kind: Likewise.
        state: (STATE,); changed.
        whole: (WHOLE,); changed.
        ring: (RING_ROWS, RING) of the last cycles; changed.
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
        results: (RESULTS,) written.
        outcome: (OUTCOME,) written.
        work: (8, 12) work space.
    """
    period = constants[C_PERIOD]
    elapsed = min(max(flags[F_ELAPSED], 0), MOST_ELAPSED)
    lost = flags[F_ELAPSED] - 1 if flags[F_ELAPSED] > 0 else whole[N_LATE] + 1
    whole[N_LATE] = 0 if flags[F_ELAPSED] > 0 else whole[N_LATE] + 1
    whole[N_CYCLES] += 1
    soft, hard = flags[F_SOFT], flags[F_HARD]
    if lost >= _FAULT_LOST and hard == 0:
        hard = _STOPPED
    elif lost >= choices[W_LOST] and soft == 0:
        soft = _LATE
    for k in range(G_ACTUAL if flags[F_TRACKER_NEW] == 0 else GIVEN):
        if not math.isfinite(given[k]):
            hard = _NOT_FINITE if hard == 0 else hard
    force_mode, tracker_mode = choices[W_FORCE], choices[W_TRACKER]
    nominal = work[0]
    for k in range(12):
        nominal[k] = given[G_NOMINAL + k]
    measured, predicted, ahead, used = work[1], work[2], work[3], work[4]
    contained, direction, deviation = work[5], work[6], work[7]
    for k in range(12):
        measured[k] = predicted[k] = ahead[k] = used[k] = contained[k] = deviation[k] = 0.0
    row = 0
    distance, cut = 0.0, 0.0
    planned = choices[W_PLAN] == 1 and hard != _NOT_FINITE
    if planned:
        distance = follow(plan, state[S_PLACE:], nominal[9], nominal[10], nominal[11], choices[W_WINDOW])
        row = int(state[S_PLACE])
        cut = wrench_at(plan, state[S_PLACE:], 0.0, predicted[:6])
        wrench_at(plan, state[S_PLACE:], constants[C_LEAD], ahead[:6])
        contained_at(plan, state[S_PLACE:], contained[:6])
        if distance > constants[C_OFF_PATH] and soft == 0:
            soft = _OFF_PATH
    # Force.
    filtered = results[R_MEASURED : R_MEASURED + 6]
    if hard != _NOT_FINITE:
        smooth(given[G_W : G_W + 6], filtered, coefficients, measured_memory, measured_ring, measured_place)
        smooth(predicted[:6], measured[6:12], coefficients, predicted_memory, predicted_ring, predicted_place)
    late_prediction = measured[6:12]
    force_good = flags[F_FORCE_AGE] < choices[W_STALE]
    if force_mode != 0 and not force_good and soft == 0:
        soft = _FORCE_STALE
    _directions(plan, row, nominal, direction)
    if force_mode == _MEASURED:
        for k in range(6):
            used[k] = filtered[k]
        if choices[W_COMPENSATED] == 1:
            for k in range(6):
                used[k] -= late_prediction[k]
    elif force_mode == _PILOT:
        state[S_SHARE] = blend(
            filtered, ahead[:6], state[S_SHARE], constants[C_THRESHOLD], constants[C_BLEND], used[:6]
        )
        if choices[W_COMPENSATED] == 1:
            share = state[S_SHARE]
            for k in range(6):
                used[k] -= (1.0 - share) * late_prediction[k] + share * ahead[k]
    elif force_mode == _SCALE:
        if force_good and cut > 0.0:
            learn_scale(
                filtered,
                late_prediction,
                state[S_BEFORE : S_BEFORE + 6],
                direction[:9],
                constants[C_SCALE : C_SCALE + 4],
                state[S_SCALE : S_SCALE + 3],
                state[S_VARIANCE : S_VARIANCE + 3],
            )
        scaled(ahead[:6], direction[:9], state[S_SCALE : S_SCALE + 3], used[:6])
        if choices[W_COMPENSATED] == 1:
            for k in range(6):
                used[k] -= ahead[k]
    for k in range(6):
        state[S_BEFORE + k] = late_prediction[k]
        results[R_WRENCH + k] = used[k]
        results[R_PREDICTED + k] = ahead[k]
    # Deflection under it, part axes.
    elastic_status = 0
    bent = results[R_DEFLECTION : R_DEFLECTION + 6]
    for k in range(6):
        load[k] = given[G_Q + k]
        load[6 + k] = used[k]
        bent[k] = 0.0
    if hard != _NOT_FINITE:
        _turn(constants, C_R_BASE_PART, load, 6)
        _turn(constants, C_R_BASE_PART, load, 9)
        elastic_status = elastic_step(real, kind, load, elastic, frame, delta, scratch, 0)
        for k in range(6):
            bent[k] = elastic[OUT_D + k]
        _turn_back(constants, C_R_BASE_PART, bent, 0)
        _turn_back(constants, C_R_BASE_PART, bent, 3)
    if elastic_status & REFUSED and soft == 0:
        soft = _SINGULAR
    if choices[W_NORMAL] == 1 and planned:
        _across(bent, 0, plan, row)
    # Tracker.
    active = whole[AT_STATE] == _ACTIVE
    at = whole[N_RING]
    if tracker_mode != 0 and flags[F_TRACKER_NEW] == 1 and hard != _NOT_FINITE:
        back = (at - choices[W_NOMINAL_BACK] + RING_ROWS) % RING_ROWS
        past = ring[back, RING_NOMINAL : RING_NOMINAL + 12]
        if choices[W_NOMINAL_BACK] == 0:
            past = nominal
        pose_deviation(given, G_ACTUAL, past, contained[:6], deviation[:6])
        if choices[W_NORMAL] == 1 and planned:
            _across(deviation, 0, plan, row)
        if tracker_mode == _INTEGRATOR:
            if active:
                for k in range(6):
                    largest = constants[C_SATURATION + (0 if k < 3 else 1)]
                    state[S_SUM + k] -= min(largest, max(-largest, constants[C_GAIN] * deviation[k]))
        else:
            bent_then = ring[(at - choices[W_DEFLECTION_BACK] + RING_ROWS) % RING_ROWS]
            gap = 0.0
            for k in range(6):
                expected = state[S_IN_FORCE + k] + bent_then[RING_DEFLECTION + k] + state[S_OFFSET + k]
                deviation[6 + k] = deviation[k] - expected
                gap += deviation[6 + k] ** 2 if k < 3 else 0.0
            believed = math.sqrt(gap) <= constants[C_JUMP] or not active
            for part in range(2):
                variance = state[S_OFFSET_VARIANCE + part]
                gain = variance / (variance + constants[C_NOISE + part])
                if believed:
                    state[S_OFFSET_VARIANCE + part] = variance * (1.0 - gain)
                    for k in range(3 * part, 3 * part + 3):
                        state[S_OFFSET + k] += gain * deviation[6 + k]
            if not believed and soft == 0:
                soft = _TRACKER_LOST
    if tracker_mode == _OBSERVER:
        for part in range(2):
            state[S_OFFSET_VARIANCE + part] += constants[C_DRIFT + part]
    if tracker_mode != 0 and force_mode == 0 and flags[F_TRACKER_AGE] >= choices[W_STALE] and soft == 0:
        soft = _TRACKER_LOST
    for k in range(6):
        results[R_DEVIATION + k] = deviation[k]
    # Correction wanted.
    wanted = results[R_WANTED : R_WANTED + 6]
    for k in range(3):
        if active:
            state[S_INTEGRAL + k] += constants[C_KI] * bent[k]
        change = bent[k] - state[S_LAST + k]
        state[S_LAST + k] = bent[k]
        wanted[k] = -(constants[C_KP] * bent[k] + state[S_INTEGRAL + k] + constants[C_KD] * change)
        wanted[3 + k] = -constants[C_KP] * bent[3 + k] if choices[W_ORIENTATION] == 1 else 0.0
    if tracker_mode == _INTEGRATOR:
        for k in range(6):
            wanted[k] += state[S_SUM + k] if k < 3 or choices[W_ORIENTATION] == 1 else 0.0
    elif tracker_mode == _OBSERVER:
        for k in range(6):
            wanted[k] -= state[S_OFFSET + k] if k < 3 or choices[W_ORIENTATION] == 1 else 0.0
    for k in range(6):
        if not math.isfinite(wanted[k]) and hard == 0:
            hard = _NOT_FINITE
    share = risen(whole[AT_RISE], supervisor_settings[SET_RISE_CYCLES])
    if active:
        reach = max(_size(wanted, 0) / constants[C_TRANSLATION], _size(wanted, 3) / constants[C_ROTATION])
        if reach > constants[C_HARD] and hard == 0:
            hard = _HARD_LIMIT
        elif reach > 1.0 and soft == 0:
            soft = _SOFT_LIMIT
    # Who may act.
    away = 0.0
    for k in range(3):
        away += (wanted[k] - state[S_Y + k]) ** 2
    inputs = whole[N_INPUTS:]
    inputs[IN_TELEGRAM] = 1 if flags[F_ELAPSED] > 0 else 0
    inputs[IN_HEALTHY], inputs[IN_ARM], inputs[IN_ENABLE] = flags[F_HEALTHY], flags[F_ARM], flags[F_ENABLE]
    inputs[IN_STOP], inputs[IN_RESET], inputs[IN_SOFT], inputs[IN_HARD] = flags[F_STOP], flags[F_RESET], soft, hard
    still = _size(state, S_V) * period < _AT_ZERO_M and _size(state, S_V + 3) * period < _AT_ZERO_RAD
    at_zero = _size(state, S_Y) < _AT_ZERO_M and _size(state, S_Y + 3) < _AT_ZERO_RAD and still
    inputs[IN_AT_ZERO] = 1 if at_zero else 0
    inputs[IN_NEAR] = 1 if away < _NEAR_M * _NEAR_M else 0
    supervise(whole[:5], inputs, supervisor_settings)
    now = whole[AT_STATE]
    # Limits.
    limits = 0
    target = state[S_HELD : S_HELD + 6]
    for k in range(6):
        if now == _ACTIVE:
            target[k] = share * wanted[k]
        elif now in (_HOLD, _FAULT):
            target[k] = math.nan
        else:
            target[k] = 0.0
    # From rest at zero there is nowhere to ramp to: no state but ACTIVE moves the output away from zero.
    for _ in range(max(1, elapsed)):
        if now == _RAMP_OUT:
            limits |= limited_step(
                state[S_Y : S_Y + 3], state[S_V : S_V + 3], target[:3], constants[C_RAMP : C_RAMP + 3], period
            )
            limits |= (
                limited_step(
                    state[S_Y + 3 : S_Y + 6],
                    state[S_V + 3 : S_V + 6],
                    target[3:6],
                    constants[C_RAMP_ROTATION : C_RAMP_ROTATION + 3],
                    period,
                )
                << 4
            )
        else:
            limits |= limited_step(
                state[S_Y : S_Y + 3],
                state[S_V : S_V + 3],
                target[:3],
                constants[C_TRANSLATION : C_TRANSLATION + 3],
                period,
            )
            limits |= (
                limited_step(
                    state[S_Y + 3 : S_Y + 6],
                    state[S_V + 3 : S_V + 6],
                    target[3:6],
                    constants[C_ROTATION : C_ROTATION + 3],
                    period,
                )
                << 4
            )
    for k in range(6):
        if math.isnan(target[k]):
            target[k] = state[S_Y + k]
        results[R_CORRECTION + k] = state[S_Y + k]
    # What the robot makes of it, for the observer.
    for k in range(12):
        ring[at, RING_NOMINAL + k] = nominal[k]
    for k in range(6):
        ring[at, RING_SENT + k] = state[S_Y + k]
        ring[at, RING_DEFLECTION + k] = bent[k] if k < 3 or choices[W_ORIENTATION] == 1 else 0.0
    sent = ring[(at - choices[W_CORRECTION_BACK] + RING_ROWS) % RING_ROWS]
    for k in range(6):
        memory = S_ANSWER + 4 * k
        x = sent[RING_SENT + k]
        y = (
            constants[C_ANSWER] * x
            + constants[C_ANSWER + 1] * state[memory]
            + constants[C_ANSWER + 2] * state[memory + 1]
            - constants[C_ANSWER + 3] * state[memory + 2]
            - constants[C_ANSWER + 4] * state[memory + 3]
        )
        state[memory + 1], state[memory] = state[memory], x
        state[memory + 3], state[memory + 2] = state[memory + 2], y
        state[S_IN_FORCE + k] = y
    whole[N_RING] = (at + 1) % RING_ROWS
    # The same as axis angles: the damped step of the rigid Jacobian that the elastic step left behind.
    for k in range(6):
        results[R_AXES + k] = 0.0
    if hard != _NOT_FINITE and not elastic_status & REFUSED:
        error = load
        for k in range(6):
            error[k] = -state[S_Y + k]
        _turn(constants, C_R_BASE_PART, error, 0)
        _turn(constants, C_R_BASE_PART, error, 3)
        cholesky_inverse(scratch[1], 0.0, scratch[2], scratch[3])
        newton_step(scratch[1], scratch[3], error, scratch[5], results[R_AXES : R_AXES + 6])
    results[R_PATH], results[R_SIGMA], results[R_CUT] = distance, elastic[OUT_SIGMA], cut
    outcome[O_STATE], outcome[O_CAUSE] = now, whole[1]
    outcome[O_FEED_HOLD] = 1 if now in (_HOLD, _FAULT) else 0
    outcome[O_STOP] = 1 if now == _FAULT and whole[AT_CYCLES] < supervisor_settings[SET_STOP_CYCLES] else 0
    outcome[O_SILENT] = 1 if now == _FAULT and whole[AT_CYCLES] >= supervisor_settings[SET_STOP_CYCLES] else 0
    outcome[O_LIMITS], outcome[O_ELASTIC], outcome[O_SOFT], outcome[O_HARD] = limits, elastic_status, soft, hard
