"""Regions of the part and of external axes: wishes in shop units, regions in SI.

Mounting of the spindle: an angle of a body of the end effector, one of several that a shop can have.

Turning the body turns all beyond it, with its mass and its compliance; a shop has such choices as holders or shims.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import DEG, MM
from counterflex.files.cell.cell import Cell, resolve
from counterflex.files.cell.external_axes import ExternalAxisTable, moved
from counterflex.files.cell.set_up import POSE_KEYS
from counterflex.files.schema import PoseTable
from counterflex.geometry import pose
from counterflex.plan.placement.search import CandidatePoses, PlacementBounds, placed, usual_region


@dataclass(frozen=True)
class Mounting:
    """Angles to choose from."""

    body: str  # Name of a body of the end effector, or ``tcp``
    key: str  # ``a_deg``, ``b_deg`` or ``c_deg``
    values_deg: tuple[float, ...]  # Angles that can be had, besides the present one

    def present_deg(self, cell: Cell) -> float:
        """The angle that a cell file has. Raises InputError: the cell has no such body, or holds the part."""
        if self.body == "tcp":
            return float(getattr(cell.tables.tcp, self.key))
        for table in cell.tables.end_effector:
            if table.name == self.body:
                return float(getattr(table, self.key))
        raise InputError(
            "the end effector has no such body",
            where="--mounting",
            value=self.body,
            limit=", ".join([*(table.name for table in cell.tables.end_effector), "tcp"]),
        )

    def cell(self, cell: Cell, value_deg: float) -> Cell:
        """The cell with the spindle mounted at another angle."""
        tables = cell.tables
        change = {self.key: value_deg}
        if self.body == "tcp":
            tables = tables.model_copy(update={"tcp": tables.tcp.model_copy(update=change)})
        else:
            bodies = tuple(b.model_copy(update=change) if b.name == self.body else b for b in tables.end_effector)
            tables = tables.model_copy(update={"end_effector": bodies})
        return resolve(tables, Path(cell.path), assume_class=cell.class_stiffness is not None)


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


ANY_TURN: Final = (-180.0, 180.0)


@dataclass(frozen=True)
class Wish:
    """Wish for the place of the part."""

    # Least and largest x and y of the middle of the program, and z of the part frame, robot base at zero of the
    # external axes; where the robot holds the part x, y and z of the tip of the spindle. None: as
    # :func:`counterflex.plan.placement.search.usual_region` has it; in a cell with external axes the part (or the
    # spindle) stays where it is clamped.
    box_mm: tuple[float, ...] | None = None
    # Least and largest rotation about z, from the present one; None: any, in a cell with external axes only together
    # with ``box_mm``; none for a vertical spindle that stands
    turned_deg: tuple[float, ...] | None = None
    # Least and largest value of external axes, mm or deg, by name; those that are not named stand still. None: all over
    # their whole range.
    axes: Mapping[str, tuple[float, float]] | None = field(default=None)

    def region(self, frame: ProgramInCell) -> PlacementBounds:
        """The region that is searched.

        Raises:
            InputError: It is empty, an axis is not there or cannot go so far, or the robot has no closed-form geometry
                and no region is given.
        """
        cell = frame.cell
        low, high = self._part(frame)
        names, units = ["x", "y", "z", "the rotation"], [MM, MM, MM, DEG]
        for axis in cell.tables.external_axes:
            unit = MM if axis.kind == "linear" else DEG
            least, most = self._range(axis)
            low, high = [*low, least * unit], [*high, most * unit]
            names, units = [*names, axis.name], [*units, unit]
        for name, least, most, unit in zip(names, low, high, units, strict=True):
            if least > most:
                raise InputError(
                    f"the region is empty along {name}",
                    value=f"{least / unit:g} to {most / unit:g}",
                    limit="the least first",
                    hint="Give --region X0,X1,Y0,Y1,Z0,Z1, --turned A,B and --axis NAME=A,B with the least first",
                )
        self._require_axes(cell)
        return PlacementBounds(tuple(low), tuple(high))

    def _part(self, frame: ProgramInCell) -> tuple[list[float], list[float]]:
        """Bounds of x, y, z and rotation."""
        here: Float = frame.here
        free = self.box_mm is not None or not frame.cell.tables.external_axes
        turned = self.turned_deg or (ANY_TURN if free and frame.may_turn else (0.0, 0.0))
        angles = [a * DEG for a in turned]
        if self.box_mm is not None:
            return [*(v * MM for v in self.box_mm[::2]), angles[0]], [*(v * MM for v in self.box_mm[1::2]), angles[1]]
        if not free:
            return [*here[:3].tolist(), angles[0]], [*here[:3].tolist(), angles[1]]
        opw = frame.cell.controller_chain.opw
        if opw is None:
            raise InputError("the reach of this robot is not known", where=frame.cell.label, hint="Give --region")
        usual = usual_region(opw)
        return [*usual.low[:3], angles[0]], [*usual.high[:3], angles[1]]

    def _range(self, axis: ExternalAxisTable) -> tuple[float, float]:
        """Least and largest value of an axis in its unit."""
        unit = "mm" if axis.kind == "linear" else "deg"
        least, most = (float(getattr(axis, f"{key}_{unit}")) for key in ("min", "max"))
        if self.axes is None:
            return least, most
        if axis.name not in self.axes:
            return axis.shown, axis.shown
        requested = self.axes[axis.name]
        if min(requested) < least or max(requested) > most:
            raise InputError(
                f"{axis.name} cannot go so far",
                where="--axis",
                value=f"{requested[0]:g} to {requested[1]:g} {unit}",
                limit=f"{least:g} to {most:g} {unit} (external_axes)",
            )
        return requested

    def _require_axes(self, cell: Cell) -> None:
        names = [axis.name for axis in cell.tables.external_axes]
        for name in self.axes or {}:
            if name not in names:
                raise InputError(
                    "the cell has no such external axis",
                    where="--axis",
                    value=name,
                    limit=", ".join(names) or "none: no [[external_axes]] in the cell file",
                )


def shown(values: tuple[float, ...], cell: Cell) -> list[float]:
    """Bounds of a region in shop units: mm, deg."""
    units = [MM, MM, MM, DEG, *(MM if axis.kind == "linear" else DEG for axis in cell.tables.external_axes)]
    out: list[float] = np.round(np.array(values) / np.array(units), 2).tolist()
    return out
