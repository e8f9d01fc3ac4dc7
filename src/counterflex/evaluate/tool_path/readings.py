"""Positions of the tool as they were logged, and how much they scatter."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, as_float
from counterflex.core.errors import InputError
from counterflex.geometry import pose

LEAST: Final = 50
"""Fewer readings are no path."""
_NORMAL: Final = 0.67449  # Median of the magnitude of a standard normal value


@dataclass(frozen=True, eq=False)
class ToolReadings:
    """Positions of the tool along a program, in the order of time.

    Raises:
        InputError: Too few readings, lengths differ, a value is not finite, or time does not go on.
    """

    p: Float  # (n, 3) m, tool tip, in the frame of the log
    time_s: Float | None = None  # (n,) s, increasing; None where it is not known
    # (n, 3) m, commanded tool tip at the same instants, part frame; None where it is not known
    command_part: Float | None = None

    def __post_init__(self) -> None:
        """Check the readings."""
        n = len(as_float("p", self.p, (None, 3)))
        if n < LEAST:
            raise InputError("the log has too few readings", value=n, limit=f">= {LEAST}")
        if self.time_s is not None and np.any(np.diff(as_float("time_s", self.time_s, (n,))) <= 0.0):
            raise InputError(
                "time of the log does not go on", where=f"reading {int(np.argmin(np.diff(self.time_s))) + 2}"
            )
        if self.command_part is not None:
            as_float("command_part", self.command_part, (n, 3))

    def __len__(self) -> int:
        """Number of readings."""
        return len(self.p)

    def moved(self, T: Float) -> ToolReadings:
        """The same in another frame."""
        return replace(self, p=pose.transform(T, self.p))

    def only(self, rows: Bool) -> ToolReadings:
        """Some of the readings."""
        time, command = self.time_s, self.command_part
        return ToolReadings(
            self.p[rows], None if time is None else time[rows], None if command is None else command[rows]
        )

    @property
    def clock_s(self) -> Float:
        """(n,) s; the number of the reading where time is not known."""
        return np.arange(len(self), dtype=np.float64) if self.time_s is None else self.time_s

    def noise_m(self) -> float:
        """Standard deviation of one reading along one axis, m: ``median |d3| / (0.6745 sqrt(20))``.

        d3 are third differences of the readings, of all axes.
        Vibration of the tool that is as fast as the readings counts as noise.
        """
        third = np.diff(self.p, n=3, axis=0)
        moving = np.any(third != 0.0, axis=1)
        return float(np.median(np.abs(third[moving]))) / (_NORMAL * np.sqrt(20.0)) if moving.any() else 0.0
