"""Kernels: take the sweep of a tool out of columns of material, and gather what was taken for the books.

Columns are worked in the blocks of 8 x 16 of the height map. A block is plain while each of its columns is one stretch
on the common floor: there an upright tool is the height map's own stamp. Other motions look at a block only where its
highest material reaches into the bounds of the sweep, and then at sixteen columns of a row at once
(:mod:`pose_kernels`). What is left for single columns is to cut a stretch in two.
"""

from __future__ import annotations

import math
from typing import Annotated, Final, NamedTuple

import numpy as np

from counterflex.core.arrays import Bool, Float, Float1, Float2, Float32, Int
from counterflex.core.jit import bundle, kernel
from counterflex.cutting.booking_kernels import EVENTS, VISITED
from counterflex.cutting.envelope_kernels import LANES, ROWS, Int32, Real, Whole
from counterflex.cutting.kernel_arrays import SCRATCH, Scratch, StockGrid
from counterflex.cutting.sweep_kernels import stamp_rows
from counterflex.cutting.tridexel.column_block_kernels import (
    COLUMNS,
    LOWEST,
    MOST_STRETCHES,
    Columns as Columns,
    block_top,
    empty_columns,
    free,
    mark,
    take,
)
from counterflex.cutting.tridexel.pose_kernels import Sweep
from counterflex.cutting.tridexel.row_kernels import HIGH, LOW, highest_ends, lowest_ends
from counterflex.cutting.tridexel.sweep_bounds_kernels import (
    OMEGA,
    SPEED,
    TIP,
    already_cut,
    bounds_of,
    frame_of,
    missed,
)
from counterflex.cutting.tridexel.swept_solid import stretch
from counterflex.cutting.tridexel.turning_book_kernels import settle_turning

_PIECES: Final = 10.0
"""Pieces of what is taken out of a column in a radius of the cutter across its axis."""
_STEEP: Final = 0.25
"""Cosine of the tilt below which a motion is looked at column by column, with both ends of the tool."""
_BARE = np.float32(1.0e-9)


class Desk(NamedTuple):
    """Scratch arrays: events, their codes, lanes, what was taken out of a column, frame and bounds of a motion."""

    event: Annotated[Float32, "float32[:, ::1]"]
    code: Annotated[Int32, "int32[:, ::1]"]
    line: Annotated[Float32, "float32[:, ::1]"]
    work: Annotated[Float32, "float32[:, ::1]"]
    row: Annotated[Float32, "float32[::1]"]
    piece: Float2
    frame: Float1
    bounds: Float1
    motion: Float1
    point: Float1


DESK: Final = bundle(Desk)


