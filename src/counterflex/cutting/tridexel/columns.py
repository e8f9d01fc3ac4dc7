"""Material as columns along z that may hold several stretches: what a tilted or turning tool leaves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Float32, Int, as_float
from counterflex.core.errors import InputError, ModelError
from counterflex.core.units import DEG, MM, UM
from counterflex.cutting import removal
from counterflex.cutting.booking_kernels import BINS, BOTTOM, EVENTS, QUANTUM_M, VISITED, VOLUME
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.envelope_kernels import LANES
from counterflex.cutting.stock import BLOCK_COLUMNS, BLOCK_ROWS, HeightMap
from counterflex.cutting.tridexel import column_block_kernels
from counterflex.cutting.tridexel.column_kernels import Desk, cut_motions
from counterflex.cutting.tridexel.row_kernels import ROWS_OF_WORK
from counterflex.cutting.tridexel.sweep_bounds_kernels import BOUNDS, FRAME
from counterflex.cutting.tridexel.swept_solid import tool_shape
from counterflex.cutting.tridexel.turning_book_kernels import CODE_ROWS, EVENT_ROWS
from counterflex.cutting.tridexel.turning_line_kernels import MOTION
from counterflex.path import FEED, RAPID

CHORD_M: Final = 2.0 * UM
"""How far the sweep of a turning tool may be off, at the height of :data:`ENGAGED_M` on the cutter."""
ENGAGED_M: Final = 10.0 * MM
RIDGE_M: Final = CHORD_M
"""Stretches thinner than the sweep is exact are dropped where a column is full."""
LARGEST_TURN_RAD: Final = 90.0 * DEG
CHUNK: Final = 4096
_UPRIGHT: Final = 1.0 - 1e-15


@dataclass
class ColumnStock:
    """Material over a grid of columns in the part frame."""

    x0_m: float  # x of the centre of column [0, 0], m, part frame
    y0_m: float  # y of that centre, m
    cell_m: float  # side of a column, m
    low: Float32  # (layers, ny, nx) float32 lower ends of the stretches of material, m, rising
    high: Float32  # (layers, ny, nx) float32 their upper ends
    count: column_block_kernels.UInt8  # (ny, nx) how many stretches there are

    @classmethod
    def of(cls, stock: HeightMap) -> ColumnStock:
        """The columns of a height map."""
        ny, nx = stock.z.shape
        low, high = (
            np.zeros((column_block_kernels.STRETCHES, ny, nx), np.float32),
            np.zeros((column_block_kernels.STRETCHES, ny, nx), np.float32),
        )
        low[0], high[0] = stock.bottom_m, stock.z
        count = (stock.z > stock.bottom_m + 1e-9).astype(np.uint8)
        return cls(stock.x0_m, stock.y0_m, stock.cell_m, low, high, count)

    @property
    def columns(self) -> column_block_kernels.Columns:
        """As the kernels take it; it shares the arrays. What is known of the blocks is as of now."""
        ny, nx = self.count.shape
        blocks = (-(-ny // BLOCK_ROWS), -(-nx // BLOCK_COLUMNS))
        tops, plain = np.empty(blocks, np.float32), np.empty(blocks, np.uint8)
        floor = float(self.low[0].min())
        out = column_block_kernels.Columns(
            self.low, self.high, self.count, tops, plain, self.x0_m, self.y0_m, self.cell_m, floor
        )
        column_block_kernels.survey(out)
        return out

    def make_room(self, where: str, spare: int = 1, ridge_m: float = RIDGE_M) -> None:
        """Give every column room for more stretches: drop ridges, then double the layers where that is not enough.

        Args:
            where: Place in the path, for the message.
            spare: Stretches that the fullest column has room for.
            ridge_m: Stretches that are thinner and stand above others are dropped, m.

        Raises:
            ModelError: A column would hold more stretches than the kernels can work on.
        """
        if int(self.count.max(initial=0)) + spare <= len(self.low):
            return
        most = column_block_kernels.fell_ridges(self.columns, ridge_m)
        while most + spare > len(self.low):
            if 2 * len(self.low) > column_block_kernels.MOST_STRETCHES:
                raise ModelError(
                    "a column of the stock holds too many stretches of material",
                    where=where,
                    value=most,
                    limit=f"at most {column_block_kernels.MOST_STRETCHES - spare}",
                    hint="Turn the part frame so that z looks along most cuts",
                )
            self.low, self.high = (np.concatenate([ends, np.zeros_like(ends)]) for ends in (self.low, self.high))

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
    """Straight motions, the axis turning evenly in each, that stand for a path.

    In a motion the tip goes straight and the axis turns in the plane of its first and last direction, u0 to u1. Its
    middle and the turn are ``u0 + u1`` and ``u1 - u0`` over ``|u0 + u1|``, so that it points along
    ``middle + (s - 1/2) turn``. What the closed forms leave out is of second order: a point at ``engaged_m`` above the
    tip bulges by ``(engaged + R) theta^2 / 8`` out of its chord. A segment is divided until that is below
    :data:`CHORD_M` with R = ``engaged_m``; and, where a column is parallel to the flank or to the end face at some
    moment and these turn about a line within the engaged part, until what the column passes on the way is as little.

    Args:
        p_part_tcp: (n + 1, 3) m.
        axis_part: (n + 1, 3) unit vectors from the tip to the spindle.
        engaged_m: Height on the cutter up to which it cuts, m.

    Returns:
        Motions (k, 12): start of the tip, displacement, axis in the middle, turn; and the segment of each (k,).

    Raises:
        InputError: The axis turns by more than 90 degrees in a segment.
    """
    a, b = axis_part[:-1], axis_part[1:]
    theta = np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.sum(a * b, axis=1))
    if theta.max(initial=0.0) > LARGEST_TURN_RAD:
        worst = int(np.argmax(theta))
        raise InputError(
            "the tool axis turns too far in one segment",
            where=f"segment {worst}",
            value=f"{theta[worst] / DEG:.2f} deg",
            limit=f"{LARGEST_TURN_RAD / DEG:g} deg",
            hint="Sample the path more finely",
        )
    bulge = theta * np.sqrt(2.0 * engaged_m / (8.0 * CHORD_M))
    waist = _waists(p_part_tcp, axis_part, theta, engaged_m) / CHORD_M
    steps = np.maximum(1, np.ceil(np.maximum(bulge, waist))).astype(np.int64)
    owner = np.repeat(np.arange(len(steps)), steps)
    place = np.arange(len(owner)) - np.repeat(np.cumsum(steps) - steps, steps)
    n = steps[owner]
    step = (p_part_tcp[1:] - p_part_tcp[:-1])[owner] / n[:, None]
    start = p_part_tcp[:-1][owner] + step * place[:, None]
    ends = [a[owner] + (b - a)[owner] * ((place + s) / n)[:, None] for s in (0.0, 1.0)]
    one, two = (end / np.linalg.norm(end, axis=1, keepdims=True) for end in ends)
    size = np.linalg.norm(one + two, axis=1, keepdims=True)
    turn = (two - one) * (2.0 / size)
    turn[theta[owner] == 0.0] = 0.0
    return np.concatenate([start, step, (one + two) / size, turn], axis=1), owner


def _waists(tips: Float, axes: Float, theta: Float, engaged_m: float) -> Float:
    """Largest depth of columns in the waist of each segment's sweep, m: of its flank, or amid its end face."""
    # Points at either end of a length of the tool move by l and h to opposite sides; between them the sweep is narrower
    # by `l h / (l + h)`.
    a, b, step = axes[:-1], axes[1:], np.diff(tips, axis=0)
    turn = (b - a) / np.maximum(np.linalg.norm(b - a, axis=1, keepdims=True), 1e-300)
    aside, along = np.sum(step * turn, axis=1), 0.5 * np.sum(step * (a + b), axis=1)
    reach = theta * engaged_m
    lean = np.minimum(np.hypot(a[:, 0], a[:, 1]), np.hypot(b[:, 0], b[:, 1]))
    out = np.zeros(len(theta))
    for one, two, parallel in (
        (aside, aside + reach, lean <= theta),
        (along - reach, along + reach, a[:, 2] * b[:, 2] <= 0.0),
    ):
        opposite = parallel & (one * two < 0.0)
        low, high = np.abs(one[opposite]), np.abs(two[opposite])
        out[opposite] = np.maximum(out[opposite], low * high / (low + high))
    return out


