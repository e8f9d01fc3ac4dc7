"""Axes, zeros and world of KUKA controllers."""

from __future__ import annotations

from typing import Final

from counterflex.robot.model.controller_axes import Maker

AXES: Final = Maker(
    "KUKA", "krl", (-1, 1, 1, -1, 1, -1), (0.0, -90.0, 0.0, 0.0, 0.0, 0.0), "upper_arm", "floor",
    "data sheets: A1 0, A2 -90, A3 90 is upper arm upright, forearm level; $ROBROOT on the base plate", "A",
    set_up="rsi.xml",
)  # fmt: skip
