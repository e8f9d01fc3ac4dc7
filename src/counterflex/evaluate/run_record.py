"""Record of an online run: cycles, states with their times, changes with their causes, answering times."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, Generic, TypeVar

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.errors import InputError
from counterflex.core.units import UM, plain
from counterflex.evaluate.loop_timing import LatencyHistogram, Percentiles
from counterflex.evaluate.missing_cycles import MissingCycles, MissingFinder
from counterflex.evaluate.process_record import ProcessFigures, ProcessRecord
from counterflex.runtime import record_ring as record
from counterflex.runtime.estimator.fusion import Source
from counterflex.runtime.state.supervisor import Cause, State

_RECEIVED, _SENT, _ELAPSED = 1, 2, 3
Kind = TypeVar("Kind")
MOST_CHANGES: Final = 10_000
_SOURCES: Final = 16  # sets of four sources
_PAIR: Final = 4  # sets of two force sensors


@dataclass(frozen=True)
class RecordChange(Generic[Kind]):
    """A change of the supervisor's state, of the sources of the estimate, or of which of two force sensors is used."""

    cycle: int  # first cycle of the change, 1 is the loop's first
    time_s: float  # since the first record
    before: Kind
    after: Kind
    cause: Cause = Cause.NONE  # as latched then; of sources why one of the cell's is missing

    def shown(self) -> dict[str, Any]:
        """Plain values."""
        return plain(self, "cycle time_s:3 from=before to=after cause")


@dataclass(frozen=True)
class RunFigures:
    """Figures of one run."""

    records: int  # records read
    answered: int  # cycles in which a telegram came
    waited: int  # cycles in which none came
    telegrams_lost: int  # cycles that the controller counted and no telegram was seen of
    records_lost: int  # cycles without a record, by the loop's own count
    time_s: float  # from the first record to the last
    # cycles and seconds by state, in the order of State; states that were not met are left out
    states: dict[State, tuple[int, float]]
    causes: dict[Cause, int]  # cycles by cause of a hold or fault, most frequent first
    changes: tuple[RecordChange[State], ...]  # the first MOST_CHANGES
    # from the return of the receive call to the return of the send call; None where nothing was answered
    reply: Percentiles | None
    largest_m: float  # largest correction that was sent, length of its translation
    largest_step_m: float  # largest change of it from one record to the next cycle's
    # cycles by what the estimate rested on, most frequent first; empty without an estimator
    sources: dict[Source, int] = field(default_factory=dict)
    sources_changes: tuple[RecordChange[Source], ...] = ()  # the first MOST_CHANGES changes of it
    process: ProcessFigures | None = None  # what process monitoring found
    # cycles by the force sensors of two that were used; empty where there is one or none
    pair: dict[int, int] = field(default_factory=dict)
    pair_changes: tuple[RecordChange[int], ...] = ()  # the first MOST_CHANGES changes of that

    def shown(self) -> dict[str, Any]:
        """Counts and duration."""
        return plain(self, "records records_lost answered waited telegrams_lost seconds=time_s:3")


