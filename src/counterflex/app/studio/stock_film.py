"""The stock as it is cut along the points of a program: a coarse height map, and what each stretch takes from it."""

from __future__ import annotations

import base64
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from counterflex.app.studio.tool_way import ToolWay
from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.errors import ModelError
from counterflex.cutting.removal import remove_path
from counterflex.cutting.stock import BLOCK_COLUMNS, HeightMap
from counterflex.path.toolpath import FEED

CELLS: Final = 100
"""Cells along the longer side of the blank: drawn without a graphics card in as much time as the robot."""
STATES: Final = 240
"""States along a program: half a second each of a program of two minutes."""
MOST: Final = 1_000_000
"""Changes that are sent to the browser, 8 bytes each; a program with more gets fewer states."""
_LEAST_M: Final = 2e-5
"""A cell that is lowered by less keeps its height: smaller than a pixel."""


@dataclass(frozen=True, eq=False)
class StockFilm:
    """m states of a stock; a state differs from the one before by some cells that became lower."""

    blank: HeightMap  # Before the first cut
    R_part_plane: Float  # (3, 3) axes of the map in the part frame
    point: Int  # (m,) drawn point of the way at which each state is reached
    end: Int  # (m,) changes up to each state
    cell: Int  # (changes,) number of a cell, row by row
    top_m: Float  # (changes,) its new height

    @classmethod
    def of(cls, way: ToolWay, stopped: Callable[[], bool] = lambda: False) -> StockFilm | None:
        """Cut the blank along the drawn points of a way.

        Rapids take nothing away: what they would hit is a matter of the check, not of the picture.

        Args:
            stopped: Asked between two states; True ends the work.

        Returns:
            None where it was stopped.

        Raises:
            CounterflexError: The cell has no blank or no such tool, or the tool turns: no height map holds that.
        """
        cell = way.cell
        if cell is None or cell.tool_turns or cell.holds_part:
            raise ModelError("stock is cut in 3-D only where the part stands and the tool keeps its direction")
        R = np.eye(3) if cell.R_part_plane is None else cell.R_part_plane
        blank = coarse(cell.stock())
        stock, seen = blank.copy(), blank.z.copy()
        rows = way.drawn_rows
        p = way.p_part[rows] * 1e-3 @ R
        tool = way.tool[rows]
        states = np.unique(np.linspace(1, len(rows), STATES).astype(np.int64))
        changes: list[tuple[Int, Float]] = []
        cuts = _cuts(way.cutting, rows)
        first = 1
        for last in states:
            if stopped():
                return None
            for begin, end in _runs(cuts[first:last], tool[first:last]):
                some = slice(first + begin - 1, first + end)
                kind = np.full(end - begin, FEED)
                remove_path(stock, p[some], kind, cell.cutter(int(tool[first + begin])), engagement=False)
            lower: Int = np.flatnonzero(seen.reshape(-1) - stock.z.reshape(-1) > _LEAST_M)
            seen.reshape(-1)[lower] = stock.z.reshape(-1)[lower]
            changes.append((lower, seen.reshape(-1)[lower].astype(np.float64)))
            first = int(last)
        points, changes = _thinned(states - 1, changes)
        ends: Int = np.cumsum([len(one) for one, _ in changes])
        cells, tops = (np.concatenate(one) for one in zip(*changes, strict=True))
        return cls(blank, R, points, ends, cells, tops)

    def drawn(self) -> dict[str, Any]:
        """Plain values for the browser; arrays as base 64 of little-endian numbers."""
        ny, nx = self.blank.z.shape
        return {
            "nx": nx,
            "ny": ny,
            "corner": [self.blank.x0_m - 0.5 * self.blank.cell_m, self.blank.y0_m - 0.5 * self.blank.cell_m],
            "side": self.blank.cell_m,
            "bottom": self.blank.bottom_m,
            "turn": self.R_part_plane.reshape(-1).tolist(),
            "blank": _text(self.blank.z, "<f4"),
            "point": self.point.tolist(),
            "end": self.end.tolist(),
            "cell": _text(self.cell, "<u4"),
            "top": _text(self.top_m, "<f4"),
        }


def coarse(stock: HeightMap, cells: int = CELLS) -> HeightMap:
    """Return a map with at most so many cells along its longer side, of the highest points in them.

    A narrow stock keeps the least number of cells across. The last row and column may reach beyond the stock by less
    than a cell.
    """
    times = min(-(-max(stock.z.shape) // cells), min(stock.z.shape) // BLOCK_COLUMNS)
    if times < 2:
        return stock
    ny, nx = stock.z.shape
    z = np.pad(stock.z, ((0, -ny % times), (0, -nx % times)), mode="edge")
    tops = z.reshape(z.shape[0] // times, times, z.shape[1] // times, times).max(axis=(1, 3))
    shift = 0.5 * (times - 1) * stock.cell_m
    return HeightMap(stock.x0_m + shift, stock.y0_m + shift, times * stock.cell_m, tops, stock.bottom_m)


def _cuts(cutting: Float, rows: Int) -> Bool:
    """(n,) all of the way from the drawn point before is feed; nothing leads to the first one."""
    feeds = np.concatenate([[0.0], np.cumsum(cutting)])
    count = feeds[rows[1:] + 1] - feeds[rows[:-1] + 1]
    return np.concatenate([[False], count == np.diff(rows)])


def _runs(cuts: Bool, tool: Int) -> list[tuple[int, int]]:
    """First and end of each stretch that cuts with one tool."""
    if not len(cuts):
        return []
    new = np.flatnonzero(np.concatenate([[True], (np.diff(cuts.astype(int)) != 0) | (np.diff(tool) != 0)]))
    pairs = zip(new.tolist(), [*new[1:].tolist(), len(cuts)], strict=True)
    return [(begin, end) for begin, end in pairs if cuts[begin]]


def _thinned(points: Int, changes: list[tuple[Int, Float]]) -> tuple[Int, list[tuple[Int, Float]]]:
    """Join every two states until there are few enough changes; a cell counts once in a joined state."""
    while sum(len(cell) for cell, _ in changes) > MOST and len(changes) > 1:
        joined = []
        for k in range(0, len(changes), 2):
            cell, top = (np.concatenate(one) for one in zip(*changes[k : k + 2], strict=True))
            kept, place = np.unique(cell[::-1], return_index=True)
            joined.append((kept, top[::-1][place]))
        points, changes = np.append(points[1::2], points[-1:] if len(points) % 2 else []).astype(np.int64), joined
    return points, changes


def _text(values: Any, kind: str) -> str:
    return base64.b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode("ascii")
