"""Cycles of a run without a record: by the loop's own count, and by the time between the records around them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import NS
from counterflex.runtime.record_ring import CYCLE

MOST_GAPS: Final = 10_000
_RECEIVED = 1


@dataclass(frozen=True)
class MissingCycles:
    """Cycles in a row without a record."""

    after: int  # last cycle before them that has one; 0 where the beginning of the run is missing
    count: int  # how many
    time_s: float  # from the record before them to the one behind; 0 at the beginning and the end of a run


class MissingFinder:
    """Takes the records of one run piece by piece, in order.

    Args:
        cycle: Last cycle before the first record it is given; None where that is not known: nothing is missing before.

    Attributes:
        found: The first :data:`MOST_GAPS`.
        total: Cycles without a record, all of them.
    """

    def __init__(self, cycle: int | None = 0) -> None:
        self.gaps: list[MissingCycles] = []
        self.total = 0
        self._cycle = cycle
        self._time_ns: float | None = None

    def add(self, rows: Float) -> None:
        """Take records, (n, WIDTH) of :class:`counterflex.runtime.record_ring.RecordRing`."""
        if len(rows) == 0:
            return
        begin = int(rows[0, CYCLE]) - 1 if self._cycle is None else self._cycle
        cycles = np.r_[begin, rows[:, CYCLE]].astype(np.int64)
        for k in np.flatnonzero(np.diff(cycles) > 1):
            before = self._time_ns if k == 0 else float(rows[k - 1, _RECEIVED])
            time_s = 0.0 if before is None else (float(rows[k, _RECEIVED]) - before) * NS
            self._add_gap(int(cycles[k]), int(cycles[k + 1] - cycles[k] - 1), time_s)
        self._cycle, self._time_ns = int(cycles[-1]), float(rows[-1, _RECEIVED])

    def join(self, rows: Float, gaps: Sequence[MissingCycles], total: int) -> None:
        """Take what is known of a stretch of records without them.

        Args:
            rows: (k, WIDTH) the first of them is its first record, the last one its last.
            gaps: Within it, the first :data:`MOST_GAPS`.
            total: Cycles without a record within it.
        """
        self.add(rows[:1])
        for gap in gaps:
            if len(self.gaps) < MOST_GAPS:
                self.gaps.append(gap)
        self.total += total
        self._cycle, self._time_ns = int(rows[-1, CYCLE]), float(rows[-1, _RECEIVED])

    def end(self, lost: int) -> None:
        """Say that so many records are known to be missing behind the last one."""
        if lost:
            self._add_gap(self._cycle or 0, lost, 0.0)

    def _add_gap(self, after: int, count: int, time_s: float) -> None:
        self.total += count
        if len(self.gaps) < MOST_GAPS:
            self.gaps.append(MissingCycles(after, count, time_s))
