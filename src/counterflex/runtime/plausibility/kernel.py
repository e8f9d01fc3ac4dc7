"""Tests during operation that tell a wrong sign, a wrong frame or a wrong sensor from ordinary errors. Pure kernels.

What each can see, and what it cannot:

- *answer*: the pose that the controller itself reports, minus the commanded one, must be the correction. It sees a
  correction that is applied in another frame, with another sign or order of axes, or not at all; it needs no tracker.
  It does not see what is wrong with the force sensor or the tracker.
- *residual*: the tracker's deviation must not grow while the correction acts (the sign test, and divergence).
- *frame*: before arming, the tracker must see the tool where the controller says it is.
- *return*: after a broken beam the tracker must go on where the prediction is, else it may be another reflector.
- *direction* and *idle*: what the force shows (:mod:`counterflex.runtime.plausibility.doubts`).
- *step*: the force must not jump where neither plan nor speed do
  (:mod:`counterflex.runtime.plausibility.force_step`), and in a calm cut it must be off the plan as it was in such
  cuts before (:mod:`counterflex.runtime.plausibility.calm_cuts`).
"""

from __future__ import annotations

import math
from typing import Final

from counterflex.core.arrays import Float, Int
from counterflex.core.jit import kernel

# Limits, float64.
L_LEAST: Final = 0  # m: below it neither correction nor deviation says anything
L_ANSWER: Final = 1  # share of the correction that may be missing or too much
L_ANSWER_LATE: Final = 2  # s: how much later than thought the robot may answer a correction
L_FOLLOW_LATE: Final = 3  # s: likewise its path, where the path turns
L_GROWTH: Final = 4  # residual by what it was at the start
L_AGAINST: Final = 5  # share of the correction's change by which the residual may grow against it
L_FRAME_M: Final = 6
L_FRAME_RAD: Final = 7
L_RETURN_M: Final = 8
L_COSINE: Final = 9  # of the largest angle between measured and predicted force
L_FORCE_N: Final = 10  # least force that has a direction
L_IDLE_N: Final = 11
L_IDLE_NM: Final = 12
L_PERIOD: Final = 13
L_MIRRORED: Final = 14  # share by which the residual's change may differ from the correction's mirrored one
L_SHARE: Final = 15  # share of a tracker's last samples that may be rejected
L_LATE: Final = 16  # s, age of a tracker's sample that does not say it
L_STEP_N: Final = 17  # N, step of the residual of the force
L_STEP_PLAN: Final = 18  # share of a change of the planned force that swings on
L_STEP_FADE: Final = 19  # what is left of a swing of the arm after a cycle
L_STEP_TORQUE: Final = 20  # of the variances C_TORQUE: of a single sample
L_STEP_MEMORY: Final = 21  # what is left of a change of the residual after a cycle
LIMITS: Final = 22

# Limits in cycles, int64.
T_ANSWER: Final = 0
T_RESIDUAL: Final = 1
T_GAP: Final = 2  # cycles without a sample after which the return is checked, see gap_cycles
T_RETURN: Final = 3  # samples in a row that must agree
T_DIRECTION: Final = 4
T_IDLE: Final = 5
T_WINDOW: Final = 6  # cycles over which changes of residual and correction are compared
T_SIGN: Final = 7  # samples in a row that mirror the correction; 0: not judged
T_SHARE: Final = 8  # samples over which the share of rejected ones is kept
T_SILENT: Final = 9  # cycles without a believed sample after which the tracker is lost
T_STEP_FEW: Final = 10  # samples of the force in which a step shows
T_STEP_PERIOD: Final = 11  # of the arm's lowest mode
T_STEP_LONG: Final = 12  # over which a slower one is looked for
T_STEP_BACK: Final = 13  # after which it is over
TIMES: Final = 14

