"""A scan as it is in its file: points in the file's unit and pose, of any number, little memory."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, Float32
from counterflex.core.errors import FileFormatError
from counterflex.core.units import INCH, MM, UM

UNITS: Final = {"um": UM, "mm": MM, "cm": 10.0 * MM, "inch": INCH, "m": 1.0}
"""SI value of the units that a scan may be in, by name."""
LIMIT_POINTS: Final = 100_000_000


@dataclass(frozen=True, eq=False)
class Scan:
    """Measured points."""

    name: str
    kind: str
    chunks: tuple[Float32, ...]  # (k, 3) float32 each, in file units, counted from ``origin``
    origin: Float  # (3,) in file units
    unit_m: float | None = None  # SI value of one file unit where the file states it, else None
    ball_radius: float = 0.0  # Where the points are centres of a probe's ball: its radius, in file units; else 0
    dropped: int = 0  # Points of the file that were no finite numbers

    def __len__(self) -> int:
        """Number of points."""
        return sum(len(chunk) for chunk in self.chunks)

    def sample(self, count: int) -> Float:
        """(k, 3) at most so many points, evenly taken from the whole file, in file units from ``origin``."""
        step = max(1, -(-len(self) // count))
        taken, place = [], 0
        for chunk in self.chunks:
            taken.append(chunk[(-place) % step :: step])
            place += len(chunk)
        out: Float = np.concatenate(taken).astype(np.float64)
        return out


@dataclass
class PointStore:
    """Takes the points of a file, a few at a time."""

    path: Path
    kind: str
    _chunks: list[Float32] = field(default_factory=list)
    _origin: Float | None = None
    _count: int = 0
    _dropped: int = 0

    def add(self, points: Float) -> None:
        """Take points (k, 3) in file units; those that are not finite are counted and left out.

        Raises:
            FileFormatError: They are more than a hundred million.
        """
        finite = np.isfinite(points).all(axis=1)
        if not finite.all():
            self._dropped += int(np.count_nonzero(~finite))
            points = points[finite]
        if len(points) == 0:
            return
        self._count += len(points)
        if self._count > LIMIT_POINTS:
            raise FileFormatError(
                "the scan has too many points",
                where=str(self.path),
                limit=f"{LIMIT_POINTS:.0e}",
                hint="Export it with a larger distance of points",
            )
        if self._origin is None:
            self._origin = np.asarray(points[0], np.float64).copy()
        self._chunks.append((points - self._origin).astype(np.float32))

    def skip(self, count: int) -> None:
        """Count points of the file that hold nothing."""
        self._dropped += count

    def extend(self, blocks: Iterable[Float]) -> PointStore:
        """Take every block."""
        for block in blocks:
            self.add(block)
        return self

    def scan(self, unit_m: float | None = None, ball_radius: float = 0.0) -> Scan:
        """What was taken. Raises FileFormatError: there is no valid point."""
        if self._origin is None:
            raise FileFormatError(
                "the file holds no valid point",
                where=str(self.path),
                value=f"{self.kind}, {self._dropped} points that are no finite numbers" if self._dropped else self.kind,
            )
        chunks = tuple(self._chunks)
        return Scan(self.path.name, self.kind, chunks, self._origin, unit_m, ball_radius, self._dropped)
