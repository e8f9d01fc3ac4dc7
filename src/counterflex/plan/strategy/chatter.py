"""Chatter of the robot in a side cut: how much of the depth at its limit a cut uses.

The criterion is that of ``plan stability`` (:mod:`counterflex.plan.stability.criterion`), with the arc of the cut as
the engagement and the modes of the postures along the wall; the use is one over the margin. In up-milling it is the
direction normal to the wall that may lose its damping, where the radial force is small against the cutting force; at
the width without normal force it keeps it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Float
from counterflex.cutting.coefficients import ForceLaw
from counterflex.cutting.stability.modes import TipModes
from counterflex.cutting.stability.process import process_of_side_cut
from counterflex.plan.stability.criterion import SharedLimits
from counterflex.plan.stability.robot_modes import robot_modes
from counterflex.plan.strategy.side_cut import SideCuts, feed_axes
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.signals.preview import Mode

# How much a harmonic force swings the tool normal to a wall: modes of the robot in every posture along a cut.
# At rest a force along the wall's normal n moves the tip by ``n' C n``. Each mode of the robot has a share of that,
# ``s_m = (n' u_m)^2 / (omega_m^2 n' C n)``; what is left moves at once. A force of angular frequency w is magnified
#
# |1 - sum s_m + sum s_m / (1 - r_m^2 + 2 i D_m r_m)|,  r_m = w / omega_m,
#
# so that a mode which hardly moves the tip along the normal hardly counts.
#
# Source: superposition of modes, Ewins 2000, Modal Testing, ch. 2.


@dataclass(frozen=True, eq=False)
class Swing:
    """The modes of a posture as they move the tool normal to a wall."""

    omega_rad_s: Float  # (m,) angular frequencies, the lowest first
    damping_ratio: Float
    share: Float  # (m,) of the displacement at rest; their sum is at most 1
    line: int = 0  # line of the program at which the posture is taken; 0 without a program

    def magnification(self, omega_rad_s: Float) -> Float:
        """Displacement under a harmonic force over that at rest.

        Args:
            omega_rad_s: (n,) angular frequency of the force.
        """
        r = np.asarray(omega_rad_s, dtype=np.float64)[:, None] / self.omega_rad_s
        dynamic = self.share / (1.0 - r**2 + 2.0j * self.damping_ratio * r)
        out: Float = np.abs(1.0 - self.share.sum() + dynamic.sum(axis=1))
        return out


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
        q: (6,) rad.
        to_part: (6, 6), see :func:`counterflex.plan.stability.robot_modes.robot_modes`.
        compliance_part: (6, 6) at the tool tip, part axes.
        normal_part: (3,) unit normal of the wall.
        damping_ratio: Of every mode.
        measured: Lowest mode of a tap test, or None.

    Raises:
        ModelError: Nothing yields.
    """
    swings = robot_modes(chain, q, to_part, measured, damping_ratio)
    at_rest = float(normal_part @ compliance_part[:3, :3] @ normal_part)
    share = (normal_part @ swings.shape / swings.omega_rad_s) ** 2 / max(at_rest, 1e-15)
    # Modes and compliance are computed apart: together the modes must not move more than the whole.
    return Swing(swings.omega_rad_s, swings.damping_ratio, share / max(1.0, float(share.sum())), line)


def worst(swings: Sequence[Swing], omega_rad_s: Float) -> Float:
    """Largest magnification over all postures; (n,), 0 without any.

    Args:
        omega_rad_s: (n,) angular frequency of the force.
    """
    out = np.zeros(len(omega_rad_s))
    for swing in swings:
        out = np.maximum(out, swing.magnification(omega_rad_s))
    return out


@dataclass(frozen=True, eq=False)
class WallPosture:
    """The robot in a posture along a wall."""

    modes: TipModes  # its modes, part axes
    normal_part: Float  # (3,) unit normal of the wall there, out of the material


def depth_used(cuts: SideCuts, law: ForceLaw, spindle_rad_s: Float, standings: Sequence[WallPosture]) -> Float:
    """Share of the limiting depth that each cut uses in each posture; above 1 it chatters.

    ``cuts``: (n) the cuts; ``spindle_rad_s``: (n,) their spindle speeds; ``standings``: k postures.

    Returns:
        (n, k).
    """
    limits = SharedLimits()
    axes = [feed_axes(cuts.up, standing.normal_part) for standing in standings]
    periods = 2.0 * math.pi / (cuts.cutter.flutes * np.asarray(spindle_rad_s))
    out = np.empty((len(cuts), len(standings)))
    for i, (entry, leave, ap, fz, T) in enumerate(
        zip(cuts.entry_rad, cuts.exit_rad, cuts.ap_m, cuts.fz_m, periods, strict=True)
    ):
        A = process_of_side_cut(cuts.cutter, law, float(entry), float(leave), float(ap), float(fz)).mean
        for k, standing in enumerate(standings):
            R = axes[k][i]
            out[i, k] = 1.0 / limits(k, standing.modes, R @ A @ R.T, float(T)).factor
    return out
