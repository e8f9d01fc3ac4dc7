"""Gate for tracker samples: held against what the tool can have done since the last believed one.

Prediction: the last believed deviation from the commanded pose, plus how correction in effect and expected deflection
have changed since. What a sample may differ from it by::

    |g - (g.t) t| <= 6 sqrt(2) s + min(r dt, m) + |de| + |dc| / 2 + |c'| dt + |v| min(dt, 2 T) / 5 + 2 |v - v_before| dt
    |g.t|         <= the same + 2 |v| (dt + T)

g is the difference, t the direction of the commanded motion, v its speed now and ``v_before`` up to 0.3 s ago (a robot
trails its program, so that its deviation turns round with it), dt the time since the last believed sample by the
stamps, at least a cycle T, s the sample's standard deviation, c the correction in effect, e the expected deflection.
The arm bends under a force that nobody announced no faster than r, 40 mm/s, and while nothing is seen no farther than
m, 0.25 mm. With 20 um of noise, at 4 ms and without a correction on its way 0.33 mm pass in straight motion. The
orientation may change by 0.2 deg. A sample that was rejected was seen: behind it r goes on for one pause between two
samples, and after two of them :func:`counterflex.runtime.plausibility.kernel.return_is_believed` judges. So what was
rejected is not believed later because time has passed.

A sample that was measured before the last one, or longer ago than the loop remembers, has a wrong stamp. One that is
the same bit for bit although the tool has moved by 20 um is none: the source repeats itself.
"""

from __future__ import annotations

import math
from typing import Final

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.core.records import Record, Records
from counterflex.runtime.plausibility.kernel import DOUBT_FROZEN, DOUBT_JUMP, DOUBT_STAMP, gap_cycles
from counterflex.runtime.primitives.history import row_at, row_back
from counterflex.runtime.primitives.loop_types import LOOP_TYPES
from counterflex.runtime.state.memory import PAST_ROWS
from counterflex.runtime.state.supervisor import Cause

LEAST_SIGMA_M: Final = 20e-6
"""Noise of a tracker that does not state a larger one."""
SIGMAS: Final = 6.0 * math.sqrt(2.0)
RATE_M_S: Final = 40e-3
MOST_M: Final = 0.25e-3
FROZEN: Final = 8
"""Repeats in a row that no living tracker sends; fewer are not used, and not counted against it."""
REPEATED: Final = -1
MOVED_M: Final = 20e-6
BEYOND_NOISE: Final = 5.0
"""Way of the program, in noises of the tracker, in which a living one leaves its noise."""
CORRECTED_M: Final = 0.5e-3
_LOST, _JUMP = int(Cause.TRACKER_LOST), int(Cause.TRACKER_JUMP)
_FROZEN, _STAMP = int(Cause.TRACKER_FROZEN), int(Cause.TRACKER_STAMP)
_SESSION = int(Cause.SESSION_RESTARTED)
_LONGEST = 0.9 * PAST_ROWS
_LOOK_BACK = (12, 40, 75)


@kernel("float64(Past[::1], int64, float64[::1])", **LOOP_TYPES)
def _turned(ring: Records, here: int, v: Float) -> float:
    """Largest change of the commanded motion, m per cycle, against what it was up to 0.3 s ago."""
    most = 0.0
    for back in _LOOK_BACK:
        later = ring[row_back(here, back)]
        earlier = ring[row_back(here, back + 1)]
        square = 0.0
        for k in range(3):
            square += (v[k] - later.nominal[9 + k] + earlier.nominal[9 + k]) ** 2
        most = max(most, square)
    return math.sqrt(most)


@kernel("boolean(Given, Past[::1], int64, float64, Limits, State, float64[::1])", **LOOP_TYPES)
def stamped_pose(
    given: Record, ring: Records, here: int, earlier_s: float, limits: Record, state: Record, out: Float
) -> bool:
    """Commanded pose at the time of a sample, or earlier by what the robot trails its program.

    ``earlier_s``: how much earlier; ``out``: (12,) written.

    Returns:
        False where that is longer ago than the loop remembers.
    """
    late = given.tracker_late if given.tracker_late >= 0.0 else limits.tracker_late
    return pose_at(given, ring, here, (late + earlier_s) / limits.period, state, out)


