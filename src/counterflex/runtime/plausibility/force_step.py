"""A force that steps in the cut where neither plan nor speed does: first not followed, then judged. Pure kernels.

A sensor whose zero jumps in the cut shows a force that goes on changing as planned, with something added. Judged is
the residual ``r = measured - planned`` before the force filters, against ``r0``, its mean over one period of the
arm's lowest mode before. The arm swings about when a load comes or goes; over a whole period a swing has next to no
mean. So there are two stages:

1. *suspected*: the mean of a few samples departs from r0 by more than a bound. At once the loop goes on with
   ``planned + r0`` in place of the measured force, before its filters: what was on its way is all that is followed.
2. a period later the mean over it says whether the force has *swung back* (it is used again, without a word) or
   *stands off*: that is told, with what was set to follow.

A wrong factor of the planned force changes r too, but only where the planned force changes or the program's speed does:
both widen the bounds, and fade as the arm's swing does. A force that has gone to about nothing is a missing cut or a
broken tool and not taken for an offset: it is followed, and so is the load that comes late after it, until it has
settled. A force that agrees with the planned one is none either. Motor currents, where there are any, say whether it
is the process: a real change of the force changes the torque of the axes by ``J^T dw``, one of the sensor's zero does
not.

A force that moves off more slowly is found by its means over a period now and some periods ago while plan and speed
stay the same. What comes while the arm swings, or over seconds, is found in the next calm cut
(:mod:`counterflex.runtime.plausibility.calm_cuts`).
"""

from __future__ import annotations

import math
from typing import Final

from counterflex.core.arrays import Float, Int
from counterflex.core.jit import kernel
from counterflex.runtime.plausibility.calm_cuts import forget_calm, known_in_air, off_in_calm
from counterflex.runtime.plausibility.force_change import (
    STANDS_M,
    TORQUE,
    apart,
    by_currents,
    mean_rows,
    missing,
    size,
    zero_is_right,
)
from counterflex.runtime.plausibility.kernel import (
    K_CALM,
    K_CALM_LONG,
    K_CALM_OFF,
    K_STEP,
    K_STEP_BACK,
    K_STEP_EVEN,
    K_STEP_FILLED,
    K_STEP_PLACE,
    K_STEP_SINCE,
    L_STEP_FADE,
    L_STEP_MEMORY,
    L_STEP_N,
    L_STEP_PLAN,
    M_STEP_BEFORE,
    M_STEP_CHANGE,
    M_STEP_NOISE,
    M_STEP_PLAN,
    M_STEP_SIZE,
    M_STEP_SWING,
    M_STEP_WORK,
    M_STEPS,
    STEP_MOST,
    STEP_ROW,
    T_STEP_BACK,
    T_STEP_FEW,
    T_STEP_LONG,
    T_STEP_PERIOD,
)
from counterflex.runtime.primitives.frames import directions
from counterflex.runtime.state import layout as at
from counterflex.runtime.state.supervisor import AT_STATE, Cause, State

SUSPECTED: Final = 1
TOLD: Final = 2
_ENTERING: Final = 3
"""A load is missing, or coming after it was: nothing is judged until it has settled."""
_ARMED, _HOLD = int(State.ARMED), int(State.HOLD)
_OFFSET = int(Cause.FORCE_OFFSET)
_STALE, _INVALID, _SATURATED = int(Cause.FORCE_STALE), int(Cause.FORCE_INVALID), int(Cause.FORCE_SATURATED)
_TELL, _PLAN, _HOLDS, _FUSED = 0, 1, 2, 4
_FROM_CURRENTS = 8
_PLANNED, _WAY, _CHANGE, _RANG = 6, 9, 16, 17  # in a row, behind the residual
_SPAN: Final = 4
"""Cycles over which the commanded speed is taken."""
_STEADY: Final = 0.2
"""Share by which the speed may change for residuals to be compared over a longer time."""
_SIGMAS: Final = 4.0
_SOONER: Final = 0.75
"""Share of the smallest step told at which a force is suspected."""
_INERTIA: Final = 0.4
"""Share of the largest force of inertia: of its peak, which is three times the root mean square."""
_AGAIN: Final = 0.7
"""Share of a change of the residual with which it may come again while it rings down."""
_NOISE_KEEP: Final = 0.98
_EVEN: Final = 0.5
"""Share of the largest step by which the planned force may change for the same."""
_AGREES: Final = 0.5
"""Share of the smallest step within which the measured force is the planned one."""
_NOTHING_N: Final = 1.0