# What is remembered, float64.
M_STANDING: Final = 0  # 3: reported minus commanded while nothing is corrected and the robot stands
M_START: Final = 3  # residual before the correction acted
M_EXPECTED: Final = 4  # largest expected deflection, fading
M_SEEN: Final = 5  # 3: last believed deviation
M_MODEL: Final = 8  # 3: correction in effect plus expected deflection then
M_RING: Final = 11  # WINDOW_MOST x 6: residual and correction in effect of the last cycles
WINDOW_MOST: Final = 64
M_FORCE: Final = M_RING + 6 * WINDOW_MOST  # 6: last wrench that was numbers
M_POSE: Final = M_FORCE + 6  # 12: last sample as it came
M_STOOD: Final = M_POSE + 12  # 6: commanded position and correction in effect then
M_TURN: Final = M_STOOD + 6  # 3: orientation of the last believed deviation
M_CLOCK: Final = M_TURN + 3  # when it was measured, cycles of the controller
M_LATE: Final = M_CLOCK + 1  # how late it came, s
M_SHARE: Final = M_LATE + 1  # share of rejected samples
M_PAUSE: Final = M_SHARE + 1  # usual cycles without a sample between two; 0 where one comes in every cycle
STEP_MOST: Final = 256
STEP_ROW: Final = 18
"""Residual (6) and planned force (3) before the filters, way of the tool, torques of the axes (6), change, and the
fading largest of those before."""
M_STEPS: Final = M_PAUSE + 1
M_STEP_BEFORE: Final = M_STEPS + STEP_ROW * STEP_MOST  # 10: mean residual, planned force, way before the step
M_STEP_PLAN: Final = M_STEP_BEFORE + 10  # by how much the planned force has changed recently, fading, N
M_STEP_SWING: Final = M_STEP_PLAN + 1  # likewise the largest force of inertia
M_STEP_SIZE: Final = M_STEP_SWING + 1  # likewise the largest measured force
M_STEP_CHANGE: Final = M_STEP_SIZE + 1  # likewise by how much the residual has changed
M_STEP_NOISE: Final = M_STEP_CHANGE + 1  # variance of a sample, by what changes from one to the next
M_STEP_WORK: Final = M_STEP_NOISE + 1  # 18: work space
CALM_MOST: Final = 16
CALM_ROW: Final = 14
"""Mean residual (6) and planned force (3), feed axes; way of the tool; direction of feed (3); periods seen."""
M_CALM: Final = M_STEP_WORK + 18  # CALM_MOST x CALM_ROW: what calm cuts have shown
M_CALM_SUM: Final = M_CALM + CALM_MOST * CALM_ROW  # 10: of the period that is running
M_CALM_FIRST: Final = M_CALM_SUM + 10  # 4: planned force and way with which it began
M_CALM_SPREAD: Final = M_CALM_FIRST + 4  # 2: largest differences from them
M_CALM_LAST: Final = M_CALM_SPREAD + 2  # 10: means of the period before
M_CALM_OTHER: Final = M_CALM_LAST + 10  # 13: a row without its last: what was told
REMEMBERED: Final = M_CALM_OTHER + 13

# Counters, int64.
K_ANSWER: Final = 0
K_RESIDUAL: Final = 1
K_FRAME: Final = 2  # 1: the last sample was beyond the limits of the frame test
K_UNSEEN: Final = 3  # cycles without a sample
K_WAITING: Final = 4  # 1: after a gap, no sample has been believed yet
K_AGREED: Final = 5
K_DIRECTION: Final = 6
K_IDLE: Final = 7
K_PLACE: Final = 8  # of the ring
K_FILLED: Final = 9
K_AIR: Final = 10  # cycles since the plan last cut
K_KNOWN: Final = 11  # 1: a sample has been believed
K_SOFT: Final = 12  # causes for the next cycle
K_HARD: Final = 13
K_EARLY: Final = 14  # doubts found before the step
K_SIGN: Final = 15
K_REJECTED: Final = 16  # samples of the tracker that were rejected, in all
K_WHY: Final = 17  # cause of the last one, 0 once one has been believed
K_WITHOUT: Final = 18  # cycles since one was believed
K_SAME: Final = 19  # samples in a row that repeat the one before although the tool moves
K_PAUSED: Final = 20  # cycles since a sample came, believed or not
K_STEP: Final = 21  # 1: the force is suspected of a step, 2: told of one
K_STEP_SINCE: Final = 22
K_STEP_BACK: Final = 23
K_STEP_PLACE: Final = 24  # of its ring
K_STEP_FILLED: Final = 25
K_STEP_EVEN: Final = 26  # cycles since plan or speed changed
K_CALM: Final = 27  # samples of the period that is running
K_CALM_LONG: Final = 28  # calm periods in a row
K_CALM_OFF: Final = 29  # of them off what such cuts have shown before
K_CALM_ROWS: Final = 30
K_CALM_TOLD: Final = 31  # 1: told
K_CALM_AIR: Final = 32  # cycles in air since, in which the sensor shows nothing
COUNTS: Final = 33

