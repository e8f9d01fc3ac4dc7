"""The recorder of a run: takes what the loop hands over, writes the log, shows the state, and serves the operator.

It is another process than the loop's and can stand still or die without disturbing it. What it has taken is told to the
loop by the control array, so that a loop whose records nobody takes is not armed.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from counterflex import __version__
from counterflex.app.incidents import numbered
from counterflex.app.operator_requests import OperatorRequests
from counterflex.app.process_events import shown_process
from counterflex.core.arrays import Float
from counterflex.evaluate.incidents import IncidentFinder
from counterflex.evaluate.latency import LatencyHistogram
from counterflex.evaluate.process_record import ProcessEvent, ProcessRecord
from counterflex.files.run_log import RunLog
from counterflex.links.control_array import Kept, Request, Tally
from counterflex.links.operator_port import OperatorPort
from counterflex.runtime.fusion import Source
from counterflex.runtime.layout import O_CAUSE, O_DEGRADED, O_FEED_HOLD, O_SOFT, O_SOURCES, O_STATE
from counterflex.runtime.monitor_layout import R_SPEED
from counterflex.runtime.record_ring import MONITOR, OUTCOME, RESULTS, RecordRing
from counterflex.runtime.supervisor import Cause, State

_POLL_S: Final = 0.02
_SHOWN_S: Final = 0.5
_INCIDENTS_SHOWN: Final = 250


@dataclass(frozen=True)
class Status:
    """What a run looks like from outside, now and then.

    Attributes:
        state: Of the supervisor.
        cause: Why.
        cycles: Answered.
        correction_um: (3,) of the tool, part axes.
        compute_us: Median time of a cycle since the last status.
        log_trouble: Why the log cannot be written, or empty.
        foreign: Telegrams from an address that is not the controller's, so far.
        sources: What the estimate rests on; nothing without an estimator.
        degraded: Why one of its sources is missing.
        events: Of the process, since the last status.
        speed: Share of the programmed speed that is asked for.
        feed_hold: A feed hold is asked for.
        tares: Zeros of the force sensor refused in a row; it is tried again until one is accepted.
        idle_n: What the sensor showed then.
        idle_nm: Likewise.
        trouble: What failed in the loop's own program, or empty.
    """

    state: State
    cause: Cause
    cycles: int
    correction_um: tuple[float, float, float]
    compute_us: float
    log_trouble: str
    foreign: int = 0
    sources: Source = Source.NOTHING
    degraded: Cause = Cause.NONE
    events: tuple[ProcessEvent, ...] = ()
    speed: float = 1.0
    feed_hold: bool = False
    tares: int = 0
    idle_n: float = 0.0
    idle_nm: float = 0.0
    trouble: str = ""


class Recorder:
    """Records one run.

    Args:
        ring: Name of the ring of records.
        log: Where they go.
        control: Of :data:`counterflex.links.session.CONTROL` numbers, shared with the loop.
        operator: Where the operator's requests come.
        watch: Told the status twice a second.
        arm: Arm as soon as all checks are passed.
    """

    def __init__(
        self,
        ring: str,
        log: RunLog,
        control: Any,
        operator: OperatorPort,
        watch: Callable[[Status], None],
        *,
        arm: bool,
    ) -> None:
        self._reader = RecordRing(ring)
        self._reader.rewind()
        self._log, self._control, self._watch, self._arm = log, control, watch, arm
        self._requests = OperatorRequests(operator, control, may_arm=arm)
        self._shown = time.monotonic()
        self._times = LatencyHistogram()
        self._states: dict[str, int] = {}
        self._causes: set[str] = set()
        self._cycles, self._worst = 0, 0.0
        self._recent: list[Float] = []
        self._seen = ProcessRecord()
        self._incidents = IncidentFinder()
        self._events: list[ProcessEvent] = []
        self.trouble = ""

    def close(self) -> None:
        """Leave the ring."""
        self._reader.close()

    def hear(self, said: object) -> None:
        """What the loop's process said: a fault that ended it is raised, what failed in a cycle is shown.

        Raises:
            BaseException: The fault.
        """
        if isinstance(said, BaseException):
            raise said
        self.trouble = str(said)

    def work(self, *, end: bool) -> None:
        """Take, write, show and serve once, then rest a little.

        Args:
            end: Ask the loop to end.
        """
        control = self._control
        rows = self._take()
        now = time.monotonic()
        if now - self._shown > _SHOWN_S and self._recent:
            self._watch(self._status())
            self._shown, self._recent, self._events = now, [], []
        if end:
            control[Request.END] = 1
        self._arm = self._arm and not np.any(rows[:, OUTCOME + O_STATE] >= State.ARMED)
        self._arm = self._requests.serve(None if len(rows) == 0 else rows[-1]) or self._arm
        control[Request.ARM] = int(self._arm)
        try:
            time.sleep(_POLL_S)
        except KeyboardInterrupt:
            if control[Request.END]:
                raise
            control[Request.END] = 1  # the loop ramps out first; a second time it is left alone

    def last(self) -> None:
        """What is left when the loop has ended."""
        self._take()

    def _take(self) -> Float:
        rows = self._reader.take()
        control = self._control
        state = self._reader.states.take()
        if len(rows) or state is not None:
            self._log.add(rows, state=state)
        if len(rows):
            self._count(rows)
        control[Kept.TAKEN] = self._reader.taken
        control[Kept.TROUBLE] = int(bool(self._log.trouble))
        return rows

    def _count(self, rows: Float) -> None:
        compute = (rows[:, 2] - rows[:, 1]) * 1e-3
        answered = rows[:, 3] > 0
        self._times.add(compute[answered])
        self._recent.append(rows)
        self._events += self._seen.add(rows)
        self._incidents.add(rows)
        self._cycles += int(np.sum(answered))
        self._worst = max(self._worst, float(np.max(np.linalg.norm(rows[:, RESULTS : RESULTS + 3], axis=1))))
        for value, count in zip(*np.unique(rows[:, OUTCOME + O_STATE], return_counts=True), strict=True):
            name = State(int(value)).name.lower()
            self._states[name] = self._states.get(name, 0) + int(count)
        for column in (O_CAUSE, O_SOFT, O_DEGRADED):
            self._causes |= {Cause(int(c)).name.lower() for c in np.unique(rows[:, OUTCOME + column]) if c}

    def _status(self) -> Status:
        last = self._recent[-1][-1]
        tail = np.concatenate([(r[:, 2] - r[:, 1]) * 1e-3 for r in self._recent])
        control = self._control
        x, y, z = (float(v) * 1e6 for v in last[RESULTS : RESULTS + 3])
        return Status(
            State(int(last[OUTCOME + O_STATE])),
            Cause(int(last[OUTCOME + O_CAUSE]) or int(last[OUTCOME + O_SOFT])),
            self._cycles,
            (x, y, z),
            float(np.median(tail)),
            self._log.trouble,
            int(control[Tally.FOREIGN]),
            Source(int(last[OUTCOME + O_SOURCES])),
            Cause(int(last[OUTCOME + O_DEGRADED])),
            tuple(self._events),
            float(last[MONITOR + R_SPEED]),
            bool(last[OUTCOME + O_FEED_HOLD]),
            int(control[Tally.TARES]),
            control[Tally.IDLE_MN] * 1e-3,
            control[Tally.IDLE_MNM] * 1e-3,
            self.trouble,
        )

    def _shown_incidents(self) -> dict[str, Any]:
        found = [one.shown() for one in numbered({1: self._incidents})]
        counts = Counter(f"{one['state']} {one['cause']}" for one in found)
        return {
            "incidents": found[:_INCIDENTS_SHOWN],
            "incidents_total": self._incidents.total,
            "incidents_by_cause": dict(counts.most_common()),
        }

    def summary(self) -> dict[str, Any]:
        """What the run was, plain values."""
        return {
            "cycles": self._cycles,
            "states": self._states,
            "causes": sorted(self._causes),
            **self._shown_incidents(),
            **shown_process(self._seen.figures()),
            "largest_correction_um": round(self._worst * 1e6, 1),
            "compute_us": {
                "p50": round(self._times.at(0.5), 1),
                "p99": round(self._times.at(0.99), 1),
                "p99.9": round(self._times.at(0.999), 1),
                "max": round(self._times.largest, 1),
            },
            "telegrams": {tally.name.lower(): int(self._control[tally]) for tally in Tally if tally < Tally.TARES},
            "records": self._log.written,
            "records_lost": self._log.lost + self._reader.dropped,
            "trouble": self.trouble,
            "counterflex": __version__,
        }
