"""The plausibility tests around the step: what is not used is decided before it, what is doubted is found after it.

Doubts are bits ``DOUBT_...`` of :mod:`counterflex.runtime.plausibility.kernel`. What follows from them reaches the
supervisor in the next cycle, see :func:`causes`.
"""

from __future__ import annotations

import math

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.core.records import Record, Records
from counterflex.runtime.plausibility import kernel as tests
from counterflex.runtime.plausibility.answer import SHORT, TOO_SHORT, WRONG, judge_answer
from counterflex.runtime.plausibility.force_step import REPORTED, SUSPECTED
from counterflex.runtime.plausibility.tracker_gate import tracker_cause
from counterflex.runtime.plausibility.tracker_sample import judge_sample, judges
from counterflex.runtime.primitives.causes import next_cause
from counterflex.runtime.primitives.finite import is_sample
from counterflex.runtime.primitives.frames import all_finite, pose_deviation
from counterflex.runtime.primitives.loop_types import LOOP_TYPES
from counterflex.runtime.state.memory import PAST_ROWS
from counterflex.runtime.state.supervisor import Cause, State

_ARMED, _ACTIVE = int(State.ARMED), int(State.ACTIVE)
_WRONG_FRAME, _DIVERGENCE = int(Cause.WRONG_FRAME), int(Cause.DIVERGENCE)
_OFFSET, _TRACKER_LOST = int(Cause.FORCE_OFFSET), int(Cause.TRACKER_LOST)
_DIFFERS, _SHORT = int(Cause.FORCE_DIFFERS), int(Cause.ANSWER_SHORT)
_FORCE_INVALID, _MALFORMED = int(Cause.FORCE_INVALID), int(Cause.TELEGRAM_MALFORMED)
_FAULT = int(State.FAULT)
_FUSED, _TRACKER = 4, 4
"""ForceMode and Source."""
_NO_CURRENTS = 10_000
_STANDS_M = 20e-6
_TURN_BACK = 3
_STOOD = 3
_STANDING_M = 1e-6


@kernel("int64(float64[::1], float64[::1], boolean, boolean, float64, Limits, Memory)", **LOOP_TYPES)
def watch_force(
    measured: Float,
    predicted: Float,
    good: bool,
    cuts: bool,
    swing_n: float,
    limits: Record,
    memory: Record,
) -> int:
    """Doubts about the force where there is a plan.

    Args:
        measured: (6,) filtered, part axes.
        predicted: (6,) through the same filters.
        good: The measured one is fresh.
        cuts: The plan cuts material now or within the lead.
        swing_n: Force that inertia explains.
        memory: Of the tests; changed.
    """
    memory.air = 0 if cuts else min(memory.air + 1, limits.settled)
    doubt = 0
    if tests.direction_is_wrong(measured, predicted, good, limits, memory):
        doubt |= tests.DOUBT_DIRECTION
    if tests.idle_is_wrong(measured, good and memory.air >= limits.settled, swing_n, limits, memory):
        doubt |= tests.DOUBT_IDLE
    return doubt


@kernel("void(Past[::1], int64, int64, float64[::1])", **LOOP_TYPES)
def _way(ring: Records, newer: int, older: int, out: Float) -> None:
    rows = PAST_ROWS
    for k in range(3):
        now = ring[(newer + rows) % rows].nominal[9 + k]
        out[k] = now - ring[(older + rows) % rows].nominal[9 + k]


@kernel("int64(Given, Settings, Past[::1], State, float64[::1], boolean, Limits, Memory, Work)", **LOOP_TYPES)
def watch_robot(
    given: Record,
    settings: Record,
    ring: Records,
    state: Record,
    bent: Float,
    corrects: bool,
    limits: Record,
    memory: Record,
    work: Record,
) -> int:
    """Doubts about what the robot makes of the correction, by the pose that it reports.

    ``state``: of the step; at the beginning nothing is known of the motion. ``bent``: (3,) deflection under the load as
    it is known, m.
    """
    window, back, here = limits.window, settings.reported_back, state.ring_row
    if state.cycles <= max(_TURN_BACK * window + window, back) + 1:
        return 0
    difference, moved, before = work.one[:3], work.one[3:6], work.one[6:9]
    row = (here - 1 - back + PAST_ROWS) % PAST_ROWS
    for k in range(3):
        past = given.nominal[9 + k] if back == 0 else ring[row].nominal[9 + k]
        difference[k] = given.reported[9 + k] - past
    _way(ring, here - 1, here - 1 - _STOOD, moved)
    stood = math.sqrt(moved[0] ** 2 + moved[1] ** 2 + moved[2] ** 2) < _STANDING_M
    memory.still = min(memory.still + 1, limits.settle_cycles) if stood else 0
    _way(ring, here - 1, here - 1 - window, moved)
    _way(ring, here - 1 - _TURN_BACK * window, here - 1 - (_TURN_BACK + 1) * window, before)
    answer = judge_answer(difference, moved, before, bent, state, ring, corrects, work.answer[:], limits, memory)
    if answer == WRONG:
        return tests.DOUBT_ANSWER
    if answer == TOO_SHORT:
        return tests.DOUBT_TOO_SHORT
    return tests.DOUBT_SHORT if answer == SHORT else 0


