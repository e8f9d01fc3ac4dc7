"""Axes, zeros and world of FANUC controllers."""

from __future__ import annotations

from typing import Final

from counterflex.core.arrays import Float
from counterflex.integrations.fanuc.language.program import wpr_of
from counterflex.robot.model.controller_axes import Maker


def words(R: Float) -> dict[str, float]:
    """W P R of an orientation (3, 3), deg."""
    return dict(zip(("W deg", "P deg", "R deg"), wpr_of(R), strict=True))


AXES: Final = Maker(
    "FANUC", "fanuc", (1, 1, -1, -1, -1, -1), (0.0, 0.0, -90.0, 0.0, 0.0, -180.0), "horizontal", "axis 2",
    "Operator's manual, J2/J3 interaction; world at the crossing of J1 and the height of J2", "J", words,
)  # fmt: skip
