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

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.core.records import Record, Records
from counterflex.runtime.monitoring.records import HARMONICS, MEMORY, SAMPLES, SETTINGS

GAIN: Final = 0.06
"""mu of the notches: 9.5 Hz on each side at 1 kHz, memory 33 ms."""
SLOW_HZ: Final = 60.0
"""Corner of the high-passes: the mean force and the robot's own modes lie below."""
SETTLED: Final = 150
"""Samples after a gap or another speed before amplitudes are believed."""
SLOWER: Final = 1.2
"""Residual that a force slower than 54 Hz or a step of the force leaves at most, by what lies about the corner."""
_CLOSE: Final = 0.025  # lines closer than this share of the sampling rate are one line


@kernel("float64(float64)")
def folded(turns: float) -> float:
    """Apparent frequency, 0 .. 1/2 of the sampling rate, of a line of ``turns`` per sample."""
    rest = turns - math.floor(turns)
    return min(rest, 1.0 - rest)


@kernel("void(Samples, float64, int64, float64)", Samples=SAMPLES)
def set_lines(d: Record, turn: float, teeth: int, slow: float) -> None:
    """Choose the lines of a spindle speed: those that fall apart, above the high-pass and below half the rate.

    Args:
        d: SAMPLES; changed.
        turn: Turns of the spindle per sample.
        teeth: Of the tool.
        slow: Corner of the high-pass by the sampling rate.
    """
    d.lines[:] = 0.0
    d.frequency[:] = -1.0
    d.turn = turn
    d.settled, d.turn_line, d.tooth_line, d.separate = 0, -1, -1, 0
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
            if abs(d.frequency[j] - f) < _CLOSE:
                place = j
        if place < 0:
            own = turn * order - math.floor(turn * order)
            d.frequency[used] = 1.0 - own if own > 0.5 else own
            place = used
            used += 1
            if order == 1:
                d.separate = 1
        if order == 1:
            d.turn_line = place
        if order == z:
            d.tooth_line = place
    if z == 1:
        d.separate = 0


@kernel("float64(Samples, int64, float64)", Samples=SAMPLES)
def _amplitude(d: Record, line: int, share: float) -> float:
    """Amplitude of a line over the three axes, before the high-passes; 0 for no line."""
    if line < 0:
        return 0.0
    total = 0.0
    for axis in range(3):
        cosine, sine = d.lines[axis, 2 * line], d.lines[axis, 2 * line + 1]
        total += cosine * cosine + sine * sine
    # |(1 - s/2) (1 - 1/z) / (1 - (1 - s) / z)| of each high-pass at the line.
    cosine, keep = math.cos(2.0 * math.pi * d.frequency[line]), 1.0 - share
    gain = (1.0 - 0.5 * share) ** 2 * (2.0 - 2.0 * cosine) / (1.0 - 2.0 * keep * cosine + keep * keep)
    return math.sqrt(total) / gain


@kernel("int64(Samples, int64)", Samples=SAMPLES)
def _set_wave(d: Record, number: int) -> int:
    """Cosine and sine of every line at a sample; returns the number of lines."""
    lines = 0
    for k in range(HARMONICS):
        f = d.frequency[k]
        if f < 0.0:
            break
        angle = number * f
        angle = 2.0 * math.pi * (angle - math.floor(angle))
        d.wave[2 * k], d.wave[2 * k + 1] = math.cos(angle), math.sin(angle)
        lines += 1
    return lines


@kernel("void(Samples, float64[::1], int64, float64, float64)", Samples=SAMPLES)
def _take_sample(d: Record, sample: Float, lines: int, share: float, forget: float) -> None:
    """One sample through high-passes and notches; the energies of the rest and of what lies about the corner.

    Args:
        d: SAMPLES; changed.
        sample: (>= 3,) N.
        lines: Number of lines.
        share: Of the new value in the low-passes.
        forget: Of the new value in the energies.
    """
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
            line[k] += GAIN * e * d.wave[k]
        energy += e * e
    d.settled += 1
    if d.settled > SETTLED // 3:
        d.energy += forget * (energy - d.energy)
        d.slower_energy += forget * (slower - d.slower_energy)
    else:
        d.energy, d.slower_energy = energy, slower


@kernel(
    "void(float64[:, ::1], int64, int64, float64, int64, Settings[::1], Memory[::1])",
    Settings=SETTINGS,
    Memory=MEMORY,
    entry=True,
)
def take_samples(
    samples: Float, count: int, number: int, turn_per_s: float, teeth: int, settings: Records, memories: Records
) -> None:
    """The samples of a cycle.

    Args:
        samples: (n, >= 3) N, in time; the first three columns are the force in any fixed axes.
        count: How many of its rows.
        number: Sequence number of the first one.
        turn_per_s: Spindle speed, turns per second; 0 where not known.
        teeth: Of the tool.
        settings: (1,) SETTINGS.
        memories: (1,) MEMORY; samples and fast are changed.
    """
    s, d, out = settings[0], memories[0].samples, memories[0].fast
    turn = turn_per_s * s.sample_period
    if turn != d.turn:
        set_lines(d, turn, teeth, SLOW_HZ * s.sample_period)
    if count > 0 and number != d.following:
        d.settled = 0
    d.following = number + count
    share = 1.0 - math.exp(-2.0 * math.pi * SLOW_HZ * s.sample_period)
    forget = 1.0 - math.exp(-s.sample_period / s.energy_time)
    for i in range(count):
        if not (math.isfinite(samples[i, 0]) and math.isfinite(samples[i, 1]) and math.isfinite(samples[i, 2])):
            d.settled = 0
            continue
        if d.settled == 0:
            for axis in range(3):
                d.high_pass[axis, 0], d.high_pass[axis, 1], d.slower[axis] = samples[i, axis], 0.0, 0.0
        _take_sample(d, samples[i], _set_wave(d, number + i), share, forget)
    out.samples = count
    out.residual = math.sqrt(d.energy)
    out.slower = math.sqrt(d.slower_energy)
    out.turn = _amplitude(d, d.turn_line, share)
    out.tooth = _amplitude(d, d.tooth_line, share)
    out.ready = 1.0 if count > 0 and d.settled >= SETTLED else 0.0
    out.separate = 1.0 if d.separate == 1 else 0.0
