"""Settings of a recipe as they are typed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from counterflex.core.errors import InputError
from counterflex.core.similar import close_to
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.identify.recipe import Recipe

_WIDE: Final = "wide"


def starting_cell(path: str | Path, recipe: Recipe, settings: Mapping[str, Any]) -> tuple[Cell, dict[str, Any], str]:
    """Read a cell to identify from.

    A recipe that fits compliances begins with what the file says. An axis without stiffness would stay rigid; it begins
    with the median of the robot's class instead, as widely as what is only assumed (setting ``wide``).

    Returns:
        The cell, the settings, and a remark that says which axes begin so; empty where none does.

    Raises:
        FileFormatError: The file cannot be used, or the robot has no class to begin with.
    """
    cell = read_cell(path)
    if _WIDE not in recipe.settings or not cell.unknown_axes:
        return cell, dict(settings), ""
    cell = read_cell(path, assume_class=True)
    given = cell.class_stiffness
    if given is None:
        return cell, dict(settings), ""
    names = {segment.joint: segment.name for segment in cell.robot.segments}
    wide = " ".join(f"{names[axis]}.rz" for axis in given.axes)
    remark = f"{given.named} begin with the median of the robot's class: no stiffness was known of them"
    return cell, {**settings, _WIDE: f"{settings[_WIDE]} {wide}".strip()}, remark


SEED: Final = "seed"
Setting = float | int | str | bool


def read_settings(recipe: Recipe, values: Mapping[str, Setting], seed: int = 0) -> dict[str, Any]:
    """Settings of a recipe; see :func:`settings_of`."""
    return settings_of(recipe.name, recipe.settings, values, seed)


def settings_of(
    name: str, defaults: Mapping[str, Setting], values: Mapping[str, Setting], seed: int = 0
) -> dict[str, Any]:
    """Settings of a recipe, with what was given in the place of defaults, and the seed.

    ``values``: By key, as text from the command line or as values; ``seed`` is allowed. Raises InputError: an unknown
    key, or no value of the setting's kind.
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
