"""Tracker logs as text: one measurement per line, comma-separated, a unit in every column's name.

Position either ``x_mm y_mm z_mm`` or, as a tracker measures it, ``distance_mm azimuth_deg zenith_deg`` (Mandiola2023
eq. 1); orientation ``qw qx qy qz``, left out for a reflector; further ``time_s`` (or ``time_ns``), and where known
``status`` and ``sigma_mm``. Lines that begin with ``#`` are comments.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from counterflex.core import file_content
from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError
from counterflex.core.similar import close_to
from counterflex.core.units import DEG, MM, NS
from counterflex.files.small_table import number
from counterflex.geometry import pose, rotation
from counterflex.protocols.tracker.telegram import NO_ORIENTATION, TrackerPose, spherical_point
from counterflex.twin.devices.pose_source import TrackerLog

CARTESIAN: Final = ("x_mm", "y_mm", "z_mm")
SPHERICAL: Final = ("distance_mm", "azimuth_deg", "zenith_deg")
ORIENTATION: Final = ("qw", "qx", "qy", "qz")
OTHER: Final = ("time_s", "time_ns", "status", "sigma_mm")
_UNIT: Final = 1e-4


class TrackerLines:
    """Reads a log line by line; the first line names the columns.

    Raises:
        FileFormatError: An unknown, missing or repeated column.
    """

    def __init__(self, head: str, where: str) -> None:
        self._names = [name.strip() for name in head.lstrip("\ufeff").strip().split(",")]
        self._where = where
        known = (*CARTESIAN, *SPHERICAL, *ORIENTATION, *OTHER)
        for name in self._names:
            if name not in known:
                close = close_to(name, known, 1)
                raise FileFormatError(
                    "unknown column of a tracker log",
                    where=f"{where}:1",
                    value=repr(name),
                    limit=", ".join(known),
                    hint=f"Did you mean {close[0]}?" if close else None,
                )
        if len(set(self._names)) != len(self._names):
            raise FileFormatError("a column stands twice", where=f"{where}:1", value=", ".join(self._names))
        self._spherical = self._whole(SPHERICAL)
        if self._spherical == self._whole(CARTESIAN):
            raise FileFormatError(
                "the position must be given once",
                where=f"{where}:1",
                limit=f"{' '.join(CARTESIAN)} or {' '.join(SPHERICAL)}",
            )
        self._oriented = self._whole(ORIENTATION)
        if ("time_s" in self._names) == ("time_ns" in self._names):
            raise FileFormatError("the time must be given once", where=f"{where}:1", limit="time_s or time_ns")
        self._row = 1

    def _whole(self, names: Sequence[str]) -> bool:
        results = [name in self._names for name in names]
        if any(results) and not all(results):
            missing = names[results.index(False)]
            raise FileFormatError("a column is missing", where=f"{self._where}:1", value=missing)
        return all(results)

    def measured(self, line: str, sequence: int = 0) -> TrackerPose | None:
        """The measurement of a line, or None for a comment or an empty line.

        Raises:
            FileFormatError: Another number of values, not a number, a quaternion that is not of unit length, a
                distance that is negative.
        """
        self._row += 1
        where = f"{self._where}:{self._row}"
        text = line.strip()
        if not text or text.startswith("#"):
            return None
        parts = text.split(",")
        if len(parts) != len(self._names):
            raise FileFormatError("values in a line", where=where, value=len(parts), limit=len(self._names))
        row = dict(zip(self._names, parts, strict=True))
        time_ns = _whole(row["time_ns"], where) if "time_ns" in row else _nanoseconds(row["time_s"], where)
        status = _whole(row["status"], where) if "status" in row else 0
        if not 0 <= time_ns < 1 << 64 or not 0 <= status < 1 << 32:
            raise FileFormatError("time or status out of range", where=where, value=(time_ns, status), limit=">= 0")
        p, R = self._position(row, where), np.eye(3)
        if self._oriented:
            quat = np.array([number(row[name], where) for name in ORIENTATION])
            R = rotation.from_quat_wxyz(quat / unit_length(quat, where))
        else:
            status |= NO_ORIENTATION
        sigma = number(row["sigma_mm"], where) if "sigma_mm" in row else 0.0
        if sigma < 0.0:
            raise FileFormatError("a standard deviation is negative", where=where, value=sigma, limit=">= 0")
        return TrackerPose(sequence & 0xFFFFFFFF, time_ns, status, 0, pose.make(R, p), sigma * MM)

    def _position(self, row: Mapping[str, str], where: str) -> Float:
        if not self._spherical:
            return np.array([number(row[name], where) for name in CARTESIAN]) * MM
        distance, azimuth, zenith = (number(row[name], where) for name in SPHERICAL)
        if distance < 0.0:
            raise FileFormatError("the distance is negative", where=where, value=distance, limit=">= 0 mm")
        return spherical_point(distance * MM, azimuth * DEG, zenith * DEG)


def unit_length(quat_wxyz: Float, where: str) -> float:
    """Length of a quaternion as it is written. Raises FileFormatError: it is not 1."""
    size = math.hypot(*quat_wxyz.tolist())
    if abs(size - 1.0) > _UNIT:
        raise FileFormatError("a quaternion is not of unit length", where=where, value=size, limit=1)
    return size


def measurements(lines: Iterable[str], where: str) -> Iterator[TrackerPose]:
    """Measurements of lines as they come, the first naming the columns; numbered from 1."""
    reader: TrackerLines | None = None
    sequence = 0
    for line in lines:
        if reader is None:
            reader = TrackerLines(line, where)
            continue
        result = reader.measured(line, sequence + 1)
        if result is not None:
            sequence += 1
            yield result


def read_tracker_log(path: str | Path) -> TrackerLog:
    """Read a whole log.

    Raises:
        FileFormatError: Missing, not text, without rows, times that do not go on, or as :class:`TrackerLines`.
    """
    file, text = Path(path), file_content.text(path)
    results = list(measurements(text.splitlines(), str(file)))
    if not results:
        raise FileFormatError("a tracker log without rows", where=str(file))
    back = next((k for k in range(1, len(results)) if results[k].time_ns <= results[k - 1].time_ns), None)
    if back is not None:
        raise FileFormatError(
            "the clock of a tracker log does not go on",
            where=f"{file}: measurement {back + 1}",
            value=f"{results[back].time_ns} ns",
            limit=f"> {results[back - 1].time_ns} ns",
        )
    return TrackerLog(
        tuple(one.time_ns for one in results),
        np.stack([one.T_tracker_target for one in results]),
        tuple(one.status for one in results),
        tuple(one.sigma_m for one in results),
    )


def log_text(time_s: Float, Ts_tracker_target: Float, sigma_m: float) -> str:
    """A log as text: ``time_s``, position, orientation, standard deviation of the position.

    Args:
        time_s: (n,) s.
        Ts_tracker_target: (n, 4, 4) m.
    """
    quat = rotation.quat_wxyz(Ts_tracker_target[:, :3, :3])
    rows = np.column_stack([Ts_tracker_target[:, :3, 3] / MM, quat])
    head = ",".join(("time_s", *CARTESIAN, *ORIENTATION, "sigma_mm"))
    sigma = f"{sigma_m / MM:.6g}"
    lines = [
        f"{time:.6f}," + ",".join(f"{value:.6f}" for value in row[:3]) + "," + ",".join(f"{v:.9f}" for v in row[3:])
        for time, row in zip(time_s.tolist(), rows.tolist(), strict=True)
    ]
    return "\n".join([head, *(f"{line},{sigma}" for line in lines)]) + "\n"


def _nanoseconds(text: str, where: str) -> int:
    value = number(text, where) / NS
    if not math.isfinite(value):
        raise FileFormatError("time or status out of range", where=where, value=text.strip(), limit="< 2^64 ns")
    return round(value)


def _whole(text: str, where: str) -> int:
    try:
        return int(text.strip(), 0)
    except ValueError as fault:
        raise FileFormatError("not a whole number", where=where, value=repr(text.strip())) from fault
