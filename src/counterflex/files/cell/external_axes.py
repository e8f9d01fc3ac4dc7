"""Table ``[[external_axes]]`` of a cell file: a rail under the robot, or a positioner under the part.

Such an axis stands still while an operation is cut; ``moves_mm`` or ``moves_deg`` take it to another place between two
of them. Its value moves what it carries, as a rigid body, from where that is at zero: along its direction, or about it
through its origin. Poses of the cell file hold at zero.
"""

from __future__ import annotations

import itertools
import math
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from counterflex.core.arrays import Float
from counterflex.core.units import DEG, MM
from counterflex.files.schema import Length, Table
from counterflex.path.external_axes import ExternalAxis

AxisName = Literal["E1", "E2", "E3", "E4", "E5", "E6"]
Angle = Annotated[float, Field(ge=-3600.0, le=3600.0)]
Along = Annotated[float, Field(ge=0.0, le=1e9)]
"""Place along the path of a program, mm from its first point."""
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
    moves_mm: Annotated[tuple[tuple[Along, Along, Length], ...], Field(max_length=1000)] = ()
    moves_deg: Annotated[tuple[tuple[Along, Along, Angle], ...], Field(max_length=1000)] = ()
    moves_at_mm: Annotated[tuple[tuple[Length, Length, Length], ...], Field(max_length=1000)] = ()
    coupled: bool | None = None

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
        self._check_moves(unit, other, low, high)
        if not math.isclose(float(np.linalg.norm(self.direction)), 1.0, abs_tol=1e-6):
            raise ValueError(f"the direction of {self.name} is no unit vector; got {list(self.direction)}")
        if self.kind == "turning" and self.carries == "robot" and abs(self.direction[2]) < 1.0 - 1e-6:
            raise ValueError(f"{self.name} would tilt the robot: gravity is along -z of its base, in every model here")
        return self

    def _check_moves(self, unit: str, other: str, low: float, high: float) -> None:
        if getattr(self, f"moves_{other}"):
            raise ValueError(f"{self.name} is {self.kind}: moves_{other} has no meaning; give moves_{unit}")
        if len(self.moves_at_mm) != len(self.moves):
            raise ValueError(f"moves_at_mm has one point for each of moves_{unit}: the tool's tip in the part frame")
        if any(end < begin for begin, end, _ in self.moves) or any(
            b[0] <= a[1] for a, b in itertools.pairwise(self.moves)
        ):
            raise ValueError(f"the places along the path of moves_{unit} do not rise")
        for *_, value in self.moves:
            if not low <= value <= high:
                raise ValueError(
                    f"{self.name} cannot go to {value:g} (moves_{unit}); limits {low:g} to {high:g} {unit}"
                )

    @property
    def moves(self) -> tuple[tuple[float, float, float], ...]:
        """Places along the path, mm from its first point, from and to which the axis goes to a value, mm or deg."""
        return self.moves_mm if self.kind == "linear" else self.moves_deg

    def axis(self) -> ExternalAxis:
        """The axis in SI."""
        unit, word = (MM, "mm") if self.kind == "linear" else (DEG, "deg")
        return ExternalAxis(
            int(self.name[1:]), self.kind == "turning", self.carries == "robot", np.array(self.direction),
            np.array(self.origin_mm) * MM, getattr(self, f"min_{word}") * unit, getattr(self, f"max_{word}") * unit,
        )  # fmt: skip

    @property
    def shown(self) -> float:
        """Value in the program: mm or deg."""
        value = self.at_mm if self.kind == "linear" else self.at_deg
        assert value is not None
        return value

    def matrix(self) -> Float:
        """(4, 4) by which the axis has moved what it carries from where that is at zero, robot base at zero."""
        axis = self.axis()
        out: Float = axis.matrices(np.array([self.shown * axis.unit]))[0]
        return out


def moved(axes: tuple[ExternalAxisTable, ...], carries: Literal["robot", "part"]) -> Float:
    """(4, 4) by which all axes that carry one of the two have moved it; the first axis carries the next."""
    out = np.eye(4)
    for axis in axes:
        if axis.carries == carries:
            out = out @ axis.matrix()
    return out
