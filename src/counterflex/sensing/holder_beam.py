"""Closed-form model of a two-cheek spindle holder: the strain under each gauge for any load.

Two prismatic Euler-Bernoulli cheeks, clamped at z = 0, joined at z = L by a rigid ring that carries the spindle. Holder
frame: z along the cheeks to the spindle, x through both cheeks, y across them. With the tip flexibility of a cantilever
the ring's six displacements follow from ``sum A^T k A``, and from them section forces and surface strain

    eps_z = N / EA + Mx y / EIx - My x / EIy,  gamma = 1.5 V / (G A) (1 - r^2) + torsion

A full bridge of two gauges at the angle a to z and two across it, scaled to show the strain of a bar under tension,
reads ``eps_z cos 2a + gamma sin 2a / (1 + nu)``. It serves as what is known before a calibration, and to choose places
for gauges; a calibration corrects it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Float, as_float, as_positive
from counterflex.core.errors import InputError
from counterflex.geometry import wrench
from counterflex.geometry.rotation import skew

_NEAR = 0.5e-3  # m, within which a gauge counts as on a surface


@dataclass(frozen=True)
class Gauge:
    """One full bridge.

    Attributes:
        p_holder_gauge: x, y, z m in the holder frame, on a surface of a cheek.
        angle_rad: Of the active gauges to z, towards y on faces across x, towards x on edges across y.
        factor: By which the notch raises the strain.
    """

    p_holder_gauge: tuple[float, float, float]
    angle_rad: float = 0.0
    factor: float = 1.0


@dataclass(frozen=True)
class HolderBeam:
    """Dimensions of the holder.

    Attributes:
        length_m: L, from the clamped end to the ring.
        distance_m: Between the middles of the cheeks, along x.
        thickness_m: Of a cheek, along x.
        width_m: Of a cheek, along y.
    """

    length_m: float
    distance_m: float
    thickness_m: float
    width_m: float
    e_pa: float = 210e9
    poisson_ratio: float = 0.3

    def __post_init__(self) -> None:
        """Check that the dimensions are those of a holder.

        Raises:
            InputError: Not positive, or cheeks that meet.
        """
        for name in ("length_m", "distance_m", "thickness_m", "width_m", "e_pa"):
            as_positive(f"holder: {name}", getattr(self, name))
        if self.thickness_m >= self.distance_m:
            raise InputError("the cheeks of the holder overlap", value=self.thickness_m, limit=f"< {self.distance_m}")

    def sensitivity(self, gauges: Sequence[Gauge]) -> Float:
        """Strain shown per unit of load.

        Returns:
            (n, 6) 1/N and 1/(N m): strain per force and moment about the holder's origin in its axes.

        Raises:
            InputError: A gauge sits on no surface of a cheek.
        """
        return np.stack([self._gauge(g) for g in gauges]) if gauges else np.zeros((0, 6))

    def tip_stiffness(self) -> Float:
        """(6, 6) stiffness of one cheek at its tip."""
        L, e, t, b = self.length_m, self.e_pa, self.thickness_m, self.width_m
        area, ix, iy = t * b, t * b**3 / 12.0, b * t**3 / 12.0
        c = np.zeros((6, 6))
        c[0, 0], c[0, 4], c[4, 4] = L**3 / (3 * e * iy), L**2 / (2 * e * iy), L / (e * iy)
        c[1, 1], c[1, 3], c[3, 3] = L**3 / (3 * e * ix), -(L**2) / (2 * e * ix), L / (e * ix)
        c[4, 0], c[3, 1] = c[0, 4], c[1, 3]
        c[2, 2], c[5, 5] = L / (e * area), L / (self._g * self._torsion)
        return np.asarray(np.linalg.inv(c), dtype=np.float64)

    @property
    def _g(self) -> float:
        return self.e_pa / (2.0 * (1.0 + self.poisson_ratio))

    @property
    def _torsion(self) -> float:
        t, b = sorted((self.thickness_m, self.width_m))
        return b * t**3 * (1.0 / 3.0 - 0.21 * t / b * (1.0 - t**4 / (12.0 * b**4)))

    def tip_loads(self) -> tuple[Float, Float]:
        """Loads on the tips of the cheeks at -x and +x per unit load about the holder's origin: two (6, 6)."""
        k = self.tip_stiffness()
        maps = []
        for side in (-0.5, 0.5):
            A = np.eye(6)
            A[:3, 3:] = -skew(np.array([side * self.distance_m, 0.0, 0.0]))
            maps.append(A)
        ring = np.linalg.inv(sum(A.T @ k @ A for A in maps))
        at_ring = np.stack([wrench.shift(w, np.array([0.0, 0.0, -self.length_m])) for w in np.eye(6)], axis=1)
        low, right = (k @ A @ ring @ at_ring for A in maps)
        return low, right

    def _gauge(self, gauge: Gauge) -> Float:
        x, y, z = as_float("place of a gauge", gauge.p_holder_gauge, (3,))
        side = 1 if x > 0.0 else 0
        x = float(x) - (side - 0.5) * self.distance_m
        t, b = self.thickness_m, self.width_m
        face = abs(abs(x) - 0.5 * t) < _NEAR and abs(y) <= 0.5 * b + _NEAR
        edge = abs(abs(y) - 0.5 * b) < _NEAR and abs(x) <= 0.5 * t + _NEAR
        if not (face or edge) or not -_NEAR <= z <= self.length_m + _NEAR:
            raise InputError(
                "a gauge sits on no surface of a cheek",
                value=[round(1e3 * v, 2) for v in gauge.p_holder_gauge],
                limit=f"|x| = {500 * (self.distance_m - t):g} or {500 * (self.distance_m + t):g} mm, or |y| = "
                f"{500 * b:g} mm; z 0..{1e3 * self.length_m:g} mm",
            )
        tip = self.tip_loads()[side]
        lever = self.length_m - float(z)
        mx, my = tip[3] - lever * tip[1], tip[4] + lever * tip[0]
        area = t * b
        eps = tip[2] / area + mx * y / (t * b**3 / 12.0) - my * x / (b * t**3 / 12.0)
        twist = tip[5] * min(t, b) / self._torsion
        if face:
            shear = 1.5 * tip[1] / area * (1.0 - (2.0 * y / b) ** 2) + twist * np.sign(x)
        else:
            shear = 1.5 * tip[0] / area * (1.0 - (2.0 * x / t) ** 2) - 0.75 * twist * np.sign(y)
        a = 2.0 * gauge.angle_rad
        out: Float = gauge.factor * (
            eps / self.e_pa * math.cos(a) + shear / self._g * math.sin(a) / (1.0 + self.poisson_ratio)
        )
        return out
