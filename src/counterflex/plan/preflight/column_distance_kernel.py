"""Kernel: signed distance of a convex body to the columns of a height map.

The distance to a convex body is a convex function along a column: where it falls towards the top its least is there,
else golden sections find it. It changes by no more than the way: blocks that are farther away than the least distance
so far and half their diagonal are left out.
"""

from __future__ import annotations

import math

from counterflex.core.arrays import Float, Float32
from counterflex.core.jit import kernel
from counterflex.cutting.stock import BLOCK_COLUMNS, BLOCK_ROWS

BOX = 0
CAPSULE = 1
CYLINDER = 2
MESH = 3
GOLDEN = 0.6180339887498949
STEP_M = 1e-5
STEPS = 20
"""Golden sections of a column: its closest height is known to 1e-4 of its length, the distance to the square of it."""


@kernel("float64(int64, float64[::1], float64[:, ::1], float64, float64, float64)")
def body_distance(shape: int, size: Float, planes: Float, x: float, y: float, z: float) -> float:
    """Signed distance of a point in the frame of a body, negative inside; outside of a mesh at most the true one."""
    if shape == MESH:
        most = -math.inf
        for k in range(planes.shape[0]):
            most = max(most, planes[k, 0] * x + planes[k, 1] * y + planes[k, 2] * z + planes[k, 3])
        return most
    if shape == BOX:
        a, b, c = abs(x) - size[0], abs(y) - size[1], abs(z) - size[2]
        outside = math.sqrt(max(a, 0.0) ** 2 + max(b, 0.0) ** 2 + max(c, 0.0) ** 2)
        return float(outside + min(max(a, max(b, c)), 0.0))
    side, along = math.hypot(x, y), abs(z) - size[1]
    if shape == CAPSULE:
        return float(math.hypot(side, max(along, 0.0)) - size[0])
    side -= size[0]
    return float(math.hypot(max(side, 0.0), max(along, 0.0)) + min(max(side, along), 0.0))


@kernel("float64(int64, float64[::1], float64[:, ::1], float64[::1], float64[::1], float64, float64)")
def column_distance(shape: int, size: Float, planes: Float, foot: Float, up: Float, low: float, high: float) -> float:
    """Signed distance of a body to the upright line from ``foot + low up`` to ``foot + high up``, in its frame."""
    top = body_distance(shape, size, planes, foot[0] + high * up[0], foot[1] + high * up[1], foot[2] + high * up[2])
    z = max(low, high - STEP_M)
    if body_distance(shape, size, planes, foot[0] + z * up[0], foot[1] + z * up[1], foot[2] + z * up[2]) >= top:
        return top  # convex, and falling towards the top: the body is above the column
    best = min(top, body_distance(shape, size, planes, foot[0] + low * up[0], foot[1] + low * up[1],
                                  foot[2] + low * up[2]))  # fmt: skip
    a, b = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
    at_a = body_distance(shape, size, planes, foot[0] + a * up[0], foot[1] + a * up[1], foot[2] + a * up[2])
    at_b = body_distance(shape, size, planes, foot[0] + b * up[0], foot[1] + b * up[1], foot[2] + b * up[2])
    for _ in range(STEPS):
        if at_a < at_b:
            high, b, at_b = b, a, at_a
            a = high - GOLDEN * (high - low)
            at_a = body_distance(shape, size, planes, foot[0] + a * up[0], foot[1] + a * up[1], foot[2] + a * up[2])
        else:
            low, a, at_a = a, b, at_b
            b = low + GOLDEN * (high - low)
            at_b = body_distance(shape, size, planes, foot[0] + b * up[0], foot[1] + b * up[1], foot[2] + b * up[2])
    return min(best, min(at_a, at_b))


