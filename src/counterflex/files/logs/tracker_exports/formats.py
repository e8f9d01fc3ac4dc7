"""Formats of tracker exports by name, and how a file of one is read."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Protocol

import numpy as np

from counterflex.core import file_content
from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError
from counterflex.core.file_kind import of_bytes
from counterflex.core.units import NS
from counterflex.files.logs.tracker_exports.dtrack import DTrackLines
from counterflex.files.logs.tracker_exports.point_table import PointTableLines
from counterflex.files.logs.tracker_exports.spatial_analyzer import SpatialAnalyzerLines
from counterflex.files.logs.tracker_log import TrackerLines
from counterflex.protocols.tracker.telegram import BEAM_BROKEN, INACCURATE, NO_ORIENTATION, TrackerPose


class ExportLines(Protocol):
    """Reads an export line by line."""

    @property
    def ready(self) -> bool:
        """Whether what stands before the measurements has come."""

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
    """What a tracker measured, bad readings left out.

    Attributes:
        Ts_tracker_target: (n, 4, 4) m; the rotation is the identity where there is no orientation.
        time_s: (n,) s since the first reading, increasing; None where the stamps are too coarse or missing.
        oriented: Whether orientations were measured.
        left_out: Readings with a broken beam or marked inaccurate.
        sigma_m: Standard deviation of a position as stated, 0 where it is not.
    """

    Ts_tracker_target: Float
    time_s: Float | None
    oriented: bool
    left_out: int
    sigma_m: float


def lines_of(name: str, where: str) -> ExportLines:
    """A reader of lines.

    Raises:
        FileFormatError: There is no such format.
    """
    if name not in FORMATS:
        raise FileFormatError("unknown format of a tracker's export", value=name, limit=", ".join(FORMATS))
    return FORMATS[name][0](where)


def read_export(path: str | Path, name: str = OWN) -> Readings:
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
        raise FileFormatError("not a text file", where=str(file), value=foreign, hint="Export the measurements as text")
    if name == OWN and text.startswith("// SpatialAnalyzer"):
        raise FileFormatError("this is an export of SpatialAnalyzer", where=str(file), hint="--format spatial-analyzer")
    return collected(_measured(text.splitlines(), lines_of(name, str(file))), str(file))


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
