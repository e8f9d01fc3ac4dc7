"""Regions of the part and of external axes: wishes in shop units, regions in SI."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from counterflex.app.placement.frame import ProgramInCell
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import DEG, MM
from counterflex.files.cell.cell import Cell
from counterflex.files.cell.external_axes import ExternalAxisTable
from counterflex.plan.placement.search import PlacementBounds, usual_region

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
