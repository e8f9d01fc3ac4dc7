"""Cutting force of a tool of any direction, from the chip that it really takes in columns of material, one kernel.

As :mod:`counterflex.twin.plant.chip`, with the edges about the tool's own axis u. The chip at height t above the tip
is the true displacement of that point of the tool over one tooth period along the outline's normal,

    h = (p(t0) - p(t0 - T) + t (u(t0) - u(t0 - T))) . n,

so a tool that turns cuts a thicker chip where it moves faster. The edges of the cylinder are walked in slices of
:data:`SLICE_M`; what of a slice stands in material is looked up in the columns, bilinear between their centres.
"""

from __future__ import annotations

import math
from typing import Final

from counterflex.core.arrays import Float, Float32
from counterflex.core.jit import kernel
from counterflex.core.units import MM
from counterflex.twin.plant.chip import OK, SHANK, STILL, add_edge, edge_load
from counterflex.twin.plant.turning.column_material import UInt8

SLICE_M: Final = 0.25 * MM
_SOFT_M: Final = 1.0e-6


@kernel()
def _filled(low: Float32, high: Float32, held: UInt8, j: int, i: int, bottom: float, top: float) -> float:
    """Share of the heights [bottom, top] that a column fills."""
    ny, nx = held.shape
    if j < 0 or i < 0 or j >= ny or i >= nx:
        return 0.0
    total = 0.0
    for k in range(held[j, i]):
        total += max(0.0, min(top, high[j, i, k]) - max(bottom, low[j, i, k]))
    return float(total / (top - bottom))


@kernel()
def filled(low: Float32, high: Float32, held: UInt8, grid: Float, x: float, y: float, z: float, half: float) -> float:
    """Share of material about a point, bilinear between columns; over the heights z - half to z + half, m."""
    fx, fy = (x - grid[0]) / grid[2], (y - grid[1]) / grid[2]
    ny, nx = held.shape
    if fx <= -1.0 or fy <= -1.0 or fx >= nx or fy >= ny:
        return 0.0
    i, j = math.floor(fx), math.floor(fy)
    u, v = fx - i, fy - j
    a, b = z - half, z + half
    near = (1.0 - u) * _filled(low, high, held, j, i, a, b) + u * _filled(low, high, held, j, i + 1, a, b)
    far = (1.0 - u) * _filled(low, high, held, j + 1, i, a, b) + u * _filled(low, high, held, j + 1, i + 1, a, b)
    return float((1.0 - v) * near + v * far)


@kernel()
def _side(
    low: Float32,
    high: Float32,
    held: UInt8,
    grid: Float,
    box: Float,
    x: float,
    y: float,
    z: float,
    u: Float,
    start: float,
    end: float,
) -> tuple[float, float]:
    """Length in material of the edge from height start to end, and the height of its middle, m."""
    # The edge runs along the axis through the point (x, y, z) at height 0; box (2,) m: no material is below or above.
    if u[2] > 1e-6:
        start, end = max(start, (box[0] - z) / u[2]), min(end, (box[1] - z) / u[2])
    elif u[2] < -1e-6:
        start, end = max(start, (box[1] - z) / u[2]), min(end, (box[0] - z) / u[2])
    elif z < box[0] or z > box[1]:
        return 0.0, 0.0
    if end <= start:
        return 0.0, 0.0
    count = max(1, math.ceil((end - start) / SLICE_M))
    step = (end - start) / count
    half = max(0.5 * step * abs(u[2]), _SOFT_M)
    length, moment = 0.0, 0.0
    for k in range(count):
        t = start + (k + 0.5) * step
        part = step * filled(low, high, held, grid, x + t * u[0], y + t * u[1], z + t * u[2], half)
        length += part
        moment += part * t
    return length, moment / length if length > 0.0 else 0.0


