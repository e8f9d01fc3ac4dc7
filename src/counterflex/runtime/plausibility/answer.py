"""Test of what the robot makes of the correction, by the pose that its controller reports. Pure kernels.

The reported pose less the commanded one must be the correction. How late a robot answers is known within limits only,
so the test takes any answer between the correction that was sent last and the one that was to act some time ago. Three
tests follow from the distance to the nearest of these answers:

- *early*: along the correction almost nothing of it shows, or its opposite: a fault within a few cycles;
- *lasting*: by more than a share of it, for longer than the arm swings: a fault;
- *missing*: the mean of what is missing is told with its size, and beyond a limit it is a fault.

Along the motion the robot trails its program: that part is left out. Its drives yield to a load that comes or goes
before their controllers have taken it up: a share of the change of the deflection is left out, too. Where the
programmed point has just stopped neither motion nor load is known any more, and nothing is judged until the arm has
settled.
"""

from __future__ import annotations

import math
from typing import Final

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.core.records import Record, Records
from counterflex.runtime.primitives.loop_types import LOOP_TYPES
from counterflex.runtime.state.memory import PAST_ROWS

RIGHT: Final = 0
SHORT: Final = 1
"""A lasting part of the correction is missing: told."""
TOO_SHORT: Final = 2
"""It is larger than it may be."""
WRONG: Final = 3
"""The robot does something else than the correction."""
_SETTLE: Final = 0.05
_STILL_M: Final = 1e-6
_TOLD_AGAIN: Final = 0.8
"""Share of the limit below which a missing part is no longer told."""


@kernel("float64(float64[::1], int64)")
def _norm(x: Float, begin: int) -> float:
    return math.sqrt(x[begin] * x[begin] + x[begin + 1] * x[begin + 1] + x[begin + 2] * x[begin + 2])


@kernel("float64(float64[::1], float64[::1], Limits, Memory)", **LOOP_TYPES)
def _bend_of_path(moved: Float, before: Float, limits: Record, memory: Record) -> float:
    """Follow the direction of motion; return by how much a bend of the path may throw the robot off, m."""
    # ``t_f |v| sin(turn)``, and what is left of it behind the bend.
    way, earlier = _norm(moved, 0), _norm(before, 0)
    thrown = 0.0
    for k in range(3):
        memory.heading[k] = moved[k] / way if way > _STILL_M else 0.0
    if min(way, earlier) > _STILL_M:
        cosine = 0.0
        for k in range(3):
            cosine += moved[k] * before[k]
        cosine = min(1.0, max(-1.0, cosine / (way * earlier)))
        # A turn back is taken as a right angle: beyond it the sine falls again, what the robot is thrown off does not.
        turn = math.sqrt(max(0.0, 1.0 - cosine * cosine)) if cosine > 0.0 else 1.0
        thrown = limits.follow_late_s * max(way, earlier) / (limits.window * limits.period) * turn
    memory.bend = max(thrown, (1.0 - limits.settle_gain) * memory.bend)
    return float(memory.bend)


@kernel("float64(float64[::1], Limits, Memory)", **LOOP_TYPES)
def _yield_of_drives(bent: Float, limits: Record, memory: Record) -> float:
    """By how much the drives may yield to the load that has lately come or gone, m: ``s_l |d - mean(d)|``."""
    square = 0.0
    for k in range(3):
        off = bent[k] - memory.bent[k]
        square += off * off
        memory.bent[k] += limits.settle_gain * off
    return float(limits.load_share * math.sqrt(square))


@kernel("void(Memory, float64[::1], int64)", **LOOP_TYPES)
def _across(memory: Record, x: Float, begin: int) -> None:
    """Take the part along the motion out of ``x[begin : begin + 3]``, in place."""
    along = 0.0
    for k in range(3):
        along += x[begin + k] * memory.heading[k]
    for k in range(3):
        x[begin + k] -= along * memory.heading[k]


@kernel("void(float64[::1], int64, float64[::1], float64[::1])")
def _nearest_on_leg(legs: Float, begin: int, shown: Float, nearest: Float) -> None:
    """Take the point of a leg that is nearest to what is shown, where it is nearer than the one before."""
    along = square = 0.0
    for k in range(3):
        leg = legs[begin + 3 + k] - legs[begin + k]
        along += leg * (shown[k] - legs[begin + k])
        square += leg * leg
    u = min(1.0, max(0.0, along / square)) if square > 0.0 else 0.0
    distance = 0.0
    for k in range(3):
        distance += (shown[k] - legs[begin + k] - u * (legs[begin + 3 + k] - legs[begin + k])) ** 2
    distance = math.sqrt(distance)
    # Written so that NaN is taken as nearest: it then fails every bound, where it would pass unseen otherwise.
    if not distance >= nearest[6]:
        for k in range(3):
            nearest[k] = legs[begin + k] + u * (legs[begin + 3 + k] - legs[begin + k])
            nearest[3 + k] = shown[k] - nearest[k]
        nearest[6] = distance


@kernel("void(State, Past[::1], int64, int64, float64[::1], float64[::1], float64[::1], Memory)", **LOOP_TYPES)
def _nearest_answer(
    state: Record,
    ring: Records,
    here: int,
    late: int,
    shown: Float,
    legs: Float,
    nearest: Float,
    memory: Record,
) -> None:
    """Nearest of the answers of a robot that is at most ``late`` cycles later than thought, across the motion."""
    nearest[6] = math.inf
    for k in range(3):
        # The first leg runs from what was sent last to what should act now: a robot that is faster than thought is
        # right.
        legs[k], legs[3 + k] = state.correction[k], state.in_effect[k]
    _across(memory, legs, 0)
    _across(memory, legs, 3)
    _nearest_on_leg(legs, 0, shown, nearest)
    for back in range(2, late + 2):
        past = ring[(here - back + PAST_ROWS) % PAST_ROWS]
        for k in range(3):
            legs[k] = legs[3 + k]
            legs[3 + k] = past.in_effect[k]
        _across(memory, legs, 3)
        _nearest_on_leg(legs, 0, shown, nearest)


