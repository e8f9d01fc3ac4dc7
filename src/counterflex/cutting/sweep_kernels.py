"""Kernels: drive the cutter along a path over the height map.

The map is worked in blocks of 8 x 16 cells whose highest cell is known, so that blocks already below the cutter are
skipped; the part of the cutter's footprint that an earlier segment has cut falls away by itself. Rows of blocks are
dealt to the workers in turn, so that each has its share of every segment.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.jit import kernel
from counterflex.cutting.booking_kernels import (
    AREA,
    BINS,
    BOOK,
    BOTTOM,
    COUNT,
    END_FACE,
    EVENTS,
    QUANTUM_M,
    VISITED,
    VOLUME,
    settle,
)
from counterflex.cutting.envelope_kernels import (
    LANES,
    ROWS,
    SIDE,
    block_ball,
    block_bull,
    block_flat,
    fill_minimiser,
    gather,
    height_under,
    highest,
)
from counterflex.cutting.kernel_arrays import GRID, SCRATCH, Scratch, StockGrid, Workspace

_STEEP: Final = 1.0e6
EIGHT: Final = 8
"""Blocks of a row that are looked at together whether one of them is above the cutter's lowest point."""


@kernel()
def stamp_rows(
    grid: StockGrid,
    worker: int,
    workers: int,
    path: Float,
    first: int,
    count: int,
    shape: Float,
    continued: bool,
    book: bool,
    booked: Int,
    totals: Int,
    scratch: Scratch,
) -> None:
    """Cut a run of ``count`` collinear segments within every ``workers``-th row of blocks.

    path is (n + 1, 3); the run goes from point ``first`` to ``first + count``. Row i of booked and totals belongs to
    segment first + i.
    """
    z, tops, x0, y0, cell, floor = grid.z, grid.tops, grid.x0, grid.y0, grid.cell, grid.floor
    lane, out, minimiser, stations = scratch.lane, scratch.out, scratch.minimiser, scratch.stations
    event, code, bit, hits = scratch.event, scratch.code, scratch.bit, scratch.hits
    ny, nx = z.shape
    radius, corner = shape[0], shape[1]
    xa, ya, za = path[first, 0], path[first, 1], path[first, 2]
    xb, yb, zb = path[first + count, 0], path[first + count, 1], path[first + count, 2]
    length = math.hypot(xb - xa, yb - ya)
    low = min(za, zb)
    slope = 0.0
    ux, uy = 1.0, 0.0
    # Steeper than that the horizontal way is rounding of the program: it would book a plunge to one side.
    if length > 1e-9 and abs(zb - za) < _STEEP * length:
        ux, uy = (xb - xa) / length, (yb - ya) / length
        slope = (zb - za) / length
        start = za
    else:
        length = 0.0
        start = low
        xa, ya = xb, yb
    plunge = length == 0.0
    descending = zb < za
    low = max(low, floor)
    flat = corner == 0.0
    ball = corner == radius
    sin_theta = slope / math.sqrt(1.0 + slope * slope)
    if not (flat or ball) and slope != 0.0:
        fill_minimiser(minimiser, radius, corner, slope)
    for k in range(SIDE):
        lane[k] = np.float32(k * cell * ux)
        lane[SIDE + k] = np.float32(-k * cell * uy)
    stations[0] = 0.0
    for i in range(1, count + 1):
        stations[i] = math.hypot(path[first + i, 0] - xa, path[first + i, 1] - ya)
    # What lies behind the start was cut by the segment before. On a descent the tool is lower now, so it cuts again as
    # far back as its rear touches: the whole radius of a flat end, less of a ball.
    reach_back = -1.0e30
    if continued and not plunge:
        reach_back = 0.0 if slope >= 0.0 else (radius * sin_theta if ball else -radius)
    y_low, y_high = min(ya, yb), max(ya, yb)
    f_len, f_za, f_slope = np.float32(length), np.float32(start), np.float32(slope)
    f_floor = np.float32(floor)
    f_rad, f_cor, f_sin = np.float32(radius), np.float32(corner), np.float32(sin_theta)
    row_low = max(0, math.floor((y_low - radius - y0) / cell / ROWS))
    # Dealt by their number in the map, not in the segment: a row has one owner for good, so no two threads write it.
    row_low += (worker - row_low) % workers
    row_high = min(tops.shape[0], math.floor((y_high + radius - y0) / cell / ROWS) + 1)
    gathered = 0
    mode = END_FACE if plunge else (BOOK if book else COUNT)
    half_x, half_y = 0.5 * (LANES - 1) * cell, 0.5 * (ROWS - 1) * cell
    diagonal = math.hypot(half_x, half_y)
    reach = half_x * abs(ux) + half_y * abs(uy)
    width = half_x * abs(uy) + half_y * abs(ux)
    inner, r2, corner2 = radius - corner, radius * radius, corner * corner
    # To spare: no block is skipped that rounding in its cells would lower.
    spare = 1e-3 * cell
    # A cell cut by a flat end on the level has the rounded height, which may lie above the height.
    limit = float(np.float32(low)) if flat and slope == 0.0 else low
    for block_row in range(row_low, row_high, workers):
        j_low = block_row * ROWS
        j_high = min(j_low + ROWS, ny)
        y_mid = y0 + cell * (j_low + 0.5 * (ROWS - 1))
        gap = max(0.0, max(y_low - (y_mid + half_y), y_mid - half_y - y_high))
        if gap >= radius:
            continue
        reach_x = math.sqrt(radius * radius - gap * gap)
        x_left, x_right = min(xa, xb) - reach_x, max(xa, xb) + reach_x
        block_low = max(0, math.floor((x_left - x0) / cell / LANES))
        block_high = min(tops.shape[1], math.floor((x_right - x0) / cell / LANES) + 1)
        if block_high == tops.shape[1] - 1:
            block_high = tops.shape[1]  # the last column of blocks overlaps the one before
        block = block_low - 1
        while block + 1 < block_high:
            block += 1
            if block + EIGHT <= block_high:
                above = False
                for k in range(EIGHT):
                    above |= tops[block_row, block + k] > limit
                if not above:
                    block += EIGHT - 1
                    continue
            top = tops[block_row, block]
            if top <= limit:
                continue
            i_low = min(block * LANES, nx - LANES)
            x_mid = x0 + cell * i_low + half_x
            dx, dy = x_mid - xa, y_mid - ya
            s_mid = dx * ux + dy * uy
            w_mid = dy * ux - dx * uy
            if s_mid + reach <= reach_back or abs(w_mid) - width >= radius:
                continue
            # The nearest cell lies no nearer than the circle about the block, nor than the rectangle along the feed.
            beyond = max(0.0, max(-s_mid, s_mid - length))
            away = math.sqrt(beyond * beyond + w_mid * w_mid) - diagonal
            along, aside = max(0.0, beyond - reach - spare), max(0.0, abs(w_mid) - width - spare)
            rho2 = along * along + aside * aside
            if away >= radius or rho2 >= r2:
                continue
            if not flat:
                under = low + corner - spare - top  # height of the centre of the corner above the highest cell
                over = max(0.0, math.sqrt(rho2) - inner)
                if under >= 0.0 and corner2 - over * over <= under * under:
                    continue
                if top <= low + height_under(max(0.0, away), radius, corner):
                    continue
            s_first = s_mid - half_x * ux - half_y * uy
            w_first = w_mid + half_x * uy - half_y * ux
            totals[0, VISITED] += (j_high - j_low) * LANES
            if flat:
                lowered = block_flat(
                    z, j_low, j_high, i_low, lane, bit, out, hits, s_first, w_first, cell, ux, uy, f_len, f_za, f_slope,
                    f_floor, f_rad,
                )  # fmt: skip
            elif ball:
                lowered = block_ball(
                    z, j_low, j_high, i_low, lane, bit, out, hits, s_first, w_first, cell, ux, uy, f_len, f_za, f_slope,
                    f_floor, f_rad, f_sin,
                )  # fmt: skip
            else:
                lowered = block_bull(
                    z, j_low, j_high, i_low, lane, bit, out, hits, s_first, w_first, cell, ux, uy, f_len, f_za, f_slope,
                    f_floor, f_rad, f_cor, minimiser,
                )  # fmt: skip
            if lowered == 0:
                continue
            for row in range(j_high - j_low):
                if hits[row] != 0:
                    gathered += gather(event, gathered, hits[row], out, row)
            tops[block_row, block] = highest(out, j_high - j_low)
            if gathered > EVENTS - (ROWS + 1) * LANES:
                settle(
                    event, code, gathered, booked, totals, count, stations, length, start, slope, descending, mode,
                    continued, minimiser, shape,
                )  # fmt: skip
                gathered = 0
    if gathered > 0:
        settle(
            event, code, gathered, booked, totals, count, stations, length, start, slope, descending, mode, continued,
            minimiser, shape,
        )  # fmt: skip


