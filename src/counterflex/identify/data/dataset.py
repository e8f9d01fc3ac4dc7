"""Measured data in memory: named channels in SI with standard deviations, frames and a clock."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.errors import FileFormatError
from counterflex.identify.data.measuring_frame import SensorFrame


@dataclass(frozen=True, eq=False)
class Channel:
    """One measured quantity."""

    name: str  # canonical name (docs/datasets.md), for example `q`, `p_tracker_target`, `w_sensor`
    values: Float  # (n, k) SI; rotations are rotation vectors or, for `R_...` channels, (n, 3, 3) matrices
    sigma: Float | None  # (n, k) standard deviations, SI (rad for rotations), or None where the file states none
    unit: str  # SI unit of the values
    source: str  # file and columns, for messages
    # headers of the columns it was read from; empty for constants and for data made in memory
    columns: tuple[str, ...] = ()
    as_model: bool = False  # the manifest says how its joint angles become those of the model

    def need_sigma(self) -> Float:
        """The standard deviations.

        Raises:
            FileFormatError: None are stated; the message says which line of the manifest would fix it.
        """
        if self.sigma is None:
            raise FileFormatError(
                f"channel '{self.name}' has no standard deviation",
                where=self.source,
                hint=f"Add to the manifest under [channels.{self.name}]: sigma = ... (in the channel's unit), "
                'sigma_columns = [...], or sigma = "repeats" to estimate it from repeated rows',
            )
        return self.sigma


@dataclass(frozen=True, eq=False)
class Dataset:
    """One table of measurements."""

    name: str  # of the dataset
    kind: str  # what was measured, which decides who can use it: `tracker_poses`, `pulls`, ... (docs/datasets.md)
    channels: Mapping[str, Channel]  # by canonical name
    group: Int  # (n,) ids of rows that belong together (repeats of a pose, samples of a cut); hold-out keeps them so
    line: Int  # (n,) line of the file each row comes from, for messages
    # further facts that the manifest states, by their keys (SI)
    settings: Mapping[str, Any] = field(default_factory=dict)
    fingerprint: str = ""  # SHA-256 over manifest and data files, hex
    where: str = ""  # manifest path, for messages
    file: str = ""  # data file whose lines `line` counts; empty for data made in memory
    sensors: SensorFrame | None = None  # of a measuring frame whose readings are `s_unloaded` and `s_loaded`, or None

    def finite(self, name: str) -> Float:
        """The values of a channel, each row of numbers only. Raises FileFormatError: names channel and line."""
        values = self.values(name)
        bad = np.flatnonzero(~np.all(np.isfinite(values.reshape(len(self), -1)), axis=1))
        if len(bad):
            raise FileFormatError(
                f"channel '{name}' holds a value that is not a number",
                where=self.place(int(bad[0])),
                hint="Remove the row, or the cause: an empty cell of the table is read as not a number",
            )
        return values

    def __len__(self) -> int:
        return len(self.group)

    def has(self, name: str) -> bool:
        """Return whether a channel is there."""
        return name in self.channels

    def channel(self, name: str) -> Channel:
        """A channel. Raises FileFormatError: the dataset has none of that name."""
        if name not in self.channels:
            raise FileFormatError(
                f"the dataset has no channel '{name}'",
                where=self.where or self.name,
                limit=", ".join(self.channels),
                hint=f"Map it in the manifest: [channels.{name}] columns = [...]",
            )
        return self.channels[name]

    def values(self, name: str) -> Float:
        """SI values (n, k) of a channel."""
        return self.channel(name).values

    def rows(self, mask: Bool) -> Dataset:
        """The marked rows only."""
        channels = {
            key: replace(c, values=c.values[mask], sigma=None if c.sigma is None else c.sigma[mask])
            for key, c in self.channels.items()
        }
        return replace(self, channels=channels, group=self.group[mask], line=self.line[mask])

    def place(self, row: int) -> str:
        """Place of a row, for messages."""
        return f"{self.file or self.where or self.name}:{int(self.line[row])}"


def of_arrays(
    name: str,
    kind: str,
    arrays: Mapping[str, Float],
    sigmas: Mapping[str, Float | float] | None = None,
    *,
    group: Int | None = None,
    settings: Mapping[str, Any] | None = None,
    sensors: SensorFrame | None = None,
) -> Dataset:
    """A dataset from arrays in memory, for examples and tests.

    Args:
        kind: See :class:`Dataset`.
        arrays: (n, ...) SI by channel name.
        sigmas: Standard deviations, broadcast against the values (against (n, 3) for rotation matrices).
        group: (n,) or None for every row on its own.
        settings: See :class:`Dataset`.
        sensors: See :class:`Dataset`.
    """
    n = len(next(iter(arrays.values())))
    channels = {}
    for key, values in arrays.items():
        array = np.asarray(values, dtype=np.float64)
        array = array[:, None] if array.ndim == 1 else array
        shape = (n, 3) if array.ndim == 3 else array.shape
        sigma = None if sigmas is None or key not in sigmas else np.broadcast_to(sigmas[key], shape).astype(np.float64)
        channels[key] = Channel(key, array, sigma, "SI", f"{name}: {key}")
    rows = np.arange(n, dtype=np.int64)
    return Dataset(
        name=name,
        kind=kind,
        channels=channels,
        group=rows if group is None else np.asarray(group, dtype=np.int64),
        line=rows + 1,
        settings=dict(settings or {}),
        where=name,
        sensors=sensors,
    )