@kernel("int64(float64[::1], Past[::1], int64, int64, Limits, Memory)", **LOOP_TYPES)
def watch_frame(deviation: Float, ring: Records, here: int, at_state: int, limits: Record, memory: Record) -> int:
    """Doubt about the tracker's frame before arming: a new sample; while the robot moves it can only be confirmed.

    ``deviation``: (6,) measured minus commanded pose, the component along the feed included; ``at_state``: state of the
    supervisor.
    """
    if at_state >= _ARMED:
        return 0
    rows = PAST_ROWS
    way = 0.0
    for k in range(3):
        now = ring[(here - 1 + rows) % rows].nominal[9 + k]
        way += (now - ring[(here - 1 - limits.window + rows) % rows].nominal[9 + k]) ** 2
    return tests.DOUBT_FRAME if tests.frame_is_wrong(deviation, math.sqrt(way) > _STANDS_M, limits, memory) else 0


@kernel("void(Memory)", **LOOP_TYPES)
def forget_doubts(memory: Record) -> None:
    """The operator's reset: what was counted towards a fault begins anew."""
    memory.answer = memory.early_answer = memory.residual = memory.sign = memory.direction = memory.short = 0
    for k in range(3):
        memory.missing[k] = 0.0


@kernel("Tuple((int64, int64))(int64, int64)")
def causes(doubt: int, at_state: int) -> tuple[int, int]:
    """Soft and hard cause that follow from doubts, 0 none.

    A wrong frame, sign or direction is a fault once armed; before, it keeps the loop from being armed.

    Args:
        doubt: Bits.
        at_state: State of the supervisor.
    """
    soft = hard = 0
    wrong = 0
    if doubt & (tests.DOUBT_ANSWER | tests.DOUBT_DIRECTION):
        wrong = _WRONG_FRAME
    elif doubt & tests.DOUBT_TOO_SHORT:
        wrong = _SHORT
    elif doubt & tests.DOUBT_RESIDUAL:
        wrong = _DIVERGENCE
    # In a fault the first cause stands: what the arm does while it stops would write over why.
    if at_state == _FAULT:
        return 0, 0
    if wrong != 0 and at_state >= _ARMED:
        hard = wrong
    elif wrong != 0:
        soft = wrong
    elif doubt & tests.DOUBT_FRAME:
        soft = _WRONG_FRAME
    elif doubt & tests.DOUBT_IDLE:
        soft = _OFFSET
    return soft, hard


@kernel("void(Given, Settings, State, Past[::1], Result, Limits, Memory, Work)", **LOOP_TYPES)
def before_step(
    given: Record,
    settings: Record,
    state: Record,
    ring: Records,
    result: Record,
    limits: Record,
    memory: Record,
    work: Record,
) -> None:
    """Take out what must not be used in this cycle, and hand over the causes that the last one left.

    A measured number that is not finite is not used: the last good one stands in its place, and the loop holds (R14). A
    sample of the tracker that is not believed after a gap is marked (R18). Run again over its own output it changes
    nothing, so that a recorded cycle replays.
    """
    soft, early = given.soft, 0
    if all_finite(given.wrench[:]):
        for k in range(6):
            memory.force[k] = given.wrench[k]
    else:
        # The step takes the force whole in any case: a last good one beside the cause of a hold, instead of a gap that
        # the filters of the force would carry on as NaN for ever.
        for k in range(6):
            given.wrench[k] = memory.force[k]
        given.force_age = max(given.force_age, settings.stale)
        soft = _FORCE_INVALID if soft == 0 else soft
    if given.tracker_new != 0 and not is_sample(given):
        given.tracker_new = 0
        soft = _TRACKER_LOST if soft == 0 else soft
    if not all_finite(given.torque[:]):
        for k in range(6):
            given.torque[k] = 0.0
        # Currents are an optional source: without them the loop goes on, so they get an age and no cause.
        given.current_age = _NO_CURRENTS
    if given.is_reported == 1 and not all_finite(given.reported[:]):
        given.is_reported = 0
        soft = next_cause(settings, soft, _MALFORMED)
    if given.reset == 1:
        forget_doubts(memory)
    acts = state.supervisor.state > _ARMED
    if judges(given, settings):
        early = judge_sample(given, settings, acts, state, ring, result, limits, memory, work)
        why = memory.why if memory.why != 0 else _TRACKER_LOST
        if early & tests.DOUBT_RETURN and settings.force == 0 and soft == 0:
            soft = why
        if settings.tracker_lost_holds == 1:
            lost = tracker_cause(limits, memory)
            exact = lost != 0 and soft == _TRACKER_LOST and settings.force == _FUSED
            soft = lost if exact else next_cause(settings, soft, lost)
        # A step without any source says only that the tracker is lost.
        alone = settings.force == _FUSED and settings.has_plan == 0 and given.sources == _TRACKER
        if alone and state.disbelieved >= settings.disbelieved:
            soft = next_cause(settings, soft, memory.why)
    # What the last cycle found is handed over here and not where it was found: the supervisor takes one cause in a
    # cycle, and a recorded cycle run again must find the same one in its memory.
    given.soft = next_cause(settings, soft, memory.soft)
    if given.hard == 0:
        given.hard = memory.hard
    memory.early = early


