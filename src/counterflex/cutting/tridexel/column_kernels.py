"""Kernels: take the sweep of a tool out of columns of material and book where on the cutter it was met.

Of every piece taken out of a column, in lengths of at most a cell, the middle is followed back to the place of the
motion at which the cutter first meets it. There the height on the cutter gives the level, and its distance from the
axis to the left of the feed the immersion angle; of what a descending motion takes, the share of the end face is that
of the axial in the normal speed of the surface, as in :mod:`counterflex.cutting.booking_kernels`.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from counterflex.core.arrays import Float, Float32, Int
from counterflex.core.jit import kernel
from counterflex.cutting.booking_kernels import BINS, BOTTOM, QUANTUM_M, VISITED, VOLUME
from counterflex.cutting.tridexel.swept_solid import depth_at, distance, stretch

UInt8 = npt.NDArray[np.uint8]
STRETCHES: Final = 8
"""Stretches of material that a column can hold."""
_HALVINGS: Final = 40
_TINY_M: Final = 1.0e-9
_NO_FEED: Final = 1.0e-9
_PIECES: Final = 20.0
"""Pieces of a column in a radius of the cutter, at least."""

Real = Any
Whole = Any


class Columns(NamedTuple):
    """Columns of material: (8, ny, nx) lower and upper ends, (ny, nx) stretches held, centre of the first, side (m)."""

    low: Float32
    high: Float32
    held: UInt8
    x0: float
    y0: float
    cell: float


class Books(NamedTuple):
    """Where the removal of motions goes: (1, n, levels, bins) quanta, (n, 4) totals, what is booked at all."""

    booked: Int
    totals: Int
    book: bool
    continued: bool


@kernel()
def _first_met(x: Real, y: Real, z: Real, motion: Float, shape: Float) -> float:
    """Share of the motion at which the cutter first meets a point of its sweep (from the start of the tip)."""
    if depth_at(x, y, z, motion, shape) <= 0.0:
        return -1.0
    _, high = distance(x, y, z, motion, shape)
    low = 0.0
    for _ in range(_HALVINGS):
        s = 0.5 * (low + high)
        if depth_at(x - s * motion[3], y - s * motion[4], z - s * motion[5], motion, shape) > 0.0:
            low = s
        else:
            high = s
    return high


@kernel()
def _book(x: Real, y: Real, z: Real, step: Real, motion: Float, shape: Float, books: Books, row: Whole) -> None:
    """Book a piece of length step about a point (from the start of the tip); shape is that with the levels."""
    quanta, tall = np.int64(round(step / QUANTUM_M)), step * abs(motion[8])
    totals = books.totals
    if not books.book:
        totals[row, VOLUME] += quanta
        return
    s = _first_met(x, y, z, motion, shape)
    vx, vy, vz = motion[3], motion[4], motion[5]
    ux, uy, uz = motion[6], motion[7], motion[8]
    along = vx * ux + vy * uy + vz * uz
    fx, fy, fz = vx - along * ux, vy - along * uy, vz - along * uz
    feed = math.sqrt(fx * fx + fy * fy + fz * fz)
    if feed <= _NO_FEED:
        totals[row, BOTTOM] += quanta
        return
    if s < 0.0:
        if books.continued:
            s = 0.0
        else:
            totals[row, BOTTOM] += quanta
            return
    px, py, pz = x - s * vx, y - s * vy, z - s * vz
    h = px * ux + py * uy + pz * uz
    rx, ry, rz = px - h * ux, py - h * uy, pz - h * uz
    rho = max(math.sqrt(rx * rx + ry * ry + rz * rz), 1.0e-12)
    ahead = (rx * fx + ry * fy + rz * fz) / (feed * rho)
    # to the left of the feed: axis x feed
    left = (rx * (uy * fz - uz * fy) + ry * (uz * fx - ux * fz) + rz * (ux * fy - uy * fx)) / (feed * rho)
    corner, inner = shape[1], shape[0] - shape[1]
    radial, axial = 1.0, 0.0
    if h < corner - _TINY_M or rho < shape[0] - 1.0e-6:
        radial, axial = max(rho - inner, 0.0), max(corner - h, 0.0)
        if corner == 0.0 or radial + axial <= 0.0:
            radial, axial = 0.0, 1.0
        size = math.hypot(radial, axial)
        radial, axial = radial / size, axial / size
    side = max(radial * ahead, 0.0) * feed
    down = max(-along, 0.0) * axial
    share = quanta
    if down > 0.0 or side <= 0.0:
        share = np.int64(round(quanta * side / max(side + down, 1.0e-30))) if side > 0.0 else np.int64(0)
    totals[row, BOTTOM] += quanta - share
    phi = math.acos(min(1.0, max(-1.0, left)))
    place = min(int(phi * (BINS / math.pi)), BINS - 1)
    levels, rest = int(shape[3]), share
    low, high = max(0.0, h - 0.5 * tall), max(0.0, h + 0.5 * tall)
    for level in range(levels):  # a piece may reach over several levels
        border = shape[5 + level]
        if border <= low or rest == 0:
            continue
        part = rest
        if border < high:
            part = min(rest, np.int64(round(share * (border - max(low, shape[4 + level])) / (high - low))))
        books.booked[0, row, level, place] += part
        rest -= part
    books.booked[0, row, levels, place] += rest


@kernel()
def _take(columns: Columns, j: Whole, i: Whole, low: Real, high: Real, piece: Float) -> Whole:
    """Take [low, high] out of a column; piece (8, 2) receives what was taken. Returns how many pieces, -1: no room."""
    ends_low, ends_high = columns.low[:, j, i], columns.high[:, j, i]
    n, taken = int(columns.held[j, i]), 0
    k = 0
    while k < n:
        bottom, top = float(ends_low[k]), float(ends_high[k])
        one, two = max(low, bottom), min(high, top)
        if two - one <= _TINY_M:
            k += 1
            continue
        piece[taken, 0], piece[taken, 1] = one, two
        taken += 1
        below, above = one - bottom > _TINY_M, top - two > _TINY_M
        if below and above:
            if n == STRETCHES:
                return -1
            for m in range(n, k + 1, -1):
                ends_low[m], ends_high[m] = ends_low[m - 1], ends_high[m - 1]
            ends_high[k] = one
            ends_low[k + 1], ends_high[k + 1] = two, top
            n += 1
            k += 2
        elif below:
            ends_high[k] = one
            k += 1
        elif above:
            ends_low[k] = two
            k += 1
        else:
            for m in range(k, n - 1):
                ends_low[m], ends_high[m] = ends_low[m + 1], ends_high[m + 1]
            n -= 1
    columns.held[j, i] = n
    return taken


@kernel()
def cut_motion(columns: Columns, motion: Float, shape: Float, books: Books, row: Whole) -> bool:
    """Take the sweep of one straight motion out of the columns; False where a column would need more stretches.

    Args:
        columns: Changed.
        motion: (9,) start of the tip in the part frame, displacement, tool axis.
        shape: Radius, corner radius, top, then number of corner levels and their boundaries.
        books: What was removed is added to row ``row``.
        row: Of the books.
    """
    ny, nx = columns.held.shape
    cell, radius, top = columns.cell, shape[0], shape[2]
    reach_x, reach_y = top * motion[6], top * motion[7]
    x_low = motion[0] + min(0.0, motion[3]) + min(0.0, reach_x) - radius
    x_high = motion[0] + max(0.0, motion[3]) + max(0.0, reach_x) + radius
    y_low = motion[1] + min(0.0, motion[4]) + min(0.0, reach_y) - radius
    y_high = motion[1] + max(0.0, motion[4]) + max(0.0, reach_y) + radius
    i_low = max(0, math.ceil((x_low - columns.x0) / cell))
    i_high = min(nx - 1, math.floor((x_high - columns.x0) / cell))
    j_low = max(0, math.ceil((y_low - columns.y0) / cell))
    j_high = min(ny - 1, math.floor((y_high - columns.y0) / cell))
    z_low = motion[2] + min(0.0, motion[5]) + min(0.0, top * motion[8]) - radius
    finest = min(cell, radius / _PIECES)
    q, piece = np.empty(3), np.empty((STRETCHES, 2))
    q[2] = 0.0 - motion[2]
    for j in range(j_low, j_high + 1):
        q[1] = columns.y0 + cell * j - motion[1]
        for i in range(i_low, i_high + 1):
            n = int(columns.held[j, i])
            if n == 0 or columns.high[n - 1, j, i] <= z_low:
                continue
            q[0] = columns.x0 + cell * i - motion[0]
            first, last = stretch(q, 2, motion, shape)
            if last <= first or last <= columns.low[0, j, i] or first >= columns.high[n - 1, j, i]:
                continue
            books.totals[row, VISITED] += 1
            taken = _take(columns, j, i, first, last, piece)
            if taken < 0:
                return False
            for k in range(taken):
                parts = 1 + int((piece[k, 1] - piece[k, 0]) / finest) if books.book else 1
                step = (piece[k, 1] - piece[k, 0]) / parts
                for m in range(parts):
                    z = piece[k, 0] + (m + 0.5) * step
                    _book(q[0], q[1], z + q[2], step, motion, shape, books, row)
    return True


@kernel()
def cut_motions(columns: Columns, motions: Float, owner: Int, shape: Float, books: Books, book: Float) -> int:
    """Take motions (k, 9) out one after the other; owner (k,) is the row of each. Returns how many were done."""
    for k in range(len(motions)):
        of = Books(books.booked, books.totals, book[owner[k]] > 0.0, books.continued or k > 0)
        if not cut_motion(columns, motions[k], shape, of, owner[k]):
            return k
    return len(motions)
