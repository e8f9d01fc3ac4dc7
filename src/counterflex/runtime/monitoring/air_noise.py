"""Noise of the force sensor though nothing is cut, and the inertia of what hangs behind it.

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

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.core.records import Record
from counterflex.runtime.monitoring.records import MONITOR_TYPES

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


@kernel("void(float64[::1], float64, float64)")
def two_stages(stages: Float, value: float, keep: float) -> None:
    """Two first-order stages one behind the other, (2,)."""
    stages[0] = keep * stages[0] + (1.0 - keep) * value
    stages[1] = keep * stages[1] + (1.0 - keep) * stages[0]


@kernel("void(Memory, Settings, Given, Result)", **MONITOR_TYPES)
def follow_motion(m: Record, s: Record, given: Record, result: Record) -> None:
    """Recent acceleration of the tool; changes place, velocity and acceleration.

    ``m``: MEMORY; changed. ``given``: of the step; a telegram came.
    """
    time, keep = given.elapsed * s.period, s.keep**given.elapsed
    square = 0.0
    for k in range(3):
        place = given.nominal[9 + k] + result.correction[k]
        before = m.velocity[k, 1]
        if m.placed == 1:
            two_stages(m.velocity[k], (place - m.place[k]) / time, keep)
        m.place[k] = place
        square += ((m.velocity[k, 1] - before) / time) ** 2
    m.placed = 1
    m.acceleration = max(math.sqrt(square), m.acceleration * math.exp(-time / SWING_S))


@kernel("float64(Memory, Settings)", **MONITOR_TYPES)
def noise(m: Record, s: Record) -> float:
    """Standard deviation of the filtered force while the tool moves evenly, N."""
    learnt = math.sqrt(m.idle) if m.idle_cycles >= IDLE_LEARNT else 0.0
    return float(max(s.noise, learnt))


@kernel("float64(Memory, Settings)", **MONITOR_TYPES)
def swing_mass(m: Record, s: Record) -> float:
    """Largest force that no cut needs by the recent acceleration, kg: ``3 k``."""
    mass = s.inertia_mass
    if m.swing_cycles >= IDLE_LEARNT:
        mass = math.sqrt(m.swing_force / max(m.swing_acceleration, EVEN_M_S2 * EVEN_M_S2))
    return float(CREST * mass)


@kernel("float64(Memory, Settings)", **MONITOR_TYPES)
def quiet_force(m: Record, s: Record) -> float:
    """Largest filtered force that is no cut, N."""
    swing = swing_mass(m, s) * m.acceleration
    return float(s.noise_z * noise(m, s) + swing)


@kernel("void(Memory, Settings, float64)", **MONITOR_TYPES)
def learn_quiet(m: Record, s: Record, force: float) -> None:
    """Take a cycle out of the cut.

    ``m``: MEMORY; changed. ``force``: filtered size of the measured force, N.
    """
    moved = m.acceleration
    least = s.period / IDLE_S
    if moved <= EVEN_M_S2:
        m.idle_cycles += 1
        share = max(least, 1.0 / m.idle_cycles)
        m.idle += share * (force * force - m.idle)
        return
    m.swing_cycles += 1
    share = max(least, 1.0 / m.swing_cycles)
    m.swing_force += share * (force * force - m.swing_force)
    m.swing_acceleration += share * (moved * moved - m.swing_acceleration)
