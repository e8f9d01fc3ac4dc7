"""The simulated laboratory touches planes: the robot lowers a switching probe at the tool tip onto them."""

from __future__ import annotations

import numpy as np

from counterflex.core.errors import SimulationError
from counterflex.core.units import UM
from counterflex.twin.laboratory.laboratory import Measured, Measurement, Order
from counterflex.twin.plant.plant import Plant

PROBE_M = 3.0 * UM
"""Standard deviation with which the probe switches."""
_ROUNDS = 8
_STEP_RAD = 1e-4


@Measurement
def measure(order: Order) -> Measured:
    """Joint angles at which the probe at the tool tip meets planes.

    The robot stands near each place of the request and is lowered until the tip is on the plane: the smallest change of
    the joint angles that brings it there, in static equilibrium.

    ``order``: Request: ``q1_rad`` ... ``q6_rad`` near the planes, ``plane`` 1, 2, ... of each row. Settings:
    ``planes``, rows [x, y, z, nx, ny, nz] of a point (m) and the normal of each plane in the base.

    Returns:
        ``q``, ``plane``; the settings tell ``probe_sigma_m``.

    Raises:
        SimulationError: The tip does not reach a plane from where it was asked to start.
    """
    truth, laboratory, request, settings, progress = order
    q = order.q
    planes = np.array(settings["planes"], dtype=np.float64).reshape(-1, 6)
    number = np.asarray(request.get("plane", np.ones(len(q))), dtype=np.int64)
    noise = laboratory.noise("planes")
    plant = Plant(truth)
    touched = np.empty_like(q)
    for k, row in enumerate(q):
        point, normal = planes[number[k] - 1, :3], planes[number[k] - 1, 3:]
        normal = normal / np.linalg.norm(normal)
        height = PROBE_M * noise.standard_normal()
        here = row.copy()
        for _ in range(_ROUNDS):
            off = float(normal @ (plant.equilibrium(here)[:3, 3] - point)) - height
            slope = np.array(
                [(normal @ (plant.equilibrium(here + d)[:3, 3] - point) - height - off) / _STEP_RAD
                 for d in _STEP_RAD * np.eye(6)]
            )  # fmt: skip
            here = here - slope * off / float(slope @ slope)
            if abs(off) < 1e-8:
                break
        else:
            raise SimulationError("the probe does not reach the plane", where=f"row {k + 1}", value=f"{off:.3g} m off")
        touched[k] = here
        progress((k + 1) / len(q), f"touched {k + 1} of {len(q)}")
    return Measured(
        channels={"q": touched, "plane": number[:, None].astype(np.float64)},
        sigma={},
        group=np.arange(len(q), dtype=np.int64),
        settings={"probe_sigma_m": PROBE_M},
    )
