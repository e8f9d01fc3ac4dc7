"""The radial width of cut at which nothing pushes the tool off the wall.

In up-milling the radial force pushes the tool away from the wall and the cutting force pulls it in; the first wins in
thin cuts, the second in wide ones, and between them the sum of the means is zero. The rule "half the diameter" of
Berger2013 holds only where k_r / k_c = pi / 2, so it is computed. Two zeros are told apart: that of the force normal
to the wall, and that of the displacement normal to the wall, in which the robot's compliance also turns the force along
the feed and along the axis. In down-milling both forces push the tool away and there is none.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy

from counterflex.core.arrays import Float
from counterflex.cutting.coefficients import ForceLaw
from counterflex.cutting.cutter import Cutter
from counterflex.plan.strategy.side_cut import SideCuts, in_part, wrenches

_WIDTHS = np.concatenate(
    [np.geomspace(1e-4, 0.002, 6, endpoint=False), np.geomspace(0.002, 0.1, 12), np.linspace(0.12, 1.0, 23)]
)
"""Shares of the diameter between which a change of sign is looked for."""


def normal_force(cuts: SideCuts, law: ForceLaw) -> Float:
    """(n,) N, mean force normal to the wall; positive pushes the tool out of the material."""
    side = wrenches(cuts, law).sum(axis=1)[:, 1]
    out: Float = np.where(cuts.up, -side, side)
    return out


def normal_errors(cuts: SideCuts, law: ForceLaw, compliance_part: Float, normal_part: Float) -> Float:
    """Displacement of the tool normal to the wall, by the constants that make it: ``n . C w``.

    ``compliance_part``: (6, 6) at the tool tip, part axes; ``normal_part``: (3,) unit normal of the wall, out of the
    material.

    Returns:
        (n, 3) m, parts of the cutting, radial and axial constants; positive leaves material on the wall.
    """
    w = in_part(cuts, wrenches(cuts, law), normal_part)
    out: Float = w @ (normal_part @ compliance_part[:3])
    return out


def zero_width(cutter: Cutter, ap_m: float, fz_m: float, value: Callable[[SideCuts], Float]) -> float | None:
    """Least radial width of cut in up-milling at which a value changes its sign.

    ``ap_m``: axial depth; ``fz_m``: feed per tooth; ``value``: of cuts, (n,): for example their normal force.

    Returns:
        a_e in m, to 0.1 um; None where the value has one sign at every width up to the diameter.
    """
    widths = _WIDTHS * cutter.diameter_m
    values = value(_up_milling(cutter, widths, ap_m, fz_m))
    change = np.flatnonzero(np.sign(values[1:]) * np.sign(values[:-1]) < 0.0)
    if not len(change):
        return None
    i = int(change[0])
    return float(
        scipy.optimize.brentq(
            lambda ae: float(value(_up_milling(cutter, np.array([ae]), ap_m, fz_m))[0]),
            widths[i],
            widths[i + 1],
            xtol=1e-7,
        )
    )


def _up_milling(cutter: Cutter, ae_m: Float, ap_m: float, fz_m: float) -> SideCuts:
    one = np.ones(len(ae_m))
    return SideCuts(cutter, one > 0.0, ae_m, ap_m * one, fz_m * one)