class RunRecord:
    """Takes the records of one run piece by piece, in order, or what is known of them without them.

    Args:
        begun: The first record that it takes is the run's first, so that cycles before it are missing.
    """

    def __init__(self, *, begun: bool = True) -> None:
        self._records = self._answered = self._waited = self._telegrams_lost = 0
        self._missing = MissingFinder(0 if begun else None)
        self._largest = self._largest_step = 0.0
        self._cycles: Int = np.zeros(len(State), dtype=np.int64)
        self._times: Float = np.zeros(len(State))
        self._causes: Int = np.zeros(len(Cause), dtype=np.int64)
        self._changes: list[RecordChange[State]] = []
        self._process = ProcessRecord()
        self._sources: Int = np.zeros(_SOURCES, dtype=np.int64)
        self._sources_changes: list[RecordChange[Source]] = []
        self._pair: Int = np.zeros(_PAIR, dtype=np.int64)
        self._pair_changes: list[RecordChange[int]] = []
        self._reply: list[Float] = []
        self._classes: LatencyHistogram | None = None
        self._last: Float | None = None
        self._begin = self._end = 0.0

    def add(self, rows: Float) -> None:
        """Take records.

        Args:
            rows: (n, WIDTH) of :class:`counterflex.runtime.record_ring.RecordRing`.

        Raises:
            InputError: Another shape, or a state or cause that does not exist.
        """
        if rows.ndim != 2 or rows.shape[1] != record.WIDTH:
            raise InputError("records have the wrong shape", value=rows.shape, limit=("n", record.WIDTH))
        if len(rows) == 0:
            return
        states = _numbers(rows[:, record.column("out_state")], len(State), "state")
        joined, known = self._joined(rows, states)
        self._missing.add(rows)
        self._count(rows, states)
        self._process.add(rows)
        self._pass_time(joined, known)
        self._find_changes(joined, known)
        self._go_on(rows)

    def join(self, sums: Mapping[str, Any], rows: Float) -> None:
        """Take what is known of a stretch of records without them, see :mod:`counterflex.evaluate.run_digest`.

        Args:
            sums: As :meth:`sums` of a record of that stretch alone gives them.
            rows: (k, WIDTH) its first and its last record, and those at changes and events.

        Raises:
            InputError: Sums that are none.
        """
        states = _numbers(rows[:, record.column("out_state")], len(State), "state")
        joined, known = self._joined(rows, states)
        self._records += int(sums["records"])
        self._answered += int(sums["answered"])
        self._waited += int(sums["waited"])
        self._telegrams_lost += int(sums["telegrams_lost"])
        self._largest = max(self._largest, float(sums["largest_m"]))
        self._largest_step = max(self._largest_step, float(sums["largest_step_m"]))
        for mine, name in (
            (self._cycles, "states"),
            (self._times, "times_s"),
            (self._causes, "causes"),
            (self._sources, "sources"),
            (self._pair, "pair"),
        ):
            mine += _of_length(sums[name], len(mine), name).astype(mine.dtype)
        if self._classes is None:
            self._classes = LatencyHistogram()
        self._classes.join(sums["reply"])
        self._missing.join(rows, [MissingCycles(*one) for one in sums["gaps"]], int(sums["missing"]))
        self._process.join(rows, int(sums["records"]), int(sums["slowed"]), float(sums["least_speed"]))
        if len(joined) > len(rows):  # from the stretch before to this one
            self._pass_time(joined[:2], known[:2])
        self._find_changes(joined, known)
        self._go_on(rows)

    def sums(self) -> dict[str, Any]:
        """Plain values from which, with the records at changes, :meth:`join` knows all that was taken."""
        classes = LatencyHistogram()
        if self._classes is not None:
            classes.join(self._classes.plain())
        for times in self._reply:
            classes.add(times / UM)
        return {
            "records": self._records,
            "answered": self._answered,
            "waited": self._waited,
            "telegrams_lost": self._telegrams_lost,
            "largest_m": self._largest,
            "largest_step_m": self._largest_step,
            "states": self._cycles.tolist(),
            "times_s": self._times.tolist(),
            "causes": self._causes.tolist(),
            "sources": self._sources.tolist(),
            "pair": self._pair.tolist(),
            "reply": classes.plain(),
            "gaps": [[gap.after, gap.count, gap.time_s] for gap in self._missing.gaps],
            "missing": self._missing.total,
            **self._process.sums(),
        }

    def _joined(self, rows: Float, states: Int) -> tuple[Float, Int]:
        """Rows and their states behind the last one taken before."""
        if self._last is None:
            self._begin = float(rows[0, _RECEIVED])
            return rows, states
        before = int(self._last[record.column("out_state")])
        return np.concatenate([self._last[None], rows]), np.concatenate([[before], states])

    def _go_on(self, rows: Float) -> None:
        self._last = rows[-1].copy()
        self._end = float(rows[-1, _RECEIVED])

    def end(self, lost: int) -> None:
        """Say that so many records are known to be missing behind the last one."""
        self._missing.end(lost)

    def _count(self, rows: Float, states: Int) -> None:
        received = rows[:, _ELAPSED] > 0
        self._records += len(rows)
        self._answered += int(received.sum())
        self._waited += int((~received).sum())
        self._telegrams_lost += int((rows[received, _ELAPSED] - 1).sum())
        self._reply.append((rows[received, _SENT] - rows[received, _RECEIVED]) * 1e-9)
        self._cycles += np.bincount(states, minlength=len(State))
        soft = _numbers(rows[:, record.column("out_soft")], len(Cause), "cause")
        hard = _numbers(rows[:, record.column("out_hard")], len(Cause), "cause")
        self._causes += np.bincount(np.where(hard > 0, hard, soft), minlength=len(Cause))
        self._sources += np.bincount(
            _numbers(rows[:, record.column("out_sources")], _SOURCES, "set of sources"), minlength=_SOURCES
        )
        self._pair += np.bincount(
            _numbers(rows[:, record.column("pair_used")], _PAIR, "set of force sensors"), minlength=_PAIR
        )
        length = np.linalg.norm(rows[:, record.RESULTS : record.RESULTS + 3], axis=1)
        self._largest = max(self._largest, float(length.max()))

    def _pass_time(self, rows: Float, states: Int) -> None:
        """Time and movement from each record to the next."""
        step = np.diff(rows[:, record.CYCLE]).astype(np.int64)
        next_to = step == 1
        time = np.diff(rows[:, _RECEIVED]) * 1e-9
        np.add.at(self._times, states[:-1][step > 0], time[step > 0])
        moved = np.linalg.norm(np.diff(rows[:, record.RESULTS : record.RESULTS + 3], axis=0), axis=1)[next_to]
        self._largest_step = max(self._largest_step, float(moved.max(initial=0.0)))

    def _find_changes(self, rows: Float, states: Int) -> None:
        """Changes from each record to the next."""
        for k in np.flatnonzero(np.diff(states)):
            if len(self._changes) >= MOST_CHANGES:
                break
            row = rows[k + 1]
            self._changes.append(
                RecordChange(
                    int(row[record.CYCLE]),
                    (float(row[_RECEIVED]) - self._begin) * 1e-9,
                    State(int(states[k])),
                    State(int(states[k + 1])),
                    Cause(int(row[record.column("out_cause")])),
                )
            )

        pair = rows[:, record.column("pair_used")].astype(np.int64)
        for k in np.flatnonzero(np.diff(pair))[: MOST_CHANGES - len(self._pair_changes)]:
            cycle, time_s = int(rows[k + 1, record.CYCLE]), (float(rows[k + 1, _RECEIVED]) - self._begin) * 1e-9
            self._pair_changes.append(RecordChange(cycle, time_s, int(pair[k]), int(pair[k + 1])))
        sources = rows[:, record.column("out_sources")].astype(np.int64)
        for k in np.flatnonzero(np.diff(sources)):
            if len(self._sources_changes) >= MOST_CHANGES:
                break
            row = rows[k + 1]
            self._sources_changes.append(
                RecordChange(
                    int(row[record.CYCLE]),
                    (float(row[_RECEIVED]) - self._begin) * 1e-9,
                    Source(int(sources[k])),
                    Source(int(sources[k + 1])),
                    Cause(int(row[record.column("out_degraded")])),
                )
            )

    def _rested(self) -> dict[Source, int]:
        if not self._sources[1:].any():
            return {}
        order = sorted(np.flatnonzero(self._sources), key=lambda c: -int(self._sources[c]))
        return {Source(int(c)): int(self._sources[c]) for c in order}

    def _percentiles(self) -> Percentiles | None:
        """Of the times to answer: exact where all records were taken, else at most one percent above one that was."""
        if self._classes is None:
            reply = np.concatenate(self._reply) if self._reply else np.zeros(0)
            return Percentiles.of(reply) if len(reply) else None
        classes = LatencyHistogram()
        classes.join(self.sums()["reply"])
        return classes.percentiles(UM) if classes.n else None

    def figures(self) -> RunFigures:
        """Figures of what was taken so far."""
        order = sorted(np.flatnonzero(self._causes[1:]) + 1, key=lambda c: -int(self._causes[c]))
        return RunFigures(
            records=self._records,
            answered=self._answered,
            waited=self._waited,
            telegrams_lost=self._telegrams_lost,
            records_lost=self._missing.total,
            time_s=(self._end - self._begin) * 1e-9,
            states={s: (int(self._cycles[s]), float(self._times[s])) for s in State if self._cycles[s]},
            causes={Cause(int(c)): int(self._causes[c]) for c in order},
            changes=tuple(self._changes),
            reply=self._percentiles(),
            largest_m=self._largest,
            largest_step_m=self._largest_step,
            sources=self._rested(),
            pair={k: int(n) for k, n in enumerate(self._pair) if n} if self._pair[1:].any() else {},
            pair_changes=tuple(self._pair_changes),
            sources_changes=tuple(self._sources_changes),
            process=self._process.figures(),
        )


def _numbers(values: Float, count: int, what: str) -> Int:
    good = (values >= 0) & (values < count) & (values == np.floor(values))
    if not good.all():
        raise InputError(f"a record holds a {what} that does not exist", value=float(values[~good][0]))
    return values.astype(np.int64)


def _of_length(values: Sequence[float], count: int, what: str) -> Float:
    """Sums by number, as many as there are kinds today, or fewer where older code wrote them."""
    if len(values) > count:
        raise InputError(f"sums of more kinds of {what} than there are", value=len(values), limit=count)
    out: Float = np.zeros(count)
    out[: len(values)] = values
    return out
