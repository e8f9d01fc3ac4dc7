"""Pattern of the force over a turn of the spindle, compared with the pattern of the cut so far.

Each line of the spindle has a phasor ``p_k = a_k - i b_k`` per axis. In a sound cut all phasors grow and shrink with
the force together: run-out is a constant pattern, thinner stock scales it. A lost tooth changes the lines between the
tooth passing against it. With ``r_k`` the remembered phasors, g the scale and delta the angle by which the pattern is
turned, both of the tooth passing alone, the change of the pattern is::

    change^2 = sum_between |p_k - g r_k exp(i k delta)|^2

The angle of the spindle follows its lines (:mod:`counterflex.runtime.monitoring.spindle_lines`), so delta is small in
the cut. In a gap of the stock there are no lines. Behind it the tooth passing shows delta up to whole teeth, and of
these the one counts that changes the pattern the least.

The spindle turns slower under load than commanded, and lines of high orders move through each other meanwhile. A line
counts while it lies off the tooth passing at the present speed, and has for :data:`APART_S`.

At exact fractions of the sampling rate (10 000 rpm: six samples a turn at 1 kHz) orders between the tooth passing fold
onto each other: they exchange their phasors, and their speed is uncertain. Where such lines hold the pattern, the
change is the rise of the amplitude of all of them, which a lost tooth raises and thinner stock takes down::

    change = sqrt(sum |p_k|^2) - g sqrt(mean sum |p_k|^2)
"""

from __future__ import annotations

import math
from typing import Final

from counterflex.core.jit import kernel
from counterflex.core.records import Record
from counterflex.runtime.monitoring.records import FAST, HARMONICS, MONITOR_TYPES
from counterflex.runtime.monitoring.spindle_lines import NOTCH_S, is_apart

APART_S: Final = 0.1
"""Time after which the amplitude of a line is its own again: three times tau."""
MEMORY_S: Final = 1.0
"""Memory of the pattern."""
KNOWN: Final = 75.0
"""Cycles of calm cut over which a line was averaged without coming near another one, before it counts."""
MOST: Final = 0.7
"""Least share of the pattern's energy in lines that count; with less the angle is uncertain."""
TOGETHER: Final = 1.0
"""Lines nearer to each other than this many turns of their phasors within tau, in rad, exchange their phases."""
MIXED_S: Final = 1.0
"""Time for which the phases of such lines count as exchanged: of lines so near, the speed is uncertain too."""
FORGOTTEN: Final = 8.0
"""Cycles of the average that a cycle near another line undoes."""
LARGEST: Final = 0.05
"""Largest turn of the pattern in a cycle, rad."""


@kernel("boolean(Samples, int64)", **MONITOR_TYPES)
def _is_clear(d: Record, line: int) -> bool:
    """Return whether a line is followed and lies off the tooth passing and its harmonics at the present speed."""
    return bool(d.active[line] >= 0.5 and is_apart(d.turn * (1.0 + d.slip), int(d.order[line]), d.teeth, d.period))


@kernel("boolean(Samples, int64)", **MONITOR_TYPES)
def _is_alone(d: Record, line: int) -> bool:
    """Return whether no other line, nor the image of this one at the edge of the band, folds to nearly its place."""
    least = TOGETHER * d.period / (2.0 * math.pi * NOTCH_S)
    alone = 1.0 - 2.0 * d.place[line] >= least
    for k in range(HARMONICS):
        alone = alone and (k == line or abs(d.place[k] - d.place[line]) >= least)
    return bool(alone)


@kernel("void(Samples, int64)", **MONITOR_TYPES)
def see_lines(d: Record, count: int) -> None:
    """Choose the lines whose amplitudes count.

    Args:
        d: SAMPLES; seen, mixed, clear and known are changed.
        count: Samples of the cycle.
    """
    for k in range(HARMONICS):
        if _is_clear(d, k):
            d.clear[k] += count
        else:
            d.clear[k] = 0.0
            d.known[k] = max(0.0, d.known[k] - FORGOTTEN)
        d.seen[k] = 1.0 if d.clear[k] * d.period >= APART_S else 0.0
        d.mixed[k] = max(0.0, d.mixed[k] - count * d.period) if _is_alone(d, k) else MIXED_S


