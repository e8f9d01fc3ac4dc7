"""Kernels: how the tool bends away in a step of the cut, with the thrust on a descending end face as its damper.

The thrust of a face that descends at the rate d is ``F = a d^p`` with the exponent p of the chip, below 1. Its slope
``p F / d`` grows without bound as the descent gets slow: in a ramp of 1 in 50 it is 1e5 N s/m, so the tool of a robot
follows the programmed descent within a millisecond. A thrust held over a step of some milliseconds throws the tool out
of the cut instead and lets it fall back in the next one, with a mean far below the true one. So each step of the
motion solves for the thrust together with the rate that it leaves.
"""

from __future__ import annotations

import math
from typing import Final

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.cutting.mean_force import mean_wrench

AMPLITUDE, EXPONENT, UP, PROGRAMMED, FORCE = 0, 1, 2, 5, 6
"""Places in the array of a thrust: a in N/(m/s)^p, p, the unit vector of the thrust (3), programmed descent in m/s, and
F in N at the descent at which a was found."""
THRUST_SIZE: Final = 7
_NEWTON = 8
"""Steps of Newton's rule at least: the equation is concave and is approached from below, so each doubles the digits."""
_MOST_NEWTON = 40
"""The same at most. With exponents near zero the first steps only climb to the root, over tens of decades."""
_SETTLED = 1e-8
"""Share of the descent that the last step may have gone: its square is what is left."""
_LEAST_EXPONENT = 0.02


@kernel("float64(float64, float64, float64, float64)")
def thrust_of_step(free_m_s: float, gain: float, amplitude: float, exponent: float) -> float:
    """Thrust F that agrees with the descent it leaves: ``F = a d^p``, ``d = free - gain F``.

    Args:
        free_m_s: Descent at the end of the step without thrust, m/s; none acts where the tool rises.
        gain: By how much a newton slows the descent within the step, m/(s N), > 0.
        amplitude: a, N/(m/s)^p, >= 0.
        exponent: p, 0 to 1.

    Returns:
        F in N.
    """
    if free_m_s <= 0.0 or amplitude <= 0.0:
        return 0.0
    p = max(exponent, _LEAST_EXPONENT)
    # Below the root: half of the free descent leaves room for half of the thrust, or the thrust alone takes half of it.
    # Whichever is less, both together stay below what there is.
    d = min(0.5 * free_m_s, (0.5 * free_m_s / (gain * amplitude)) ** (1.0 / p))
    for k in range(_MOST_NEWTON):
        if d <= 0.0:
            break
        power = gain * amplitude * d**p
        step = (d + power - free_m_s) / (1.0 + p * power / d)
        d -= step
        if k + 1 >= _NEWTON and abs(step) <= _SETTLED * d:
            break
    return float((free_m_s - min(max(d, 0.0), free_m_s)) / gain)


@kernel(
    "void(float64[:,::1], float64, float64, float64, float64[:,::1], float64[:,:,::1], float64[:,::1], float64,"
    " float64, float64[::1], float64[::1])"
)
def follow_descent(
    depth: Float,
    feed_m: float,
    drop_m: float,
    end_area_m2: float,
    terms: Float,
    arc: Float,
    levels: Float,
    axial_n: float,
    descent_m_s: float,
    thrust: Float,
    space: Float,
) -> None:
    """Find the part of an axial force that the descent makes, and the exponent with which it follows the descent.

    Arguments that are not listed are those of :func:`counterflex.cutting.mean_force.mean_wrench`.

    ``drop_m``: descent per tooth, > 0. ``axial_n``: axial force at this descent. ``descent_m_s``: the same descent as a
    rate, > 0. ``thrust``: array of a thrust; amplitude, exponent and force are written. ``space``: (6,), written.
    """
    mean_wrench(depth, feed_m, 0.0, 0.0, terms, arc, levels, space)
    level = space[2]
    mean_wrench(depth, feed_m, 0.5 * drop_m, end_area_m2, terms, arc, levels, space)
    whole, half = axial_n - level, space[2] - level
    if whole <= 0.0:
        return
    # A thrust that more than halves with half the descent rises faster than any law lets it: it is grain, and is held
    # to a plain damper.
    exponent = 1.0 if half <= 0.5 * whole else math.log2(whole / min(half, whole))
    thrust[AMPLITUDE], thrust[EXPONENT] = whole / descent_m_s**exponent, exponent
    thrust[FORCE] = whole


