"""What measured and planned force say of sensor and frame: where they point, and what is left in air. Pure kernels.

- *direction*: while cutting, the measured force must point about where the predicted one points. It sees a sensor frame
  that is turned or mirrored where this changes the direction of the force by more than the limit; a turn about the
  force itself, or a factor on it, it cannot see.
- *idle*: where the plan cuts air, the sensor must show next to nothing.
"""

from __future__ import annotations

import math

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.core.records import Record
from counterflex.runtime.plausibility.force_change import size
from counterflex.runtime.state.doubts import LIMITS, MEMORY


@kernel("boolean(float64[::1], float64[::1], boolean, Limits, Memory)", Limits=LIMITS, Memory=MEMORY)
def direction_is_wrong(measured: Float, predicted: Float, good: bool, limits: Record, memory: Record) -> bool:
    """Whether the measured force points elsewhere than the predicted one (R19, WRONG_FRAME without a tracker).

    Args:
        measured: (3,) N, filtered, part axes.
        predicted: (3,) N through the same filters.
        good: The measured one is fresh; else the count stands still.
        limits: Of the tests.
        memory: Of the tests; changed.

    Returns:
        Whether the angle was above the limit over ``direction_cycles`` in a row in which both had a direction.
    """
    a, b = size(measured), size(predicted)
    if good and min(a, b) > limits.force_n:
        both = measured[0] * predicted[0] + measured[1] * predicted[1] + measured[2] * predicted[2]
        memory.direction = memory.direction + 1 if both < limits.cosine * a * b else 0
    return bool(memory.direction >= limits.direction_cycles)


@kernel("boolean(float64[::1], boolean, float64, Limits, Memory)", Limits=LIMITS, Memory=MEMORY)
def idle_is_wrong(measured: Float, air: bool, swing_n: float, limits: Record, memory: Record) -> bool:
    """Whether the sensor shows a force where the plan cuts air: drifted zero, wrong load, or a missing plan (R17).

    Both limits grow by the share of the force that the inertia of what hangs behind the sensor explains.

    Args:
        measured: (6,) N, N m, filtered.
        air: The plan cuts nothing here, nor did it within the filters' memory, nor will it within the lead.
        swing_n: Force that the recent acceleration explains, N.
        limits: Of the tests.
        memory: Of the tests; changed.

    Returns:
        Whether it was above the limits over ``idle_cycles`` in a row.
    """
    moment = math.sqrt(measured[3] ** 2 + measured[4] ** 2 + measured[5] ** 2)
    share = 1.0 + swing_n / limits.idle_n
    bad = air and not (size(measured) <= share * limits.idle_n and moment <= share * limits.idle_nm)
    memory.idle = memory.idle + 1 if bad else 0
    return bool(memory.idle >= limits.idle_cycles)
