"""The cutter as a body of revolution: flat end mill, ball end mill and bull nose in one description."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError

CORNER_LEVELS: Final = 8
"""Axial levels over the height of a rounded corner; 8 keep the mean force of a ball within 0.1 % of 64."""


@dataclass(frozen=True)
class Cutter:
    """A milling cutter: cylinder of radius R whose lower edge is rounded with the corner radius r.

    The outline at distance rho from the axis is at height ``f(rho) = 0`` for ``rho <= R - r`` and
    ``f(rho) = r - sqrt(r^2 - (rho - R + r)^2)`` up to R, above the tip.

    Raises:
        InputError: A length is not positive, the corner is larger than the cutter, no flute, helix of 90 deg or more.
    """

    diameter_m: float  # 2 R, m
    corner_radius_m: float = 0.0  # r, m: 0 is a flat end mill, R a ball end mill, between them a bull nose
    flutes: int = 2  # number of cutting edges N
    helix_rad: float = math.radians(30.0)  # helix angle, rad, positive for a right-handed helix (chips lifted with M3)
    flute_length_m: float = math.inf  # height above the tip over which the cutter cuts, m
    runout_m: float = 0.0  # radial offset of the cutter axis from the spindle axis, m
    runout_angle_rad: float = 0.0  # angle of that offset from the first edge, clockwise seen from the spindle, rad
    edge_radius_m: float = 0.0  # rounding of the cutting edge, m

    def __post_init__(self) -> None:
        """Check every dimension."""
        if not (math.isfinite(self.diameter_m) and self.diameter_m > 0.0):
            raise InputError("cutter diameter is out of range", value=self.diameter_m, limit="> 0 m")
        if self.diameter_m > 1.0:
            raise InputError(
                "cutter diameter is implausible", value=f"{self.diameter_m:g} m", limit="<= 1 m", hint="Is it in mm?"
            )
        if not 0.0 <= self.corner_radius_m <= self.radius_m * (1.0 + 1e-9):
            raise InputError(
                "corner radius does not fit the cutter",
                value=f"{self.corner_radius_m:g} m",
                limit=f"0 to {self.radius_m:g} m",
            )
        if self.flutes < 1 or int(self.flutes) != self.flutes:
            raise InputError("number of flutes is out of range", value=self.flutes, limit="1, 2, 3, ...")
        if not abs(self.helix_rad) < math.pi / 2.0:
            raise InputError("helix angle is out of range", value=self.helix_rad, limit="-pi/2 to pi/2 rad")
        if not self.flute_length_m > 0.0:
            raise InputError("flute length is out of range", value=self.flute_length_m, limit="> 0 m")
        for name in ("runout_m", "edge_radius_m"):
            value = getattr(self, name)
            if not (math.isfinite(value) and 0.0 <= value < self.radius_m):
                raise InputError(f"cutter {name} is out of range", value=value, limit=f"0 to {self.radius_m:g} m")
        if not math.isfinite(self.runout_angle_rad):
            raise InputError("cutter runout_angle_rad is not finite", value=self.runout_angle_rad)

    @property
    def radius_m(self) -> float:
        """R, m."""
        return 0.5 * self.diameter_m

    @property
    def is_flat(self) -> bool:
        """True for a flat end mill."""
        return self.corner_radius_m == 0.0

    @property
    def is_ball(self) -> bool:
        """True for a ball end mill."""
        return abs(self.corner_radius_m - self.radius_m) <= 1e-9 * self.radius_m

    def radius_at(self, z_m: float) -> float:
        """Radius of the outline at a height above the tip, m: ``R - r + sqrt(r^2 - (r - z)^2)`` in the corner.

        Args:
            z_m: Height above the tip, m, >= 0.

        Raises:
            InputError: The height is below the tip.
        """
        if not z_m >= 0.0:
            raise InputError("height is below the cutter tip", value=z_m, limit=">= 0 m")
        r = self.corner_radius_m
        if z_m >= r:
            return self.radius_m
        return self.radius_m - r + math.sqrt(r * r - (r - z_m) ** 2)

    @property
    def n_levels(self) -> int:
        """Number of axial levels of the engagement: 1 for a flat end mill, corner levels + 1 otherwise."""
        return 1 if self.is_flat else CORNER_LEVELS + 1

    def levels(self) -> Float:
        """Axial level boundaries above the tip, (n_levels + 1,) m, rising from 0 to infinity.

        A flat end mill has one level [0, inf). A rounded corner is divided at ``r (l / K)^2``, l = 0..K, steps of
        nearly equal surface inclination; the cylinder above is the last level.
        """
        if self.is_flat:
            return np.array([0.0, np.inf])
        steps = self.corner_radius_m * (np.arange(CORNER_LEVELS + 1) / CORNER_LEVELS) ** 2
        out: Float = np.append(steps, np.inf)
        return out

    def level_radii(self) -> Float:
        """Mean radius of the outline over each level, (n_levels,) m: ``integral of r(z) dz / height``; R on top."""
        radius, r = self.radius_m, self.corner_radius_m
        if self.is_flat:
            return np.array([radius])
        x = r - self.levels()[:-1]
        area = 0.5 * (x * np.sqrt(np.maximum(0.0, r * r - x * x)) + r * r * np.arcsin(np.clip(x / r, -1.0, 1.0)))
        mean = radius - r + (area[:-1] - area[1:]) / (x[:-1] - x[1:])
        out: Float = np.append(mean, radius)
        return out

    def level_inclinations(self) -> Float:
        """Angle kappa between the tool axis and the surface normal at each level's mean radius, (n_levels,) rad.

        90 deg on the cylinder, towards 0 at the tip: ``sin(kappa) = (r_mean - R + r) / r``.
        """
        if self.is_flat:
            return np.array([math.pi / 2.0])
        r = self.corner_radius_m
        ratio = np.clip((self.level_radii()[:-1] - self.radius_m + r) / r, 0.0, 1.0)
        out: Float = np.append(np.arcsin(ratio), math.pi / 2.0)
        return out

    def kernel_parameters(self) -> Float:
        """The numbers the sweep kernels need: R, r, number of corner levels, boundaries from 0, mean radii.

        Returns:
            (3 + 2 n_levels,) array ``[R, r, K, H_0 .. H_K, R_0 .. R_K]`` in m, with K = 0 for a flat end mill.
        """
        corner = 0.0 if self.is_flat else float(CORNER_LEVELS)
        # Kernels tell a ball by equal radii to the last bit; a file may differ there.
        r = self.radius_m if self.is_ball else self.corner_radius_m
        head = [self.radius_m, r, corner]
        out: Float = np.concatenate([head, self.levels()[:-1], self.level_radii()])
        return out
