"""Joint angles of datasets and proposals: as the controller shows them in files, as the model has them in memory."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError
from counterflex.identify.data.dataset import Channel, Dataset
from counterflex.robot.model.controller_axes import ControllerAxes

_SHOWN: Final = ("q", "q_command", "q_motor", "q_second")
_CHANGES: Final = ("approach",)
_COLUMNS: Final = tuple(f"q{axis}_rad" for axis in range(1, 7))


def in_model_angles(data: Dataset, axes: ControllerAxes) -> Dataset:
    """Return the dataset with joint angles of the model.

    A channel whose manifest says by ``coupling``, ``signs`` or ``offsets_deg`` how its numbers become angles of the
    model is left as it is.

    Raises:
        FileFormatError: A channel has fewer than six axes, and they depend on each other.
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
