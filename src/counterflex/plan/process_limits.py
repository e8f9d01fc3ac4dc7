"""Limits of spindle, tool and robot that choices of strategy and feeds are held against.

A limit that is None is not known and binds nowhere. The tool is a cantilever of the effective diameter 0.8 D
(:data:`CORE`), ``k = 3 pi E (0.8 D)^4 / (64 L^3)``.

Source of the effective diameter: Kops, L., Vo, D. T.: Determination of the equivalent diameter of an end mill based on
its compliance, Annals of the CIRP 39/1 (1990), 0.8 times the nominal diameter.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, as_positive
from counterflex.robot.elasticity.chain import ElasticChain, jacobian

CORE: Final = 0.8
CARBIDE_PA: Final = 600e9
"""Young's modulus of cemented carbide; high-speed steel has 210e9."""


@dataclass(frozen=True, eq=False)
class ProcessLimits:
    """Limits of the process; None where one is not known."""

    spindle_min_rad_s: float | None = None  # lowest speed
    spindle_max_rad_s: float | None = None  # highest speed
    power_w: float | None = None  # of the spindle, continuous, at the tool
    torque_nm: float | None = None  # of the spindle, continuous
    force_n: float | None = None  # largest mean force on the tool
    axis_torque_nm: Float | None = None  # (6,) largest torque that the process may put on each axis of the robot
    bending_m: float | None = None  # largest elastic bending of the tool at its tip
    overhang_m: float | None = None  # length of the tool out of its holder
    modulus_pa: float = CARBIDE_PA  # Young's modulus of the tool
    deflection_m: float | None = None  # largest deflection of the tool square to its path
    acceleration_m_s2: float | None = None  # largest acceleration of the tool
    # the same by its speed: rows of rad/s, N m, rising; straight between them, constant beyond them
    torque_by_speed: tuple[tuple[float, float], ...] = ()
    run_up_s: float | None = None  # time in which the spindle comes to a new speed

    def torque_at(self, spindle_rad_s: Float) -> Float | None:
        """Largest torque (n,) N m of the spindle at speeds (n,) rad/s; None where it is not known."""
        if self.torque_nm is None and not self.torque_by_speed:
            return None
        out: Float = np.full(np.shape(spindle_rad_s), np.inf if self.torque_nm is None else self.torque_nm)
        if self.torque_by_speed:
            speeds, torques = zip(*self.torque_by_speed, strict=True)
            out = np.minimum(out, np.interp(np.abs(spindle_rad_s), speeds, torques))
        return out

    def bending(self, diameter_m: float, force_n: Float) -> Float:
        """Bending of the tool at its tip under a force there, m; zero where the overhang is not known.

        Args:
            force_n: Square to the tool axis.
        """
        if self.overhang_m is None:
            return np.zeros_like(force_n)
        return force_n / tool_stiffness(diameter_m, self.overhang_m, self.modulus_pa)


def tool_stiffness(diameter_m: float, overhang_m: float, modulus_pa: float = CARBIDE_PA) -> float:
    """Bending stiffness of an end mill at its tip, N/m.

    ``overhang_m``: length out of the holder; ``modulus_pa``: Young's modulus.

    Raises:
        InputError: A number is not positive.
    """
    d = CORE * as_positive("diameter_m", diameter_m)
    length = as_positive("overhang_m", overhang_m)
    return 3.0 * math.pi * as_positive("modulus_pa", modulus_pa) * d**4 / (64.0 * length**3)


def axis_torques(chain: ElasticChain, q: Float, w_tcp_base: Float) -> Float:
    """Torque that a wrench on the tool puts on each axis, ``J^T w``.

    ``q``: (n, 6) rad; ``w_tcp_base``: (n, 6) N, N m, about the tip, base axes.

    Returns:
        (n, 6) N m, positive in the positive direction of the angles.
    """
    out: Float = np.einsum("nda,nd->na", jacobian(chain, q), w_tcp_base)
    return out
