"""Rotation of the tool about its own axis along a path: over its length, which no feed and no sampling changes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import MM

NEAR_M: Final = 25.0 * MM
"""How far along the path a place may have moved: a compensated program is a little longer or shorter."""
APART_M: Final = 5.0 * MM
"""How far from the path a place may lie: more than a correction."""
_STEP_M: Final = 1.0 * MM


@dataclass(frozen=True)
class ToolRotation:
    """Rotation about the tool axis over the length of the programmed path, linear between the places given."""

    length_m: tuple[float, ...]  # places, m from the first point of the program, rapids counted; rising
    # rotation there, not limited to a turn; constant before the first place and behind the last
    angle_rad: tuple[float, ...]
    # (x, y, z) m in the part frame of the tool tip at each place, by which another program is told apart; none where
    # they have not been looked up, see placed
    p_part: tuple[tuple[float, float, float], ...] = ()

    def __post_init__(self) -> None:
        """Check lengths and order."""
        if len(self.length_m) != len(self.angle_rad) or not self.length_m:
            raise InputError("a turning has as many angles as places, and at least one", value=len(self.angle_rad))
        if np.any(np.diff(self.length_m) <= 0.0):
            raise InputError("the places of a turning do not rise")
        if self.p_part and len(self.p_part) != len(self.length_m):
            raise InputError("a turning has one point for each place", value=len(self.p_part), limit=len(self.length_m))

    def along(self, p_part_tcp: Float) -> Float:
        """Rotations at the points of a path.

        Args:
            p_part_tcp: (n, 3) m, all points of the program in their order.

        Returns:
            (n,) rad.
        """
        out: Float = np.interp(_lengths(p_part_tcp), self.length_m, self.angle_rad)
        return out

    def placed(self, p_part_tcp: Float) -> ToolRotation:
        """The same with the points at its places.

        Args:
            p_part_tcp: (n, 3) m, all points of the program that it was chosen for.
        """
        points = _points(p_part_tcp, np.asarray(self.length_m))
        return replace(self, p_part=tuple((float(x), float(y), float(z)) for x, y, z in points))

    def distance(self, p_part_tcp: Float) -> tuple[float, float]:
        """Distance of a program from the one that the turning was chosen for.

        Each of ``p_part`` is looked for within :data:`NEAR_M` of its place along the path.

        Args:
            p_part_tcp: (n, 3) m, all points of the program in their order.

        Returns:
            Largest distance of a point to the path, m, and the place along the path where it was expected, m; more
            than :data:`APART_M` is another program. Zeros without points.
        """
        around = np.arange(-NEAR_M, NEAR_M + 0.5 * _STEP_M, _STEP_M)
        worst = (0.0, 0.0)
        for place, point in zip(self.length_m, self.p_part, strict=False):
            near = _points(p_part_tcp, place + around)
            worst = max(worst, (float(np.linalg.norm(near - point, axis=1).min()), place))
        return worst


def _lengths(p_part_tcp: Float) -> Float:
    step = np.linalg.norm(np.diff(p_part_tcp, axis=0, prepend=p_part_tcp[:1]), axis=1)
    out: Float = np.cumsum(step)
    return out


def _points(p_part_tcp: Float, length_m: Float) -> Float:
    """(k, 3) m, points of a path at lengths along it; its ends beyond them."""
    along = _lengths(p_part_tcp)
    return np.stack([np.interp(length_m, along, column) for column in p_part_tcp.T], axis=1)