@kernel(
    "int64(float32[:, :, ::1], float32[:, :, ::1], uint8[:, ::1], float64[::1], float64[::1], "
    "float64[::1], float64[::1], float64[:, ::1], int64, float64, float64, float64[::1], float64[:, "
    "::1], float64[:, ::1], float64[:, ::1], float64[:, ::1], float64[::1], float64[::1], "
    "float64[::1], float64[::1], float64[::1])",
    entry=True,
)
def turned_wrench(
    low: Float32,
    high: Float32,
    held: UInt8,
    grid: Float,
    box: Float,
    p: Float,
    u: Float,
    history: Float,
    count: int,
    delay_steps: float,
    turns: float,
    shape: Float,
    rings: Float,
    rims: Float,
    faces: Float,
    circle: Float,
    radii: Float,
    law: Float,
    load: Float,
    own: Float,
    out: Float,
) -> int:
    """Mean cutting wrench on the tool now; arguments not named here as for :func:`.chip.cutting_wrench`.

    ``low``, ``high``: (ny, nx, 8) m, columns of material; ``held``: (ny, nx) how many. ``grid``: (3,) x0, y0, cell, m.
    ``box``: (2,) lowest and highest material, m. ``p``: (3,) m, tool tip in the part frame now. ``u``: (3,) tool axis
    from the tip to the spindle, part axes. ``history``: (HISTORY, 6) ring of tips and axes, one per step; now is at
    ``count``. ``turns``: as ``turning`` there. ``own``: (6,) workspace: force and moment in the tool's axes.

    Returns:
        OK, SHANK or STILL.
    """
    out[:] = 0.0
    own[:] = 0.0
    size = history.shape[0]
    for c in range(3):
        history[count % size, c], history[count % size, 3 + c] = p[c], u[c]
    back = min(delay_steps, float(count), size - 2.0)
    whole = int(back)
    part = back - whole
    a, b = (count - whole) % size, (count - min(whole + 1, count)) % size
    dx = p[0] - ((1.0 - part) * history[a, 0] + part * history[b, 0])
    dy = p[1] - ((1.0 - part) * history[a, 1] + part * history[b, 1])
    dz = p[2] - ((1.0 - part) * history[a, 2] + part * history[b, 2])
    tx = u[0] - ((1.0 - part) * history[a, 3] + part * history[b, 3])
    ty = u[1] - ((1.0 - part) * history[a, 4] + part * history[b, 4])
    tz = u[2] - ((1.0 - part) * history[a, 5] + part * history[b, 5])
    up = dx * u[0] + dy * u[1] + dz * u[2]
    # e square to the axis, then g = u x e: counter-clockwise seen from the spindle
    if abs(u[0]) < 0.9:
        ex, ey, ez = 1.0 - u[0] * u[0], -u[0] * u[1], -u[0] * u[2]
    else:
        ex, ey, ez = -u[1] * u[0], 1.0 - u[1] * u[1], -u[1] * u[2]
    norm = math.sqrt(ex * ex + ey * ey + ez * ez)
    ex, ey, ez = ex / norm, ey / norm, ez / norm
    gx, gy, gz = u[1] * ez - u[2] * ey, u[2] * ex - u[0] * ez, u[0] * ey - u[1] * ex
    radius, corner, flute = shape[0], shape[1], shape[2]
    status, share = OK, 1.0 / circle.shape[0]
    for i in range(circle.shape[0]):
        c, s = circle[i, 0], circle[i, 1]
        nx, ny, nz = c * ex + s * gx, c * ey + s * gy, c * ez + s * gz
        level, lever = dx * nx + dy * ny + dz * nz, tx * nx + ty * ny + tz * nz
        deepest = 0.0
        if level > 0.0 or level + flute * lever > 0.0:
            x, y, z = p[0] + radius * nx, p[1] + radius * ny, p[2] + radius * nz
            wide, middle = _side(low, high, held, grid, box, x, y, z, u, corner, flute)
            chip = level + middle * lever
            if wide > _SOFT_M and chip > 0.0:
                deepest = wide
                edge_load(chip, 1.0, radii, law, load)
                add_edge(own, load, share * wide, c, s, 1.0, 0.0, radius, middle, turns)
            t = flute + SLICE_M
            x, y, z = x + t * u[0], y + t * u[1], z + t * u[2]
            if level + t * lever > 0.0 and filled(low, high, held, grid, x, y, z, _SOFT_M) > 0.5:
                status = SHANK
        for k in range(faces.shape[0]):
            r, t, sk, ck = faces[k, 0], faces[k, 1], faces[k, 3], faces[k, 4]
            chip = (level + t * lever) * sk - up * ck
            if chip <= 0.0:
                continue
            tall = (rims[k + 1, 1] - rims[k, 1]) * u[2] + (rims[k + 1, 0] - rims[k, 0]) * nz
            half = max(0.5 * abs(tall), _SOFT_M)
            x, y = p[0] + r * nx + t * u[0], p[1] + r * ny + t * u[1]
            z = p[2] + r * nz + t * u[2] + _SOFT_M
            engaged = filled(low, high, held, grid, x, y, z, half)
            if engaged > 0.0:
                deepest += engaged * (rims[k + 1, 1] - rims[k, 1])
                edge_load(chip, sk, radii, law, load)
                add_edge(own, load, share * engaged * faces[k, 2], c, s, sk, ck, r, t, turns)
        if up < 0.0:
            half = max(-0.5 * up * abs(u[2]), _SOFT_M)
            for k in range(rings.shape[0]):
                r = rings[k, 0]
                x, y = p[0] + r * nx - 0.5 * up * u[0], p[1] + r * ny - 0.5 * up * u[1]
                engaged = filled(low, high, held, grid, x, y, p[2] + r * nz - 0.5 * up * u[2] + _SOFT_M, half)
                if engaged > 0.0:
                    deepest = max(deepest, -engaged * up)
                    edge_load(-up, 0.0, radii, law, load)
                    add_edge(own, load, share * engaged * rings[k, 1], c, s, 0.0, 1.0, r, 0.0, turns)
        out[6] = max(out[6], deepest)
    for k in (0, 3):
        out[k] = ex * own[k] + gx * own[k + 1] + u[0] * own[k + 2]
        out[k + 1] = ey * own[k] + gy * own[k + 1] + u[1] * own[k + 2]
        out[k + 2] = ez * own[k] + gz * own[k + 1] + u[2] * own[k + 2]
    if turns == 0.0 and out[6] > 0.0:
        status = STILL
    return status
