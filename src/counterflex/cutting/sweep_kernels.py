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

What a removed column cost is booked to the cutter's element that first met it: the circle at height h above the tip,
of radius r(h), meets a column with its front at t = s - sqrt(r(h)^2 - w^2), at the immersion angle
``phi = acos(w / r(h))``. What the end face removes (descending moves, plunges) is booked apart.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from counterflex.core.arrays import Float, Float32, Int
from counterflex.core.jit import kernel, prange

Int32 = npt.NDArray[np.int32]

BINS = 64
"""Bins of the immersion angle over (0, pi)."""
ROWS = 8
LANES = 16
BAND_BLOCKS = 8
"""Blocks of rows in a band: 64 rows, which stay in the second-level cache while all segments pass."""
QUANTUM_M = 2.0**-30
"""Unit of the booked heights, m."""
NODES = 256
"""Intervals of the table of the minimiser of a bull nose over w in [0, R]."""
VOLUME, BOTTOM, AREA, VISITED = 0, 1, 2, 3
"""Columns of the per-segment totals: quanta removed, of these by the end face, cells under it, cells visited."""

_ZERO = np.float32(0.0)
_HALF = np.float32(0.5)
_SCALE = np.float32(2.0**30)
_STEEP = 1.0e6


@kernel()
def _row_flat(row, lane, out, s0, w0, length, za, slope, floor, radius):  # type: ignore[no-untyped-def]
    """Lower 16 cells under a flat end mill; out receives the quanta removed, the result is 0 when none was."""
    hit = np.int32(0)
    r2 = radius * radius
    for k in range(LANES):
        s = s0 + lane[k]
        w = w0 + lane[LANES + k]
        a = r2 - w * w
        q = math.sqrt(max(a, _ZERO))
        t_in = max(s - q, _ZERO)
        t_out = min(s + q, length)
        low = max(za + slope * (t_in if slope > _ZERO else t_out), floor)
        old = row[k]
        new = low if (a >= _ZERO) & (t_in <= t_out) & (low < old) else old
        d = np.int32((old - new) * _SCALE + _HALF)
        row[k] = new
        out[k] = d
        hit |= d
    return hit


@kernel()
def _row_ball(row, lane, out, s0, w0, length, za, slope, floor, radius, sin_theta):  # type: ignore[no-untyped-def]
    """Lower 16 cells under a ball end mill."""
    hit = np.int32(0)
    r2 = radius * radius
    for k in range(LANES):
        s = s0 + lane[k]
        w = w0 + lane[LANES + k]
        a = r2 - w * w
        t = min(max(s - sin_theta * math.sqrt(max(a, _ZERO)), _ZERO), length)
        rest = a - (s - t) * (s - t)
        low = max(za + slope * t + radius - math.sqrt(max(rest, _ZERO)), floor)
        old = row[k]
        new = low if (rest >= _ZERO) & (low < old) else old
        d = np.int32((old - new) * _SCALE + _HALF)
        row[k] = new
        out[k] = d
        hit |= d
    return hit


@kernel()
def _row_bull(row, lane, out, s0, w0, length, za, slope, floor, radius, corner, minimiser):  # type: ignore[no-untyped-def]
    """Lower 16 cells under a bull nose; minimiser is the table of u over |w| (ignored on the level)."""
    hit = np.int32(0)
    inner = radius - corner
    r2 = corner * corner
    per = np.float32(NODES) / radius
    for k in range(LANES):
        s = s0 + lane[k]
        w = w0 + lane[LANES + k]
        u = _ZERO
        if slope != _ZERO:
            x = min(abs(w) * per, np.float32(NODES - 0.001))
            i = np.int32(x)
            u = minimiser[i] + (x - np.float32(i)) * (minimiser[i + 1] - minimiser[i])
        t = min(max(s + u, _ZERO), length)
        v = max(math.sqrt(w * w + (s - t) * (s - t)) - inner, _ZERO)
        rest = r2 - v * v
        low = max(za + slope * t + corner - math.sqrt(max(rest, _ZERO)), floor)
        old = row[k]
        new = low if (rest >= _ZERO) & (low < old) else old
        d = np.int32((old - new) * _SCALE + _HALF)
        row[k] = new
        out[k] = d
        hit |= d
    return hit


@kernel()
def _fill_minimiser(table: Float32, radius: float, corner: float, slope: float) -> None:
    """Tabulate u(|w|) of a bull nose at the slope: bisection on psi, then Newton's accuracy by 40 halvings."""
    inner = radius - corner
    steep = abs(slope)
    sign = -1.0 if slope > 0.0 else 1.0
    for i in range(NODES + 1):
        w = radius * i / NODES
        low = math.asin(min(1.0, max(0.0, (w - inner) / corner)))
        high = 0.5 * math.pi
        for _ in range(40):
            psi = 0.5 * (low + high)
            rho = inner + corner * math.sin(psi)
            if math.tan(psi) * math.sqrt(max(0.0, 1.0 - (w / rho) ** 2)) < steep:
                low = psi
            else:
                high = psi
        rho = inner + corner * math.sin(0.5 * (low + high))
        table[i] = sign * math.sqrt(max(0.0, rho * rho - w * w))