@kernel()
def _push(
    event: Float32, gathered: Whole, line: Float32, k: Whole, m: Sweep, low: Real, high: Real, tilt: Real
) -> Whole:
    """Gather what was taken out of a lane between two t, in pieces; returns how many."""
    parts = 1 + int((high - low) * tilt / (float(m.radius) / _PIECES))
    # With little room left pieces get longer; none is lost.
    parts = min(parts, max(1, (EVENTS - LANES * MOST_STRETCHES - gathered) // LANES))
    step = (high - low) / parts
    for n in range(parts):
        t = np.float32(low + (n + 0.5) * step)
        event[0, gathered + n] = np.float32(step)
        event[1, gathered + n] = line[0, k] + t * m.d_w
        event[2, gathered + n] = line[1, k] + t * m.d_e
        event[3, gathered + n] = line[2, k] + t * m.d_h
    return parts


@kernel()
def _lay_lines(frame: Float, lane: Float32, x: Real, y: Real, line: Float32) -> None:
    """Points of sixteen columns at the height of the tip, in the tool's frame; x, y of the first."""
    dx, dy = x - frame[TIP], y - frame[TIP + 1]
    for c in range(3):
        base = np.float32(dx * frame[3 * c] + dy * frame[3 * c + 1])
        for k in range(LANES):
            line[c, k] = base + lane[c, k]


@kernel()
def _cut_row(columns: Columns, j: Whole, i_low: Whole, plain: bool, m: Sweep, tool: Float, begins: bool, tilt: Real,
             desk: Desk, gathered: Whole) -> Whole:  # fmt: skip
    """Cut sixteen columns of a row; returns how many events there are now, -1 where a column has no room."""
    # The first number of `desk.point` tells whether anything was taken, the second whether the block stays plain, the
    # last whether a column is full now.
    line, work, row, piece = desk.line, desk.work, desk.row, desk.piece
    z_tip = desk.frame[TIP + 2]
    if plain:
        for k in range(LANES):
            row[k] = columns.high[0, j, i_low + k]
    else:
        for k in range(LANES):
            n = int(columns.held[j, i_low + k])
            row[k] = columns.high[n - 1, j, i_low + k] if n > 0 else LOWEST
    low, high, near = work[LOW], work[HIGH], line[3]
    f_tip = np.float32(z_tip)
    for k in range(LANES):
        near[k] = row[k] - f_tip
    lowest_ends(m, begins, line, work)
    hit, under = False, False
    for k in range(LANES):
        lower = low[k] < near[k]
        hit = hit | lower
        under = under | (lower & (high[k] < near[k]))
    if not hit:
        return gathered
    if under:
        highest_ends(m, line, work)
        if 0.0 < m.corner < m.radius:  # above a rounded end: line by line
            q = desk.point[2:5]
            q[1], q[2] = columns.y0 + columns.cell * j - desk.motion[1], -desk.motion[2]
            for k in range(LANES):
                if low[k] < near[k]:
                    q[0] = columns.x0 + columns.cell * (i_low + k) - desk.motion[0]
                    one, two = stretch(q, 2, desk.motion, tool)
                    if one <= two:
                        low[k], high[k] = np.float32(one - z_tip), np.float32(two - z_tip)
    floor = np.float32(columns.floor)
    for k in range(LANES):
        if not low[k] < near[k]:
            continue
        if plain and high[k] >= near[k]:
            new = max(low[k] + f_tip, floor)
            if not new < row[k]:
                continue
            desk.point[0] = 1.0
            columns.high[0, j, i_low + k] = new
            if new <= floor:
                columns.held[j, i_low + k] = 0
            gathered += _push(desk.event, gathered, line, k, m, float(new) - z_tip, float(row[k]) - z_tip, tilt)
            continue
        n = int(columns.held[j, i_low + k])
        if high[k] >= near[k] and low[k] + f_tip > columns.low[n - 1, j, i_low + k] + _BARE:
            new = low[k] + f_tip
            if not new < row[k]:
                continue
            desk.point[0] = 1.0
            columns.high[n - 1, j, i_low + k] = new
            gathered += _push(desk.event, gathered, line, k, m, float(new) - z_tip, float(row[k]) - z_tip, tilt)
            continue
        taken = take(columns, j, i_low + k, float(low[k]) + z_tip, float(high[k]) + z_tip, piece)
        if taken < 0:
            return -1
        for p in range(taken):
            gathered += _push(desk.event, gathered, line, k, m, piece[p, 0] - z_tip, piece[p, 1] - z_tip, tilt)
        if taken > 0:
            desk.point[0] = 1.0
            desk.point[1] = 0.0 if plain else desk.point[1]
            if columns.held[j, i_low + k] == columns.low.shape[0]:
                desk.point[5] = 1.0
    return gathered


@kernel()
def _cut_row_slowly(columns: Columns, j: Whole, i_low: Whole, m: Sweep, shape: Float, desk: Desk, tilt: Real,
                    gathered: Whole) -> Whole:  # fmt: skip
    """As :func:`_cut_row`, column by column and with both ends of the tool: lying tools, and short ones in material."""
    motion, q, frame, piece = desk.motion, desk.point[2:5], desk.frame, desk.piece
    q[1] = columns.y0 + columns.cell * j - motion[1]
    q[2] = -motion[2]
    z_tip = frame[TIP + 2]
    for k in range(LANES):
        n = int(columns.held[j, i_low + k])
        if n == 0:
            continue
        q[0] = columns.x0 + columns.cell * (i_low + k) - motion[0]
        low, high = stretch(q, 2, motion, shape)
        if high <= low or high <= columns.low[0, j, i_low + k] or low >= columns.high[n - 1, j, i_low + k]:
            continue
        taken = take(columns, j, i_low + k, low, high, piece)
        if taken < 0:
            return -1
        for p in range(taken):
            gathered += _push(desk.event, gathered, desk.line, k, m, piece[p, 0] - z_tip, piece[p, 1] - z_tip, tilt)
        if taken > 0:
            desk.point[0], desk.point[1] = 1.0, 0.0
            if columns.held[j, i_low + k] == columns.low.shape[0]:
                desk.point[5] = 1.0
    return gathered


@kernel()
def cut_motion(columns: Columns, motion: Float, corners: Float, tool: Float, ceiling: float, begins: bool, book: bool,
               booked: Int, totals: Int, desk: Desk) -> bool:  # fmt: skip
    """Take the sweep of one motion with a tilted or turning tool out of the columns.

    Args:
        columns: Changed.
        motion: (12,) start of the tip in the part frame, displacement, axis in the middle, turn; see
            :mod:`swept_solid`.
        corners: ``Cutter.kernel_parameters()``.
        tool: (3,) radius, corner radius, top.
        ceiling: No material is higher, m.
        begins: No motion with this tool leads up to its start.
        book: Book by level and angle.
        booked: (n_levels, 64) quanta, added to.
        totals: (4,) quanta, added to.
        desk: Scratch.

    Returns:
        False where a column has no room for another stretch.
    """
    frame, bounds, line = desk.frame, desk.bounds, desk.line
    desk.motion[:] = motion
    frame_of(motion, frame)
    m = Sweep(
        np.float32(frame[SPEED]), np.float32(frame[SPEED + 1]), np.float32(frame[SPEED + 2]),
        np.float32(frame[OMEGA]), np.float32(frame[2]), np.float32(frame[5]), np.float32(frame[8]),
        np.float32(tool[0]), np.float32(tool[1]),
    )  # fmt: skip
    slowly = bounds_of(motion, tool, ceiling, _STEEP, bounds)
    tilt = math.hypot(frame[2], frame[5]) + (0.5 if tool[1] > 0.0 else 0.0) if book else 0.0
    lane = desk.work[-3:]
    cell = columns.cell
    for c in range(3):
        for k in range(LANES):
            lane[c, k] = np.float32(k * cell * frame[3 * c])
    ny, nx = columns.held.shape
    half_x, half_y = 0.5 * (LANES - 1) * cell, 0.5 * (ROWS - 1) * cell
    row_low = max(0, math.floor((bounds[1] - columns.y0) / cell / ROWS))
    row_high = min(columns.tops.shape[0], math.floor((bounds[3] - columns.y0) / cell / ROWS) + 1)
    block_low = max(0, math.floor((bounds[0] - columns.x0) / cell / LANES))
    block_high = min(columns.tops.shape[1], math.floor((bounds[2] - columns.x0) / cell / LANES) + 1)
    if block_high >= columns.tops.shape[1] - 1:
        block_high = columns.tops.shape[1]  # the last column of blocks overlaps the one before
    gathered = 0
    for block_row in range(row_low, row_high):
        j_low = block_row * ROWS
        j_high = min(j_low + ROWS, ny)
        y_mid = columns.y0 + cell * j_low + half_y
        for block in range(block_low, block_high):
            z_top = float(columns.tops[block_row, block])
            i_low = min(block * LANES, nx - LANES)
            x_mid = columns.x0 + cell * i_low + half_x
            if missed(bounds, x_mid, y_mid, half_x, half_y, z_top, slowly):
                continue
            plain = columns.plain[block_row, block] != 0
            done = not begins and not slowly
            if done and already_cut(bounds, motion[9:12], tool[1], x_mid, y_mid, half_x, half_y, z_top):
                continue
            desk.point[0], desk.point[1] = 0.0, 1.0 if plain else 0.0
            for j in range(j_low, j_high):
                y = columns.y0 + cell * j
                if missed(bounds, x_mid, y, half_x, 0.0, z_top, slowly):
                    continue
                totals[VISITED] += LANES
                _lay_lines(frame, lane, columns.x0 + cell * i_low, y, line)
                if slowly:
                    gathered = _cut_row_slowly(columns, j, i_low, m, tool, desk, tilt, gathered)
                else:
                    gathered = _cut_row(columns, j, i_low, desk.point[1] != 0.0, m, tool, begins, tilt, desk, gathered)
                if gathered < 0:
                    return False
                if desk.point[1] == 0.0 and plain:
                    mark(columns, block_row, block)
                    plain = False
                # One more row may add a piece of each stretch of sixteen columns: half of the events.
                if gathered > EVENTS // 2:
                    settle_turning(desk.event, desk.code, gathered, m, begins, book, corners, booked, totals)
                    gathered = 0
            if desk.point[0] != 0.0:
                columns.tops[block_row, block] = block_top(columns, block_row, block)
    if gathered > 0:
        settle_turning(desk.event, desk.code, gathered, m, begins, book, corners, booked, totals)
    return True


@kernel(
    "int64(Columns, float64[:, ::1], float64[:, ::1], int64[::1], int64[::1], float64[::1], "
    "float64[::1], float64, boolean, boolean[::1], boolean, int64[:, :, ::1], int64[:, ::1], "
    "Scratch, Desk)",
    entry=True,
    Columns=COLUMNS,
    Scratch=SCRATCH,
    Desk=DESK,
)
def cut_motions(
    columns: Columns,
    path: Float,
    motions: Float,
    owner: Int,
    upright: Int,
    corners: Float,
    tool: Float,
    ceiling: float,
    continued: bool,
    book: Bool,
    engagement: bool,
    booked: Int,
    totals: Int,
    scratch: Scratch,
    desk: Desk,
) -> int:
    """Take motions out one after the other, until a column is full. Returns how many were done.

    A motion gives a column at most one stretch more, so columns that are not full have room for it.

    Args:
        columns: Changed.
        path: (n + 1, 3) tip, m.
        motions: (k, 12), see :func:`cut_motion`.
        owner: (k,) segment of each.
        upright: (k,) where a run of collinear segments of an upright tool begins, how many they are; 0 elsewhere.
        corners: ``Cutter.kernel_parameters()``.
        tool: (3,) radius, corner radius, top.
        ceiling: No material is higher, m.
        continued: A motion with this tool leads up to the first.
        book: (n,) book the segment.
        engagement: ``booked`` has levels.
        booked: (n, n_levels, 64) quanta.
        totals: (n, 4) quanta.
        scratch: Of the height map's stamp.
    """
    desk.point[5] = 0.0
    grid = StockGrid(columns.high[0], columns.tops, columns.x0, columns.y0, columns.cell, columns.floor)
    k = 0
    while k < len(motions):
        row, count = owner[k], upright[k]
        follows = continued or k > 0
        if count > 0 and free(columns, path, row, count, tool[0], tool[2]):
            stamp_rows(
                grid, 0, 1, path, row, count, corners, follows, book[row],
                booked[row : row + count], totals[row : row + count], scratch,
            )  # fmt: skip
            if min(path[row, 2], path[row + count, 2]) <= columns.floor + 1.0e-6:
                empty_columns(columns, path, row, count, tool[0])
            k += count
            continue
        book_of = booked[row] if engagement else booked[0]
        if not cut_motion(
            columns, motions[k], corners, tool, ceiling, not follows, book[row], book_of, totals[row], desk
        ):
            return k
        k += 1
        if desk.point[5] != 0.0:
            return k
    return len(motions)
