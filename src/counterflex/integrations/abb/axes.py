"""Axes, zeros and world of ABB controllers."""

from __future__ import annotations

from typing import Final

from counterflex.core.arrays import Float
from counterflex.geometry import rotation
from counterflex.robot.model.controller_axes import Maker


def quaternion(R: Float) -> dict[str, float]:
    """q1 to q4 of an orientation (3, 3), the scalar first."""
    return dict(zip(("q1", "q2", "q3", "q4"), rotation.quat_wxyz(R), strict=True))


AXES: Final = Maker(
    "ABB", "rapid", (1, 1, 1, 1, 1, 1), (0.0, 0.0, -90.0, 0.0, 0.0, 0.0), None, "floor",
    "product specifications; with a parallel rod axis 3 is the forearm against the horizontal "
    "(ROS-Industrial abb_driver, J23_coupled: IRB 1400, 2400, 4400, 5400, 6400, 6660; IRB 1410: Malla and "
    "Shanmugavel 2024; IRB 8700: working range -30 to 132 deg)",
    words_of=quaternion,
)  # fmt: skip
