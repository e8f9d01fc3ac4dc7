"""Detectors of process monitoring with a memory of their own (wear, breakage, chatter), and how an event is made."""

from __future__ import annotations

import math
from typing import Final

from counterflex.core.arrays import Float, Int
from counterflex.core.jit import kernel
from counterflex.runtime.monitoring import layout as ml
from counterflex.runtime.monitoring.air_noise import IDLE_LEARNT, IDLE_S
from counterflex.runtime.monitoring.fast_force import SLOWER
from counterflex.runtime.monitoring.wear import add_ratio, force_class, normal_of_student, trend
from counterflex.runtime.state import layout as at

PEAK_S: Final = 0.15
"""How long a force counts for the vibration that comes from it."""
LEVEL_S: Final = 0.16
"""Memory of the mean about which a force vibrates slowly: what is below 1 Hz is none."""
SLOW_S: Final = 0.12
"""Memory of the energy of slow vibration."""
_SLOW_S: Final = 1.0
_DOUBT: Final = 250  # cycles after which a lower ratio that was no event becomes the new reference
_WEAR, _BREAKAGE, _CHATTER = int(ml.Event.WEAR), int(ml.Event.BREAKAGE), int(ml.Event.CHATTER)
_LOW_CHATTER = int(ml.Event.LOW_CHATTER)
_LATCHED = (1 << _BREAKAGE) | (1 << _WEAR)


@kernel("void(float64[::1], int64[::1], int64[::1], int64[::1], int64, float64, float64, int64)")
def judge(
    results: Float,
    outcome: Int,
    whole: Int,
    choices: Int,
    event: int,
    value: float,
    limit: float,
    cycles: int,
) -> None:
    """One detector: value above limit for so many cycles in a row is an event; it may come again after a pause.

    Args:
        results: (RESULTS,) value and limit are written.
        outcome: (OUTCOME,) bits are written.
        whole: (WHOLE,) counters; changed.
        choices: (CHOICES,).
        event: Which.
        value: What is watched.
        limit: Not above 0: cannot be seen at present, the counter stands still.
        cycles: In a row.
    """
    bit = 1 << event
    results[ml.R_VALUE + event] = value
    if limit <= 0.0:
        results[ml.R_LIMIT + event] = 0.0
        return
    results[ml.R_LIMIT + event] = limit
    outcome[ml.O_SEEN] |= bit
    if value > limit:
        whole[ml.N_COUNT + event] += 1
        whole[ml.N_GONE + event] = 0
        if whole[ml.N_COUNT + event] >= cycles and not whole[ml.N_ON] & bit:
            whole[ml.N_ON] |= bit
            outcome[ml.O_NEW] |= bit
    else:
        whole[ml.N_COUNT + event] = 0
        whole[ml.N_GONE + event] += 1
        if whole[ml.N_GONE + event] >= choices[ml.W_CLEAR] and not bit & _LATCHED:
            whole[ml.N_ON] &= ~bit


@kernel(
    "void(float64[::1], float64[::1], int64[::1], float64[::1], int64[::1], int64[::1], float64, float64, float64,"
    " float64, float64)"
)
def wear(
    constants: Float,
    state: Float,
    whole: Int,
    results: Float,
    outcome: Int,
    choices: Int,
    ratio: float,
    product: float,
    square: float,
    moved: float,
    rate: float,
) -> None:
    """Collect ratios by length of cut; judge the rise once sum and trend both say that there is one."""
    classes = state[ml.S_CLASS : ml.S_CLASS + ml.CLASSES * ml.CLASS].reshape((ml.CLASSES, ml.CLASS))
    serial = state[ml.S_SERIAL : ml.S_SERIAL + 4]
    if ratio != 0.0 and moved > 0.0 and 0.8 < rate < 1.2:
        state[ml.S_BIN] += product * moved
        state[ml.S_BIN + 1] += square * moved
        state[ml.S_BIN + 2] += moved
        if state[ml.S_BIN + 2] >= constants[ml.C_BIN]:
            force = math.sqrt(state[ml.S_BIN + 1] / state[ml.S_BIN + 2])
            middle = state[ml.S_CUT] - 0.5 * state[ml.S_BIN + 2]
            found = state[ml.S_BIN] / state[ml.S_BIN + 1]
            state[ml.S_CUSUM] = add_ratio(classes, serial, force_class(force), middle, found, state[ml.S_CUSUM])
            for k in range(3):
                state[ml.S_BIN + k] = 0.0
    trend(classes, serial, state[ml.S_CUT], results[ml.R_TREND : ml.R_TREND + 4])
    rise = results[ml.R_RISE]
    seen = results[ml.R_TREND_DEGREES] > 0.0 and state[ml.S_CUSUM] > constants[ml.C_CUSUM]
    if seen:
        t = results[ml.R_TREND] / results[ml.R_TREND_SIGMA]
        seen = normal_of_student(t, results[ml.R_TREND_DEGREES]) > constants[ml.C_TREND]
    judge(results, outcome, whole, choices, _WEAR, rise, constants[ml.C_RISE] if seen else 0.0, 1)
    if not seen:
        results[ml.R_VALUE + _WEAR] = rise


