"""The cutting process of a tool that turns: columns of material, and the axis of the tool as it really is."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import MM
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.stock import HeightMap
from counterflex.twin.plant.chip import HISTORY, OK
from counterflex.twin.plant.process import PENDING, StockCutting
from counterflex.twin.plant.turning.chip_kernel import turned_wrench
from counterflex.twin.plant.turning.column_material import ColumnMaterial, outline_of, place_tool
from counterflex.twin.truth.truth import CuttingTruth

STAMP_M: Final = 0.02 * MM
"""Way between two places of the tool at which material is taken away: a tilted flat end leaves a saw of a quarter."""
_LEVER_M: Final = 20.0 * MM  # Height on the tool at which its way is measured beside the tip


class TurningProcess(StockCutting):
    """Cuts columns of material with a tool whose tip is given step by step and whose axis is that of the plant.

    ``step_s``: Time between calls of :meth:`wrench`, s. ``T_base_part``: (4, 4) where the part truly lies.
    ``R_base_tcp``: (3, 3) live view of the axes of the tool frame; its z points out of the spindle.

    Attributes:
        material: As cut so far (call :meth:`finish_material` at the end).
    """

    def __init__(
        self,
        stock: HeightMap,
        cutter: Cutter,
        cutting: CuttingTruth,
        step_s: float,
        T_base_part: Float,
        R_base_tcp: Float,
    ) -> None:
        self.material = ColumnMaterial.of(stock)
        self._columns = (self.material.low, self.material.high, self.material.held, self.material.grid)
        self._box: Float = np.array([stock.bottom_m, float(stock.z.max())])
        self._R_base_tcp = R_base_tcp
        self._parts: Float = np.zeros((1, 3))
        self._own: Float = np.zeros(6)
        self._poses: Float = np.zeros((HISTORY, 6))
        self._axes: Float = np.zeros((PENDING, 3))
        super().__init__(stock, cutter, cutting, step_s, T_base_part)

    def mount(self, cutter: Cutter) -> None:
        """Change the tool, see :meth:`StockCutting.mount`."""
        super().mount(cutter)
        self._parts = outline_of(cutter, self._shape[2])

    @property
    def axis_part(self) -> Float:
        """(3,) unit vector from the tip to the spindle now."""
        out: Float = -(self.T_base_part[:3, :3].T @ self._R_base_tcp[:, 2])
        return out

    def restart(self, p_part: Float) -> None:
        """Forget the motion so far, see :meth:`StockCutting.restart`."""
        super().restart(p_part)
        self._poses[:, :3], self._poses[:, 3:] = p_part, self.axis_part

    def wrench(self, p_base_tcp: Float) -> Float:
        """Mean cutting wrench now, see :meth:`StockCutting.wrench`.

        Raises SimulationError: the tool cuts above its flutes, or is moved into stock with the spindle off.
        """
        R = self.T_base_part[:3, :3]
        self.p_part[:] = (p_base_tcp - self.T_base_part[:3, 3]) @ R
        status = turned_wrench(
            *self._columns, self._box, self.p_part, self.axis_part, self._poses, self._count, self._delay,
            self._turning, self._shape, self._rings, self._rims, self._faces, self._circle, self._radii, self._law,
            self._load, self._own, self.wrench_part,
        )  # fmt: skip
        self._count += 1
        w = self.wrench_part
        self._wrench_base[:3], self._wrench_base[3:] = R @ w[:3], R @ w[3:6]
        self.sums[:6] += w[:6]
        self.sums[6] = max(self.sums[6], math.sqrt(w[0] ** 2 + w[1] ** 2 + w[2] ** 2))
        self.sums[7] = max(self.sums[7], w[6])
        self.sums[8] += 1.0
        if status != OK:
            self._refuse(status)
        return self._wrench_base

    def advance(self, p_part: Float) -> None:
        """Add a point of the tool's track with the axis now; removes what lies ``lag`` behind."""
        axis = self.axis_part
        self._axes[self._head % PENDING] = axis
        turned = 0.0
        if self._head > 0:
            before = (self._head - 1) % PENDING
            lever = min(_LEVER_M, self._shape[2])
            turned = math.dist(self._trail[before, :3] + lever * self._axes[before], p_part + lever * axis)
        self._follow(p_part, turned)

    def finish_material(self) -> ColumnMaterial:
        """Remove what still trails behind the tool and return what is left."""
        self._flush()
        return self.material

    def _cut_next(self) -> None:
        one, two = self._tail % PENDING, (self._tail + 1) % PENDING
        self._tail += 1
        a, b, u, v = self._trail[one], self._trail[two], self._axes[one], self._axes[two]
        count = max(1, math.ceil((b[3] - a[3]) / STAMP_M))
        for k in range(count):
            share = (k + 1.0) / count
            axis = u + share * (v - u)
            axis /= np.linalg.norm(axis)
            while not place_tool(*self._columns, a[:3] + share * (b[:3] - a[:3]), axis, self._parts):
                self.material.make_room()
                self._columns = (self.material.low, self.material.high, self.material.held, self.material.grid)
