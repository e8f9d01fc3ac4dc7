"""Rows ``[[robot.elastic_region]]`` of a cell file: compliances that differ by region of the joint space."""

from __future__ import annotations

from typing import Annotated, Final, Literal

import numpy as np
from pydantic import Field, model_validator

from counterflex.core.units import DEG
from counterflex.files.schema import Table
from counterflex.robot.model.description import ElasticRegion
from counterflex.robot.model.elastic_region import ANGLES, DIRECTIONS

Angle = Annotated[float, Field(ge=-720.0, le=720.0)]
Factor = Annotated[float, Field(ge=0.1, le=10.0)]
MOST_REGIONS: Final = 24
CLOSEST_DEG: Final = 0.1
"""Least distance of two angles: a steeper change would step the correction."""


class ElasticRegionTable(Table):
    """Factor on one compliance over the angle of one axis."""

    segment: str
    direction: Literal["tx", "ty", "tz", "rx", "ry", "rz"]
    axis: Annotated[int, Field(ge=1, le=6)]
    angles_deg: Annotated[tuple[Angle, ...], Field(min_length=ANGLES[0], max_length=ANGLES[1])]
    factors: Annotated[tuple[Factor, ...], Field(min_length=ANGLES[0], max_length=ANGLES[1])]
    source: str = ""

    @model_validator(mode="after")
    def _curve(self) -> ElasticRegionTable:
        if len(self.angles_deg) != len(self.factors):
            raise ValueError(
                f"angles_deg has {len(self.angles_deg)} values and factors {len(self.factors)}; "
                "expected one factor for every angle"
            )
        if np.min(np.diff(self.angles_deg)) < CLOSEST_DEG:
            raise ValueError(
                f"angles_deg = {', '.join(f'{a:g}' for a in self.angles_deg)} do not rise by at least {CLOSEST_DEG:g} "
                "each; list them from the lowest to the highest"
            )
        return self

    def region(self) -> ElasticRegion:
        """The same in SI."""
        return ElasticRegion(
            self.segment,
            DIRECTIONS.index(self.direction),
            self.axis - 1,
            tuple(angle * DEG for angle in self.angles_deg),
            self.factors,
        )
