"""All recipes by name; each is imported when it is asked for. Other packages add theirs by an entry point."""

from __future__ import annotations

from typing import Any, Final

from counterflex.core.registry import Registry

RECIPES: Final[Registry[Any]] = Registry(
    "counterflex.recipes",
    "recipe",
    "counterflex.identify.recipe:Recipe",
    {
        "kinematics": "counterflex.identify.kinematics.recipe:RECIPE",
        "tracker-frame": "counterflex.identify.tracker_frame.recipe:RECIPE",
        "stiffness": "counterflex.identify.stiffness.recipe:RECIPE",
        "cubes": "counterflex.identify.cubes.recipe:RECIPE",
        "play": "counterflex.identify.play.recipe:RECIPE",
        "timing": "counterflex.identify.timing.recipe:RECIPE",
        "servo": "counterflex.identify.servo.recipe:RECIPE",
        "payload": "counterflex.identify.payload.recipe:RECIPE",
        "holder": "counterflex.identify.holder.recipe:RECIPE",
        "cutting": "counterflex.identify.cutting.recipe:RECIPE",
    },
)

TITLES: Final = {
    "kinematics": "geometry of arm, base and tool, from tracker poses or points, distances, touched planes",
    "tracker-frame": "pose of the tracker in the base, of its target on the tool, drift, from fiducials or poses",
    "stiffness": "compliances of joints, links, bodies, from displacement of the tool under known loads",
    "cubes": "compliances of single elements, from motion of measuring cubes on the structure",
    "play": "lost motion and friction of the axes, from slow reversals",
    "timing": "dead time, lag and clock offset between channels, from a recorded motion",
    "servo": "drive lag, loop gains, bandwidth of corrections, from steps",
    "payload": "bias, weight, centre of gravity, hose pack at the force sensor, from many orientations",
    "holder": "force from strain gauges on the spindle holder, from known loads",
    "cutting": "force constants of a material, from test slots",
}
"""What each recipe identifies, and from what: in the help, in result.json, over the report, in docs/identify.md."""


def added_kinds() -> dict[str, str]:
    """Kinds of datasets that recipes of other packages use, with the title of the recipe.

    Raises:
        InputError: A package is broken.
    """
    names = [name for name in RECIPES if name not in RECIPES.own]
    return {kind: RECIPES[name].title for name in names for kind in RECIPES[name].kinds}