@kernel("Tuple((float64, float64))(float64[:, ::1], int64, float64[::1], float64)")
def _commanded_motion(ring: Float, here: int, nominal: Float, period: float) -> tuple[float, float]:
    """Way of the commanded point in the last cycles, m, and its acceleration over twice as many, m/s2."""
    one = ring[(here - _SPAN + at.RING_ROWS) % at.RING_ROWS]
    two = ring[(here - 2 * _SPAN + at.RING_ROWS) % at.RING_ROWS]
    square = second = 0.0
    for k in range(3):
        p, q, r = nominal[9 + k], one[at.RING_NOMINAL + 9 + k], two[at.RING_NOMINAL + 9 + k]
        square += (p - q) ** 2
        second += (p - 2.0 * q + r) ** 2
    return math.sqrt(square), math.sqrt(second) / (_SPAN * period) ** 2


@kernel("void(int64[::1])")
def forget_step(counts: Int) -> None:
    """Nothing is held against the force any more, and that it comes back is no step."""
    if counts[K_STEP] != 0:
        counts[K_STEP_FILLED] = counts[K_STEP_EVEN] = 0
    counts[K_STEP] = counts[K_STEP_SINCE] = counts[K_STEP_BACK] = 0


@kernel("float64(float64[::1], float64[::1])")
def _uneven(now: Float, before: Float) -> float:
    """Share by which the speed has changed; 1 where the program stands."""
    most = max(now[_WAY], before[_WAY])
    return 1.0 - min(now[_WAY], before[_WAY]) / most if most > STANDS_M else 1.0


@kernel("void(float64[::1], float64, float64, float64[::1], float64[::1], int64[::1], float64[::1], int64[::1])")
def _take(
    given: Float, way: float, swing_n: float, state: Float, limits: Float, times: Int, memory: Float, counts: Int
) -> None:
    """Keep a sample, and what swings on of what plan, program and force did before.

    Args:
        given: Inputs of the cycle.
        way: Of the commanded point in a few cycles, m: its speed.
        swing_n: Force of what hangs behind the sensor, as the program accelerates it now and it may swing on.
        state: Of the step, with the planned force of the last cycle.
        limits: (LIMITS,).
        times: (TIMES,).
        memory: (REMEMBERED,); changed.
        counts: (COUNTS,); changed.
    """
    place, few = counts[K_STEP_PLACE], times[T_STEP_FEW]
    begin = M_STEPS + STEP_ROW * place
    row = memory[begin : begin + STEP_ROW]
    last = M_STEPS + STEP_ROW * ((place - 1 + STEP_MOST) % STEP_MOST)
    square = change = 0.0
    for k in range(6):
        row[k] = given[at.G_W + k] - state[at.S_LATE + k]
        row[TORQUE + k] = given[at.G_TORQUE + k]
    for k in range(3):
        row[_PLANNED + k] = state[at.S_LATE + k]
        square += given[at.G_W + k] ** 2
        change += (row[k] - memory[last + k]) ** 2
    row[_WAY], row[_CHANGE] = way, 0.0
    counts[K_STEP_PLACE] = (place + 1) % STEP_MOST
    if counts[K_STEP_FILLED] > 0 and counts[K_STEP] == 0:
        change = min(0.5 * change, (_SIGMAS * limits[L_STEP_N]) ** 2)
        memory[M_STEP_NOISE] = _NOISE_KEEP * memory[M_STEP_NOISE] + (1.0 - _NOISE_KEEP) * change
    counts[K_STEP_FILLED] = min(counts[K_STEP_FILLED] + 1, STEP_MOST)
    window = min(times[T_STEP_PERIOD] + few, counts[K_STEP_FILLED])
    planned = row[_PLANNED : _PLANNED + 3]
    spread, fade = apart(state[at.S_SOON : at.S_SOON + 3], planned), limits[L_STEP_FADE]
    for back in range(1, window):
        old = M_STEPS + STEP_ROW * ((place - back + STEP_MOST) % STEP_MOST) + _PLANNED
        spread = max(spread, apart(memory[old : old + 3], planned))
    memory[M_STEP_PLAN] = max(spread, fade * memory[M_STEP_PLAN])
    memory[M_STEP_SWING] = max(swing_n, fade * memory[M_STEP_SWING])
    memory[M_STEP_SIZE] = max(math.sqrt(square), fade * memory[M_STEP_SIZE])
    # Not what belongs to the samples in which a step shows now.
    known = memory[M_STEPS + STEP_ROW * ((place - few - 1 + STEP_MOST) % STEP_MOST) + _CHANGE]
    row[_RANG] = memory[M_STEP_CHANGE] = max(known, limits[L_STEP_MEMORY] * memory[M_STEP_CHANGE])


