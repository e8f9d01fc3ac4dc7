"""Table ``[[external_axes]]`` of a cell file: a rail under the robot, or a positioner under the part.

Such an axis stands still while a program runs. Its value moves what it carries, as a rigid body, from where that is at
zero: along its direction, or about it through its origin. Poses of the cell file hold at zero.
"""

from __future__ import annotations

import math
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from counterflex.core.arrays import Float
from counterflex.core.units import DEG, MM
from counterflex.files.schema import Length, Table
from counterflex.geometry import pose, rotation

AxisName = Literal["E1", "E2", "E3", "E4", "E5", "E6"]
Angle = Annotated[float, Field(ge=-3600.0, le=3600.0)]
_UNITS = {"linear": "mm", "turning": "deg"}


class ExternalAxisTable(Table):
    """One axis, its range, and where it stands."""

    name: AxisName
    kind: Literal["linear", "turning"]
    carries: Literal["robot", "part"]
    direction: tuple[float, float, float]
    origin_mm: tuple[Length, Length, Length] = (0.0, 0.0, 0.0)
    at_mm: Length | None = None
    min_mm: Length | None = None
    max_mm: Length | None = None
    at_deg: Angle | None = None
    min_deg: Angle | None = None
    max_deg: Angle | None = None

    @model_validator(mode="after")
    def _fits(self) -> ExternalAxisTable:
        unit, other = _UNITS[self.kind], "deg" if self.kind == "linear" else "mm"
        for key in ("at", "min", "max"):
            if getattr(self, f"{key}_{other}") is not None:
                raise ValueError(f"{self.name} is {self.kind}: {key}_{other} has no meaning; give {key}_{unit}")
            if getattr(self, f"{key}_{unit}") is None:
                raise ValueError(f"{self.name} is {self.kind}: {key}_{unit} is missing")
        low, at, high = (getattr(self, f"{key}_{unit}") for key in ("min", "at", "max"))
        if not low <= at <= high:
            raise ValueError(f"{self.name} cannot stand there: at_{unit} = {at:g}; limits {low:g} to {high:g} {unit}")
        if not math.isclose(float(np.linalg.norm(self.direction)), 1.0, abs_tol=1e-6):
            raise ValueError(f"the direction of {self.name} is no unit vector; got {list(self.direction)}")
        if self.kind == "turning" and self.carries == "robot" and abs(self.direction[2]) < 1.0 - 1e-6:
            raise ValueError(f"{self.name} would tilt the robot: gravity is along -z of its base, in every model here")
        return self

    @property
    def shown(self) -> float:
        """Value in the program: mm or deg."""
        value = self.at_mm if self.kind == "linear" else self.at_deg
        assert value is not None
        return value

    def matrix(self) -> Float:
        """(4, 4) by which the axis has moved what it carries from where that is at zero, robot base at zero."""
        axis = np.array(self.direction)
        if self.kind == "linear":
            return pose.make(np.eye(3), axis * self.shown * MM)
        R = rotation.exp(axis * self.shown * DEG)
        origin = np.array(self.origin_mm) * MM
        return pose.make(R, origin - R @ origin)


def moved(axes: tuple[ExternalAxisTable, ...], carries: Literal["robot", "part"]) -> Float:
    """(4, 4) by which all axes that carry one of the two have moved it; the first axis carries the next."""
    out = np.eye(4)
    for axis in axes:
        if axis.carries == carries:
            out = out @ axis.matrix()
    return out
