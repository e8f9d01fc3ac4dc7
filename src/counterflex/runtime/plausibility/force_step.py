"""A force that steps in the cut where neither plan nor speed does: first not followed, then judged. Pure kernels.

A sensor whose zero jumps in the cut shows a force that goes on changing as planned, with something added. Judged is
the residual ``r = measured - planned`` before the force filters, against ``r0``, its mean over one period of the
arm's lowest mode before. The arm swings about when a load comes or goes; over a whole period a swing has next to no
mean. So there are two stages:

1. *suspected*: the mean of a few samples departs from r0 by more than a bound. At once the loop goes on with
   ``planned + r0`` in place of the measured force, before its filters: what was on its way is all that is followed.
2. a period later the mean over it says whether the force has *swung back* (it is used again, silently) or
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

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.core.records import Record, Records
from counterflex.runtime.plausibility.calm_cuts import forget_calm, known_in_air, off_in_calm
from counterflex.runtime.plausibility.force_change import (
    STANDS_M,
    by_currents,
    copy_cut,
    distance,
    mean_cut,
    mean_ringing,
    missing,
    sample_at,
    size,
    zero_is_right,
)
from counterflex.runtime.primitives.causes import next_cause
from counterflex.runtime.primitives.frames import directions
from counterflex.runtime.primitives.history import row_back
from counterflex.runtime.primitives.loop_types import LOOP_TYPES
from counterflex.runtime.state.doubts import STEP_MOST
from counterflex.runtime.state.supervisor import Cause, State

SUSPECTED: Final = 1
REPORTED: Final = 2
_ENTERING: Final = 3
"""A load is missing, or coming after it was: nothing is judged until it has settled."""
_ARMED, _HOLD = int(State.ARMED), int(State.HOLD)
_OFFSET = int(Cause.FORCE_OFFSET)
_STALE, _INVALID, _SATURATED = int(Cause.FORCE_STALE), int(Cause.FORCE_INVALID), int(Cause.FORCE_SATURATED)
_TELL, _PLAN, _HOLDS, _FUSED = 0, 1, 2, 4
_FROM_CURRENTS = 8
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


@kernel("Tuple((float64, float64))(Past[::1], int64, float64[::1], float64)", **LOOP_TYPES)
def _commanded_motion(ring: Records, here: int, nominal: Float, period: float) -> tuple[float, float]:
    """Way of the commanded point in the last cycles, m, and its acceleration over twice as many, m/s2."""
    later, earlier = row_back(here, _SPAN), row_back(here, 2 * _SPAN)
    one, two = ring[later], ring[earlier]
    square = second = 0.0
    for k in range(3):
        p, q, r = nominal[9 + k], one.nominal[9 + k], two.nominal[9 + k]
        square += (p - q) ** 2
        second += (p - 2.0 * q + r) ** 2
    return math.sqrt(square), math.sqrt(second) / (_SPAN * period) ** 2


@kernel("void(Memory)", **LOOP_TYPES)
def forget_step(memory: Record) -> None:
    """Nothing is held against the force any more, and that it comes back is no step."""
    if memory.step != 0:
        memory.samples_filled = memory.step_even = 0
    memory.step = memory.step_since = memory.step_back = 0


@kernel("float64(Cut, Cut)", **LOOP_TYPES)
def _uneven(now: Record, before: Record) -> float:
    """Share by which the speed has changed; 1 where the program stands."""
    most = max(now.way, before.way)
    return 1.0 - min(now.way, before.way) / most if most > STANDS_M else 1.0


@kernel("int64(int64, int64)")
def _sample_back(place: int, samples: int) -> int:
    """Row of the samples that was written some samples before row ``place``, at most STEP_MOST."""
    return (place - samples + STEP_MOST) % STEP_MOST


@kernel("void(Given, float64, float64, State, Limits, Memory)", **LOOP_TYPES)
def _take(given: Record, way: float, swing_n: float, state: Record, limits: Record, memory: Record) -> None:
    """Keep a sample, and what swings on of what plan, program and force did before."""
    place, few = memory.sample_row, limits.step_few
    row, last = memory.samples[place], memory.samples[_sample_back(place, 1)]
    square = change = 0.0
    for k in range(6):
        row.cut.residual[k] = given.wrench[k] - state.predicted_late[k]
        row.torque[k] = given.torque[k]
    for k in range(3):
        row.cut.planned[k] = state.predicted_late[k]
        square += given.wrench[k] ** 2
        change += (row.cut.residual[k] - last.cut.residual[k]) ** 2
    row.cut.way, row.change = way, 0.0
    memory.sample_row = (place + 1) % STEP_MOST
    if memory.samples_filled > 0 and memory.step == 0:
        # Half: a difference of two samples has twice the variance of one. Capped: a step must not raise the noise by
        # which it is judged so far that it hides itself.
        change = min(0.5 * change, (_SIGMAS * limits.step_n) ** 2)
        memory.noise = _NOISE_KEEP * memory.noise + (1.0 - _NOISE_KEEP) * change
    memory.samples_filled = min(memory.samples_filled + 1, STEP_MOST)
    window = min(limits.step_period + few, memory.samples_filled)
    planned = row.cut.planned[:]
    spread, fade = distance(state.preview[:3], planned), limits.step_fade
    for back in range(1, window):
        old = memory.samples[_sample_back(place, back)]
        spread = max(spread, distance(old.cut.planned[:], planned))
    memory.plan_change = max(spread, fade * memory.plan_change)
    memory.swing_n = max(swing_n, fade * memory.swing_n)
    memory.force_size = max(math.sqrt(square), fade * memory.force_size)
    # Not what belongs to the samples in which a step shows now.
    known = memory.samples[_sample_back(place, few + 1)].change
    memory.residual_change = max(known, limits.step_memory * memory.residual_change)
    row.ringing = memory.residual_change


@kernel("float64(Cut, Cut, float64, float64, int64, Memory)", **LOOP_TYPES)
def _bound(now: Record, before: Record, step_n: float, share: float, samples: int, memory: Record) -> float:
    """By how much the mean residual of so many samples may differ from an earlier one, N."""
    # ``step + |dp| + |m| dv / v + s D + 0.4 I + 0.7 C + 4 noise``: change of the planned force and of the speed between
    # the two, and what swings on: of the planned force's change D, of inertia I, of the residual's own changes C
    # before.
    explained = distance(now.planned[:], before.planned[:])
    explained += _uneven(now, before) * memory.force_size + share * memory.plan_change
    explained += _INERTIA * memory.swing_n + _AGAIN * memory.residual_change
    return float(step_n + explained + _SIGMAS * math.sqrt(memory.noise / samples))


@kernel("void(float64, float64[::1], Settings, float64[::1], boolean, Limits, Memory, Cut)", **LOOP_TYPES)
def _tell(
    rang: float,
    planned: Float,
    settings: Record,
    jac: Float,
    shown: bool,
    limits: Record,
    memory: Record,
    mean: Record,
) -> None:
    """Tell the force if its mean over the last period stands off from that before, which rang by so much, or not."""
    period, before = limits.step_period, memory.cut_before
    mean_cut(memory, 0, period, mean)
    noise = _SIGMAS * math.sqrt(memory.noise / period)
    least = limits.step_n + _AGAIN * rang
    bound = _bound(mean, before, least, 0.5 * limits.step_plan, period, memory)
    residual = mean.residual[:]
    stands = distance(residual, before.residual[:]) > bound and size(residual) > _AGREES * limits.step_n
    stands = stands and not missing(residual, planned, limits, noise)
    if stands and shown:
        for k in range(6):
            residual[k] -= before.residual[k]
        stands = by_currents(residual, jac, memory.step_since, settings, limits, memory) != 1
    memory.step = REPORTED if stands else 0
    memory.step_since = memory.step_back = 0


@kernel("void(float64[::1], Settings, float64[::1], boolean, boolean, Limits, Memory, Work)", **LOOP_TYPES)
def _judge(
    planned: Float,
    settings: Record,
    jac: Float,
    acts: bool,
    shown: bool,
    limits: Record,
    memory: Record,
    work: Record,
) -> None:
    """Suspect, tell, or believe again, by the samples so far."""
    few, period = limits.step_few, limits.step_period
    fresh, mean, before = work.fresh, work.period_mean, memory.cut_before
    mean_cut(memory, 0, few, fresh)
    noise = _SIGMAS * math.sqrt(memory.noise / few)
    if memory.step == REPORTED:
        again = (
            _uneven(fresh, before) < _STEADY
            and distance(fresh.residual[:], before.residual[:]) < 0.5 * limits.step_n + noise
        )
        right = zero_is_right(fresh, planned, limits, memory)
        memory.step_back = memory.step_back + 1 if again or right else 0
        if memory.step_back >= limits.step_back:
            forget_step(memory)
        return
    if missing(fresh.residual[:], planned, limits, noise):
        forget_step(memory)
        memory.samples_filled = memory.step_even = 0
        memory.step = _ENTERING
        return
    if memory.step == SUSPECTED:
        memory.step_since += 1
        if memory.step_since >= period + few:
            _tell(0.0, planned, settings, jac, shown, limits, memory, mean)
        return
    if memory.samples_filled < period + few:
        return
    mean_cut(memory, few, period, mean)
    newest = memory.samples[sample_at(memory, 0)]
    newest.change = distance(fresh.residual[:], mean.residual[:])
    if memory.step == _ENTERING:
        memory.step = _ENTERING if newest.change > _EVEN * limits.step_n + noise else 0
        return
    even = memory.plan_change < _EVEN * limits.step_n and _uneven(fresh, mean) < _STEADY
    memory.step_even = min(memory.step_even + 1, STEP_MOST) if even else 0
    if not acts:
        return
    bound = _bound(fresh, mean, _SOONER * limits.step_n, limits.step_plan, few, memory)
    if newest.change > bound and size(fresh.residual[:]) > _AGREES * limits.step_n + noise:
        memory.step, memory.step_since = SUSPECTED, few
        copy_cut(mean, before)
        return
    if memory.step_even < limits.step_long + period:
        return
    rang = mean_ringing(memory, limits.step_long, period)
    memory.step_since = limits.step_long
    mean_cut(memory, limits.step_long, period, before)
    _tell(rang, planned, settings, jac, shown, limits, memory, mean)


@kernel("void(Given, Settings, Plan[::1], State, Past[::1], float64[::1], float64, Limits, Memory, Work)", **LOOP_TYPES)
def believe_force(
    given: Record,
    settings: Record,
    plan: Records,
    state: Record,
    ring: Records,
    jac: Float,
    swing_kg: float,
    limits: Record,
    memory: Record,
    work: Record,
) -> None:
    """Choose the force that the step takes as measured (R17): writes ``believed``, and ``soft`` where it must hold.

    It is ``planned + s r0`` in place of the measured one while a step is suspected, and once it is told with anything
    but ``"tell"``; s the share of the planned force that is left of what it was. Run again over its own output it
    changes nothing, so that a recorded cycle replays.

    ``jac``: (36,) rigid Jacobian of the TCP in the last cycle, base axes, by rows; ``swing_kg``: largest force at the
    sensor by the recent acceleration of the program.
    """
    for k in range(6):
        state.believed[k] = given.wrench[k]
    if settings.force == 0 or settings.has_plan == 0:
        return
    acts = state.supervisor.state > _ARMED
    # A feed hold is acknowledged by a reset, too; what it was held for goes on.
    if not acts or (given.reset == 1 and state.supervisor.state != _HOLD):
        forget_step(memory)
        forget_calm(memory)
    set_to, fused = settings.force_offset, settings.force == _FUSED  # which has other sources
    leaves_out = set_to == _PLAN or (fused and set_to != _TELL)
    soft = given.soft
    if given.force_age >= settings.stale or soft in (_STALE, _INVALID, _SATURATED):
        memory.samples_filled = memory.step_even = memory.step_back = 0
        memory.calm = memory.calm_long = memory.calm_off = 0
        if memory.step == SUSPECTED:
            forget_step(memory)
    else:
        nominal = given.nominal[:]
        way, acceleration = _commanded_motion(ring, state.ring_row, nominal, settings.period)
        if state.cycles < 2 * _SPAN:
            acceleration = 0.0
        _take(given, way, swing_kg * acceleration, state, limits, memory)
        shown = bool(given.sources & _FROM_CURRENTS) and given.current_age < settings.stale
        late = state.predicted_late[:3]
        _judge(late, settings, jac, acts, shown, limits, memory, work)
        known_in_air(zero_is_right(work.fresh, late, limits, memory), limits, memory)
        if memory.step != 0 or not acts:
            memory.calm = memory.calm_long = memory.calm_off = 0
        else:
            feed = work.feed[:]
            directions(plan, int(state.place[0]), nominal, feed)
            # It may be another cut: the feed is not held for it, the way in air tells.
            if off_in_calm(feed, limits, memory, work.now) and leaves_out:
                memory.step, memory.step_since, memory.step_back = REPORTED, 0, 0
    acts_as_set = memory.step == REPORTED and set_to != _TELL
    if memory.step == SUSPECTED or acts_as_set:
        share, load = 1.0, size(memory.cut_before.planned[:])
        if load > _NOTHING_N:
            share = min(1.0, size(state.predicted_late[:3]) / load)
        for k in range(6):
            state.believed[k] = state.predicted_late[k] + share * memory.cut_before.residual[k]
    if acts_as_set and (set_to == _HOLDS or fused):
        given.soft = next_cause(settings, given.soft, _OFFSET)
