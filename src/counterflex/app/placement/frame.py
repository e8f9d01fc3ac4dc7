"""Turn a candidate into a pose of the part and values of external axes in a cell file, and place both."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import DEG, MM
from counterflex.files.cell.cell import Cell
from counterflex.files.cell.external_axes import ExternalAxisTable, moved
from counterflex.files.cell.set_up import POSE_KEYS
from counterflex.files.schema import PoseTable
from counterflex.geometry import pose
from counterflex.plan.placement.search import CandidatePoses, placed


@dataclass(frozen=True)
class Stand:
    """A candidate as a cell file has it."""

    part: dict[str, float]  # Keys of ``[part]``, mm and deg; of ``[tcp]`` where the robot holds the part
    axes: dict[str, float]  # Values of the external axes by name, mm or deg


@dataclass(frozen=True, eq=False)
class ProgramInCell:
    """A program in its cell."""

    cell: Cell  # The cell, perhaps in the working plane of a tilted tool
    middle: Float  # (3,) m, middle of what is cut, frame of the program; 0 where the robot holds the part

    @property
    def axes(self) -> tuple[ExternalAxisTable, ...]:
        """External axes."""
        return self.cell.tables.external_axes

    @property
    def table(self) -> PoseTable:
        """Table of the cell file that says where it stands: ``[part]``, or ``[tcp]`` of a spindle that stands."""
        return self.cell.tables.tcp if self.cell.holds_part else self.cell.part

    @cached_property
    def T_zero_program(self) -> Float:
        """(4, 4) present frame of the program, or of the spindle, in the robot base, external axes at zero."""
        carried = self.cell.T_base_floor @ moved(self.axes, "part")
        T_base_tcp = self.cell.T_base_tcp
        out: Float = pose.inverse(carried) @ (self.cell.T_base_part if T_base_tcp is None else T_base_tcp)
        return out

    @property
    def may_turn(self) -> bool:
        """A rotation about z of the base changes more than the free rotation about the tool axis does."""
        return not self.cell.holds_part or abs(float(self.T_zero_program[2, 2])) < 1.0 - 1e-9

    @cached_property
    def here(self) -> Float:
        """(4 + k,) the present candidate: x and y of the middle, z of the frame, no rotation, values of axes."""
        T = self.T_zero_program
        level = (T[:3, :3] @ self.middle + T[:3, 3])[:2]
        return np.array([*level, T[2, 3], 0.0, *(axis.shown * _unit(axis) for axis in self.axes)])

    def stand(self, place: Float) -> Stand:
        """The candidate as a cell file has it, to 0.1 mm and 0.01 deg; what stays keeps its pose exactly."""
        now = self.table
        keys = {key: float(getattr(now, key)) for key in POSE_KEYS}
        if not np.allclose(place[:4], self.here[:4], rtol=0.0, atol=1e-9):
            p = placed(place[:4], self.middle, self.T_zero_program[:3, :3])[:3, 3] / MM
            a = (now.a_deg + place[3] / DEG + 180.0) % 360.0 - 180.0
            keys |= dict(zip(POSE_KEYS[:4], (*np.round(p, 1).tolist(), round(float(a), 2)), strict=True))
        values: dict[str, float] = {}
        for axis, value in zip(self.axes, place[4:], strict=True):
            digits = 1 if axis.kind == "linear" else 2
            values[axis.name] = _within(axis, round(float(value / _unit(axis)), digits))
        return Stand(keys, values)

    def at(self, stand: Stand) -> CandidatePoses:
        """Return where the program (or the spindle) and the floor then are."""
        p, angles = [stand.part[k] * MM for k in POSE_KEYS[:3]], [stand.part[k] * DEG for k in POSE_KEYS[3:]]
        T = pose.from_xyz_zyx(np.array(p), np.array(angles)) @ pose.inverse(self.table.matrix())
        return self._seen(T @ self.T_zero_program, [stand.axes[axis.name] for axis in self.axes])

    def seen(self, place: Float) -> CandidatePoses:
        """Return where program and floor are in a candidate, not rounded."""
        T = placed(place[:4], self.middle, self.T_zero_program[:3, :3])
        return self._seen(T, [float(v / _unit(axis)) for axis, v in zip(self.axes, place[4:], strict=True)])

    def _seen(self, T_zero_program: Float, values: list[float]) -> CandidatePoses:
        if not self.axes:
            return CandidatePoses(T_zero_program)
        axes = tuple(
            axis.model_copy(update={"at_mm" if axis.kind == "linear" else "at_deg": value})
            for axis, value in zip(self.axes, values, strict=True)
        )
        T_base_floor, T_before_floor = pose.inverse(moved(axes, "robot")), self.cell.T_base_floor
        T_base_before = T_base_floor @ pose.inverse(T_before_floor)
        return CandidatePoses(T_base_floor @ moved(axes, "part") @ T_zero_program, T_base_before)


def _unit(axis: ExternalAxisTable) -> float:
    return MM if axis.kind == "linear" else DEG


def _within(axis: ExternalAxisTable, value: float) -> float:
    """A rounded value, not beyond the limits that it was rounded over."""
    unit = "mm" if axis.kind == "linear" else "deg"
    return float(min(max(value, getattr(axis, f"min_{unit}")), getattr(axis, f"max_{unit}")))
