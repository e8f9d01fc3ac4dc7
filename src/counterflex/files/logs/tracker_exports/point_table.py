"""Tables of measured points with a header row, as programs of trackers and spreadsheets export them.

The separator (tab, semicolon or comma) and the decimal mark are found; the header names each column and its unit, in
brackets or as a suffix: ``Time [s];X [mm];Y [mm];Z [mm]``. Lines before the header are passed over. Used are time, a
position (Cartesian, or distance with horizontal and vertical angle), a quaternion and the standard deviation; other
columns are not. A unit is never guessed.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError
from counterflex.core.units import MINUTE, NS
from counterflex.files.dataset.units import factor, in_header
from counterflex.files.logs.tracker_log import unit_length
from counterflex.files.small_table import number
from counterflex.geometry import pose, rotation
from counterflex.protocols.tracker.telegram import NO_ORIENTATION, TrackerPose, spherical_point

_HOUR_S: Final = 60.0 * MINUTE
_CLOCK: Final = re.compile(
    r"(?:(?P<date>\S+)[T ])?(?P<h>\d{1,2}):(?P<m>\d{2}):(?P<s>\d{2}(?:[.,]\d+)?)(?:Z|[+]00:?00)?"
)
_DATES: Final = ("%Y-%m-%d", "%Y/%m/%d", "%d.%m.%Y", "%m/%d/%Y", "%m/%d/%y")
"""Year first, German, American: the order that is not told apart by its marks is read as the American one."""


def stamp_ns(text: str, where: str) -> int:
    """Time of ``16:56:08.25`` (since midnight), or of ``02/12/25 16:56:08`` and other dates (since 1970, UTC).

    Raises:
        FileFormatError: It is neither.
    """
    match = _CLOCK.fullmatch(text.strip())
    if match is None or int(match["h"]) > 23 or int(match["m"]) > 59:
        raise FileFormatError("not a time stamp", where=where, value=repr(text.strip()), limit="[date] hh:mm:ss[.fff]")
    day_s = 0
    if match["date"]:
        day_s = _day(match["date"], where)
    seconds = int(match["h"]) * _HOUR_S + int(match["m"]) * MINUTE
    whole, _, rest = match["s"].replace(",", ".").partition(".")
    return round((day_s + seconds + int(whole)) / NS) + int(rest.ljust(9, "0")[:9] or 0)


def _day(text: str, where: str) -> int:
    for form in _DATES:
        try:
            return int(datetime.strptime(text, form).replace(tzinfo=UTC).timestamp())
        except ValueError:
            continue
    raise FileFormatError("not a date", where=where, value=repr(text), limit="2026-05-12, 12.05.2026 or 05/12/26")


_NAMES: Final[Mapping[str, tuple[str, ...]]] = {
    "time": ("time", "timestamp", "time stamp", "date time", "datetime", "t", "zeit", "zeitstempel"),
    "x": ("x",),
    "y": ("y",),
    "z": ("z",),
    "distance": ("distance", "dist", "d", "r", "range", "slope distance", "radius", "distanz", "schrägdistanz"),
    "azimuth": ("azimuth", "az", "hz", "horizontal", "horizontal angle", "azimut"),
    "zenith": ("zenith", "ze", "v", "vertical", "vertical angle", "zenit"),
    "elevation": ("elevation", "el"),
    "qw": ("qw", "q0"),
    "qx": ("qx", "q1"),
    "qy": ("qy", "q2"),
    "qz": ("qz", "q3"),
    "sigma": ("sigma", "std", "std dev", "rms"),
}
_KNOWN: Final = {text: name for name, texts in _NAMES.items() for text in texts}
_SI: Final = {"time": "s", "azimuth": "rad", "zenith": "rad", "elevation": "rad", "qw": "1", "qx": "1", "qy": "1",
              "qz": "1"}  # fmt: skip
_UNIT_TEXT: Final = re.compile(r"\s*[\[(][^\[\]()]*[\])]\s*$|_[a-z]+$")
_QUATERNION: Final = ("qw", "qx", "qy", "qz")
_ANGULAR: Final = ("distance", "azimuth", "zenith", "elevation")
_MOST_BEFORE: Final = 50


class PointTableLines:
    """Reads the table line by line."""

    def __init__(self, where: str) -> None:
        self._where, self._row = where, 0
        self._separator, self._decimal = ",", "."
        self._place: dict[str, int] = {}
        self._unit: dict[str, float | None] = {}
        self._count = 0

    @property
    def ready(self) -> bool:
        """Return whether what stands before the measurements has come."""
        return bool(self._place)

    def measured(self, line: str, sequence: int = 0) -> TrackerPose | None:
        """The measurement of a line; None for an empty line, the header and what stands before it.

        Raises:
            FileFormatError: No header within the first 50 lines, a column without a unit, another number of values,
                not a number, a quaternion that is not of unit length.
        """
        self._row += 1
        where = f"{self._where}:{self._row}"
        text = line.lstrip("\ufeff").rstrip("\r\n")
        if not text.strip(" ;,\t"):
            return None
        if not self._place:
            if not self._header(text, where) and self._row >= _MOST_BEFORE:
                raise FileFormatError(
                    "no header names the columns",
                    where=f"{self._where}: first {_MOST_BEFORE} lines",
                    limit="time, x, y, z (or distance, azimuth, zenith) with their units, such as X [mm]",
                )
            return None
        cells = text.split(self._separator)
        if len(cells) < self._count:
            raise FileFormatError("values in a line", where=where, value=len(cells), limit=self._count)
        R, status = np.eye(3), NO_ORIENTATION
        if "qw" in self._place:
            quat = np.array([self._value(cells, where, name) for name in _QUATERNION])
            unit_length(quat, where)
            R, status = rotation.from_quat_wxyz(quat), 0
        stamp = cells[self._place["time"]]
        time_ns = (
            stamp_ns(stamp, where) if ":" in stamp else round(self._time(self._value(cells, where, "time"), where) / NS)
        )
        sigma = self._value(cells, where, "sigma") if "sigma" in self._place else 0.0
        if sigma < 0.0 or time_ns < 0:
            raise FileFormatError("time or standard deviation is negative", where=where, value=(time_ns, sigma))
        T = pose.make(R, self._position(lambda name: self._value(cells, where, name)))
        return TrackerPose(sequence & 0xFFFFFFFF, time_ns, status, 0, T, sigma)

    def _time(self, value: float, where: str) -> float:
        if self._unit["time"] is None:
            raise FileFormatError("the column of times has no unit", where=where, limit="Time [s], [ms] or [ns]")
        return value

    def _position(self, value: object) -> Float:
        get = value
        assert callable(get)
        if "x" in self._place:
            return np.array([get("x"), get("y"), get("z")])
        zenith = get("zenith") if "zenith" in self._place else 0.5 * math.pi - get("elevation")
        return spherical_point(get("distance"), get("azimuth"), zenith)

    def _value(self, cells: Sequence[str], where: str, name: str) -> float:
        return number(cells[self._place[name]], where, self._decimal) * float(self._unit[name] or 1.0)

    def _header(self, text: str, where: str) -> bool:
        """Take the line as the header where it names a time and a position."""
        separator = next((mark for mark in ("\t", ";", ",") if mark in text), ",")
        heads = [head.strip().strip('"') for head in text.split(separator)]
        place = _places(heads, where)
        cartesian = {"x", "y", "z"} <= place.keys()
        spherical = {"distance", "azimuth"} <= place.keys() and ("zenith" in place) != ("elevation" in place)
        if "time" not in place or not (cartesian or spherical):
            return False
        if cartesian:
            place = {name: k for name, k in place.items() if name not in _ANGULAR}
        if len(set(_QUATERNION) & place.keys()) in (1, 2, 3):
            raise FileFormatError("a quaternion needs four columns", where=where, limit="qw, qx, qy, qz")
        self._unit |= {name: _factor(name, heads[k], where) for name, k in place.items()}
        self._place, self._separator, self._count = place, separator, max(place.values()) + 1
        self._decimal = "." if separator == "," else ","
        return True


def _places(heads: Sequence[str], where: str) -> dict[str, int]:
    """Columns of the quantities that a header names."""
    place: dict[str, int] = {}
    for k, head in enumerate(heads):
        name = _KNOWN.get(_UNIT_TEXT.sub("", head.lower()).strip())
        if name in place:
            raise FileFormatError("two columns of one quantity", where=where, value=f"{head!r} again")
        if name is not None:
            place[name] = k
    return place


def _factor(name: str, head: str, where: str) -> float | None:
    """SI value of one of a column; None where it has no unit and needs none."""
    si = _SI.get(name, "m")
    unit = in_header(head) or {"s": "s", "ns": "ns", "m": "m"}.get(head.rpartition("_")[2].lower())
    if unit is None and name != "time" and si != "1":
        raise FileFormatError("a column has no unit", where=where, value=repr(head), limit=f"such as {head} [mm]")
    return None if unit is None else factor(unit, si, f"{where}: {head}")
