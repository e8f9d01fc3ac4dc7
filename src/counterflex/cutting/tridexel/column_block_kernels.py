"""Kernels: columns of material, what is known of their blocks, and taking a stretch out of one."""

from __future__ import annotations

import math
from typing import Annotated, Final, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from counterflex.core.arrays import Float, Float32
from counterflex.core.jit import bundle, kernel
from counterflex.cutting.envelope_kernels import LANES, ROWS, Real, Whole

UInt8 = npt.NDArray[np.uint8]
STRETCHES: Final = 8
"""Stretches of material that a column has room for at first; columns that need more grow."""
MOST_STRETCHES: Final = 64
"""Stretches for which the scratch arrays of the kernels are made."""
LOWEST: Final = np.float32(-3.0e38)
"""Highest material of a column without any."""
_TINY_M: Final = 1.0e-9


class Columns(NamedTuple):
    """Columns of material.

    (layers, ny, nx) lower and upper ends, (ny, nx) stretches held; highest material of each block and whether the block
    is plain; centre of the first column, side, floor of plain blocks (m).
    """

    low: Annotated[Float32, "float32[:, :, ::1]"]
    high: Annotated[Float32, "float32[:, :, ::1]"]
    held: Annotated[UInt8, "uint8[:, ::1]"]
    tops: Annotated[Float32, "float32[:, ::1]"]
    plain: Annotated[UInt8, "uint8[:, ::1]"]
    x0: float
    y0: float
    cell: float
    floor: float


COLUMNS: Final = bundle(Columns)


class Ends(Protocol):
    """Ends of stretches (layers, ny, nx), rising, and how many each column holds (ny, nx)."""

    @property
    def low(self) -> Float32:
        """Lower ends."""

    @property
    def high(self) -> Float32:
        """Upper ends."""

    @property
    def held(self) -> UInt8:
        """Stretches held."""


@kernel()
def take(columns: Ends, j: Whole, i: Whole, low: Real, high: Real, piece: Float) -> Whole:
    """Take [low, high] out of a column; piece (layers, 2) receives what was taken.

    Returns how many pieces, -1: no room. A column gains at most one stretch.
    """
    ends_low, ends_high = columns.low[:, j, i], columns.high[:, j, i]
    n, taken = int(columns.held[j, i]), 0
    k = 0
    while k < n:
        bottom, top = float(ends_low[k]), float(ends_high[k])
        one, two = max(low, bottom), min(high, top)
        if two - one <= _TINY_M:
            k += 1
            continue
        piece[taken, 0], piece[taken, 1] = one, two
        taken += 1
        below, above = one - bottom > _TINY_M, top - two > _TINY_M
        if below and above:
            if n == ends_low.shape[0]:
                return -1
            for m in range(n, k + 1, -1):
                ends_low[m], ends_high[m] = ends_low[m - 1], ends_high[m - 1]
            ends_high[k] = one
            ends_low[k + 1], ends_high[k + 1] = two, top
            n += 1
            k += 2
        elif below:
            ends_high[k] = one
            k += 1
        elif above:
            ends_low[k] = two
            k += 1
        else:
            for m in range(k, n - 1):
                ends_low[m], ends_high[m] = ends_low[m + 1], ends_high[m + 1]
            n -= 1
    columns.held[j, i] = n
    return taken


@kernel("int64(Columns, float64)", entry=True, Columns=COLUMNS)
def fell_ridges(columns: Ends, ridge: float) -> int:
    """Drop stretches thinner than a ridge that stand above others; returns the most stretches of a column now."""
    ny, nx = columns.held.shape
    most = 0
    for j in range(ny):
        for i in range(nx):
            n = int(columns.held[j, i])
            k = 1
            while k < n:
                if columns.high[k, j, i] - columns.low[k, j, i] < ridge:
                    for m in range(k, n - 1):
                        columns.low[m, j, i], columns.high[m, j, i] = (
                            columns.low[m + 1, j, i],
                            columns.high[m + 1, j, i],
                        )
                    n -= 1
                else:
                    k += 1
            columns.held[j, i] = n
            most = max(most, n)
    return most