@kernel(
    "float64(int64, float64[::1], float64[:, ::1], float64[:, ::1], float32[:, ::1], float64[::1], float64[::1], "
    "int64, int64, float64)"
)
def block_distance(
    shape: int,
    size: Float,
    planes: Float,
    T_stock_body: Float,
    z: Float32,
    grid: Float,
    foot: Float,
    block_j: int,
    block_i: int,
    most: float,
) -> float:
    """Signed distance of a body to the columns of one block, m, at most ``most``; see :func:`stock_distance`."""
    x0, y0, cell, bottom = grid[0], grid[1], grid[2], grid[3]
    ny, nx = z.shape
    up = T_stock_body[2, :3].copy()
    best = most
    i_low = min(block_i * BLOCK_COLUMNS, nx - BLOCK_COLUMNS)
    for j in range(block_j * BLOCK_ROWS, min((block_j + 1) * BLOCK_ROWS, ny)):
        for i in range(i_low, i_low + BLOCK_COLUMNS):
            high = float(z[j, i])
            if high <= bottom + 1e-9:
                continue
            dx, dy = x0 + i * cell - T_stock_body[0, 3], y0 + j * cell - T_stock_body[1, 3]
            for k in range(3):
                foot[k] = T_stock_body[0, k] * dx + T_stock_body[1, k] * dy - T_stock_body[2, k] * T_stock_body[2, 3]
            best = min(best, column_distance(shape, size, planes, foot, up, bottom, high))
    return best


@kernel(
    "float64(int64, float64[::1], float64[:, ::1], float64[:, ::1], float32[:, ::1], float32[:, ::1], float64[::1], "
    "float64[::1], float64)",
    entry=True,
)
def stock_distance(
    shape: int,
    size: Float,
    planes: Float,
    T_stock_body: Float,
    z: Float32,
    tops: Float32,
    grid: Float,
    foot: Float,
    most: float,
) -> float:
    """Signed distance of a body to a height map, m; ``most`` where it is farther away.

    Args:
        shape: One of the constants of this module.
        size: (3,) as of :class:`~counterflex.plan.preflight.bodies.CollisionBody`.
        planes: (f, 4) of a mesh.
        T_stock_body: (4, 4) pose of the body in the frame of the map.
        z: (ny, nx) tops of the columns.
        tops: Highest column of each block.
        grid: x0, y0, side of a column, bottom.
        foot: (3,) room for a point.
        most: Distances from here on need not be told apart.
    """
    x0, y0, cell, bottom = grid[0], grid[1], grid[2], grid[3]
    nx = z.shape[1]
    up = T_stock_body[2, :3].copy()
    radius = math.sqrt(size[0] ** 2 + size[1] ** 2 + size[2] ** 2) + (size[0] if shape == CAPSULE else 0.0)
    half = 0.5 * cell * math.hypot(float(BLOCK_ROWS), float(BLOCK_COLUMNS))
    best, first_j, first_i = most, -1, -1
    least = math.inf
    for seek in (True, False):  # first the block that seems nearest, so that most others can be left out
        if not seek and first_j >= 0:
            best = block_distance(shape, size, planes, T_stock_body, z, grid, foot, first_j, first_i, best)
        for block_j in range(tops.shape[0]):
            dy = y0 + (block_j * BLOCK_ROWS + 0.5 * (BLOCK_ROWS - 1)) * cell - T_stock_body[1, 3]
            if abs(dy) - half - radius >= best:
                continue
            for block_i in range(tops.shape[1]):
                i_low = min(block_i * BLOCK_COLUMNS, nx - BLOCK_COLUMNS)
                dx = x0 + (i_low + 0.5 * (BLOCK_COLUMNS - 1)) * cell - T_stock_body[0, 3]
                top = float(tops[block_j, block_i])
                if top <= bottom + 1e-9 or abs(dx) - half - radius >= best:
                    continue
                for k in range(3):
                    foot[k] = (
                        T_stock_body[0, k] * dx + T_stock_body[1, k] * dy - T_stock_body[2, k] * T_stock_body[2, 3]
                    )
                bound = column_distance(shape, size, planes, foot, up, bottom, top) - half
                if bound >= best:
                    continue
                if not seek:
                    best = block_distance(shape, size, planes, T_stock_body, z, grid, foot, block_j, block_i, best)
                elif bound < least:
                    least, first_j, first_i = bound, block_j, block_i
    return best
