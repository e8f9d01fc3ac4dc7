"""The cell that an identification of compliances starts from: axes of unknown stiffness begin at their class."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

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
