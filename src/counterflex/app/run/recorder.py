"""The recorder of a run: takes what the loop hands over, writes the log, counts, and says at the end what the run was.

It is a process of its own, that does nothing else: a disk that stands still, or a recorder that is stopped, disturbs
neither the loop nor the operator, as long as the memory in between holds the records. What it has taken is told to the
loop by the control array, so that a loop whose records nobody takes is not armed. When the process that started it has
died, it writes to the end what the loop still does.
"""

from __future__ import annotations

import contextlib
import signal
import time
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex import __version__
from counterflex.app.run.child import outlive_starter
from counterflex.app.run.end import AS_REQUESTED, RunCauses, RunEnd
from counterflex.app.run.incidents import numbered, shown_process
from counterflex.core.arrays import Float, Int
from counterflex.core.errors import CounterflexError
from counterflex.evaluate.incidents import IncidentFinder
from counterflex.evaluate.loop_timing import LatencyHistogram
from counterflex.evaluate.process_record import ProcessRecord
from counterflex.files.logs.run_log import RunLogWriter
from counterflex.files.summary_file import write_summary
from counterflex.protocols.processes.actions import Actions, actions_path
from counterflex.protocols.processes.control_array import CONTROL, Kept, Life, Tally
from counterflex.protocols.processes.living import Beat, Living
from counterflex.protocols.processes.shared_words import SharedWords
from counterflex.protocols.system.signals import hear_signals
from counterflex.runtime.record_ring import RESULTS, RecordRing, column
from counterflex.runtime.state.supervisor import State
from counterflex.runtime.state_slots import LoopState

SUMMARY: Final = "summary.json"
_POLL_S: Final = 0.02
_INCIDENTS_SHOWN: Final = 250


class NoLog:
    """In place of a log that cannot be written: all records are lost."""

    def __init__(self) -> None:
        self.written = self.lost = self.trouble_number = 0
        self.trouble = ""

    def add(self, rows: Float, *, state: LoopState | None = None) -> None:  # noqa: ARG002 - as a log takes them
        """Count them."""
        self.lost += len(rows)

    def note(self, facts: Mapping[str, Any]) -> None:
        """Nothing is noted."""


