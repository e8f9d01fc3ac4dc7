"""Axes, zeros, world and types of posture of Yaskawa controllers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from counterflex.core.arrays import Float
from counterflex.integrations.yaskawa.language.program import angles_of
from counterflex.robot.model.controller_axes import Maker

_HALF: Final = math.pi
_QUARTER: Final = 0.5 * math.pi


def words(R: Float) -> dict[str, float]:
    """Rx Ry Rz of an orientation (3, 3), deg."""
    return dict(zip(("Rx deg", "Ry deg", "Rz deg"), angles_of(R), strict=True))


AXES: Final = Maker(
    "Yaskawa", "inform", (1, 1, -1, -1, -1, -1), (0.0, 0.0, -90.0, 0.0, 0.0, -180.0), "upper_arm", "axis 2",
    "ROS-Industrial motoman, urdf of GP25: S L +, U R B T -; all at zero is upper arm upright, forearm level, x of the "
    "flange up; world of the maker on axis 1 at the height of axis 2", "", words,
)  # fmt: skip
"""S L U R B T. Arms whose U is counted from the horizontal say ``axis_3_from`` in the cell file."""


def rconf(branch: str, axes_rad: Sequence[float]) -> str:
    """The six flags of RCONF that mean something in a posture, with commas between.

    Source: DX100, Instructions for data transmission, RCONF; NX100, Operator's manual, "Manipulator types": flip (0)
    where R is within a quarter turn of 0, upper arm (0) or lower arm, front (0) or rear, then R, T and S within half a
    turn (0) or beyond.

    Args:
        branch: Such as ``front up noflip``.
        axes_rad: (6,) axes as the controller shows them.
    """
    arm, elbow, _ = branch.split()
    s, r, t = axes_rad[0], axes_rad[3], axes_rad[5]
    near = r - 2.0 * math.pi * round(r / (2.0 * math.pi))
    flags = (
        not -_QUARTER < near <= _QUARTER,
        elbow != "up",
        arm != "front",
        *(not -_HALF < a <= _HALF for a in (r, t, s)),
    )
    return ",".join(str(int(flag)) for flag in flags)
