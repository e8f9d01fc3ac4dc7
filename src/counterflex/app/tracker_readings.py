"""Measured poses in the frame of the commands: logs, exports and datasets of a tracker."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from counterflex.app.run.loop import tcp_target
from counterflex.core.arrays import Float, Int
from counterflex.core.errors import FileFormatError, InputError
from counterflex.core.units import DEG, MM
from counterflex.files.cell.cell import read_cell
from counterflex.files.dataset.reader import read_dataset
from counterflex.files.logs.tracker_exports.formats import OWN, Readings
from counterflex.geometry import pose
from counterflex.identify.data.dataset import Channel, Dataset
from counterflex.protocols.session.senses import tracker_frames

AS_MEASURED: Final = "as-measured"
FIT: Final = "fit"
KINDS: Final = ("pose_test", "path_test")


@dataclass(frozen=True, eq=False)
class TrackerMeasurement:
    """Readings of one file."""

    name: str
    Ts_command_tcp: Float  # (n, 4, 4) m, the tool (or the target) in the frame of the commands
    time_s: Float | None  # (n,) s, or None
    oriented: bool
    sigma_m: float  # Standard deviation of a position as stated, 0 where it is not
    pose: Int | None = None  # (n,) number of the commanded pose from 0, where a dataset states it
    direction: Int | None = None  # (n,) number of the direction of approach, likewise
    # (n, 4, 4) m, commanded pose of each row, likewise; its rotation is the identity without one
    command: Float | None = None
    commanded_oriented: bool = False  # Whether ``command`` has orientations

    @property
    def p(self) -> Float:
        """(n, 3) m."""
        return self.Ts_command_tcp[:, :3, 3]

    @property
    def R(self) -> Float | None:
        """(n, 3, 3), or None."""
        return self.Ts_command_tcp[:, :3, :3] if self.oriented else None

    def moved(self, T_command_log: Float, T_target_tcp: Float) -> TrackerMeasurement:
        """In another frame, and at another point of the target."""
        Ts_log_target = self.Ts_command_tcp
        return replace(self, Ts_command_tcp=T_command_log @ Ts_log_target @ T_target_tcp)

    def averaged(self, window_s: float) -> TrackerMeasurement:
        """Positions as moving means over ``window_s``, centred; the first and last half window are cut off."""
        if window_s <= 0.0 or self.time_s is None:
            return self
        count = 2 * round(0.5 * window_s / float(np.median(np.diff(self.time_s)))) + 1
        if count >= len(self.Ts_command_tcp):
            raise InputError("the log is shorter than the filter", where=self.name, value=f"{window_s:g} s")
        total = np.cumsum(np.concatenate([np.zeros((1, 3)), self.p - self.p[0]]), axis=0)
        half = count // 2
        Ts = self.Ts_command_tcp[half : len(self.Ts_command_tcp) - half].copy()
        Ts[:, :3, 3] = self.p[0] + (total[count:] - total[:-count]) / count
        return replace(self, Ts_command_tcp=Ts, time_s=self.time_s[half : len(self.time_s) - half])


def read_measured(file: str | Path, form: str = OWN) -> TrackerMeasurement:
    """Read a log, an export of the named format, or a dataset (.toml) of kind ``pose_test`` or ``path_test``."""
    name = Path(file).name
    if Path(file).suffix.lower() == ".toml":
        return _of_dataset(read_dataset(file), name)
    readings = Readings.read(file, form)
    return TrackerMeasurement(name, readings.Ts_tracker_target, readings.time_s, readings.oriented, readings.sigma_m)


def _poses(have: Mapping[str, Channel], position: str, turned: str) -> Float:
    return pose.make(have[turned].values if turned in have else np.eye(3), have[position].values)


def _whole(have: Mapping[str, Channel], name: str) -> Int | None:
    return None if name not in have else np.round(have[name].values[:, 0]).astype(np.int64)


def _of_dataset(data: Dataset, name: str) -> TrackerMeasurement:
    if data.kind not in KINDS:
        raise FileFormatError(
            "the dataset is of another kind", where=data.where, value=data.kind, limit=" or ".join(KINDS)
        )
    have = data.channels
    if "p_tracker_target" not in have:
        raise FileFormatError("a channel is missing", where=data.where, limit="p_tracker_target")
    sigma = have["p_tracker_target"].sigma
    which = _whole(have, "pose")
    time_s = have["time_s"].values[:, 0] if "time_s" in have else None
    if time_s is not None and np.any(np.diff(time_s) <= 0.0):
        raise FileFormatError("times do not increase", where=f"{data.where}: channels.time_s")
    return TrackerMeasurement(
        name,
        _poses(have, "p_tracker_target", "R_tracker_target"),
        time_s,
        "R_tracker_target" in have,
        0.0 if sigma is None else float(np.median(sigma)),
        None if which is None else which - 1,
        _whole(have, "direction"),
        _poses(have, "p_base_command", "R_base_command") if "p_base_command" in have else None,
        "R_base_command" in have,
    )


@dataclass(frozen=True, eq=False)
class CommandFrame:
    """Frame of the commands, and how readings are brought into it."""

    text: str
    fitted: bool  # It is found from the readings themselves; accuracies then leave out what a frame can absorb
    T_command_log: Float  # (4, 4)
    T_target_tcp: Float  # (4, 4)

    @classmethod
    def of(cls, text: str) -> CommandFrame:
        """A frame: ``as-measured``, ``fit``, a cell file with a table ``[tracker]``, or ``X,Y,Z,A,B,C`` in mm and deg.

        Raises:
            InputError: It is none of these.
            FileFormatError: The cell has no tracker.
        """
        if text in (AS_MEASURED, FIT):
            return cls(text, text == FIT, np.eye(4), np.eye(4))
        if text.endswith(".toml"):
            cell = read_cell(text)
            table = cell.tables.tracker
            if table is None:
                raise FileFormatError("the cell has no tracker", where=text, hint="Add a table [tracker]")
            frames = tracker_frames(cell.T_base_part, table.T_base_tracker, tcp_target(cell, cell.chain))
            return cls(f"part frame of {Path(text).name}", False, *frames)
        try:
            values = np.array([float(word) for word in text.split(",")])
        except ValueError:
            values = np.zeros(0)
        if len(values) != 6 or not np.all(np.isfinite(values)):
            raise InputError(
                "no frame",
                where="--frame",
                value=text,
                limit=f"{AS_MEASURED}, {FIT}, a cell file (.toml) or X,Y,Z,A,B,C of the tracker in the frame of the "
                "commands, mm and deg",
            )
        T = pose.from_xyz_zyx(values[:3] * MM, values[3:] * DEG)
        return cls(f"tracker at {text}", False, T, np.eye(4))
