"""Horizontal section through what a tool path has cut: where a ray leaves it, exact to rounding.

At a height z a straight move of the tool clears a stadium: all points within r of the part of the move that runs
below z, r the radius of the cutter outline at that height above the tip. A wall is where the union of all stadiums
ends; a height map knows it to one cell only.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Bool, Float, Int, as_float, as_positive
from counterflex.core.jit import kernel
from counterflex.cutting.cutter import Cutter

_JOIN = 1e-9  # m; intervals closer than this touch


@dataclass(frozen=True)
class SweptSection:
    """Straight moves of a cutter, sorted into square bins for ray queries."""

    start: Float  # (n, 3) m tool tip at the start of each move, part frame
    end: Float  # (n, 3) m
    radius_m: Float  # (n,) cutter radius of each move
    corner_m: Float  # (n,) corner radius of its outline
    reach_m: float  # longest ray that may be cast from a wall point, m
    bin_m: float  # side of a bin
    low: Float  # (2,) m corner of the first bin
    shape: tuple[int, int]  # bins along y and x
    first: Int  # (bins + 1,) first entry of each bin in `member`
    member: Int  # moves that can touch a ray from a point in the bin

    def wall_exit(self, point: Float, direction: Float, inside_m: float) -> tuple[Float, Float]:
        """Distance along a ray that the cut reaches, from a place inside it.

        Args:
            point: (m, 3) m; z is the height of the section.
            direction: (m, 2) horizontal unit vectors, from the cut towards the material.
            inside_m: The ray starts this far behind the point, at a place expected to be cut; at most ``reach_m``.

        Returns:
            Distance from the point along ``direction`` to where the cut ends (m,), m: NaN where the start of the ray is
            not cut, and infinity where the cut goes on beyond ``reach_m``; and the unit normal of the cut's boundary
            there (m, 2), out of the cut.
        """
        points, rays = as_float("point", point, (None, 3)), as_float("direction", direction, (len(point), 2))
        if self.shape[0] == 0:
            return np.full(len(points), np.nan), rays.copy()
        return _exits(
            points,
            rays,
            float(inside_m),
            self.reach_m,
            self.start,
            self.end,
            self.radius_m,
            self.corner_m,
            self.low[0],
            self.low[1],
            self.bin_m,
            self.shape[1],
            self.shape[0],
            self.first,
            self.member,
        )


def swept_section(
    p_part_tcp: Float, outline: Cutter | Float, reach_m: float, joined: Bool | None = None
) -> SweptSection:
    """Prepare the moves of a tool path for :func:`wall_exit`.

    Args:
        p_part_tcp: (n, 3) m tool tip, part frame, tool axis along part z.
        outline: Cutter, or (n, 2) m, radius and corner radius of the tool that each row was run to with.
        reach_m: Longest ray, from a wall point inward and outward.
        joined: (n,) False where a row does not continue the one before, or None for a path without holes.

    Raises:
        InputError: Shape, values or reach are out of range.
    """
    p = as_float("p_part_tcp", p_part_tcp, (None, 3))
    reach = as_positive("reach_m", reach_m)
    keep = np.ones(max(len(p) - 1, 0), dtype=np.bool_)
    if joined is not None:
        keep &= np.asarray(joined, dtype=np.bool_)[1:]
    if isinstance(outline, Cutter):
        outline = np.tile([outline.radius_m, outline.corner_radius_m], (len(p), 1))
    sizes = as_float("outline", outline, (len(p), 2))[1:][keep]
    radius, corner = np.ascontiguousarray(sizes[:, 0]), np.ascontiguousarray(sizes[:, 1])
    start, end = np.ascontiguousarray(p[:-1][keep]), np.ascontiguousarray(p[1:][keep])
    widest = float(np.max(radius, initial=0.0))
    side = max(widest, reach, 1e-3)
    margin = widest + reach
    if len(start) == 0:
        empty = np.zeros(0, dtype=np.int64)
        return SweptSection(start, end, radius, corner, reach, side, np.zeros(2), (0, 0), empty, empty)
    low: Float = np.minimum(start, end)[:, :2].min(axis=0) - margin
    high: Float = np.maximum(start, end)[:, :2].max(axis=0) + margin
    nx, ny = (int(v) for v in np.floor((high - low) / side) + 1)
    first, member = _bins(start, end, margin, low[0], low[1], side, nx, ny)
    return SweptSection(start, end, radius, corner, reach, side, low, (ny, nx), first, member)


@kernel(
    "UniTuple(int64[::1], 2)(float64[:, ::1], float64[:, ::1], float64, float64, float64, float64, int64, int64)",
    entry=True,
)
def _bins(a: Float, b: Float, margin: float, x0: float, y0: float, side: float, nx: int, ny: int) -> tuple[Int, Int]:
    """Moves that come within ``margin`` (as boxes) of each bin, in compressed rows."""
    first = np.zeros(nx * ny + 1, dtype=np.int64)
    member = np.zeros(0, dtype=np.int64)
    fill = np.zeros(0, dtype=np.int64)
    for sweep in range(2):
        for k in range(a.shape[0]):
            i0 = max(math.floor((min(a[k, 0], b[k, 0]) - margin - x0) / side), 0)
            i1 = min(math.floor((max(a[k, 0], b[k, 0]) + margin - x0) / side), nx - 1)
            j0 = max(math.floor((min(a[k, 1], b[k, 1]) - margin - y0) / side), 0)
            j1 = min(math.floor((max(a[k, 1], b[k, 1]) + margin - y0) / side), ny - 1)
            for j in range(j0, j1 + 1):
                for i in range(i0, i1 + 1):
                    if sweep == 0:
                        first[j * nx + i + 1] += 1
                    else:
                        member[fill[j * nx + i]] = k
                        fill[j * nx + i] += 1
        if sweep == 0:
            first = np.cumsum(first)
            member = np.zeros(first[-1], dtype=np.int64)
            fill = first[:-1].copy()
    return first, member


@kernel()
def _span(
    px: float, py: float, z: float, dx: float, dy: float, a: Float, b: Float, R: float, rc: float
) -> tuple[float, float, float, float]:
    """Interval of the ray that one move clears, and the unit normal where it ends; empty as (1, 0)."""
    ax, ay, az, bx, by, bz = a[0], a[1], a[2], b[0], b[1], b[2]
    if az > z and bz > z:
        return 1.0, 0.0, dx, dy
    if az > z:
        t = (z - bz) / (az - bz)
        ax, ay, az = bx + t * (ax - bx), by + t * (ay - by), z
    elif bz > z:
        t = (z - az) / (bz - az)
        bx, by, bz = ax + t * (bx - ax), ay + t * (by - ay), z
    r = R
    if rc > 0.0:
        h = z - 0.5 * (az + bz)
        if h < rc:
            r = R - rc + math.sqrt(max(rc * rc - (rc - h) ** 2, 0.0))
    low, high, nx, ny = math.inf, -math.inf, dx, dy
    for cap in range(2):
        cx, cy = (ax, ay) if cap == 0 else (bx, by)
        qx, qy = px - cx, py - cy
        beta = qx * dx + qy * dy
        root = beta * beta - (qx * qx + qy * qy) + r * r
        if root >= 0.0:
            root = math.sqrt(root)
            low = min(low, -beta - root)
            if -beta + root > high:
                high = -beta + root
                nx, ny = (qx + high * dx) / r, (qy + high * dy) / r
    ux, uy = bx - ax, by - ay
    length = math.sqrt(ux * ux + uy * uy)
    if length > 0.0:
        ux, uy = ux / length, uy / length
        along0, along1 = (px - ax) * ux + (py - ay) * uy, dx * ux + dy * uy
        side0, side1 = -(px - ax) * uy + (py - ay) * ux, -dx * uy + dy * ux
        if abs(side1) > 1e-15:
            for sign in (-1.0, 1.0):
                t = (sign * r - side0) / side1
                s = along0 + t * along1
                if 0.0 <= s <= length:
                    low = min(low, t)
                    if t > high:
                        high = t
                        nx, ny = -sign * uy, sign * ux
    if high < low:
        return 1.0, 0.0, dx, dy
    return low, high, nx, ny


@kernel(
    "Tuple((float64[::1], float64[:, ::1]))(float64[:, ::1], float64[:, ::1], float64, float64, "
    "float64[:, ::1], float64[:, ::1], float64[::1], float64[::1], float64, float64, float64, int64, "
    "int64, int64[::1], int64[::1])",
    entry=True,
)
def _exits(
    point: Float,
    direction: Float,
    inside: float,
    reach: float,
    a: Float,
    b: Float,
    R: Float,
    rc: Float,
    x0: float,
    y0: float,
    side: float,
    nx: int,
    ny: int,
    first: Int,
    member: Int,
) -> tuple[Float, Float]:
    """See :func:`wall_exit`."""
    m = point.shape[0]
    out = np.full(m, np.nan)
    normal = direction.copy()
    for k in range(m):
        i = math.floor((point[k, 0] - x0) / side)
        j = math.floor((point[k, 1] - y0) / side)
        if i < 0 or j < 0 or i >= nx or j >= ny:
            continue
        f0, f1 = first[j * nx + i], first[j * nx + i + 1]
        n = f1 - f0
        spans = np.empty((n, 4))
        count = 0
        for c in range(f0, f1):
            s0, s1, gx, gy = _span(
                point[k, 0], point[k, 1], point[k, 2], direction[k, 0], direction[k, 1], a[member[c]], b[member[c]],
                R[member[c]], rc[member[c]],
            )  # fmt: skip
            if s1 >= s0 and s1 >= -inside:
                spans[count, 0], spans[count, 1], spans[count, 2], spans[count, 3] = s0, s1, gx, gy
                count += 1
        t = -inside
        covered = False
        grown = True
        while grown and t < reach:
            grown = False
            for c in range(count):
                if spans[c, 0] <= t + _JOIN and spans[c, 1] > t:
                    t = spans[c, 1]
                    normal[k, 0], normal[k, 1] = spans[c, 2], spans[c, 3]
                    grown = True
                    covered = True
        if covered:
            out[k] = t if t < reach else math.inf
    return out, normal
