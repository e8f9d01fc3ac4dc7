"""Material as columns of several stretches, and what a tool that stands in it takes away, one kernel.

The simulated cell's own removal for tools of any direction: the tool is placed every few hundredths of a millimetre of
its way, and what lies within it is taken out. A column meets the tool, a convex body, in one stretch.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from counterflex.core.arrays import Bool, Float, Float32
from counterflex.core.errors import SimulationError
from counterflex.core.jit import kernel
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.stock import HeightMap

UInt8 = npt.NDArray[np.uint8]
STRETCHES: Final = 8
"""Stretches that a column has room for at first."""
MOST_STRETCHES: Final = 128
"""Their number is held in 8 bits."""
DISCS: Final = 32
"""Discs that stand for the rounded corner of a bull nose; each has its outline's radius at the middle."""
_TINY_M: Final = 1.0e-9
_FAR_M: Final = 1.0e9
_THIN_M: Final = 0.05e-3
"""In a column without room the thinnest stretch is given up where it is thinner: a ridge between two places."""


@dataclass
class ColumnMaterial:
    """Columns of material along z of the part."""

    x0_m: float  # x of the centre of column [0, 0], m, part frame
    y0_m: float  # y of that centre, m
    cell_m: float  # side of a column, m
    low: Float32  # (ny, nx, layers) lower ends of the stretches, m, rising
    high: Float32  # (ny, nx, layers) upper ends
    held: UInt8  # (ny, nx) stretches in each column
    bottom_m: float  # underside of the blank, m

    @classmethod
    def of(cls, stock: HeightMap) -> ColumnMaterial:
        """The columns of a height map."""
        ny, nx = stock.z.shape
        low, high = np.zeros((ny, nx, STRETCHES), np.float32), np.zeros((ny, nx, STRETCHES), np.float32)
        low[..., 0], high[..., 0] = stock.bottom_m, stock.z
        held = (stock.z > stock.bottom_m + _TINY_M).astype(np.uint8)
        return cls(stock.x0_m, stock.y0_m, stock.cell_m, low, high, held, stock.bottom_m)

    def make_room(self) -> None:
        """Double the stretches that a column has room for.

        Raises SimulationError: there are :data:`MOST_STRETCHES` already.
        """
        if self.low.shape[2] >= MOST_STRETCHES:
            raise SimulationError(
                "a column of the stock would hold too many stretches of material",
                limit=str(MOST_STRETCHES),
                hint="Turn the part frame so that z looks along most cuts",
            )
        self.low, self.high = (np.concatenate([ends, np.zeros_like(ends)], axis=2) for ends in (self.low, self.high))

    def tops(self) -> HeightMap:
        """The highest material of each column, as a height map."""
        last = np.maximum(self.held.astype(np.int64) - 1, 0)
        top = np.take_along_axis(self.high, last[..., None], axis=2)[..., 0]
        z = np.where(self.held > 0, top, np.float32(self.bottom_m))
        return HeightMap(self.x0_m, self.y0_m, self.cell_m, z.astype(np.float32), self.bottom_m)

    @property
    def grid(self) -> Float:
        """(3,) x0, y0, cell, m."""
        return np.array([self.x0_m, self.y0_m, self.cell_m])


def outline_of(cutter: Cutter, top_m: float) -> Float:
    """Parts of a cutter, (n, 3) m: radius, lower and upper height of cylinders; first of all the ball, if it has one.

    The first row is the radius of the ball about that height on the axis, or zeros.
    """
    radius, corner = cutter.radius_m, cutter.corner_radius_m
    if cutter.is_flat:
        return np.array([[0.0, 0.0, 0.0], [radius, 0.0, top_m]])
    if cutter.is_ball:
        return np.array([[radius, 0.0, 0.0], [radius, radius, top_m]])
    rim = np.linspace(0.0, 0.5 * np.pi, DISCS + 1)
    middle = 0.5 * (rim[1:] + rim[:-1])
    heights = corner * (1.0 - np.cos(rim))
    discs = np.stack([radius - corner + corner * np.sin(middle), heights[:-1], np.full(DISCS, top_m)], axis=1)
    return np.concatenate([np.zeros((1, 3)), discs, [[radius, corner, top_m]]])


def near(p_part: Float, axis_part: Float, stock: HeightMap, radius_m: float, length_m: float, gap_m: float) -> Bool:
    """(n,) tools, given by tip and axis, that come nearer than a gap to the box around the stock.

    ``p_part``: (n, 3) m. ``axis_part``: (n, 3) unit vectors from the tip to the spindle.
    """
    ny, nx = stock.z.shape
    low = np.array([stock.x0_m, stock.y0_m, stock.bottom_m])
    high = np.array([stock.x0_m + (nx - 1) * stock.cell_m, stock.y0_m + (ny - 1) * stock.cell_m, float(stock.z.max())])
    out = np.zeros(len(p_part), dtype=np.bool_)
    count = math.ceil(length_m / radius_m) + 1
    for along in np.linspace(0.0, length_m, count):
        p = p_part + along * axis_part
        off = np.linalg.norm(np.maximum(np.maximum(low - p, p - high), 0.0), axis=1)
        out |= off < radius_m + gap_m + 0.5 * length_m / count
    return out