# Bits that say what is doubted.
DOUBT_ANSWER: Final = 1
DOUBT_RESIDUAL: Final = 2
DOUBT_FRAME: Final = 4
DOUBT_TRACKER: Final = 8
"""No sample: its part of the correction stands still."""
DOUBT_DIRECTION: Final = 16
DOUBT_IDLE: Final = 32
DOUBT_BRIDGED: Final = 128
"""No force: the plan alone goes on for a while."""
DOUBT_RETURN: Final = 64
"""The sample is not what was predicted after a gap: it is not used."""

DOUBT_JUMP: Final = 256
"""The sample is not where the tool can be: it is not used."""
DOUBT_FROZEN: Final = 512
"""The sample is the last one bit for bit although the tool has moved: it is not used."""
DOUBT_STAMP: Final = 1024
"""The sample's time stamp cannot be: it is not used."""
DOUBT_STEP: Final = 2048
"""The measured force has made a step that neither plan nor speed explains: the plan goes on with what it was before."""
DOUBT_OFFSET: Final = 4096
"""It stands off so: the sensor's zero has jumped, or it is another cut."""
DOUBT_DIFFERS: Final = 8192
"""In a calm cut it is off the plan otherwise than in such cuts before: deeper stock, another material, or its zero."""

_FADE = 0.98
_SETTLE = 0.05


@kernel("float64(float64[::1])")
def _norm(x: Float) -> float:
    return math.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])


@kernel(
    "boolean(float64[::1], float64[::1], float64[::1], float64[::1], float64, float64[::1], boolean, float64[::1],"
    " int64[::1], float64[::1], int64[::1])"
)
def answer_is_wrong(
    difference: Float,
    in_effect: Float,
    moved: Float,
    moved_before: Float,
    change_m_s: float,
    work: Float,
    corrects: bool,
    limits: Float,
    times: Int,
    memory: Float,
    counts: Int,
) -> bool:
    """Whether the robot does something else than the correction it is sent (R19, WRONG_FRAME).

    ``|P (r - r0 - c)| > max(L, s |c|) + t_c |dc/dt| + t_f |v| sin(turn)`` over T_ANSWER cycles in a row, with r the
    reported minus the commanded position, r0 the same at rest without a correction, c the correction in effect, P the
    projection across the motion (along it the robot lags), v the speed and ``turn`` how far the path has turned lately.

    Args:
        difference: (3,) r, m, part axes.
        in_effect: (3,) c as the loop computes it, m, part axes.
        moved: (3,) way of the commanded point over the last cycles, m.
        moved_before: (3,) the same some time ago, over as many cycles.
        change_m_s: Speed at which the correction changes.
        work: (3,) work space.
        corrects: The correction may act: r0 is not learnt.
        limits: (LIMITS,).
        times: (TIMES,).
        memory: (REMEMBERED,); changed.
        counts: (COUNTS,); changed.

    Returns:
        Whether it has lasted long enough to be a fault.
    """
    way, before = _norm(moved), _norm(moved_before)
    size = _norm(in_effect)
    least = limits[L_LEAST]
    if not corrects and size < 1e-6 and way < 1e-6:
        for k in range(3):
            memory[M_STANDING + k] += _SETTLE * (difference[k] - memory[M_STANDING + k])
    if size < least:
        counts[K_ANSWER] = 0
        return False
    along = 0.0
    for k in range(3):
        work[k] = difference[k] - memory[M_STANDING + k] - in_effect[k]
        along += work[k] * moved[k]
    turn = 0.0
    if way > 1e-6:
        for k in range(3):
            work[k] -= along * moved[k] / (way * way)
        if before > 1e-6:
            cosine = 0.0
            for k in range(3):
                cosine += moved[k] * moved_before[k]
            cosine = min(1.0, max(-1.0, cosine / (way * before)))
            turn = math.sqrt(max(0.0, 1.0 - cosine * cosine)) if cosine > 0.0 else 1.0
    speed = max(way, before) / (times[T_WINDOW] * limits[L_PERIOD])
    bound = max(least, limits[L_ANSWER] * size)
    bound += limits[L_ANSWER_LATE] * change_m_s + limits[L_FOLLOW_LATE] * speed * turn
    # NaN is no agreement.
    counts[K_ANSWER] = 0 if _norm(work) <= bound else counts[K_ANSWER] + 1
    return bool(counts[K_ANSWER] >= times[T_ANSWER])


