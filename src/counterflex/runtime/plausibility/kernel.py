"""Tests during operation that tell a wrong sign, a wrong frame or a wrong sensor from ordinary errors. Pure kernels.

What each can see, and what it cannot:

- *answer*: the pose that the controller itself reports, minus the commanded one, must be the correction
  (:mod:`counterflex.runtime.plausibility.answer`). It sees a correction that is applied in another frame, with another
  sign or order of axes, in part, or not at all; it needs no tracker. It does not see what is wrong with the force
  sensor or the tracker.
- *residual*: the tracker's deviation must not grow while the correction acts (the sign test, and divergence).
- *frame*: before arming, the tracker must see the tool where the controller says it is.
- *return*: after a broken beam the tracker must go on where the prediction is, else it may be another reflector.
- *direction* and *idle*: what the force shows (:mod:`counterflex.runtime.plausibility.kernel`).
- *step*: the force must not jump where neither plan nor speed do
  (:mod:`counterflex.runtime.plausibility.force_step`), and in a calm cut it must be off the plan as it was in such
  cuts before (:mod:`counterflex.runtime.plausibility.calm_cuts`).
"""

from __future__ import annotations

import math
from typing import Final

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.core.records import Record
from counterflex.runtime.plausibility.force_change import size
from counterflex.runtime.primitives.loop_types import LOOP_TYPES

# What measured and planned force say of sensor and frame: where they point, and what is left in air. Pure kernels.
# - *direction*: while cutting, the measured force must point about where the predicted one points. It sees a sensor
# frame that is turned or mirrored where this changes the direction of the force by more than the limit; a turn about
# the force itself, or a factor on it, it cannot see.
# - *idle*: where the plan cuts air, the sensor must show next to nothing.


@kernel("boolean(float64[::1], float64[::1], boolean, Limits, Memory)", **LOOP_TYPES)
def direction_is_wrong(measured: Float, predicted: Float, good: bool, limits: Record, memory: Record) -> bool:
    """Return whether the measured force points elsewhere than the predicted one (R19, WRONG_FRAME without a tracker).

    Args:
        measured: (3,) N, filtered, part axes.
        predicted: (3,) N through the same filters.
        good: The measured one is fresh; else the count stands still.
        memory: Of the tests; changed.

    Returns:
        Whether the angle was above the limit over ``direction_cycles`` in a row in which both had a direction.
    """
    a, b = size(measured), size(predicted)
    if good and min(a, b) > limits.force_n:
        both = measured[0] * predicted[0] + measured[1] * predicted[1] + measured[2] * predicted[2]
        memory.direction = memory.direction + 1 if both < limits.cosine * a * b else 0
    return bool(memory.direction >= limits.direction_cycles)


@kernel("boolean(float64[::1], boolean, float64, Limits, Memory)", **LOOP_TYPES)
def idle_is_wrong(measured: Float, air: bool, swing_n: float, limits: Record, memory: Record) -> bool:
    """Return whether the sensor shows a force where the plan cuts air: drifted zero, wrong load, missing plan (R17).

    Both limits grow by the share of the force that the inertia of what hangs behind the sensor explains.

    Args:
        measured: (6,) N, N m, filtered.
        air: The plan cuts nothing here, nor did it within the filters' memory, nor will it within the lead.
        swing_n: Force that the recent acceleration explains, N.
        memory: Of the tests; changed.

    Returns:
        Whether it was above the limits over ``idle_cycles`` in a row.
    """
    moment = math.sqrt(measured[3] ** 2 + measured[4] ** 2 + measured[5] ** 2)
    # In air the sensor still feels what hangs behind it: at each turn of the path the mass would pass for an offset.
    share = 1.0 + swing_n / limits.idle_n
    bad = air and not (size(measured) <= share * limits.idle_n and moment <= share * limits.idle_nm)
    memory.idle = memory.idle + 1 if bad else 0
    return bool(memory.idle >= limits.idle_cycles)


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

DOUBT_SHORT: Final = 16384
"""A lasting part of the correction is missing at the robot."""
DOUBT_TOO_SHORT: Final = 32768
"""It is larger than it may be."""

_FADE = 0.98
_SETTLE = 0.05


@kernel("float64(float64[::1])")
def _norm(x: Float) -> float:
    return math.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])


