"""A tracker's sample before the step uses it: what the loop knew at its time, and whether it is believed. Pure.

The modes of :class:`counterflex.runtime.settings.TrackerMode` hold a sample against the commanded pose that belongs to
it by the delays of the cell file, and against correction and deflection of the last cycle. The estimator of all sources
takes samples of any age: for it all three are those of the sample's own time, and the deflection is
``sum_d (k_d + a_d) D_d`` of :mod:`counterflex.runtime.estimator.fusion_kernel`. What the program contains moves the
commanded pose itself.
"""

from __future__ import annotations

from typing import Final

from counterflex.core.arrays import Float, Int
from counterflex.core.jit import kernel
from counterflex.runtime.estimator.fusion_kernel import X
from counterflex.runtime.plausibility.kernel import (
    DOUBT_FRAME,
    DOUBT_RETURN,
    DOUBT_STAMP,
    DOUBT_TRACKER,
    K_FRAME,
    K_KNOWN,
    K_PAUSED,
    K_UNSEEN,
    K_WAITING,
    K_WITHOUT,
    M_PAUSE,
    gap_cycles,
    return_is_believed,
)
from counterflex.runtime.plausibility.tracker_gate import REPEATED, count_sample, sample_doubt, stamped_pose
from counterflex.runtime.primitives.frames import pose_deviation
from counterflex.runtime.primitives.history import row_at
from counterflex.runtime.state import layout as at
from counterflex.runtime.state.supervisor import AT_STATE, State

_FUSED, _DESIGNED = 4, 3
_TRACKER: Final = 4
"""Bit of Source."""
_ARMED: Final = int(State.ARMED)


@kernel("boolean(int64[::1], int64[::1])")
def judges(flags: Int, choices: Int) -> bool:
    """Whether samples of a tracker are judged: in every tracker mode, and by the estimator where there is a tracker."""
    fused = choices[at.W_FORCE] == _FUSED and flags[at.F_SOURCES] & _TRACKER != 0
    return bool(choices[at.W_TRACKER] != 0 or fused)


@kernel("int64(int64, int64[::1], float64[::1], int64[::1])")
def _not_seen(at_state: int, times: Int, memory: Float, counts: Int) -> int:
    """A cycle without a sample of the tracker: what it is doubted for."""
    counts[K_UNSEEN] += 1
    counts[K_PAUSED] += 1
    doubt = DOUBT_TRACKER if counts[K_UNSEEN] >= gap_cycles(times, memory) else 0
    if counts[K_WAITING] == 1:
        doubt |= DOUBT_RETURN
    if at_state < _ARMED and counts[K_FRAME] == 1:
        doubt |= DOUBT_FRAME
    return doubt


@kernel("void(float64[::1], int64[::1])")
def _paused(memory: Float, counts: Int) -> None:
    """Learn the usual pause between two samples; one long one is mostly a gap and counts little."""
    pause = memory[M_PAUSE]
    memory[M_PAUSE] += 0.5 * (min(float(counts[K_PAUSED]), 2.0 * pause + 2.0) - pause)
    counts[K_PAUSED] = 0


@kernel(
    "boolean(float64[::1], int64[::1], float64[::1], float64[:, ::1], int64, float64[::1], float64[::1], float64[::1],"
    " float64[::1])"
)
def known_then(
    given: Float,
    flags: Int,
    constants: Float,
    ring: Float,
    here: int,
    limits: Float,
    state: Float,
    pose: Float,
    model: Float,
) -> bool:
    """What the estimator knew at the time of a sample.

    Args:
        given: Inputs of the cycle.
        flags: Likewise.
        constants: Of the loop.
        ring: Of the last cycles.
        here: Its next row.
        limits: Of the tests.
        state: Of the step; its work space for a row of the past is written.
        pose: (12,) commanded pose that the robot followed then; written.
        model: (6,) correction in effect, then expected deflection, m, part axes; written.

    Returns:
        False where the loop does not remember it.
    """
    period = constants[at.C_PERIOD]
    late = given[at.G_TRACKER_LATE] if given[at.G_TRACKER_LATE] >= 0.0 else constants[at.C_TRACKER_LATE]
    if not stamped_pose(given, flags, ring, here, constants[at.C_FOLLOW], limits, state, pose):
        return False
    newest = (here - 1 + at.RING_ROWS) % at.RING_ROWS
    last, past = ring[newest, at.RING_CLOCK], state[at.S_PAST : at.S_PAST + at.RING]
    clock = state[at.S_CLOCK] + flags[at.F_ELAPSED] - late / period
    for k in range(6):
        model[k] = 0.0
    if not row_at(ring, newest, min(clock, last), past):
        return bool(last <= 0.0)  # nothing has been commanded yet
    for k in range(3):
        model[k] = past[at.RING_IN_FORCE + k]
    behind = clock + (constants[at.C_REFERENCE_LATE] - constants[at.C_FOLLOW]) / period
    if not row_at(ring, newest, min(behind, last), past):
        return False
    for d in range(3):
        factor = state[at.S_FUSION + X + d] + state[at.S_FUSION + X + 3 + d]
        for k in range(3):
            model[3 + k] += factor * past[at.RING_BENT + 6 * d + k]
    return True


