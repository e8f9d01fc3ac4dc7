"""Division of a step of the plant for its stiffest spring: elastic joints, stuck friction, drives.

A step of length h takes springs and drives at its start and the dampers of the elastic joints at its end,
``(M + h D) v' = (M - h D_e) v - h K q``, ``q' = q + h v'``. No motion of it grows if ``4 M + 2 h (D - D_e) - h^2 K``
has no negative eigenvalue: for every eigenvector the scalar polynomial
``z^2 (m + h d) + z (h^2 k - 2 m - h d + h d_e) + m - h d_e`` then has its roots in the unit circle (Jury's conditions).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import SimulationError
from counterflex.twin.plant.mjcf import Coordinates

PARTS: Final = (1, 2, 4, 8, 16, 32)
"""Divisions of a step that are tried."""
_RESERVE: Final = 1.2
"""A part of a step is stable if one longer by this is: postures between those looked at have a little less inertia."""
_POSTURES: Final = 24


def on_axes(coordinates: Coordinates, sign: Float, on_link: Float, on_motor: Float) -> Float:
    """Matrix (n, n) of springs, or of dampers, on the link angle ``q + sign rz`` and on the motor angle of each axis.

    ``sign``: (6,) of each axis. ``on_link``: (6,) N m/rad, or N m s/rad. ``on_motor``: (6,), the same.
    """
    out: Float = np.zeros((len(coordinates.kind), len(coordinates.kind)))
    for axis, (m, t) in enumerate(zip(coordinates.motor, coordinates.torsion, strict=True)):
        link = np.zeros(len(out))
        link[m] = 1.0
        if t >= 0:
            link[t] = sign[axis]
        out += on_link[axis] * np.outer(link, link)
        out[m, m] += on_motor[axis]
    return out


def step_is_stable(M: Float, K: Float, implicit: Float, explicit: Float, step_s: float) -> bool:
    """Return whether no small motion grows from step to step.

    Args:
        M: (n, n) inertia.
        K: (n, n) stiffness of all springs, drives and stuck friction elements.
        implicit: (n, n) damping that acts on the speed at the end of a step.
        explicit: (n, n) damping that acts on the speed at its start.
        step_s: h, s.
    """
    least = 4.0 * M + 2.0 * step_s * (implicit - explicit) - step_s**2 * K
    try:
        np.linalg.cholesky(least)
    except np.linalg.LinAlgError:
        return False
    return True


def parts_of_step(
    mass_matrix: Callable[[Float], Float], K: Float, implicit: Float, explicit: Float, step_s: float
) -> int:
    """Smallest division of a step that is stable in every posture of a fixed random choice.

    Args:
        mass_matrix: (n, n) inertia at motor angles (6,) rad.
        K: (n, n), see :func:`step_is_stable`.
        implicit: (n, n), see there.
        explicit: (n, n), see there.
        step_s: Step to be divided, s.

    Raises:
        SimulationError: A 32nd of the step is too long still.
    """
    angles = np.random.default_rng(0).uniform(-np.pi, np.pi, (_POSTURES, 6))
    inertia = [mass_matrix(q) for q in angles]
    for parts in PARTS:
        if all(step_is_stable(M, K, implicit, explicit, _RESERVE * step_s / parts) for M in inertia):
            return parts
    raise SimulationError(
        "a spring of the truth is too stiff for its inertia to be simulated",
        value=f"steps of {step_s / PARTS[-1] * 1e6:.1f} us",
        hint="Check slip angles of the friction, masses and inertias of the truth",
    )
