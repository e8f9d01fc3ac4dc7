"""Lines of the spindle in the force sensor's own samples, followed wherever they fold to.

The teeth of a fast spindle pass more often than half the sampling rate (13 000 rpm with three teeth: 650 Hz against
500 Hz), so that their lines fold back: a line at f appears at ``|f - round(f / f_s) f_s|``. No line has to be looked
for. Its phase at a sample is its order times the angle of the spindle there, so an adaptive notch (Widrow et al. 1975)
on the cosine and sine of that angle follows it wherever it folds to, at the edge of the band too::

    e = x - sum_k (a_k cos k psi + b_k sin k psi),    a_k += mu e cos k psi,    b_k += mu e sin k psi

Orders followed are those of the tooth passing and, between them, those that run-out or a lost tooth leave. The spindle
turns slower than commanded under load: by how much is seen from how fast the phasors ``a_k - i b_k`` turn, all orders
together, and ``psi`` follows it. Of what a notch follows with its time constant tau, ``2 pi delta tau`` of the
amplitude is left in e at a frequency that is off by delta.
"""

from __future__ import annotations

import math
from typing import Final

from counterflex.core.jit import kernel
from counterflex.core.records import Record
from counterflex.runtime.monitoring.records import FAST, HARMONICS, MONITOR_TYPES

NOTCH_S: Final = 0.033
"""Time constant tau of the notches: 4.8 Hz on each side. Shorter ones take chatter between the lines with them."""
TOOTH_ORDERS: Final = 6
"""Harmonics of the tooth passing that are followed; the other lines are orders between them, the lowest first."""
SLOW_HZ: Final = 60.0
"""Corner of the high-passes: the mean force and the robot's own modes lie below."""
FOLLOW: Final = 8.0
"""Gain of the spindle speed, 1/s of a turn of the phasors by 1 rad: well damped with the lag of the notches."""
SLIP: Final = 0.015
"""Largest share by which the spindle may be off its commanded speed: slip of an asynchronous motor at full load."""
FIRST_SLIP: Final = -0.004
"""Slip until lines show it: of an asynchronous motor under half its load. It parts lines that fold to one place."""
LINES: Final = 2.0
"""Squared amplitude of all lines by the energy of the rest from which on they show the speed of the spindle."""
RESOLVED: Final = 0.8
"""Lines as many turns of their phasors apart within tau as this, in rad, are told apart."""
VISIBLE_HZ: Final = 40.0
"""Folded lines below are too much weakened by the high-passes for an amplitude."""
CLEAR: Final = 1.6
"""The same for a line whose amplitude or phase alone counts."""
KEPT_S: Final = 1.0
"""Time over which an amplitude is forgotten that the samples do not show: of a sine at half the sampling rate."""


@kernel("float64(float64)", entry=True)
def folded(turns: float) -> float:
    """Apparent frequency, 0 .. 1/2 of the sampling rate, of a line of ``turns`` per sample."""
    rest = turns - math.floor(turns)
    return min(rest, 1.0 - rest)


@kernel("boolean(float64, int64, int64, float64)", entry=True)
def is_apart(turn: float, order: int, teeth: int, period: float) -> bool:
    """Return whether a line folds to a visible frequency, off the tooth passing and its harmonics unless it is one.

    ``turn``: turns of the spindle per sample.
    """
    z, unit = max(1, teeth), period / (2.0 * math.pi * NOTCH_S)
    f = folded(turn * order)
    if f <= VISIBLE_HZ * period:
        return False
    if order % z == 0:
        return True
    for k in range(1, TOOTH_ORDERS + 1):
        if abs(folded(turn * k * z) - f) < (CLEAR if k <= 2 else RESOLVED) * unit:
            return False
    return True


@kernel("int64(Samples, int64, int64, int64, int64)", **MONITOR_TYPES)
def _list_orders(d: Record, used: int, first: int, last: int, z: int) -> int:
    """List orders from first to last that are not listed yet; z above 0 takes multiples of it, below 0 the others."""
    for order in range(first, last + 1):
        if used == HARMONICS:
            break
        if (order % abs(z) == 0) == (z > 0):
            listed = False
            for k in range(used):
                listed = listed or int(d.order[k]) == order
            if not listed:
                d.order[used] = float(order)
                used += 1
    return used


