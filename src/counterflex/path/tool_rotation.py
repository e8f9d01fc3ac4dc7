"""How the tool turns about its own axis along a path: over its length, which no feed and no sampling changes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError


@dataclass(frozen=True)
class ToolRotation:
    """Rotation about the tool axis over the length of the programmed path, linear between the places given.

    Attributes:
        length_m: Places, m from the first point of the program, rapids counted; rising.
        angle_rad: Rotation there, not limited to a turn; constant before the first place and behind the last.
    """

    length_m: tuple[float, ...]
    angle_rad: tuple[float, ...]

    def __post_init__(self) -> None:
        """Check lengths and order."""
        if len(self.length_m) != len(self.angle_rad) or not self.length_m:
            raise InputError("a turning has as many angles as places, and at least one", value=len(self.angle_rad))
        if np.any(np.diff(self.length_m) <= 0.0):
            raise InputError("the places of a turning do not rise")

    def along(self, p_part_tcp: Float) -> Float:
        """Rotations at the points of a path.

        Args:
            p_part_tcp: (n, 3) m, all points of the program in their order.

        Returns:
            (n,) rad.
        """
        step = np.linalg.norm(np.diff(p_part_tcp, axis=0, prepend=p_part_tcp[:1]), axis=1)
        out: Float = np.interp(np.cumsum(step), self.length_m, self.angle_rad)
        return out
