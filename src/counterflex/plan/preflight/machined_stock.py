"""Distance of bodies to the stock as it is machined so far, along a path.

The blank's box is what most bodies are compared with: as long as they keep their clearance to it, they keep it to what
is left of the blank. Where they do not, the program is cut up to that row, and the body is compared with the columns of
the height map. Of a tool that turns in the cut the map holds the highest material of each column: what lies below an
overhang counts as filled.
"""

from __future__ import annotations

import itertools
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.progress import silent
from counterflex.cutting.stock import BLOCK_COLUMNS, BLOCK_ROWS, HeightMap
from counterflex.path.toolpath import ToolPath
from counterflex.plan.cut import any_tilted, cut
from counterflex.plan.cut_kernel_arrays import CutPath, CutRows
from counterflex.plan.elastic_motion import STILL
from counterflex.plan.inputs import Setting
from counterflex.plan.preflight.bodies import Body
from counterflex.plan.turning_cut.cut import TurningCut

_GOLDEN: Final = 0.5 * (np.sqrt(5.0) - 1.0)
_STEPS: Final = 24
"""Golden sections of a column: its closest height is known to 1e-5 of its length."""


class MachinedStock:
    """The stock while a program is cut.

    Args:
        path: n rows; the spindle turns clockwise in all of them.
        blank: Left as it is.
        setting: Tools and force law.
    """

    def __init__(self, path: ToolPath, blank: HeightMap, setting: Setting) -> None:
        self._path, self._setting, self._done = path, setting, 0
        self._stock = blank.copy()
        self._turned = _turning_cut(path, blank, setting) if any_tilted(path, blank, setting.cutter_of) else None

    @property
    def cell_m(self) -> float:
        """Side of a column, m: distances are known to half of it."""
        return self._stock.cell_m

    def cut_to(self, row: int) -> None:
        """Cut the program up to a row; rows come in rising order.

        Args:
            row: Index.
        """
        if row <= self._done:
            return
        if self._turned is None:
            part = _rows(self._path, self._done, row + 1)
            cut(part, part.p_part_tcp, self._stock, self._setting.cutter_of, self._setting.law)
        else:
            tool = self._path.tool
            first = self._done + 1
            changes = np.flatnonzero(np.diff(tool[first : row + 1])) + first + 1
            for begin, end in itertools.pairwise([first, *changes.tolist(), row + 1]):
                self._turned.cut(begin, end, self._setting.cutter_of(int(tool[begin])), silent)
            self._stock = self._turned.stock.tops()
        self._done = row

    def distance(self, body: Body, T_stock_body: Float, most_m: float) -> float:
        """Signed distance of a body to the material, m.

        Args:
            body: It.
            T_stock_body: (4, 4) m, its pose in the frame of the stock.
            most_m: Distances from here on need not be told apart.

        Returns:
            To half a column where the body is near; ``most_m`` where it is farther away.
        """
        stock, best = self._stock, most_m
        ny, nx = stock.z.shape
        j, i = np.arange(stock.tops.shape[0]) * BLOCK_ROWS, np.arange(stock.tops.shape[1]) * BLOCK_COLUMNS
        i = np.minimum(i, nx - BLOCK_COLUMNS)
        half = 0.5 * stock.cell_m * np.hypot(BLOCK_ROWS, BLOCK_COLUMNS)
        x, y = np.meshgrid(
            stock.x0_m + (i + 0.5 * (BLOCK_COLUMNS - 1)) * stock.cell_m,
            stock.y0_m + (j + 0.5 * (BLOCK_ROWS - 1)) * stock.cell_m,
        )
        tops = stock.tops.astype(np.float64)
        solid = tops > stock.bottom_m + 1e-9
        block_j, block_i = np.nonzero(solid)
        to_block = _to_columns(body, T_stock_body, x[solid], y[solid], tops[solid], stock.bottom_m) - half
        for k in np.argsort(to_block):
            if to_block[k] >= best:
                break
            rows = np.arange(j[block_j[k]], min(j[block_j[k]] + BLOCK_ROWS, ny))
            columns = np.arange(i[block_i[k]], i[block_i[k]] + BLOCK_COLUMNS)
            z = stock.z[np.ix_(rows, columns)].astype(np.float64)
            there = z > stock.bottom_m + 1e-9
            if np.any(there):
                cx, cy = np.meshgrid(stock.x0_m + columns * stock.cell_m, stock.y0_m + rows * stock.cell_m)
                near = _to_columns(body, T_stock_body, cx[there], cy[there], z[there], stock.bottom_m)
                best = min(best, float(near.min()))
        return best


def _turning_cut(path: ToolPath, blank: HeightMap, setting: Setting) -> TurningCut:
    n = len(path)
    rows = CutRows(np.zeros((n, 6)), np.zeros((n, 6)), *(np.zeros(n) for _ in range(6)))
    kind = np.ascontiguousarray(path.kind, dtype=np.int64)
    command = CutPath(path.p_part_tcp, kind, path.time_s, path.spindle_rad_s, np.zeros((n, 6, 6)), np.zeros((n, 3)))
    return TurningCut(blank, path.axis_part, setting.law, command, 0.0, 1.0, STILL, rows)


def _rows(path: ToolPath, begin: int, end: int) -> ToolPath:
    time = path.time_s[begin:end] - path.time_s[begin]
    return ToolPath(
        path.p_part_tcp[begin:end], path.axis_part[begin:end], path.kind[begin:end], path.feed_m_s[begin:end],
        path.spindle_rad_s[begin:end], time, path.motion[begin:end], path.tool[begin:end],
    )  # fmt: skip


def _to_columns(body: Body, T_stock_body: Float, x: Float, y: Float, top: Float, bottom_m: float) -> Float:
    """(k,) m, signed distances of a convex body to upright columns: a convex function of the height, by its least."""
    R, t = T_stock_body[:3, :3], T_stock_body[:3, 3]
    foot = np.stack([x, y, np.zeros_like(x)], axis=1) @ R - t @ R
    up = R[2]
    low, high = np.full_like(x, bottom_m), top.copy()
    a, b = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    at_a, at_b = (signed_distance(body, foot + z[:, None] * up) for z in (a, b))
    for _ in range(_STEPS):
        lower = at_a < at_b
        low, high = np.where(lower, low, a), np.where(lower, b, high)
        a, b = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
        at_a, at_b = (signed_distance(body, foot + z[:, None] * up) for z in (a, b))
    ends = [signed_distance(body, foot + z[:, None] * up) for z in (np.full_like(x, bottom_m), top)]
    out: Float = np.minimum.reduce([at_a, at_b, *ends])
    return out


def signed_distance(body: Body, p_body: Float) -> Float:
    """(k,) m, signed distance of points (k, 3) m in the frame of a body to its surface, negative inside.

    Outside of a mesh it is the distance to the nearest plane of its hull: never more than the true one.
    """
    size = body.size_m
    out: Float
    if body.shape == "mesh":
        planes = np.asarray(body.planes)
        out = np.max(p_body @ planes[:, :3].T + planes[:, 3], axis=1)
    elif body.shape == "box":
        beyond = np.abs(p_body) - np.array(size)
        out = np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(axis=1), 0.0)
    else:
        side, along = np.linalg.norm(p_body[:, :2], axis=1), np.abs(p_body[:, 2]) - size[1]
        if body.shape == "capsule":
            out = np.hypot(side, np.maximum(along, 0.0)) - size[0]
            return out
        side = side - size[0]
        out = np.hypot(np.maximum(side, 0.0), np.maximum(along, 0.0)) + np.minimum(np.maximum(side, along), 0.0)
    return out
