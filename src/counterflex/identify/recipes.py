"""All recipes by name; each is imported when it is asked for. Other packages add theirs by an entry point."""

from __future__ import annotations

import importlib
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


def own_title(name: str) -> str:
    """Title of one of our own recipes: ``TITLE`` of its folder, so that the help loads no recipe."""
    title: str = importlib.import_module(RECIPES.own[name].rpartition(".")[0]).TITLE
    return title


def added_kinds() -> dict[str, str]:
    """Kinds of datasets that recipes of other packages use, with the title of the recipe.

    Raises:
        InputError: A package is broken.
    """
    names = [name for name in RECIPES if name not in RECIPES.own]
    return {kind: RECIPES[name].title for name in names for kind in RECIPES[name].kinds}
