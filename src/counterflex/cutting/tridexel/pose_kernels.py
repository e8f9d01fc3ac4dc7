"""Kernels: one column against a cutter that moves straight while its axis turns.

Everything is in the frame of the tool in the middle of its motion: w the way the axis turns, e across it, h along the
axis, origin at the tip. At the share sigma of the motion, -1/2 to 1/2, the tip is at ``sigma v`` and the axis has
turned from h towards w by ``atan(sigma omega)``. In the tool's own frame at sigma a column is a line ``a + t d``, and
the stretch of it that lies in the tool has a closed form. What a motion takes is the union of these stretches, from
the least of their lower ends to the greatest of their upper ends. Those are at an end of the motion or where

* the line touches the shank, the plane of the line and the velocity there being tangent to it,
* it touches the ball, likewise,
* it crosses the rim of the end face.

With a constant axis each is a closed form in sigma; a turning axis takes the velocity of the point of contact and does
it twice. The stretch is then evaluated at that sigma itself, exactly: a pose that was nearly the right one costs second
order only, and never takes what no pose takes. A torus has no closed form: its ends are found by Newton's method from
outside, and the sigma by false position on the sign of the normal velocity.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from counterflex.core.jit import kernel

Real: TypeAlias = Any
"""float32 in rows; float64 where one line is looked at."""

_ZERO = np.float32(0.0)
_HALF = np.float32(0.5)
_ONE = np.float32(1.0)
_SMALL = np.float32(1.0e-20)
_PARALLEL = np.float32(1.0e-11)
"""Squared sine of the tilt up to which a column runs along the axis: less than 0.2 um off in 50 mm."""
_ENDLESS = np.float32(10.0)
_GRAZED = np.float32(1.0e-6)
"""Stretch of less than nothing that still counts as one, m: what 32 bits leave open."""
NOWHERE = np.float32(1.0e6)
"""Lower end of a column that the sweep misses; its upper end is the negative."""


class Sweep(NamedTuple):
    """A motion in the tool's frame of its middle: displacement, turn, direction of the columns; radius and corner."""

    v_w: Real
    v_e: Real
    v_h: Real
    omega: Real
    d_w: Real
    d_e: Real
    d_h: Real
    radius: Real
    corner: Real


@kernel(inline=True)
def posed(aw: Real, ae: Real, ah: Real, sigma: Real, m: Sweep) -> tuple[Real, Real, Real, Real, Real, Real, Real, Real]:
    """Line in the tool's frame at sigma: point (w, e, h), direction (w, h), velocity of the tip (w, h), cos^2."""
    k = sigma * m.omega
    square = _ONE / (_ONE + k * k)
    n = math.sqrt(square)
    bw, bh = aw - sigma * m.v_w, ah - sigma * m.v_h
    return (
        (bw - k * bh) * n,
        ae - sigma * m.v_e,
        (bh + k * bw) * n,
        (m.d_w - k * m.d_h) * n,
        (m.d_h + k * m.d_w) * n,
        (m.v_w - k * m.v_h) * n,
        (m.v_h + k * m.v_w) * n,
        square * m.omega,
    )


@kernel(inline=True)
def cylinder(aw: Real, ae: Real, dw: Real, de: Real, radius: Real) -> tuple[bool, Real, Real]:
    """Return whether a line meets the endless cylinder, and between which t."""
    alpha = dw * dw + de * de
    cross = aw * de - ae * dw
    rest = alpha * radius * radius - cross * cross
    root = math.sqrt(max(rest, _ZERO))
    per = _ONE / max(alpha, _PARALLEL)
    middle = -(aw * dw + ae * de) * per
    tilted = alpha > _PARALLEL
    within = aw * aw + ae * ae <= radius * radius
    half = root * per if tilted else _ENDLESS
    middle = middle if tilted else _ZERO
    return ((rest >= _ZERO) & tilted) | (within & (alpha <= _PARALLEL)), middle - half, middle + half


@kernel(inline=True)
def at_flat(aw: Real, ae: Real, ah: Real, sigma: Real, m: Sweep) -> tuple[Real, Real]:
    """Stretch of a line in a flat mill at sigma."""
    aw, ae, ah, dw, dh, _, _, _ = posed(aw, ae, ah, sigma, m)
    meets, low, high = cylinder(aw, ae, dw, m.d_e, m.radius)
    low = max(low, -ah / dh)
    meets = meets & (low <= high + _GRAZED)  # where it leaves at the rim, the stretch ends in nothing
    high = max(low, high)
    return (low if meets else NOWHERE), (high if meets else -NOWHERE)


