"""All recipes by name; each is imported when it is asked for."""

from __future__ import annotations

import importlib
from typing import Final

from counterflex.core.errors import InputError
from counterflex.core.similar import close_to
from counterflex.identify.recipe import Recipe

MODULES: Final = {
    "kinematics": "kinematics",
    "tracker-frame": "tracker_frame",
    "stiffness": "stiffness",
    "cubes": "cubes",
    "play": "reversals",
    "timing": "timing",
    "servo": "servo",
    "payload": "payload",
    "holder": "holder",
    "cutting": "cutting",
}


def recipe(name: str) -> Recipe:
    """The recipe of a name.

    Raises:
        InputError: There is none.
    """
    if name not in MODULES:
        close = close_to(name, sorted(MODULES), 1)
        raise InputError(
            "there is no such recipe",
            value=name,
            limit=", ".join(MODULES),
            hint=f"Did you mean '{close[0]}'?" if close else None,
        )
    found: Recipe = importlib.import_module(f"counterflex.identify.{MODULES[name]}").RECIPE
    return found
