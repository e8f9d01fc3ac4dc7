"""Axes, zeros and world of Yaskawa controllers."""

from __future__ import annotations

from typing import Final

from counterflex.core.arrays import Float
from counterflex.integrations.yaskawa.language.program import angles_of
from counterflex.robot.model.controller_axes import Maker


def words(R: Float) -> dict[str, float]:
    """Rx Ry Rz of an orientation (3, 3), deg."""
    return dict(zip(("Rx deg", "Ry deg", "Rz deg"), angles_of(R), strict=True))


AXES: Final = Maker(
    "Yaskawa", "inform", (1, 1, -1, -1, -1, -1), (0.0, 0.0, -90.0, 0.0, 0.0, -180.0), "upper_arm", "axis 2",
    "ROS-Industrial motoman, urdf of GP25: S L +, U R B T -; all at zero is upper arm upright, forearm level, x of the "
    "flange up; world of the maker on axis 1 at the height of axis 2", "", words,
)  # fmt: skip
"""S L U R B T. Arms whose U is counted from the horizontal say ``axis_3_from`` in the cell file."""
