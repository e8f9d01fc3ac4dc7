"""Modes of a structure as the tool tip sees them, by natural frequency, damping ratio and mass-normalised shape.

In modal coordinates eta of unit mass, with the shapes U at the tip,

    q = U eta,    eta_j'' + 2 zeta_j omega_j eta_j' + omega_j^2 eta_j = u_j' F

and the frequency response at the tip is ``G(i w) = sum_j u_j u_j' / (omega_j^2 - w^2 + 2 i zeta_j omega_j w)``.

Source: Altintas 2012, Manufacturing Automation, ch. 3 (modal analysis of machine tools).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Bool, Complex, Float, Int, as_float
from counterflex.core.errors import InputError

DIMENSIONS = 3
"""x, y, z of the frame that the shapes are given in."""


@dataclass(frozen=True, eq=False)
class TipModes:
    """Modes seen at the tool tip.

    Raises:
        InputError: Shapes do not match, or a frequency or a damping ratio is out of range.
    """

    omega_rad_s: Float  # (n,) natural angular frequencies, > 0
    damping_ratio: Float  # (n,) in (0, 1)
    shape: Float  # (3, n) 1/sqrt(kg), displacement of the tip per unit of the modal coordinate (modal mass 1 kg)

    def __post_init__(self) -> None:
        """Check every number."""
        omega = as_float("omega_rad_s", self.omega_rad_s, (None,))
        zeta = as_float("damping_ratio", self.damping_ratio, (len(omega),))
        as_float("shape", self.shape, (DIMENSIONS, len(omega)))
        if np.any(omega <= 0.0):
            raise InputError("natural frequency is out of range", value=float(omega.min()), limit="> 0 rad/s")
        if np.any((zeta <= 0.0) | (zeta >= 1.0)):
            worst = float(zeta[int(np.argmax(np.abs(zeta - 0.5)))])
            raise InputError("damping ratio is out of range", value=worst, limit="above 0, below 1")

    def __len__(self) -> int:
        """Number of modes."""
        return len(self.omega_rad_s)

    def turned(self, R: Float) -> TipModes:
        """The same modes in other axes: ``R`` (3, 3) takes vectors of the present frame to the new one."""
        return TipModes(self.omega_rad_s, self.damping_ratio, R @ self.shape)

    def only(self, chosen: Bool | Int) -> TipModes:
        """Those of the modes that a mask or indices (n,) choose."""
        return TipModes(self.omega_rad_s[chosen], self.damping_ratio[chosen], self.shape[:, chosen])

    def response(self, omega_rad_s: Float) -> Complex:
        """Frequency response at the tip, (len(omega), 3, 3) m/N."""
        w = omega_rad_s[:, None]
        gain = 1.0 / (self.omega_rad_s**2 - w**2 + 2.0j * self.damping_ratio * self.omega_rad_s * w)
        out: Complex = np.einsum("in,wn,jn->wij", self.shape, gain, self.shape)
        return out


def modes_along(frequency_hz: Float, damping_ratio: Float, stiffness_n_m: Float, direction: Float) -> TipModes:
    """Modes from modal parameters, each along one direction at the tip: ``u = direction omega / sqrt(k)``.

    Args:
        frequency_hz: (n,) natural frequencies, Hz.
        damping_ratio: (n,).
        stiffness_n_m: (n,) modal stiffness k along the direction, N/m, > 0.
        direction: (n, 3), of any length > 0.

    Raises:
        InputError: Numbers out of range, or a direction of no length.
    """
    omega = 2.0 * np.pi * as_float("frequency_hz", frequency_hz, (None,))
    k = as_float("stiffness_n_m", stiffness_n_m, (len(omega),))
    u = as_float("direction", direction, (len(omega), DIMENSIONS))
    if np.any(k <= 0.0):
        raise InputError("modal stiffness is out of range", value=float(k.min()), limit="> 0 N/m")
    length = np.linalg.norm(u, axis=1, keepdims=True)
    if np.any(length == 0.0):
        raise InputError("the direction of a mode has no length")
    return TipModes(omega, as_float("damping_ratio", damping_ratio), ((u / length) * (omega / np.sqrt(k))[:, None]).T)