@kernel(
    "void(float64[::1], int64[::1], float64[::1], int64[::1], float64[::1], int64[::1], float64[::1], float64[::1],"
    " float64, float64, float64, boolean)"
)
def breakage(
    constants: Float,
    choices: Int,
    state: Float,
    whole: Int,
    results: Float,
    outcome: Int,
    here: Float,
    fast: Float,
    ratio: float,
    predicted: float,
    noise: float,
    steady: bool,
) -> None:
    """A drop of the ratio against its own past in a steady stretch."""
    turn = fast[ml.F_TURN] / predicted if predicted > 0.0 else 0.0
    if not steady:
        whole[ml.N_STEADY] = 0
        judge(results, outcome, whole, choices, _BREAKAGE, 0.0, 0.0, choices[ml.W_CYCLES + 1])
        return
    whole[ml.N_STEADY] += 1
    n = whole[ml.N_STEADY]
    if n == 1:
        state[ml.S_RATIO], state[ml.S_TURN] = ratio, turn
        state[ml.S_RATIO_VARIANCE] = state[ml.S_TURN_VARIANCE] = 0.0
    floor = noise / predicted
    spread = math.sqrt(state[ml.S_RATIO_VARIANCE] + floor * floor)
    turn_spread = math.sqrt(state[ml.S_TURN_VARIANCE] + (constants[ml.C_FAST_NOISE] * 0.3 / predicted) ** 2)
    reference = state[ml.S_RATIO]
    drop, limit = 0.0, 0.0
    ready = n > choices[ml.W_SETTLE] and reference > 0.1
    if ready:
        drop = 1.0 - ratio / reference
        scatter = constants[ml.C_Z] * spread / reference
        tooth = here[ml.P_DROP] if here[ml.P_TEETH] > 0.0 else 0.25
        told = fast[ml.F_READY] > 0.5 and fast[ml.F_SEPARATE] > 0.5
        rose = told and turn > state[ml.S_TURN] + constants[ml.C_Z] * turn_spread
        limit = min(0.5, max(0.5 * tooth if rose else 2.0 * tooth, scatter))
        if limit < scatter:
            limit = 0.0
    judge(results, outcome, whole, choices, _BREAKAGE, drop, limit, choices[ml.W_CYCLES + 1])
    suspicious = limit > 0.0 and drop > 0.4 * here[ml.P_DROP] and drop > 0.5 * constants[ml.C_Z] * spread / reference
    whole[ml.N_DOUBT] = whole[ml.N_DOUBT] + 1 if suspicious else 0
    if not suspicious or whole[ml.N_DOUBT] > _DOUBT:
        share = max(constants[ml.C_PERIOD] / _SLOW_S, 1.0 / n)
        state[ml.S_RATIO_VARIANCE] += share * ((ratio - reference) ** 2 - state[ml.S_RATIO_VARIANCE])
        state[ml.S_TURN_VARIANCE] += share * ((turn - state[ml.S_TURN]) ** 2 - state[ml.S_TURN_VARIANCE])
        state[ml.S_RATIO] += share * (ratio - reference)
        state[ml.S_TURN] += share * (turn - state[ml.S_TURN])


