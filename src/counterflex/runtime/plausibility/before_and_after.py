"""The plausibility tests around the step: what is not used is decided before it, what is doubted is found after it.

Doubts are bits ``DOUBT_...`` of :mod:`counterflex.runtime.plausibility.kernel`. What follows from them reaches the
supervisor in the next cycle, see :func:`causes`.
"""

from __future__ import annotations

import math

from counterflex.core.arrays import Float, Int
from counterflex.core.jit import kernel
from counterflex.runtime.plausibility.doubts import direction_is_wrong, idle_is_wrong
from counterflex.runtime.plausibility.force_step import SUSPECTED, TOLD
from counterflex.runtime.plausibility.kernel import (
    DOUBT_ANSWER,
    DOUBT_BRIDGED,
    DOUBT_DIFFERS,
    DOUBT_DIRECTION,
    DOUBT_FRAME,
    DOUBT_IDLE,
    DOUBT_OFFSET,
    DOUBT_RESIDUAL,
    DOUBT_RETURN,
    DOUBT_STEP,
    K_AIR,
    K_ANSWER,
    K_CALM_TOLD,
    K_DIRECTION,
    K_EARLY,
    K_HARD,
    K_REJECTED,
    K_RESIDUAL,
    K_SIGN,
    K_SOFT,
    K_STEP,
    K_WHY,
    M_FORCE,
    T_WINDOW,
    answer_is_wrong,
    frame_is_wrong,
    residual_grows,
)
from counterflex.runtime.plausibility.tracker_gate import tracker_cause
from counterflex.runtime.plausibility.tracker_sample import judge_sample, judges
from counterflex.runtime.primitives.frames import all_finite, pose_deviation
from counterflex.runtime.state import layout as at
from counterflex.runtime.state.supervisor import AT_STATE, Cause, State

_ARMED, _ACTIVE = int(State.ARMED), int(State.ACTIVE)
_WRONG_FRAME, _DIVERGENCE = int(Cause.WRONG_FRAME), int(Cause.DIVERGENCE)
_OFFSET, _TRACKER_LOST = int(Cause.FORCE_OFFSET), int(Cause.TRACKER_LOST)
_DIFFERS = int(Cause.FORCE_DIFFERS)
_FORCE_INVALID, _MALFORMED = int(Cause.FORCE_INVALID), int(Cause.TELEGRAM_MALFORMED)
_FAULT = int(State.FAULT)
_FUSED = 4
_NO_CURRENTS = 10_000
_STANDS_M = 20e-6
_TURN_BACK = 3


@kernel("int64(float64[::1], float64[::1], boolean, boolean, float64, int64, float64[::1], int64[::1], int64[::1])")
def watch_force(
    measured: Float,
    predicted: Float,
    good: bool,
    cuts: bool,
    swing_n: float,
    settled: int,
    limits: Float,
    times: Int,
    counts: Int,
) -> int:
    """Doubts about the force where there is a plan.

    Args:
        measured: (6,) filtered, part axes.
        predicted: (6,) through the same filters.
        good: The measured one is fresh.
        cuts: The plan cuts material now or within the lead.
        swing_n: Force that inertia explains.
        settled: Cycles after a cut until the filters have forgotten it.
        limits: Of the tests.
        times: Likewise.
        counts: Their counters; changed.
    """
    counts[K_AIR] = 0 if cuts else min(counts[K_AIR] + 1, settled)
    doubt = 0
    if direction_is_wrong(measured, predicted, good, limits, times, counts):
        doubt |= DOUBT_DIRECTION
    if idle_is_wrong(measured, good and counts[K_AIR] >= settled, swing_n, limits, times, counts):
        doubt |= DOUBT_IDLE
    return doubt


@kernel("void(float64[:, ::1], int64, int64, float64[::1])")
def _way(ring: Float, newer: int, older: int, out: Float) -> None:
    rows = at.RING_ROWS
    for k in range(3):
        now = ring[(newer + rows) % rows, at.RING_NOMINAL + 9 + k]
        out[k] = now - ring[(older + rows) % rows, at.RING_NOMINAL + 9 + k]


