"""Whether a tracker's sample can be true: held against what the tool can have done since the last believed one.

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

from counterflex.core.arrays import Float, Int
from counterflex.core.jit import kernel
from counterflex.runtime.plausibility.kernel import (
    DOUBT_FROZEN,
    DOUBT_JUMP,
    DOUBT_STAMP,
    K_KNOWN,
    K_REJECTED,
    K_SAME,
    K_UNSEEN,
    K_WAITING,
    K_WHY,
    K_WITHOUT,
    L_FRAME_RAD,
    L_LATE,
    L_PERIOD,
    L_SHARE,
    M_CLOCK,
    M_LATE,
    M_MODEL,
    M_PAUSE,
    M_POSE,
    M_SEEN,
    M_SHARE,
    M_STOOD,
    M_TURN,
    T_SHARE,
    T_SILENT,
    gap_cycles,
)
from counterflex.runtime.primitives.history import row_at
from counterflex.runtime.state import layout as at
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
CORRECTED_M: Final = 0.5e-3
_LOST, _JUMP = int(Cause.TRACKER_LOST), int(Cause.TRACKER_JUMP)
_FROZEN, _STAMP = int(Cause.TRACKER_FROZEN), int(Cause.TRACKER_STAMP)
_LONGEST = 0.9 * at.RING_ROWS
_LOOK_BACK = (12, 40, 75)


@kernel("float64(float64[:, ::1], int64, float64[::1])")
def _turned(ring: Float, here: int, v: Float) -> float:
    """Largest change of the commanded motion, m per cycle, against what it was up to 0.3 s ago."""
    most = 0.0
    for back in _LOOK_BACK:
        later = ring[(here - back + at.RING_ROWS) % at.RING_ROWS]
        earlier = ring[(here - back - 1 + at.RING_ROWS) % at.RING_ROWS]
        square = 0.0
        for k in range(at.RING_NOMINAL + 9, at.RING_NOMINAL + 12):
            square += (v[k - at.RING_NOMINAL - 9] - later[k] + earlier[k]) ** 2
        most = max(most, square)
    return math.sqrt(most)


@kernel("boolean(float64[::1], int64[::1], float64[:, ::1], int64, float64, float64[::1], float64[::1], float64[::1])")
def stamped_pose(
    given: Float, flags: Int, ring: Float, here: int, behind_s: float, limits: Float, state: Float, out: Float
) -> bool:
    """Commanded pose at the time of a sample, or earlier by what the robot trails its program.

    Args:
        given: Inputs of the cycle.
        flags: Likewise.
        ring: Of the last cycles, with their clock.
        here: Its next row.
        behind_s: How much earlier.
        limits: Of the tests.
        state: Of the step; its work space for a row of the past is written.
        out: (12,) written.

    Returns:
        False where that is longer ago than the loop remembers.
    """
    late = given[at.G_TRACKER_LATE] if given[at.G_TRACKER_LATE] >= 0.0 else limits[L_LATE]
    now = state[at.S_CLOCK] + flags[at.F_ELAPSED]
    newest = (here - 1 + at.RING_ROWS) % at.RING_ROWS
    clock, stamp = now - (late + behind_s) / limits[L_PERIOD], ring[newest, at.RING_CLOCK]
    for k in range(12):
        out[k] = given[at.G_NOMINAL + k]
    if clock >= now:
        return True
    if clock >= stamp:
        u = (clock - stamp) / (now - stamp)
        for k in range(9, 12):
            out[k] = (1.0 - u) * ring[newest, at.RING_NOMINAL + k] + u * out[k]
        return True
    past = state[at.S_PAST : at.S_PAST + at.RING]
    if not row_at(ring, newest, clock, past):
        return False
    for k in range(12):
        out[k] = past[at.RING_NOMINAL + k]
    return True


@kernel("boolean(float64[::1], float64[::1], float64[::1])")
def _repeats(given: Float, stands: Float, memory: Float) -> bool:
    """Whether a sample is the last one bit for bit although the tool has moved since; remembers it otherwise.

    By its program, or by more than :data:`CORRECTED_M` of a correction.
    """
    same = True
    for k in range(12):
        same = same and given[at.G_ACTUAL + k] == memory[M_POSE + k]
    gone = corrected = 0.0
    for k in range(3):
        gone += (stands[k] - memory[M_STOOD + k]) ** 2
        corrected += (stands[3 + k] - memory[M_STOOD + 3 + k]) ** 2
    if same:
        return bool(gone > MOVED_M * MOVED_M or corrected > CORRECTED_M * CORRECTED_M)
    for k in range(12):
        memory[M_POSE + k] = given[at.G_ACTUAL + k]
    for k in range(6):
        memory[M_STOOD + k] = stands[k]
    return False


@kernel(
    "int64(float64[::1], float64[::1], boolean, int64[::1], float64[::1], float64[:, ::1], int64, boolean,"
    " float64[::1], float64[::1], float64[::1], int64[::1], float64[::1], int64[::1], float64[::1])"
)
def sample_doubt(
    given: Float,
    deviation: Float,
    stamped: bool,
    flags: Int,
    state: Float,
    ring: Float,
    here: int,
    corrects: bool,
    in_force: Float,
    expected: Float,
    limits: Float,
    times: Int,
    memory: Float,
    counts: Int,
    work: Float,
) -> int:
    """What a new sample is doubted for; see the module.

    Args:
        given: Inputs of the cycle.
        deviation: (6,) measured minus commanded pose, m and rad, part axes.
        stamped: The commanded pose is that of the sample's own stamp; else that of a sample that is as late as usual.
        flags: Inputs of the cycle.
        state: Of the step, as the last cycle left it.
        ring: Of the last cycles.
        here: Its next row.
        corrects: The correction acts or stands: before, only its stamp and whether it repeats itself is judged.
        in_force: (3,) correction in effect when it was measured.
        expected: (3,) deflection under the known force then.
        limits: Of the tests.
        times: Likewise.
        memory: What they remember; changed.
        counts: Their counters.
        work: (9,) work space.

    Returns:
        Bits ``DOUBT_JUMP``, ``DOUBT_FROZEN``, ``DOUBT_STAMP``, or 0; REPEATED: no news, not to be used.
    """
    period = limits[L_PERIOD]
    before = ring[(here - 1 + at.RING_ROWS) % at.RING_ROWS]
    elapsed = max(1, flags[at.F_ELAPSED])
    v, stands = work[:3], work[3:9]
    speed = 0.0
    for k in range(3):
        v[k] = (given[at.G_NOMINAL + 9 + k] - before[at.RING_NOMINAL + 9 + k]) / elapsed
        stands[k] = given[at.G_ACTUAL + 9 + k] - deviation[k]  # commanded when the sample was measured
        stands[3 + k] = state[at.S_IN_FORCE + k]
        speed += v[k] * v[k]
    speed = math.sqrt(speed)
    late = given[at.G_TRACKER_LATE]
    clock = state[at.S_CLOCK] + flags[at.F_ELAPSED] - max(0.0, late) / period
    if late >= 0.0 and (not late / period <= _LONGEST or (counts[K_KNOWN] == 1 and clock < memory[M_CLOCK] - 0.25)):
        return DOUBT_STAMP
    if _repeats(given, stands, memory):
        counts[K_SAME] += 1
        return DOUBT_FROZEN if counts[K_SAME] >= FROZEN else REPEATED
    counts[K_SAME] = 0
    if not corrects or counts[K_KNOWN] == 0:
        return 0
    turned = 0.0
    for k in range(3):
        turned += (deviation[3 + k] - memory[M_TURN + k]) ** 2
    if not math.sqrt(turned) <= limits[L_FRAME_RAD]:
        return DOUBT_JUMP
    if counts[K_WAITING] == 1 or counts[K_UNSEEN] >= gap_cycles(times, memory):  # its place is judged as a return
        return 0
    later = (late - memory[M_LATE]) / period if not stamped and min(late, memory[M_LATE]) >= 0.0 else 0.0
    dt = max(1.0, clock - memory[M_CLOCK])
    gap = along = change = rate = bent = 0.0
    for k in range(3):
        model = in_force[k] + expected[k]
        difference = deviation[k] - memory[M_SEEN + k] - model + memory[M_MODEL + k] + v[k] * later
        gap += difference * difference
        along += difference * v[k]
        change += (model - memory[M_MODEL + k]) ** 2
        rate += state[at.S_V + k] ** 2
        bent += expected[k] ** 2
    along = abs(along) / speed if speed > 0.0 else 0.0
    across = math.sqrt(max(0.0, gap - along * along))
    unseen = dt if counts[K_WHY] == 0 else min(dt, 1.0 + memory[M_PAUSE])
    bound = SIGMAS * max(LEAST_SIGMA_M, given[at.G_TRACKER_SIGMA]) + min(RATE_M_S * period * unseen, MOST_M)
    bound += math.sqrt(change) + math.sqrt(rate) * period * dt
    bound += 0.2 * speed * min(dt, 2.0) + 2.0 * _turned(ring, here, v) * dt
    # NaN is no agreement.
    return 0 if across <= bound and along <= bound + 2.0 * speed * (dt + 1.0) else DOUBT_JUMP


@kernel(
    "void(int64, float64[::1], float64[::1], int64[::1], float64[::1], float64[::1], int64[::1], float64[::1],"
    " int64[::1])"
)
def count_sample(
    doubt: int,
    given: Float,
    deviation: Float,
    flags: Int,
    state: Float,
    limits: Float,
    times: Int,
    memory: Float,
    counts: Int,
) -> None:
    """Keep the share of the samples that were rejected, and what the next one is held against.

    Args:
        doubt: Bits of :func:`sample_doubt` and of the return after a gap; 0: believed.
        given: Inputs of the cycle.
        deviation: (6,) as there.
        flags: Inputs of the cycle.
        state: Of the step.
        limits: Of the tests.
        times: Likewise.
        memory: What they remember; changed.
        counts: Their counters; changed.
    """
    memory[M_SHARE] += ((1.0 if doubt != 0 else 0.0) - memory[M_SHARE]) / times[T_SHARE]
    if doubt != 0:
        counts[K_REJECTED] += 1
        if doubt & DOUBT_FROZEN:
            counts[K_WHY] = _FROZEN
        elif doubt & DOUBT_STAMP:
            counts[K_WHY] = _STAMP
        elif doubt & DOUBT_JUMP:
            counts[K_WHY] = _JUMP
        if doubt & (DOUBT_FROZEN | DOUBT_STAMP | DOUBT_JUMP):
            counts[K_UNSEEN] += 1
        return
    counts[K_WHY] = counts[K_WITHOUT] = 0
    late = given[at.G_TRACKER_LATE]
    memory[M_LATE] = late
    memory[M_CLOCK] = state[at.S_CLOCK] + flags[at.F_ELAPSED] - max(0.0, late) / limits[L_PERIOD]
    for k in range(3):
        memory[M_TURN + k] = deviation[3 + k]


@kernel("int64(float64[::1], int64[::1], float64[::1], int64[::1])")
def tracker_cause(limits: Float, times: Int, memory: Float, counts: Int) -> int:
    """Why the tracker is not to be relied on any more, or 0: silent for too long, or too many samples rejected."""
    if counts[K_WITHOUT] >= times[T_SILENT] or memory[M_SHARE] > limits[L_SHARE]:
        return counts[K_WHY] if counts[K_WHY] != 0 else _LOST
    return 0