@kernel("boolean(Samples, int64)", **MONITOR_TYPES)
def _is_known(d: Record, line: int) -> bool:
    """Return whether a line is seen and its amplitude was averaged for long enough."""
    return bool(d.seen[line] > 0.5 and d.known[line] >= KNOWN)


@kernel("boolean(Samples, int64)", **MONITOR_TYPES)
def _counts(d: Record, line: int) -> bool:
    """Return whether a line is known and its phase is its own."""
    return bool(_is_known(d, line) and d.mixed[line] <= 0.0)


@kernel("boolean(Samples, boolean)", **MONITOR_TYPES)
def _is_whole(d: Record, phases: bool) -> bool:
    """Return whether the tooth passing and lines with most of the energy between it count, by phase or by amplitude."""
    tooth, between, counted = False, 0.0, 0.0
    for k in range(HARMONICS):
        counts = _counts(d, k) if phases else _is_known(d, k)
        if int(d.order[k]) % max(1, d.teeth) == 0:
            tooth = tooth or counts
        else:
            between += d.gain[k] * d.square[k]
            counted += d.gain[k] * d.square[k] if counts else 0.0
    return bool(tooth and counted > MOST * between)


@kernel("void(Samples, Fast)", Fast=FAST, **MONITOR_TYPES)
def measure(d: Record, out: Record) -> None:
    """Amplitudes of the tooth passing and of the lines between, N, and whether both are seen.

    Args:
        d: SAMPLES.
        out: FAST; turn, tooth and separate are changed.
    """
    tooth = turns = 0.0
    teeth_seen = between_seen = 0.0
    for k in range(HARMONICS):
        if d.seen[k] > 0.5:
            square = 0.0
            for j in range(2):
                for axis in range(3):
                    square += d.lines[axis, 2 * k + j] ** 2
            if int(d.order[k]) % max(1, d.teeth) == 0:
                tooth += square * d.gain[k]
                teeth_seen = 1.0
            else:
                turns += square * d.gain[k]
                between_seen = 1.0
    out.turn, out.tooth, out.separate = math.sqrt(turns), math.sqrt(tooth), teeth_seen * between_seen
    if out.separate > 0.5 and _is_whole(d, True):
        out.separate = 2.0


@kernel("float64(Samples, float64)", **MONITOR_TYPES)
def _rise(d: Record, scale: float) -> float:
    """Rise of the amplitude of all lines between the tooth passing from their scaled past, N."""
    past = present = 0.0
    for k in range(HARMONICS):
        if _is_known(d, k) and int(d.order[k]) % max(1, d.teeth) != 0:
            past += d.gain[k] * d.square[k]
            for axis in range(3):
                present += d.gain[k] * (d.lines[axis, 2 * k] ** 2 + d.lines[axis, 2 * k + 1] ** 2)
    return max(0.0, math.sqrt(present) - scale * math.sqrt(past))


@kernel("float64(Samples)", **MONITOR_TYPES)
def _search_angle(d: Record) -> float:
    """Angle by which the pattern is turned: where present lines and pattern correlate most."""
    best, angle = -math.inf, 0.0
    steps = 16 * max(1, d.teeth)
    for step in range(steps):
        delta, total = 2.0 * math.pi * step / steps, 0.0
        for k in range(HARMONICS):
            if _counts(d, k):
                real, imaginary = _product(d, k)
                total += d.gain[k] * (real * math.cos(d.order[k] * delta) + imaginary * math.sin(d.order[k] * delta))
        if total > best:
            best, angle = total, delta
    return angle


@kernel("UniTuple(float64, 2)(Samples, int64)", **MONITOR_TYPES)
def _product(d: Record, line: int) -> tuple[float, float]:
    """Return ``p conj(r)`` of a line over the axes: real and imaginary part."""
    real = imaginary = 0.0
    for axis in range(3):
        a, b = d.lines[axis, 2 * line], d.lines[axis, 2 * line + 1]
        c, s = d.pattern[axis, 2 * line], d.pattern[axis, 2 * line + 1]
        real += a * c + b * s
        imaginary += a * s - b * c
    return real, imaginary


