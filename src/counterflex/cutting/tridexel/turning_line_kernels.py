"""Kernels: where a line runs through what a cutter sweeps whose axis turns as it goes.

The stretch of a line in the cutter at one moment has a closed form, but for a torus. What the motion takes of the line
is the union of these stretches, and ends at an end of the motion or where the shank or the ball touches the line, where
the line crosses the rim of a face, or where a face turns from going down to going up. The share of the motion is found
by a few rounds of the closed form with the velocity of the last (:mod:`pose_kernels`); then the stretch of that very
moment is taken. So what is off is of second order, and never beyond what the tool sweeps. On a torus, and where a line
runs nearly in a face, the share is searched for.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.cutting.tridexel.pose_kernels import Sweep, on_ball, on_shank, posed
from counterflex.cutting.tridexel.sweep_bounds_kernels import FRAME, OMEGA, SPEED, frame_of

MOTION: Final = 12
"""Numbers of a motion: start of the tip, displacement, axis from the tip to the spindle in its middle, and its turn."""
_NOTHING: Final = 1.0e-18
_EMPTY_LOW: Final = 1.0e30
_STEPS: Final = 40
_NEAR_M: Final = 1.0e-12
_ROUNDS: Final = 5
"""Times that the share of a turning motion is set right."""
_SEARCH: Final = 40
_NEARLY: Final = 0.2
"""Sine of the angle between a line and a face below which the share at which it crosses the rim is searched for."""
_GOLDEN: Final = 0.5 * (math.sqrt(5.0) - 1.0)

Whole = Any
Real = Any


@kernel()
def between(first: Real, last: Real, offset: Real, slope: Real, low: Real, high: Real) -> tuple[Real, Real]:
    """The part of [first, last] in which ``low <= offset + slope x <= high``."""
    if abs(slope) < _NOTHING:
        return (first, last) if low - 1e-15 <= offset <= high + 1e-15 else (1.0, -1.0)
    one, two = (low - offset) / slope, (high - offset) / slope
    return max(first, min(one, two)), min(last, max(one, two))


@kernel()
def _in_tool(aw: Real, ae: Real, ah: Real, dw: Real, de: Real, dh: Real, shape: Float) -> tuple[Real, Real]:
    """Stretch of a line in the cutter at rest, in its own frame."""
    radius, corner, top = shape[0], shape[1], shape[2]
    alpha, cross = dw * dw + de * de, aw * de - ae * dw
    first, last = -_EMPTY_LOW, _EMPTY_LOW
    if alpha < _NOTHING:
        if aw * aw + ae * ae > radius * radius:
            return _EMPTY_LOW, -_EMPTY_LOW
    else:
        rest = alpha * radius * radius - cross * cross
        if rest < 0.0:
            return _EMPTY_LOW, -_EMPTY_LOW
        middle, half = -(aw * dw + ae * de) / alpha, math.sqrt(rest) / alpha
        first, last = middle - half, middle + half
    first, last = between(first, last, ah, dh, 0.0, top)
    if first > last:
        return _EMPTY_LOW, -_EMPTY_LOW
    if corner == 0.0:
        return first, last
    for end in range(2):  # from outside to the rounding, by Newton's method
        t, way = (first, 1.0) if end == 0 else (last, -1.0)
        if ah + t * dh >= corner:
            continue
        for _ in range(_STEPS):
            rw, re, up = aw + t * dw, ae + t * de, min(ah + t * dh - corner, 0.0)
            rho = math.sqrt(rw * rw + re * re)
            out = max(rho - radius + corner, 0.0)
            size = math.sqrt(out * out + up * up)
            if size - corner <= _NEAR_M:
                break
            falls = -way * ((out * (rw * dw + re * de) / rho if out > 0.0 else 0.0) + up * dh) / size
            if falls <= 1.0e-12:
                return _EMPTY_LOW, -_EMPTY_LOW
            t += way * (size - corner) / falls
        if end == 0:
            first = t
        else:
            last = t
        if first > last:
            return _EMPTY_LOW, -_EMPTY_LOW
    return first, last


@kernel()
def _at(aw: Real, ae: Real, ah: Real, sigma: Real, m: Sweep, shape: Float) -> tuple[Real, Real]:
    """Stretch of a line in the cutter at a share of its motion from the middle."""
    bw, be, bh, dw, dh, _, _, _ = posed(aw, ae, ah, sigma, m)
    return _in_tool(bw, be, bh, dw, m.d_e, dh, shape)


@kernel()
def _on_face(aw: Real, ae: Real, ah: Real, sigma: Real, height: Real, radius: Real, way: Real, m: Sweep) -> Real:
    """Share at which a line crosses the rim of a face at a height on the cutter, near sigma; way: which of two."""
    bw, be, bh, dw, dh, vw, vh, turn = posed(aw, ae, ah, sigma, m)
    if abs(dh) < 1.0e-9:  # the line runs in the face: the moment at which the face passes it
        goes = vh - turn * bw
        return sigma + (bh - height) / goes if abs(goes) > 1.0e-12 else sigma
    t = (height - bh) / dh
    rw, re = bw + t * dw, be + t * m.d_e
    rises = (vh - turn * rw) / dh
    gw, ge = rises * dw - vw - turn * height, rises * m.d_e - m.v_e
    a, b = gw * gw + ge * ge, rw * gw + re * ge
    if a < _NOTHING:
        return sigma
    root = math.sqrt(max(b * b - a * (rw * rw + re * re - radius * radius), 0.0))
    return sigma + (-b + way * root) / a


@kernel()
def turning_stretch(q: Float, along: Whole, motion: Float, shape: Float) -> tuple[Real, Real]:
    """:func:`stretch` with an axis that turns: the pose that touches the line, found by iteration, decides."""
    frame = np.empty(FRAME)
    frame_of(motion, frame)
    x, y, z = q[0] - 0.5 * motion[3], q[1] - 0.5 * motion[4], q[2] - 0.5 * motion[5]
    aw = frame[0] * x + frame[1] * y + frame[2] * z
    ae = frame[3] * x + frame[4] * y + frame[5] * z
    ah = frame[6] * x + frame[7] * y + frame[8] * z
    radius, corner, top = shape[0], shape[1], shape[2]
    m = Sweep(
        frame[SPEED], frame[SPEED + 1], frame[SPEED + 2], frame[OMEGA],
        frame[along], frame[3 + along], frame[6 + along], radius, corner,
    )  # fmt: skip
    first, last = _EMPTY_LOW, -_EMPTY_LOW
    best_first, best_last = 0.0, 0.0
    near = -(aw * m.d_w + ae * m.d_e) / max(m.d_w * m.d_w + m.d_e * m.d_e, 1.0e-6)
    for k in range(10):
        sigma = 0.5 if k == 1 else -0.5
        way = 1.0 if k % 2 == 0 else -1.0
        if k in (2, 3):
            sigma, t = 0.0, near
            for _ in range(_ROUNDS):
                sigma, t = on_shank(aw, ae, ah, sigma, t, way, m)
        elif k in (4, 5):
            sigma = 0.0
            for _ in range(_ROUNDS):
                if corner == radius:
                    sigma = on_ball(aw, ae, ah, sigma, way, m)
                else:
                    sigma = _on_face(aw, ae, ah, min(max(sigma, -0.5), 0.5), 0.0, radius - corner, way, m)
        elif k in (6, 7):
            sigma = 0.0
            for _ in range(_ROUNDS):
                sigma = _on_face(aw, ae, ah, min(max(sigma, -0.5), 0.5), top, radius, way, m)
        elif k > 7:  # where a face turns from going down to going up
            high = 0.0 if k == 8 else top
            rates = np.empty(2)
            for end in range(2):
                bw, _, bh, dw, dh, _, vh, turn = posed(aw, ae, ah, end - 0.5, m)
                rates[end] = vh - turn * (bw + ((high - bh) / dh if abs(dh) > 1.0e-9 else 0.0) * dw)
            sigma = -0.5 - rates[0] / (rates[1] - rates[0]) if rates[1] != rates[0] else 0.0
        sigma = min(max(sigma, -0.5), 0.5)
        one, two = _at(aw, ae, ah, sigma, m, shape)
        if one < first:
            first, best_first = one, sigma
        if two > last:
            last, best_last = two, sigma
    if first > last:
        return first, last
    for side in range(2):
        begin, t = (best_first, first) if side == 0 else (best_last, last)
        _, _, bh, _, dh, _, _, _ = posed(aw, ae, ah, begin, m)
        h, rim = bh + t * dh, 4.0 * m.omega * radius
        torus = 0.0 < corner < radius and h < corner + rim
        nearly = abs(dh) < _NEARLY and (h < rim or h > top - rim)
        if not (torus or nearly):  # no closed form, or a line nearly in a face: narrow the share down
            continue
        a, b = max(-0.5, begin - 0.5), min(0.5, begin + 0.5)
        c, d = b - _GOLDEN * (b - a), a + _GOLDEN * (b - a)
        ends = _at(aw, ae, ah, c, m, shape)
        fc = ends[0] if side == 0 else -ends[1]
        ends = _at(aw, ae, ah, d, m, shape)
        fd = ends[0] if side == 0 else -ends[1]
        for _ in range(_SEARCH):
            toward = fc < fd or (fc == fd and abs(c - begin) < abs(d - begin))
            if toward:
                b, d, fd = d, c, fc
                c = b - _GOLDEN * (b - a)
                ends = _at(aw, ae, ah, c, m, shape)
                fc = ends[0] if side == 0 else -ends[1]
            else:
                a, c, fc = c, d, fd
                d = a + _GOLDEN * (b - a)
                ends = _at(aw, ae, ah, d, m, shape)
                fd = ends[0] if side == 0 else -ends[1]
        if side == 0:
            first = min(first, fc, fd)
        else:
            last = max(last, -min(fc, fd))
    return first, last
