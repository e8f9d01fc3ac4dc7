"""Cutting force of the tool where it really is, from the chip it really takes, one kernel.

The edges are sampled at fixed angles about the tool axis and, on rounded corners and the end face, at slices of the
outline. Each sample looks up the stock there: what stands above it is engaged. The chip thickness is the tool's true
displacement over one tooth period projected on the outline's normal, ``h = (p(t) - p(t - T)) . n``; so feed,
vibration and the wave left by the previous tooth enter together. The force per edge length follows
:class:`~counterflex.twin.truth.truth.CuttingTruth`; its mean over a revolution is returned, which is what a robot
with modes far below the tooth passing frequency responds to.

The tool axis is taken along part z: the elastic tilt of some mrad moves the chip by micrometres only.
"""

from __future__ import annotations

import math

import numpy as np

from counterflex.core.arrays import Float, Float32
from counterflex.core.jit import kernel

ANGLES = 96
HISTORY = 4096  # steps of remembered tool positions
CORNER_SLICES = 12
END_RINGS = 4
_SOFT_M = 1.0e-6  # material that stands less above the outline is what the tool has just left

OK, SHANK, STILL = 0, 1, 2  # what the kernel found: fine; cut above the flutes; cut with the spindle off


@kernel()
def stock_height(z: Float32, x0: float, y0: float, cell: float, bottom: float, x: float, y: float) -> float:
    """Bilinear height of the stock at a point, m; what lies outside the map counts as the bottom."""
    fx, fy = (x - x0) / cell, (y - y0) / cell
    ny, nx = z.shape
    if fx <= -1.0 or fy <= -1.0 or fx >= nx or fy >= ny:
        return bottom
    i, j = math.floor(fx), math.floor(fy)
    u, v = fx - i, fy - j
    inside_i, inside_i1 = i >= 0, i + 1 < nx
    z00 = z[j, i] if j >= 0 and inside_i else bottom
    z01 = z[j, i + 1] if j >= 0 and inside_i1 else bottom
    z10 = z[j + 1, i] if j + 1 < ny and inside_i else bottom
    z11 = z[j + 1, i + 1] if j + 1 < ny and inside_i1 else bottom
    return (1.0 - v) * ((1.0 - u) * z00 + u * z01) + v * ((1.0 - u) * z10 + u * z11)


@kernel()
def edge_load(h: float, sin_kappa: float, radii: Float, law: Float, out: Float) -> None:
    """Sum over the teeth of the force per edge length at chip thickness h, N/m.

    Tooth j is ``radii[j]`` off the nominal radius and takes what the k teeth before it have left:
    ``h_j = max(0, min_k (k h + (r_j - r_(j-k)) sin kappa))``.

    Args:
        h: Displacement over one tooth period along the outline's normal, m, > 0.
        sin_kappa: 1 on the cylinder, 0 on the end face.
        radii: (teeth,) m, runout.
        law: (10,) ``k h_ref^m`` of c r a, exponents ``1 - m``, ploughing, its onset.
        out: (3,) set to c, r, a.
    """
    out[:] = 0.0
    teeth = radii.shape[0]
    uneven = radii[0] != 0.0 and sin_kappa != 0.0
    for j in range(teeth if uneven else 1):
        chip = h
        if uneven:
            chip = teeth * h
            for k in range(1, teeth):
                chip = min(chip, k * h + (radii[j] - radii[j - k]) * sin_kappa)
            if chip <= 0.0:
                continue
        logarithm = math.log(chip)
        plough = 1.0 - math.exp(-chip / law[9])
        for c in range(3):
            out[c] += law[c] * math.exp(law[3 + c] * logarithm) + law[6 + c] * plough
    if not uneven:
        for c in range(3):
            out[c] *= teeth


@kernel()
def add_edge(
    out: Float,
    load: Float,
    weight: float,
    nx: float,
    ny: float,
    sk: float,
    ck: float,
    r: float,
    up: float,
    turning: float,
) -> None:
    """Add the force of one edge element and its moment about the tip; normal (sk nx, sk ny, -ck), at radius r."""
    inward = weight * (load[1] * sk + load[2] * ck)
    fx = -weight * load[0] * turning * ny - inward * nx
    fy = weight * load[0] * turning * nx - inward * ny
    fz = weight * (load[1] * ck - load[2] * sk)
    out[0] += fx
    out[1] += fy
    out[2] += fz
    out[3] += r * ny * fz - up * fy
    out[4] += up * fx - r * nx * fz
    out[5] += r * (nx * fy - ny * fx)


