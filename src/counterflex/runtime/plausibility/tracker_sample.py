"""A tracker's sample before the step uses it: what the loop knew at its time, and whether it is believed. Pure.

The modes of :class:`counterflex.runtime.settings.TrackerMode` hold a sample against the commanded pose that belongs to
it by the delays of the cell file, and against correction and deflection of the last cycle. The estimator of all sources
takes samples of any age: for it all three are those of the sample's own time, and the deflection is
``sum_d (k_d + a_d) D_d`` of :mod:`counterflex.runtime.estimator.fusion_kernel`. What the program contains moves the
commanded pose itself.
"""

from __future__ import annotations

from typing import Final

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.core.records import Record, Records
from counterflex.runtime.plausibility.kernel import (
    DOUBT_FRAME,
    DOUBT_RETURN,
    DOUBT_STAMP,
    DOUBT_TRACKER,
    gap_cycles,
    return_is_believed,
)
from counterflex.runtime.plausibility.tracker_gate import (
    REPEATED,
    count_sample,
    pose_at,
    sample_doubt,
    stamped_pose,
    watch_session,
)
from counterflex.runtime.primitives.frames import pose_deviation
from counterflex.runtime.primitives.history import row_at
from counterflex.runtime.primitives.loop_types import LOOP_TYPES
from counterflex.runtime.state.memory import PAST_ROWS
from counterflex.runtime.state.supervisor import State

_FUSED, _DESIGNED = 4, 3
_TRACKER: Final = 4
"""Bit of Source."""
_ARMED: Final = int(State.ARMED)


@kernel("boolean(Given, Settings)", **LOOP_TYPES)
def judges(given: Record, settings: Record) -> bool:
    """Return whether a tracker's samples are judged: in every tracker mode, and by the estimator that has a tracker."""
    fused = settings.force == _FUSED and given.sources & _TRACKER != 0
    return bool(settings.tracker != 0 or fused)


@kernel("int64(int64, Limits, Memory)", **LOOP_TYPES)
def _not_seen(at_state: int, limits: Record, memory: Record) -> int:
    """A cycle without a sample of the tracker: what it is doubted for."""
    memory.unseen += 1
    memory.paused += 1
    doubt = DOUBT_TRACKER if memory.unseen >= gap_cycles(limits, memory) else 0
    if memory.waiting == 1:
        doubt |= DOUBT_RETURN
    if at_state < _ARMED and memory.frame == 1:
        doubt |= DOUBT_FRAME
    return doubt


@kernel("void(Memory)", **LOOP_TYPES)
def _paused(memory: Record) -> None:
    """Learn the usual pause between two samples; one long one is mostly a gap and counts little."""
    pause = memory.pause
    memory.pause += 0.5 * (min(float(memory.paused), 2.0 * pause + 2.0) - pause)
    memory.paused = 0


@kernel("boolean(Given, Settings, Past[::1], int64, Limits, State, float64[::1], float64[::1])", **LOOP_TYPES)
def known_then(
    given: Record,
    settings: Record,
    ring: Records,
    here: int,
    limits: Record,
    state: Record,
    pose: Float,
    model: Float,
) -> bool:
    """Estimate at the time of a sample.

    ``pose``: (12,) commanded pose that the robot followed then; written. ``model``: (6,) correction in effect, then
    expected deflection, m, part axes; written.

    Returns:
        False where the loop does not remember it.
    """
    period = settings.period
    late = given.tracker_late if given.tracker_late >= 0.0 else settings.tracker_late
    if not stamped_pose(given, ring, here, settings.follow, limits, state, pose):
        return False
    newest = (here - 1 + PAST_ROWS) % PAST_ROWS
    last, past = ring[newest].clock, state.past
    clock = state.clock + given.elapsed - late / period
    for k in range(6):
        model[k] = 0.0
    if not row_at(ring, newest, min(clock, last), past):
        return bool(last <= 0.0)  # nothing has been commanded yet
    for k in range(3):
        model[k] = past.in_effect[k]
    lagged_clock = clock + (settings.reference_late - settings.follow) / period
    if not row_at(ring, newest, min(lagged_clock, last), past):
        return False
    for d in range(3):
        factor = state.fusion.estimate[d] + state.fusion.estimate[3 + d]
        for k in range(3):
            model[3 + k] += factor * past.bent[6 * d + k]
    return True


@kernel("int64(Given, Settings, boolean, State, Past[::1], Result, Limits, Memory, Work)", **LOOP_TYPES)
def judge_sample(
    given: Record,
    settings: Record,
    acts: bool,
    state: Record,
    ring: Records,
    result: Record,
    limits: Record,
    memory: Record,
    work: Record,
) -> int:
    """Judge the sample of this cycle, or that there is none; marks it in the inputs (``tracker_new`` 2: not believed).

    Returns:
        Bits ``DOUBT_...``.
    """
    memory.without += 1
    watch_session(given, limits, memory)
    if given.tracker_new == 0:
        return int(_not_seen(state.supervisor.state, limits, memory))
    here, fused = state.ring_row, settings.force == _FUSED
    deviation, nothing, past = work.one[:6], work.one[6:12], work.two[:12]
    model = state.residual[:]  # work space of the estimator
    in_force, expected = model[:3], model[3:]
    stamped = fused or settings.tracker == _DESIGNED
    remembered = True
    if fused:
        _paused(memory)
        remembered = known_then(given, settings, ring, here, limits, state, past, model)
    elif stamped:
        stamped_pose(given, ring, here, 0.0, limits, state, past)
    else:
        pose_at(given, ring, here, float(settings.nominal_back), state, past)
    for k in range(6):
        nothing[k] = 0.0  # what the program contains moves the commanded pose itself
    pose_deviation(given.actual[:], 0, past, nothing, deviation)
    if not fused:
        for k in range(3):
            in_force[k], expected[k] = state.in_effect[k], result.deflection[k]
    early = sample_doubt(
        given, deviation, stamped, state, ring, here, acts, in_force, expected, limits, memory,
        past[:9],
    )  # fmt: skip
    if early == 0 and not remembered and memory.known == 1:
        early = DOUBT_STAMP
    given.tracker_new = 2
    if early == REPEATED:
        return 0
    if early == 0 and not return_is_believed(deviation[:3], in_force, expected, acts, limits, memory):
        early = DOUBT_RETURN
    count_sample(early, given, deviation, state, limits, memory)
    if early == 0:
        given.tracker_new = 1
    elif fused:
        state.disbelieved += 1
    return int(early)
