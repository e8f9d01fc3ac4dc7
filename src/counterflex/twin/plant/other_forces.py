"""Forces of the other kinds of physics of a truth, added to those of drives, friction and loads at every step."""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.twin.plant.gear_curves import apply_gears, gear_parameters, gear_torque, wind_up
from counterflex.twin.plant.mjcf import Coordinates
from counterflex.twin.truth.truth import Truth


class OtherForces:
    """What the other kinds of a truth do to a plant.

    Args:
        truth: With other kinds.
        coordinates: Of the truth.
        stiffness: (6,) N m/rad, live, of the torsions.
        half_band: (6,) rad, of the dead bands.
        friction: False leaves out hysteresis.
    """

    def __init__(
        self, truth: Truth, coordinates: Coordinates, stiffness: Float, half_band: Float, *, friction: bool
    ) -> None:
        self._torsion: Int = coordinates.torsion
        self._stiffness, self._band = stiffness, half_band
        self._curves = gear_parameters(truth.other.gears)
        if not friction:
            self._curves[:, 5:7] = 0.0
        self._gear_slip: Float = np.zeros(6)
        self._gear_angle: Float = np.zeros(6)
        self._curved = [gear.axis for gear in truth.other.gears]

    def apply(self, q_all: Float, force: Float) -> None:
        """Add them to ``force`` (n,) at the coordinates ``q_all`` (n,), and advance what remembers."""
        apply_gears(
            q_all, self._torsion, self._stiffness, self._band, self._curves, self._gear_slip, self._gear_angle, force
        )

    def bend(self, target: Float, net: Float) -> None:
        """Put the wind-ups of curved gears in place of the straight springs' in a search for the equilibrium.

        Args:
            target: (n,) coordinates of straight springs without dead band, changed.
            net: (n,) generalised forces that they balance.
        """
        for i in self._curved:
            t = self._torsion[i]
            target[t] = wind_up(float(net[t]), float(self._stiffness[i]), self._curves[i])

    def spring(self, axis: int, angle: float, straight: float) -> float:
        """Torque of an axis' gear at a wind-up, N m, without hysteresis; ``straight`` where the gear is not curved."""
        if axis not in self._curved:
            return straight
        return gear_torque(angle, float(self._stiffness[axis]), float(self._band[axis]), self._curves[axis])

    def rest(self, q_all: Float) -> None:
        """Relax what remembers, at the coordinates ``q_all`` (n,) of an equilibrium."""
        self._gear_slip[:] = 0.0
        self._gear_angle[:] = np.where(self._torsion >= 0, q_all[self._torsion], 0.0)
