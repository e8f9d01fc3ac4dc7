"""Kernels: the ends of sixteen columns of a row in the sweep of a cutter, in loops that run in vectors.

For a flat and a ball mill these are the closed forms of :mod:`pose_kernels`. A torus has none: its ends are found by
Newton's method from outside, and the share of the motion by false position on the rate of the lower end.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from counterflex.core.arrays import Float32
from counterflex.core.jit import kernel
from counterflex.cutting.envelope_kernels import LANES, Real
from counterflex.cutting.tridexel.pose_kernels import (
    NOWHERE,
    Sweep,
    at_ball,
    at_flat,
    cylinder,
    on_ball,
    on_rim,
    on_shank,
    posed,
    turn_of_face,
)

_ZERO = np.float32(0.0)
_HALF = np.float32(0.5)
_ONE = np.float32(1.0)
_SMALL = np.float32(1.0e-20)
_FLOOR = np.float32(1.0e-6)
_NEWTON: Final = 5
_FALSE: Final = 10
LOW: Final = 0
HIGH: Final = 1
_SIGMA: Final = 2
_ONE_END: Final = 3
_TWO_END: Final = 4
_RATE: Final = 5
_FIRST: Final = 6
_LAST: Final = 7
_LEFT: Final = 8
_RIGHT: Final = 9
_POSED: Final = 10
ROWS_OF_WORK: Final = 18
"""Rows of the scratch array of sixteen lanes."""
_LEAST = np.float32(0.05)
"""Share of the bracket that a step of false position leaves at either end."""


@kernel(inline=True)
def _nearer(aw: Real, ae: Real, ah: Real, dw: Real, dh: Real, t: Real, way: Real, m: Sweep) -> Real:
    """A step of Newton's method from outside at t to the end of a line in a rounded disc; way 1 is up."""
    rw, re = aw + t * dw, ae + t * m.d_e
    rho = math.sqrt(rw * rw + re * re)
    out = max(rho - (m.radius - m.corner), _ZERO)
    up = min(ah + t * dh - m.corner, _ZERO)
    size = math.sqrt(out * out + up * up)
    falls = -way * (out * (rw * dw + re * m.d_e) / max(rho, _SMALL) + up * dh) / max(size, _SMALL)
    return t + way * max(size - m.corner, _ZERO) / max(falls, _FLOOR)


@kernel()
def _flat(m: Sweep, begins: bool, line: Float32, work: Float32) -> None:
    """Lower ends of sixteen columns under a flat mill, in loops that run in vectors."""
    w_of, e_of, h_of, near = line[0], line[1], line[2], line[3]
    low, high = work[LOW], work[HIGH]
    start = -_HALF if begins else _HALF
    for k in range(LANES):
        aw, ae, ah = w_of[k], e_of[k], h_of[k]
        least, most = at_flat(aw, ae, ah, start, m)
        one, two = at_flat(aw, ae, ah, _HALF, m)
        most = two if one < least else most
        least = min(one, least)
        sigma, t = on_shank(aw, ae, ah, _ZERO, near[k], _ONE, m)
        sigma, t = on_shank(aw, ae, ah, sigma, t, _ONE, m)
        one, two = at_flat(aw, ae, ah, sigma, m)
        high[k] = two if one < least else most
        low[k] = min(one, least)
    for k in range(LANES):
        aw, ae, ah = w_of[k], e_of[k], h_of[k]
        least, most = low[k], high[k]
        sigma = on_rim(aw, ae, ah, _ZERO, _ONE, m)
        sigma = on_rim(aw, ae, ah, sigma, _ONE, m)
        one, two = at_flat(aw, ae, ah, sigma, m)
        most = two if one < least else most
        least = min(one, least)
        sigma = on_rim(aw, ae, ah, _ZERO, -_ONE, m)
        sigma = on_rim(aw, ae, ah, sigma, -_ONE, m)
        one, two = at_flat(aw, ae, ah, sigma, m)
        high[k] = two if one < least else most
        low[k] = min(one, least)
    if m.omega == _ZERO:
        return
    for k in range(LANES):
        aw, ae, ah = w_of[k], e_of[k], h_of[k]
        one, two = at_flat(aw, ae, ah, turn_of_face(aw, ae, ah, m), m)
        most = two if one < low[k] else high[k]
        low[k] = min(one, low[k])
        high[k] = most


