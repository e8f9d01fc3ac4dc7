"""Kernels: where a line runs through what a cutter sweeps whose axis turns as it goes.

``f(t, sigma)`` is the signed distance of the point t of the line to the cutter at a share sigma of its motion, and
``F(t)`` its least over the motion. The line is in the sweep where F is below zero. Without a turn F is convex, since
the cutter is, so that Newton's method approaches an end from outside and from one side only; the share of the least is
found by halving on the sign of the derivative. This needs no case for rims, faces and shank, and holds where a line
runs in a face or nearly so: there the stretch at one moment jumps from nothing to a whole chord, but not the distance.

A turn leaves F convex but for ``(reach + R) theta^2 / 8``, see :func:`counterflex.cutting.tridexel.columns.motions_of`.
The exception is a line to which the end face is parallel at some moment of the motion: a face that turns about a
diameter cuts twice, on either side of it. Such lines are gone along in pieces.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.cutting.tridexel.pose_kernels import Sweep, posed
from counterflex.cutting.tridexel.sweep_bounds_kernels import FRAME, OMEGA, SPEED, frame_of

MOTION: Final = 12
"""Numbers of a motion: start of the tip, displacement, axis from the tip to the spindle in its middle, and its turn."""
MISSED: Final = 1.0e30
"""Where the sweep begins on a line that it misses."""
_HALVINGS: Final = 34
_STEPS: Final = 40
_PIECES: Final = 8
_NEAR_M: Final = 1.0e-12
_LEVEL: Final = 1.0e-12
_NOTHING: Final = 1.0e-15

Whole = Any
Real = Any


@kernel()
def _offset(point: Float, t: Real, sigma: Real, m: Sweep, top: Real) -> tuple[Real, Real, Real]:
    """Signed distance of the point at t of a line to the cutter at sigma, and how it changes with t and with sigma."""
    bw, be, bh, dw, dh, vw, vh, turn = posed(point[0], point[1], point[2], sigma, m)
    w, e, h = bw + t * dw, be + t * m.d_e, bh + t * dh
    rho = math.sqrt(w * w + e * e)
    out, down = rho - (m.radius - m.corner), m.corner - h
    radial, axial = max(out, 0.0), max(down, 0.0)
    size = math.sqrt(radial * radial + axial * axial)
    off = size + min(max(out, down), 0.0) - m.corner
    if h - top >= off:
        return h - top, dh, turn * w - vh
    if size > _NOTHING:
        radial, axial = radial / size, axial / size
    else:
        radial, axial = (1.0, 0.0) if out >= down else (0.0, 1.0)
    nw, ne, nh = radial * w / max(rho, _NOTHING), radial * e / max(rho, _NOTHING), -axial
    return off, nw * dw + ne * m.d_e + nh * dh, -(nw * (vw + turn * h) + ne * m.v_e + nh * (vh - turn * w))


@kernel()
def _least(point: Float, t: Real, m: Sweep, top: Real) -> tuple[Real, Real]:
    """Least of the distance over the motion at t, and how it changes with t."""
    # At an edge the distance has two slopes; that of the least is their mean for which it does not change with sigma.
    low, high = -0.5, 0.5
    best, slope, grows_low = _offset(point, t, low, m, top)
    off, slope_high, grows_high = _offset(point, t, high, m, top)
    slope_low = slope
    if off < best:
        best, slope = off, slope_high
    if grows_low >= 0.0 or grows_high <= 0.0:  # the least is at an end, or the distance is not quite convex
        off, along, grows = _offset(point, t, 0.0, m, top)
        if off < best:
            best, slope = off, along
        if grows_low < 0.0 < grows:
            high, slope_high, grows_high = 0.0, along, grows
        elif grows < 0.0 < grows_high:
            low, slope_low, grows_low = 0.0, along, grows
        else:
            return best, slope
    before = best
    for _ in range(_HALVINGS):
        sigma = 0.5 * (low + high)
        off, along, grows = _offset(point, t, sigma, m, top)
        best = min(best, off)
        if grows < 0.0:
            low, slope_low, grows_low = sigma, along, grows
        else:
            high, slope_high, grows_high = sigma, along, grows
    if best < before:
        slope = (grows_high * slope_low - grows_low * slope_high) / (grows_high - grows_low)
    return best, slope


@kernel()
def _between(point: Float, out: Real, within: Real, m: Sweep, top: Real) -> Real:
    """Beginning of the sweep between a t outside of it and one within, by halving."""
    for _ in range(_STEPS):
        middle = 0.5 * (out + within)
        size, _ = _least(point, middle, m, top)
        out, within = (middle, within) if size > 0.0 else (out, middle)
    return within


@kernel()
def _entry_in_piece(point: Float, begin: Real, end: Real, m: Sweep, top: Real) -> tuple[Real, Real]:
    """Beginning of the sweep between two t, :data:`MISSED` where there is none; and the least distance, m."""
    way = 1.0 if end >= begin else -1.0
    t = begin
    size, slope = _least(point, t, m, top)
    for _ in range(_STEPS):
        if size <= _NEAR_M:
            return t, size
        falls = -way * slope
        if falls <= _LEVEL or size > falls * abs(end - t):
            beyond, _ = _least(point, end, m, top)
            return (_between(point, t, end, m, top) if beyond <= 2.0 * _NEAR_M else MISSED), size
        before, t = t, t + way * size / falls
        size, slope = _least(point, t, m, top)
        if size < -_NEAR_M:  # not quite convex: it began before
            return _between(point, before, t, m, top), size
    return t, size


@kernel()
def _entry(point: Float, begin: Real, end: Real, m: Sweep, top: Real) -> Real:
    """Beginning of the sweep on the way from one t to another; :data:`MISSED` where there is none."""
    size, _ = _least(point, begin, m, top)
    if size <= 0.0:
        return begin
    if size > abs(end - begin):
        return MISSED
    if abs(m.d_h) > 0.5 * m.omega * abs(m.d_w):  # the face is parallel to the line at no moment
        t, size = _entry_in_piece(point, begin, end, m, top)
        if t != MISSED or size > 0.5 * m.omega * (top + m.radius):
            return t
    step = (end - begin) / _PIECES
    for n in range(_PIECES):
        t = begin + n * step
        size, _ = _least(point, t, m, top)
        if size <= 0.0:  # the piece before did not see it
            return _between(point, t - step, t, m, top)
        if size <= abs(step):
            t, _ = _entry_in_piece(point, t, t + step, m, top)
            if t != MISSED:
                return t
    return MISSED


@kernel()
def _line_in_tool(q: Float, along: Whole, motion: Float, shape: Float, point: Float) -> Sweep:
    """The motion in the tool's frame of its middle; point (3,) receives that of the line."""
    frame = np.empty(FRAME)
    frame_of(motion, frame)
    x, y, z = q[0] - 0.5 * motion[3], q[1] - 0.5 * motion[4], q[2] - 0.5 * motion[5]
    for c in range(3):
        point[c] = frame[3 * c] * x + frame[3 * c + 1] * y + frame[3 * c + 2] * z
    return Sweep(
        frame[SPEED], frame[SPEED + 1], frame[SPEED + 2], frame[OMEGA],
        frame[along], frame[3 + along], frame[6 + along], shape[0], shape[1],
    )  # fmt: skip