def shape_of(cutter: Cutter, top_m: float) -> Float:
    """Radius, corner radius and top, then the number of corner levels and their boundaries, m."""
    parameters = cutter.kernel_parameters()
    levels = int(parameters[2])
    head = tool_shape(parameters[0], parameters[1], top_m)
    return np.concatenate([head, [float(levels)], parameters[3 : 4 + levels]])


def _desk() -> Desk:
    """Scratch arrays of the kernels."""
    return Desk(
        event=np.zeros((EVENT_ROWS, EVENTS), np.float32),
        code=np.zeros((CODE_ROWS, EVENTS), np.int32),
        line=np.zeros((4, LANES), np.float32),
        work=np.zeros((ROWS_OF_WORK + 3, LANES), np.float32),
        row=np.zeros(LANES, np.float32),
        piece=np.empty((column_block_kernels.MOST_STRETCHES, 2)),
        frame=np.zeros(FRAME),
        bounds=np.zeros(BOUNDS),
        motion=np.zeros(MOTION),
        point=np.zeros(6),
    )


def _upright_runs(path: Float, axis: Float, kinds: Int, cutter: Cutter, motions: Float, owner: Int) -> Int:
    """Of each motion that begins a run of an upright tool, how many segments the run has; 0 of the others."""
    upright = (axis[:-1, 2] >= _UPRIGHT) & (axis[1:, 2] >= _UPRIGHT)
    out = np.zeros(len(motions), np.int64)
    if not upright.any():
        return out
    runs = removal.runs_of(path, kinds, cutter)
    whole = np.logical_and.reduceat(upright, runs[:, 0])
    count = upright.astype(np.int64)
    for first, n in runs[whole & (runs[:, 1] > 1)]:
        count[first : first + n] = 0
        count[first] = n
    begins = np.concatenate([[True], owner[1:] != owner[:-1]])
    out[begins] = count[owner[begins]]
    return out