@kernel("void(Samples, float64)", **MONITOR_TYPES)
def _turn_pattern(d: Record, angle: float) -> None:
    """Turn the remembered pattern to the present angle of the spindle."""
    for k in range(HARMONICS):
        c, s = math.cos(d.order[k] * angle), math.sin(d.order[k] * angle)
        for axis in range(3):
            a, b = d.pattern[axis, 2 * k], d.pattern[axis, 2 * k + 1]
            d.pattern[axis, 2 * k], d.pattern[axis, 2 * k + 1] = c * a + s * b, c * b - s * a


@kernel("void(Samples)", **MONITOR_TYPES)
def _align(d: Record) -> None:
    """Turn the pattern to the present angle: searched over the turn at first, then by the slope of the correlation."""
    if d.matched == 0:
        _turn_pattern(d, _search_angle(d))
        d.matched = 1
    slope = curvature = 0.0
    for k in range(HARMONICS):
        if _counts(d, k):
            real, imaginary = _product(d, k)
            slope += d.gain[k] * d.order[k] * imaginary
            curvature += d.gain[k] * d.order[k] ** 2 * real
    if curvature > 0.0:
        _turn_pattern(d, min(LARGEST, max(-LARGEST, slope / curvature)))


@kernel("float64(Samples)", **MONITOR_TYPES)
def _change(d: Record) -> float:
    """Amplitude of the change between the tooth passing from the pattern, scaled to the present lines, N."""
    product = square = 0.0
    for k in range(HARMONICS):
        if _counts(d, k):
            product += d.gain[k] * _product(d, k)[0]
            for axis in range(3):
                square += d.gain[k] * (d.pattern[axis, 2 * k] ** 2 + d.pattern[axis, 2 * k + 1] ** 2)
    scale = max(0.0, product / square) if square > 0.0 else 0.0
    total = 0.0
    for k in range(HARMONICS):
        if _counts(d, k) and int(d.order[k]) % max(1, d.teeth) != 0:
            for axis in range(3):
                for j in range(2):
                    total += d.gain[k] * (d.lines[axis, 2 * k + j] - scale * d.pattern[axis, 2 * k + j]) ** 2
    return math.sqrt(total)


@kernel("void(Samples, float64)", **MONITOR_TYPES)
def _remember(d: Record, time: float) -> None:
    """Let the pattern follow the present lines, those that are seen."""
    for k in range(HARMONICS):
        if d.seen[k] > 0.5:
            d.known[k] = min(MEMORY_S / time, d.known[k] + 1.0)
            share, square = 1.0 / d.known[k], 0.0
            for axis in range(3):
                for j in range(2):
                    square += d.lines[axis, 2 * k + j] ** 2
                    d.pattern[axis, 2 * k + j] += share * (d.lines[axis, 2 * k + j] - d.pattern[axis, 2 * k + j])
            d.square[k] += share * (square - d.square[k])


@kernel("float64(Samples, boolean, boolean, float64, float64)", **MONITOR_TYPES)
def compare_pattern(d: Record, steady: bool, calm: bool, scale: float, time: float) -> float:
    """Amplitude of the change of the lines between the tooth passing from their pattern, N; -1 where it is not known.

    Args:
        d: SAMPLES; pattern, square, known and matched are changed.
        steady: The cut is steady.
        calm: It is, and nothing is suspected: the pattern follows it.
        scale: Of the mean force against that of the cut so far, for lines whose phases cannot be told apart.
        time: Since the last call, s.
    """
    if not steady:
        d.matched = 0
        return -1.0
    change = -1.0
    if _is_whole(d, True):
        _align(d)
        change = _change(d)
    elif _is_whole(d, False):
        change = _rise(d, scale)
    if calm:
        _remember(d, time)
    return change