@kernel()
def _phi_bin(ratio: float) -> int:
    """Bin of phi = acos(ratio)."""
    phi = math.acos(min(1.0, max(-1.0, ratio)))
    return min(int(phi * (BINS / math.pi)), BINS - 1)


@kernel()
def _height_under(rho: float, radius: float, corner: float) -> float:
    """Height of the outline at rho above the tip."""
    v = max(0.0, rho - (radius - corner))
    return corner - math.sqrt(max(0.0, corner * corner - v * v))


@kernel()
def _radius_over(h: float, radius: float, corner: float) -> float:
    """Radius of the outline at height h above the tip."""
    if h >= corner:
        return radius
    return radius - corner + math.sqrt(max(0.0, h * (2.0 * corner - h)))


@kernel()
def _book_column(  # type: ignore[no-untyped-def]
    booked, sub, quanta, old, new, s, w, length, za, slope, minimiser, shape
):
    """Split one removed column by level and angle; returns the quanta removed by the end face.

    booked (n_sub, n_levels, bins) receives the quanta of the side for the segment ``sub``. Of a slice cut by a
    descending corner the share ``sin(phi) tan(kappa) / (sin(phi) tan(kappa) + |m|)`` belongs to the horizontal
    motion, the rest to the end face.
    """
    radius, corner = shape[0], shape[1]
    levels = int(shape[2])
    inner = radius - corner
    aside = abs(w)
    left = quanta
    bottom = 0
    if slope > 0.0:
        if corner == radius:
            t_new = s - math.sqrt(max(0.0, radius * radius - w * w)) * slope / math.sqrt(1.0 + slope * slope)
        elif levels > 0:
            x = min(aside * NODES / radius, NODES - 0.001)
            i = int(x)
            t_new = s + minimiser[i] + (x - i) * (minimiser[i + 1] - minimiser[i])
        else:
            t_new = s
    else:
        t_new = s - math.sqrt(max(0.0, inner * inner - w * w))
    tip = za + slope * min(max(t_new, 0.0), length)
    if slope < 0.0:
        front = tip + _height_under(max(aside, inner), radius, corner)
        bottom = min(quanta, int(round(min(max(front - new, 0.0), old - new) * (1.0 / QUANTUM_M))))
        new += bottom * QUANTUM_M
        left -= bottom
    if levels == 0:
        booked[sub, 0, _phi_bin(w / radius)] += left
        return bottom
    h_new = max(0.0, new - tip)
    upper = old
    h_up = 1.0e9
    for level in range(levels, -1, -1):
        if left <= 0:
            break
        h = shape[3 + level]
        lower = new
        if h > h_new and level > 0:
            r = _radius_over(h, radius, corner)
            lower = za + slope * min(max(s - math.sqrt(max(0.0, r * r - w * w)), 0.0), length) + h
        else:
            h = h_new
        if lower < upper:
            part = left
            if lower > new:
                part = min(left, int(round((upper - lower) * (1.0 / QUANTUM_M))))
            r_mid = max(_radius_over(0.5 * (h + min(h_up, h + upper - lower)), radius, corner), 1.0e-12)
            share = part
            if slope < 0.0 and level < levels:
                ratio = min(1.0, aside / r_mid)
                v = max(0.0, r_mid - inner)
                pull = math.sqrt(1.0 - ratio * ratio) * v / math.sqrt(max(1.0e-30, corner * corner - v * v))
                share = int(round(part * pull / (pull - slope)))
                bottom += part - share
            booked[sub, level, _phi_bin(w / r_mid)] += share
            left -= part
            upper = max(lower, new)
        h_up = h
    return bottom + left