@kernel("int64(float64[::1], float64, Limits, Memory)", **LOOP_TYPES)
def _judge_missing(gap: Float, explained_m: float, limits: Record, memory: Record) -> int:
    """Mean of what is missing over the time ``settle_s``: RIGHT, SHORT or TOO_SHORT."""
    size = _norm(gap, 0)
    share = max(0.0, 1.0 - explained_m / size) if size > 0.0 else 0.0
    for k in range(3):
        if math.isfinite(gap[k]):
            memory.missing[k] += limits.settle_gain * (share * gap[k] - memory.missing[k])
    missing = _norm(memory.missing[:], 0)
    memory.short = 1 if missing > (_TOLD_AGAIN if memory.short == 1 else 1.0) * limits.least_m else 0
    if missing > limits.missing_m:
        return TOO_SHORT
    return SHORT if memory.short == 1 else RIGHT


@kernel("boolean(float64[::1], float64[::1], State, boolean, Limits, Memory)", **LOOP_TYPES)
def _says_nothing(
    difference: Float, moved: Float, state: Record, corrects: bool, limits: Record, memory: Record
) -> bool:
    """Return whether the reported pose says nothing of the correction now: too little is sent, or the arm settles."""
    in_effect = _norm(state.in_effect[:], 0)
    # Learnt at rest only: with the motion in it, the trailing of the robot would pass for a standing offset.
    if not corrects and in_effect < _STILL_M and _norm(moved, 0) < _STILL_M:
        for k in range(3):
            memory.standing[k] += _SETTLE * (difference[k] - memory.standing[k])
    small = max(in_effect, _norm(state.correction[:], 0)) < limits.least_m
    if small:
        memory.short = 0
        for k in range(3):
            memory.missing[k] *= 1.0 - limits.settle_gain
    return bool(small or 0 < memory.still < limits.settle_cycles)


@kernel(
    "int64(float64[::1], float64[::1], float64[::1], float64[::1], State, Past[::1], boolean, float64[::1],"
    " Limits, Memory)",
    **LOOP_TYPES,
)
def judge_answer(
    difference: Float,
    moved: Float,
    before: Float,
    bent: Float,
    state: Record,
    ring: Records,
    corrects: bool,
    work: Float,
    limits: Record,
    memory: Record,
) -> int:
    """Return what the robot makes of the correction (R19).

    With r the reported less the commanded position, r0 the same at rest without a correction, P the projection across
    the motion, a the nearest answer and d the distance ``|P (r - r0 - a)|`` to it:

    - WRONG where ``d > max(L, s |a|) + b + y`` in ``answer_cycles`` in a row, a at most ``answer_late`` cycles late,
    - WRONG where ``-a . P (r - r0 - a) / |a| > max(L', s' |a|, y) + b`` in ``early_cycles`` in a row, a at most
      ``early_late`` cycles late: along the correction the robot makes almost nothing of it, or the opposite,
    - SHORT or TOO_SHORT by the mean of ``P (r - r0 - a)``, see :func:`_judge_missing`.

    b is what a bend of the path explains (:func:`_bend_of_path`), y the yield of the drives (:func:`_yield_of_drives`).

    Args:
        difference: (3,) r, m, part axes.
        moved: (3,) way of the commanded point over the last cycles, m.
        before: (3,) the same some time ago, over as many cycles.
        bent: (3,) deflection under the load as it is known, m.
        ring: Past cycles.
        corrects: The correction may act: r0 is not learnt.
        work: (16,) work space.
        memory: Of the tests; changed.

    Returns:
        RIGHT, SHORT, TOO_SHORT or WRONG.
    """
    bend_m = _bend_of_path(moved, before, limits, memory)
    yield_m = _yield_of_drives(bent, limits, memory)
    if _says_nothing(difference, moved, state, corrects, limits, memory):
        memory.answer = memory.early_answer = 0
        return SHORT if memory.short == 1 else RIGHT
    here = state.ring_row
    shown, legs, nearest = work[:3], work[3:9], work[9:16]
    for k in range(3):
        shown[k] = difference[k] - memory.standing[k]
    _across(memory, shown, 0)
    # Two spans of lateness: the early test may be sooner only because it grants the robot more time to answer.
    _nearest_answer(state, ring, here, limits.early_late, shown, legs, nearest, memory)
    expected, short = _norm(nearest, 0), 0.0
    if expected > 0.0:
        short = -(nearest[0] * nearest[3] + nearest[1] * nearest[4] + nearest[2] * nearest[5]) / expected
    bound = max(limits.early_m, limits.early_share * expected, yield_m) + bend_m
    memory.early_answer = 0 if short <= bound else memory.early_answer + 1  # NaN is no agreement
    _nearest_answer(state, ring, here, limits.answer_late, shown, legs, nearest, memory)
    bound = max(limits.least_m, limits.answer_share * _norm(nearest, 0)) + bend_m + yield_m
    memory.answer = 0 if nearest[6] <= bound else memory.answer + 1
    missing = _judge_missing(nearest[3:6], bend_m + yield_m, limits, memory)
    if memory.answer >= limits.answer_cycles or memory.early_answer >= limits.early_cycles:
        return WRONG
    return int(missing)