@kernel("boolean(float64[::1], float64[::1], float64, boolean, float64[::1], int64[::1], float64[::1], int64[::1])")
def residual_grows(
    deviation: Float,
    in_effect: Float,
    expected_m: float,
    active: bool,
    limits: Float,
    times: Int,
    memory: Float,
    counts: Int,
) -> bool:
    """Whether the tracker's deviation grows under the correction (R19: sign test, DIVERGENCE).

    Counted are samples with ``|d| > 0.1 mm`` and ``|d| > 1.5 max(start, expected)``: start is the residual before the
    correction acted, expected the deflection under the force that is known. A deviation can also grow by itself; so a
    sample counts only where the residual moves against the correction, over T_WINDOW cycles: ``dd . dc < -a |dc|^2``.
    A right correction gives ``dd = dc`` plus what the process adds, a wrong sign ``dd = -dc``.

    That mirror image is judged sooner: ``|d| > 0.1 mm`` and ``|dd + dc| < 0.2 |dc|`` over T_SIGN samples in a row.
    A process under a right correction would have to grow by ``dp = -2 dc`` to look so. While an integrator of gain K
    per second follows a ramp or a sine it does for 0.2 / K s at most; T_SIGN is twice that.

    Args:
        deviation: (3,) d across the feed, m, part axes: a new sample.
        in_effect: (3,) correction in effect, as the loop computes it.
        expected_m: Size of the deflection under the known force; 0 where none is known.
        active: The correction acts.
        limits: (LIMITS,).
        times: (TIMES,).
        memory: (REMEMBERED,); changed.
        counts: (COUNTS,); changed.

    Returns:
        Whether it has lasted long enough to be a fault.
    """
    size = _norm(deviation)
    window = times[T_WINDOW]
    place = counts[K_PLACE]
    old = M_RING + 6 * place
    against = mirrored = False
    if counts[K_FILLED] >= window:
        both = square = apart = 0.0
        for k in range(3):
            change = in_effect[k] - memory[old + 3 + k]
            grown = deviation[k] - memory[old + k]
            both += change * grown
            square += change * change
            apart += (grown + change) ** 2
        tells = math.sqrt(square) > 0.3 * limits[L_LEAST]
        against = tells and both < -limits[L_AGAINST] * square
        mirrored = tells and apart < limits[L_MIRRORED] ** 2 * square
    for k in range(3):
        memory[old + k], memory[old + 3 + k] = deviation[k], in_effect[k]
    counts[K_PLACE] = (place + 1) % window
    counts[K_FILLED] = min(window, counts[K_FILLED] + 1)
    memory[M_EXPECTED] = max(expected_m, _FADE * memory[M_EXPECTED])
    if not active:
        memory[M_START] += _SETTLE * (size - memory[M_START])
        counts[K_RESIDUAL] = counts[K_SIGN] = 0
        return False
    start = max(memory[M_START], memory[M_EXPECTED])
    bad = size > limits[L_LEAST] and size > limits[L_GROWTH] * start and against
    counts[K_RESIDUAL] = counts[K_RESIDUAL] + 1 if bad else 0
    counts[K_SIGN] = counts[K_SIGN] + 1 if size > limits[L_LEAST] and mirrored else 0
    wrong_sign = times[T_SIGN] > 0 and counts[K_SIGN] >= times[T_SIGN]
    return bool(wrong_sign or counts[K_RESIDUAL] >= times[T_RESIDUAL])


