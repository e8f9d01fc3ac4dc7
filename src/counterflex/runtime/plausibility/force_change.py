"""Samples of measured less planned force that are kept, and what the motor currents say of a change. Pure kernels."""

from __future__ import annotations

import math
from typing import Final

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.core.records import Record
from counterflex.runtime.estimator.idle_torque import less_force
from counterflex.runtime.primitives.loop_types import LOOP_TYPES
from counterflex.runtime.state.doubts import STEP_MOST

STANDS_M: Final = 4e-6
"""Way over the cycles in which the speed is taken, below which the program stands."""
_NOTHING_N: Final = 1.0
_SHARE_SIGMA: Final = 0.3
"""Standard deviation of the share of a change that the currents show, up to which they tell."""
_MISSING: Final = 0.15
"""Share of the planned force below which the measured one is missing rather than off."""


@kernel("float64(float64[::1], float64[::1])")
def distance(a: Float, b: Float) -> float:
    """Length of the difference of two vectors."""
    return math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


@kernel("float64(float64[::1])")
def size(a: Float) -> float:
    """Length of a vector."""
    return math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


@kernel("boolean(float64[::1], float64[::1], Limits, float64)", **LOOP_TYPES)
def missing(residual: Float, planned: Float, limits: Record, noise: float) -> bool:
    """Return whether next to nothing is measured where a force is planned: no cut, or a tool that is gone."""
    x, y, z = residual[0] + planned[0], residual[1] + planned[1], residual[2] + planned[2]
    least = max(limits.idle_n, _MISSING * size(planned)) + noise
    # Twice: where the planned force is itself near the bound, nothing measured and all measured look the same.
    return bool(x * x + y * y + z * z < least * least and size(planned) > 2.0 * least)


@kernel("boolean(Cut, float64[::1], Limits, Memory)", **LOOP_TYPES)
def zero_is_right(mean: Record, planned: Float, limits: Record, memory: Record) -> bool:
    """Return whether the sensor shows next to nothing where nothing is cut: in air, or at rest.

    ``planned``: (3,) force now, N.
    """
    stands, residual = mean.way <= STANDS_M, mean.residual[:]
    if not stands and (memory.plan_change >= limits.idle_n or size(planned) >= _NOTHING_N):
        return False
    x, y, z = residual[0] + planned[0], residual[1] + planned[1], residual[2] + planned[2]
    return bool(x * x + y * y + z * z < limits.idle_n**2)


@kernel("int64(Memory, int64)", **LOOP_TYPES)
def sample_at(memory: Record, back: int) -> int:
    """Row of the sample that was taken so many samples before the newest."""
    return int((memory.sample_row - 1 - back + 2 * STEP_MOST) % STEP_MOST)


@kernel("void(Cut)", **LOOP_TYPES)
def clear_cut(out: Record) -> None:
    """Zero."""
    for k in range(6):
        out.residual[k] = 0.0
    for k in range(3):
        out.planned[k] = 0.0
    out.way = 0.0


@kernel("void(Cut, Cut)", **LOOP_TYPES)
def add_cut(cut: Record, out: Record) -> None:
    """``out += cut``."""
    for k in range(6):
        out.residual[k] += cut.residual[k]
    for k in range(3):
        out.planned[k] += cut.planned[k]
    out.way += cut.way


@kernel("void(Cut, int64)", **LOOP_TYPES)
def divide_cut(out: Record, by: int) -> None:
    """``out /= by``."""
    for k in range(6):
        out.residual[k] /= by
    for k in range(3):
        out.planned[k] /= by
    out.way /= by


@kernel("void(Cut, Cut)", **LOOP_TYPES)
def copy_cut(cut: Record, out: Record) -> None:
    """``out = cut``."""
    for k in range(6):
        out.residual[k] = cut.residual[k]
    for k in range(3):
        out.planned[k] = cut.planned[k]
    out.way = cut.way


@kernel("void(Memory, int64, int64, Cut)", **LOOP_TYPES)
def mean_cut(memory: Record, back: int, count: int, out: Record) -> None:
    """Mean residual, planned force and way of so many samples.

    Args:
        back: Samples that are newer.
        count: See above, at least 1.
        out: Written.
    """
    clear_cut(out)
    for i in range(count):
        add_cut(memory.samples[sample_at(memory, back + i)].cut, out)
    divide_cut(out, count)


@kernel("void(Memory, int64, int64, float64[::1])", **LOOP_TYPES)
def mean_torque(memory: Record, back: int, count: int, out: Float) -> None:
    """Mean torque of the axes, (6,) written, of so many samples; as :func:`mean_cut`."""
    for k in range(6):
        out[k] = 0.0
    for i in range(count):
        sample = memory.samples[sample_at(memory, back + i)]
        for k in range(6):
            out[k] += sample.torque[k]
    for k in range(6):
        out[k] /= count


@kernel("float64(Memory, int64, int64)", **LOOP_TYPES)
def mean_ringing(memory: Record, back: int, count: int) -> float:
    """Mean of how the residual rang in so many samples; as :func:`mean_cut`."""
    total = 0.0
    for i in range(count):
        total += memory.samples[sample_at(memory, back + i)].ringing
    return total / count


@kernel("int64(float64[::1], float64[::1], int64, Settings, Limits, Memory)", **LOOP_TYPES)
def by_currents(change: Float, jac: Float, first: int, settings: Record, limits: Record, memory: Record) -> int:
    """Origin of a change of the force by the torque of the axes: 1 the process, -1 the sensor, 0 not decided.

    The share of ``J^T dw`` that is found in the change of the torques, by least squares.

    ``change``: (6,) N, N m, part axes; ``jac``: (36,) Jacobian of the TCP, base axes; ``first``: samples since the
    change.
    """
    now, before, expected = memory.torque_now[:], memory.torque_then[:], memory.torque_expected[:]
    period = limits.step_period
    mean_torque(memory, 0, period, now)
    mean_torque(memory, first, period, before)
    for k in range(6):
        expected[k] = 0.0
    less_force(change, jac, settings.R_base_part[:], expected)
    both = square = 0.0
    for k in range(6):
        # Axes by the inverse of their variance: friction hides a change in the large axes that the wrist shows.
        weight = 1.0 / max(settings.torque_variance[k] * limits.step_torque, 1e-9)
        # ``less_force`` has written ``-J^T dw``: hence the minus, and a share of 1 where the process has changed.
        both -= weight * expected[k] * (now[k] - before[k])
        square += weight * expected[k] * expected[k]
    if square * _SHARE_SIGMA * _SHARE_SIGMA < 1.0:
        return 0
    return 1 if both > 0.5 * square else -1