@kernel("int64(Memory, int64)", **LOOP_TYPES)
def degraded_by(memory: Record, degraded: int) -> int:
    """Cause of a degraded correction: by the force, the robot's answer, or as found before."""
    if memory.step == REPORTED:
        return _OFFSET
    if degraded == 0 and memory.short == 1:
        return _SHORT
    return _DIFFERS if degraded == 0 and memory.calm_told == 1 else degraded


@kernel("void(Given, Settings, State, Past[::1], Cycle, Result, Limits, float64, Memory, Work)", **LOOP_TYPES)
def after_step(
    given: Record,
    settings: Record,
    state: Record,
    ring: Records,
    cycle: Record,
    result: Record,
    limits: Record,
    swing_n: float,
    memory: Record,
    work: Record,
) -> None:
    """Find doubts in what the cycle gave; writes them into the result and keeps their causes for the next cycle.

    ``swing_n``: force at the sensor that inertia explains.
    """
    doubt, now = memory.early, result.state
    forced = settings.force != 0
    acts = now > _ARMED
    here = state.ring_row
    if forced and settings.has_plan == 1:
        good = given.force_age < settings.stale
        preview = state.preview[:3]
        cuts = result.cut > 0.0 or preview[0] != 0.0 or preview[1] != 0.0 or preview[2] != 0.0
        measured = result.measured[:]
        predicted = state.predicted_before[:]
        doubt |= watch_force(measured, predicted, good, cuts, swing_n, limits, memory)
        if memory.step == SUSPECTED:
            doubt |= tests.DOUBT_STEP
        elif memory.step == REPORTED:
            doubt |= tests.DOUBT_OFFSET
        if memory.calm_told == 1:
            doubt |= tests.DOUBT_DIFFERS
        if not good and given.force_age < settings.bridge:
            doubt |= tests.DOUBT_BRIDGED
    if given.is_reported == 1 and given.elapsed > 0:
        whole = work.two[:3]
        for k in range(3):
            # The program carries what it contains of the correction: the drives see that as path, not as load.
            whole[k] = result.deflection[k] - cycle.contained[k]
        doubt |= watch_robot(given, settings, ring, state, whole, acts, limits, memory, work)
    if (settings.tracker != 0 or settings.force == _FUSED) and given.tracker_new == 1:
        row = (here - 1 - settings.nominal_back + PAST_ROWS) % PAST_ROWS
        nothing, from_tracker = work.one[:6], work.two[:6]
        for k in range(6):
            nothing[k] = 0.0
        pose_deviation(given.actual[:], 0, ring[row].nominal[:], nothing, from_tracker)
        doubt |= watch_frame(from_tracker, ring, here, now, limits, memory)
        bent = result.deflection[:3]
        size = math.sqrt(bent[0] ** 2 + bent[1] ** 2 + bent[2] ** 2)
        deviation = result.deviation[:]
        in_force = state.in_effect[:3]
        if tests.residual_grows(deviation, in_force, size, now == _ACTIVE, limits, memory):
            doubt |= tests.DOUBT_RESIDUAL
    result.doubt, result.rejected = doubt, memory.rejected
    if judges(given, settings) and result.degraded in (0, _TRACKER_LOST):
        why = memory.why if memory.why != 0 else tracker_cause(limits, memory)
        if why != 0:
            result.degraded = why
    result.degraded = degraded_by(memory, result.degraded)
    memory.soft, memory.hard = causes(doubt, now)