@kernel("float64(float64[::1], float64[::1], float64, float64, int64, float64[::1])")
def _bound(now: Float, before: Float, step_n: float, share: float, samples: int, memory: Float) -> float:
    """By how much the mean residual of so many samples may differ from an earlier one, N.

    ``step + |dp| + |m| dv / v + s D + 0.4 I + 0.7 C + 4 noise``: change of the planned force and of the speed between
    the two, and what swings on: of the planned force's change D, of inertia I, of the residual's own changes C before.

    Args:
        now: (10,) mean residual, planned force, way.
        before: (10,) likewise.
        step_n: Smallest step.
        share: Of a change of the planned force that swings on.
        samples: Of the mean.
        memory: (REMEMBERED,).
    """
    explained = apart(now[_PLANNED : _PLANNED + 3], before[_PLANNED : _PLANNED + 3])
    explained += _uneven(now, before) * memory[M_STEP_SIZE] + share * memory[M_STEP_PLAN]
    explained += _INERTIA * memory[M_STEP_SWING] + _AGAIN * memory[M_STEP_CHANGE]
    return float(step_n + explained + _SIGMAS * math.sqrt(memory[M_STEP_NOISE] / samples))


@kernel(
    "void(float64, float64[::1], float64[::1], float64[::1], boolean, float64[::1], int64[::1], float64[::1],"
    " int64[::1], float64[::1])"
)
def _tell(
    rang: float,
    planned: Float,
    constants: Float,
    jac: Float,
    shown: bool,
    limits: Float,
    times: Int,
    memory: Float,
    counts: Int,
    mean: Float,
) -> None:
    """Tell the force if its mean over the last period stands off from that before, which rang by so much, or not."""
    period, before = times[T_STEP_PERIOD], memory[M_STEP_BEFORE : M_STEP_BEFORE + 10]
    mean_rows(memory, counts, 0, period, 0, mean)
    noise = _SIGMAS * math.sqrt(memory[M_STEP_NOISE] / period)
    least = limits[L_STEP_N] + _AGAIN * rang
    bound = _bound(mean, before, least, 0.5 * limits[L_STEP_PLAN], period, memory)
    stands = apart(mean, before) > bound and size(mean) > _AGREES * limits[L_STEP_N]
    stands = stands and not missing(mean, planned, limits, noise)
    if stands and shown:
        for k in range(6):
            mean[k] -= before[k]
        stands = by_currents(mean[:6], jac, counts[K_STEP_SINCE], constants, limits, times, memory, counts) != 1
    counts[K_STEP] = TOLD if stands else 0
    counts[K_STEP_SINCE] = counts[K_STEP_BACK] = 0