@kernel(inline=True)
def at_ball(aw: Real, ae: Real, ah: Real, sigma: Real, m: Sweep) -> tuple[Real, Real]:
    """Stretch of a line in a ball mill at sigma."""
    aw, ae, ah, dw, dh, _, _, _ = posed(aw, ae, ah, sigma, m)
    de, radius = m.d_e, m.radius
    meets, low, high = cylinder(aw, ae, dw, de, radius)
    up = ah - radius
    b = aw * dw + ae * de + up * dh
    rest = radius * radius - (aw * aw + ae * ae + up * up) + b * b
    root = math.sqrt(max(rest, _ZERO))
    by_shank = meets & (ah + low * dh >= radius)
    off_shank = meets & (ah + high * dh >= radius)
    meets = by_shank | (rest >= _ZERO)
    ball_low, ball_high = -b - root, root - b
    low = low if by_shank else ball_low
    high = high if off_shank else ball_high
    return (low if meets else NOWHERE), (high if meets else -NOWHERE)


@kernel(inline=True)
def _clamped(sigma: Real) -> Real:
    return min(max(sigma, -_HALF), _HALF)


@kernel(inline=True)
def on_shank(aw: Real, ae: Real, ah: Real, sigma: Real, t: Real, way: Real, m: Sweep) -> tuple[Real, Real]:
    """Share at which the sweep of the shank touches a line, and t there; from near sigma and t, way 1 is the lower."""
    aw, ae, ah, dw, dh, vw, _, turn = posed(aw, ae, ah, sigma, m)
    de = m.d_e
    fw, fe = vw + turn * (ah + t * dh), m.v_e
    square = max(fw * fw + fe * fe, _SMALL)
    size = math.sqrt(square)
    across = ae * fw - aw * fe
    rate = de * fw - dw * fe
    rate = rate if abs(rate) > _SMALL else _SMALL
    t = -across / rate - way * m.radius * size / abs(rate)
    return _clamped(sigma + ((aw + t * dw) * fw + (ae + t * de) * fe) / square), t


@kernel(inline=True)
def on_ball(aw: Real, ae: Real, ah: Real, sigma: Real, way: Real, m: Sweep) -> Real:
    """Share at which the sweep of the ball touches a line, near sigma."""
    aw, ae, ah, dw, dh, vw, vh, turn = posed(aw, ae, ah, sigma, m)
    de, ve, radius = m.d_e, m.v_e, m.radius
    vw, up = vw + turn * radius, ah - radius
    square = max(vw * vw + ve * ve + vh * vh, _SMALL)
    pv, dv = (aw * vw + ae * ve + up * vh) / square, (dw * vw + de * ve + dh * vh) / square
    pw, pe, ph = aw - pv * vw, ae - pv * ve, up - pv * vh
    lw, le, lh = dw - dv * vw, de - dv * ve, dh - dv * vh
    a, b = lw * lw + le * le + lh * lh, pw * lw + pe * le + ph * lh
    c = pw * pw + pe * pe + ph * ph - radius * radius
    t = (-b - way * math.sqrt(max(b * b - a * c, _ZERO))) / max(a, _SMALL)
    return _clamped(sigma + pv + t * dv)


@kernel(inline=True)
def on_rim(aw: Real, ae: Real, ah: Real, sigma: Real, way: Real, m: Sweep) -> Real:
    """Share at which a line crosses the rim of the end face, near sigma; way 1 is the later of two, -1 the earlier."""
    aw, ae, ah, dw, dh, vw, vh, turn = posed(aw, ae, ah, sigma, m)
    t = -ah / dh
    rw, re = aw + t * dw, ae + t * m.d_e
    rises = (vh - turn * rw) / dh
    gw, ge = rises * dw - vw, rises * m.d_e - m.v_e
    a, b = max(gw * gw + ge * ge, _SMALL), rw * gw + re * ge
    c = rw * rw + re * re - m.radius * m.radius
    root = math.sqrt(max(b * b - a * c, _ZERO))
    return _clamped(sigma + (way * root - b) / a)


@kernel(inline=True)
def rate_on_face(aw: Real, ae: Real, ah: Real, sigma: Real, m: Sweep) -> Real:
    """Speed along the axis at which the end face comes up where a line meets it."""
    aw, _, ah, dw, dh, _, vh, turn = posed(aw, ae, ah, sigma, m)
    return vh - turn * (aw - ah / dh * dw)


@kernel(inline=True)
def turn_of_face(aw: Real, ae: Real, ah: Real, m: Sweep) -> Real:
    """Share at which the end face turns from going down to going up where a line meets it."""
    one, two = rate_on_face(aw, ae, ah, -_HALF, m), rate_on_face(aw, ae, ah, _HALF, m)
    change = two - one
    change = change if abs(change) > _SMALL else _SMALL
    return _clamped(-_HALF - one / change)
