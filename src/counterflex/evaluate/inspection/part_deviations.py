"""Deviations of a measured part from its nominal surface: one row per measured place."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, Int, as_float
from counterflex.core.errors import InputError

FACES: Final = ("floor", "wall", "free")
"""Names of the faces by their number: machined floor, machined wall, face that the program does not machine."""
FLOOR, WALL, FREE = range(3)


@dataclass(frozen=True, eq=False)
class PartDeviations:
    """Deviation of a measured part from its nominal surface, part frame.

    Raises:
        InputError: Lengths differ, a value is not finite, a normal has no unit length, a standard deviation is negative
            or a face has no such number.
    """

    points: Float  # (n, 3) m, points on the nominal surface
    normals: Float  # (n, 3) unit normals of the nominal surface there, out of the material
    deviation_m: Float  # (n,) m, actual minus nominal along the normal: positive = material left
    # (n,) m, of each deviation: noise of the measurement and uncertainty of the pose in which it was placed on the
    # nominal part
    standard_deviation_m: Float
    face: Int  # (n,) number in FACES

    def __post_init__(self) -> None:
        """Check the rows."""
        n = len(as_float("points", self.points, (None, 3)))
        as_float("normals", self.normals, (n, 3))
        as_float("deviation_m", self.deviation_m, (n,))
        as_float("standard_deviation_m", self.standard_deviation_m, (n,))
        length = np.linalg.norm(self.normals, axis=1)
        for wrong, what, value, limit in (
            (np.abs(length - 1.0) > 1e-6, "a normal has no unit length", length, "1"),
            (self.standard_deviation_m < 0.0, "a standard deviation is negative", self.standard_deviation_m, ">= 0"),
            ((self.face < 0) | (self.face >= len(FACES)), "there is no such face", self.face, "0 (floor) to 2 (free)"),
        ):
            if np.any(wrong):
                row = int(np.argmax(wrong))
                raise InputError(what, where=f"row {row}", value=f"{value[row]:g}", limit=limit)

    def __len__(self) -> int:
        """Number of measured places."""
        return len(self.deviation_m)

    def turned(self, R: Float | None) -> PartDeviations:
        """The same in other axes: R, (3, 3), holds those of now by columns; None: they are the same."""
        return self if R is None else replace(self, points=self.points @ R.T, normals=self.normals @ R.T)
