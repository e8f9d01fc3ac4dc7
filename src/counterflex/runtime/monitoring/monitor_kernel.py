"""Process monitoring: one call per cycle after the step. Pure; the same inputs give the same outputs bit for bit.

Force in the feed frame, measured and predicted through the same filter (two equal first-order stages, whose impulse
response is nowhere negative: what is between two bounds stays between the filtered bounds), and five detectors:

- *missing cut*: the plan's least force about here, less the model's error, lies above twice the noise, and the measured
  size lies below once the noise, over a length of path. Both hypotheses then err at the same stated rate.
- *overload*: measured size above the plan's largest force about here times ``1 + model error``, plus noise, plus
  margin; or the force (moment) of a cycle above the limit of spindle and tool.
- *wear*: cumulative sum and trend of the ratio, :mod:`counterflex.runtime.monitoring.wear`.
- *breakage*: in a stretch that the plan says is steady the ratio drops at once. By more than half of what one tooth
  carries (:func:`counterflex.runtime.monitoring.plan.lost_tooth`) counts where at the same time the amplitude once per
  turn rises by force; without that sign, or where it cannot be told, by twice of what one tooth carries; by half of
  all force in any case.
- *chatter*: energy of the samples that is neither slow nor a harmonic of the spindle, against what it is out of the
  cut, plus a share of the largest force to be expected, plus what slow force leaves in it.
- *low chatter*: slow vibration of the force that does not die away where the plan is steady.

What the sensor shows without a cut is learnt out of the cut, :mod:`counterflex.runtime.monitoring.air_noise`.
"""

from __future__ import annotations

import math
from typing import Final

from counterflex.core.arrays import Float, Int
from counterflex.core.jit import kernel
from counterflex.runtime.monitoring import layout as ml
from counterflex.runtime.monitoring.air_noise import follow_motion, learn_quiet, noise, quiet_force, two_stages
from counterflex.runtime.monitoring.detectors import breakage, chatter, judge, low_chatter, wear
from counterflex.runtime.monitoring.feed_frame import feed_frame
from counterflex.runtime.primitives.localize import PLAN_V
from counterflex.runtime.state import layout as at
from counterflex.runtime.state.supervisor import Cause, State

AIR_N: Final = 1.0
"""Largest predicted force that still is no cut."""
LEAP_M: Final = 10e-3
"""The place on the plan was sought anew where it went farther than this in a cycle."""
RATE_S: Final = 0.04
_MISSING, _OVERLOAD, _WEAR = int(ml.Event.MISSING_CUT), int(ml.Event.OVERLOAD), int(ml.Event.WEAR)
_FIRST_CAUSE = int(Cause.PROCESS_MISSING_CUT)
_ARMED, _FAULT = int(State.ARMED), int(State.FAULT)
# Places in the work space.
_FRAME: Final = 0  # 9
_NOW: Final = 9  # 3: predicted force of this cycle, part axes
_LOWEST, _HIGHEST = 12, 13  # its bounds
_PREDICTED, _RATIO = 14, 15
WORK: Final = 16


@kernel("boolean(float64[::1], int64[::1], int64[::1])")
def _whole(given: Float, flags: Int, choices: Int) -> bool:
    """A telegram came, and force and pose are numbers and fresh."""
    good = flags[at.F_ELAPSED] > 0 and flags[at.F_FORCE_AGE] < choices[ml.W_STALE]
    for k in range(6):
        good = good and math.isfinite(given[at.G_W + k])
    for k in range(12):
        good = good and math.isfinite(given[at.G_NOMINAL + k])
    return bool(good)


