"""Springs between elastic coordinates, of one body or of several, that change with the posture.

``f_i = -k_ij c(q) x_j``, ``f_j = -k_ij c(q) x_i`` with ``k_ij = share sqrt(k_i k_j)`` and ``c(q) = cos(q_axis -
phase)``, or 1 where no axis is named. A coordinate coupled with itself has a stiffness that changes with the posture,
``k_i (1 + share c(q))``.
"""

from __future__ import annotations

import math

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.jit import kernel
from counterflex.twin.plant.mjcf import Coordinates
from counterflex.twin.truth.truth import Truth


def coupling_parameters(truth: Truth, coordinates: Coordinates) -> tuple[Int, Float]:
    """Places (k, 3): two coordinates and the motor coordinate of the axis, -1 without; values (k, 2): k_ij, phase."""
    names = [body.name for body in truth.bodies]
    place, value = [], []
    for c in truth.other.couplings:
        pair = [
            int(np.flatnonzero((coordinates.body == names.index(name)) & (coordinates.kind == direction))[0])
            for name, direction in zip(c.bodies, c.directions, strict=True)
        ]
        mean = math.sqrt(coordinates.stiffness[pair[0]] * coordinates.stiffness[pair[1]])
        place.append((*pair, -1 if c.axis is None else int(coordinates.motor[c.axis])))
        value.append((c.share * mean, c.phase_rad))
    return np.array(place, dtype=np.int64).reshape(-1, 3), np.array(value, dtype=np.float64).reshape(-1, 2)


@kernel()
def apply_couplings(qpos: Float, place: Int, value: Float, force: Float) -> None:
    """Add the springs to ``force``.

    Args:
        qpos: (n,) coordinates.
        place: (k, 3) of :func:`coupling_parameters`.
        value: (k, 2) of it.
        force: (n,) generalised forces, added to.
    """
    for k in range(place.shape[0]):
        i, j = place[k, 0], place[k, 1]
        stiffness = value[k, 0]
        if place[k, 2] >= 0:
            stiffness *= math.cos(qpos[place[k, 2]] - value[k, 1])
        force[i] -= stiffness * qpos[j]
        if i != j:
            force[j] -= stiffness * qpos[i]