class Recorder:
    """Records one run.

    Args:
        ring: Name of the ring of records.
        log: Where they go.
        control: Shared, see :mod:`counterflex.protocols.processes.control_array`.
        skipped: Rows that another recorder has taken before.
        actions: What operators do, or None.
    """

    def __init__(
        self, ring: str, log: RunLogWriter | NoLog, control: Int, *, skipped: int = 0, actions: Actions | None = None
    ) -> None:
        self._reader = RecordRing(ring)
        self._reader.rewind(skipped)
        self._log, self._control, self._actions = log, control, actions
        self._done: list[dict[str, Any]] = []
        self._times = LatencyHistogram()
        self._states: dict[str, int] = {}
        self._causes = RunCauses()
        self._cycles, self._worst = 0, 0.0
        self._seen = ProcessRecord()
        self._incidents = IncidentFinder()
        self._end = RunEnd()

    def close(self) -> None:
        """Leave the ring."""
        self._reader.close()

    def take(self) -> None:
        """Take what is there, write it, count it, tell the loop."""
        rows = self._reader.take()
        control = self._control
        state = self._reader.states.take()
        self._log.add(rows, state=state)
        if len(rows):
            self._count(rows)
        for one in () if self._actions is None else self._actions.take():
            self._log.note(one)
            self._done.append(one)
        control[Kept.TAKEN] = self._reader.taken
        control[Kept.TROUBLE] = self._log.trouble_number
        control[Kept.LOST] = self._log.lost + self._reader.dropped

    def _count(self, rows: Float) -> None:
        compute = (rows[:, 2] - rows[:, 1]) * 1e-3
        answered = rows[:, 3] > 0
        self._times.add(compute[answered])
        self._seen.add(rows)
        self._incidents.add(rows)
        self._end.add(rows)
        self._cycles += int(np.sum(answered))
        self._worst = max(self._worst, float(np.max(np.linalg.norm(rows[:, RESULTS : RESULTS + 3], axis=1))))
        for value, count in zip(*np.unique(rows[:, column("out_state")], return_counts=True), strict=True):
            name = State(int(value)).name.lower()
            self._states[name] = self._states.get(name, 0) + int(count)
        self._causes.add(rows)

    def _shown_incidents(self) -> dict[str, Any]:
        shown = [one.shown() for one in numbered({1: self._incidents})]
        counts = Counter(f"{one['state']} {one['cause']}" for one in shown)
        return {
            "incidents": shown[:_INCIDENTS_SHOWN],
            "incidents_total": self._incidents.total,
            "incidents_by_cause": dict(counts.most_common()),
        }

    def summary(self) -> dict[str, Any]:
        """Describe the run in plain values."""
        control = self._control
        return {
            "cycles": self._cycles,
            "states": self._states,
            "causes": self._causes.names,
            "correction_ended": self._end.shown(),
            **self._shown_incidents(),
            **shown_process(self._seen.figures()),
            "operator_actions": self._done[-_INCIDENTS_SHOWN:],
            "largest_correction_um": round(self._worst * 1e6, 1),
            "compute_us": {
                "p50": round(self._times.at(0.5), 1),
                "p99": round(self._times.at(0.99), 1),
                "p99.9": round(self._times.at(0.999), 1),
                "max": round(self._times.largest, 1),
            },
            "telegrams": {tally.name.lower(): int(control[tally]) for tally in Tally if tally < Tally.TARES},
            "records": self._log.written,
            "records_lost": self._log.lost + self._reader.dropped,
            "log_trouble": self._log.trouble,
            "loop_ended": AS_REQUESTED if control[Life.ENDED] else "died",
            "counterflex": __version__,
        }


def recorder_process(ring_name: str, words: Path, out: Path, pipe: Any) -> None:
    """The recorder's own process: is told what the run is made of, begins the log, records until the loop has ended.

    What ends the run is left to the process that started this one, and to the loop: the end of a run is recorded too.

    Args:
        ring_name: Of the ring of records.
        words: Where the shared numbers of the control array are.
        out: Folder of the log.
        pipe: Says what the run is made of, or nothing when there will be no run; told the number of the log's first
            segment when it has begun, the summary at the end, or what went wrong.
    """
    for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGTSTP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    hear_signals()
    shared = SharedWords(CONTROL, words)
    control: Int = np.frombuffer(shared.words, dtype=np.int64)
    try:
        about = pipe.recv()
    except (EOFError, OSError):
        return
    try:
        log = RunLogWriter(out, about)
    except CounterflexError as fault:
        pipe.send(fault)
        return
    beat = Beat(control, Life.RECORDER_NS, Life.RECORDER_PID)
    outlive_starter()
    loop, run = Living(control, Life.LOOP_PID), Living(control, Life.RUN_PID)
    done = actions_path(words)
    actions = Actions(done) if done.exists() else None
    recorder = Recorder(ring_name, log, control, actions=actions)
    with contextlib.suppress(OSError):
        pipe.send(log.first)
    while not (control[Life.ENDED] or loop.gone()):
        recorder.take()
        time.sleep(_POLL_S)
    recorder.take()
    log.close()
    summary = recorder.summary()
    if run.gone():
        with contextlib.suppress(CounterflexError, OSError):
            write_summary(out / SUMMARY, {"job": "run", "run": log.first, "run_died": True, **summary})
        shared.remove()
        done.unlink(missing_ok=True)
    with contextlib.suppress(OSError):
        pipe.send(summary)
    beat.close()
    recorder.close()
    if actions is not None:
        actions.close()
    loop.close()
    run.close()
