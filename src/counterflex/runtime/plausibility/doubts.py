"""What measured and planned force say of sensor and frame: where they point, and what is left in air. Pure kernels.

- *direction*: while cutting, the measured force must point about where the predicted one points. It sees a sensor frame
  that is turned or mirrored where this changes the direction of the force by more than the limit; a turn about the
  force itself, or a factor on it, it cannot see.
- *idle*: where the plan cuts air, the sensor must show next to nothing.
"""

from __future__ import annotations

import math

from counterflex.core.arrays import Float, Int
from counterflex.core.jit import kernel
from counterflex.runtime.plausibility.force_change import size
from counterflex.runtime.plausibility.kernel import (
    K_DIRECTION,
    K_IDLE,
    L_COSINE,
    L_FORCE_N,
    L_IDLE_N,
    L_IDLE_NM,
    T_DIRECTION,
    T_IDLE,
)


@kernel("boolean(float64[::1], float64[::1], boolean, float64[::1], int64[::1], int64[::1])")
def direction_is_wrong(measured: Float, predicted: Float, good: bool, limits: Float, times: Int, counts: Int) -> bool:
    """Whether the measured force points elsewhere than the predicted one (R19, WRONG_FRAME without a tracker).

    Args:
        measured: (3,) N, filtered, part axes.
        predicted: (3,) N through the same filters.
        good: The measured one is fresh; else the count stands still.
        limits: (LIMITS,).
        times: (TIMES,).
        counts: (COUNTS,); changed.

    Returns:
        Whether the angle was above the limit over T_DIRECTION cycles in a row in which both had a direction.
    """
    a, b = size(measured), size(predicted)
    if good and min(a, b) > limits[L_FORCE_N]:
        both = measured[0] * predicted[0] + measured[1] * predicted[1] + measured[2] * predicted[2]
        counts[K_DIRECTION] = counts[K_DIRECTION] + 1 if both < limits[L_COSINE] * a * b else 0
    return bool(counts[K_DIRECTION] >= times[T_DIRECTION])


@kernel("boolean(float64[::1], boolean, float64, float64[::1], int64[::1], int64[::1])")
def idle_is_wrong(measured: Float, air: bool, swing_n: float, limits: Float, times: Int, counts: Int) -> bool:
    """Whether the sensor shows a force where the plan cuts air: drifted zero, wrong load, or a missing plan (R17).

    Both limits grow by the share of the force that the inertia of what hangs behind the sensor explains.

    Args:
        measured: (6,) N, N m, filtered.
        air: The plan cuts nothing here, nor did it within the filters' memory, nor will it within the lead.
        swing_n: Force that the recent acceleration explains, N.
        limits: (LIMITS,).
        times: (TIMES,).
        counts: (COUNTS,); changed.

    Returns:
        Whether it was above the limits over T_IDLE cycles in a row.
    """
    moment = math.sqrt(measured[3] ** 2 + measured[4] ** 2 + measured[5] ** 2)
    share = 1.0 + swing_n / limits[L_IDLE_N]
    bad = air and not (size(measured) <= share * limits[L_IDLE_N] and moment <= share * limits[L_IDLE_NM])
    counts[K_IDLE] = counts[K_IDLE] + 1 if bad else 0
    return bool(counts[K_IDLE] >= times[T_IDLE])
