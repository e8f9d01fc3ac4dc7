"""Chatter of the robot's own low modes in a side cut: how much of the axial depth at its limit a cut uses.

Where a mode is slow against the teeth (omega_n T << 1, T the tooth period), the wave that the last tooth left makes the
force follow the velocity: ``q(t) - q(t - T) = T q'``. Regeneration then acts as a damping matrix ``a_p T A`` with the
mean directional matrix of the arc, feed frame,

    A = N / 2 pi int [[s (Kt c + Kn s), c (Kt c + Kn s)], [s (-Kt s + Kn c), c (-Kt s + Kn c)]] dphi,

Kt and Kn the slopes of the cutting and radial force per edge at the mean chip. A mode of stiffness k and damping ratio
D along u is stable while ``a_p T (-u' A u) < 2 D k / omega_n``. The principal directions of the compliance
at the pose are taken for modes, each with the frequency and the damping of the lowest one.

Valid for omega_n T below about 0.3; the axial force is left out. In up-milling it is the direction normal to the wall
that may lose its damping, where the radial force is small against the cutting force; at the width without normal force
it keeps it.

Source: milling stability at high spindle speed, Cordes, Hintze, Altintas 2019 (low modes are damped out at high speed);
derived here from semi-discretisation's limit for omega_n T -> 0.
"""

from __future__ import annotations

import math

import numpy as np

from counterflex.core.arrays import Float
from counterflex.cutting.coefficients import ForceLaw
from counterflex.plan.strategy.side_cut import SideCuts, feed_axes
from counterflex.signals.preview import Mode


def directional_matrices(cuts: SideCuts, law: ForceLaw) -> Float:
    """Mean directional matrices, feed frame.

    Args:
        cuts: (n) the cuts.
        law: The force law.

    Returns:
        (n, 2, 2, 2) N/m2, parts of the cutting and of the radial constants; rows and columns are x and y.
    """
    slopes = np.zeros((2, len(cuts)))
    for p, kc, kr, _ in law.terms():
        if p > 0.0:
            power = p * cuts.mean_chip_m ** (p - 1.0)
            slopes += np.array([[kc], [kr]]) * power
    ends = [np.array([np.sin(a) ** 2, a - 0.5 * np.sin(2.0 * a), a + 0.5 * np.sin(2.0 * a)]) for a in _arc(cuts)]
    sc, ss, cc = 0.5 * (ends[1] - ends[0])
    unit = cuts.cutter.flutes / (2.0 * math.pi)
    by_cutting = np.array([[sc, cc], [-ss, -sc]]) * slopes[0]
    by_radial = np.array([[ss, sc], [sc, cc]]) * slopes[1]
    out: Float = np.moveaxis(unit * np.array([by_cutting, by_radial]), 3, 0)
    return out


def _arc(cuts: SideCuts) -> tuple[Float, Float]:
    return cuts.entry_rad, cuts.exit_rad


def depth_used(
    cuts: SideCuts, law: ForceLaw, tooth_period_s: Float, compliance_part: Float, normal_part: Float, mode: Mode
) -> Float:
    """Share of the limiting depth that a cut uses, by the constants that make it; their sum is the share.

    Args:
        cuts: (n) the cuts.
        law: The force law.
        tooth_period_s: (n,).
        compliance_part: (6, 6) at the tool tip, part axes.
        normal_part: (3,) unit normal of the wall.
        mode: The lowest mode.

    Returns:
        (n, 3, 2): for each principal direction, parts of the cutting and the radial constants; above 1 it chatters,
        below 0 the cut damps.
    """
    values, directions = np.linalg.eigh(compliance_part[:3, :3])
    damping = 2.0 * mode.damping_ratio / (np.maximum(values, 1e-15) * mode.omega_rad_s)
    u = np.einsum("nij,ik->nkj", feed_axes(cuts.up, normal_part), directions)[..., :2]
    along = np.einsum("nki,ncij,nkj->nkc", u, directional_matrices(cuts, law), u)
    out: Float = -along * (cuts.ap_m * tooth_period_s)[:, None, None] / damping[:, None]
    return out