@kernel()
def _within(parts: Float, qx: float, qy: float, ux: float, uy: float, uz: float) -> tuple[float, float]:
    """Stretch of heights (from the tip) in which a column at (qx, qy) from the tip lies within the tool."""
    first, last = _FAR_M, -_FAR_M
    if parts[0, 0] > 0.0:
        r = parts[0, 0]
        dx, dy = qx - r * ux, qy - r * uy
        rest = r * r - dx * dx - dy * dy
        if rest > 0.0:
            root = math.sqrt(rest)
            first, last = r * uz - root, r * uz + root
    alpha = qx * ux + qy * uy
    ax, ay, az = qx - alpha * ux, qy - alpha * uy, -alpha * uz
    bx, by, bz = -uz * ux, -uz * uy, 1.0 - uz * uz
    aa, ab, bb = ax * ax + ay * ay + az * az, ax * bx + ay * by + az * bz, bx * bx + by * by + bz * bz
    for k in range(1, parts.shape[0]):
        r = parts[k, 0]
        rest = aa - r * r
        one, two = -_FAR_M, _FAR_M
        if bb > 1e-18:
            square = ab * ab - bb * rest
            if square <= 0.0:
                continue
            root = math.sqrt(square)
            one, two = (-ab - root) / bb, (-ab + root) / bb
        elif rest > 0.0:
            continue
        if abs(uz) > 1e-12:
            low, high = (parts[k, 1] - alpha) / uz, (parts[k, 2] - alpha) / uz
            one, two = max(one, min(low, high)), min(two, max(low, high))
        elif not parts[k, 1] <= alpha <= parts[k, 2]:
            continue
        if two > one:
            first, last = min(first, one), max(last, two)
    return first, last


@kernel()
def _without_ridge(low: Float32, high: Float32, n: int) -> int:
    """Give up the thinnest of n stretches of a column, where it is a ridge; returns how many are left."""
    which, least = 0, _FAR_M
    for k in range(n):
        tall = float(high[k]) - float(low[k])
        if tall < least:
            which, least = k, tall
    if least >= _THIN_M:
        return n
    for k in range(which, n - 1):
        low[k], high[k] = low[k + 1], high[k + 1]
    return n - 1


@kernel()
def take(low: Float32, high: Float32, held: UInt8, j: int, i: int, first: float, last: float) -> bool:
    """Take heights [first, last] out of a column; False where it has no room for another stretch."""
    n, k = int(held[j, i]), 0
    if n == low.shape[2]:
        n = _without_ridge(low[j, i], high[j, i], n)
    while k < n:
        bottom, top = float(low[j, i, k]), float(high[j, i, k])
        one, two = max(first, bottom), min(last, top)
        if two - one <= _TINY_M:
            k += 1
            continue
        below, above = one - bottom > _TINY_M, top - two > _TINY_M
        if below and above:
            if n == low.shape[2]:
                return False
            for m in range(n, k + 1, -1):
                low[j, i, m], high[j, i, m] = low[j, i, m - 1], high[j, i, m - 1]
            high[j, i, k] = one
            low[j, i, k + 1], high[j, i, k + 1] = two, top
            n += 1
            k += 2
        elif below:
            high[j, i, k] = one
            k += 1
        elif above:
            low[j, i, k] = two
            k += 1
        else:
            for m in range(k, n - 1):
                low[j, i, m], high[j, i, m] = low[j, i, m + 1], high[j, i, m + 1]
            n -= 1
    held[j, i] = n
    return True


@kernel(
    "boolean(float32[:, :, ::1], float32[:, :, ::1], uint8[:, ::1], float64[::1], float64[::1], "
    "float64[::1], float64[:, ::1])",
    entry=True,
)
def place_tool(low: Float32, high: Float32, held: UInt8, grid: Float, tip: Float, axis: Float, parts: Float) -> bool:
    """Take away what lies within the tool; False where a column has no room for another stretch.

    Args:
        low: (ny, nx, layers) m, changed.
        high: Same.
        held: (ny, nx), changed.
        grid: (3,) x0, y0, cell, m.
        tip: (3,) m, part frame.
        axis: (3,) unit vector from the tip to the spindle.
        parts: Of :func:`outline_of`.
    """
    x0, y0, cell = grid[0], grid[1], grid[2]
    ny, nx = held.shape
    last = parts.shape[0] - 1
    radius, top = parts[last, 0], parts[last, 2]
    x_low = tip[0] + min(0.0, top * axis[0]) - radius
    x_high = tip[0] + max(0.0, top * axis[0]) + radius
    y_low = tip[1] + min(0.0, top * axis[1]) - radius
    y_high = tip[1] + max(0.0, top * axis[1]) + radius
    z_low = tip[2] + min(0.0, top * axis[2]) - radius
    for j in range(max(0, math.ceil((y_low - y0) / cell)), min(ny - 1, math.floor((y_high - y0) / cell)) + 1):
        for i in range(max(0, math.ceil((x_low - x0) / cell)), min(nx - 1, math.floor((x_high - x0) / cell)) + 1):
            n = int(held[j, i])
            if n == 0 or high[j, i, n - 1] <= z_low:
                continue
            one, two = _within(parts, x0 + cell * i - tip[0], y0 + cell * j - tip[1], axis[0], axis[1], axis[2])
            if two > one and not take(low, high, held, j, i, one + tip[2], two + tip[2]):
                return False
    return True
