"""Replay: recorded inputs through a loop of the same files; its answers must be the recorded ones bit for bit.

A record holds everything that a cycle was given. What a loop remembers follows from all cycles before, so a replay
needs the record from the loop's first cycle on; after a gap it can only begin again where the loop itself did.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, as_float
from counterflex.core.errors import InputError
from counterflex.runtime import record_ring as record
from counterflex.runtime.loop import Loop
from counterflex.runtime.record_ring import COLUMNS, WIDTH

_COMPARED: Final = slice(record.RESULTS, record.CYCLE)


@dataclass(frozen=True)
class Difference:
    """The first place where a replay leaves the record.

    Attributes:
        cycle: Of the loop, 1 is its first.
        counter_ms: The controller's counter in that cycle.
        column: Name of the first number that differs.
        logged: As recorded.
        replayed: As computed now.
        columns: How many numbers of that cycle differ.
    """

    cycle: int
    counter_ms: int
    column: str
    logged: float
    replayed: float
    columns: int


@dataclass(frozen=True)
class Gap:
    """Where records are missing.

    Attributes:
        after: Last cycle before it; 0 where the beginning is missing.
        missing: Cycles between the records, or what is missing of the beginning.
    """

    after: int
    missing: int


class Replay:
    """Feeds the records of one run, in order and in pieces of any size, through a loop.

    Args:
        loop: Of the same cell, plan and settings; it is reset.

    Attributes:
        compared: Cycles that were computed again and compared.
        skipped: Records after a gap: what the loop then knew is not known.
        difference: The first one, or None; nothing is computed after it.
        gaps: Where records are missing.
    """

    def __init__(self, loop: Loop) -> None:
        self._loop = loop
        self._cycle = 0
        self._known = True
        self._answers: Float = np.zeros((0, record.CYCLE - record.RESULTS))
        self.compared = self.skipped = 0
        self.difference: Difference | None = None
        self.gaps: list[Gap] = []
        loop.reset()

    def __call__(self, rows: Float) -> None:
        """Feed records.

        Args:
            rows: (n, WIDTH) of :class:`counterflex.runtime.record_ring.RecordRing`, in order.

        Raises:
            InputError: Rows of another shape, or a loop's count of cycles that is no number.
        """
        if rows.ndim != 2 or rows.shape[1] != WIDTH:
            raise InputError("records have the wrong shape", value=rows.shape, limit=("n", WIDTH))
        cycles = as_float("records: cycle", rows[:, record.CYCLE], (None,)).astype(np.int64)
        done: list[int] = []
        answers = np.empty((len(rows), record.CYCLE - record.RESULTS))
        loop = self._loop
        for k, cycle in enumerate(cycles.tolist()):
            if self.difference is not None:
                break
            if not self._follows(cycle):
                self.skipped += 1
                continue
            loop.given[:] = rows[k, record.GIVEN : record.FLAGS]
            loop.flags[:] = rows[k, record.FLAGS : record.RESULTS]
            loop.monitor.fast[:] = rows[k, record.FAST : record.SENSOR]
            loop.run()
            answers[k, : record.OUTCOME - record.RESULTS] = loop.results
            answers[k, record.OUTCOME - record.RESULTS : record.MONITOR - record.RESULTS] = loop.outcome
            answers[k, record.MONITOR - record.RESULTS : record.MONITOR_OUTCOME - record.RESULTS] = loop.monitor.results
            answers[k, record.MONITOR_OUTCOME - record.RESULTS :] = loop.monitor.outcome
            done.append(k)
            if len(done) >= 256:
                self._compare(rows, answers, done)
        self._compare(rows, answers, done)

    def _follows(self, cycle: int) -> bool:
        """Whether the loop's state before this cycle is known."""
        before, self._cycle = self._cycle, cycle
        if cycle == 1:
            self._loop.reset()
            self._known = True
        elif cycle != before + 1:
            self.gaps.append(Gap(before, cycle - before - 1))
            self._known = False
        return self._known

    def _compare(self, rows: Float, answers: Float, done: list[int]) -> None:
        if not done or self.difference is not None:
            done.clear()
            return
        logged, now = np.ascontiguousarray(rows[done, _COMPARED]), answers[done]
        different = logged.view(np.int64) != now.view(np.int64)
        different &= ~(np.isnan(logged) & np.isnan(now))
        bad = np.flatnonzero(different.any(axis=1))
        if len(bad):
            at_row, at_column = int(bad[0]), int(np.argmax(different[bad[0]]))
            row = rows[done[at_row]]
            self.difference = Difference(
                cycle=int(row[record.CYCLE]),
                counter_ms=int(row[0]),
                column=COLUMNS[record.RESULTS + at_column],
                logged=float(logged[at_row, at_column]),
                replayed=float(now[at_row, at_column]),
                columns=int(different[at_row].sum()),
            )
            self.compared += at_row
        else:
            self.compared += len(done)
        done.clear()
