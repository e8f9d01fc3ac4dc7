"""Columns of material that a path with a turning tool is cut out of, tool by tool."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, as_float
from counterflex.core.errors import ModelError
from counterflex.core.records import records
from counterflex.cutting.coefficients import ForceLaw
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.mean_force import mean_force_weights
from counterflex.cutting.removal import bin_edges_rad
from counterflex.cutting.stock import HeightMap
from counterflex.cutting.tridexel.columns import ColumnStock
from counterflex.cutting.tridexel.step_kernels import RIDGE_M, SPARE, step_columns, step_space
from counterflex.plan.bending_kernels import THRUST_SIZE
from counterflex.plan.cut_kernel_arrays import CutPath, CutRows
from counterflex.plan.elastic_motion_kernel import MotionArrays
from counterflex.plan.turning_cut.kernel import TURNING_STATE, TurningTool, cut_turning_rows

ROWS_PER_CALL: Final = 500


def reach_of(cutter: Cutter, stock: HeightMap) -> float:
    """Height above the tip up to which a tool takes material away, m: its flutes, at most across the blank."""
    ny, nx = stock.z.shape
    size = np.array([nx * stock.cell_m, ny * stock.cell_m, float(stock.z.max()) - stock.bottom_m])
    return min(cutter.flute_length_m, float(np.linalg.norm(size)) + cutter.diameter_m)


class TurningCut:
    """A cut in progress.

    Args:
        stock: The blank; left as it is.
        axis_part: (n, 3) unit vectors from the tip to the spindle.
        law: Force law.
        path: As for upright cuts, n rows.
        omega: Undamped angular frequency of the mode, rad/s; 0 where nothing yields.
        zeta: Its damping ratio.
        motion: The elastic robot in motion, or what stands for none.
        rows: Results, written.
    """

    def __init__(
        self,
        stock: HeightMap,
        axis_part: Float,
        law: ForceLaw,
        path: CutPath,
        omega: float,
        zeta: float,
        motion: MotionArrays,
        rows: CutRows,
    ) -> None:
        self._blank, self.stock = stock, ColumnStock.of(stock)
        self._columns = step_columns(self.stock)
        self._axis = as_float("axis_part", axis_part, (len(path.kind), 3))
        self._law, self._path, self._rows = law, path, rows
        self._omega, self._zeta, self._motion = omega, zeta, motion
        self._states = records(TURNING_STATE)
        self.jump_to(path.p_command[0])

    def jump_to(self, tip: Float) -> None:
        """Go on at a tip (3,) m, after a way through air."""
        self._states[0].tip[:] = tip

    def cut(self, begin: int, end: int, cutter: Cutter, progress: Callable[[float], None]) -> None:
        """Cut rows [begin, end) with a tool.

        Raises:
            ModelError: A column would hold more stretches of material than the kernels can work on.
        """
        weights = mean_force_weights(cutter, self._law)
        tool = TurningTool(
            flutes=float(cutter.flutes),
            space=step_space(cutter, reach_of(cutter, self._blank)),
            terms=weights.terms,
            arc=weights.arc,
            levels=weights.levels,
            edges=bin_edges_rad(),
            depth=np.zeros((weights.n_levels, weights.n_bins)),
            extra=np.zeros(2),
            wrench_feed=np.zeros(6),
            force=np.zeros(6),
            ends=np.zeros((4, 3)),
            space_wrench=np.zeros(6),
            thrust=np.zeros(THRUST_SIZE),
        )
        state, n = self._states[0], len(self._path.kind)
        at = begin
        while at < end:
            stop = min(at + ROWS_PER_CALL, end)
            state.full = 0
            cut_turning_rows(
                at, stop, self._path, self._axis, tool, self._columns, self._omega, self._zeta, self._motion,
                self._states, self._rows,
            )  # fmt: skip
            at = stop
            if state.full:
                at = abs(int(state.full))
                self._make_room(tool, at, possible=state.full > 0)
            progress(at / n)

    def _make_room(self, tool: TurningTool, row: int, *, possible: bool) -> None:
        """Give the columns room for more stretches before a row."""
        if not possible:
            raise ModelError(
                "one row of the path leaves too many stretches of material in a column",
                where=f"row {row}",
                limit=f"at most {SPARE} more than before it",
                hint="Sample the path more finely",
            )
        self.stock.make_room(f"row {row}", SPARE, RIDGE_M)
        self._columns = step_columns(self.stock)
        tool.space.work[18] = 0.0
