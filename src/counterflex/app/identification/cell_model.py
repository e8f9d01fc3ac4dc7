"""The cell as identification sees it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError, InputError
from counterflex.core.similar import close_to
from counterflex.core.units import MM
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.cell.sensing import sensing_of
from counterflex.identify.data.dataset import Channel, Dataset
from counterflex.identify.data.model import CellModel
from counterflex.identify.recipe import Recipe
from counterflex.robot.model.controller_axes import ControllerAxes

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


_SHOWN: Final = ("q", "q_command", "q_motor", "q_second")
_CHANGES: Final = ("approach",)
_COLUMNS: Final = tuple(f"q{axis}_rad" for axis in range(1, 7))


def in_model_angles(data: Dataset, axes: ControllerAxes) -> Dataset:
    """Return the dataset with joint angles of the model.

    A channel whose manifest says by ``coupling``, ``signs`` or ``offsets_deg`` how its numbers become angles of the
    model is left as it is. Raises FileFormatError: a channel has fewer than six axes, and they depend on each other.
    """
    if axes.matrix is None:
        return data
    channels = {name: _in_model(channel, axes) for name, channel in data.channels.items()}
    return replace(data, channels=channels)


def shown_channels(channels: Mapping[str, Float], axes: ControllerAxes) -> dict[str, Float]:
    """Return channels, (n, k) SI by name, with joint angles as the controller shows them."""
    return {
        name: axes.shown(values) if name in _SHOWN else axes.shown_change(values) if name in _CHANGES else values
        for name, values in channels.items()
    }


def shown_columns(columns: Mapping[str, Float], axes: ControllerAxes) -> dict[str, Float]:
    """Return the columns of a proposal with joint angles as the controller shows them."""
    return _columns(columns, axes.shown)


def model_columns(columns: Mapping[str, Float], axes: ControllerAxes) -> dict[str, Float]:
    """Return the columns of a proposal with joint angles of the model; the inverse of :func:`shown_columns`."""
    return _columns(columns, axes.model)


def _columns(columns: Mapping[str, Float], change: Callable[[Float], Float]) -> dict[str, Float]:
    out = dict(columns)
    if all(name in columns for name in _COLUMNS):
        changed = change(np.stack([columns[name] for name in _COLUMNS], axis=1))
        out |= {name: changed[:, axis] for axis, name in enumerate(_COLUMNS)}
    return out


def _in_model(channel: Channel, axes: ControllerAxes) -> Channel:
    if channel.as_model or channel.name not in (*_SHOWN, *_CHANGES):
        return channel
    if channel.values.shape[1] != 6:
        raise FileFormatError(
            "axes of this robot depend on each other, and the channel has not all six", where=channel.source,
            value=f"{channel.values.shape[1]} axes", limit="6",
            hint="Add the missing columns, or say coupling, signs or offsets_deg in the manifest",
        )  # fmt: skip
    values = axes.model_change(channel.values) if channel.name in _CHANGES else axes.model(channel.values)
    sigma = channel.sigma
    if sigma is not None and axes.matrix is not None:
        sigma = np.sqrt(sigma**2 @ (np.linalg.inv(axes.matrix) ** 2).T)
    return replace(channel, values=values, sigma=sigma)


_ELSEWHERE: Final = frozenset(
    (
        *("format", "version", "name", "robot", "end_effector", "tcp", "part", "tools", "material"),
        *("posture", "controller", "dynamics", "limits", "identified"),
    )
)
"""Tables of the cell file that the model has as objects, or not at all."""


def model_of(cell: Cell) -> CellModel:
    """Model of a cell for recipes."""
    tables = cell.tables.model_dump(mode="json", exclude_none=True)
    return CellModel(
        name=cell.name,
        robot=cell.robot,
        end_effector=cell.end_effector,
        nominal_robot=cell.nominal_robot,
        nominal_end_effector=cell.nominal_end_effector,
        calibration=cell.calibration,
        law_of=partial(getattr, cell, "force_law"),
        cutter_of=cell.cutter,
        frame_of=partial(getattr, cell, "T_base_part"),
        branch=cell.tables.posture.branch,
        joint_margin_rad=cell.tables.limits.limits.joint_margin_rad,
        rotation_about_tool_rad=cell.tables.posture.rotation_about_tool_rad,
        blank_part=_box(cell),
        datum_points_part=_datum_points(cell),
        tables={
            **{name: tables[name] for name in tables if name not in _ELSEWHERE},
            **sensing_of(cell.tables.sensor, cell.tables.holder, cell.chain),
        },
    )


def _datum_points(cell: Cell) -> Float | None:
    part = cell.tables.part
    return cell.datum_points_part if part is not None and part.measured_with == "robot" else None


def _box(cell: Cell) -> Float | None:
    part = cell.tables.part
    stock = None if part is None else part.stock
    if stock is None or stock.box_min_mm is None or stock.box_max_mm is None:
        return None
    return np.array([stock.box_min_mm, stock.box_max_mm]) * MM
