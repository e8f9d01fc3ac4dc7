"""Material as columns along z that may hold several stretches: what a tilted or turning tool leaves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Float32, Int, as_float
from counterflex.core.errors import InputError, ModelError
from counterflex.core.units import MM, UM
from counterflex.cutting.booking_kernels import BINS, BOTTOM, QUANTUM_M, VISITED, VOLUME
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.removal import Engagement, RemovalResult, UInt16, compress, unit_widths
from counterflex.cutting.stock import HeightMap
from counterflex.cutting.tridexel.column_kernels import STRETCHES, Books, Columns, UInt8, cut_motions
from counterflex.cutting.tridexel.swept_solid import tool_shape
from counterflex.path import FEED, RAPID

CHORD_M: Final = 2.0 * UM
"""How far the sweep of a turning tool may be off, at the height of :data:`ENGAGED_M` on the cutter."""
ENGAGED_M: Final = 10.0 * MM
MOST_STEPS: Final = 1000
CHUNK: Final = 4096


@dataclass
class ColumnStock:
    """Material over a grid of columns in the part frame.

    Attributes:
        x0_m: x of the centre of column [0, 0], m, part frame.
        y0_m: y of that centre, m.
        cell_m: Side of a column, m.
        low: (8, ny, nx) float32 lower ends of the stretches of material, m, rising.
        high: (8, ny, nx) float32 their upper ends.
        count: (ny, nx) how many stretches there are.
    """

    x0_m: float
    y0_m: float
    cell_m: float
    low: Float32
    high: Float32
    count: UInt8

    @classmethod
    def of(cls, stock: HeightMap) -> ColumnStock:
        """The columns of a height map."""
        ny, nx = stock.z.shape
        low, high = np.zeros((STRETCHES, ny, nx), np.float32), np.zeros((STRETCHES, ny, nx), np.float32)
        low[0], high[0] = stock.bottom_m, stock.z
        count = (stock.z > stock.bottom_m + 1e-9).astype(np.uint8)
        return cls(stock.x0_m, stock.y0_m, stock.cell_m, low, high, count)

    @property
    def columns(self) -> Columns:
        """As the kernels take it; it shares the arrays."""
        return Columns(self.low, self.high, self.count, self.x0_m, self.y0_m, self.cell_m)

    def tops(self) -> HeightMap:
        """The highest material of each column as a height map; empty columns end at the lowest material of all."""
        layer = np.arange(len(self.high))[:, None, None]
        bottom = float(self.low.min(initial=np.inf, where=layer < self.count))
        bottom = bottom if np.isfinite(bottom) else 0.0
        z = self.high.max(axis=0, initial=bottom, where=layer < self.count)
        return HeightMap(self.x0_m, self.y0_m, self.cell_m, np.asarray(z, np.float32), bottom)

    @property
    def volume_m3(self) -> float:
        """Volume of the material, m^3."""
        tall = 0.0
        for k in range(int(self.count.max(initial=0))):
            tall += float(np.sum(self.high[k] - self.low[k], where=self.count > k, dtype=np.float64))
        return tall * self.cell_m**2

    def holds(self, z: Float) -> Bool:
        """(nz, ny, nx) bool: whether the columns hold material at heights (nz,) m."""
        at = np.asarray(z, np.float32)[:, None, None]
        out: Bool = np.zeros((len(at), *self.count.shape), dtype=np.bool_)
        for k in range(int(self.count.max(initial=0))):
            out |= (self.count > k) & (self.low[k] < at) & (at < self.high[k])
        return out


def motions_of(p_part_tcp: Float, axis_part: Float, engaged_m: float = ENGAGED_M) -> tuple[Float, Int]:
    """Straight motions with the axis held still that stand for a path.

    A segment in which the axis turns by theta is divided so that a point at ``engaged_m`` above the tip is nowhere
    off by more than :data:`CHORD_M`: ``engaged theta / (2 n)``; each part has the axis of its middle.

    Args:
        p_part_tcp: (n + 1, 3) m.
        axis_part: (n + 1, 3) unit vectors from the tip to the spindle.
        engaged_m: Height on the cutter up to which it cuts, m.

    Returns:
        Motions (k, 9) and the segment of each (k,).

    Raises:
        InputError: The axis turns by so much in a segment that it would have to be divided over a thousand times.
    """
    a, b = axis_part[:-1], axis_part[1:]
    theta = np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.sum(a * b, axis=1))
    steps = np.maximum(1, np.ceil(engaged_m * theta / (2.0 * CHORD_M))).astype(np.int64)
    if steps.max() > MOST_STEPS:
        worst = int(np.argmax(steps))
        raise InputError(
            "the tool axis turns too far in one segment",
            where=f"segment {worst}",
            value=f"{np.degrees(theta[worst]):.2f} deg",
            limit=f"{np.degrees(2.0 * CHORD_M * MOST_STEPS / engaged_m):.2f} deg",
            hint="Sample the path more finely",
        )
    owner = np.repeat(np.arange(len(steps)), steps)
    place = np.arange(len(owner)) - np.repeat(np.cumsum(steps) - steps, steps)
    n = steps[owner]
    step = (p_part_tcp[1:] - p_part_tcp[:-1])[owner] / n[:, None]
    start = p_part_tcp[:-1][owner] + step * place[:, None]
    axis = a[owner] + (b - a)[owner] * ((place + 0.5) / n)[:, None]
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    return np.concatenate([start, step, axis], axis=1), owner


def shape_of(cutter: Cutter, top_m: float) -> Float:
    """Radius, corner radius and top, then the number of corner levels and their boundaries, m."""
    parameters = cutter.kernel_parameters()
    levels = int(parameters[2])
    head = tool_shape(parameters[0], parameters[1], top_m)
    return np.concatenate([head, [float(levels)], parameters[3 : 4 + levels]])


def remove_turning(
    stock: ColumnStock,
    p_part_tcp: Float,
    axis_part: Float,
    kind: Int,
    cutter: Cutter,
    *,
    top_m: float,
    engagement: bool = True,
) -> RemovalResult:
    """Cut a path whose tool axis may point anywhere and turn.

    Args:
        stock: Cut in place.
        p_part_tcp: (n + 1, 3) tool tip, m, part frame.
        axis_part: (n + 1, 3) unit vectors from the tip to the spindle.
        kind: (n,) kind of each segment, see :func:`counterflex.cutting.removal.remove_path`.
        cutter: The cutter.
        top_m: Height above the tip up to which the tool takes material away: flutes, or all that is as thick.
        engagement: Book what feed segments remove by level and immersion angle about the tool axis; the feed is the
            motion square to it.

    Returns:
        The removal per segment; ``length_m`` is that square to the axis.

    Raises:
        InputError: The path is not as described, or turns too far in a segment.
        ModelError: A column would need more than eight stretches.
    """
    path = as_float("p_part_tcp", p_part_tcp, (None, 3))
    axis = as_float("axis_part", axis_part, (len(path), 3))
    n = len(path) - 1
    kinds = np.asarray(kind, np.int64)[-n:] if n else np.empty(0, np.int64)
    if n < 1 or kinds.shape != (n,):
        raise InputError("path and kinds do not fit", value=f"{len(path)} points, {np.size(kind)} kinds")
    step, middle = np.diff(path, axis=0), axis[1:] + axis[:-1]
    middle /= np.linalg.norm(middle, axis=1, keepdims=True)
    length = np.linalg.norm(step - np.sum(step * middle, axis=1)[:, None] * middle, axis=1)
    shape, levels, unit = shape_of(cutter, top_m), cutter.n_levels, QUANTUM_M * stock.cell_m**2
    book = ((kinds == FEED) & engagement).astype(np.float64)
    totals = np.zeros((n, 4), np.int64)
    parts: list[tuple[Int, Float32, UInt16]] = []
    side = np.zeros(n, np.int64)
    for first in range(0, n, CHUNK):
        last = min(first + CHUNK, n)
        motions, owner = motions_of(path[first : last + 1], axis[first : last + 1])
        booked = np.zeros((1, last - first, levels, BINS), np.int64)
        books = Books(booked, totals[first:last], True, first > 0)
        done = cut_motions(stock.columns, motions, owner, shape, books, book[first:last])
        if done < len(motions):
            raise ModelError(
                "a column of the stock would hold too many stretches of material",
                where=f"segment {first + int(owner[done])}",
                limit=str(STRETCHES),
                hint="Turn the part frame so that z looks along most cuts",
            )
        count = int(np.count_nonzero(booked))
        cell, depth = np.empty(count, np.uint16), np.empty(count, np.float32)
        offsets = np.zeros(last - first + 1, np.int64)
        free = np.maximum(length[first:last], 1e-12)
        compress(booked, free, unit, cutter.level_radii(), unit_widths(), cell, depth, offsets, side[first:last])
        parts.append((np.diff(offsets), depth, cell))
    quanta = totals[:, VOLUME] + totals[:, BOTTOM] + side
    volume = quanta * unit
    booked_engagement = None
    if engagement:
        counts = np.concatenate([part[0] for part in parts])
        booked_engagement = Engagement(
            levels,
            np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
            np.concatenate([part[2] for part in parts]),
            np.concatenate([part[1] for part in parts]),
        )
    return RemovalResult(
        as_float("volume", volume, (n,)),
        as_float("bottom volume", totals[:, BOTTOM] * unit, (n,)),
        np.zeros(n),
        length,
        booked_engagement,
        np.flatnonzero((kinds == RAPID) & (volume > 0.0)),
        int(totals[:, VISITED].sum()),
        int(np.count_nonzero(quanta)),
    )