@kernel("float64(float64, float64, int64, float64, float64[::1], int64[::1])")
def _progress(time: float, distance: float, elapsed: int, period: float, state: Float, whole: Int) -> float:
    """Way along the plan since the last cycle, m; follows its speed by the programmed one."""
    moved = 0.0
    if whole[ml.N_STARTED] == 1:
        moved = max(0.0, distance - state[ml.S_LAST_DISTANCE])
        moved = moved if moved < LEAP_M else 0.0
        rate = max(0.0, time - state[ml.S_LAST_TIME]) / (elapsed * period)
        kept = math.exp(-period / RATE_S)
        state[ml.S_RATE] = kept * state[ml.S_RATE] + (1.0 - kept) * min(rate, 2.0)
    else:
        state[ml.S_RATE], whole[ml.N_STARTED] = 1.0, 1
    state[ml.S_LAST_TIME], state[ml.S_LAST_DISTANCE] = time, distance
    return moved


@kernel("void(float64[::1], int64, float64[::1], float64[::1], float64, float64, float64[::1])")
def _expect(here: Float, planned: int, there: Float, constants: Float, u: float, rate: float, work: Float) -> None:
    """Predicted force of this cycle and its bounds at the present speed."""
    for k in range(5):
        work[_NOW + k] = 0.0
    if planned == 1:
        slower = min(max(rate, 0.0), 1.5) ** constants[ml.C_EXPONENT]
        for k in range(3):
            work[_NOW + k] = ((1.0 - u) * here[ml.P_FORCE + k] + u * there[ml.P_FORCE + k]) * slower
        work[_LOWEST] = min(here[ml.P_LOW], there[ml.P_LOW]) * slower
        # going slower never narrows the bound
        work[_HIGHEST] = max(here[ml.P_HIGH], there[ml.P_HIGH]) * max(1.0, slower)


@kernel("float64(float64[::1], float64[::1], float64[::1], float64[::1], float64[::1])")
def _filter_forces(given: Float, constants: Float, state: Float, results: Float, work: Float) -> float:
    """Forces through the filter, in the feed frame, and their ratio; returns the size of the measured one, N."""
    keep = constants[ml.C_KEEP]
    size = 0.0
    for k in range(3):
        w = given[at.G_W + k]
        size += w * w
        two_stages(state, ml.S_FORCE + 2 * k, w, keep)
        two_stages(state, ml.S_EXPECTED + 2 * k, work[_NOW + k], keep)
    size = math.sqrt(size)
    two_stages(state, ml.S_SIZE, size, keep)
    two_stages(state, ml.S_LOW, work[_LOWEST], keep)
    two_stages(state, ml.S_HIGH, work[_HIGHEST], keep)
    product = square = 0.0
    for k in range(3):
        f = e = 0.0
        for j in range(3):
            f += work[_FRAME + 3 * k + j] * state[ml.S_FORCE + 2 * j + 1]
            e += work[_FRAME + 3 * k + j] * state[ml.S_EXPECTED + 2 * j + 1]
        results[ml.R_FORCE + k], results[ml.R_EXPECTED + k] = f, e
        product += f * e
        square += e * e
    work[_PREDICTED] = math.sqrt(square)
    work[_RATIO] = product / square if work[_PREDICTED] > constants[ml.C_LEAST] else 0.0
    results[ml.R_SIZE], results[ml.R_RATIO] = state[ml.S_SIZE + 1], work[_RATIO]
    return size


@kernel("void(float64[::1], float64, float64, int64, float64[::1], int64[::1], int64[::1], float64[::1], int64[::1])")
def _overload(
    given: Float,
    size: float,
    ceiling: float,
    planned: int,
    constants: Float,
    choices: Int,
    whole: Int,
    results: Float,
    outcome: Int,
) -> None:
    """Filtered force above what the plan explains, or force or moment of the cycle above what is allowed."""
    moment = 0.0
    for k in range(3):
        moment += given[at.G_W + 3 + k] ** 2
    moment = math.sqrt(moment)
    value, limit = results[ml.R_SIZE], ceiling if planned == 1 else 0.0
    top = max(size / constants[ml.C_LIMIT_N], moment / constants[ml.C_LIMIT_NM])
    if top > 1.0 or (planned == 0 and top > 0.0):  # the tighter of both bounds is shown
        value, limit = top * constants[ml.C_LIMIT_N], constants[ml.C_LIMIT_N]
        if not math.isfinite(limit):
            value, limit = top * constants[ml.C_LIMIT_NM], constants[ml.C_LIMIT_NM]
    judge(results, outcome, whole, choices, _OVERLOAD, value, limit, choices[ml.W_CYCLES])


