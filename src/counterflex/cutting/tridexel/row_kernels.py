"""Kernels: the ends of sixteen columns of a row in the sweep of a cutter, in loops that run in vectors.

For a flat and a ball mill these are the closed forms of :mod:`pose_kernels`. A torus has none: its ends are found by
Newton's method from outside. The lower end is a convex function of the share of the motion. Its least value is searched
between the two shares at which the column passes the rim of the tool, whatever the length of the motion: Newton's
method on the rate of the lower end, and bisection where a Newton step leaves the bracket.
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
_NEWTON: Final = 6
_NEAR: Final = 4
"""Steps to the point of a column that is nearest to the disc of the corner: the square of the distance has a second
derivative of at most 2, so they converge."""
_SEARCH: Final = 14
"""Shares of a motion at which a bull nose is looked at: two of the bracket, one where the shank touches, then the
search. Of 15 100 random columns (R 2 to 15 mm, r 0.03 to 0.9 R, tilt to 69 deg, motions of 0.1 mm to 1 m) four lie more
than 1 um off the end by 48 halvings, the worst 4.7 um; after 11 shares 14 lie more than 10 um off."""
_HALVED: Final = (3, 8)
"""Steps of the search that halve the bracket, so that it closes where Newton's method creeps."""
LOW: Final = 0
HIGH: Final = 1
_SIGMA: Final = 2
_ONE_END: Final = 3
_TWO_END: Final = 4
_RATE: Final = 5
_FIRST: Final = 6
_LAST: Final = 7
_ENTERS: Final = 8
_LEAVES: Final = 9
_POSED: Final = 10
_BEND: Final = 18
_TOUCHES: Final = 19
_NEAREST: Final = 20
_LOW_FIRST: Final = 21
_LOW_LAST: Final = 22
_RATE_FIRST: Final = 23
_RATE_LAST: Final = 24
ROWS_OF_WORK: Final = 25
"""Rows of the scratch array of sixteen lanes."""


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


@kernel(inline=True)
def _slope(aw: Real, ae: Real, ah: Real, dw: Real, dh: Real, t: Real, m: Sweep) -> Real:
    """Half the rate at which the square of the distance of a line at t from the disc of the corner changes along it."""
    rw, re = aw + t * dw, ae + t * m.d_e
    rho = max(math.sqrt(rw * rw + re * re), _SMALL)
    out, up = max(rho - (m.radius - m.corner), _ZERO), min(ah + t * dh - m.corner, _ZERO)
    return out * (rw * dw + re * m.d_e) / rho + up * dh


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
    """Stretches of sixteen columns in a bull nose at their sigma, and two derivatives of their lower ends by it."""
    # Where a column misses the tool, the rate has the sign that leads to it: that of the velocity along the normal of
    # the tool at the point of the column that is nearest to it.
    w_of, e_of, h_of, sigma_of = line[0], line[1], line[2], work[_SIGMA]
    one, two, rate_of, bend_of = work[_ONE_END], work[_TWO_END], work[_RATE], work[_BEND]
    aw, ae, ah, dw = work[_POSED], work[_POSED + 1], work[_POSED + 2], work[_POSED + 3]
    near = work[_NEAREST]
    dh, vw, vh, turn = work[_POSED + 4], work[_POSED + 5], work[_POSED + 6], work[_POSED + 7]
    de = m.d_e
    for k in range(LANES):
        bw, be, bh, lw, lh, uw, uh, om = posed(w_of[k], e_of[k], h_of[k], sigma_of[k], m)
        aw[k], ae[k], ah[k], dw[k], dh[k], vw[k], vh[k], turn[k] = bw, be, bh, lw, lh, uw, uh, om
        meets, low, high = cylinder(bw, be, lw, de, m.radius)
        low = max(low, -bh / lh)
        high = max(low, high)
        fall, rise = -_slope(bw, be, bh, lw, lh, low, m), _slope(bw, be, bh, lw, lh, high, m)
        near[k] = low + (high - low) * max(fall, _ZERO) / max(max(fall, _ZERO) + max(rise, _ZERO), _SMALL)
        meets = meets & (low < high)
        one[k], two[k] = low if meets else NOWHERE, high if meets else -NOWHERE
    for _ in range(_NEWTON):
        for k in range(LANES):
            low = _nearer(aw[k], ae[k], ah[k], dw[k], dh[k], one[k], _ONE, m)
            one[k] = low if ah[k] + one[k] * dh[k] < m.corner else one[k]
    for _ in range(_NEAR):
        for k in range(LANES):
            near[k] -= _slope(aw[k], ae[k], ah[k], dw[k], dh[k], near[k], m)
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
        sw, sh = vw[k] + turn[k] * h, vh[k] - turn[k] * rw
        falls = min(nw * dw[k] + ne * de + up * dh[k], -_SMALL)
        rate = (nw * sw + ne * m.v_e + up * sh) / falls
        # curvature of the torus along the way of the point of contact: 1/r in its section, and about the axis
        uw, ue, uh = rate * dw[k] - sw, rate * de - m.v_e, rate * dh[k] - sh
        about = (rw * ue - re * uw) / rho
        rounded = (uw * uw + ue * ue + uh * uh - about * about) if (out > _ZERO) & (up < _ZERO) else _ZERO
        bend_of[k] = -(max(rounded, _ZERO) + about * about * out) / falls
        t = near[k]
        rw, re, h = aw[k] + t * dw[k], ae[k] + t * de, ah[k] + t * dh[k]
        rho = max(math.sqrt(rw * rw + re * re), _SMALL)
        out, up = max(rho - inner, _ZERO) / rho, min(h - m.corner, _ZERO)
        comes = out * (rw * (vw[k] + turn[k] * h) + re * m.v_e) + up * (vh[k] - turn[k] * rw)
        lost = -_SMALL if comes > _ZERO else _SMALL
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
def _bracket(m: Sweep, line: Float32, work: Float32) -> None:
    """Shares at which sixteen columns pass the rim of a bull nose: only between them its rounded end meets a column."""
    # Where a column crosses the heights from 0 to r, it moves sideways by at most `r tan(tilt)`, so the rim is that of
    # the tool widened by as much.
    w_of, e_of, h_of, near = line[0], line[1], line[2], line[3]
    enters, leaves, touches = work[_ENTERS], work[_LEAVES], work[_TOUCHES]
    aside = math.sqrt(m.d_w * m.d_w + m.d_e * m.d_e) + abs(m.omega * m.d_h)
    wide = m.radius + m.corner * aside / max(m.d_h, _FLOOR)
    for k in range(LANES):
        aw, ae, ah = w_of[k], e_of[k], h_of[k]
        foot = -ah / m.d_h
        fw, fe = aw + foot * m.d_w, ae + foot * m.d_e
        rises = (m.v_h - m.omega * fw) / m.d_h
        gw, ge = rises * m.d_w - m.v_w, rises * m.d_e - m.v_e
        square = max(gw * gw + ge * ge, _SMALL)
        middle = -(fw * gw + fe * ge) / square
        half = wide / math.sqrt(square)
        enters[k] = min(max(middle - half, -_HALF), _HALF)
        leaves[k] = min(max(middle + half, -_HALF), _HALF)
        sigma, t = on_shank(aw, ae, ah, _ZERO, near[k], _ONE, m)
        sigma, t = on_shank(aw, ae, ah, sigma, t, _ONE, m)
        touches[k] = sigma