@kernel("void(Samples, float64, int64, float64)", **MONITOR_TYPES)
def set_lines(d: Record, turn: float, teeth: int, period: float) -> None:
    """Begin with the lines of a spindle speed and a tool; by how much the spindle was off its speed is kept.

    Orders are listed the strongest first: the tooth passing, what run-out leaves below it, its next harmonic, etc.

    Args:
        d: SAMPLES; changed.
        turn: Turns of the spindle per sample; 0 where not known.
        teeth: Of the tool; 0 where not known.
        period: Of the samples, s.
    """
    d.lines[:] = 0.0
    d.before[:] = 0.0
    d.pattern[:] = 0.0
    d.active[:] = d.seen[:] = d.clear[:] = d.known[:] = d.square[:] = d.mixed[:] = 0.0
    d.turn, d.teeth, d.period = turn, teeth, period
    d.settled = d.matched = d.in_cut = 0
    d.turning = 0.0
    z = max(1, teeth)
    used = _list_orders(d, 0, z, z, z)
    for harmonic in range(2, TOOTH_ORDERS + 1):
        if z > 1 and harmonic < 4:
            used = _list_orders(d, used, (harmonic - 2) * z + 1, (harmonic - 1) * z - 1, -z)
        used = _list_orders(d, used, harmonic * z, harmonic * z, z)
    if z > 1:
        used = _list_orders(d, used, 1, HARMONICS * z, -z)
    _list_orders(d, used, z, HARMONICS * z, z)


@kernel("float64(float64, int64)")
def mean_gain(turns: float, count: int) -> float:
    """Squared amplitude that the mean over ``count`` samples leaves of a line of ``turns`` per sample."""
    sine = math.sin(math.pi * turns)
    if abs(sine) < 1e-9:
        return 1.0
    return (math.sin(math.pi * turns * count) / (count * sine)) ** 2


@kernel("float64(float64, float64)")
def _high_pass_square(turns: float, share: float) -> float:
    """Squared gain of the two high-passes at a line of ``turns`` per sample."""
    # |(1 - s/2) (1 - 1/z) / (1 - (1 - s) / z)| of each high-pass at the line.
    cosine, keep = math.cos(2.0 * math.pi * turns), 1.0 - share
    gain = (1.0 - 0.5 * share) ** 2 * (2.0 - 2.0 * cosine) / (1.0 - 2.0 * keep * cosine + keep * keep)
    return max(1e-12, gain * gain)


@kernel("void(Samples, float64)", **MONITOR_TYPES)
def choose_lines(d: Record, share: float) -> None:
    """Follow every line that is told apart from those before it, at the speed at which the spindle turns now.

    Args:
        d: SAMPLES; active and gains are changed, and lines that are given up are zero.
        share: Of the new value in the low-passes.
    """
    turn = d.turn * (1.0 + d.slip)
    spacing = RESOLVED * d.period / (2.0 * math.pi * NOTCH_S)
    for k in range(HARMONICS):
        f = folded(turn * d.order[k])
        active = f > spacing
        for j in range(k):
            if d.active[j] > 0.5 and abs(folded(turn * d.order[j]) - f) < spacing:
                active = False
        if not active:
            for axis in range(3):
                d.lines[axis, 2 * k] = d.lines[axis, 2 * k + 1] = 0.0
        d.gain[k] = 1.0 / _high_pass_square(f, share)
        d.active[k] = 1.0 if active else 0.0


@kernel("void(Samples, boolean)", **MONITOR_TYPES)
def set_wave(d: Record, first: bool) -> None:
    """Cosine and sine of every line that is followed at the present angle; within a cycle turned on by one sample."""
    speed = d.turn * (1.0 + d.slip)
    for k in range(HARMONICS):
        if d.active[k] < 0.5:
            d.wave[2 * k] = d.wave[2 * k + 1] = 0.0
        elif first:
            turns, step = d.angle * d.order[k], speed * d.order[k]
            angle, step = 2.0 * math.pi * (turns - math.floor(turns)), 2.0 * math.pi * (step - math.floor(step))
            d.wave[2 * k], d.wave[2 * k + 1] = math.cos(angle), math.sin(angle)
            d.step[2 * k], d.step[2 * k + 1] = math.cos(step), math.sin(step)
        else:
            c, s = d.wave[2 * k], d.wave[2 * k + 1]
            d.wave[2 * k] = c * d.step[2 * k] - s * d.step[2 * k + 1]
            d.wave[2 * k + 1] = s * d.step[2 * k] + c * d.step[2 * k + 1]


