"""Holds and faults in the records of an online run: when each began and why."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import plain
from counterflex.runtime import record_ring as record
from counterflex.runtime.state.supervisor import Cause, State

MOST_INCIDENTS: Final = 10_000
_RECEIVED, _ELAPSED = 1, 3
_PATH: Final = record.COLUMNS.index("path_distance")
_INCIDENTS: Final = (State.HOLD, State.FAULT)


@dataclass(frozen=True)
class Incident:
    """The loop went into a hold or a fault. A fault out of a hold is an incident of its own."""

    cycle: int  # first cycle in it, 1 is the loop's first
    time_s: float  # since the first record of the run
    before: State | None  # state left; None where the first record of the run is in it already
    state: State  # hold or fault
    cause: Cause  # as latched then
    # distance of the commanded point from the plan in that record, or the one before where it was larger; 0 without a
    # plan
    path_m: float = 0.0
    elapsed: int = 0  # cycles of the controller since the telegram before; 0 where none came

    def shown(self) -> dict[str, Any]:
        """Plain values."""
        return plain(self, "cycle time_s:3 state cause before path_distance_mm=path_m:3 cycles_since_telegram=elapsed")


class IncidentFinder:
    """Takes the records of one run piece by piece, in order.

    Attributes:
        incidents: The first :data:`MOST_INCIDENTS`, in order.
        total: All of them, also those beyond.
    """

    def __init__(self) -> None:
        self.incidents: list[Incident] = []
        self.total = 0
        self._state: State | None = None
        self._path_m = 0.0  # of the last record
        self._begin_ns: float | None = None

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
        states = rows[:, record.column("out_state")]
        if not np.isin(states, list(State)).all():
            raise InputError("a record holds a state that does not exist", value=float(states.max()))
        if self._begin_ns is None:
            self._begin_ns = float(rows[0, _RECEIVED])
        earlier = np.concatenate([[-1.0 if self._state is None else float(self._state)], states[:-1]])
        for k in np.flatnonzero((states != earlier) & np.isin(states, _INCIDENTS)):
            self.total += 1
            if self.total > MOST_INCIDENTS:
                continue
            row = rows[k]
            cause = float(row[record.column("out_cause")])
            if cause not in list(Cause):
                raise InputError("a record holds a cause that does not exist", value=cause)
            self.incidents.append(
                Incident(
                    int(row[record.CYCLE]),
                    (float(row[_RECEIVED]) - self._begin_ns) * 1e-9,
                    None if earlier[k] < 0 else State(int(earlier[k])),
                    State(int(states[k])),
                    Cause(int(cause)),
                    max(self._path_m if k == 0 else float(rows[k - 1, _PATH]), float(row[_PATH])),
                    int(row[_ELAPSED]),
                )
            )
        self._state, self._path_m = State(int(states[-1])), float(rows[-1, _PATH])
