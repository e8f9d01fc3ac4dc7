"""The cutting process in the part frame: stock, tool, force, and removal that trails the tool.

Material is taken out of the map a few cells of travel behind the tool (``lag``), so that the edge always looks at
stock the previous teeth have not touched, free of the staircase of the cells just cut.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError, SimulationError
from counterflex.core.units import MM
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.stock import HeightMap
from counterflex.twin.plant.chip import ANGLES, CORNER_SLICES, END_RINGS, HISTORY, OK, SHANK, coupled_wrench, cut
from counterflex.twin.truth.other import ToolOff
from counterflex.twin.truth.truth import CuttingTruth

LAG_CELLS = 4.0
PENDING = 1 << 12


def end_rings(cutter: Cutter) -> Float:
    """Rings of the end face, which reaches the centre: (n, 2) radius and edge length, m."""
    inner = cutter.radius_m - cutter.corner_radius_m
    if inner < 1e-9:
        return np.zeros((0, 2))
    step = inner / END_RINGS
    return np.array([((k + 0.5) * step, step) for k in range(END_RINGS)])


def corner_slices(cutter: Cutter) -> tuple[Float, Float]:
    """Slices of the rounded corner, equal steps of kappa.

    Returns rims (K + 1, 2): radius and height, m; slices (K, 5): radius, height, edge length, m, sin and cos of kappa.
    """
    corner, inner = cutter.corner_radius_m, cutter.radius_m - cutter.corner_radius_m
    if corner == 0.0:
        return np.array([[cutter.radius_m, 0.0]]), np.zeros((0, 5))
    rim = np.linspace(0.0, 0.5 * np.pi, CORNER_SLICES + 1)
    mid = 0.5 * (rim[1:] + rim[:-1])
    rims = np.stack([inner + corner * np.sin(rim), corner * (1.0 - np.cos(rim))], axis=1)
    length = np.full_like(mid, corner * (rim[1] - rim[0]))
    faces = [inner + corner * np.sin(mid), corner * (1.0 - np.cos(mid)), length, np.sin(mid), np.cos(mid)]
    return np.ascontiguousarray(rims), np.ascontiguousarray(np.stack(faces, axis=1))


def as_ground(cutter: Cutter, off: ToolOff) -> Cutter:
    """A cutter with its true diameter; a ball stays one, another corner keeps its radius."""
    if off.diameter_m == 0.0:
        return cutter
    diameter = cutter.diameter_m + off.diameter_m
    corner = 0.5 * diameter if cutter.is_ball else min(cutter.corner_radius_m, 0.5 * diameter)
    return replace(cutter, diameter_m=diameter, corner_radius_m=corner)


def force_law(cutting: CuttingTruth) -> Float:
    """The law as (10,) numbers: ``k h_ref^m`` of c r a, exponents ``1 - m``, ploughing N/m, its onset m."""
    k, m = np.array(cutting.k_pa), np.array(cutting.exponent)
    return np.concatenate([k * cutting.h_ref_m**m, 1.0 - m, np.array(cutting.edge_n_m), [cutting.edge_onset_m]])


class StockCutting:
    """Cuts a height map with a tool whose tip is given step by step.

    ``stock``: Height map in the part frame; a copy is cut. ``step_s``: Time between calls of :meth:`wrench`, s.
    ``T_base_part``: (4, 4) where the part truly lies.

    Attributes:
        stock: The map as cut so far (call :meth:`finish` at the end).
        p_part: (3,) m, tool tip at the last call.
        wrench_part: (7,) force N, moment N m about the tip on the tool in part axes, engaged axial depth m.
        sums: (9,) since :meth:`clear`: sums of the force and moment, largest force, largest depth, calls.
    """

    def __init__(
        self, stock: HeightMap, cutter: Cutter, cutting: CuttingTruth, step_s: float, T_base_part: Float
    ) -> None:
        self.stock = stock.copy()
        self.T_base_part: Float = np.array(T_base_part, dtype=np.float64, order="C")
        self.p_part: Float = np.zeros(3)
        self.sums: Float = np.zeros(9)
        self._wrench_base: Float = np.zeros(6)
        self.step_s = step_s
        self._grid: Float = np.array([stock.x0_m, stock.y0_m, stock.cell_m, stock.bottom_m])
        angle = (np.arange(ANGLES) + 0.5) * (2.0 * np.pi / ANGLES)
        self._circle: Float = np.ascontiguousarray(np.stack([np.cos(angle), np.sin(angle)], axis=1))
        self._runout_m = cutting.runout_m
        self._law = force_law(cutting)
        self._history: Float = np.zeros((HISTORY, 3))
        self._load: Float = np.zeros(3)
        self.wrench_part: Float = np.zeros(7)
        self._count = 0
        self._lag = LAG_CELLS * stock.cell_m
        self._trail: Float = np.zeros((PENDING, 4))  # x, y, z, travel
        self._head = 0
        self._tail = 0
        self._top = float(stock.z.max())
        self.mount(cutter)

    def mount(self, cutter: Cutter) -> None:
        """Change the tool; the spindle stands still, and what the last one cut is out of the stock.

        Call :meth:`restart` before the new tool cuts.
        """
        self._flush()
        flute = min(cutter.flute_length_m, 1.0)
        self._shape: Float = np.array([cutter.radius_m, cutter.corner_radius_m, flute])
        self._rings = end_rings(cutter)
        self._rims, self._faces = corner_slices(cutter)
        self._teeth = int(cutter.flutes)
        turn = 2.0 * np.pi * np.arange(self._teeth) / self._teeth
        self._radii: Float = self._runout_m * np.cos(turn) if self._teeth > 1 else np.zeros(1)
        self.spindle(0.0)

    def spindle(self, speed_rad_s: float) -> None:
        """Set the spindle speed, rad/s, positive clockwise seen from the spindle, 0 standing still.

        Raises InputError: so slow that a tooth period exceeds the remembered motion (about 2 s).
        """
        self._turning = float(np.sign(speed_rad_s))
        period = 2.0 * math.pi / (abs(speed_rad_s) * self._teeth) if speed_rad_s else self.step_s
        self._delay = period / self.step_s
        if self._delay > HISTORY - 2:
            raise InputError(
                "the spindle turns too slowly for the simulation",
                value=f"{speed_rad_s:g} rad/s",
                limit=f"a tooth every {HISTORY * self.step_s:.1f} s or faster",
            )

    def clear(self) -> None:
        """Start new sums."""
        self.sums[:] = 0.0

    def restart(self, p_part: Float) -> None:
        """Forget the motion so far (after a jump through air) and start at ``p_part`` (3,) m."""
        self._flush()
        self._count = 0
        self._history[:] = p_part
        self._head, self._tail = 0, 0

    def wrench(self, p_base_tcp: Float) -> Float:
        """Mean cutting wrench now; call once per step.

        ``p_base_tcp``: (3,) m, tool tip in base coordinates.

        Returns:
            (6,) N, N m on the tool about the tip in base axes; overwritten by the next call. ``p_part``,
            ``wrench_part`` and ``sums`` are set as well.

        Raises:
            SimulationError: The tool cuts above its flutes, or is moved into stock with the spindle off.
        """
        status = coupled_wrench(
            self.stock.z, self._grid, p_base_tcp, self.T_base_part, self._history, self._count, self._delay,
            self._turning, self._shape, self._rings, self._rims, self._faces, self._circle, self._radii, self._law,
            self._load, self.p_part, self.wrench_part, self._wrench_base, self.sums,
        )  # fmt: skip
        self._count += 1
        if status != OK:
            self._refuse(status)
        return self._wrench_base

    def _refuse(self, status: int) -> None:
        where = "part x {:.2f} y {:.2f} z {:.2f} mm".format(*(self.p_part / MM))
        if status == SHANK:
            raise SimulationError(
                "the tool is deeper in the stock than its flutes are long",
                where=where,
                value=f"{self.wrench_part[6] / MM:.2f} mm",
                limit=f"{self._shape[2] / MM:.2f} mm",
            )
        raise SimulationError(
            "the tool is moved into the stock with the spindle off", where=where, hint="Start the spindle (M3 S...)"
        )

    def advance(self, p_part: Float) -> None:
        """Add a point of the tool's track, a few ms after the last; removes what lies ``lag`` behind.

        ``p_part``: (3,) m, tool tip in the part frame.
        """
        self._follow(p_part, 0.0)

    def _follow(self, p_part: Float, least_m: float) -> None:
        """Add a point that is at least a way behind the last."""
        head, trail = self._head, self._trail
        travel = 0.0
        if head > 0:
            last = trail[(head - 1) % PENDING]
            travel = last[3] + max(math.dist(last[:3], p_part), least_m)
        row = trail[head % PENDING]
        row[:3], row[3] = p_part, travel
        self._head = head + 1
        while self._tail + 1 < self._head and (
            travel - trail[(self._tail + 1) % PENDING, 3] >= self._lag or self._head - self._tail >= PENDING - 1
        ):
            self._cut_next()

    def finish(self) -> HeightMap:
        """Remove what still trails behind the tool and return the as-machined stock."""
        self._flush()
        self.stock.refresh()
        return self.stock

    def _flush(self) -> None:
        while self._tail + 1 < self._head:
            self._cut_next()

    def _cut_next(self) -> None:
        a, b = self._trail[self._tail % PENDING], self._trail[(self._tail + 1) % PENDING]
        self._tail += 1
        if min(a[2], b[2]) >= self._top:
            return
        cut(self.stock.z, self._grid, a[0], a[1], a[2], b[0], b[1], b[2], self._shape)
