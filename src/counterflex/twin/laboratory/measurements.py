"""What the simulated laboratory can measure: one module per kind of dataset."""

from __future__ import annotations

import importlib
from typing import Final

from counterflex.core.errors import InputError
from counterflex.twin.laboratory.laboratory import Measurement

MODULES: Final[dict[str, str]] = {
    "cubes": "cubes",
    "pulls": "pulls",
    "slots": "slots",
    "sensor_poses": "sensor_poses",
    "sensor_motion": "sensor_motion",
    "holder_loads": "holder_loads",
    "tracker_poses": "tracker_poses",
    "fiducials": "fiducials",
    "tracker_points": "tracker_points",
    "distances": "distances",
    "planes": "planes",
    "record": "record",
    "reversals": "reversals",
    "servo_steps": "servo_steps",
}
"""Kind of dataset: module of this package whose ``measure`` takes it, see :class:`.laboratory.Measurement`."""


def measurement(kind: str) -> Measurement:
    """The measurement that gives datasets of a kind.

    ``kind``: For example ``tracker_poses``, as in :class:`counterflex.identify.recipe.Proposal`.

    Raises:
        InputError: The simulated laboratory has no equipment for it.
    """
    if kind not in MODULES:
        raise InputError(
            "the simulated laboratory cannot measure this", value=kind, limit=", ".join(sorted(MODULES)) or "nothing"
        )
    measure: Measurement = importlib.import_module(f"counterflex.twin.laboratory.{MODULES[kind]}").measure
    return measure