@kernel("boolean(Given, Past[::1], int64, float64, State, float64[::1])", **LOOP_TYPES)
def pose_at(given: Record, ring: Records, here: int, ago: float, state: Record, out: Float) -> bool:
    """Commanded pose some cycles of the controller ago; between two telegrams as if it had gone on evenly.

    Counted by the controller's cycles and not by those of the loop: where telegrams were lost both part.

    Args:
        given: Inputs of the cycle.
        ring: Past cycles.
        here: Its next row.
        ago: Cycles.
        state: Of the step; written.
        out: (12,) written.

    Returns:
        False where that is longer ago than the loop remembers; then ``out`` is the present pose.
    """
    now = state.clock + given.elapsed
    newest = (here - 1 + PAST_ROWS) % PAST_ROWS
    clock, stamp = now - ago, ring[newest].clock
    for k in range(12):
        out[k] = given.nominal[k]
    if clock >= now:
        return True
    if clock >= stamp:
        u = (clock - stamp) / (now - stamp)
        for k in range(9, 12):
            out[k] = (1.0 - u) * ring[newest].nominal[k] + u * out[k]
        return True
    past = state.past
    if not row_at(ring, newest, clock, past):
        return False
    for k in range(12):
        out[k] = past.nominal[k]
    return True


@kernel("boolean(Given, float64[::1], Memory)", **LOOP_TYPES)
def _stands_in_its_noise(given: Record, stands: Float, memory: Record) -> bool:
    # "Return whether the samples stay within their noise although the program has moved the tool by many times as
    # much.""" Against the first of them: one that leaves the noise is the next first one. So is one that agrees better
    # with the program than the first did: that one was held against a place that the robot had left while telegrams
    # were lost, and a living tracker of a robot that now stands would be called frozen for as long as it stands.
    if memory.anchor[6] < 0.0:
        return False
    noise = SIGMAS * max(LEAST_SIGMA_M, given.tracker_sigma)
    seen = moved = off = off_first = 0.0
    for k in range(3):
        seen += (given.actual[9 + k] - memory.anchor[k]) ** 2
        moved += (stands[k] - memory.anchor[3 + k]) ** 2
        off += (given.actual[9 + k] - stands[k]) ** 2
        off_first += (memory.anchor[k] - memory.anchor[3 + k]) ** 2
    if memory.anchor[6] == 1.0 and seen <= noise * noise:
        if moved <= (BEYOND_NOISE * noise) ** 2:
            return False
        if off > off_first:
            return True
    for k in range(3):
        memory.anchor[k], memory.anchor[3 + k] = given.actual[9 + k], stands[k]
    memory.anchor[6] = 1.0
    return False


@kernel("void(Given, Limits, Memory)", **LOOP_TYPES)
def watch_session(given: Record, limits: Record, memory: Record) -> None:
    """Hold nothing against the commanded pose of another session: between the two the robot may have been moved."""
    if given.hard == _SESSION:
        memory.anchor[6] = -float(limits.settle_cycles)
    elif memory.anchor[6] < 0.0:
        memory.anchor[6] += 1.0


@kernel("boolean(Given, float64[::1], Memory)", **LOOP_TYPES)
def _repeats(given: Record, stands: Float, memory: Record) -> bool:
    """Return whether a sample is the last one bit for bit although the tool has moved since; remembers it otherwise."""
    # By its program, or by more than :data:`CORRECTED_M` of a correction.
    same = True
    for k in range(12):
        same = same and given.actual[k] == memory.pose[k]
    moved = corrected = 0.0
    for k in range(3):
        moved += (stands[k] - memory.stood[k]) ** 2
        corrected += (stands[3 + k] - memory.stood[3 + k]) ** 2
    if same:
        return bool(moved > MOVED_M * MOVED_M or corrected > CORRECTED_M * CORRECTED_M)
    for k in range(12):
        memory.pose[k] = given.actual[k]
    for k in range(6):
        memory.stood[k] = stands[k]
    return False


