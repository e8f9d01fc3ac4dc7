"""Distance of bodies to the stock as it is machined so far, along a path.

The blank's box is what most bodies are compared with: as long as they keep their clearance to it, they keep it to what
is left of the blank. Where they do not, the program is cut up to that row, and the body is compared with the columns of
the height map. Of a tool that turns in the cut the map holds the highest material of each column: what lies below an
overhang counts as filled.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.progress import silent
from counterflex.core.units import MM
from counterflex.cutting.stock import BLOCK_COLUMNS, HeightMap
from counterflex.geometry import pose
from counterflex.path.toolpath import ToolPath
from counterflex.plan.cut import any_tilted, cut
from counterflex.plan.cut_kernel_arrays import CutPath, CutRows
from counterflex.plan.elastic_motion import STILL
from counterflex.plan.inputs import Setting
from counterflex.plan.preflight.bodies import STOCK, Body
from counterflex.plan.preflight.column_distance_kernel import BOX, CAPSULE, CYLINDER, MESH, stock_distance
from counterflex.plan.turning_cut.cut import TurningCut

SIDE_M: Final = 0.5 * MM
"""Side of the columns that bodies are compared with: finer ones cost time and change no clearance."""
SHAPES: Final = {"box": BOX, "capsule": CAPSULE, "cylinder": CYLINDER, "mesh": MESH}


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
        self._coarse = coarse(self._stock)
        self._turned = _turning_cut(path, blank, setting) if any_tilted(path, blank, setting.cutter_of) else None

    @property
    def cell_m(self) -> float:
        """Side of a column, m: distances are known to half of it."""
        return self._coarse.cell_m

    def cut_to(self, row: int) -> None:
        """Cut the program up to a row; rows come in rising order."""
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
        self._coarse = coarse(self._stock)
        self._done = row

    def distance(self, body: Body, T_stock_body: Float, most_m: float) -> float:
        """Signed distance of a body to the material, m.

        Args:
            T_stock_body: (4, 4) m, its pose in the frame of the stock.
            most_m: Distances from here on need not be told apart.

        Returns:
            To a column where the body is near, never too large; ``most_m`` where it is farther away.
        """
        stock = self._coarse
        grid = np.array([stock.x0_m, stock.y0_m, stock.cell_m, stock.bottom_m])
        size = np.array([*body.size_m, 0.0, 0.0][:3])
        planes = np.zeros((0, 4)) if body.faces is None else np.ascontiguousarray(body.faces)
        T_frame = np.ascontiguousarray(T_stock_body, dtype=np.float64)
        return stock_distance(SHAPES[body.shape], size, planes, T_frame, stock.z, stock.tops, grid, np.zeros(3), most_m)


class LeftOver:
    """Machined stock along the path, in place of its box.

    Args:
        stock: The stock while the program is cut.
        bodies: The bodies; one of them is the blank's box.
        near_m: Pairs with the box that come nearer are compared with what is left.
    """

    def __init__(self, stock: MachinedStock, bodies: Sequence[Body], near_m: float) -> None:
        self.near_m, self.grain_m = near_m, stock.cell_m
        self._stock, self._bodies = stock, bodies
        self._box = next((k for k, body in enumerate(bodies) if body.name == STOCK and body.assumed), -1)

    def distance(self, pair: tuple[int, int], row: int, Ts_base_body: Float, most_m: float, least_m: float) -> float:
        """Signed distance of a pair at a row, m; minus infinity where it is not one with the blank.

        The stock only shrinks: a distance to what was left at an earlier row is no larger than the true one, and is
        returned where it is no new least distance.

        Args:
            pair: Indices of the bodies.
            row: Of the path, rising from call to call.
            Ts_base_body: (k, 4, 4) m, poses of all bodies.
            most_m: Distances from here on need not be told apart.
            least_m: Least distance of the rows before.
        """
        if self._box not in pair:
            return -np.inf
        other = pair[0] if pair[1] == self._box else pair[1]
        T_frame_box = self._bodies[self._box].T_frame_body
        T_base_box = Ts_base_body[self._box]
        T_base_frame = T_base_box @ pose.inverse(T_frame_box)
        T_base_body = Ts_base_body[other]
        T_frame_body = pose.inverse(T_base_frame) @ T_base_body
        most_m = min(most_m, self.near_m)
        before = self._stock.distance(self._bodies[other], T_frame_body, most_m)
        if before >= min(least_m, most_m):
            return before
        self._stock.cut_to(row)
        return self._stock.distance(self._bodies[other], T_frame_body, most_m)


def coarse(stock: HeightMap) -> HeightMap:
    """The stock in columns of about :data:`SIDE_M`, each as high as the highest of those that it stands for."""
    ny, nx = stock.z.shape
    times = max(1, min(int(SIDE_M / stock.cell_m), nx // BLOCK_COLUMNS, ny // BLOCK_COLUMNS))
    if times == 1:
        return stock
    room = np.full((-(-ny // times) * times, -(-nx // times) * times), stock.bottom_m, np.float32)
    room[:ny, :nx] = stock.z
    rows = np.maximum.reduce([room[k::times] for k in range(times)])
    z = np.maximum.reduce([rows[:, k::times] for k in range(times)])
    shift = 0.5 * (times - 1) * stock.cell_m
    return HeightMap(stock.x0_m + shift, stock.y0_m + shift, times * stock.cell_m, z, stock.bottom_m)


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
        path.place[begin:end],
    )  # fmt: skip