@kernel()
def _ball(m: Sweep, begins: bool, line: Float32, work: Float32) -> None:
    """Lower ends of sixteen columns under a ball mill; see :func:`_flat`."""
    w_of, e_of, h_of, near = line[0], line[1], line[2], line[3]
    low, high = work[LOW], work[HIGH]
    start = -_HALF if begins else _HALF
    for k in range(LANES):
        aw, ae, ah = w_of[k], e_of[k], h_of[k]
        least, most = at_ball(aw, ae, ah, start, m)
        one, two = at_ball(aw, ae, ah, _HALF, m)
        most = two if one < least else most
        least = min(one, least)
        sigma, t = on_shank(aw, ae, ah, _ZERO, near[k], _ONE, m)
        sigma, t = on_shank(aw, ae, ah, sigma, t, _ONE, m)
        one, two = at_ball(aw, ae, ah, sigma, m)
        most = two if one < least else most
        least = min(one, least)
        sigma = on_ball(aw, ae, ah, _ZERO, _ONE, m)
        sigma = on_ball(aw, ae, ah, sigma, _ONE, m)
        one, two = at_ball(aw, ae, ah, sigma, m)
        high[k] = two if one < least else most
        low[k] = min(one, least)


@kernel()
def _at_bull(m: Sweep, line: Float32, work: Float32) -> None:
    """Stretches of sixteen columns in a bull nose at their sigma, and the rate of the lower ends with it.

    Where a column misses the tool, the rate has the sign that leads to it.
    """
    w_of, e_of, h_of, sigma_of = line[0], line[1], line[2], work[_SIGMA]
    one, two, rate_of = work[_ONE_END], work[_TWO_END], work[_RATE]
    aw, ae, ah, dw = work[_POSED], work[_POSED + 1], work[_POSED + 2], work[_POSED + 3]
    dh, vw, vh, turn = work[_POSED + 4], work[_POSED + 5], work[_POSED + 6], work[_POSED + 7]
    de = m.d_e
    for k in range(LANES):
        bw, be, bh, lw, lh, uw, uh, om = posed(w_of[k], e_of[k], h_of[k], sigma_of[k], m)
        aw[k], ae[k], ah[k], dw[k], dh[k], vw[k], vh[k], turn[k] = bw, be, bh, lw, lh, uw, uh, om
        meets, low, high = cylinder(bw, be, lw, de, m.radius)
        low = max(low, -bh / lh)
        one[k], two[k] = low if meets else NOWHERE, high if meets else -NOWHERE
    for _ in range(_NEWTON):
        for k in range(LANES):
            low = _nearer(aw[k], ae[k], ah[k], dw[k], dh[k], one[k], _ONE, m)
            one[k] = low if ah[k] + one[k] * dh[k] < m.corner else one[k]
    for _ in range(_NEWTON):
        for k in range(LANES):
            high = _nearer(aw[k], ae[k], ah[k], dw[k], dh[k], two[k], -_ONE, m)
            two[k] = high if (ah[k] + two[k] * dh[k] < m.corner) & (one[k] < two[k]) else two[k]
    inner = m.radius - m.corner
    for k in range(LANES):
        low, high = one[k], two[k]
        rw, re, h = aw[k] + low * dw[k], ae[k] + low * de, ah[k] + low * dh[k]
        rho = max(math.sqrt(rw * rw + re * re), _SMALL)
        out, up = max(rho - inner, _ZERO) / rho, min(h - m.corner, _ZERO)
        nw, ne = out * rw, out * re
        speed = nw * (vw[k] + turn[k] * h) + ne * m.v_e + up * (vh[k] - turn[k] * rw)
        rate = speed / min(nw * dw[k] + ne * de + up * dh[k], -_SMALL)
        foot = -ah[k] / dh[k]
        ahead = (aw[k] + foot * dw[k]) * vw[k] + (ae[k] + foot * de) * m.v_e
        lost = -_SMALL if ahead > _ZERO else _SMALL
        meets = low <= high
        rate_of[k] = rate if meets else lost
        one[k], two[k] = low if meets else NOWHERE, high if meets else -NOWHERE


@kernel()
def _take_lower(work: Float32) -> None:
    """Take the stretches at sigma where they end lower."""
    one, two, low, high = work[_ONE_END], work[_TWO_END], work[LOW], work[HIGH]
    for k in range(LANES):
        lower = one[k] < low[k]
        most = two[k] if lower else high[k]
        low[k], high[k] = min(one[k], low[k]), most


