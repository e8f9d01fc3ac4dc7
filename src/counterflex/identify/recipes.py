"""All recipes by name; each is imported when it is asked for."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Final

from counterflex.core.errors import InputError
from counterflex.core.similar import close_to

if TYPE_CHECKING:
    from counterflex.identify.recipe import Recipe

FOLDERS: Final = {
    "kinematics": "kinematics",
    "tracker-frame": "tracker_frame",
    "stiffness": "stiffness",
    "cubes": "cubes",
    "play": "play",
    "timing": "timing",
    "servo": "servo",
    "payload": "payload",
    "holder": "holder",
    "cutting": "cutting",
}
"""Folder of each recipe; its module ``recipe`` holds ``RECIPE``."""

TITLES: Final = {
    "kinematics": "true geometry of the arm from tracker poses or points, distances, touched planes",
    "tracker-frame": "where the tracker stands and where its target sits, from fiducials or poses",
    "stiffness": "springs of joints, links and bodies from the tool's displacement under known loads",
    "cubes": "springs of single parts from the motion of measuring cubes on the structure",
    "play": "lost motion and friction of the axes from slow reversals",
    "timing": "dead time, lag and clock offset between recorded channels",
    "servo": "drive lag, loop gains and bandwidth of corrections from steps",
    "payload": "bias, weight and centre of gravity at the force sensor from many orientations",
    "holder": "force from the strain-gauge bridges of a tool holder",
    "cutting": "cutting constants of a material from test slots",
}
"""What each recipe finds, in one line."""


def recipe(name: str) -> Recipe:
    """The recipe of a name.

    Raises:
        InputError: There is none.
    """
    if name not in FOLDERS:
        close = close_to(name, sorted(FOLDERS), 1)
        raise InputError(
            "there is no such recipe",
            value=name,
            limit=", ".join(FOLDERS),
            hint=f"Did you mean '{close[0]}'?" if close else None,
        )
    found: Recipe = importlib.import_module(f"counterflex.identify.{FOLDERS[name]}.recipe").RECIPE
    return found
