"""Correction from what a tracker sees: published integrator, designed PI with a filter, observer of the unexplained."""

from __future__ import annotations

import math

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.core.records import Record
from counterflex.runtime.primitives.loop_types import LOOP_TYPES


@kernel("void(float64[::1], float64, float64[::1], State)", **LOOP_TYPES)
def sum_up(deviation: Float, gain: float, saturation: Float, state: Record) -> None:
    """Integrator of Mandiola2023: ``c -= sat(K deviation)`` per component and cycle.

    ``deviation``: (6,) actual minus nominal, m and rad; ``gain``: k; ``saturation``: (2,) largest step, m and rad.
    """
    for k in range(6):
        largest = saturation[0 if k < 3 else 1]
        state.tracker_integral[k] -= min(largest, max(-largest, gain * deviation[k]))


@kernel("void(Cycle, float64[::1], State)", **LOOP_TYPES)
def compare(cycle: Record, deflection: Float, state: Record) -> None:
    """Innovation of the observer, whose model is ``deviation = correction in effect + deflection + b``.

    The correction in effect is what was sent, delayed and smoothed as the robot does it; so a correction on its way is
    not asked for twice, and the gain may be as high as the noise allows.

    Args:
        cycle: With the deviation; the innovation is written.
        deflection: (6,) expected at the time of the sample.
    """
    for k in range(6):
        cycle.innovation[k] = cycle.deviation[k] - state.in_effect[k] - deflection[k] - state.offset[k]


@kernel("boolean(Cycle, float64[::1], float64, State)", **LOOP_TYPES)
def observe(cycle: Record, noise: Float, largest_m: float, state: Record) -> bool:
    """Kalman update of the offset b by the innovation, see :func:`compare`.

    Args:
        cycle: With the innovation.
        noise: (2,) variance of a sample, m2 and rad2.
        largest_m: Innovation beyond which the sample is not believed.
        state: Of the step; offset and its variances are changed.

    Returns:
        Whether the sample was believed.
    """
    innovation, gap = cycle.innovation[:], 0.0
    for k in range(3):
        gap += innovation[k] ** 2
    if not math.sqrt(gap) <= largest_m:
        return False
    for part in range(2):
        variance = state.offset_variance[part]
        gain = variance / (variance + noise[part])
        state.offset_variance[part] = variance * (1.0 - gain)
        for k in range(3 * part, 3 * part + 3):
            state.offset[k] += gain * innovation[k]
    return True


@kernel("void(float64[::1], boolean, Settings, State)", **LOOP_TYPES)
def designed(deviation: Float, summing: bool, settings: Record, state: Record) -> None:
    """Designed controller of :mod:`counterflex.runtime.design.tracker`: filter, then sum of what it passes.

    ``f = N deviation``, ``c -= sat(Ki f)`` per component; :func:`designed_correction` adds ``-Kp f``.

    ``deviation``: (6,) actual minus where it should be, m and rad; ``summing``: whether the sum goes on.
    """
    b0, b1, b2 = settings.notch[0], settings.notch[1], settings.notch[2]
    a1, a2 = settings.notch[3], settings.notch[4]
    memory = state.notch_filter[:]
    for k in range(6):
        e = deviation[k]
        f = b0 * e + memory[2 * k]
        memory[2 * k] = b1 * e - a1 * f + memory[2 * k + 1]
        memory[2 * k + 1] = b2 * e - a2 * f
        state.notch_output[k] = f
        if summing:
            largest = settings.saturation[0 if k < 3 else 1]
            state.tracker_integral[k] -= min(largest, max(-largest, settings.gain * f))


@kernel("void(Settings, State, float64[::1])", **LOOP_TYPES)
def designed_correction(settings: Record, state: Record, out: Float) -> None:
    """Correction of the designed controller with what is known ahead, (6,) added to ``out``."""
    for k in range(6):
        feedback = state.tracker_integral[k] - settings.proportional * state.notch_output[k]
        out[k] += feedback + state.known_ahead[k]