@kernel("boolean(float64[::1], boolean, float64[::1], int64[::1])")
def frame_is_wrong(deviation: Float, moves: bool, limits: Float, counts: Int) -> bool:
    """Whether the tracker sees the tool elsewhere than where the controller says it is (R19, before arming).

    A robot that moves trails its program: then a sample can only prove the frame, not disprove it.

    Args:
        deviation: (6,) measured minus commanded pose, m and rad: a new sample.
        moves: The robot moves.
        limits: (LIMITS,).
        counts: (COUNTS,); changed.

    Returns:
        Whether the last sample that could be judged lay beyond 2 mm or 0.2 deg.
    """
    angle = math.sqrt(deviation[3] ** 2 + deviation[4] ** 2 + deviation[5] ** 2)
    if _norm(deviation) <= limits[L_FRAME_M] and angle <= limits[L_FRAME_RAD]:
        counts[K_FRAME] = 0
    elif not moves:
        counts[K_FRAME] = 1
    return bool(counts[K_FRAME] == 1)


@kernel("int64(int64[::1], float64[::1])")
def gap_cycles(times: Int, memory: Float) -> int:
    """Cycles without a believed sample that are a gap: T_GAP, or three usual pauses of a tracker that sends seldom."""
    return int(max(times[T_GAP], math.ceil(3.0 * memory[M_PAUSE])))


@kernel(
    "boolean(float64[::1], float64[::1], float64[::1], boolean, float64[::1], int64[::1], float64[::1], int64[::1])"
)
def return_is_believed(
    deviation: Float,
    in_effect: Float,
    expected: Float,
    corrects: bool,
    limits: Float,
    times: Int,
    memory: Float,
    counts: Int,
) -> bool:
    """Whether a tracker's sample may be used: after a gap only where it goes on as predicted (R18).

    Prediction: the last believed deviation plus how correction in effect and expected deflection have changed since.
    T_RETURN samples in a row must lie within 0.2 mm of it; the first of all samples within the limit of the frame
    test. While nothing is corrected every sample is believed: the
    frame test judges it.

    Args:
        deviation: (3,) m, part axes: a new sample.
        in_effect: (3,) correction in effect.
        expected: (3,) deflection under the known force.
        corrects: The correction acts or stands.
        limits: (LIMITS,).
        times: (TIMES,).
        memory: (REMEMBERED,); changed.
        counts: (COUNTS,); changed.
    """
    if counts[K_UNSEEN] >= gap_cycles(times, memory):
        counts[K_WAITING], counts[K_AGREED] = 1, 0
    counts[K_UNSEEN] = 0
    if not corrects:
        counts[K_WAITING] = 0
    if counts[K_WAITING] == 1:
        gap, least, largest = 0.0, times[T_RETURN], limits[L_RETURN_M]
        for k in range(3):
            predicted = memory[M_SEEN + k] + in_effect[k] + expected[k] - memory[M_MODEL + k]
            gap += (deviation[k] - predicted) ** 2
        if counts[K_KNOWN] == 0:
            gap, least, largest = _norm(deviation) ** 2, 1, limits[L_FRAME_M]
        counts[K_AGREED] = counts[K_AGREED] + 1 if math.sqrt(gap) <= largest else 0
        if counts[K_AGREED] < least:
            return False
        counts[K_WAITING] = 0
        counts[K_FILLED] = 0
    counts[K_KNOWN] = 1
    for k in range(3):
        memory[M_SEEN + k], memory[M_MODEL + k] = deviation[k], in_effect[k] + expected[k]
    return True