@kernel(
    "void(Grid, float64[:, ::1], int64[:, ::1], float64[::1], boolean, boolean[::1], int64[:, :, ::1], int64[:, ::1], "
    "int64, int64, Scratch)",
    waits=True,
    entry=True,
    Grid=GRID,
    Scratch=SCRATCH,
)
def stamp_runs(
    grid: StockGrid,
    path: Float,
    runs: Int,
    shape: Float,
    continued: bool,
    book: Bool,
    booked: Int,
    totals: Int,
    worker: int,
    workers: int,
    scratch: Scratch,
) -> None:
    """Cut a stretch of path in the rows of blocks that are dealt to a worker.

    path (n + 1, 3); runs (n_runs, 2) first segment and count; book (n,) flag; booked (n, levels, bins) and totals
    (n, 4) of this worker are added to.
    """
    for run in range(runs.shape[0]):
        a, n = runs[run, 0], runs[run, 1]
        stamp_rows(
            grid, worker, workers, path, a, n, shape, continued or a > 0, book[a], booked[a : a + n], totals[a : a + n],
            scratch,
        )  # fmt: skip


@kernel()
def stamp_segment(
    grid: StockGrid,
    shape: Float,
    xa: float,
    ya: float,
    za: float,
    xb: float,
    yb: float,
    zb: float,
    continued: bool,
    workspace: Workspace,
    depth_out: Float,
    extra_out: Float,
) -> float:
    """Cut one straight segment and say what it removed. For step-by-step loops inside other kernels.

    Args:
        grid: :class:`StockGrid` of the stock, cut in place.
        shape: ``Cutter.kernel_parameters()``.
        xa: Start of the tool tip, m, part frame; likewise ya, za.
        xb: End of the tool tip, m, part frame; likewise yb, zb.
        continued: True when the segment begins where an already stamped one ended (its start is skipped, no result
            changes).
        workspace: :class:`Workspace`, made for the same cutter.
        depth_out: (n_levels, 64) float64, overwritten: axial length in m of the edge engaged at each level and
            immersion angle, averaged over the segment: removed volume / (L R_level (cos phi_j - cos phi_j+1)).
            Zero for vertical moves.
        extra_out: (2,) float64, overwritten: volume removed by the end face in m^3 (part of the total, not in
            depth_out) and the horizontal area in m^2 under the cutter at the segment's end that was lowered by it
            (0 unless descending).

    Returns:
        Volume removed, m^3.
    """
    path, booked, totals = workspace.path, workspace.booked, workspace.totals
    path[0, 0], path[0, 1], path[0, 2] = xa, ya, za
    path[1, 0], path[1, 1], path[1, 2] = xb, yb, zb
    booked[:] = 0
    totals[:] = 0
    stamp_rows(grid, 0, 1, path, 0, 1, shape, continued, True, booked, totals, workspace.scratch)
    unit = QUANTUM_M * grid.cell * grid.cell
    length = math.hypot(xb - xa, yb - ya)
    levels = booked.shape[1]
    radii = 3 + levels
    removed = totals[0, VOLUME] + totals[0, BOTTOM]
    for level in range(levels):
        for j in range(BINS):
            depth_out[level, j] = 0.0
            if booked[0, level, j] > 0:
                removed += booked[0, level, j]
                depth_out[level, j] = (
                    booked[0, level, j] * unit / (length * shape[radii + level] * workspace.unit_width[j])
                )
    extra_out[0] = totals[0, BOTTOM] * unit
    extra_out[1] = totals[0, AREA] * grid.cell * grid.cell
    return float(removed * unit)
