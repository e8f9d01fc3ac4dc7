"""How much a harmonic force swings the tool normal to a wall: modes of the robot in every posture along a cut.

At rest a force along the wall's normal n moves the tip by ``n' C n``. Each mode of the robot has a share of that,
``s_m = (n' u_m)^2 / (omega_m^2 n' C n)``; what is left moves at once. A force of angular frequency w is magnified

    |1 - sum s_m + sum s_m / (1 - r_m^2 + 2 i D_m r_m)|,  r_m = w / omega_m,

so that a mode which hardly moves the tip along the normal hardly counts.

Source: superposition of modes, Ewins 2000, Modal Testing, ch. 2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Float
from counterflex.plan.stability.robot_modes import robot_modes
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.signals.preview import Mode


@dataclass(frozen=True, eq=False)
class Swing:
    """The modes of a posture as they move the tool normal to a wall.

    Attributes:
        omega_rad_s: (m,) angular frequencies, the lowest first.
        damping_ratio: (m,).
        share: (m,) of the displacement at rest; their sum is at most 1.
        line: Line of the program at which the posture is taken; 0 without a program.
    """

    omega_rad_s: Float
    damping_ratio: Float
    share: Float
    line: int = 0

    def magnification(self, omega_rad_s: Float) -> Float:
        """Displacement under a harmonic force over that at rest.

        Args:
            omega_rad_s: (n,) angular frequency of the force.
        """
        r = np.asarray(omega_rad_s, dtype=np.float64)[:, None] / self.omega_rad_s
        dynamic = self.share / (1.0 - r**2 + 2.0j * self.damping_ratio * r)
        out: Float = np.abs(1.0 - self.share.sum() + dynamic.sum(axis=1))
        return out


def single(mode: Mode) -> Swing:
    """A posture with one mode that all of the displacement belongs to."""
    return Swing(np.array([mode.omega_rad_s]), np.array([mode.damping_ratio]), np.ones(1))


def swing_of(
    chain: ElasticChain,
    q: Float,
    to_part: Float,
    compliance_part: Float,
    normal_part: Float,
    damping_ratio: float,
    measured: Mode | None,
    line: int = 0,
) -> Swing:
    """The modes of a posture.

    Args:
        chain: The elastic robot.
        q: (6,) rad.
        to_part: (6, 6), see :func:`counterflex.plan.stability.robot_modes.robot_modes`.
        compliance_part: (6, 6) at the tool tip, part axes.
        normal_part: (3,) unit normal of the wall.
        damping_ratio: Of every mode.
        measured: Lowest mode of a tap test, or None.
        line: Of the program.

    Raises:
        ModelError: Nothing yields.
    """
    swings = robot_modes(chain, q, to_part, measured, damping_ratio)
    at_rest = float(normal_part @ compliance_part[:3, :3] @ normal_part)
    share = (normal_part @ swings.shape / swings.omega_rad_s) ** 2 / max(at_rest, 1e-15)
    return Swing(swings.omega_rad_s, swings.damping_ratio, share / max(1.0, float(share.sum())), line)


def worst(swings: Sequence[Swing], omega_rad_s: Float) -> Float:
    """Largest magnification over all postures; (n,), 0 without any.

    Args:
        swings: Of the postures.
        omega_rad_s: (n,) angular frequency of the force.
    """
    out = np.zeros(len(omega_rad_s))
    for swing in swings:
        out = np.maximum(out, swing.magnification(omega_rad_s))
    return out