@kernel(
    "void(float64[::1], float64[::1], float64[::1], boolean, boolean, float64[::1], int64[::1], float64[::1],"
    " int64[::1], float64[:, ::1])"
)
def _judge(
    planned: Float,
    constants: Float,
    jac: Float,
    acts: bool,
    shown: bool,
    limits: Float,
    times: Int,
    memory: Float,
    counts: Int,
    work: Float,
) -> None:
    """Suspect, tell, or believe again, by the samples so far.

    Args:
        planned: (3,) force before the filters, N.
        constants: Of the loop.
        jac: (36,) Jacobian of the TCP, base axes.
        acts: The correction may act.
        shown: There are motor currents.
        limits: (LIMITS,).
        times: (TIMES,).
        memory: (REMEMBERED,); changed.
        counts: (COUNTS,); changed.
        work: (2, 14) work space.
    """
    few, period = times[T_STEP_FEW], times[T_STEP_PERIOD]
    fresh, mean, before = work[0, :10], work[1, :10], memory[M_STEP_BEFORE : M_STEP_BEFORE + 10]
    mean_rows(memory, counts, 0, few, 0, fresh)
    noise = _SIGMAS * math.sqrt(memory[M_STEP_NOISE] / few)
    if counts[K_STEP] == TOLD:
        again = _uneven(fresh, before) < _STEADY and apart(fresh, before) < 0.5 * limits[L_STEP_N] + noise
        right = zero_is_right(fresh, planned, limits, memory)
        counts[K_STEP_BACK] = counts[K_STEP_BACK] + 1 if again or right else 0
        if counts[K_STEP_BACK] >= times[T_STEP_BACK]:
            forget_step(counts)
        return
    if missing(fresh, planned, limits, noise):
        forget_step(counts)
        counts[K_STEP_FILLED] = counts[K_STEP_EVEN] = 0
        counts[K_STEP] = _ENTERING
        return
    if counts[K_STEP] == SUSPECTED:
        counts[K_STEP_SINCE] += 1
        if counts[K_STEP_SINCE] >= period + few:
            _tell(0.0, planned, constants, jac, shown, limits, times, memory, counts, mean)
        return
    if counts[K_STEP_FILLED] < period + few:
        return
    mean_rows(memory, counts, few, period, 0, mean)
    newest = M_STEPS + STEP_ROW * ((counts[K_STEP_PLACE] - 1 + STEP_MOST) % STEP_MOST)
    memory[newest + _CHANGE] = apart(fresh, mean)
    if counts[K_STEP] == _ENTERING:
        counts[K_STEP] = _ENTERING if memory[newest + _CHANGE] > _EVEN * limits[L_STEP_N] + noise else 0
        return
    even = memory[M_STEP_PLAN] < _EVEN * limits[L_STEP_N] and _uneven(fresh, mean) < _STEADY
    counts[K_STEP_EVEN] = min(counts[K_STEP_EVEN] + 1, STEP_MOST) if even else 0
    if not acts:
        return
    bound = _bound(fresh, mean, _SOONER * limits[L_STEP_N], limits[L_STEP_PLAN], few, memory)
    if memory[newest + _CHANGE] > bound and size(fresh) > _AGREES * limits[L_STEP_N] + noise:
        counts[K_STEP], counts[K_STEP_SINCE] = SUSPECTED, few
        for k in range(10):
            before[k] = mean[k]
        return
    if counts[K_STEP_EVEN] < times[T_STEP_LONG] + period:
        return
    rang = memory[M_STEP_WORK : M_STEP_WORK + 1]
    mean_rows(memory, counts, times[T_STEP_LONG], period, _RANG, rang)
    counts[K_STEP_SINCE] = times[T_STEP_LONG]
    mean_rows(memory, counts, times[T_STEP_LONG], period, 0, before)
    _tell(rang[0], planned, constants, jac, shown, limits, times, memory, counts, mean)


