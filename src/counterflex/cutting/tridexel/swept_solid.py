"""Kernels: where a line of the lattice runs through the solid that a cutter sweeps, and how far a point is from it.

A cutter is a convex solid of revolution: the disc of radius R - r at height r above the tip, rounded with the corner
radius r, and the cylinder of radius R from there to its top. Moved straight with its axis held still it sweeps a convex
solid, so that a line meets it in one stretch, the union of the stretches in which it meets the sweeps of its parts.

A cylinder: a point ``q + t d - s v`` of line and motion, relative to the start of the motion, lies inside where its
distance from the axis is at most R and its height within bounds. In the plane (t, s) that is an ellipse cut by two
pairs of parallel lines, and the ends of t are at the ellipse's own ends or on those lines: closed forms. A ball: two
spheres and the cylinder between them. The rounded disc of a bull nose has none; there the convex function
``min over s of the distance`` is brought to zero by Newton's method from outside, which approaches from one side only.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.cutting.tridexel.turning_line_kernels import MOTION, turning_stretch

_NOTHING: Final = 1.0e-18
_EMPTY_LOW: Final = 1.0e30
_HALVINGS: Final = 48
_STEPS: Final = 40
_NEAR_M: Final = 1.0e-12
_GOLDEN: Final = 0.5 * (math.sqrt(5.0) - 1.0)

Whole = Any
Real = Any


@kernel()
def _roots(a: Real, b: Real, c: Real) -> tuple[float, float]:
    """Ends of ``a x^2 + 2 b x + c <= 0``, a >= 0; the second below the first where there are none."""
    if a < _NOTHING:
        return (-_EMPTY_LOW, _EMPTY_LOW) if c <= 0.0 else (1.0, -1.0)
    rest = b * b - a * c
    if rest < 0.0:
        return 1.0, -1.0
    root = math.sqrt(rest)
    return (-b - root) / a, (-b + root) / a


@kernel()
def _between(first: Real, last: Real, offset: Real, slope: Real, low: Real, high: Real) -> tuple[float, float]:
    """The part of [first, last] in which ``low <= offset + slope x <= high``."""
    if abs(slope) < _NOTHING:
        return (first, last) if low - 1e-15 <= offset <= high + 1e-15 else (1.0, -1.0)
    one, two = (low - offset) / slope, (high - offset) / slope
    return max(first, min(one, two)), min(last, max(one, two))


@kernel()
def _cylinder(q: Float, along: Whole, motion: Float, radius: Real, low: Real, high: Real) -> tuple[float, float]:
    """Stretch of a line in the sweep of a cylinder about the tool axis, from height low to high above the tip."""
    ux, uy, uz = motion[6], motion[7], motion[8]
    vx, vy, vz = motion[3], motion[4], motion[5]
    alpha = q[0] * ux + q[1] * uy + q[2] * uz
    beta = motion[6 + along]
    gamma = vx * ux + vy * uy + vz * uz
    ax, ay, az = q[0] - alpha * ux, q[1] - alpha * uy, q[2] - alpha * uz
    bx, by, bz = -beta * ux, -beta * uy, -beta * uz
    if along == 0:
        bx += 1.0
    elif along == 1:
        by += 1.0
    else:
        bz += 1.0
    cx, cy, cz = vx - gamma * ux, vy - gamma * uy, vz - gamma * uz
    aa, ab, ac = ax * ax + ay * ay + az * az, ax * bx + ay * by + az * bz, ax * cx + ay * cy + az * cz
    bb, bc, cc = bx * bx + by * by + bz * bz, bx * cx + by * cy + bz * cz, cx * cx + cy * cy + cz * cz
    aa -= radius * radius
    first, last = _EMPTY_LOW, -_EMPTY_LOW
    for end in range(2):  # at the start and at the end of the motion
        s = float(end)
        one, two = _roots(bb, ab - s * bc, aa - 2.0 * s * ac + s * s * cc)
        one, two = _between(one, two, alpha - s * gamma, beta, low, high)
        if one <= two:
            first, last = min(first, one), max(last, two)
    for end in range(2):  # on the lower and on the upper face
        rest = (low if end == 0 else high) - alpha
        if abs(rest) > 1.0e20:
            continue
        if abs(beta) >= abs(gamma) and abs(beta) > _NOTHING:
            t0, m = rest / beta, gamma / beta
            one, two = _roots(
                bb * m * m - 2.0 * bc * m + cc, ab * m - ac + (bb * m - bc) * t0, aa + 2.0 * ab * t0 + bb * t0 * t0
            )
            one, two = max(one, 0.0), min(two, 1.0)
            if one <= two:
                one, two = t0 + m * one, t0 + m * two
                first, last = min(first, one, two), max(last, one, two)
        elif abs(gamma) > _NOTHING:
            s0, m = -rest / gamma, beta / gamma
            one, two = _roots(
                bb - 2.0 * bc * m + cc * m * m, ab - ac * m + (cc * m - bc) * s0, aa - 2.0 * ac * s0 + cc * s0 * s0
            )
            one, two = _between(one, two, s0, m, 0.0, 1.0)
            if one <= two:
                first, last = min(first, one), max(last, two)
    if cc > _NOTHING:  # where the ellipse itself ends
        one, two = _roots(bb - bc * bc / cc, ab - ac * bc / cc, aa - ac * ac / cc)
        if one <= two and abs(one) < 1.0e20:
            for t in (one, two):
                s = (ac + t * bc) / cc
                h = alpha + t * beta - s * gamma
                if 0.0 <= s <= 1.0 and low <= h <= high:
                    first, last = min(first, t), max(last, t)
    return first, last


@kernel()
def _sphere(q: Float, along: Whole, motion: Float, radius: Real) -> tuple[float, float]:
    """Stretch of a line in the sweep of a ball about height r on the tool axis."""
    first, last = _EMPTY_LOW, -_EMPTY_LOW
    x, y, z = q[0] - radius * motion[6], q[1] - radius * motion[7], q[2] - radius * motion[8]
    vx, vy, vz = motion[3], motion[4], motion[5]
    vv = vx * vx + vy * vy + vz * vz
    for end in range(2):
        dx, dy, dz = x - end * vx, y - end * vy, z - end * vz
        b = dx if along == 0 else (dy if along == 1 else dz)
        one, two = _roots(1.0, b, dx * dx + dy * dy + dz * dz - radius * radius)
        if one <= two:
            first, last = min(first, one), max(last, two)
    if vv > _NOTHING:
        v = vx if along == 0 else (vy if along == 1 else vz)
        xv = (x * vx + y * vy + z * vz) / vv
        d = x if along == 0 else (y if along == 1 else z)
        one, two = _roots(1.0 - v * v / vv, d - xv * v, x * x + y * y + z * z - xv * xv * vv - radius * radius)
        if one <= two and abs(one) < 1.0e20:
            for t in (one, two):
                s = xv + t * v / vv
                if 0.0 <= s <= 1.0:
                    first, last = min(first, t), max(last, t)
    return first, last


@kernel()
def _off_disc(x: Real, y: Real, z: Real, motion: Float, inner: Real, corner: Real) -> tuple[float, float, float, float]:
    """Distance of a point (from the tip) to the disc at height r, and the direction away from it."""
    ux, uy, uz = motion[6], motion[7], motion[8]
    h = x * ux + y * uy + z * uz
    rx, ry, rz = x - h * ux, y - h * uy, z - h * uz
    rho = math.sqrt(rx * rx + ry * ry + rz * rz)
    out, up = max(rho - inner, 0.0), h - corner
    size = math.sqrt(out * out + up * up)
    if size < 1.0e-15:
        return 0.0, 0.0, 0.0, 0.0
    o = out / size / rho if out > 0.0 else 0.0
    w = up / size
    return size, o * rx + w * ux, o * ry + w * uy, o * rz + w * uz


@kernel()
def _least_off_disc(q: Float, along: Whole, t: Real, motion: Float, inner: Real, corner: Real) -> tuple[float, float]:
    """Least distance over the motion of the point at t to the disc, and how it changes with t."""
    x, y, z = q[0], q[1], q[2]
    if along == 0:
        x += t
    elif along == 1:
        y += t
    else:
        z += t
    vx, vy, vz = motion[3], motion[4], motion[5]
    low, high = 0.0, 1.0
    for end in range(2):  # is the least at an end?
        s = float(end)
        size, nx, ny, nz = _off_disc(x - s * vx, y - s * vy, z - s * vz, motion, inner, corner)
        rises = -(nx * vx + ny * vy + nz * vz)
        if (end == 0 and rises >= 0.0) or (end == 1 and rises <= 0.0):
            return size, nx if along == 0 else (ny if along == 1 else nz)
    for _ in range(_HALVINGS):
        s = 0.5 * (low + high)
        size, nx, ny, nz = _off_disc(x - s * vx, y - s * vy, z - s * vz, motion, inner, corner)
        if nx * vx + ny * vy + nz * vz < 0.0:
            high = s
        else:
            low = s
    return size, nx if along == 0 else (ny if along == 1 else nz)


@kernel()
def _rounded_disc(
    q: Float, along: Whole, motion: Float, inner: Real, corner: Real, first: Real, last: Real
) -> tuple[float, float]:
    """Stretch of a line in the sweep of the rounded disc, which lies within [first, last]."""
    low, high = first, last
    for _ in range(_STEPS):
        size, slope = _least_off_disc(q, along, low, motion, inner, corner)
        if size - corner <= _NEAR_M:
            break
        if slope >= -1.0e-12:
            return _EMPTY_LOW, -_EMPTY_LOW
        low -= (size - corner) / slope
        if low > last:
            return _EMPTY_LOW, -_EMPTY_LOW
    for _ in range(_STEPS):
        size, slope = _least_off_disc(q, along, high, motion, inner, corner)
        if size - corner <= _NEAR_M or slope <= 1.0e-12:
            break
        high -= (size - corner) / slope
    return low, high


@kernel()
def stretch(q: Float, along: Whole, motion: Float, shape: Float) -> tuple[float, float]:
    """Stretch [t0, t1] of a line that a cutter takes on a straight motion; t1 < t0 where it does not meet it.

    Args:
        q: (3,) m, a point of the line relative to the start of the tool tip.
        along: 0, 1 or 2: the line runs along x, y or z from there.
        motion: (12,) start of the tip (not used), its displacement in m, the unit vector of the tool axis in the middle
            and its turn, see :func:`counterflex.cutting.tridexel.columns.motions_of`; (9,) without a turn.
        shape: (3,) m: radius R, corner radius r, height of the top above the tip.
    """
    if len(motion) == MOTION and (motion[9] != 0.0 or motion[10] != 0.0 or motion[11] != 0.0):
        return turning_stretch(q, along, motion, shape)
    radius, corner, top = shape[0], shape[1], shape[2]
    first, last = _cylinder(q, along, motion, radius, corner, top)
    if corner == 0.0:
        return first, last
    if radius - corner < 1.0e-12:
        one, two = _sphere(q, along, motion, radius)
    else:
        one, two = _cylinder(q, along, motion, radius - corner, 0.0, top)
        first, last = min(first, one), max(last, two)
        one, two = _cylinder(q, along, motion, radius, 0.0, 2.0 * corner)
        if one <= two:
            one, two = _rounded_disc(q, along, motion, radius - corner, corner, one, two)
    return min(first, one), max(last, two)


@kernel()
def depth_at(x: Real, y: Real, z: Real, share: Real, motion: Float, shape: Float) -> float:
    """Signed distance of a point (from the start of the tip) to the cutter at a share of its motion, m: inside < 0."""
    x, y, z = x - share * motion[3], y - share * motion[4], z - share * motion[5]
    s = share - 0.5
    ux, uy, uz = motion[6] + s * motion[9], motion[7] + s * motion[10], motion[8] + s * motion[11]
    per = 1.0 / math.sqrt(ux * ux + uy * uy + uz * uz)
    ux, uy, uz = ux * per, uy * per, uz * per
    inner, corner = shape[0] - shape[1], shape[1]
    h = x * ux + y * uy + z * uz
    rx, ry, rz = x - h * ux, y - h * uy, z - h * uz
    out = math.sqrt(rx * rx + ry * ry + rz * rz) - inner
    down = corner - h
    below = min(max(out, down), 0.0) + math.hypot(max(out, 0.0), max(down, 0.0)) - corner
    return float(max(below, h - shape[2]))


@kernel()
def distance(x: Real, y: Real, z: Real, motion: Float, shape: Float) -> tuple[float, float]:
    """Signed distance of a point (from the start of the tip) to the swept solid, m, and the share of the motion there.

    The distance to the cutter is convex over a motion with a constant axis, and nearly so over one that turns by as
    little as :func:`counterflex.cutting.tridexel.columns.motions_of` lets it: golden section.
    """
    low, high = 0.0, 1.0
    a, b = 1.0 - _GOLDEN, _GOLDEN
    fa, fb = depth_at(x, y, z, a, motion, shape), depth_at(x, y, z, b, motion, shape)
    for _ in range(_HALVINGS):
        if fa <= fb:
            high, b, fb = b, a, fa
            a = high - _GOLDEN * (high - low)
            fa = depth_at(x, y, z, a, motion, shape)
        else:
            low, a, fa = a, b, fb
            b = low + _GOLDEN * (high - low)
            fb = depth_at(x, y, z, b, motion, shape)
    best, at = (fa, a) if fa <= fb else (fb, b)
    for s in (0.0, 1.0):
        f = depth_at(x, y, z, s, motion, shape)
        if f < best:
            best, at = f, s
    return best, at


def tool_shape(radius_m: float, corner_m: float, top_m: float) -> Float:
    """The numbers that :func:`stretch` needs of a cutter, (3,) m."""
    return np.array([radius_m, corner_m, top_m])
