"""ASCII points of SpatialAnalyzer: ``[collection,] [group,] [target,] x, y, z [, date time]``, commas or spaces.

Comment lines begin with ``//``; ``// AXES = CARTESIAN: X,  Y,  Z (mm)`` names coordinates and unit and is required: a
unit is never guessed. Time stamps are whole seconds, as the program writes them; several points then share one.

Source: user's manual of SpatialAnalyzer (New River Kinematics), "Exporting ASCII Formatted Points": names, separators,
time stamps, comments of version, frame and axes; the axes line as version 2024.2 writes it in a published recording.
"""

from __future__ import annotations

import re
from typing import Final

import numpy as np

from counterflex.core.errors import FileFormatError
from counterflex.files.dataset.units import UNITS, factor
from counterflex.files.logs.tracker_exports.stamps import number, stamp_ns
from counterflex.geometry import pose
from counterflex.protocols.tracker.telegram import NO_ORIENTATION, TrackerPose

_AXES: Final = re.compile(r"//\s*AXES\s*=\s*(?P<kind>\w+)\s*:(?P<names>[^(]*)(?:\((?P<unit>[^)]*)\))?.*", re.IGNORECASE)
_NUMBER: Final = r"([-+]?[0-9.]+(?:[eE][-+]?\d+)?)"
_GAP: Final = r"(?:\s*,\s*|\s+)"
_POINT: Final = re.compile(
    rf"(?:.*{_GAP})?{_NUMBER}{_GAP}{_NUMBER}{_GAP}{_NUMBER}(?:{_GAP}(\d+/\d+/\d+ \d+:\d+:\d+(?:\.\d+)?))?\s*,?\s*"
)


class SpatialAnalyzerLines:
    """Reads the export line by line.

    Args:
        where: For messages.
    """

    def __init__(self, where: str) -> None:
        self._where, self._row, self._unit = where, 0, 0.0

    @property
    def ready(self) -> bool:
        """Whether what stands before the measurements has come."""
        return self._unit > 0.0

    def measured(self, line: str, sequence: int = 0) -> TrackerPose | None:
        """The point of a line; None for a comment or an empty line. Without time stamps the time is 0.

        Raises:
            FileFormatError: No axes line yet, other coordinates than Cartesian ones, not three numbers.
        """
        self._row += 1
        where = f"{self._where}:{self._row}"
        text = line.lstrip("\ufeff").strip()
        if not text:
            return None
        if text.startswith("//"):
            axes = _AXES.fullmatch(text)
            if axes is not None:
                self._unit = self._axes(axes, where)
            return None
        if self._unit == 0.0:
            raise FileFormatError(
                "nothing says which unit the coordinates have",
                where=where,
                limit="a line // AXES = CARTESIAN: X, Y, Z (mm) before the points",
                hint="Export with axis comments, or write this line yourself",
            )
        match = _POINT.fullmatch(text)
        if match is None:
            raise FileFormatError(
                "not a point of SpatialAnalyzer", where=where, value=text[:60], limit="names, x, y, z[, date time]"
            )
        p = np.array([number(match[k], where) for k in (1, 2, 3)]) * self._unit
        time_ns = stamp_ns(match[4], where) if match[4] else 0
        return TrackerPose(sequence & 0xFFFFFFFF, time_ns, NO_ORIENTATION, 0, pose.make(p=p), 0.0)

    @staticmethod
    def _axes(axes: re.Match[str], where: str) -> float:
        if axes["kind"].upper() != "CARTESIAN":
            raise FileFormatError(
                "coordinates other than Cartesian ones", where=where, value=axes["kind"], limit="CARTESIAN"
            )
        if not axes["unit"]:
            raise FileFormatError("the axes have no unit", where=where, limit=", ".join(UNITS["m"]))
        unit = axes["unit"].strip().lower()
        return factor({"inches": "inch", "in": "inch", "meters": "m", "millimeters": "mm"}.get(unit, unit), "m", where)