@kernel(
    "int64(float64[::1], float64[:, ::1], int64, int64, int64, float64[::1], boolean, float64[::1], int64[::1],"
    " float64[::1], int64[::1], float64[:, ::1])"
)
def watch_robot(
    given: Float,
    ring: Float,
    here: int,
    back: int,
    cycles: int,
    state: Float,
    corrects: bool,
    limits: Float,
    times: Int,
    memory: Float,
    counts: Int,
    work: Float,
) -> int:
    """Doubts about what the robot makes of the correction, by the pose that it reports.

    Args:
        given: Inputs of the cycle, with the reported pose.
        ring: Of the last cycles, this one included.
        here: Its next row.
        back: Cycles back to the commanded pose that the reported one belongs to.
        cycles: Run so far; at the beginning nothing is known of the motion.
        state: State of the step.
        corrects: The correction may act.
        limits: Of the tests.
        times: Likewise.
        memory: What they remember; changed.
        counts: Their counters; changed.
        work: (2, 14) work space.
    """
    window = times[T_WINDOW]
    if cycles <= max(_TURN_BACK * window + window, back) + 1:
        return 0
    difference, moved, before, space = work[0, :3], work[0, 3:6], work[0, 6:9], work[0, 9:12]
    row = (here - 1 - back + at.RING_ROWS) % at.RING_ROWS
    for k in range(3):
        past = given[at.G_NOMINAL + 9 + k] if back == 0 else ring[row, at.RING_NOMINAL + 9 + k]
        difference[k] = given[at.G_REPORTED + 9 + k] - past
    _way(ring, here - 1, here - 1 - window, moved)
    _way(ring, here - 1 - _TURN_BACK * window, here - 1 - (_TURN_BACK + 1) * window, before)
    change = 0.0
    for k in range(3):
        change += state[at.S_V + k] ** 2
    wrong = answer_is_wrong(
        difference,
        state[at.S_IN_FORCE : at.S_IN_FORCE + 3],
        moved,
        before,
        math.sqrt(change),
        space,
        corrects,
        limits,
        times,
        memory,
        counts,
    )
    return DOUBT_ANSWER if wrong else 0


@kernel("int64(float64[::1], float64[:, ::1], int64, int64, float64[::1], int64[::1], int64[::1])")
def watch_frame(deviation: Float, ring: Float, here: int, at_state: int, limits: Float, times: Int, counts: Int) -> int:
    """Doubt about the tracker's frame before arming: a new sample; while the robot moves it can only be confirmed.

    Args:
        deviation: (6,) measured minus commanded pose, the component along the feed included.
        ring: Of the last cycles.
        here: Its next row.
        at_state: State of the supervisor.
        limits: Of the tests.
        times: Likewise.
        counts: Their counters; changed.
    """
    if at_state >= _ARMED:
        return 0
    rows = at.RING_ROWS
    way = 0.0
    for k in range(3):
        now = ring[(here - 1 + rows) % rows, at.RING_NOMINAL + 9 + k]
        way += (now - ring[(here - 1 - times[T_WINDOW] + rows) % rows, at.RING_NOMINAL + 9 + k]) ** 2
    return DOUBT_FRAME if frame_is_wrong(deviation, math.sqrt(way) > _STANDS_M, limits, counts) else 0


@kernel("void(int64[::1])")
def forget_doubts(counts: Int) -> None:
    """The operator's reset: what was counted towards a fault begins anew."""
    counts[K_ANSWER] = counts[K_RESIDUAL] = counts[K_SIGN] = counts[K_DIRECTION] = 0


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
    if doubt & (DOUBT_ANSWER | DOUBT_DIRECTION):
        wrong = _WRONG_FRAME
    elif doubt & DOUBT_RESIDUAL:
        wrong = _DIVERGENCE
    if at_state == _FAULT:
        return 0, 0
    if wrong != 0 and at_state >= _ARMED:
        hard = wrong
    elif wrong != 0:
        soft = wrong
    elif doubt & DOUBT_FRAME:
        soft = _WRONG_FRAME
    elif doubt & DOUBT_IDLE:
        soft = _OFFSET
    return soft, hard


