"""Replay: recorded inputs through a loop of the same files; its answers must be the recorded ones bit for bit.

A record holds everything that a cycle was given. What a loop remembers follows from all cycles before, so a replay
needs the record from the loop's first cycle on, or from one whose state was recorded too; after a gap it begins again
at the next such state, or where the loop itself did. A state of cycle 0 is what a loop began with whose robot held a
correction already.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, as_float
from counterflex.core.errors import InputError
from counterflex.runtime import record_ring as record
from counterflex.runtime.loop import Loop
from counterflex.runtime.record_ring import COLUMNS, WIDTH
from counterflex.runtime.state_slots import LoopState

_COMPARED: Final = slice(record.RESULTS, record.CYCLE)


@dataclass(frozen=True)
class Difference:
    """The first place where a replay leaves the record."""

    cycle: int  # of the loop, 1 is its first
    counter_ms: int  # the controller's counter in that cycle
    column: str  # name of the first number that differs
    logged: float  # as recorded
    replayed: float  # as computed now
    columns: int  # how many numbers of that cycle differ


@dataclass(frozen=True)
class Gap:
    """A place at which records are missing."""

    after: int  # last cycle before it; 0 where the beginning is missing
    missing: int  # cycles between the records, or what is missing of the beginning


class Replay:
    """Feeds the records of one run, in order and in pieces of any size, through a loop.

    Args:
        loop: Of the same cell, plan and settings; it is reset.
        after: Cycle whose recorded state it begins from; records up to it are passed over. 0: from the beginning.

    Attributes:
        compared: Cycles that were computed again and compared.
        skipped: Records after a gap: what the loop then knew is not known.
        difference: The first one, or None; nothing is computed after it.
        gaps: Where records are missing.
        begun: Cycles from whose recorded state it began.
    """

    def __init__(self, loop: Loop, *, after: int = 0) -> None:
        self._loop, self._after = loop, after
        self._cycle = after
        self._known = after == 0
        self._states: dict[int, LoopState] = {}
        self.begun: list[int] = []
        self._answers: Float = np.zeros((0, record.CYCLE - record.RESULTS))
        self.compared = self.skipped = 0
        self.difference: Difference | None = None
        self.gaps: list[Gap] = []
        loop.reset()

    def __call__(self, rows: Float, states: Sequence[LoopState] = ()) -> None:
        """Feed records.

        Args:
            rows: (n, WIDTH) of :class:`counterflex.runtime.record_ring.RecordRing`, in order.
            states: Of the loop, recorded with them or before.

        Raises:
            InputError: Rows of another shape, a loop's count of cycles that is no number, or another loop's state.
        """
        if rows.ndim != 2 or rows.shape[1] != WIDTH:
            raise InputError("records have the wrong shape", value=rows.shape, limit=("n", WIDTH))
        cycles = as_float("records: cycle", rows[:, record.CYCLE], (None,)).astype(np.int64)
        self._states = {cycle: state for cycle, state in self._states.items() if cycle >= self._cycle}
        self._states |= {state.cycle: state for state in states}
        done: list[int] = []
        answers = np.empty((len(rows), record.CYCLE - record.RESULTS))
        loop = self._loop
        for k, cycle in enumerate(cycles.tolist()):
            if self.difference is not None:
                break
            if cycle <= self._after:
                continue
            if not self._follows(cycle):
                self.skipped += 1
                continue
            loop.inputs[0][:] = rows[k, record.GIVEN : record.FLAGS]
            loop.inputs[1][:] = rows[k, record.FLAGS : record.RESULTS]
            fast, results, outcome = loop.monitor.columns
            fast[:] = rows[k, record.FAST : record.SENSOR]
            loop.run()
            answers[k, : record.OUTCOME - record.RESULTS] = loop.answers[0]
            answers[k, record.OUTCOME - record.RESULTS : record.MONITOR - record.RESULTS] = loop.answers[1]
            answers[k, record.MONITOR - record.RESULTS : record.MONITOR_OUTCOME - record.RESULTS] = results
            answers[k, record.MONITOR_OUTCOME - record.RESULTS :] = outcome
            done.append(k)
            if len(done) >= 256:
                self._compare(rows, answers, done)
        self._compare(rows, answers, done)

    def _follows(self, cycle: int) -> bool:
        """Return whether the loop's state before this cycle is known."""
        before, self._cycle = self._cycle, cycle
        if cycle == 1:
            self._loop.reset()
            self._known = True
            if (first := self._states.pop(0, None)) is not None:
                self._loop.restore(first.words, first.layout)
        elif cycle != before + 1:
            self.gaps.append(Gap(before, cycle - before - 1))
            self._known = False
        if not self._known and cycle - 1 in self._states:
            state = self._states[cycle - 1]
            self._loop.restore(state.words, state.layout)
            self.begun.append(cycle - 1)
            self._known = True
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