@kernel()
def cutting_wrench(
    z: Float32,
    grid: Float,
    p_part: Float,
    history: Float,
    count: int,
    delay_steps: float,
    turning: float,
    shape: Float,
    rings: Float,
    rims: Float,
    faces: Float,
    circle: Float,
    radii: Float,
    law: Float,
    load: Float,
    out: Float,
) -> int:
    """Mean cutting wrench on the tool now.

    Args:
        z: (ny, nx) m, height map.
        grid: (4,) x0, y0, cell, bottom of it, m.
        p_part: (3,) m, tool tip in the part frame now.
        history: (HISTORY, 3) ring of tip positions, one per step; now is written at ``count``.
        count: Number of steps since the start.
        delay_steps: Tooth period in steps.
        turning: +1 clockwise seen from the spindle, -1 counter-clockwise, 0 standing still.
        shape: (3,) tool radius, corner radius, flute length, m.
        rings: (n, 2) radius and edge length of the rings of the end face, m.
        rims: (K + 1, 2) radius and height of the rims between the slices of the corner, m; (1, 2) without corner.
        faces: (K, 5) radius, height, edge length, sin kappa, cos kappa of the slices.
        circle: (ANGLES, 2) cosine and sine of the sampled angles.
        radii: (teeth,) m.
        law: (10,) see :func:`edge_load`.
        load: (3,) workspace.
        out: (7,) set to force N and moment N m about the tip in part axes, and the largest engaged axial depth m.

    Returns:
        OK, SHANK or STILL.
    """
    out[:] = 0.0
    size = history.shape[0]
    now = count % size
    for c in range(3):
        history[now, c] = p_part[c]
    back = min(delay_steps, float(count), size - 2.0)
    whole = int(back)
    part = back - whole
    a, b = (count - whole) % size, (count - min(whole + 1, count)) % size
    dx = p_part[0] - ((1.0 - part) * history[a, 0] + part * history[b, 0])
    dy = p_part[1] - ((1.0 - part) * history[a, 1] + part * history[b, 1])
    dz = p_part[2] - ((1.0 - part) * history[a, 2] + part * history[b, 2])
    radius, corner, flute = shape[0], shape[1], shape[2]
    x0, y0, cell, bottom = grid[0], grid[1], grid[2], grid[3]
    px, py, pz = p_part[0], p_part[1], p_part[2]
    status = OK
    share = 1.0 / circle.shape[0]
    for i in range(circle.shape[0]):
        nx, ny = circle[i, 0], circle[i, 1]
        level = dx * nx + dy * ny
        if level > 0.0:
            depth = stock_height(z, x0, y0, cell, bottom, px + radius * nx, py + radius * ny) - pz
            if depth > 0.0:
                out[6] = max(out[6], depth)
                if depth > flute:
                    status = SHANK
            wide = min(depth, flute) - corner
            if wide > 0.0:
                edge_load(level, 1.0, radii, law, load)
                add_edge(out, load, share * wide, nx, ny, 1.0, 0.0, radius, corner + 0.5 * wide, turning)
        if faces.shape[0] > 0 and level > min(0.0, dz):
            below = stock_height(z, x0, y0, cell, bottom, px + rims[0, 0] * nx, py + rims[0, 0] * ny)
            below -= pz + rims[0, 1] + _SOFT_M
            for s in range(faces.shape[0]):
                r = rims[s + 1, 0]
                above = stock_height(z, x0, y0, cell, bottom, px + r * nx, py + r * ny) - pz - rims[s + 1, 1] - _SOFT_M
                sk, ck = faces[s, 3], faces[s, 4]
                h = level * sk - dz * ck
                if h > 0.0 and (below > 0.0 or above > 0.0):
                    engaged = 1.0
                    if below <= 0.0 or above <= 0.0:
                        engaged = max(below, above) / (max(below, above) - min(below, above))
                    out[6] = max(out[6], max(below + rims[s, 1], above + rims[s + 1, 1]))
                    edge_load(h, sk, radii, law, load)
                    add_edge(
                        out, load, share * engaged * faces[s, 2], nx, ny, sk, ck, faces[s, 0], faces[s, 1], turning
                    )
                below = above
        if dz < 0.0:
            for s in range(rings.shape[0]):
                r = rings[s, 0]
                standing = stock_height(z, x0, y0, cell, bottom, px + r * nx, py + r * ny) - pz
                if standing > 0.0:
                    out[6] = max(out[6], standing)
                    edge_load(min(-dz, standing), 0.0, radii, law, load)  # at first contact no more than stands there
                    add_edge(out, load, share * rings[s, 1], nx, ny, 0.0, 1.0, r, 0.0, turning)
    if turning == 0.0 and (out[0] != 0.0 or out[1] != 0.0 or out[2] != 0.0):
        status = STILL
    return status


