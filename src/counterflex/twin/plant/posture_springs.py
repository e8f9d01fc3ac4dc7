"""Springs of the true cell that are other in other postures."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.twin.plant.mjcf import Coordinates
from counterflex.twin.truth.truth import Truth

_FADE_RAD: Final = math.radians(10.0)


class PostureSprings:
    """Stiffness of every elastic coordinate over the motor angles.

    ``truth``: With ``regions``; without, nothing changes.

    Attributes:
        free: (k,) coordinates with a spring of the engine's own, all but the torsion of driven bodies.
    """

    def __init__(self, truth: Truth, coordinates: Coordinates) -> None:
        self._mean = coordinates.stiffness
        self._regions = truth.regions
        names = [body.name for body in truth.bodies]
        self._place = [
            int(np.flatnonzero((coordinates.body == names.index(r.segment)) & (coordinates.kind == r.direction))[0])
            for r in truth.regions
        ]
        self.free: Int = np.flatnonzero((coordinates.kind >= 0) & (coordinates.axis < 0))

    def __bool__(self) -> bool:
        """Whether any spring changes."""
        return bool(self._regions)

    @property
    def stiffest(self) -> Float:
        """(n,) N/m, N m/rad, in the posture in which each is stiffest."""
        out = self._mean.copy()
        for region, place in zip(self._regions, self._place, strict=True):
            out[place] /= min(1.0, *region.factors)
        return out

    def stiffness(self, q: Float) -> Float:
        """(n,) N/m, N m/rad at the motor angles q (6,) rad; 0 for motors."""
        out = self._mean.copy()
        for region, place in zip(self._regions, self._place, strict=True):
            angle = float(q[region.axis])
            inside = float(np.clip(angle, region.angles_rad[0], region.angles_rad[-1]))
            factor = float(np.interp(inside, region.angles_rad, region.factors))
            near = max(0.0, 1.0 - abs(angle - inside) / _FADE_RAD)
            out[place] /= 1.0 + (factor - 1.0) * near
        return out
