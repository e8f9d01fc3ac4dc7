"""What the force sensor's own samples (1 kHz) say beyond the mean force: what turns with the spindle, and the rest.

The tooth passing frequency of a fast spindle lies above half the sampling rate (13 000 rpm with three teeth: 650 Hz
against 500 Hz) and folds back: a line at f appears at ``|f - round(f / f_s) f_s|``. Where the spindle speed is known
the places of all its harmonics are known too, folded or not, and can be told from what does not turn with the spindle,
unless two of them fall on the same place.

Sample by sample: slow force out (two high-passes, 60 Hz), then an adaptive notch per harmonic (Widrow et al. 1975)::

    e = x - sum_k (a_k cos th_k + b_k sin th_k),    a_k += mu e cos th_k,    b_k += mu e sin th_k

A notch is about ``mu f_s / (2 pi)`` wide on each side and follows the true speed within that. ``sqrt(a_k^2 + b_k^2)``
over the three axes is the amplitude of a harmonic, the energy of e the vibration that is none.

Of the force that is slow (an entry, the arm that swings) the high-passes leave a rest. How much it can be is seen from
what they take out: with the second low-pass of what the first high-pass leaves, passed through a third, a line at f
has ``e / b = r sqrt(1 + r^2)``, r = f by 60 Hz, and a step of the force ``e / b = 1.15``. What is no more than
:data:`SLOWER` times b is therefore slower than 54 Hz, or a step.

What reaches a flange sensor is the cutting force through the spindle's inertia: above the robot's own modes only a part
of it, the same part in every cycle. So amplitudes are judged against their own past, never as absolute forces.
"""

from __future__ import annotations

import math
from typing import Final

from counterflex.core.arrays import Float, Int
from counterflex.core.jit import kernel
from counterflex.runtime.monitoring import layout as ml

HARMONICS: Final = 8
"""Lines that are followed: one to six times per turn, and the tooth passing with its first harmonic."""
GAIN: Final = 0.06
"""mu of the notches: 9.5 Hz on each side at 1 kHz, memory 33 ms."""
SLOW_HZ: Final = 60.0
"""Corner of the high-passes: the mean force and the robot's own modes lie below."""
SETTLED: Final = 150
"""Samples after a gap or another speed before amplitudes are believed."""
SLOWER: Final = 1.2
"""Residual that a force slower than 54 Hz or a step of the force leaves at most, by what lies about the corner."""
_CLOSE: Final = 0.025  # lines closer than this share of the sampling rate are one line

# Memory, float64: 6 of the high-passes, 3, 3 x HARMONICS x 2 amplitudes, two energies, speed
_SLOWER: Final = 6  # 3: third low-pass
_LINES: Final = 9
_ENERGY: Final = _LINES + 3 * HARMONICS * 2
_SLOWER_ENERGY: Final = _ENERGY + 1
_SPEED: Final = _ENERGY + 2
_FREQUENCY: Final = _SPEED + 1  # HARMONICS, turns of the line per sample, folded; -1 unused
_WAVE: Final = _FREQUENCY + HARMONICS  # cos and sin of each line, this sample
MEMORY: Final = _WAVE + 2 * HARMONICS
# Memory, int64
_SINCE: Final = 0
_NEXT: Final = 1
_TURN_AT: Final = 2  # place of the line once per turn, -1
_TOOTH_AT: Final = 3
_SEPARATE: Final = 4
COUNTS: Final = 5


@kernel("float64(float64)")
def folded(turns: float) -> float:
    """Apparent frequency, 0 .. 1/2 of the sampling rate, of a line of ``turns`` per sample."""
    rest = turns - math.floor(turns)
    return min(rest, 1.0 - rest)


@kernel("void(float64, int64, float64, float64[::1], int64[::1])")
def set_lines(turn: float, teeth: int, slow: float, memory: Float, counts: Int) -> None:
    """Choose the lines of a spindle speed: those that fall apart, above the high-pass and below half the rate.

    Args:
        turn: Turns of the spindle per sample.
        teeth: Of the tool.
        slow: Corner of the high-pass by the sampling rate.
        memory: (MEMORY,); changed.
        counts: (COUNTS,); changed.
    """
    for k in range(_LINES, _ENERGY):
        memory[k] = 0.0
    for k in range(HARMONICS):
        memory[_FREQUENCY + k] = -1.0
    memory[_SPEED] = turn
    counts[_SINCE], counts[_TURN_AT], counts[_TOOTH_AT], counts[_SEPARATE] = 0, -1, -1, 0
    if turn <= 0.0:
        return
    z = max(1, teeth)
    used = 0
    for k in range(HARMONICS):
        order = z if k == 0 else (2 * z if k == 1 else k - 1)
        f = folded(turn * order)
        if f < slow or f > 0.5 - 0.5 * _CLOSE:
            continue
        place = -1
        for j in range(used):
            if abs(memory[_FREQUENCY + j] - f) < _CLOSE:
                place = j
        if place < 0:
            memory[_FREQUENCY + used] = turn * order - math.floor(turn * order)
            if memory[_FREQUENCY + used] > 0.5:
                memory[_FREQUENCY + used] = 1.0 - memory[_FREQUENCY + used]
            place = used
            used += 1
            if order == 1:
                counts[_SEPARATE] = 1
        if order == 1:
            counts[_TURN_AT] = place
        if order == z:
            counts[_TOOTH_AT] = place
    if z == 1:
        counts[_SEPARATE] = 0


