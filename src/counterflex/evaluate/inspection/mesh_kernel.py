"""Kernels: nearest triangle of a mesh by cubes of space, exact within a reach.

Triangles are listed in each cube that their box touches. A search goes outward cube by cube, shell by shell, and ends
where the best distance is less than what the next shell may hold.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from counterflex.core.arrays import Float, Int
from counterflex.core.jit import kernel

_TIE = 1e-12
"""Distances that differ by less, m, are those to an edge that two triangles share."""


@kernel("void(float64[:, :, ::1], float64[::1], float64, int64[::1], int64[::1])", entry=True)
def count_cubes(corners: Float, low: Float, side: float, shape: Int, first: Int) -> None:
    """Add to ``first[c + 1]`` the number of triangles whose box touches cube c."""
    for t in range(corners.shape[0]):
        i0, i1, j0, j1, k0, k1 = _box(corners[t], low, side, shape)
        for i in range(i0, i1 + 1):
            for j in range(j0, j1 + 1):
                for k in range(k0, k1 + 1):
                    first[(i * shape[1] + j) * shape[2] + k + 1] += 1


@kernel("void(float64[:, :, ::1], float64[::1], float64, int64[::1], int64[::1], int64[::1])", entry=True)
def list_cubes(corners: Float, low: Float, side: float, shape: Int, place: Int, member: Int) -> None:
    """Write the triangles of each cube, from ``place[c]`` on, which is moved."""
    for t in range(corners.shape[0]):
        i0, i1, j0, j1, k0, k1 = _box(corners[t], low, side, shape)
        for i in range(i0, i1 + 1):
            for j in range(j0, j1 + 1):
                for k in range(k0, k1 + 1):
                    c = (i * shape[1] + j) * shape[2] + k
                    member[place[c]] = t
                    place[c] += 1


@kernel()
def _box(triangle: Float, low: Float, side: float, shape: Int) -> tuple[int, int, int, int, int, int]:
    """First and last cube of a triangle along each axis."""
    a = np.empty(3, np.int64)
    b = np.empty(3, np.int64)
    for d in range(3):
        least = min(triangle[0, d], triangle[1, d], triangle[2, d])
        most = max(triangle[0, d], triangle[1, d], triangle[2, d])
        a[d] = min(max(math.floor((least - low[d]) / side), 0), shape[d] - 1)
        b[d] = min(max(math.floor((most - low[d]) / side), 0), shape[d] - 1)
    return a[0], b[0], a[1], b[1], a[2], b[2]


@kernel(
    "void(float64[:, ::1], float64[:, :, ::1], float64[:, ::1], float64[::1], float64, int64[::1], "
    "int64[::1], int64[::1], float64, float64[::1], int64[::1])",
    parallel=True,
    entry=True,
)
def signed_distances(
    points: Float,
    corners: Float,
    normals: Float,
    low: Float,
    side: float,
    shape: Int,
    first: Int,
    member: Int,
    reach: float,
    out: Float,
    nearest: Int,
) -> None:
    """Distance of each point to the nearest triangle, positive on its inner side, and which one; nan beyond reach."""
    for n in prange(points.shape[0]):
        out[n], nearest[n] = _signed(points[n], corners, normals, low, side, shape, first, member, reach)


@kernel()
def _signed(
    p: Float, corners: Float, normals: Float, low: Float, side: float, shape: Int, first: Int, member: Int, reach: float
) -> tuple[float, int]:
    i = math.floor((p[0] - low[0]) / side)
    j = math.floor((p[1] - low[1]) / side)
    k = math.floor((p[2] - low[2]) / side)
    best, inward, nearest = math.inf, 0.0, 0
    last = math.ceil(reach / side) + 1
    for shell in range(last + 1):
        if best <= (shell - 1) * side:
            break
        for a in range(max(i - shell, 0), min(i + shell, shape[0] - 1) + 1):
            for b in range(max(j - shell, 0), min(j + shell, shape[1] - 1) + 1):
                on_side = abs(a - i) == shell or abs(b - j) == shell
                step = 1 if on_side else max(2 * shell, 1)
                for c in range(k - shell, k + shell + 1, step):
                    if c < 0 or c >= shape[2]:
                        continue
                    cube = (a * shape[1] + b) * shape[2] + c
                    for m in range(first[cube], first[cube + 1]):
                        t = member[m]
                        x, y, z = _foot(p, corners[t])
                        dx, dy, dz = p[0] - x, p[1] - y, p[2] - z
                        size = math.sqrt(dx * dx + dy * dy + dz * dz)
                        along = -(dx * normals[t, 0] + dy * normals[t, 1] + dz * normals[t, 2])
                        # of two triangles at one edge the one that the point lies over most says on which side it is
                        if size < best - _TIE or (size < best + _TIE and abs(along) > abs(inward)):
                            best, inward, nearest = min(size, best), along, t
    if not best <= reach:
        return math.nan, nearest
    return (best if inward > 0.0 else -best), nearest


@kernel()
def _foot(p: Float, t: Float) -> tuple[float, float, float]:
    """Nearest point of a triangle (Ericson 2005, Real-Time Collision Detection, 5.1.5)."""
    abx, aby, abz = t[1, 0] - t[0, 0], t[1, 1] - t[0, 1], t[1, 2] - t[0, 2]
    acx, acy, acz = t[2, 0] - t[0, 0], t[2, 1] - t[0, 1], t[2, 2] - t[0, 2]
    apx, apy, apz = p[0] - t[0, 0], p[1] - t[0, 1], p[2] - t[0, 2]
    d1 = abx * apx + aby * apy + abz * apz
    d2 = acx * apx + acy * apy + acz * apz
    if d1 <= 0.0 and d2 <= 0.0:
        return t[0, 0], t[0, 1], t[0, 2]
    bpx, bpy, bpz = p[0] - t[1, 0], p[1] - t[1, 1], p[2] - t[1, 2]
    d3 = abx * bpx + aby * bpy + abz * bpz
    d4 = acx * bpx + acy * bpy + acz * bpz
    if d3 >= 0.0 and d4 <= d3:
        return t[1, 0], t[1, 1], t[1, 2]
    vc = d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        v = d1 / (d1 - d3)
        return t[0, 0] + v * abx, t[0, 1] + v * aby, t[0, 2] + v * abz
    cpx, cpy, cpz = p[0] - t[2, 0], p[1] - t[2, 1], p[2] - t[2, 2]
    d5 = abx * cpx + aby * cpy + abz * cpz
    d6 = acx * cpx + acy * cpy + acz * cpz
    if d6 >= 0.0 and d5 <= d6:
        return t[2, 0], t[2, 1], t[2, 2]
    vb = d5 * d2 - d1 * d6
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        w = d2 / (d2 - d6)
        return t[0, 0] + w * acx, t[0, 1] + w * acy, t[0, 2] + w * acz
    va = d3 * d6 - d5 * d4
    if va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        return (t[1, 0] + w * (t[2, 0] - t[1, 0]), t[1, 1] + w * (t[2, 1] - t[1, 1]), t[1, 2] + w * (t[2, 2] - t[1, 2]))
    whole = 1.0 / (va + vb + vc)
    v, w = vb * whole, vc * whole
    return t[0, 0] + abx * v + acx * w, t[0, 1] + aby * v + acy * w, t[0, 2] + abz * v + acz * w
