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
    spread = float(np.hypot(sigma_nm, motor_friction_sigma(mine)))
    if friction_nm - every > spread:
        return (
            f"{name}: {friction_nm:.3g} +- {spread:.2g} N m of dry friction on the side of the link contradict the "
            f"{every:.3g} N m that the motor's torque shows of link and motor together. Check the torsion compliance "
            f"of the axis in the cell file and the scale of 'tau_motor', and measure more poses"
        )
    return None


def least_seen(axis: int, mine: Sequence[Motion], friction_nm: float) -> str | None:
    """Return what one of the two kinds of poses that is missing leaves open; None where both were measured.

    Args:
        axis: 0..5.
        mine: Its motions.
        friction_nm: Dry friction on the side of the link.
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
