"""Kernels: lower a height map by the exact swept envelope of a cutter and book what was removed.

A straight segment runs from a to b; s and w are the coordinates of a cell along and to the left of the horizontal
feed, L its horizontal length, m its slope dz/L. With the outline f of the cutter (see :class:`Cutter`) the swept
envelope at a cell is ``min over t in [0, L] of z_a + m t + f(sqrt((s - t)^2 + w^2))``. The function is convex in t,
and its free minimiser t = s + u(w) depends on w alone:

* flat: u = -q climbing, +q descending, with q = sqrt(R^2 - w^2);
* ball: u = -q sin(theta), tan(theta) = m;
* bull nose: u = 0 on the level; on a slope ``tan(psi) sqrt(1 - w^2/rho^2) = |m|`` with ``rho = R - r + r sin(psi)``,
  solved on a table over w for each segment and interpolated. An error in u enters the height only to second order.

Heights are float32 and computed in coordinates relative to the segment. Removed heights are added as whole numbers
of 2^-30 m, so that every sum is the same for any order, number of bands and number of threads.
"""

from __future__ import annotations

import math
from typing import Any, Final, TypeAlias

import numpy as np
import numpy.typing as npt

from counterflex.core.arrays import Float32
from counterflex.core.jit import kernel

Real: TypeAlias = Any
"""A scalar of a kernel: float64, or float32 where a loop is to run in vectors."""
Whole: TypeAlias = Any
"""An integer of a kernel."""
Int32: TypeAlias = npt.NDArray[np.int32]

LANES: Final = 16
"""Cells of a row worked on at once."""
ROWS: Final = 8
"""Rows of a block."""
NEW: Final = (ROWS + 1) * LANES
S: Final = 2 * NEW
W: Final = 3 * NEW
OUT: Final = 4 * NEW
"""Places in the results of a block, row by row: removed heights from 0, new ones, s, w; padded for reads of 16 from any
lane on."""
SIDE: Final = 32
"""Place of the lanes' steps in w behind those in s."""
NODES: Final = 256
"""Intervals of the table of a bull nose's minimiser; even in ``1 - sqrt(1 - |w|/R)``, as u ends in a square root."""

_LOWEST = np.float32(-3.0e38)
_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_TINY = np.float32(1.0e-9)
_FIRST = np.array([(i & -i).bit_length() - 1 if i else LANES for i in range(256)], np.int8)
_LAST = np.array([i.bit_length() - 1 if i else -LANES for i in range(256)], np.int8)
"""Places of the lowest and of the highest bit set in a byte; beyond the other byte's where none is."""


@kernel(inline=True)
def lower(row: Float32, k: Whole, low: Real, meets: bool, s: Real, w: Real, out: Float32, at: Whole) -> Whole:
    """Lower a cell of a block to a height where the cutter meets it, and note the results; whether it was lowered."""
    old = row[k]
    new = low if meets & (low < old) else old
    row[k] = new
    place = at + np.uint64(k)
    out[place] = old - new
    out[place + np.uint64(NEW)] = new
    out[place + np.uint64(S)] = s
    out[place + np.uint64(W)] = w
    return new < old


@kernel(inline=True, disjoint=True)
def block_flat(z: Float32, j_low: Whole, j_high: Whole, i_low: Whole, lane: Float32, bit: Int32, out: Float32,
               hits: Int32, s_first: Real, w_first: Real, step: Real, ux: Real, uy: Real, length: Real, za: Real,
               slope: Real, floor: Real, radius: Real) -> Whole:  # fmt: skip
    """Lower a block under a flat end mill; returns the lowered lanes as bits, and those of each row in hits."""
    lowered = np.int32(0)
    r2 = radius * radius
    for j in range(j_low, j_high):
        row, at = z[j, i_low : i_low + LANES], np.uint64((j - j_low) * LANES)
        s0, w0 = np.float32(s_first + (j - j_low) * step * uy), np.float32(w_first + (j - j_low) * step * ux)
        hit = np.int32(0)
        for k in range(LANES):
            s = s0 + lane[k]
            w = w0 + lane[SIDE + k]
            a = r2 - w * w
            q = math.sqrt(max(a, _ZERO))
            t_in = max(s - q, _ZERO)
            t_out = min(s + q, length)
            # A flat tool that climbs is lowest over a cell as its rim arrives, one that descends as it leaves.
            low = max(za + slope * (t_in if slope > _ZERO else t_out), floor)
            falls = lower(row, k, low, (a >= _ZERO) & (t_in <= t_out), s, w, out, at)
            hit = np.int32(hit | (bit[k] if falls else np.int32(0)))
        hits[j - j_low] = hit
        lowered |= hit
    return lowered


