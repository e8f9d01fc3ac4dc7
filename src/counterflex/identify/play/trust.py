"""Reasons not to write the play and friction of an axis into the cell file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.identify.reversals.data import Motion, motor_friction, motor_friction_sigma

APART_RAD: Final = 0.1
"""Angle of any axis from which two motions are in different poses."""
POSES: Final = 2
"""Fewest poses of an axis. In one pose a dead band, friction and what the gear does in that pose look alike."""
LOADED: Final = 1.0
"""Torque in units of the dry friction from which an axis is loaded: its gear stays on one flank."""
BALANCED: Final = 0.7
"""The same below which it is balanced: its gear crosses the dead band."""


SCALE: Final = 0.03
"""Relative error of the motor's torque (torque constant, temperature), one standard deviation."""
MOST: Final = 0.15
"""Excess of the friction on the side of the link over all friction, as a share, that no standard deviation excuses: one
that wide does not tell friction from dead band. Axis 6 had 61 N m of 43 in all, +- 21, and half of its dead band."""
WIDE: Final = 1.0 / 3.0
"""Standard deviation as a share of the value above which a constant is not called determined."""


def poses_of(mine: Sequence[Motion]) -> list[Float]:
    """Poses (6,) rad in which an axis was moved, each once."""
    out: list[Float] = []
    for m in mine:
        if all(float(np.max(np.abs(m.pose - other))) > APART_RAD for other in out):
            out.append(m.pose)
    return out


def why_not(axis: int, mine: Sequence[Motion], friction_nm: float, sigma_nm: float) -> str | None:
    """Why the values of an axis cannot be trusted; None where they can.

    Args:
        axis: 0..5.
        mine: Its motions.
        friction_nm: Dry friction on the side of the link.
        sigma_nm: Its standard deviation, that of the compliance it refers to included.
    """
    name = f"axis {axis + 1}"
    if len(poses_of(mine)) < POSES:
        return (
            f"{name} was moved in one pose only: dead band, friction and the gear in that pose cannot be told apart. "
            f"Measure a second pose, one balanced and one loaded (identify play --propose 24)"
        )
    every = motor_friction(mine)
    if every is None:
        return None
    spread = float(np.hypot(sigma_nm, np.hypot(motor_friction_sigma(mine), SCALE * every)))
    if friction_nm - every > min(spread, MOST * every):
        return (
            f"{name}: {friction_nm:.3g} +- {sigma_nm:.2g} N m of dry friction on the side of the link contradict the "
            f"{every:.3g} N m that the motor's torque shows of link and motor together, so friction and dead band are "
            f"not told apart. Check the torsion compliance of the axis in the cell file and the scale of 'tau_motor', "
            f"and measure more poses (identify play --propose 24)"
        )
    return None


def too_wide(value: float, sigma: float) -> bool:
    """Whether a standard deviation is too wide for its value to be called determined."""
    return sigma > WIDE * abs(value)


def least_seen(axis: int, mine: Sequence[Motion], friction_nm: float) -> str | None:
    """Return what one of the two kinds of poses that is missing leaves open; None where both were measured.

    ``axis``: 0..5. ``friction_nm``: Dry friction on the side of the link.
    """
    load = [float(np.min(np.abs(m.torque))) for m in mine]
    if min(load) >= BALANCED * friction_nm:
        return (
            f"axis {axis + 1}: its weight ({min(load):.0f} N m at least) kept the gear on one flank, so the dead band "
            f"was not determined; measure in a pose where the axis is balanced"
        )
    if max(load) < LOADED * friction_nm:
        return (
            f"axis {axis + 1}: no pose loads it ({max(load):.0f} N m at most): dead band and friction are told apart "
            f"by the course of the reversal only; measure in a pose where the axis is loaded, where there is one"
        )
    return None