@kernel(
    "UniTuple(float64, 4)(float64, float64, float64)",
)
def oscillator(dt: float, omega: float, zeta: float) -> tuple[float, float, float, float]:
    """Exact step of ``x'' + 2 zeta w x' + w^2 x = 0`` over dt: (x, v) -> (a x + b v, c x + d v).

    Args:
        dt: s, >= 0.
        omega: Undamped angular frequency, rad/s.
        zeta: Damping ratio, > 0; at exactly 1 the neighbouring value 1 + 1e-9 is used.

    Returns:
        (a, b, c, d).
    """
    if zeta < 1.0:
        wd = omega * math.sqrt(1.0 - zeta * zeta)
        e = math.exp(-zeta * omega * dt)
        co, si = math.cos(wd * dt), math.sin(wd * dt) / wd
    else:
        wd = omega * math.sqrt(max(zeta * zeta - 1.0, 2e-9))
        fast, slow = math.exp((-zeta * omega - wd) * dt), math.exp((-zeta * omega + wd) * dt)
        e = 1.0
        co, si = 0.5 * (slow + fast), 0.5 * (slow - fast) / wd
    damp = zeta * omega
    return e * (co + damp * si), e * si, -e * omega * omega * si, e * (co - damp * si)


@kernel(
    "float64(float64[::1], float64[::1], float64[:, :, ::1], float64[:, ::1], int64, float64, float64[::1],"
    " float64[::1], float64, float64, float64)"
)
def bend_through_mode(
    displacement: Float,
    rate: Float,
    compliance: Float,
    offset: Float,
    i: int,
    share: float,
    force: Float,
    thrust: Float,
    dt: float,
    omega: float,
    zeta: float,
) -> float:
    """Advance the displacement of a tool that answers force and correction through one mode.

    Args:
        displacement: (6,) m, rad, changed.
        rate: (6,) of it, changed.
        compliance: (rows, 6, 6).
        offset: (rows, 3) m, the correction.
        i: Row.
        share: Of the row that has passed at the end of the step.
        force: (6,) N, N m on the tool in the step, its thrust included.
        thrust: That part of it, see :data:`UP`.
        dt: s, > 0.
        omega: rad/s.
        zeta: Damping ratio.

    Returns:
        How far the force would bend the tool at rest, m.
    """
    a, b, c, d = oscillator(dt, omega, zeta)
    descent, gain = thrust[PROGRAMMED], 0.0
    for k in range(6):
        target = 0.0
        for j in range(6):
            target += compliance[i, k, j] * force[j]
        yields = 0.0
        for j in range(3):
            yields += compliance[i, k, j] * thrust[UP + j]
        target -= yields * thrust[FORCE]
        if k < 3:
            target += offset[i - 1, k] + share * (offset[i, k] - offset[i - 1, k])
        x, v = displacement[k] - target, rate[k]
        displacement[k], before = target + a * x + b * v, displacement[k]
        rate[k] = c * x + d * v
        if k < 3:
            descent -= thrust[UP + k] * (displacement[k] - before) / dt
            gain += thrust[UP + k] * yields * (1.0 - a) / dt
    if thrust[AMPLITUDE] > 0.0 and gain > 0.0:
        pushed = thrust_of_step(descent, gain, thrust[AMPLITUDE], thrust[EXPONENT])
        for k in range(6):
            yields = 0.0
            for j in range(3):
                yields += compliance[i, k, j] * thrust[UP + j]
            displacement[k] += (1.0 - a) * yields * pushed
            rate[k] -= c * yields * pushed
    return bend_at_rest(compliance, i, force)


@kernel("float64(float64[:, :, ::1], int64, float64[::1])")
def bend_at_rest(compliance: Float, i: int, force: Float) -> float:
    """Return how far a force would bend the tool at rest: the largest component, m."""
    bend = 0.0
    for k in range(3):
        target = 0.0
        for j in range(6):
            target += compliance[i, k, j] * force[j]
        bend = max(bend, abs(target))
    return bend
