"""What the force sensor shows though nothing is cut: noise, and the inertia of what hangs behind it.

Both are learnt out of the cut, apart from each other. While the tool moves evenly only noise is left. After an
acceleration the spindle's inertia shows, and the arm swings on; both grow with it. How strongly the tool was
accelerated recently (commanded place, correction included, through the force filter), dying away as the arm does::

    moved = max(|a|, moved exp(-T / 0.2 s))

So the force that no cut needs is ``z noise + 3 k moved``: noise is random and z its standard deviations for a stated
rate of false alarms; a swing is not, its peak is below three times its root mean square.
``k = rms(force) / rms(moved)`` out of the cut, in kg, begins as the mass behind the sensor.
"""

from __future__ import annotations

import math
from typing import Final

from counterflex.core.arrays import Float, Int
from counterflex.core.jit import kernel
from counterflex.runtime.monitoring import layout as ml
from counterflex.runtime.state import layout as at

IDLE_LEARNT: Final = 50
"""Cycles out of the cut after which what they showed is believed."""
IDLE_S: Final = 2.0
"""Memory of it."""
SWING_S: Final = 0.2
"""Over which a swing of the arm dies away: 8 Hz with a damping ratio of 0.1."""
EVEN_M_S2: Final = 0.05
"""Recent acceleration below which the tool counts as moving evenly: 5 N of 100 kg."""
CREST: Final = 3.0
"""Peak of a swing by its root mean square."""


@kernel("void(float64[::1], int64, float64, float64)")
def two_stages(state: Float, place: int, value: float, keep: float) -> None:
    """Two first-order stages: ``state[place]``, then ``state[place + 1]``."""
    state[place] = keep * state[place] + (1.0 - keep) * value
    state[place + 1] = keep * state[place + 1] + (1.0 - keep) * state[place]


@kernel("void(float64[::1], float64[::1], int64, float64[::1], float64[::1], int64[::1])")
def follow_motion(given: Float, step_results: Float, elapsed: int, constants: Float, state: Float, whole: Int) -> None:
    """How strongly the tool was accelerated recently; changes S_PLACE, S_VELOCITY, S_MOVED.

    Args:
        given: (at.GIVEN,) inputs of the step.
        step_results: (at.RESULTS,) of the step.
        elapsed: Cycles since the last telegram, at least 1.
        constants: (CONSTANTS,).
        state: (STATE,); changed.
        whole: (WHOLE,); changed.
    """
    time, keep = elapsed * constants[ml.C_PERIOD], constants[ml.C_KEEP] ** elapsed
    square = 0.0
    for k in range(3):
        place = given[at.G_NOMINAL + 9 + k] + step_results[at.R_CORRECTION + k]
        first = ml.S_VELOCITY + 2 * k
        before = state[first + 1]
        if whole[ml.N_PLACED] == 1:
            two_stages(state, first, (place - state[ml.S_PLACE + k]) / time, keep)
        state[ml.S_PLACE + k] = place
        square += ((state[first + 1] - before) / time) ** 2
    whole[ml.N_PLACED] = 1
    state[ml.S_MOVED] = max(math.sqrt(square), state[ml.S_MOVED] * math.exp(-time / SWING_S))


@kernel("float64(float64[::1], float64[::1], int64[::1])")
def noise(constants: Float, state: Float, whole: Int) -> float:
    """Standard deviation of the filtered force while the tool moves evenly, N."""
    learnt = math.sqrt(state[ml.S_IDLE]) if whole[ml.N_IDLE] >= IDLE_LEARNT else 0.0
    return float(max(constants[ml.C_NOISE], learnt))


@kernel("float64(float64[::1], float64[::1], int64[::1])")
def swing_mass(constants: Float, state: Float, whole: Int) -> float:
    """Largest force that no cut needs by the recent acceleration, kg: ``3 k``."""
    mass = constants[ml.C_INERTIA]
    if whole[ml.N_SWUNG] >= IDLE_LEARNT:
        mass = math.sqrt(state[ml.S_SWUNG] / max(state[ml.S_SWUNG + 1], EVEN_M_S2 * EVEN_M_S2))
    return float(CREST * mass)


@kernel("float64(float64[::1], float64[::1], int64[::1])")
def quiet_force(constants: Float, state: Float, whole: Int) -> float:
    """Largest filtered force that is no cut, N."""
    swing = swing_mass(constants, state, whole) * state[ml.S_MOVED]
    return float(constants[ml.C_Z] * noise(constants, state, whole) + swing)


@kernel("void(float64, float64[::1], float64[::1], int64[::1])")
def learn_quiet(force: float, constants: Float, state: Float, whole: Int) -> None:
    """Take a cycle out of the cut.

    Args:
        force: Filtered size of the measured force, N.
        constants: (CONSTANTS,).
        state: (STATE,); changed.
        whole: (WHOLE,); changed.
    """
    moved = state[ml.S_MOVED]
    least = constants[ml.C_PERIOD] / IDLE_S
    if moved <= EVEN_M_S2:
        whole[ml.N_IDLE] += 1
        share = max(least, 1.0 / whole[ml.N_IDLE])
        state[ml.S_IDLE] += share * (force * force - state[ml.S_IDLE])
        return
    whole[ml.N_SWUNG] += 1
    share = max(least, 1.0 / whole[ml.N_SWUNG])
    state[ml.S_SWUNG] += share * (force * force - state[ml.S_SWUNG])
    state[ml.S_SWUNG + 1] += share * (moved * moved - state[ml.S_SWUNG + 1])
