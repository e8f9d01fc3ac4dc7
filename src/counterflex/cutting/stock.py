"""The stock as a height map: one column of material per square cell, lowered by the cutter."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, Float32
from counterflex.core.atomic import atomic_path
from counterflex.core.errors import FileFormatError, InputError, ModelError
from counterflex.core.file_content import arrays
from counterflex.cutting.stock_mesh import STL_UNIT_M, heights_from_stl

BLOCK_ROWS: Final = 8
BLOCK_COLUMNS: Final = 16
"""Size of the blocks whose highest cell is remembered, and which the kernels work in."""

LIMIT_CELLS: Final = 200_000_000
LIMIT_SIDE_M: Final = 20.0
LIMIT_HEIGHT_M: Final = 1.0
STOCK_FORMAT: Final = "counterflex-stock"
STOCK_VERSION: Final = 1


@dataclass(frozen=True, eq=False)
class BlankBox:
    """A blank that is a box."""

    low_m: Float  # (3,) lowest corner in its own axes, m
    high_m: Float  # (3,) highest corner
    turn: Float  # (3, 3) rows are the axes of the box in the frame of the path


@dataclass
class HeightMap:
    """Height of the material over a regular grid in the part frame; columns stand along part z.

    Cell [j, i] is a square of side ``cell_m`` about ``(x0_m + i cell_m, y0_m + j cell_m)``; material fills
    ``bottom_m <= z <= z[j, i]``. The map can represent every part a three-axis machine can cut with the tool along
    part z; undercuts and vertical walls finer than a cell are outside its range.

    Raises:
        InputError: The grid is too small or too large, or heights are not finite or below the bottom.
    """

    x0_m: float  # x of the centre of cell [0, 0], m, part frame
    y0_m: float  # y of that centre, m
    cell_m: float  # side of a cell, m
    z: Float32  # (ny, nx) float32 top of the material, m; at least 16 cells each way
    bottom_m: float  # lower face of the stock, m; the map is never cut below it
    tops: Float32 = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Check the grid and build the block maxima."""
        if not (math.isfinite(self.cell_m) and self.cell_m > 0.0):
            raise InputError("cell size is out of range", value=self.cell_m, limit="> 0 m")
        if not all(math.isfinite(v) for v in (self.x0_m, self.y0_m, self.bottom_m)):
            raise InputError("height map origin is not finite", value=(self.x0_m, self.y0_m, self.bottom_m))
        self.z = np.ascontiguousarray(self.z, dtype=np.float32)
        _check_grid(self.z.shape, self.cell_m)
        if not np.all(np.isfinite(self.z)):
            raise InputError("height map holds a height that is not finite")
        low, high = float(self.z.min()), float(self.z.max())
        if low < self.bottom_m - 1e-6:
            raise InputError("height map reaches below its bottom", value=low, limit=f">= {self.bottom_m:g} m")
        if high - self.bottom_m > LIMIT_HEIGHT_M:
            raise InputError(
                "stock is too high",
                value=f"{high - self.bottom_m:g} m",
                limit=f"<= {LIMIT_HEIGHT_M:g} m",
                hint="Are the lengths in mm?",
            )
        self.refresh()

    def refresh(self) -> None:
        """Recompute the block maxima; call it after writing to ``z`` other than through the removal functions."""
        self.tops = block_tops(self.z)

    @classmethod
    def from_box(
        cls, corner_low_m: tuple[float, float, float], corner_high_m: tuple[float, float, float], cell_m: float
    ) -> HeightMap:
        """Make a rectangular block of stock.

        The grid covers the block from its low corner with whole cells; the block grows by less than one cell when
        its sides are no multiples of the cell.

        Args:
            corner_low_m: (x, y, z) of the lowest corner, m, part frame.
            corner_high_m: (x, y, z) of the highest corner, m, part frame.
            cell_m: Side of a cell, m.

        Raises:
            InputError: The corners are not in order, or the grid is too small or too large.
        """
        low, high = np.asarray(corner_low_m, float), np.asarray(corner_high_m, float)
        if low.shape != (3,) or high.shape != (3,) or not np.all(np.isfinite(low)) or not np.all(np.isfinite(high)):
            raise InputError("stock corners are not three finite numbers", value=(corner_low_m, corner_high_m))
        if not np.all(high > low):
            raise InputError("stock has no volume", value=(corner_low_m, corner_high_m), limit="low < high in x, y, z")
        if not (math.isfinite(cell_m) and cell_m > 0.0):
            raise InputError("cell size is out of range", value=cell_m, limit="> 0 m")
        # A side that is a whole multiple of the cell but for rounding must not get a row more.
        nx, ny = (math.ceil(round((high[k] - low[k]) / cell_m, 6)) for k in (0, 1))
        _check_grid((ny, nx), cell_m)
        z = np.full((ny, nx), high[2], dtype=np.float32)
        return cls(float(low[0] + 0.5 * cell_m), float(low[1] + 0.5 * cell_m), cell_m, z, float(low[2]))

    @classmethod
    def from_stl(cls, path: str | os.PathLike[str], cell_m: float, unit_m: float = STL_UNIT_M) -> HeightMap:
        """Make stock of the upper surface of a closed STL body.

        Args:
            path: STL file.
            cell_m: Side of a cell, m.
            unit_m: Length of one unit of the file, m; CAM systems write mm.

        Raises:
            FileFormatError: The file cannot be read, is no STL, or its surface is not closed.
            InputError: The size is implausible (wrong unit), or the grid is too small or too large.
        """
        x0, y0, bottom, heights = heights_from_stl(path, cell_m, unit_m)
        return cls(x0, y0, cell_m, heights, bottom)

    @property
    def volume_m3(self) -> float:
        """Volume of the material above the bottom, m^3."""
        return float(np.sum(self.z - np.float64(self.bottom_m), dtype=np.float64)) * self.cell_m**2

    def x_m(self) -> Float:
        """Cell centres along x, (nx,) m."""
        out: Float = self.x0_m + self.cell_m * np.arange(self.z.shape[1], dtype=np.float64)
        return out

    def y_m(self) -> Float:
        """Cell centres along y, (ny,) m."""
        out: Float = self.y0_m + self.cell_m * np.arange(self.z.shape[0], dtype=np.float64)
        return out

    def copy(self) -> HeightMap:
        """An independent copy."""
        return HeightMap(self.x0_m, self.y0_m, self.cell_m, self.z.copy(), self.bottom_m)

    def finer(self, times: int) -> HeightMap:
        """The same material on a finer grid: every cell becomes ``times`` by ``times`` cells of its height.

        Args:
            times: Whole number, >= 1.

        Raises:
            InputError: The grid is too large.
        """
        cell = self.cell_m / times
        shift = 0.5 * (cell - self.cell_m)
        _check_grid((self.z.shape[0] * times, self.z.shape[1] * times), cell)
        z = np.repeat(np.repeat(self.z, times, axis=0), times, axis=1)
        return HeightMap(self.x0_m + shift, self.y0_m + shift, cell, z, self.bottom_m)

    def finer_block(self, cell_m: float) -> HeightMap:
        """Return the same block in smaller cells, of any ratio that divides both sides evenly.

        Args:
            cell_m: Largest side of a cell, at most the present one; the cells become at most one division smaller.

        Raises:
            InputError: The top is not one plane, or the grid is too large.
        """
        if self.z.min() != self.z.max():
            raise InputError("a stock whose top is not one plane is divided by whole numbers only")
        shared = math.gcd(*self.z.shape)
        parts = math.ceil(shared * self.cell_m / cell_m - 1e-9)
        cell = self.cell_m * shared / parts
        shape = (self.z.shape[0] // shared * parts, self.z.shape[1] // shared * parts)
        shift = 0.5 * (cell - self.cell_m)
        _check_grid(shape, cell)
        z = np.full(shape, self.z.flat[0], dtype=np.float32)
        return HeightMap(self.x0_m + shift, self.y0_m + shift, cell, z, self.bottom_m)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the map as a compressed NumPy archive, whole or not at all.

        Raises:
            OutputError: The folder cannot be written.
        """
        with atomic_path(path) as part, part.open("wb") as stream:
            np.savez_compressed(
                stream,
                format=np.array(STOCK_FORMAT),
                version=np.array(STOCK_VERSION),
                origin_m=np.array([self.x0_m, self.y0_m, self.bottom_m]),
                cell_m=np.array(self.cell_m),
                z_m=self.z,
            )

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> HeightMap:
        """Read a map written by :meth:`save`, for example the result of an earlier operation as new stock.

        Raises:
            FileFormatError: The file is missing, is no stock file, or was written by a newer version.
        """
        where = str(path)
        with arrays(path, "a stock file", f"A file of {STOCK_FORMAT} is needed: simulate writes one") as data:
            if "format" not in data or str(data["format"]) != STOCK_FORMAT:
                raise FileFormatError("not a counterflex stock file", where=where)
            if int(data["version"]) > STOCK_VERSION:
                raise FileFormatError(
                    "stock file was written by a newer version",
                    where=where,
                    value=int(data["version"]),
                    limit=f"<= {STOCK_VERSION}",
                )
            x0, y0, bottom = (float(v) for v in data["origin_m"])
            return cls(x0, y0, float(data["cell_m"]), np.asarray(data["z_m"], np.float32), bottom)


def require_vertical(axis_part: Float, tolerance_rad: float = 1e-6) -> None:
    """Refuse tool axes that are not along part +z.

    Args:
        axis_part: (n, 3) unit vectors from the tool tip towards the spindle, part frame.
        tolerance_rad: Largest tilt accepted, rad.

    Raises:
        ModelError: A tool axis is tilted; a height map holds one height per column and cannot be cut so.
    """
    axis: Float = np.atleast_2d(np.asarray(axis_part, dtype=np.float64))
    tilt: Float = np.arctan2(np.hypot(axis[:, 0], axis[:, 1]), axis[:, 2])
    worst = int(np.argmax(tilt)) if len(tilt) else 0
    if len(tilt) and not tilt[worst] <= tolerance_rad:
        raise ModelError(
            "tool axis is tilted against part z",
            where=f"path point {worst}",
            value=f"{math.degrees(tilt[worst]):.4g} deg",
            limit="0 deg",
            hint="The height-map stock needs a constant tool axis along part z; align the part frame with it",
        )


def block_tops(z: Float32) -> Float32:
    """Highest cell of each block of 8 x 16 cells; the last column of blocks is shifted inside the map.

    Args:
        z: (ny, nx) heights, m, nx >= 16.

    Returns:
        (ceil(ny / 8), ceil(nx / 16)) float32 m.
    """
    ny, nx = z.shape
    rows = np.maximum.reduceat(z, np.arange(0, ny, BLOCK_ROWS), axis=0)
    starts = np.minimum(np.arange(0, nx, BLOCK_COLUMNS), nx - BLOCK_COLUMNS)
    out: Float32 = np.stack([rows[:, i : i + BLOCK_COLUMNS].max(axis=1) for i in starts], axis=1)
    return np.ascontiguousarray(out)


def _check_grid(shape: tuple[int, ...], cell_m: float) -> None:
    """Refuse grids the kernels cannot work on."""
    if len(shape) != 2 or min(shape) < BLOCK_COLUMNS:
        raise InputError(
            "height map is too coarse",
            value=f"{shape} cells of {cell_m:g} m",
            limit=f">= {BLOCK_COLUMNS} cells each way",
            hint="Make the cell smaller",
        )
    if shape[0] * shape[1] > LIMIT_CELLS or max(shape) * cell_m > LIMIT_SIDE_M:
        raise InputError(
            "height map is too large",
            value=f"{shape} cells of {cell_m:g} m",
            limit=f"<= {LIMIT_CELLS:.0e} cells and {LIMIT_SIDE_M:g} m a side",
            hint="Make the cell larger, or check that the stock is given in m",
        )