@kernel("float64(float64[::1], int64, float64)")
def _amplitude(memory: Float, line: int, share: float) -> float:
    """Amplitude of a line over the three axes, before the high-passes; 0 for no line."""
    if line < 0:
        return 0.0
    total = 0.0
    for axis in range(3):
        base = _LINES + axis * HARMONICS * 2 + 2 * line
        total += memory[base] * memory[base] + memory[base + 1] * memory[base + 1]
    # |(1 - s/2) (1 - 1/z) / (1 - (1 - s) / z)| of each high-pass at the line.
    cosine, keep = math.cos(2.0 * math.pi * memory[_FREQUENCY + line]), 1.0 - share
    gain = (1.0 - 0.5 * share) ** 2 * (2.0 - 2.0 * cosine) / (1.0 - 2.0 * keep * cosine + keep * keep)
    return math.sqrt(total) / gain


@kernel("void(float64[:, ::1], int64, int64, float64, int64, float64, float64, float64[::1], int64[::1], float64[::1])")
def take_samples(
    samples: Float,
    count: int,
    number: int,
    turn_per_s: float,
    teeth: int,
    sample_s: float,
    memory_s: float,
    memory: Float,
    counts: Int,
    out: Float,
) -> None:
    """The samples of a cycle.

    Args:
        samples: (n, >= 3) N, in time; the first three columns are the force in any fixed axes.
        count: How many of its rows.
        number: Sequence number of the first one.
        turn_per_s: Spindle speed, turns per second; 0 where not known.
        teeth: Of the tool.
        sample_s: Sampling period.
        memory_s: Of the energy of the rest.
        memory: (MEMORY,); changed.
        counts: (COUNTS,); changed.
        out: (FAST,) written, see :mod:`counterflex.runtime.monitoring.layout`.
    """
    turn = turn_per_s * sample_s
    if turn != memory[_SPEED]:
        set_lines(turn, teeth, SLOW_HZ * sample_s, memory, counts)
    if count > 0 and number != counts[_NEXT]:
        counts[_SINCE] = 0
    counts[_NEXT] = number + count
    share = 1.0 - math.exp(-2.0 * math.pi * SLOW_HZ * sample_s)
    whole = (1.0 - 0.5 * share) / (1.0 - share)  # gain 1 at half the sampling rate
    forget = 1.0 - math.exp(-sample_s / memory_s)
    for i in range(count):
        if not (math.isfinite(samples[i, 0]) and math.isfinite(samples[i, 1]) and math.isfinite(samples[i, 2])):
            counts[_SINCE] = 0
            continue
        if counts[_SINCE] == 0:
            for axis in range(3):
                memory[2 * axis], memory[2 * axis + 1], memory[_SLOWER + axis] = samples[i, axis], 0.0, 0.0
        lines = 0
        for k in range(HARMONICS):
            f = memory[_FREQUENCY + k]
            if f < 0.0:
                break
            angle = (number + i) * f
            angle = 2.0 * math.pi * (angle - math.floor(angle))
            memory[_WAVE + 2 * k], memory[_WAVE + 2 * k + 1] = math.cos(angle), math.sin(angle)
            lines += 1
        energy = slower = 0.0
        for axis in range(3):
            memory[2 * axis] += share * (samples[i, axis] - memory[2 * axis])
            x = whole * (samples[i, axis] - memory[2 * axis])
            memory[2 * axis + 1] += share * (x - memory[2 * axis + 1])
            e = whole * (x - memory[2 * axis + 1])
            memory[_SLOWER + axis] += share * (memory[2 * axis + 1] - memory[_SLOWER + axis])
            slower += memory[_SLOWER + axis] ** 2
            base = _LINES + axis * HARMONICS * 2
            for k in range(2 * lines):
                e -= memory[base + k] * memory[_WAVE + k]
            for k in range(2 * lines):
                memory[base + k] += GAIN * e * memory[_WAVE + k]
            energy += e * e
        counts[_SINCE] += 1
        if counts[_SINCE] > SETTLED // 3:
            memory[_ENERGY] += forget * (energy - memory[_ENERGY])
            memory[_SLOWER_ENERGY] += forget * (slower - memory[_SLOWER_ENERGY])
        else:
            memory[_ENERGY], memory[_SLOWER_ENERGY] = energy, slower
    out[ml.F_SAMPLES] = count
    out[ml.F_RESIDUAL] = math.sqrt(memory[_ENERGY])
    out[ml.F_SLOWER] = math.sqrt(memory[_SLOWER_ENERGY])
    out[ml.F_TURN] = _amplitude(memory, counts[_TURN_AT], share)
    out[ml.F_TOOTH] = _amplitude(memory, counts[_TOOTH_AT], share)
    out[ml.F_READY] = 1.0 if count > 0 and counts[_SINCE] >= SETTLED else 0.0
    out[ml.F_SEPARATE] = 1.0 if counts[_SEPARATE] == 1 else 0.0