@kernel(
    "int64(Given, float64[::1], boolean, State, Past[::1], int64, boolean, float64[::1], float64[::1], Limits, Memory,"
    " float64[::1])",
    **LOOP_TYPES,
)
def sample_doubt(
    given: Record,
    deviation: Float,
    stamped: bool,
    state: Record,
    ring: Records,
    here: int,
    corrects: bool,
    in_force: Float,
    expected: Float,
    limits: Record,
    memory: Record,
    work: Float,
) -> int:
    """Cause for which a new sample is doubted; see the module.

    Args:
        given: Inputs of the cycle.
        deviation: (6,) measured minus commanded pose, m and rad, part axes.
        stamped: The commanded pose is that of the sample's own stamp; else that of a sample that is as late as usual.
        ring: Past cycles.
        here: Its next row.
        corrects: The correction acts or stands: before, only its stamp and whether it repeats itself is judged.
        in_force: (3,) correction in effect when it was measured.
        expected: (3,) deflection under the known force then.
        memory: Of the tests; changed.
        work: (9,) work space.

    Returns:
        Bits ``DOUBT_JUMP``, ``DOUBT_FROZEN``, ``DOUBT_STAMP``, or 0; REPEATED: no news, not to be used.
    """
    period = limits.period
    before = ring[row_back(here, 1)]
    elapsed = max(1, given.elapsed)
    v, stands = work[:3], work[3:9]
    speed = 0.0
    for k in range(3):
        v[k] = (given.nominal[9 + k] - before.nominal[9 + k]) / elapsed
        stands[k] = given.actual[9 + k] - deviation[k]  # commanded when the sample was measured
        stands[3 + k] = state.in_effect[k]
        speed += v[k] * v[k]
    speed = math.sqrt(speed)
    late = given.tracker_late
    clock = state.clock + given.elapsed - max(0.0, late) / period
    if late >= 0.0 and (not late / period <= _LONGEST or (memory.known == 1 and clock < memory.clock - 0.25)):
        return DOUBT_STAMP
    if _repeats(given, stands, memory):
        memory.same += 1
        return DOUBT_FROZEN if memory.same >= FROZEN else REPEATED
    memory.same = 0
    if state.cycles <= limits.settle_cycles:
        memory.anchor[6] = 0.0  # what was commanded then is not known yet
    if _stands_in_its_noise(given, stands, memory):
        return DOUBT_FROZEN
    if not corrects or memory.known == 0:
        return 0
    turned = 0.0
    for k in range(3):
        turned += (deviation[3 + k] - memory.turn[k]) ** 2
    # The turn is judged before the place: the correction moves a tool but does not turn it by 0.2 deg in a pause.
    if not math.sqrt(turned) <= limits.frame_rad:
        return DOUBT_JUMP
    if memory.waiting == 1 or memory.unseen >= gap_cycles(limits, memory):  # its place is judged as a return
        return 0
    later = (late - memory.late) / period if not stamped and min(late, memory.late) >= 0.0 else 0.0
    dt = max(1.0, clock - memory.clock)
    gap = along = change = rate = bent = 0.0
    for k in range(3):
        model = in_force[k] + expected[k]
        difference = deviation[k] - memory.deviation[k] - model + memory.model[k] + v[k] * later
        gap += difference * difference
        along += difference * v[k]
        change += (model - memory.model[k]) ** 2
        rate += state.correction_rate[k] ** 2
        bent += expected[k] ** 2
    along = abs(along) / speed if speed > 0.0 else 0.0
    across = math.sqrt(max(0.0, gap - along * along))
    # Behind a rejected sample time does not widen the gate: else a jump would be believed by waiting.
    unseen = dt if memory.why == 0 else min(dt, 1.0 + memory.pause)
    bound = SIGMAS * max(LEAST_SIGMA_M, given.tracker_sigma) + min(RATE_M_S * period * unseen, MOST_M)
    bound += math.sqrt(change) + math.sqrt(rate) * period * dt
    # A fifth of the way of two cycles: stamps are good to that; a change of speed comes with the robot's lag on top.
    bound += 0.2 * speed * min(dt, 2.0) + 2.0 * _turned(ring, here, v) * dt
    # NaN is no agreement.
    return 0 if across <= bound and along <= bound + 2.0 * speed * (dt + 1.0) else DOUBT_JUMP


@kernel("void(int64, Given, float64[::1], State, Limits, Memory)", **LOOP_TYPES)
def count_sample(
    doubt: int,
    given: Record,
    deviation: Float,
    state: Record,
    limits: Record,
    memory: Record,
) -> None:
    """Keep the share of the samples that were rejected, and what the next one is held against.

    ``doubt``: bits of :func:`sample_doubt` and of the return after a gap; 0: believed. ``deviation``: (6,) as there.
    """
    memory.rejected_share += ((1.0 if doubt != 0 else 0.0) - memory.rejected_share) / limits.share_samples
    if doubt != 0:
        memory.rejected += 1
        if doubt & DOUBT_FROZEN:
            memory.why = _FROZEN
        elif doubt & DOUBT_STAMP:
            memory.why = _STAMP
        elif doubt & DOUBT_JUMP:
            memory.why = _JUMP
        if doubt & (DOUBT_FROZEN | DOUBT_STAMP | DOUBT_JUMP):
            memory.unseen += 1
        return
    memory.why = memory.without = 0
    late = given.tracker_late
    memory.late = late
    memory.clock = state.clock + given.elapsed - max(0.0, late) / limits.period
    for k in range(3):
        memory.turn[k] = deviation[3 + k]


@kernel("int64(Limits, Memory)", **LOOP_TYPES)
def tracker_cause(limits: Record, memory: Record) -> int:
    """Cause for which the tracker is not used any more, or 0: silent for too long, or too many samples rejected."""
    if memory.without >= limits.silent_cycles or memory.rejected_share > limits.rejected_share:
        return memory.why if memory.why != 0 else _LOST
    return 0