@kernel("void(int64[::1], int64[::1], int64[::1], int64[::1])")
def _react(step_outcome: Int, choices: Int, whole: Int, outcome: Int) -> None:
    """Ask for what the events of the cycle are to do, if the loop is armed; until a person resets."""
    before = step_outcome[at.O_STATE]
    for event in range(ml.EVENTS):
        if outcome[ml.O_NEW] & (1 << event) and _ARMED <= before < _FAULT:
            if choices[ml.W_REACTION + event] == 1 and whole[ml.N_HOLD] == 0:
                whole[ml.N_HOLD] = _FIRST_CAUSE + event
            elif choices[ml.W_REACTION + event] == 2 and whole[ml.N_STOP] == 0:
                whole[ml.N_STOP] = _FIRST_CAUSE + event
    if whole[ml.N_HOLD] != 0:
        step_outcome[at.O_FEED_HOLD] = 1
    outcome[ml.O_ON] = whole[ml.N_ON]


@kernel(
    "void(float64[::1], int64[::1], float64[::1], int64[::1], float64[::1], float64[:, ::1], float64[:, ::1],"
    " float64[::1], float64[::1], int64[::1], float64[::1], int64[::1], float64[::1], int64[::1], float64[::1])"
)
def watch(
    given: Float,
    flags: Int,
    step_results: Float,
    step_outcome: Int,
    place: Float,
    path: Float,
    plan: Float,
    fast: Float,
    constants: Float,
    choices: Int,
    state: Float,
    whole: Int,
    results: Float,
    outcome: Int,
    work: Float,
) -> None:
    """One cycle; see the module and :class:`counterflex.runtime.monitoring.monitor.Monitor`, which owns the arrays.

    Args:
        given: (at.GIVEN,) inputs of the step.
        flags: (at.FLAGS,) likewise.
        step_results: (at.RESULTS,) results of the step.
        step_outcome: (at.OUTCOME,) likewise; a feed hold that is asked for is written.
        place: (2,) on the plan, row and fraction.
        path: (n, PLAN_COLUMNS) the plan as the step has it.
        plan: (n, P_COLUMNS) of :func:`counterflex.runtime.monitoring.plan.monitor_plan`.
        fast: (FAST,) of the force sensor's samples.
        constants: (CONSTANTS,).
        choices: (CHOICES,).
        state: (STATE,); changed.
        whole: (WHOLE,); changed.
        results: (RESULTS,) written.
        outcome: (OUTCOME,) written.
        work: (WORK,) work space.
    """
    outcome[ml.O_NEW] = outcome[ml.O_SEEN] = 0
    if flags[at.F_RESET] == 1:
        whole[ml.N_ON] = whole[ml.N_HOLD] = whole[ml.N_STOP] = whole[ml.N_STEADY] = 0
        for k in range(ml.EVENTS):
            whole[ml.N_COUNT + k] = 0
        state[ml.S_CUSUM] = state[ml.S_BLIND] = 0.0
    if _whole(given, flags, choices):
        planned = choices[ml.W_PLAN] == 1 and place[0] >= 0.0 and step_results[at.R_PATH] <= constants[ml.C_OFF_PATH]
        row = max(0, int(place[0])) if choices[ml.W_PLAN] == 1 else 0
        u = place[1]
        here, there = plan[row], plan[min(row + 1, plan.shape[0] - 1)]
        feed_frame(
            path[row, PLAN_V], path[row, PLAN_V + 1], path[row, PLAN_V + 2],
            -given[at.G_NOMINAL + 2], -given[at.G_NOMINAL + 5], -given[at.G_NOMINAL + 8],
            state[ml.S_FEED : ml.S_FEED + 6], work,
        )  # fmt: skip
        moved = 0.0
        if planned:
            time = (1.0 - u) * here[ml.P_TIME] + u * there[ml.P_TIME]
            results[ml.R_DISTANCE] = (1.0 - u) * here[ml.P_DISTANCE] + u * there[ml.P_DISTANCE]
            moved = _progress(
                time, results[ml.R_DISTANCE], flags[at.F_ELAPSED], constants[ml.C_PERIOD], state, whole
            )  # fmt: skip
        rate = state[ml.S_RATE]
        results[ml.R_RATE] = rate
        _expect(here, int(planned), there, constants, u, rate, work)
        highest = work[_HIGHEST]
        size = _filter_forces(given, constants, state, results, work)
        filtered, least, most = state[ml.S_SIZE + 1], state[ml.S_LOW + 1], state[ml.S_HIGH + 1]
        predicted, ratio = work[_PREDICTED], work[_RATIO]
        # What no cut needs, and what no cut explains.
        follow_motion(given, step_results, flags[at.F_ELAPSED], constants, state, whole)
        quiet, rest = quiet_force(constants, state, whole), noise(constants, state, whole)
        ceiling = most * (1.0 + constants[ml.C_MODEL]) + quiet + constants[ml.C_MARGIN]
        idle = planned and most < AIR_N and highest < AIR_N
        if idle and filtered < ceiling:
            learn_quiet(filtered, constants, state, whole)
        results[ml.R_MOST] = ceiling if planned else 0.0
        visible = planned and least * (1.0 - constants[ml.C_MODEL]) > 2.0 * quiet
        results[ml.R_LEAST] = quiet if visible else 0.0
        if visible:
            state[ml.S_BLIND] = state[ml.S_BLIND] + moved if filtered < quiet else 0.0
        judge(results, outcome, whole, choices, _MISSING, state[ml.S_BLIND],
            constants[ml.C_MISSING] if visible else 0.0, 1,
        )  # fmt: skip
        _overload(given, size, ceiling, int(planned), constants, choices, whole, results, outcome)
        cutting = planned and least > constants[ml.C_LEAST]
        if cutting:
            state[ml.S_CUT] += moved
        results[ml.R_CUT] = state[ml.S_CUT]
        steady = planned and here[ml.P_STEADY] > 0.5 and there[ml.P_STEADY] > 0.5 and predicted > constants[ml.C_LEAST]
        steady = steady and 0.8 < rate < 1.2
        if planned and int(here[ml.P_TOOL]) != whole[ml.N_TOOL]:
            whole[ml.N_TOOL] = int(here[ml.P_TOOL])
            for k in range(ml.S_CUT, ml.S_PEAK):
                state[k] = 0.0
            whole[ml.N_ON] &= ~(1 << _WEAR)
        wear(constants, state, whole, results, outcome, choices, ratio, ratio * predicted**2, predicted**2,
            moved if cutting else 0.0, rate,
        )  # fmt: skip
        breakage(constants, choices, state, whole, results, outcome, here, fast, ratio, predicted, rest, steady)
        chatter(constants, choices, state, whole, results, outcome, fast, max(most, filtered), idle)
        low_chatter(
            given, constants, choices, state, whole, results, outcome, work[_NOW : _NOW + 3], predicted, rest, steady
        )  # fmt: skip
    _react(step_outcome, choices, whole, outcome)


@kernel("void(int64[::1], int64[::1])")
def hand_over(whole: Int, flags: Int) -> None:
    """Hand what was found before to the supervisor: causes of hold and fault, where there are no others.

    Args:
        whole: (WHOLE,) of :func:`watch`.
        flags: (at.FLAGS,) inputs of the step; changed.
    """
    if whole[ml.N_HOLD] != 0 and flags[at.F_SOFT] == 0:
        flags[at.F_SOFT] = whole[ml.N_HOLD]
    if whole[ml.N_STOP] != 0 and flags[at.F_HARD] == 0:
        flags[at.F_HARD] = whole[ml.N_STOP]