@kernel(
    "void(float64[::1], int64[::1], float64[::1], int64[::1], float64[::1], int64[::1], float64[:, ::1], float64[::1],"
    " float64[::1], int64[::1], float64[::1], int64[::1], float64[:, ::1])"
)
def before_step(
    given: Float,
    flags: Int,
    constants: Float,
    choices: Int,
    state: Float,
    whole: Int,
    ring: Float,
    results: Float,
    limits: Float,
    times: Int,
    memory: Float,
    counts: Int,
    work: Float,
) -> None:
    """Take out what must not be used in this cycle, and hand over the causes that the last one left.

    A measured number that is not finite is not used: the last good one stands in its place, and the loop holds (R14). A
    sample of the tracker that is not believed after a gap is marked (R18). Run again over its own output it changes
    nothing, so that a recorded cycle replays.

    Args:
        given: Inputs of the step; changed.
        flags: Likewise.
        constants: Of the loop.
        choices: Likewise.
        state: State of the step, as the last cycle left it.
        whole: Likewise.
        ring: Likewise.
        results: Likewise.
        limits: Of the tests.
        times: Likewise.
        memory: What they remember; changed.
        counts: Their counters; changed.
        work: (2, 14) work space.
    """
    soft, early = flags[at.F_SOFT], 0
    if all_finite(given, at.G_W, at.G_ACTUAL):
        for k in range(6):
            memory[M_FORCE + k] = given[at.G_W + k]
    else:
        for k in range(6):
            given[at.G_W + k] = memory[M_FORCE + k]
        flags[at.F_FORCE_AGE] = max(flags[at.F_FORCE_AGE], choices[at.W_STALE])
        soft = _FORCE_INVALID if soft == 0 else soft
    if flags[at.F_TRACKER_NEW] != 0 and not all_finite(given, at.G_ACTUAL, at.G_TORQUE):
        flags[at.F_TRACKER_NEW] = 0
        soft = _TRACKER_LOST if soft == 0 else soft
    if not all_finite(given, at.G_TORQUE, at.G_REPORTED):
        for k in range(6):
            given[at.G_TORQUE + k] = 0.0
        flags[at.F_CURRENT_AGE] = _NO_CURRENTS
    if flags[at.F_REPORTED] == 1 and not all_finite(given, at.G_REPORTED, at.GIVEN):
        flags[at.F_REPORTED] = 0
        soft = _MALFORMED if soft == 0 else soft
    if flags[at.F_RESET] == 1:
        forget_doubts(counts)
    acts = whole[AT_STATE] > _ARMED
    if judges(flags, choices):
        early = judge_sample(
            given, flags, constants, choices, acts, state, whole, ring, results, limits, times, memory, counts, work
        )
        why = counts[K_WHY] if counts[K_WHY] != 0 else _TRACKER_LOST
        if early & DOUBT_RETURN and choices[at.W_FORCE] == 0 and soft == 0:
            soft = why
        if soft == 0 or (soft == _TRACKER_LOST and choices[at.W_FORCE] == _FUSED):
            lost = tracker_cause(limits, times, memory, counts)
            if choices[at.W_TRACKER_LOST] == 1 and lost != 0:
                soft = lost
    if soft == 0:
        soft = counts[K_SOFT]
    flags[at.F_SOFT] = soft
    if flags[at.F_HARD] == 0:
        flags[at.F_HARD] = counts[K_HARD]
    counts[K_EARLY] = early


