"""Table ``[robot.dh]`` of a cell file: any six-axis arm by its Denavit-Hartenberg rows."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from counterflex.core.units import DEG, MM
from counterflex.files.schema import Angle, Length, Table
from counterflex.robot.model.description import Robot
from counterflex.robot.model.dh import AXES, DhRow, from_dh

Mass = Annotated[float, Field(ge=0.0, le=5000.0)]


class DhRowTable(Table):
    """One axis: ``theta = sign q + offset``, and the body that it carries."""

    a_mm: Length = 0.0
    d_mm: Length = 0.0
    alpha_deg: Angle = 0.0
    offset_deg: Angle = 0.0
    sign: Literal[-1, 1] = 1
    limits_deg: tuple[Angle, Angle]
    mass_kg: Mass = 0.0
    com_x_mm: Length = 0.0
    com_y_mm: Length = 0.0
    com_z_mm: Length = 0.0


class DhTable(Table):
    """Six axes from the base outward."""

    convention: Literal["standard", "modified"] = "standard"
    axes: Annotated[list[DhRowTable], Field(min_length=AXES, max_length=AXES)]

    def robot(self, name: str) -> Robot:
        """The robot in SI."""
        rows = [
            DhRow(
                a_m=row.a_mm * MM,
                d_m=row.d_mm * MM,
                alpha_rad=row.alpha_deg * DEG,
                offset_rad=row.offset_deg * DEG,
                sign=float(row.sign),
                limits_rad=(row.limits_deg[0] * DEG, row.limits_deg[1] * DEG),
                mass_kg=row.mass_kg,
                p_axis_com=(row.com_x_mm * MM, row.com_y_mm * MM, row.com_z_mm * MM),
            )
            for row in self.axes
        ]
        return from_dh(name, rows, self.convention)