@kernel(
    "void(float64[::1], int64[::1], int64[::1], float64[::1], float64[:, ::1], float64[::1], int64[::1],"
    " float64[:, ::1], float64[::1], float64, float64[::1], int64[::1], float64[::1], int64[::1], float64[:, ::1])"
)
def believe_force(
    given: Float,
    flags: Int,
    choices: Int,
    constants: Float,
    plan: Float,
    state: Float,
    whole: Int,
    ring: Float,
    jac: Float,
    swing_kg: float,
    limits: Float,
    times: Int,
    memory: Float,
    counts: Int,
    work: Float,
) -> None:
    """Which force the step takes for the measured one (R17): writes S_BELIEVED, and F_SOFT where the loop must hold.

    It is ``planned + s r0`` in place of the measured one while a step is suspected, and once it is told with anything
    but ``"tell"``; s the share of the planned force that is left of what it was. Run again over its own output it
    changes nothing, so that a recorded cycle replays.

    Args:
        given: Inputs of the step.
        flags: Likewise; F_SOFT is changed.
        choices: Of the loop.
        constants: Likewise.
        plan: (n, PLAN_COLUMNS).
        state: State of the step; S_BELIEVED is written.
        whole: Likewise.
        ring: Of the last cycles.
        jac: (36,) rigid Jacobian of the TCP in the last cycle, base axes, by rows.
        swing_kg: Largest force at the sensor by the recent acceleration of the program.
        limits: Of the tests.
        times: Likewise.
        memory: What they remember; changed.
        counts: Their counters; changed.
        work: (2, 14) work space.
    """
    for k in range(6):
        state[at.S_BELIEVED + k] = given[at.G_W + k]
    if choices[at.W_FORCE] == 0 or choices[at.W_PLAN] == 0:
        return
    acts = whole[AT_STATE] > _ARMED
    # A feed hold is acknowledged by a reset, too; what it was held for goes on.
    if not acts or (flags[at.F_RESET] == 1 and whole[AT_STATE] != _HOLD):
        forget_step(counts)
        forget_calm(counts)
    set_to, fused = choices[at.W_FORCE_OFFSET], choices[at.W_FORCE] == _FUSED  # which has other sources
    leaves_out = set_to == _PLAN or (fused and set_to != _TELL)
    soft = flags[at.F_SOFT]
    if flags[at.F_FORCE_AGE] >= choices[at.W_STALE] or soft in (_STALE, _INVALID, _SATURATED):
        counts[K_STEP_FILLED] = counts[K_STEP_EVEN] = counts[K_STEP_BACK] = 0
        counts[K_CALM] = counts[K_CALM_LONG] = counts[K_CALM_OFF] = 0
        if counts[K_STEP] == SUSPECTED:
            forget_step(counts)
    else:
        nominal = given[at.G_NOMINAL : at.G_NOMINAL + 12]
        way, acceleration = _commanded_motion(ring, whole[at.N_RING], nominal, constants[at.C_PERIOD])
        if whole[at.N_CYCLES] < 2 * _SPAN:
            acceleration = 0.0
        _take(given, way, swing_kg * acceleration, state, limits, times, memory, counts)
        shown = bool(flags[at.F_SOURCES] & _FROM_CURRENTS) and flags[at.F_CURRENT_AGE] < choices[at.W_STALE]
        late = state[at.S_LATE : at.S_LATE + 3]
        _judge(late, constants, jac, acts, shown, limits, times, memory, counts, work)
        known_in_air(zero_is_right(work[0, :10], late, limits, memory), times, memory, counts)
        if counts[K_STEP] != 0 or not acts:
            counts[K_CALM] = counts[K_CALM_LONG] = counts[K_CALM_OFF] = 0
        else:
            feed = work[0, :9]
            directions(plan, int(state[at.S_PLACE]), nominal, feed)
            # It may be another cut: the feed is not held for it, the way in air tells.
            if off_in_calm(feed, limits, times, memory, counts, work[1]) and leaves_out:
                counts[K_STEP], counts[K_STEP_SINCE], counts[K_STEP_BACK] = TOLD, 0, 0
    acts_as_set = counts[K_STEP] == TOLD and set_to != _TELL
    if counts[K_STEP] == SUSPECTED or acts_as_set:
        share, load = 1.0, size(memory[M_STEP_BEFORE + _PLANNED : M_STEP_BEFORE + _PLANNED + 3])
        if load > _NOTHING_N:
            share = min(1.0, size(state[at.S_LATE : at.S_LATE + 3]) / load)
        for k in range(6):
            state[at.S_BELIEVED + k] = state[at.S_LATE + k] + share * memory[M_STEP_BEFORE + k]
    if acts_as_set and (set_to == _HOLDS or fused) and flags[at.F_SOFT] == 0:
        flags[at.F_SOFT] = _OFFSET