@kernel("float64(Samples, float64)", **MONITOR_TYPES)
def follow_speed(d: Record, time: float) -> float:
    """Let the spindle speed follow the turning of the phasors; squared speed that lines are off by, (rad/s)^2 N^2.

    Args:
        d: SAMPLES; changed.
        time: Since the last call, s.
    """
    turned = weight = energy = leaks = 0.0
    voters, edge = max(4, d.teeth + 1), 0.5 - RESOLVED * d.period / (2.0 * math.pi * NOTCH_S)
    for k in range(HARMONICS):
        if d.active[k] < 0.5:
            continue
        real = imaginary = 0.0
        at_edge = d.place[k] > edge  # its image turns the other way
        for axis in range(3):
            a, b = d.lines[axis, 2 * k], d.lines[axis, 2 * k + 1]
            c, s = d.before[axis, 2 * k], d.before[axis, 2 * k + 1]
            real += a * c + b * s
            imaginary += a * s - b * c
            if at_edge:
                a, b = a - time / KEPT_S * a, b - time / KEPT_S * b
            d.lines[axis, 2 * k], d.lines[axis, 2 * k + 1] = a, b
            d.before[axis, 2 * k], d.before[axis, 2 * k + 1] = a, b
        energy += real
        order = d.order[k]
        if not at_edge:
            leaks += order * order * real
        if k < voters and real > 0.0 and not at_edge:
            turned += order * imaginary
            weight += order * order * real
    falls = energy < (1.0 - 0.25 * time / NOTCH_S) * d.strength
    d.strength = energy
    if falls or energy <= LINES * d.energy or weight <= 0.0:  # what is left of a cut, noise, or chatter
        d.turning = 0.0
        return 0.0
    d.in_cut = 1
    speed = turned / weight / time  # of the spindle, beside the speed that is followed, rad/s
    share = time / (NOTCH_S + time)
    d.turning += share * (speed - d.turning)
    d.slip += FOLLOW * time * speed * d.period / (2.0 * math.pi * d.turn)
    d.slip = min(SLIP, max(-SLIP, d.slip))
    return float(d.turning * d.turning * max(0.0, leaks))


@kernel("void(Samples, Fast, float64, int64, int64, float64)", Fast=FAST, **MONITOR_TYPES)
def estimate_folded(d: Record, fast: Record, turn: float, teeth: int, count: int, period: float) -> None:
    """Estimate what lines leave in the mean force of a cycle, from their amplitudes and places alone, as a replay can.

    A harmonic that folds below the high-passes is not seen: its amplitude is taken for that of those that are.

    Args:
        d: SAMPLES; slow and alias are changed.
        fast: FAST.
        turn: Commanded turns of the spindle per sample.
        count: Samples of a cycle.
        period: Of the samples, s.
    """
    d.slow = d.alias = 0.0
    tooth, turns = 0.5 * fast.tooth**2, 0.5 * fast.turn**2
    if turn <= 0.0 or not math.isfinite(tooth + turns):
        return
    z, slow, seen, left = max(1, teeth), 0, 0, 0.0
    for k in range(1, TOOTH_ORDERS + 1):
        f = folded(turn * (1.0 + FIRST_SLIP) * k * z)
        if f <= VISIBLE_HZ * period:
            slow += 1
        else:
            seen += 1
            left += mean_gain(f, count)
    hidden = tooth * (left + slow) / seen if seen > 0 else 0.0
    for k in range(1, z):
        hidden += turns * mean_gain(folded(turn * (1.0 + FIRST_SLIP) * k), count) / (z - 1)
    d.slow = math.sqrt(tooth * slow / seen) if seen > 0 else 0.0
    d.alias = math.inf if seen == 0 else math.sqrt(hidden)