@kernel(
    "void(float64[::1], int64[::1], int64[::1], float64[::1], int64[::1], float64[:, ::1], float64[::1], int64[::1],"
    " float64[::1], int64[::1], int64, float64, float64[::1], int64[::1], float64[:, ::1])"
)
def after_step(
    given: Float,
    flags: Int,
    choices: Int,
    state: Float,
    whole: Int,
    ring: Float,
    results: Float,
    outcome: Int,
    limits: Float,
    times: Int,
    settled: int,
    swing_n: float,
    memory: Float,
    counts: Int,
    work: Float,
) -> None:
    """Find doubts in what the cycle gave; writes them into ``outcome`` and keeps their causes for the next cycle.

    Args:
        given: Inputs of the step.
        flags: Likewise.
        choices: Of the loop.
        state: State of the step.
        whole: Likewise.
        ring: Likewise.
        results: Of the step.
        outcome: Likewise; O_DOUBT is written.
        limits: Of the tests.
        times: Likewise.
        settled: Cycles after a cut until the force filters have forgotten it.
        swing_n: Force at the sensor that inertia explains.
        memory: What the tests remember; changed.
        counts: Their counters; changed.
        work: (2, 14) work space.
    """
    doubt, now = counts[K_EARLY], outcome[at.O_STATE]
    forced = choices[at.W_FORCE] != 0
    acts = now > _ARMED
    here = whole[at.N_RING]
    if forced and choices[at.W_PLAN] == 1:
        good = flags[at.F_FORCE_AGE] < choices[at.W_STALE]
        soon = state[at.S_SOON : at.S_SOON + 3]
        cuts = results[at.R_CUT] > 0.0 or soon[0] != 0.0 or soon[1] != 0.0 or soon[2] != 0.0
        measured = results[at.R_MEASURED : at.R_MEASURED + 6]
        predicted = state[at.S_BEFORE : at.S_BEFORE + 6]
        doubt |= watch_force(measured, predicted, good, cuts, swing_n, settled, limits, times, counts)
        if counts[K_STEP] == SUSPECTED:
            doubt |= DOUBT_STEP
        elif counts[K_STEP] == TOLD:
            doubt |= DOUBT_OFFSET
        if counts[K_CALM_TOLD] == 1:
            doubt |= DOUBT_DIFFERS
        if not good and flags[at.F_FORCE_AGE] < choices[at.W_BRIDGE]:
            doubt |= DOUBT_BRIDGED
    if flags[at.F_REPORTED] == 1 and flags[at.F_ELAPSED] > 0:
        back, cycles = choices[at.W_REPORTED_BACK], whole[at.N_CYCLES]
        doubt |= watch_robot(
            given, ring, here, back, cycles, state, acts, limits, times, memory, counts, work
        )  # fmt: skip
    if (choices[at.W_TRACKER] != 0 or choices[at.W_FORCE] == _FUSED) and flags[at.F_TRACKER_NEW] == 1:
        row = (here - 1 - choices[at.W_NOMINAL_BACK] + at.RING_ROWS) % at.RING_ROWS
        nothing, found = work[0, :6], work[1, :6]
        for k in range(6):
            nothing[k] = 0.0
        pose_deviation(given, at.G_ACTUAL, ring[row, at.RING_NOMINAL : at.RING_NOMINAL + 12], nothing, found)
        doubt |= watch_frame(found, ring, here, now, limits, times, counts)
        bent = results[at.R_DEFLECTION : at.R_DEFLECTION + 3]
        size = math.sqrt(bent[0] ** 2 + bent[1] ** 2 + bent[2] ** 2)
        deviation = results[at.R_DEVIATION : at.R_DEVIATION + 6]
        in_force = state[at.S_IN_FORCE : at.S_IN_FORCE + 3]
        if residual_grows(deviation, in_force, size, now == _ACTIVE, limits, times, memory, counts):
            doubt |= DOUBT_RESIDUAL
    outcome[at.O_DOUBT], outcome[at.O_REJECTED] = doubt, counts[K_REJECTED]
    if judges(flags, choices) and outcome[at.O_DEGRADED] in (0, _TRACKER_LOST):
        why = counts[K_WHY] if counts[K_WHY] != 0 else tracker_cause(limits, times, memory, counts)
        if why != 0:
            outcome[at.O_DEGRADED] = why
    if counts[K_STEP] == TOLD:
        outcome[at.O_DEGRADED] = _OFFSET
    elif counts[K_CALM_TOLD] == 1 and outcome[at.O_DEGRADED] == 0:
        outcome[at.O_DEGRADED] = _DIFFERS
    counts[K_SOFT], counts[K_HARD] = causes(doubt, now)