@kernel(inline=True, disjoint=True)
def block_ball(z: Float32, j_low: Whole, j_high: Whole, i_low: Whole, lane: Float32, bit: Int32, out: Float32,
               hits: Int32, s_first: Real, w_first: Real, step: Real, ux: Real, uy: Real, length: Real, za: Real,
               slope: Real, floor: Real, radius: Real, sin_theta: Real) -> Whole:  # fmt: skip
    """Lower a block under a ball end mill; see :func:`block_flat`."""
    lowered = np.int32(0)
    r2 = radius * radius
    for j in range(j_low, j_high):
        row, at = z[j, i_low : i_low + LANES], np.uint64((j - j_low) * LANES)
        s0, w0 = np.float32(s_first + (j - j_low) * step * uy), np.float32(w_first + (j - j_low) * step * ux)
        hit = np.int32(0)
        for k in range(LANES):
            s = s0 + lane[k]
            w = w0 + lane[SIDE + k]
            a = r2 - w * w
            t = min(max(s - sin_theta * math.sqrt(max(a, _ZERO)), _ZERO), length)
            rest = a - (s - t) * (s - t)
            low = max(za + slope * t + radius - math.sqrt(max(rest, _ZERO)), floor)
            falls = lower(row, k, low, (rest >= _ZERO), s, w, out, at)
            hit = np.int32(hit | (bit[k] if falls else np.int32(0)))
        hits[j - j_low] = hit
        lowered |= hit
    return lowered


@kernel(inline=True, disjoint=True)
def block_bull(z: Float32, j_low: Whole, j_high: Whole, i_low: Whole, lane: Float32, bit: Int32, out: Float32,
               hits: Int32, s_first: Real, w_first: Real, step: Real, ux: Real, uy: Real, length: Real, za: Real,
               slope: Real, floor: Real, radius: Real, corner: Real, minimiser: Float32) -> Whole:  # fmt: skip
    """Lower a block under a bull nose; minimiser is the table of u over |w| (ignored on the level)."""
    lowered = np.int32(0)
    inner = radius - corner
    r2 = corner * corner
    per = _ONE / radius
    nodes = np.float32(NODES)
    for j in range(j_low, j_high):
        row, at = z[j, i_low : i_low + LANES], np.uint64((j - j_low) * LANES)
        s0, w0 = np.float32(s_first + (j - j_low) * step * uy), np.float32(w_first + (j - j_low) * step * ux)
        hit = np.int32(0)
        for k in range(LANES):
            s = s0 + lane[k]
            w = w0 + lane[SIDE + k]
            u = _ZERO
            if slope != _ZERO:
                x = nodes * (_ONE - math.sqrt(max(_ONE - abs(w) * per, _TINY)))
                i = np.int32(x)
                u = minimiser[i] + (x - np.float32(i)) * (minimiser[i + 1] - minimiser[i])
            t = min(max(s + u, _ZERO), length)
            v = max(math.sqrt(w * w + (s - t) * (s - t)) - inner, _ZERO)
            rest = r2 - v * v
            low = max(za + slope * t + corner - math.sqrt(max(rest, _ZERO)), floor)
            falls = lower(row, k, low, (rest >= _ZERO), s, w, out, at)
            hit = np.int32(hit | (bit[k] if falls else np.int32(0)))
        hits[j - j_low] = hit
        lowered |= hit
    return lowered