@kernel()
def stamp_rows(  # type: ignore[no-untyped-def]
    z,
    tops,
    x0,
    y0,
    cell,
    floor,
    block_first,
    block_last,
    path,
    first,
    count,
    shape,
    continued,
    book,
    booked,
    totals,
    lane,
    out,
    minimiser,
    stations,
):
    """Cut a run of ``count`` collinear segments within block rows [block_first, block_last).

    path is (n + 1, 3); the run goes from point ``first`` to ``first + count``. Row i of booked and totals belongs to
    segment first + i.
    """
    ny, nx = z.shape
    radius, corner = shape[0], shape[1]
    xa, ya, za = path[first, 0], path[first, 1], path[first, 2]
    xb, yb, zb = path[first + count, 0], path[first + count, 1], path[first + count, 2]
    length = math.hypot(xb - xa, yb - ya)
    low = min(za, zb)
    slope = 0.0
    ux, uy = 1.0, 0.0
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
        _fill_minimiser(minimiser, radius, corner, slope)
    for k in range(LANES):
        lane[k] = np.float32(k * cell * ux)
        lane[LANES + k] = np.float32(-k * cell * uy)
    stations[0] = 0.0
    for i in range(1, count + 1):
        stations[i] = math.hypot(path[first + i, 0] - xa, path[first + i, 1] - ya)
    behind = -1.0e30
    if continued and not plunge and not flat:
        behind = 0.0 if slope >= 0.0 else (radius * sin_theta if ball else -radius)
    y_low, y_high = min(ya, yb), max(ya, yb)
    f_len, f_za, f_slope = np.float32(length), np.float32(start), np.float32(slope)
    f_floor = np.float32(floor)
    f_rad, f_cor, f_sin = np.float32(radius), np.float32(corner), np.float32(sin_theta)
    row_low = max(block_first, int(math.floor((y_low - radius - y0) / cell / ROWS)))
    row_high = min(block_last, int(math.floor((y_high + radius - y0) / cell / ROWS)) + 1)
    half_x, half_y = 0.5 * (LANES - 1) * cell, 0.5 * (ROWS - 1) * cell
    diagonal = math.hypot(half_x, half_y)
    reach = half_x * abs(ux) + half_y * abs(uy)
    width = half_x * abs(uy) + half_y * abs(ux)
    for block_row in range(row_low, row_high):
        j_low = block_row * ROWS
        j_high = min(j_low + ROWS, ny)
        y_mid = y0 + cell * (j_low + 0.5 * (ROWS - 1))
        gap = max(0.0, max(y_low - (y_mid + half_y), y_mid - half_y - y_high))
        if gap >= radius:
            continue
        reach_x = math.sqrt(radius * radius - gap * gap)
        x_left, x_right = min(xa, xb) - reach_x, max(xa, xb) + reach_x
        block_low = max(0, int(math.floor((x_left - x0) / cell / LANES)))
        block_high = min(tops.shape[1], int(math.floor((x_right - x0) / cell / LANES)) + 1)
        if block_high == tops.shape[1] - 1:
            block_high = tops.shape[1]  # the last column of blocks overlaps the one before
        for block in range(block_low, block_high):
            top = tops[block_row, block]
            if top <= low:
                continue
            i_low = min(block * LANES, nx - LANES)
            x_mid = x0 + cell * i_low + half_x
            dx, dy = x_mid - xa, y_mid - ya
            s_mid = dx * ux + dy * uy
            w_mid = dy * ux - dx * uy
            if s_mid + reach <= behind or abs(w_mid) - width >= radius:
                continue
            beyond = s_mid - min(max(s_mid, 0.0), length)
            distance = math.sqrt(beyond * beyond + w_mid * w_mid) - diagonal
            if distance >= radius:
                continue
            if not flat and top <= low + _height_under(max(0.0, distance), radius, corner):
                continue
            s_first = s_mid - half_x * ux - half_y * uy
            w_first = w_mid + half_x * uy - half_y * ux
            changed = False
            totals[0, VISITED] += (j_high - j_low) * LANES
            for j in range(j_low, j_high):
                s_row = s_first + (j - j_low) * cell * uy
                w_row = w_first + (j - j_low) * cell * ux
                row = z[j, i_low : i_low + LANES]
                if flat:
                    hit = _row_flat(
                        row, lane, out, np.float32(s_row), np.float32(w_row), f_len, f_za, f_slope, f_floor, f_rad
                    )
                elif ball:
                    hit = _row_ball(
                        row,
                        lane,
                        out,
                        np.float32(s_row),
                        np.float32(w_row),
                        f_len,
                        f_za,
                        f_slope,
                        f_floor,
                        f_rad,
                        f_sin,
                    )
                else:
                    hit = _row_bull(
                        row,
                        lane,
                        out,
                        np.float32(s_row),
                        np.float32(w_row),
                        f_len,
                        f_za,
                        f_slope,
                        f_floor,
                        f_rad,
                        f_cor,
                        minimiser,
                    )
                if hit == 0:
                    continue
                changed = True
                for k in range(LANES):
                    quanta = int(out[k])
                    if quanta <= 0:
                        continue
                    s = s_row + k * cell * ux
                    w = w_row - k * cell * uy
                    new = float(row[k])
                    old = new + quanta * QUANTUM_M
                    sub = 0
                    if count > 1:
                        t = s - math.sqrt(max(0.0, radius * radius - w * w))
                        while sub < count - 1 and t >= stations[sub + 1]:
                            sub += 1
                    totals[sub, VOLUME] += quanta
                    ahead = s - stations[sub + 1]
                    if descending and ahead * ahead + w * w <= radius * radius:
                        totals[sub, AREA] += 1
                    if plunge or (not continued and s * s + w * w <= radius * radius):
                        totals[sub, BOTTOM] += quanta
                    elif book:
                        totals[sub, BOTTOM] += _book_column(
                            booked, sub, quanta, old, new, s, w, length, za, slope, minimiser, shape
                        )
            if changed:
                highest = z[j_low, i_low]
                for j in range(j_low, j_high):
                    for k in range(LANES):
                        highest = max(highest, z[j, i_low + k])
                tops[block_row, block] = highest


