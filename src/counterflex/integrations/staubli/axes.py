"""Axes, zeros and world of Staubli controllers."""

from __future__ import annotations

from typing import Final

from counterflex.core.arrays import Float
from counterflex.integrations.staubli.language.program import rotations_of
from counterflex.robot.model.controller_axes import Maker


def words(R: Float) -> dict[str, float]:
    """Rotations about x, y', z'' of an orientation (3, 3), deg."""
    return dict(zip(("rx deg", "ry deg", "rz deg"), rotations_of(R), strict=True))


AXES: Final = Maker(
    "Staubli", "val3", (1, 1, 1, 1, 1, 1), (0.0,) * 6, "upper_arm", "axis 2",
    "pose shown on the pendant of an RX160, reached within 0.1 mm (tests/references/controller_arms.py)", "J", words,
)  # fmt: skip
