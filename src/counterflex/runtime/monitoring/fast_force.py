"""The force sensor's own samples: what turns with the spindle, and the rest.

Ahead of the notches (:mod:`counterflex.runtime.monitoring.spindle_lines`) slow force is taken out by two high-passes
of 60 Hz. How much they leave of it (an entry, the arm that swings) is seen from what they take out: with the second
low-pass of what the first high-pass leaves, passed through a third, a line at f has ``e / b = r sqrt(1 + r^2)``, r = f
by 60 Hz, and a step of the force ``e / b = 1.15``. What is no more than :data:`SLOWER` times b is therefore slower
than 54 Hz, or a step.

What reaches a flange sensor is the cutting force through the spindle's inertia: above the robot's own modes only a part
of it. So amplitudes are compared with each other and with their own past, never as absolute forces.
"""

from __future__ import annotations

import math
from typing import Final

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.core.records import Record, Records
from counterflex.runtime.monitoring.records import HARMONICS, MONITOR_TYPES
from counterflex.runtime.monitoring.spindle_lines import (
    FIRST_SLIP,
    LINES,
    NOTCH_S,
    SLOW_HZ,
    choose_lines,
    folded,
    follow_speed,
    set_lines,
    set_wave,
)
from counterflex.runtime.monitoring.tooth_pattern import compare_pattern, measure, see_lines

SETTLED_S: Final = 0.15
"""Time after a gap or another speed before amplitudes count."""
SLOWER: Final = 1.2
"""Residual that a force slower than 54 Hz or a step of the force leaves at most, by what lies about the corner."""
LEAST_RATE: Final = 10.0
"""Least sampling rate by the corner of the high-passes."""


@kernel("void(Samples, float64[::1], int64, float64, float64, float64, int64)", **MONITOR_TYPES)
def _take_sample(d: Record, sample: Float, lines: int, share: float, forget: float, gain: float, early: int) -> None:
    """One sample through high-passes and notches; the energies of the rest and of what lies about the corner."""
    whole = (1.0 - 0.5 * share) / (1.0 - share)  # gain 1 at half the sampling rate
    energy = slower = 0.0
    for axis in range(3):
        stages, line = d.high_pass[axis], d.lines[axis]
        stages[0] += share * (sample[axis] - stages[0])
        x = whole * (sample[axis] - stages[0])
        stages[1] += share * (x - stages[1])
        e = whole * (x - stages[1])
        d.slower[axis] += share * (stages[1] - d.slower[axis])
        slower += d.slower[axis] ** 2
        for k in range(2 * lines):
            e -= line[k] * d.wave[k]
        for k in range(2 * lines):
            line[k] += gain * e * d.wave[k]
        energy += e * e
    d.settled += 1
    if d.settled > early:
        d.energy += forget * (energy - d.energy)
        d.slower_energy += forget * (slower - d.slower_energy)
    else:
        d.energy, d.slower_energy = energy, slower


@kernel("void(float64[:, ::1], int64, int64, float64, int64, Settings[::1], Memory[::1])", entry=True, **MONITOR_TYPES)
def take_samples(
    samples: Float, count: int, number: int, turn_per_s: float, teeth: int, settings: Records, memories: Records
) -> None:
    """The samples of a cycle.

    Args:
        samples: (n, >= 3) N, in time; the first three columns are the force in any fixed axes.
        count: How many of its rows.
        number: Sequence number of the first one.
        turn_per_s: Spindle speed, turns per second; 0 where not known.
        settings: (1,) SETTINGS.
        memories: (1,) MEMORY; samples and fast are changed.
    """
    s, m = settings[0], memories[0]
    d, out = m.samples, m.fast
    turn = turn_per_s * s.sample_period
    if turn != d.turn or teeth != d.teeth:
        set_lines(d, turn, teeth, s.sample_period)
    if count > 0 and number != d.following:
        d.settled = d.matched = 0
    d.following = number + count
    share = 1.0 - math.exp(-2.0 * math.pi * SLOW_HZ * s.sample_period)
    forget = 1.0 - math.exp(-s.sample_period / s.energy_time)
    gain, settled = 2.0 * s.sample_period / NOTCH_S, int(SETTLED_S / s.sample_period)
    lines = HARMONICS if turn > 0.0 else 0
    fresh = True
    if lines > 0:
        if d.slip == 0.0:
            d.slip = FIRST_SLIP
        if d.settled == 0 or (d.in_cut == 1 and d.strength <= LINES * d.energy):
            choose_lines(d, share)  # out of the cut, at the speed that the cut has shown
            d.in_cut = 0
    for i in range(count):
        d.angle += turn * (1.0 + d.slip)
        d.angle -= math.floor(d.angle)
        if not (math.isfinite(samples[i, 0]) and math.isfinite(samples[i, 1]) and math.isfinite(samples[i, 2])):
            d.settled, fresh = 0, True
            continue
        if d.settled == 0:
            for axis in range(3):
                d.high_pass[axis, 0], d.high_pass[axis, 1], d.slower[axis] = samples[i, axis], 0.0, 0.0
        if lines > 0:
            set_wave(d, fresh)
            fresh = False
        _take_sample(d, samples[i], lines, share, forget, gain, settled // 3)
    off = 0.0
    out.change = -1.0
    for k in range(lines):
        d.place[k] = folded(turn * (1.0 + d.slip) * d.order[k])
    if lines > 0 and count > 0:
        off = follow_speed(d, count * s.sample_period)
        see_lines(d, count)
        scale = max(0.0, m.now.ratio / m.reference.ratio) if m.reference.ratio > 0.0 else 1.0
        out.change = compare_pattern(d, m.steady_cycles > 0, m.calm == 1, scale, count * s.sample_period)
    measure(d, out)
    out.samples = count
    out.residual = math.sqrt(d.energy)
    out.slower = math.sqrt(SLOWER * SLOWER * d.slower_energy + 0.5 * off * NOTCH_S * NOTCH_S)
    fast_enough = s.sample_period * SLOW_HZ * LEAST_RATE <= 1.0
    out.ready = 1.0 if count > 0 and d.settled >= settled and turn > 0.0 and fast_enough else 0.0