@kernel()
def _bull(m: Sweep, begins: bool, line: Float32, work: Float32) -> None:
    """Lower ends of sixteen columns under a bull nose: the least over the motion, by Newton's method in a bracket."""
    first, last, leaves, touches = work[_FIRST], work[_LAST], work[_LEAVES], work[_TOUCHES]
    sigma_of, rate_of, bend_of = work[_SIGMA], work[_RATE], work[_BEND]
    work[LOW, :], work[HIGH, :] = NOWHERE, -NOWHERE
    for k in range(LANES):
        first[k], last[k], sigma_of[k] = -_HALF, _HALF, -_HALF
    if begins:
        _at_bull(m, line, work)
        _take_lower(work)
    for k in range(LANES):
        sigma_of[k] = _HALF
    _at_bull(m, line, work)
    _take_lower(work)
    _bracket(m, line, work)
    sigma_of[:] = work[_ENTERS]
    low_first, low_last, rate_first, rate_last = work[_LOW_FIRST], work[_LOW_LAST], work[_RATE_FIRST], work[_RATE_LAST]
    low_of = work[_ONE_END]
    low_first[:], low_last[:] = NOWHERE, NOWHERE
    for n in range(_SEARCH):
        _at_bull(m, line, work)
        _take_lower(work)
        halved = (n + 1 == _HALVED[0]) | (n + 1 == _HALVED[1])
        for k in range(LANES):
            sigma, rate, bend, low = sigma_of[k], rate_of[k], bend_of[k], low_of[k]
            after = (rate < _ZERO) & (sigma >= first[k])
            before = (rate >= _ZERO) & (sigma <= last[k])
            begin, low_one, rate_one = first[k], low_first[k], rate_first[k]
            end, low_two, rate_two = last[k], low_last[k], rate_last[k]
            begin, low_one, rate_one = sigma if after else begin, low if after else low_one, rate if after else rate_one
            end, low_two, rate_two = sigma if before else end, low if before else low_two, rate if before else rate_two
            first[k], low_first[k], rate_first[k] = begin, low_one, rate_one
            last[k], low_last[k], rate_last[k] = end, low_two, rate_two
            newton = sigma - rate / max(bend, _SMALL)
            smooth = (newton > begin) & (newton < end) & (bend > _ZERO)
            known = (low_one < NOWHERE) & (low_two < NOWHERE)
            meet = (low_two - low_one + rate_one * begin - rate_two * end) / min(rate_one - rate_two, -_SMALL)
            meet = meet if known & (meet > begin) & (meet < end) else _HALF * (begin + end)
            step = newton if smooth else meet
            sigma_of[k] = _HALF * (begin + end) if halved else step
        if n == 0:
            for k in range(LANES):
                inside = (leaves[k] > first[k]) & (leaves[k] < last[k])
                sigma_of[k] = leaves[k] if inside else _HALF * (first[k] + last[k])
        if n == 1:
            sigma_of[:] = touches


@kernel()
def lowest_ends(m: Sweep, begins: bool, line: Float32, work: Float32) -> None:
    """Least lower ends of sixteen columns in a sweep, and the upper ends of the poses that they belong to.

    Args:
        begins: Look at the pose in which the motion begins, too; the motion before it has taken that out otherwise.
        line: (4, 16) w, e, h of a point of each column, and near which t it is met.
        work: (25, 16); rows :data:`LOW` and :data:`HIGH` receive the ends, t.
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
