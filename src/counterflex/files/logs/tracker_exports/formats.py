"""Formats of tracker exports by name, and how a file of one is read."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Protocol

import numpy as np

from counterflex.core import file_content
from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError
from counterflex.core.file_content import of_bytes
from counterflex.core.units import MM, NS
from counterflex.files.dataset.units import UNITS, factor
from counterflex.files.logs.tracker_exports.point_table import PointTableLines, stamp_ns
from counterflex.files.logs.tracker_log import TrackerLines
from counterflex.files.small_table import number
from counterflex.geometry import pose
from counterflex.protocols.tracker.telegram import BEAM_BROKEN, INACCURATE, NO_ORIENTATION, TrackerPose

# ASCII points of SpatialAnalyzer: ``[collection,] [group,] [target,] x, y, z [, date time]``, commas or spaces.
# Comment lines begin with ``//``; ``// AXES = CARTESIAN: X,  Y,  Z (mm)`` names coordinates and unit and is required: a
# unit is never guessed. Time stamps are whole seconds, as the program writes them; several points then share one.
#
# Source: user's manual of SpatialAnalyzer (New River Kinematics), "Exporting ASCII Formatted Points": names,
# separators,
# time stamps, comments of version, frame and axes; the axes line as version 2024.2 writes it in a published recording.

_AXES: Final = re.compile(r"//\s*AXES\s*=\s*(?P<kind>\w+)\s*:(?P<names>[^(]*)(?:\((?P<unit>[^)]*)\))?.*", re.IGNORECASE)
_NUMBER: Final = r"([-+]?[0-9.]+(?:[eE][-+]?\d+)?)"
_GAP: Final = r"(?:\s*,\s*|\s+)"
_POINT: Final = re.compile(
    rf"(?:.*{_GAP})?{_NUMBER}{_GAP}{_NUMBER}{_GAP}{_NUMBER}(?:{_GAP}(\d+/\d+/\d+ \d+:\d+:\d+(?:\.\d+)?))?\s*,?\s*"
)
_DECIMAL: Final = re.compile(r"[-+]?(\d+\.\d*|\.\d+)(e[-+]?\d+)?", re.IGNORECASE)
_MOST_NAMES: Final = 3


class SpatialAnalyzerLines:
    """Reads the export line by line."""

    def __init__(self, where: str) -> None:
        self._where, self._row, self._unit = where, 0, 0.0

    @property
    def ready(self) -> bool:
        """Return whether what stands before the measurements has come."""
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
        names = text[: match.start(1)]
        if any(_DECIMAL.fullmatch(name) for name in re.split(_GAP, names)) or names.count(",") > _MOST_NAMES:
            raise FileFormatError(
                "more numbers than three coordinates", where=where, value=text[:60],
                hint="Export without offsets and uncertainties",
            )  # fmt: skip
        p = np.array([number(match[k], where) for k in (1, 2, 3)]) * self._unit
        time_ns = stamp_ns(match[4], where) if match[4] else 0
        return TrackerPose(sequence & 0xFFFFFFFF, time_ns, NO_ORIENTATION, 0, pose.make(p=p), 0.0)

    @staticmethod
    def _axes(axes: re.Match[str], where: str) -> float:
        if axes["kind"].upper() != "CARTESIAN":
            raise FileFormatError(
                "coordinates other than Cartesian ones", where=where, value=axes["kind"], limit="CARTESIAN"
            )
        if axes["names"].upper().replace(",", " ").split() != ["X", "Y", "Z"]:
            raise FileFormatError("other axes", where=where, value=axes["names"].strip(), limit="X, Y, Z")
        if not axes["unit"]:
            raise FileFormatError("the axes have no unit", where=where, limit=", ".join(UNITS["m"]))
        unit = axes["unit"].strip().lower()
        return factor({"inches": "inch", "in": "inch", "meters": "m", "millimeters": "mm"}.get(unit, unit), "m", where)


# Recorded text output of ART DTrack2, an optical tracker of 6-D targets: lines ``fr``, ``ts``, ``6d``, ``3d``.
# ``6d N [id qu][x y z eta theta phi][b0 .. b8]``: position in mm, rotation matrix by columns; qu = -1: not visible.
# ``3d N [id qu][x y z]``: single markers. ``ts``: seconds since midnight UTC. A line holds the targets that are seen:
# the first one that came counts, and no other takes its place where it is hidden.
#
# Source: DTrack2 user manual, "Output of measurement data via Ethernet" (B.2).

_BLOCK: Final = re.compile(r"\[([^\[\]]*)\]")
_BLOCKS: Final = {"6d": [2, 6, 9], "3d": [2, 3]}  # numbers in the blocks of a target, by the word of the line
_TURNED: Final = 1e-3


class DTrackLines:
    """Reads the output line by line."""

    def __init__(self, where: str) -> None:
        self._where, self._row = where, 0
        self._time_ns: int | None = None
        self._word = self._target = ""

    @property
    def ready(self) -> bool:
        """Return whether what stands before the measurements has come."""
        return self._time_ns is not None

    def measured(self, line: str, sequence: int = 0) -> TrackerPose | None:
        """The pose of the target in a line ``6d`` or ``3d``; None for the others.

        Raises:
            FileFormatError: A pose before a time stamp, blocks that are missing, a matrix that is no rotation.
        """
        self._row += 1
        where = f"{self._where}:{self._row}"
        word, _, rest = line.lstrip("\ufeff").strip().partition(" ")
        if word == "ts":
            self._time_ns = round(number(rest, where) / NS)
        sizes = _BLOCKS.get(word)
        if sizes is None:
            return None
        self._word = self._word or word
        blocks = [block.split() for block in _BLOCK.findall(rest)]
        if word != self._word or not blocks:
            return None
        if self._time_ns is None:
            raise FileFormatError("a pose before the first time stamp", where=where, hint="Switch the output of ts on")
        own = self._own(blocks, sizes, where)
        if not own:
            return None
        values = [np.array([number(text, where) for text in block]) for block in own]
        seen = values[0][1] >= 0.0
        R = _rotation(values[2].reshape(3, 3).T, rest, where) if word == "6d" and seen else np.eye(3)
        status = (0 if word == "6d" else NO_ORIENTATION) | (0 if seen else BEAM_BROKEN)
        frame_id = int(values[0][0])
        T = pose.make(R, values[1][:3] * MM)
        return TrackerPose(sequence & 0xFFFFFFFF, self._time_ns, status, frame_id, T, 0.0)

    def _own(self, blocks: list[list[str]], sizes: list[int], where: str) -> list[list[str]]:
        """Blocks of the target that came first; none where it is hidden."""
        count = len(sizes)
        if [len(block) for block in blocks] != sizes * -(-len(blocks) // count):
            raise FileFormatError("blocks of a target", where=where, value=str(blocks)[:60], limit=f"{sizes} numbers")
        self._target = self._target or blocks[0][0]
        targets = (blocks[at : at + count] for at in range(0, len(blocks), count))
        return next((target for target in targets if target[0][0] == self._target), [])


def _rotation(R: Float, text: str, where: str) -> Float:
    """The rotation nearest to a matrix."""
    if float(np.abs(R @ R.T - np.eye(3)).max()) > _TURNED or float(np.linalg.det(R)) < 0.0:
        raise FileFormatError("the matrix of a target is no rotation", where=where, value=text[:60])
    u, _, vt = np.linalg.svd(R)
    nearest: Float = u @ vt
    return nearest


class ExportLines(Protocol):
    """Reads an export line by line."""

    @property
    def ready(self) -> bool:
        """Return whether what stands before the measurements has come."""

    def measured(self, line: str, sequence: int = 0) -> TrackerPose | None:
        """The measurement of a line; None where it has none. Raises FileFormatError."""


class _OwnLines:
    """Our own log, whose first line names the columns."""

    def __init__(self, where: str) -> None:
        self._where = where
        self._lines: TrackerLines | None = None

    @property
    def ready(self) -> bool:
        return self._lines is not None

    def measured(self, line: str, sequence: int = 0) -> TrackerPose | None:
        if self._lines is None:
            self._lines = TrackerLines(line, self._where)
            return None
        return self._lines.measured(line, sequence)


OWN: Final = "counterflex"
FORMATS: Final[dict[str, tuple[Callable[[str], ExportLines], str]]] = {
    OWN: (_OwnLines, "tracker log of counterflex (docs/fakes.md)"),
    "spatial-analyzer": (SpatialAnalyzerLines, "ASCII points of SpatialAnalyzer, with axis comments"),
    "point-table": (PointTableLines, "table with a header row that names columns and units"),
    "dtrack": (DTrackLines, "recorded text output of ART DTrack2"),
}
"""Reader and what it reads, by name."""


@dataclass(frozen=True, eq=False)
class Readings:
    """Readings of a tracker, bad ones left out."""

    Ts_tracker_target: Float  # (n, 4, 4) m; the rotation is the identity where there is no orientation
    time_s: Float | None  # (n,) s since the first reading, increasing; None where the stamps are too coarse or missing
    oriented: bool
    left_out: int  # Readings with a broken beam or marked inaccurate
    sigma_m: float  # Standard deviation of a position as stated, 0 where it is not

    @classmethod
    def read(cls, path: str | Path, name: str = OWN) -> Readings:
        """Read a whole export.

        Raises:
            FileFormatError: Missing, not text, without readings, as the format's reader, or times that run backwards.
        """
        file, data = Path(path), file_content.content(path)
        try:
            text = data.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = data.decode("cp1252", errors="replace")
        foreign = of_bytes(data)
        if foreign is not None or "\0" in text:
            raise FileFormatError(
                "not a text file", where=str(file), value=foreign, hint="Export the measurements as text"
            )
        if name == OWN and text.startswith("// SpatialAnalyzer"):
            raise FileFormatError(
                "this is an export of SpatialAnalyzer", where=str(file), hint="--format spatial-analyzer"
            )
        return collected(_measured(text.splitlines(), lines_of(name, str(file))), str(file))


def lines_of(name: str, where: str) -> ExportLines:
    """A reader of lines. Raises FileFormatError: there is no such format."""
    if name not in FORMATS:
        raise FileFormatError("unknown format of a tracker's export", value=name, limit=", ".join(FORMATS))
    return FORMATS[name][0](where)


def _measured(lines: Iterable[str], reader: ExportLines) -> Iterator[TrackerPose]:
    for line in lines:
        result = reader.measured(line)
        if result is not None:
            yield result


def collected(measured: Iterable[TrackerPose], where: str) -> Readings:
    """Readings of measurements.

    Raises:
        FileFormatError: There are none, orientations for some only, or times that run backwards.
    """
    everything = list(measured)
    good = [one for one in everything if not one.status & (BEAM_BROKEN | INACCURATE)]
    if not good:
        raise FileFormatError("no usable reading", where=where, value=f"{len(everything)} readings in all")
    bare = sum(bool(one.status & NO_ORIENTATION) for one in good)
    if 0 < bare < len(good):
        raise FileFormatError("orientations of some readings only", where=where, value=f"{bare} of {len(good)} without")
    stamps = np.array([one.time_ns for one in good], dtype=np.int64)
    step = np.diff(stamps)
    if np.any(step < 0):
        raise FileFormatError(
            "the clock of the readings runs backwards", where=f"{where}: reading {int(np.argmax(step < 0)) + 2}"
        )
    usable = len(stamps) > 1 and bool(np.all(step > 0))
    return Readings(
        Ts_tracker_target=np.stack([one.T_tracker_target for one in good]),
        time_s=(stamps - stamps[0]) * NS if usable else None,
        oriented=bare == 0,
        left_out=len(everything) - len(good),
        sigma_m=float(np.median([one.sigma_m for one in good])),
    )