@kernel()
def _bull(m: Sweep, begins: bool, line: Float32, work: Float32) -> None:
    """Lower ends of sixteen columns under a bull nose: false position on the rate of the lower end."""
    w_of, e_of, h_of, near = line[0], line[1], line[2], line[3]
    first, last, left, right = work[_FIRST], work[_LAST], work[_LEFT], work[_RIGHT]
    sigma_of, rate_of = work[_SIGMA], work[_RATE]
    work[LOW, :], work[HIGH, :] = NOWHERE, -NOWHERE
    for k in range(LANES):
        first[k], last[k], sigma_of[k] = -_HALF, _HALF, -_HALF
    _at_bull(m, line, work)
    if begins:
        _take_lower(work)
    for k in range(LANES):
        left[k], sigma_of[k] = rate_of[k], _HALF
    _at_bull(m, line, work)
    _take_lower(work)
    for k in range(LANES):
        right[k] = rate_of[k]
        sigma, t = on_shank(w_of[k], e_of[k], h_of[k], _ZERO, near[k], _ONE, m)
        sigma, t = on_shank(w_of[k], e_of[k], h_of[k], sigma, t, _ONE, m)
        sigma_of[k] = sigma
    for n in range(_FALSE):
        bisect = n % 2 == 0
        _at_bull(m, line, work)
        _take_lower(work)
        for k in range(LANES):
            falls = rate_of[k] < _ZERO
            begin, end = sigma_of[k] if falls else first[k], last[k] if falls else sigma_of[k]
            one, two = rate_of[k] if falls else left[k], right[k] if falls else rate_of[k]
            share = min(max(one / min(one - two, -_SMALL), _LEAST), _ONE - _LEAST)
            share = _HALF if bisect else share
            first[k], last[k], left[k], right[k] = begin, end, one, two
            sigma_of[k] = begin + share * (end - begin)


@kernel()
def lowest_ends(m: Sweep, begins: bool, line: Float32, work: Float32) -> None:
    """Least lower ends of sixteen columns in a sweep, and the upper ends of the poses that they belong to.

    Args:
        m: The sweep.
        begins: Look at the pose in which the motion begins, too; the motion before it has taken that out otherwise.
        line: (4, 16) w, e, h of a point of each column, and near which t it is met.
        work: (18, 16); rows :data:`LOW` and :data:`HIGH` receive the ends, t.
    """
    if m.corner == _ZERO:
        _flat(m, begins, line, work)
    elif m.corner == m.radius:
        _ball(m, begins, line, work)
    else:
        _bull(m, begins, line, work)


@kernel()
def highest_ends(m: Sweep, line: Float32, work: Float32) -> None:
    """Raise the upper ends of sixteen columns that :func:`lowest_ends` left to the greatest in the sweep."""
    w_of, e_of, h_of, near, high = line[0], line[1], line[2], line[3], work[HIGH]
    if m.corner > _ZERO:
        for k in range(LANES):
            aw, ae, ah = w_of[k], e_of[k], h_of[k]
            sigma, t = on_shank(aw, ae, ah, _ZERO, near[k], -_ONE, m)
            sigma, t = on_shank(aw, ae, ah, sigma, t, -_ONE, m)
            _, two = at_ball(aw, ae, ah, sigma, m)
            most = max(high[k], two)
            sigma = on_ball(aw, ae, ah, _ZERO, -_ONE, m)
            _, two = at_ball(aw, ae, ah, sigma, m)
            most = max(most, two)
            _, two = at_ball(aw, ae, ah, -_HALF, m)
            most = max(most, two)
            _, two = at_ball(aw, ae, ah, _HALF, m)
            high[k] = max(most, two)
        return
    for k in range(LANES):
        aw, ae, ah = w_of[k], e_of[k], h_of[k]
        sigma, t = on_shank(aw, ae, ah, _ZERO, near[k], -_ONE, m)
        sigma, t = on_shank(aw, ae, ah, sigma, t, -_ONE, m)
        _, two = at_flat(aw, ae, ah, sigma, m)
        most = max(high[k], two)
        sigma = on_rim(aw, ae, ah, _ZERO, -_ONE, m)
        sigma = on_rim(aw, ae, ah, sigma, -_ONE, m)
        _, two = at_flat(aw, ae, ah, sigma, m)
        most = max(most, two)
        sigma = on_rim(aw, ae, ah, _ZERO, _ONE, m)
        sigma = on_rim(aw, ae, ah, sigma, _ONE, m)
        _, two = at_flat(aw, ae, ah, sigma, m)
        most = max(most, two)
        _, two = at_flat(aw, ae, ah, -_HALF, m)
        most = max(most, two)
        _, two = at_flat(aw, ae, ah, _HALF, m)
        high[k] = max(most, two)
