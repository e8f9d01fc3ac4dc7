"""What a tracker's deviation does: published integrator, designed PI with a filter, observer of the unexplained."""

from __future__ import annotations

import math

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.runtime.state import layout as at


@kernel("void(float64[::1], float64, float64[::1], float64[::1])")
def sum_up(deviation: Float, gain: float, saturation: Float, state: Float) -> None:
    """Integrator of Mandiola2023: ``c -= sat(K deviation)`` per component and cycle.

    Args:
        deviation: (6,) actual minus nominal, m and rad.
        gain: K.
        saturation: (2,) largest step, m and rad.
        state: State of the step; its sum is changed.
    """
    for k in range(6):
        largest = saturation[0 if k < 3 else 1]
        state[at.S_SUM + k] -= min(largest, max(-largest, gain * deviation[k]))


@kernel("boolean(float64[::1], float64[::1], float64[::1], float64, float64[::1])")
def observe(deviation: Float, deflection: Float, noise: Float, largest_m: float, state: Float) -> bool:
    """Kalman update of the offset b in ``deviation = correction in effect + deflection + b``.

    The correction in effect is what was sent, delayed and smoothed as the robot does it; so a correction on its way is
    not asked for twice, and the gain may be as high as the noise allows.

    Args:
        deviation: (12,) deviation (6); the innovation is written behind it.
        deflection: (6,) expected at the time of the sample.
        noise: (2,) variance of a sample, m2 and rad2.
        largest_m: Innovation beyond which the sample is not believed.
        state: State of the step; offset and its variances are changed.

    Returns:
        Whether the sample was believed.
    """
    gap = 0.0
    for k in range(6):
        deviation[6 + k] = deviation[k] - state[at.S_IN_FORCE + k] - deflection[k] - state[at.S_OFFSET + k]
        gap += deviation[6 + k] ** 2 if k < 3 else 0.0
    if not math.sqrt(gap) <= largest_m:
        return False
    for part in range(2):
        variance = state[at.S_OFFSET_VARIANCE + part]
        gain = variance / (variance + noise[part])
        state[at.S_OFFSET_VARIANCE + part] = variance * (1.0 - gain)
        for k in range(3 * part, 3 * part + 3):
            state[at.S_OFFSET + k] += gain * deviation[6 + k]
    return True


@kernel("void(float64[::1], boolean, float64[::1], float64[::1])")
def designed(deviation: Float, summing: bool, constants: Float, state: Float) -> None:
    """Designed controller of :mod:`counterflex.runtime.design.tracker`: filter, then sum of what it passes.

    ``f = N deviation``, ``c -= sat(Ki f)`` per component; :func:`designed_correction` adds ``-Kp f``.

    Args:
        deviation: (6,) actual minus where it should be, m and rad.
        summing: Whether the sum goes on.
        constants: Of the loop.
        state: Of the step; filter and sum are changed.
    """
    b0, b1, b2 = constants[at.C_NOTCH], constants[at.C_NOTCH + 1], constants[at.C_NOTCH + 2]
    a1, a2 = constants[at.C_NOTCH + 3], constants[at.C_NOTCH + 4]
    for k in range(6):
        memory = at.S_NOTCH + 2 * k
        e = deviation[k]
        f = b0 * e + state[memory]
        state[memory] = b1 * e - a1 * f + state[memory + 1]
        state[memory + 1] = b2 * e - a2 * f
        state[at.S_FILTERED + k] = f
        if summing:
            largest = constants[at.C_SATURATION + (0 if k < 3 else 1)]
            state[at.S_SUM + k] -= min(largest, max(-largest, constants[at.C_GAIN] * f))


@kernel("void(float64[::1], float64[::1], float64[::1])")
def designed_correction(constants: Float, state: Float, out: Float) -> None:
    """Correction of the designed controller with what is known ahead, (6,) added to ``out``."""
    for k in range(6):
        feedback = state[at.S_SUM + k] - constants[at.C_PROPORTIONAL] * state[at.S_FILTERED + k]
        out[k] += feedback + state[at.S_FORWARD + k]