@kernel(inline=True, disjoint=True)
def gather(event: Float32, gathered: Whole, hit: Whole, out: Float32, row: Whole) -> int:
    """Append the row's columns from the first to the last that was lowered; returns how many."""
    left, right = hit & 255, (hit >> 8) & 255
    first = min(int(_FIRST[left]), 8 + int(_FIRST[right]))
    last = max(int(_LAST[left]), 8 + int(_LAST[right]))
    # A loop that does nothing but copy becomes one move of sixteen; unsigned places need no look whether they count
    # from the end.
    to, at = np.uint64(gathered), np.uint64(row * LANES + first)
    for k in range(LANES):
        event[0, to + np.uint64(k)] = out[at + np.uint64(k)]
    for k in range(LANES):
        event[1, to + np.uint64(k)] = out[at + np.uint64(NEW + k)]
    for k in range(LANES):
        event[2, to + np.uint64(k)] = out[at + np.uint64(S + k)]
    for k in range(LANES):
        event[3, to + np.uint64(k)] = out[at + np.uint64(W + k)]
    return last + 1 - first


@kernel(disjoint=True)
def highest(out: Float32, rows: Whole) -> Real:
    """Highest of the new heights of a block; out is overwritten from its beginning."""
    for k in range(rows * LANES, ROWS * LANES):
        out[NEW + k] = _LOWEST
    for k in range(LANES):
        top = out[NEW + k]
        for row in range(1, ROWS):
            top = max(top, out[NEW + row * LANES + k])
        out[k] = top
    for k in range(8):
        out[k] = max(out[k], out[8 + k])
    for k in range(4):
        out[k] = max(out[k], out[4 + k])
    return max(max(out[0], out[1]), max(out[2], out[3]))


@kernel()
def fill_minimiser(table: Float32, radius: Real, corner: Real, slope: Real) -> None:
    """Tabulate u(|w|) of a bull nose at the slope, to 1e-6 of the radius."""
    # With x = sin(psi) the minimiser is the root of x sqrt((1 + m^2) rho^2 - w^2) - |m| rho, rho = R - r + r x. Newton
    # falls to it from x = 1: by a third a step where the root is flat, hence so many at most. All nodes in vectors.
    inner = radius - corner
    steep = abs(slope)
    k = 1.0 + steep * steep
    sign = -1.0 if slope > 0.0 else 1.0
    sine = np.ones(NODES + 1)
    for step in range(17):
        moved = False
        for i in range(NODES + 1):
            away = 1.0 - i * (1.0 / NODES)
            w = radius * (1.0 - away * away)
            x = sine[i]
            rho = inner + corner * x
            value = np.float32(sign * math.sqrt(max(0.0, rho * rho - w * w)))
            moved |= value != table[i]
            table[i] = value
            root = math.sqrt(max(k * rho * rho - w * w, 1.0e-30))
            rise = root + x * k * rho * corner / root - steep * corner
            # Below that sine the outline is narrower than w: the tool does not reach the column, the root is imaginary.
            least = max(0.0, (w - inner) / corner)
            sine[i] = min(max(x - (x * root - steep * rho) / rise, least), 1.0)
        if step > 0 and not moved:
            return


@kernel()
def height_under(rho: Real, radius: Real, corner: Real) -> Real:
    """Height of the outline at rho above the tip."""
    v = max(0.0, rho - (radius - corner))
    return corner - math.sqrt(max(0.0, corner * corner - v * v))


@kernel()
def radius_over(h: Real, radius: Real, corner: Real) -> Real:
    """Radius of the outline at height h above the tip."""
    if h >= corner:
        return radius
    return radius - corner + math.sqrt(max(0.0, h * (2.0 * corner - h)))
