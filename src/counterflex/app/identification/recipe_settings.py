"""Settings of a recipe as they are typed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final

from counterflex.core.errors import InputError
from counterflex.core.similar import close_to
from counterflex.identify.recipe import Recipe

SEED: Final = "seed"
Setting = float | int | str | bool


def read_settings(recipe: Recipe, values: Mapping[str, Setting], seed: int = 0) -> dict[str, Any]:
    """Settings of a recipe; see :func:`settings_of`."""
    return settings_of(recipe.name, recipe.settings, values, seed)


def settings_of(
    name: str, defaults: Mapping[str, Setting], values: Mapping[str, Setting], seed: int = 0
) -> dict[str, Any]:
    """Settings of a recipe, with what was given in the place of defaults, and the seed.

    ``values``: By key, as text from the command line or as values; ``seed`` is allowed.

    Raises:
        InputError: An unknown key, or no value of the setting's kind.
    """
    out: dict[str, Any] = {**defaults, SEED: seed}
    known = sorted({*defaults, SEED})
    for key, value in values.items():
        text = str(value).lower() if isinstance(value, bool) else str(value)
        if key not in out:
            close = close_to(key, known, 1)
            raise InputError(
                f"the recipe '{name}' has no such setting",
                where=f"--set {key}={text}",
                limit=", ".join(known),
                hint=f"Did you mean '{close[0]}'?" if close else None,
            )
        out[key] = _value(key, text, out[key])
    return out


def _value(key: str, text: str, like: Setting) -> Setting:
    where, kind = f"--set {key}={text}", type(like)
    if kind is bool:
        if text.lower() not in ("true", "false"):
            raise InputError("the setting is true or false", where=where, value=repr(text))
        return text.lower() == "true"
    if kind is str:
        return text
    try:
        value = int(text) if kind is int else float(text)
    except ValueError as fault:
        expected = "a whole number" if kind is int else "a number"
        raise InputError(f"the setting is {expected}", where=where, value=repr(text)) from fault
    if not math.isfinite(value):
        raise InputError("the setting is not finite", where=where, value=repr(text))
    return value