@kernel()
def block_top(columns: Columns, block_row: Whole, block: Whole) -> float:
    """Highest material of a block."""
    ny, nx = columns.held.shape
    i_low = min(block * LANES, nx - LANES)
    top = LOWEST
    for j in range(block_row * ROWS, min((block_row + 1) * ROWS, ny)):
        if columns.plain[block_row, block] != 0:
            for i in range(i_low, i_low + LANES):
                top = max(top, columns.high[0, j, i])
        else:
            for i in range(i_low, i_low + LANES):
                n = columns.held[j, i]
                if n > 0:
                    top = max(top, columns.high[n - 1, j, i])
    return float(top)


@kernel("void(Columns)", entry=True, Columns=COLUMNS)
def survey(columns: Columns) -> None:
    """Fill the highest material of all blocks, and which are plain, from the ends."""
    ny, nx = columns.held.shape
    floor = np.float32(columns.floor)
    for block_row in range(columns.tops.shape[0]):
        for block in range(columns.tops.shape[1]):
            i_low = min(block * LANES, nx - LANES)
            plain = True
            for j in range(block_row * ROWS, min((block_row + 1) * ROWS, ny)):
                for i in range(i_low, i_low + LANES):
                    n = columns.held[j, i]
                    bare = n == 0 and columns.high[0, j, i] <= floor
                    plain = plain and (bare or (n == 1 and columns.low[0, j, i] == floor))
            columns.plain[block_row, block] = 1 if plain else 0
            columns.tops[block_row, block] = block_top(columns, block_row, block)


@kernel()
def mark(columns: Columns, block_row: Whole, block: Whole) -> None:
    """A block, and what overlaps it, is no longer plain."""
    last = columns.plain.shape[1] - 1
    columns.plain[block_row, block] = 0
    # The last block is shifted inside the map, so its columns are also those of the one before: neither stays plain.
    if block >= last - 1 and last > 0:
        columns.plain[block_row, last - 1] = 0
        columns.plain[block_row, last] = 0


@kernel()
def free(columns: Columns, path: Float, first: Whole, count: Whole, radius: float, top: float) -> bool:
    """Return whether all blocks under a run of an upright tool are plain and no material reaches over its top."""
    last = first + count
    x_low, x_high = min(path[first, 0], path[last, 0]) - radius, max(path[first, 0], path[last, 0]) + radius
    y_low, y_high = min(path[first, 1], path[last, 1]) - radius, max(path[first, 1], path[last, 1]) + radius
    over = min(path[first, 2], path[last, 2]) + top
    cell = columns.cell
    row_low = max(0, math.floor((y_low - columns.y0) / cell / ROWS))
    row_high = min(columns.tops.shape[0], math.floor((y_high - columns.y0) / cell / ROWS) + 1)
    block_low = max(0, math.floor((x_low - columns.x0) / cell / LANES))
    block_high = min(columns.tops.shape[1], math.floor((x_high - columns.x0) / cell / LANES) + 1)
    if block_high >= columns.tops.shape[1] - 1:
        block_high = columns.tops.shape[1]
    for row in range(row_low, row_high):
        for block in range(block_low, block_high):
            if columns.plain[row, block] == 0 or columns.tops[row, block] > over:
                return False
    return True


@kernel()
def empty_columns(columns: Columns, path: Float, first: Whole, count: Whole, radius: float) -> None:
    """Count what a stamp has cut down to the floor as empty."""
    last = first + count
    x_low, x_high = min(path[first, 0], path[last, 0]) - radius, max(path[first, 0], path[last, 0]) + radius
    y_low, y_high = min(path[first, 1], path[last, 1]) - radius, max(path[first, 1], path[last, 1]) + radius
    ny, nx = columns.held.shape
    floor = np.float32(columns.floor)
    for j in range(
        max(0, math.floor((y_low - columns.y0) / columns.cell)),
        min(ny, math.ceil((y_high - columns.y0) / columns.cell) + 1),
    ):
        for i in range(
            max(0, math.floor((x_low - columns.x0) / columns.cell)),
            min(nx, math.ceil((x_high - columns.x0) / columns.cell) + 1),
        ):
            if columns.held[j, i] == 1 and columns.high[0, j, i] <= floor:
                columns.held[j, i] = 0