@kernel(parallel=True)
def stamp_bands(  # type: ignore[no-untyped-def]
    z, tops, x0, y0, cell, floor, path, runs, shape, continued, book, booked, totals, workers
):
    """Cut a stretch of path in bands of 64 rows dealt to workers.

    path (n + 1, 3); runs (n_runs, 2) first segment and count; book (n,) flag; booked (workers, n, levels, bins)
    int64 and totals (workers, n, 4) int64 are added to.
    """
    bands = (tops.shape[0] + BAND_BLOCKS - 1) // BAND_BLOCKS
    radius = shape[0]
    longest = runs[:, 1].max()
    for worker in prange(workers):
        lane = np.empty(2 * LANES, np.float32)
        out = np.empty(LANES, np.int32)
        minimiser = np.empty(NODES + 2, np.float32)
        stations = np.empty(longest + 1, np.float64)
        for band in range(worker, bands, workers):
            first_block = band * BAND_BLOCKS
            last_block = min(first_block + BAND_BLOCKS, tops.shape[0])
            band_low = y0 + cell * (first_block * ROWS - 1) - radius
            band_high = y0 + cell * (last_block * ROWS) + radius
            for run in range(runs.shape[0]):
                a = runs[run, 0]
                n = runs[run, 1]
                ya, yb = path[a, 1], path[a + n, 1]
                if max(ya, yb) < band_low or min(ya, yb) > band_high:
                    continue
                stamp_rows(
                    z,
                    tops,
                    x0,
                    y0,
                    cell,
                    floor,
                    first_block,
                    last_block,
                    path,
                    a,
                    n,
                    shape,
                    continued or a > 0,
                    book[a],
                    booked[worker, a : a + n],
                    totals[worker, a : a + n],
                    lane,
                    out,
                    minimiser,
                    stations,
                )


class Grid(NamedTuple):
    """A height map as the kernels see it: heights, block maxima, centre of cell [0, 0], cell side, bottom (m)."""

    z: Float32
    tops: Float32
    x0: float
    y0: float
    cell: float
    floor: float


class Workspace(NamedTuple):
    """Scratch arrays for :func:`stamp_segment`; one for each thread that stamps. Made by ``stamp_workspace``."""

    lane: Float32
    out: Int32
    minimiser: Float32
    stations: Float
    path: Float
    booked: Int
    totals: Int
    unit_width: Float


@kernel()
def stamp_segment(  # type: ignore[no-untyped-def]
    grid, shape, xa, ya, za, xb, yb, zb, continued, workspace, depth_out, extra_out
):
    """Cut one straight segment and say what it removed. For step-by-step loops inside other kernels.

    Args:
        grid: :class:`Grid` of the stock, cut in place.
        shape: ``Cutter.kernel_parameters()``.
        xa: Start of the tool tip, m, part frame; likewise ya, za.
        ya: See xa.
        za: See xa.
        xb: End of the tool tip, m, part frame; likewise yb, zb.
        yb: See xb.
        zb: See xb.
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
    stamp_rows(
        grid.z,
        grid.tops,
        grid.x0,
        grid.y0,
        grid.cell,
        grid.floor,
        0,
        grid.tops.shape[0],
        path,
        0,
        1,
        shape,
        continued,
        True,
        booked,
        totals,
        workspace.lane,
        workspace.out,
        workspace.minimiser,
        workspace.stations,
    )
    unit = QUANTUM_M * grid.cell * grid.cell
    length = math.hypot(xb - xa, yb - ya)
    levels = booked.shape[1]
    radii = 3 + levels
    for level in range(levels):
        for j in range(BINS):
            depth_out[level, j] = 0.0
            if booked[0, level, j] > 0 and length > 0.0:
                depth_out[level, j] = (
                    booked[0, level, j] * unit / (length * shape[radii + level] * workspace.unit_width[j])
                )
    extra_out[0] = totals[0, BOTTOM] * unit
    extra_out[1] = totals[0, AREA] * grid.cell * grid.cell
    return totals[0, VOLUME] * unit
