"""Kernels: where lines of a lattice leave the material, exactly along x and y, and distances of points to what was cut.

Columns say which nodes of the lattice hold material; only between two neighbours of which one does and the other does
not is an end looked for. Motions are listed by tiles of the xy plane, so that a line or a point looks only at those
whose sweep comes near.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np

from counterflex.core.arrays import Bool, Float, Float2, Int, Int1
from counterflex.core.jit import bundle, kernel
from counterflex.cutting.tridexel.column_block_kernels import COLUMNS, Columns
from counterflex.cutting.tridexel.swept_solid import depth_at, distance, stretch
from counterflex.cutting.tridexel.turning_line_kernels import MISSED, turning_end

Whole = Any
_FAR: Final = 1.0e30
_FAR_LEVEL: Final = 1 << 62
_SAME_M: Final = 1.0e-12


GROUP: Final = 16
"""Motions that follow one another and are looked at together first."""


class Tiles(NamedTuple):
    """Motions (k, 12), the shape of the tool of each (k, 3), boxes about their sweeps (k, 6), and groups by tile.

    Sixteen motions that follow one another are a group, with a box about their sweeps and one about their tips (g, 12).
    ``members[first[t] : first[t + 1]]`` are the groups near tile ``t = row * columns + column``; tile [0, 0] begins
    at (x0, y0) and has the given side. ``ceiling`` is the height up to which sections of every sweep only grow, which
    is so for upright tools below their tops; minus infinity where a tool is tilted.
    """

    motions: Float2
    shapes: Float2
    boxes: Float2
    groups: Float2
    first: Int1
    members: Int1
    x0: float
    y0: float
    side: float
    columns: int
    ceiling: float


TILES: Final = bundle(Tiles)


@kernel("void(int64[:, ::1], int64, int64[::1])", entry=True)
def count_members(ranges: Int, columns: Whole, count: Int) -> None:
    """Count the groups of each tile; ranges (g, 4) first and last tile in x and y."""
    for k in range(len(ranges)):
        for row in range(ranges[k, 2], ranges[k, 3] + 1):
            for column in range(ranges[k, 0], ranges[k, 1] + 1):
                count[row * columns + column] += 1


@kernel("void(int64[:, ::1], int64, int64[::1], int64[::1])", entry=True)
def fill_members(ranges: Int, columns: Whole, place: Int, members: Int) -> None:
    """List the groups of each tile; place is where each list begins, and is moved to its end."""
    for k in range(len(ranges)):
        for row in range(ranges[k, 2], ranges[k, 3] + 1):
            for column in range(ranges[k, 0], ranges[k, 1] + 1):
                tile = row * columns + column
                members[place[tile]] = k
                place[tile] += 1


@kernel()
def _gap(box: Float, x: float, y: float, z: float) -> float:
    """Distance of a point from a box along the axis on which it is farthest; negative inside."""
    return float(max(box[0] - x, x - box[3], box[1] - y, y - box[4], box[2] - z, z - box[5]))


@kernel()
def tile_of(tiles: Tiles, x: float, y: float) -> int:
    """Number of the tile that holds a point, or of the nearest one."""
    rows = (len(tiles.first) - 1) // tiles.columns
    column = min(max(int((x - tiles.x0) / tiles.side), 0), tiles.columns - 1)
    row = min(max(int((y - tiles.y0) / tiles.side), 0), rows - 1)
    return row * tiles.columns + column


@kernel()
def _runs(columns: Columns, j: Whole, i: Whole, z0: float, pitch: float, runs: Int) -> int:
    """Levels (8, 2) first and past the last that a column holds, runs without a level between them joined; how many."""
    ny, nx = columns.held.shape
    if i < 0 or j < 0 or i >= nx or j >= ny:
        return 0
    n = 0
    for k in range(columns.held[j, i]):
        first = math.floor((columns.low[k, j, i] - z0) / pitch) + 1
        past = math.ceil((columns.high[k, j, i] - z0) / pitch)
        if past <= first:
            continue
        if n > 0 and first <= runs[n - 1, 1]:
            runs[n - 1, 1] = past
        else:
            runs[n, 0], runs[n, 1] = first, past
            n += 1
    return n


@kernel()
def _alike(columns: Columns, j: Whole, i: Whole, j2: Whole, i2: Whole) -> bool:
    """Return whether two columns hold the same single stretch or nothing."""
    n = columns.held[j, i]
    if n > 1 or n != columns.held[j2, i2]:
        return False
    low, high = columns.low, columns.high
    return bool(n == 0 or (low[0, j, i] == low[0, j2, i2] and high[0, j, i] == high[0, j2, i2]))


@kernel()
def _holds(runs: Int, n: int, level: int) -> bool:
    for k in range(n):  # noqa: SIM110 - kernels have no generators
        if runs[k, 0] <= level < runs[k, 1]:
            return True
    return False


@kernel("int64(Columns, int64, int64, float64, float64, int64[:, ::1], boolean[::1])", entry=True, Columns=COLUMNS)
def edges_across(columns: Columns, along: Whole, outer: Whole, z0: float, pitch: float, edge: Int, filled: Bool) -> int:
    """Edges of the lattice along x (0) or y (1) with material at one end only; returns how many there are.

    The lattice has one node more than the columns on every side, and level k at ``z0 + pitch k``.

    Args:
        along: 0 or 1.
        outer: 1 for the edges that lead out of the columns too, 0 for those between two columns only.
        z0: m.
        pitch: m.
        edge: (m, 3) receives level, row and column of the lower node; nothing is written beyond its end.
        filled: (m,) receives whether the lower node is the one in material.
    """
    ny, nx = columns.held.shape
    layers = columns.low.shape[0]
    one, two = np.empty((layers, 2), np.int64), np.empty((layers, 2), np.int64)
    right, up = (1, 0) if along == 0 else (0, 1)
    count = 0
    for j in range(-up * outer, ny - up * (1 - outer)):
        for i in range(-right * outer, nx - right * (1 - outer)):
            if i >= 0 and j >= 0 and i + right < nx and j + up < ny and _alike(columns, j, i, j + up, i + right):
                continue
            a, b = _runs(columns, j, i, z0, pitch, one), _runs(columns, j + up, i + right, z0, pitch, two)
            if a == 0 and b == 0:
                continue
            low, high = _FAR_LEVEL, 0
            if a == 1 and b == 1:  # the usual: only what is between the two upper or the two lower ends
                if one[0, 0] == two[0, 0]:
                    low, high = min(one[0, 1], two[0, 1]), max(one[0, 1], two[0, 1])
                else:
                    low, high = min(one[0, 0], two[0, 0]), max(one[0, 1], two[0, 1])
            else:
                for k in range(a):
                    low, high = min(low, one[k, 0]), max(high, one[k, 1])
                for k in range(b):
                    low, high = min(low, two[k, 0]), max(high, two[k, 1])
            for level in range(low, high):
                inside = _holds(one, a, level)
                if inside != _holds(two, b, level):
                    if count < len(edge):
                        edge[count, 0], edge[count, 1], edge[count, 2] = level, j + 1, i + 1
                        filled[count] = inside
                    count += 1
    return count


@kernel("int64(Columns, float64, float64, int64[:, ::1], boolean[::1], float64[::1])", entry=True, Columns=COLUMNS)
def edges_up(columns: Columns, z0: float, pitch: float, edge: Int, filled: Bool, z: Float) -> int:
    """Edges of the lattice along z, as :func:`edges_across`; z (m,) receives where material ends. Returns how many."""
    ny, nx = columns.held.shape
    runs = np.empty((columns.low.shape[0], 2), np.int64)
    count = 0
    for j in range(ny):
        for i in range(nx):
            n = _runs(columns, j, i, z0, pitch, runs)
            for k in range(n):
                for side in range(2):
                    if count < len(edge):
                        edge[count, 0], edge[count, 1], edge[count, 2] = runs[k, side] - 1, j + 1, i + 1
                        filled[count] = side == 1
                        best, end = _FAR, 0.0  # of several between two levels the one next to the material
                        node = z0 + pitch * (runs[k, 0] if side == 0 else runs[k, 1] - 1)
                        for m in range(columns.held[j, i]):
                            at = float(columns.low[m, j, i] if side == 0 else columns.high[m, j, i])
                            away = node - at if side == 0 else at - node
                            if -1e-9 <= away < best:
                                best, end = away, at
                        z[count] = end
                    count += 1
    return count


@kernel()
def _section(shape: Float, height: float) -> float:
    """Radius of a cutter at a height above its tip, m, the largest up to there."""
    radius, corner = shape[0], shape[1]
    if height < corner:
        down = corner - max(height, 0.0)
        return float(radius - corner + math.sqrt(corner * corner - down * down))
    return float(radius)


@kernel()
def _clear_of(x: float, y: float, z: float, half: float, motion: Float, shape: Float) -> bool:
    """Return whether the sweep of a motion certainly misses all within half of a point (from the start of the tip)."""
    ux, uy, uz = motion[6], motion[7], motion[8]
    vx, vy, vz = motion[3], motion[4], motion[5]
    h, climb = x * ux + y * uy + z * uz, vx * ux + vy * uy + vz * uz
    turn = math.sqrt(motion[9] * motion[9] + motion[10] * motion[10] + motion[11] * motion[11])
    if turn > 0.0:  # what the axis turns through to either side of its middle
        half += 0.5 * turn * (abs(h) + abs(climb) + half + shape[0])
    height = max(h, h - climb) + half
    if height < 0.0:
        return True
    radius = _section(shape, height)
    rx, ry, rz = x - h * ux, y - h * uy, z - h * uz
    sx, sy, sz = vx - climb * ux, vy - climb * uy, vz - climb * uz
    size = sx * sx + sy * sy + sz * sz
    s = 0.0 if size <= 0.0 else min(1.0, max(0.0, (rx * sx + ry * sy + rz * sz) / size))
    rx, ry, rz = rx - s * sx, ry - s * sy, rz - s * sz
    reach = radius + half
    return bool(rx * rx + ry * ry + rz * rz > reach * reach)


@kernel()
def _group_clear_of(x: float, y: float, z: float, half: float, tiles: Tiles, group: int) -> bool:
    """Return whether all motions of a group certainly miss a line of length 2 half about a point along x or y."""
    box = tiles.groups[group]
    if x - half > box[3] or x + half < box[0] or y - half > box[4] or y + half < box[1] or z > box[5] or z < box[2]:
        return True
    if tiles.ceiling == -np.inf:
        return False
    radius, height = 0.0, z - box[8]
    for k in range(group * GROUP, min(len(tiles.motions), (group + 1) * GROUP)):
        radius = max(radius, _section(tiles.shapes[k], height))
    dx, dy = max(0.0, box[6] - x, x - box[9]), max(0.0, box[7] - y, y - box[10])
    return bool(dx * dx + dy * dy > (radius + half) * (radius + half))


@kernel()
def _end_on_line(
    tiles: Tiles, along: Whole, x: float, y: float, z: float, length: float, filled: bool, q: Float
) -> float:
    """End of material on one edge from the lower node (x, y, z), m; beyond 1e30 where nothing was cut."""
    best, half = _FAR if filled else -_FAR, 0.5 * length
    x_mid, y_mid = (x + half, y) if along == 0 else (x, y + half)
    tile = tile_of(tiles, x_mid, y_mid)
    for place in range(tiles.first[tile], tiles.first[tile + 1]):
        group = tiles.members[place]
        if _group_clear_of(x_mid, y_mid, z, half, tiles, group):
            continue
        for k in range(group * GROUP, min(len(tiles.motions), (group + 1) * GROUP)):
            motion, shape = tiles.motions[k], tiles.shapes[k]
            if _clear_of(x_mid - motion[0], y_mid - motion[1], z - motion[2], half, motion, shape):
                continue
            q[0], q[1], q[2] = x - motion[0], y - motion[1], z - motion[2]
            if motion[9] != 0.0 or motion[10] != 0.0 or motion[11] != 0.0:
                low = turning_end(q, along, motion, shape, length, filled)
                if low != MISSED:
                    best = min(best, low) if filled else max(best, low)
                continue
            low, high = stretch(q, along, motion, shape)
            if high <= low or high < 0.0 or low > length:
                continue
            best = min(best, low) if filled else max(best, high)
    return best


@kernel()
def _run_of_levels(tiles: Tiles, start: Float, filled: Bool, first: int) -> int:
    """Past the last of the edges from the first that stand one above the other where sections only grow."""
    past = first + 1
    while (
        past < len(start)
        and start[past, 0] == start[first, 0]
        and start[past, 1] == start[first, 1]
        and filled[past] == filled[first]
        and start[past, 2] <= tiles.ceiling
    ):
        past += 1
    return past


@kernel("void(Tiles, int64, float64[:, ::1], float64, boolean[::1], float64[::1])", entry=True, Tiles=TILES)
def ends_on_lines(tiles: Tiles, along: Whole, start: Float, length: float, filled: Bool, ends: Float) -> None:
    """Ends of material between two nodes of the lattice, one in material and one out of it.

    Where sections only grow with height an end moves one way only from level to level: between two levels with the same
    end, all have it. So a wall is worked out at its foot and its top, however many levels it has.

    Args:
        along: 0 or 1: lines along x or y.
        start: (n, 3) m, the lower node; rising levels of one column follow one another.
        length: To the upper node, m.
        filled: (n,) whether the lower node is the one in material.
        ends: (n,) receives the distance from the lower node, m; nan where nothing was cut between the two.
    """
    q, stack = np.empty(3), np.empty((64, 2), np.int64)
    n = 0
    while n < len(start):
        past = _run_of_levels(tiles, start, filled, n)
        for k in (n, past - 1):
            ends[k] = _end_on_line(tiles, along, start[k, 0], start[k, 1], start[k, 2], length, filled[k], q)
        stack[0, 0], stack[0, 1] = n, past - 1
        depth = 1
        while depth > 0:
            depth -= 1
            low, high = stack[depth, 0], stack[depth, 1]
            if high - low < 2:
                continue
            if abs(ends[high] - ends[low]) <= _SAME_M:
                for k in range(low + 1, high):
                    ends[k] = ends[low]
                continue
            k = (low + high) // 2
            ends[k] = _end_on_line(tiles, along, start[k, 0], start[k, 1], start[k, 2], length, filled[k], q)
            stack[depth, 0], stack[depth, 1] = low, k
            stack[depth + 1, 0], stack[depth + 1, 1] = k, high
            depth += 2
        for k in range(n, past):
            if abs(ends[k]) >= _FAR:
                ends[k] = np.nan
        n = past


@kernel()
def _least_possible(x: float, y: float, z: float, motion: Float, shape: Float) -> float:
    """Lower bound of the distance of a point (from the tip's start) to a sweep: that in the middle, less the way."""
    # In the tool's frame a point goes by at most `(|v| + turn |p - tip|) / 2` from there to either end.
    way = math.sqrt(motion[3] * motion[3] + motion[4] * motion[4] + motion[5] * motion[5])
    turn = math.sqrt(motion[9] * motion[9] + motion[10] * motion[10] + motion[11] * motion[11])
    away = math.sqrt(x * x + y * y + z * z) + way
    return float(depth_at(x, y, z, 0.5, motion, shape) - 0.5 * (way + turn * away))


@kernel("void(Tiles, float64[:, ::1], float64, float64[::1])", entry=True, Tiles=TILES)
def distances(tiles: Tiles, points: Float, reach: float, out: Float) -> None:
    """Signed distance (n,) m of points (n, 3) to what was cut: negative inside; nan where it is more than reach."""
    for n in range(len(points)):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        best = _FAR
        tile = tile_of(tiles, x, y)
        for place in range(tiles.first[tile], tiles.first[tile + 1]):
            group = tiles.members[place]
            if _gap(tiles.groups[group], x, y, z) > min(best, reach):
                continue
            for k in range(group * GROUP, min(len(tiles.motions), (group + 1) * GROUP)):
                if _gap(tiles.boxes[k], x, y, z) > min(best, reach):
                    continue
                motion = tiles.motions[k]
                if _least_possible(x - motion[0], y - motion[1], z - motion[2], motion, tiles.shapes[k]) >= best:
                    continue
                size, _ = distance(x - motion[0], y - motion[1], z - motion[2], motion, tiles.shapes[k])
                best = min(best, size)
        out[n] = best if math.fabs(best) <= reach else np.nan
