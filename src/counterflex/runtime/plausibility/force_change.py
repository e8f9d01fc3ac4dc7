"""Samples of measured less planned force that are kept, and what the motor currents say of a change. Pure kernels."""

from __future__ import annotations

import math
from typing import Final

from counterflex.core.arrays import Float, Int
from counterflex.core.jit import kernel
from counterflex.runtime.estimator.idle_torque import less_force
from counterflex.runtime.plausibility.kernel import (
    K_STEP_PLACE,
    L_IDLE_N,
    L_STEP_TORQUE,
    M_STEP_PLAN,
    M_STEP_WORK,
    M_STEPS,
    STEP_MOST,
    STEP_ROW,
    T_STEP_PERIOD,
)
from counterflex.runtime.state import layout as at

TORQUE: Final = 10
"""Place of the six torques in a row."""
STANDS_M: Final = 4e-6
"""Way over the cycles in which the speed is taken, below which the program stands."""
_WAY: Final = 9
_NOTHING_N: Final = 1.0
_SHARE_SIGMA: Final = 0.3
"""Standard deviation of the share of a change that the currents show, up to which they tell."""
_MISSING: Final = 0.15
"""Share of the planned force below which the measured one is missing rather than off."""


@kernel("float64(float64[::1], float64[::1])")
def apart(a: Float, b: Float) -> float:
    """Length of the difference of two vectors."""
    return math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


@kernel("float64(float64[::1])")
def size(a: Float) -> float:
    """Length of a vector."""
    return math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


@kernel("boolean(float64[::1], float64[::1], float64[::1], float64)")
def missing(residual: Float, planned: Float, limits: Float, noise: float) -> bool:
    """Whether next to nothing is measured where a force is planned: no cut, or a tool that is gone."""
    x, y, z = residual[0] + planned[0], residual[1] + planned[1], residual[2] + planned[2]
    least = max(limits[L_IDLE_N], _MISSING * size(planned)) + noise
    return bool(x * x + y * y + z * z < least * least and size(planned) > 2.0 * least)


@kernel("boolean(float64[::1], float64[::1], float64[::1], float64[::1])")
def zero_is_right(mean: Float, planned: Float, limits: Float, memory: Float) -> bool:
    """Whether the sensor shows next to nothing where nothing is cut: in air, or at rest.

    Args:
        mean: (10,) of a few samples: residual, planned force, way.
        planned: (3,) force now, N.
        limits: (LIMITS,).
        memory: (REMEMBERED,).
    """
    stands = mean[_WAY] <= STANDS_M
    if not stands and (memory[M_STEP_PLAN] >= limits[L_IDLE_N] or size(planned) >= _NOTHING_N):
        return False
    x, y, z = mean[0] + planned[0], mean[1] + planned[1], mean[2] + planned[2]
    return bool(x * x + y * y + z * z < limits[L_IDLE_N] ** 2)


@kernel("void(float64[::1], int64[::1], int64, int64, int64, float64[::1])")
def mean_rows(memory: Float, counts: Int, back: int, rows: int, first: int, out: Float) -> None:
    """Mean of what stands from ``first`` on in so many rows, the newest of them ``back`` before the newest of all.

    Args:
        memory: (REMEMBERED,) with the ring of samples.
        counts: (COUNTS,) with its place.
        back: See above.
        rows: See above, at least 1.
        first: Place in a row.
        out: (n,) written.
    """
    for k in range(out.shape[0]):
        out[k] = 0.0
    for i in range(rows):
        place = (counts[K_STEP_PLACE] - 1 - back - i + 2 * STEP_MOST) % STEP_MOST
        row = M_STEPS + STEP_ROW * place + first
        for k in range(out.shape[0]):
            out[k] += memory[row + k]
    for k in range(out.shape[0]):
        out[k] /= rows


@kernel("int64(float64[::1], float64[::1], int64, float64[::1], float64[::1], int64[::1], float64[::1], int64[::1])")
def by_currents(
    change: Float, jac: Float, first: int, constants: Float, limits: Float, times: Int, memory: Float, counts: Int
) -> int:
    """What the torque of the axes says of a change of the force: 1 the process, -1 the sensor, 0 nothing.

    The share of ``J^T dw`` that is found in the change of the torques, by least squares.

    Args:
        change: (6,) N, N m, part axes.
        jac: (36,) Jacobian of the TCP, base axes.
        first: Samples since the change.
        constants: Of the loop.
        limits: (LIMITS,).
        times: (TIMES,).
        memory: (REMEMBERED,); its work space is changed.
        counts: (COUNTS,).
    """
    now = memory[M_STEP_WORK : M_STEP_WORK + 6]
    before, expected = memory[M_STEP_WORK + 6 : M_STEP_WORK + 12], memory[M_STEP_WORK + 12 : M_STEP_WORK + 18]
    period = times[T_STEP_PERIOD]
    mean_rows(memory, counts, 0, period, TORQUE, now)
    mean_rows(memory, counts, first, period, TORQUE, before)
    for k in range(6):
        expected[k] = 0.0
    less_force(change, jac, constants[at.C_R_BASE_PART : at.C_R_BASE_PART + 9], expected)
    both = square = 0.0
    for k in range(6):
        weight = 1.0 / max(constants[at.C_TORQUE + k] * limits[L_STEP_TORQUE], 1e-9)
        both -= weight * expected[k] * (now[k] - before[k])
        square += weight * expected[k] * expected[k]
    if square * _SHARE_SIGMA * _SHARE_SIGMA < 1.0:
        return 0
    return 1 if both > 0.5 * square else -1