@kernel("boolean(float64[::1], float64[::1], float64, boolean, Limits, Memory)", **LOOP_TYPES)
def residual_grows(
    deviation: Float,
    in_effect: Float,
    expected_m: float,
    active: bool,
    limits: Record,
    memory: Record,
) -> bool:
    """Return whether the tracker's deviation grows under the correction (R19: sign test, DIVERGENCE).

    Counted are samples with ``|d| > 0.1 mm`` and ``|d| > 1.5 max(start, expected)``: start is the residual before the
    correction acted, expected the deflection under the force that is known. A deviation can also grow by itself; so a
    sample counts only where the residual moves against the correction, over ``window`` cycles: ``dd . dc < -a |dc|^2``.
    A right correction gives ``dd = dc`` plus what the process adds, a wrong sign ``dd = -dc``.

    That mirror image is judged sooner: ``|d| > 0.1 mm`` and ``|dd + dc| < 0.2 |dc|`` over ``sign_samples`` in a row.
    A process under a right correction would have to grow by ``dp = -2 dc`` to look so. While an integrator of gain K
    per second follows a ramp or a sine it does for 0.2 / K s at most; ``sign_samples`` is twice that.

    ``deviation``: (3,) d across the feed, m, part axes: a new sample. ``in_effect``: (3,) correction in effect, as the
    loop computes it. ``expected_m``: size of the deflection under the known force; 0 where none is known.

    Returns:
        Whether it has lasted long enough to be a fault.
    """
    size = _norm(deviation)
    window = limits.window
    place = memory.window_row
    old = memory.deviations[place]
    against = mirrored = False
    if memory.window_filled >= window:
        both = square = mismatch = 0.0
        for k in range(3):
            change = in_effect[k] - old.in_effect[k]
            grown = deviation[k] - old.deviation[k]
            both += change * grown
            square += change * change
            mismatch += (grown + change) ** 2
        # Below a third of the least deviation the change is the tracker's noise, whose sign says nothing.
        conclusive = math.sqrt(square) > 0.3 * limits.least_m
        against = conclusive and both < -limits.against * square
        mirrored = conclusive and mismatch < limits.mirrored**2 * square
    for k in range(3):
        old.deviation[k], old.in_effect[k] = deviation[k], in_effect[k]
    memory.window_row = (place + 1) % window
    memory.window_filled = min(window, memory.window_filled + 1)
    # Fading, not now: behind the end of a cut the arm swings back later than the force is gone.
    memory.expected = max(expected_m, _FADE * memory.expected)
    if not active:
        # Learnt while nothing is corrected: play and an old calibration are there before, and are no wrong sign.
        memory.start += _SETTLE * (size - memory.start)
        memory.residual = memory.sign = 0
        return False
    start = max(memory.start, memory.expected)
    bad = size > limits.least_m and size > limits.growth * start and against
    memory.residual = memory.residual + 1 if bad else 0
    memory.sign = memory.sign + 1 if size > limits.least_m and mirrored else 0
    wrong_sign = limits.sign_samples > 0 and memory.sign >= limits.sign_samples
    return bool(wrong_sign or memory.residual >= limits.residual_cycles)


@kernel("boolean(float64[::1], boolean, Limits, Memory)", **LOOP_TYPES)
def frame_is_wrong(deviation: Float, moves: bool, limits: Record, memory: Record) -> bool:
    """Return whether the tracker sees the tool elsewhere than where the controller says it is (R19, before arming).

    A robot that moves trails its program: then a sample can only prove the frame, not disprove it.

    ``deviation``: (6,) measured minus commanded pose, m and rad: a new sample.

    Returns:
        Whether the last sample that could be judged lay beyond 2 mm or 0.2 deg.
    """
    angle = math.sqrt(deviation[3] ** 2 + deviation[4] ** 2 + deviation[5] ** 2)
    if _norm(deviation) <= limits.frame_m and angle <= limits.frame_rad:
        memory.frame = 0
    elif not moves:
        memory.frame = 1
    return bool(memory.frame == 1)


@kernel("int64(Limits, Memory)", **LOOP_TYPES)
def gap_cycles(limits: Record, memory: Record) -> int:
    """Cycles without a believed sample that are a gap: ``gap_cycles``, or three usual pauses where few come."""
    return int(max(limits.gap_cycles, math.ceil(3.0 * memory.pause)))


@kernel("boolean(float64[::1], float64[::1], float64[::1], boolean, Limits, Memory)", **LOOP_TYPES)
def return_is_believed(
    deviation: Float,
    in_effect: Float,
    expected: Float,
    corrects: bool,
    limits: Record,
    memory: Record,
) -> bool:
    """Return whether a tracker's sample may be used: after a gap only where it goes on as predicted (R18).

    Prediction: the last believed deviation plus how correction in effect and expected deflection have changed since.
    T_RETURN samples in a row must lie within 0.2 mm of it; the first of all samples within the limit of the frame
    test. While nothing is corrected every sample is believed: the
    frame test judges it.

    ``deviation``: (3,) m, part axes: a new sample; ``in_effect``: (3,) correction in effect; ``expected``: (3,)
    deflection under the known force.
    """
    if memory.unseen >= gap_cycles(limits, memory):
        memory.waiting, memory.agreed = 1, 0
    memory.unseen = 0
    if not corrects:
        memory.waiting = 0
    if memory.waiting == 1:
        gap, least, largest = 0.0, limits.return_samples, limits.return_m
        for k in range(3):
            predicted = memory.deviation[k] + in_effect[k] + expected[k] - memory.model[k]
            gap += (deviation[k] - predicted) ** 2
        if memory.known == 0:
            # Of the first sample nothing is known to go on from: only that it is this tool and not another reflector.
            gap, least, largest = _norm(deviation) ** 2, 1, limits.frame_m
        memory.agreed = memory.agreed + 1 if math.sqrt(gap) <= largest else 0
        if memory.agreed < least:
            return False
        memory.waiting = 0
        memory.window_filled = 0
    memory.known = 1
    for k in range(3):
        memory.deviation[k], memory.model[k] = deviation[k], in_effect[k] + expected[k]
    return True
