"""Where the part really lies once its frame has been measured with the robot itself.

In the shop the part is clamped somewhere and the robot touches datum points on it. The controller computes their
coordinates from its nominal geometry; the tool really is where sag and geometric error put it. So the part's true
pose is the one that carries the datum points onto the touched ones: what the robot gets wrong there cancels, only its
variation across the part remains.
"""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float, as_float
from counterflex.core.errors import InputError
from counterflex.geometry import pose
from counterflex.twin.plant.controller import Controller
from counterflex.twin.plant.plant import Plant


def touched_part_frame(plant: Plant, controller: Controller, datum_points_part: Float) -> tuple[Float, Float]:
    """Touch datum points in static equilibrium, no load but the robot's own weight.

    ``controller``: What it believes, with the part frame it will run the program in. ``datum_points_part``: (k, 3) m, k
    >= 3, not on one line, in the part frame.

    Returns:
        ``T_base_part`` (4, 4) true pose of the part, and what the rigid fit leaves at the points (k, 3) m in base axes.

    Raises:
        InputError: Too few points, or points on one line.
        ReachError: The robot cannot reach one.
    """
    points = as_float("datum_points_part", datum_points_part, (None, 3))
    if len(points) < 3:
        raise InputError("datum points", value=len(points), limit="3 or more")
    axis = np.tile(np.array([0.0, 0.0, 1.0]), (len(points), 1))
    touched = np.array([plant.equilibrium(q)[:3, 3] for q in controller.joints(points, axis)])
    return pose.register(touched, points)
