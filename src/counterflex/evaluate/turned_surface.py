"""Deviation of a part that a tool cut which turned, from the simulated undisturbed one; positive = material left.

Both parts are in columns. Points of the undisturbed part lie exactly where lines along x, y and z leave what its tool
swept; the deviation of each is its signed distance to what the tool really swept, along the normal of that sweep. As
with walls of upright tools, both sweeps take the cutter as the cell file has it: what wear of its radius leaves is not
in it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float
from counterflex.core.units import UM
from counterflex.cutting.tridexel.cut_log import CutLog
from counterflex.cutting.tridexel.surface import Surface
from counterflex.evaluate.figures import DeviationFigures

JUDGED_POINTS: Final = 20_000
"""Points that a part is judged at, at most; of more every second, third ... is taken."""
STEEP: Final = 1.5
"""Slope from which on a face is a wall, as on the height map."""


@dataclass(frozen=True, eq=False)
class TurnedSurface:
    """Places at which an undisturbed part is judged."""

    points: Float  # (n, 3) m, part frame
    area_m2: Float  # (n,) area that each stands for
    wall: Bool  # (n,) whether the face is steeper than 56 degrees; the others are floor
    cell_m: float  # of the lattice whose lines the points lie on

    def deviation(self, swept: CutLog) -> TurnedDeviation:
        """Compare what a tool swept with the undisturbed part.

        Args:
            swept: All motions of the machining.
        """
        deviation = swept.distance(self.points)
        known = ~np.isnan(deviation)
        all_of, floor, wall = (
            DeviationFigures.weighted(deviation[known & which], self.area_m2[known & which])
            for which in (known, ~self.wall, self.wall)
        )
        lost = float(self.area_m2[~known].sum())
        return TurnedDeviation(deviation, all_of, floor, wall, 0.1 * UM, 0.1 * UM, lost)


@dataclass(frozen=True, eq=False)
class TurnedDeviation:
    """Deviation of one machined part; m, positive = material left."""

    deviation_m: Float  # (n,) of the points of TurnedSurface; nan beyond 5 mm
    surface: DeviationFigures  # figures over floors and walls, by area
    floor: DeviationFigures  # over floors
    wall: DeviationFigures  # over walls
    floor_resolution_m: float  # points are exact sections of the sweep; stated as 0.1 um
    wall_resolution_m: float  # likewise
    wall_lost_m2: float  # area of walls and floors with no result


def turned_surface(nominal: Surface, cell_m: float) -> TurnedSurface:
    """Points of an undisturbed part that its program made, with the area of the mesh about each."""
    corners = nominal.vertices[nominal.around]
    normal = 0.5 * np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    area = np.linalg.norm(normal, axis=1)
    made = np.flatnonzero(nominal.cut & (area > 0.0))
    stride = max(1, -(-len(made) // JUDGED_POINTS))
    some = made[::stride]
    wall = np.hypot(normal[some, 0], normal[some, 1]) > STEEP * np.abs(normal[some, 2])
    return TurnedSurface(nominal.points[some], area[some] * (area[made].sum() / area[some].sum()), wall, cell_m)