def _engaged(path: Float, axis: Float, tool: Float, ceiling: float) -> float:
    """Height on the cutter up to which it can be in material, m."""
    cosine = np.maximum(axis[:, 2], 0.1)
    reach = np.max((ceiling - path[:, 2] + tool[0]) / cosine)
    return float(np.clip(max(reach, tool[0]), 1e-6, tool[2]))


def _booked(levels: int, parts: Sequence[tuple[Int, Float32, removal.UInt16]]) -> removal.Engagement:
    counts, depth, cell = (np.concatenate([part[k] for part in parts]) for k in range(3))
    return removal.Engagement(levels, np.concatenate([[0], np.cumsum(counts)]).astype(np.int64), cell, depth)


def remove_turning(
    stock: ColumnStock,
    p_part_tcp: Float,
    axis_part: Float,
    kind: Int,
    cutter: Cutter,
    *,
    top_m: float,
    engagement: bool = True,
) -> removal.RemovalResult:
    """Cut a path whose tool axis may point anywhere and turn.

    Args:
        stock: Cut in place.
        p_part_tcp: (n + 1, 3) tool tip, m, part frame.
        axis_part: (n + 1, 3) unit vectors from the tip to the spindle.
        kind: (n,) kind of each segment, see :func:`counterflex.cutting.removal.remove_path`.
        top_m: Height above the tip up to which the tool takes material away: flutes, or all that is as thick.
        engagement: Book what feed segments remove by level and immersion angle about the tool axis; the feed is the
            motion square to it.

    Returns:
        The removal per segment; ``length_m`` is that square to the axis.

    Raises:
        InputError: The path is not as described, or turns too far in a segment.
        ModelError: A column would hold more stretches than the kernels can work on.
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
    levels, unit = cutter.n_levels, QUANTUM_M * stock.cell_m**2
    stock.make_room("segment 0")
    corners, columns, desk = cutter.kernel_parameters(), stock.columns, _desk()
    tool, book = tool_shape(corners[0], corners[1], top_m), (kinds == FEED) & engagement
    totals = np.zeros((n, 4), np.int64)
    parts: list[tuple[Int, Float32, removal.UInt16]] = []
    side = np.zeros(n, np.int64)
    for first in range(0, n, CHUNK):
        last = min(first + CHUNK, n)
        part, turned = path[first : last + 1], axis[first : last + 1]
        ceiling = float(columns.tops.max())
        motions, owner = motions_of(part, turned, _engaged(part, turned, tool, ceiling))
        upright = _upright_runs(part, turned, kinds[first:last], cutter, motions, owner)
        scratch = removal.stamp_workspace(cutter, int(upright.max(initial=1))).scratch
        booked = np.zeros((1, last - first, levels if engagement else 0, BINS), np.int64)
        done = 0
        while done < len(motions):
            done += cut_motions(
                columns, part, motions[done:], owner[done:], upright[done:], corners, tool, ceiling,
                first + done > 0, book[first:last], engagement, booked[0], totals[first:last], scratch, desk,
            )  # fmt: skip
            if done < len(motions):
                stock.make_room(f"segment {first + int(owner[done])}")
                columns = stock.columns
        if not engagement:
            continue
        count = int(np.count_nonzero(booked))
        cell, depth = np.empty(count, np.uint16), np.empty(count, np.float32)
        offsets = np.zeros(last - first + 1, np.int64)
        free = np.maximum(length[first:last], 1e-12)
        removal.compress(
            booked, free, unit, cutter.level_radii(), removal.unit_widths(), cell, depth, offsets, side[first:last], 0
        )
        parts.append((np.diff(offsets), depth, cell))
    quanta = totals[:, VOLUME] + totals[:, BOTTOM] + side
    volume = quanta * unit
    return removal.RemovalResult(
        as_float("volume", volume, (n,)),
        as_float("bottom volume", totals[:, BOTTOM] * unit, (n,)),
        np.zeros(n),
        length,
        _booked(levels, parts) if engagement else None,
        np.flatnonzero((kinds == RAPID) & (volume > 0.0)),
        int(totals[:, VISITED].sum()),
        int(np.count_nonzero(quanta)),
    )