@kernel()
def turning_stretch(q: Float, along: Whole, motion: Float, shape: Float) -> tuple[Real, Real]:
    """:func:`counterflex.cutting.tridexel.swept_solid.stretch` with an axis that turns.

    The first and the last point of the line that the sweep takes. Between them all is taken but where the end face is
    parallel to the line at some moment: there up to ``R turn / 2`` may be left, m off the face.
    """
    point = np.empty(3)
    m = _line_in_tool(q, along, motion, shape, point)
    top = shape[2]
    half = 0.5 * top
    reach = math.sqrt(m.radius * m.radius + half * half) + half * m.omega
    reach += 0.5 * math.sqrt(m.v_w * m.v_w + m.v_e * m.v_e + m.v_h * m.v_h)
    h = point[2] - half
    near = -(point[0] * m.d_w + point[1] * m.d_e + h * m.d_h)
    square = point[0] * point[0] + point[1] * point[1] + h * h - near * near
    if square > reach * reach:
        return MISSED, -MISSED
    half = math.sqrt(reach * reach - max(square, 0.0)) + 1.0e-6
    first = _entry(point, near - half, near + half, m, top)
    if first == MISSED:
        return MISSED, -MISSED
    last = _entry(point, near + half, first, m, top)
    return first, (first if last == MISSED else last)


@kernel()
def turning_end(q: Float, along: Whole, motion: Float, shape: Float, length: Real, filled: bool) -> Real:
    """End of material between two nodes, one in it and one not: the first of a sweep seen from the material.

    Args:
        q: See :func:`turning_stretch`: the lower node.
        length: Between the two nodes, m.
        filled: Whether the lower node is the one in material.

    Returns:
        Distance from the lower node, m; :data:`MISSED` where the sweep misses what is between.
    """
    point = np.empty(3)
    m = _line_in_tool(q, along, motion, shape, point)
    if filled:
        return _entry(point, 0.0, length, m, shape[2])
    return _entry(point, length, 0.0, m, shape[2])