@kernel(
    "void(float64[::1], int64[::1], float64[::1], int64[::1], float64[::1], int64[::1], float64[::1], float64, boolean)"
)
def chatter(
    constants: Float,
    choices: Int,
    state: Float,
    whole: Int,
    results: Float,
    outcome: Int,
    fast: Float,
    force: float,
    idle: bool,
) -> None:
    """Energy that does not turn with the spindle against that out of the cut, a share of the force, what is slower."""
    ready = fast[ml.F_READY] > 0.5
    energy = fast[ml.F_RESIDUAL] ** 2
    slower = (SLOWER * fast[ml.F_SLOWER]) ** 2
    floor = constants[ml.C_FAST_NOISE] ** 2
    if ready and idle:
        whole[ml.N_IDLE_FAST] += 1
        share = max(constants[ml.C_PERIOD] / IDLE_S, 1.0 / whole[ml.N_IDLE_FAST])
        state[ml.S_IDLE_FAST] += share * (max(0.0, energy - slower) - state[ml.S_IDLE_FAST])
    if whole[ml.N_IDLE_FAST] >= IDLE_LEARNT:
        floor = max(floor, state[ml.S_IDLE_FAST])
    # The vibration is remembered longer than the force: at an exit it is judged by the force it comes from.
    state[ml.S_PEAK] = max(force, state[ml.S_PEAK] * math.exp(-constants[ml.C_PERIOD] / PEAK_S))
    quiet = floor + (constants[ml.C_CHATTER] * state[ml.S_PEAK]) ** 2
    limit = math.sqrt(quiet * constants[ml.C_QUANTILE] + slower) if ready else 0.0
    judge(results, outcome, whole, choices, _CHATTER, fast[ml.F_RESIDUAL], limit, choices[ml.W_CYCLES + 2]
    )  # fmt: skip


@kernel(
    "void(float64[::1], float64[::1], int64[::1], float64[::1], int64[::1], float64[::1], int64[::1], float64[::1],"
    " float64, float64, boolean)"
)
def low_chatter(
    given: Float,
    constants: Float,
    choices: Int,
    state: Float,
    whole: Int,
    results: Float,
    outcome: Int,
    expected: Float,
    predicted: float,
    noise: float,
    steady: bool,
) -> None:
    """Slow vibration of the force that goes on and on where the plan is steady.

    Measured minus predicted force less its own mean of :data:`LEVEL_S`: what vibrates between 1 Hz and half the rate of
    the telegrams, root mean square over :data:`SLOW_S`. A ring after an entry or a jump of the correction dies away
    with the arm's damping; what stays above the limit for the whole of the stated time does not.

    Args:
        given: (at.GIVEN,) of the step.
        constants: (CONSTANTS,).
        choices: (CHOICES,).
        state: (STATE,); changed.
        whole: (WHOLE,); changed.
        results: (RESULTS,) written.
        outcome: (OUTCOME,) written.
        expected: (3,) predicted force of this cycle, part axes, N.
        predicted: Its filtered size.
        noise: Of the filtered force.
        steady: The plan is.
    """
    least = constants[ml.C_PERIOD] / LEVEL_S
    square = 0.0
    for k in range(3):
        left = given[at.G_W + k] - expected[k]
        state[ml.S_LEVEL + k] += least * (left - state[ml.S_LEVEL + k])
        square += (left - state[ml.S_LEVEL + k]) ** 2
    state[ml.S_SLOW] += constants[ml.C_PERIOD] / SLOW_S * (square - state[ml.S_SLOW])
    if not steady:
        whole[ml.N_COUNT + _LOW_CHATTER] = 0
        state[ml.S_SLOW] = 0.0
        for k in range(3):
            state[ml.S_LEVEL + k] = given[at.G_W + k] - expected[k]
    limit = math.hypot(constants[ml.C_LOW_CHATTER] * predicted, constants[ml.C_Z] * noise) if steady else 0.0
    judge(results, outcome, whole, choices, _LOW_CHATTER, math.sqrt(state[ml.S_SLOW]), limit, choices[ml.W_CYCLES + 3]
    )  # fmt: skip
