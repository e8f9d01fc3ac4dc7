"""What the simulated laboratory can measure: one module per kind of dataset."""

from __future__ import annotations

import importlib
from typing import Final

from counterflex.core.errors import InputError
from counterflex.twin.laboratory import Measure

MODULES: Final[dict[str, str]] = {
    "cubes": "measure_cubes",
    "pulls": "measure_pulls",
    "slots": "measure_slots",
    "sensor_poses": "measure_sensor_poses",
    "sensor_motion": "measure_sensor_motion",
    "holder_loads": "measure_holder_loads",
    "tracker_poses": "measure_tracker_poses",
    "fiducials": "measure_fiducials",
    "tracker_points": "measure_tracker_points",
    "distances": "measure_distances",
    "planes": "measure_planes",
    "record": "measure_record",
    "reversals": "measure_reversals",
    "servo_steps": "measure_servo_steps",
}
"""Kind of dataset: module of this package whose ``measure`` takes it, see :data:`.laboratory.Measure`."""


def measurement(kind: str) -> Measure:
    """The measurement that gives datasets of a kind.

    Args:
        kind: For example ``tracker_poses``, as in :class:`counterflex.identify.recipe.Proposal`.

    Raises:
        InputError: The simulated laboratory has no equipment for it.
    """
    if kind not in MODULES:
        raise InputError(
            "the simulated laboratory cannot measure this", value=kind, limit=", ".join(sorted(MODULES)) or "nothing"
        )
    found: Measure = importlib.import_module(f"counterflex.twin.{MODULES[kind]}").measure
    return found