@kernel(
    "int64(float64[::1], int64[::1], float64[::1], int64[::1], boolean, float64[::1], int64[::1], float64[:, ::1],"
    " float64[::1], float64[::1], int64[::1], float64[::1], int64[::1], float64[:, ::1])"
)
def judge_sample(
    given: Float,
    flags: Int,
    constants: Float,
    choices: Int,
    acts: bool,
    state: Float,
    whole: Int,
    ring: Float,
    results: Float,
    limits: Float,
    times: Int,
    memory: Float,
    counts: Int,
    work: Float,
) -> int:
    """Judge the sample of this cycle, or that there is none; marks it in ``flags`` (F_TRACKER_NEW 2: not believed).

    Args:
        given: Inputs of the cycle.
        flags: Likewise; changed.
        constants: Of the loop.
        choices: Likewise.
        acts: The correction acts or stands.
        state: Of the step, as the last cycle left it.
        whole: Likewise; the estimator's count of samples not believed is changed.
        ring: Of the last cycles.
        results: Of the step, as the last cycle left it.
        limits: Of the tests.
        times: Likewise.
        memory: What they remember; changed.
        counts: Their counters; changed.
        work: (2, 14) work space.

    Returns:
        Bits ``DOUBT_...``.
    """
    counts[K_WITHOUT] += 1
    if flags[at.F_TRACKER_NEW] == 0:
        return int(_not_seen(whole[AT_STATE], times, memory, counts))
    here, fused = whole[at.N_RING], choices[at.W_FORCE] == _FUSED
    deviation, nothing, past = work[0, :6], work[0, 6:12], work[1]
    model = state[at.S_REST : at.S_REST + 6]  # work space of the estimator
    in_force, expected = model[:3], model[3:]
    stamped = fused or choices[at.W_TRACKER] == _DESIGNED
    back, remembered = choices[at.W_NOMINAL_BACK], True
    row = (here - back + at.RING_ROWS) % at.RING_ROWS
    for k in range(12):
        past[k] = given[at.G_NOMINAL + k] if back == 0 else ring[row, at.RING_NOMINAL + k]
    if fused:
        _paused(memory, counts)
        remembered = known_then(given, flags, constants, ring, here, limits, state, past, model)
    elif stamped:
        stamped_pose(given, flags, ring, here, 0.0, limits, state, past)
    for k in range(6):
        nothing[k] = 0.0  # what the program contains moves the commanded pose itself
    pose_deviation(given, at.G_ACTUAL, past, nothing, deviation)
    if not fused:
        for k in range(3):
            in_force[k], expected[k] = state[at.S_IN_FORCE + k], results[at.R_DEFLECTION + k]
    early = sample_doubt(
        given, deviation, stamped, flags, state, ring, here, acts, in_force, expected, limits, times, memory, counts,
        past[:9],
    )  # fmt: skip
    if early == 0 and not remembered and counts[K_KNOWN] == 1:
        early = DOUBT_STAMP
    flags[at.F_TRACKER_NEW] = 2
    if early == REPEATED:
        return 0
    if early == 0 and not return_is_believed(deviation[:3], in_force, expected, acts, limits, times, memory, counts):
        early = DOUBT_RETURN
    count_sample(early, given, deviation, flags, state, limits, times, memory, counts)
    if early == 0:
        flags[at.F_TRACKER_NEW] = 1
    elif fused:
        whole[at.N_DISBELIEVED] += 1
    return int(early)
