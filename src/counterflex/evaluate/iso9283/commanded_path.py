"""The commanded path of a path test: points, corners, and where across it the attained paths are measured."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, Int, as_float
from counterflex.core.errors import InputError
from counterflex.core.units import DEG, MM

CORNER_RAD: Final = 20.0 * DEG
"""Sharper turns of the polyline are corners; flatter ones approximate an arc."""
ZONE: Final = 0.1
"""Share of a stretch at either end that is no place of measurement: acceleration, rounded corners."""
PLACES: Final = 100
"""Places of measurement along the whole path, about."""


@dataclass(frozen=True, eq=False)
class CommandedPath:
    """A polyline."""

    p: Float  # (k, 3) m, k >= 2, in the frame of the commands, no two successive ones equal
    R: Float | None = None  # (k, 3, 3) commanded orientation at them, or None
    speed_m_s: float | None = None  # commanded speed along the path, or None

    def __post_init__(self) -> None:
        """Check it.

        Raises:
            InputError: Fewer than two points, or a point that repeats the one before.
        """
        p = as_float("p", self.p, (None, 3))
        if len(p) < 2:
            raise InputError("a path needs two points", value=len(p), limit=">= 2")
        if float(self._steps.min()) <= 0.0:
            raise InputError(
                "a point of the path repeats the one before", where=f"point {int(self._steps.argmin()) + 2}"
            )

    @property
    def _steps(self) -> Float:
        out: Float = np.linalg.norm(np.diff(self.p, axis=0), axis=1)
        return out

    @property
    def length(self) -> Float:
        """(k,) m, length along the path at each point."""
        return np.concatenate([[0.0], np.cumsum(self._steps)])

    @property
    def corners(self) -> Int:
        """Points at which the path turns by more than :data:`CORNER_RAD`."""
        t = np.diff(self.p, axis=0) / self._steps[:, None]
        turn = np.arccos(np.clip(np.sum(t[1:] * t[:-1], axis=1), -1.0, 1.0))
        return np.flatnonzero(turn > CORNER_RAD) + 1

    @property
    def stretches(self) -> tuple[tuple[float, float], ...]:
        """From and to, as lengths along the path, m: the parts between corners and ends."""
        ends = [0.0, *self.length[self.corners].tolist(), float(self.length[-1])]
        return tuple(itertools.pairwise(ends))

    def at(self, s: Float) -> tuple[Float, Float]:
        """Points (m, 3) m and directions (m, 3) at lengths (m,) m along the path."""
        length = self.length
        j = np.clip(np.searchsorted(length, s, side="right") - 1, 0, len(self.p) - 2)
        t = np.diff(self.p, axis=0)[j] / self._steps[j, None]
        return self.p[j] + (np.asarray(s) - length[j])[:, None] * t, t

    def orientation(self, s: Float) -> Float | None:
        """(m, 3, 3) commanded orientation at lengths (m,) m, that of the point before; None where none is known."""
        if self.R is None:
            return None
        out: Float = self.R[np.clip(np.searchsorted(self.length, s, side="right") - 1, 0, len(self.p) - 1)]
        return out

    def places(self, share: float = 1.0 - 2.0 * ZONE, count: int = PLACES) -> Float:
        """Lengths (m,) m along the path at which it is measured: evenly over the middle ``share`` of each stretch."""
        total = float(self.length[-1])
        out: list[Float] = []
        for begin, end in self.stretches:
            m = max(5, round(count * (end - begin) / total))
            out.append(begin + (end - begin) * (0.5 + share * ((np.arange(m) + 0.5) / m - 0.5)))
        return np.concatenate(out)


def path_of(p: Float, R: Float | None = None, speed_m_s: float | None = None) -> CommandedPath:
    """A path of points that may repeat; repeated ones (within 1 um) are one."""
    points = as_float("p", p, (None, 3))
    kept = [0]
    for k in range(1, len(points)):
        if float(np.linalg.norm(points[k] - points[kept[-1]])) > 1e-3 * MM:
            kept.append(k)
    return CommandedPath(points[kept], None if R is None else R[kept], speed_m_s)