@kernel(
    "void(float32[:, ::1], float64[::1], float64, float64, float64, float64, float64, float64, float64[::1])",
    entry=True,
)
def cut(
    z: Float32, grid: Float, ax: float, ay: float, az: float, bx: float, by: float, bz: float, shape: Float
) -> None:
    """Lower the stock along a short straight stretch of the tool tip, part frame.

    Each cell takes the lowest outline of the tool at the start, at the end and at the point of the stretch nearest to
    the cell; for a flat tool at the ends of its overlap. Exact for level and vertical stretches and for flat tools; on
    slopes with rounded tools high by less than ``slope^2 length / 2``, nanometres for the steps of a simulation.

    Args:
        z: (ny, nx) m, lowered in place.
        grid: (4,) x0, y0, cell, bottom, m.
        ax: Start of the stretch, m.
        ay: Same, y.
        az: Same, z.
        bx: End, m.
        by: Same, y.
        bz: Same, z.
        shape: (3,) tool radius, corner radius, flute length, m.
    """
    radius, corner = shape[0], shape[1]
    inner = radius - corner
    x0, y0, cell, bottom = grid[0], grid[1], grid[2], grid[3]
    ny, nx = z.shape
    length = math.hypot(bx - ax, by - ay)
    ux, uy = 1.0, 0.0
    if length > 1e-12:
        ux, uy = (bx - ax) / length, (by - ay) / length
    slope = (bz - az) / length if length > 1e-12 else 0.0
    lowest = min(az, bz)
    start = az if length > 1e-12 else lowest
    j0 = max(0, math.ceil((min(ay, by) - radius - y0) / cell))
    j1 = min(ny - 1, math.floor((max(ay, by) + radius - y0) / cell))
    i0 = max(0, math.ceil((min(ax, bx) - radius - x0) / cell))
    i1 = min(nx - 1, math.floor((max(ax, bx) + radius - x0) / cell))
    for j in range(j0, j1 + 1):
        ry = y0 + j * cell - ay
        for i in range(i0, i1 + 1):
            old = z[j, i]
            if old <= lowest:
                continue
            rx = x0 + i * cell - ax
            s, w = rx * ux + ry * uy, ry * ux - rx * uy
            under = radius * radius - w * w
            if under < 0.0:
                continue
            q = math.sqrt(under)
            t_in, t_out = max(0.0, s - q), min(length, s + q)
            if t_in > t_out:
                continue
            if corner == 0.0:
                low = start + slope * (t_out if slope < 0.0 else t_in)
            else:
                low = 1.0e30
                for trial in range(3):
                    t = min(max(s, t_in), t_out) if trial == 0 else (t_in if trial == 1 else t_out)
                    v = max(math.hypot(s - t, w) - inner, 0.0)
                    low = min(low, start + slope * t + corner - math.sqrt(max(corner * corner - v * v, 0.0)))
            z[j, i] = min(old, np.float32(max(low, bottom)))


@kernel(
    "int64(float32[:, ::1], float64[::1], float64[::1], float64[:, ::1], float64[:, ::1], int64, "
    "float64, float64, float64[::1], float64[:, ::1], float64[:, ::1], float64[:, ::1], float64[:, "
    "::1], float64[::1], float64[::1], float64[::1], float64[::1], float64[::1], float64[::1], "
    "float64[::1])",
    entry=True,
)
def coupled_wrench(
    z: Float32,
    grid: Float,
    p_base_tcp: Float,
    T_base_part: Float,
    history: Float,
    count: int,
    delay_steps: float,
    turning: float,
    shape: Float,
    rings: Float,
    rims: Float,
    faces: Float,
    circle: Float,
    radii: Float,
    law: Float,
    load: Float,
    p_part: Float,
    out: Float,
    w_tcp_base: Float,
    sums: Float,
) -> int:
    """:func:`cutting_wrench` for a tool given in base coordinates, the result in base axes, with running sums.

    ``p_base_tcp``: (3,) m. ``T_base_part``: (4, 4) where the part truly lies. ``p_part``: (3,) m, set to the tip in the
    part frame. ``out``: (7,) set, in part axes. ``w_tcp_base``: (6,) N, N m, set: on the tool about the tip, base axes.
    ``sums``: (9,) force and moment in part axes added to; largest force, largest depth, number of calls. All others as
    for :func:`cutting_wrench`.

    Returns:
        OK, SHANK or STILL.
    """
    for i in range(3):
        p_part[i] = 0.0
        for j in range(3):
            p_part[i] += T_base_part[j, i] * (p_base_tcp[j] - T_base_part[j, 3])
    status = cutting_wrench(
        z, grid, p_part, history, count, delay_steps, turning, shape, rings, rims, faces, circle, radii, law, load, out
    )
    for i in range(3):
        f, m = 0.0, 0.0
        for j in range(3):
            f += T_base_part[i, j] * out[j]
            m += T_base_part[i, j] * out[3 + j]
        w_tcp_base[i] = f
        w_tcp_base[3 + i] = m
    for i in range(6):
        sums[i] += out[i]
    sums[6] = max(sums[6], math.sqrt(out[0] ** 2 + out[1] ** 2 + out[2] ** 2))
    sums[7] = max(sums[7], out[6])
    sums[8] += 1.0
    return status
