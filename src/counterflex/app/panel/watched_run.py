"""A run seen from the panel: found by its log folder, read without disturbing it, told that the panel lives."""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable
from enum import Enum
from pathlib import Path
from typing import Any, Final

from counterflex.app.panel.figures import Figures, Trail
from counterflex.app.panel.metrics import RunMetrics, exposition
from counterflex.app.run.operator_requests import Clock, ask
from counterflex.core.errors import CounterflexError, OutputError
from counterflex.core.units import NS
from counterflex.files.machine_file import machine_file
from counterflex.protocols.processes.actions import PANEL_LANE, Actions, actions_path
from counterflex.protocols.processes.control_array import Life, Panel, Request
from counterflex.protocols.processes.operator_words import find
from counterflex.protocols.processes.shared_words import SharedWords
from counterflex.protocols.processes.snapshot import SnapshotReader, snapshot_path
from counterflex.protocols.session.snapshot_kernel import THERE, panel_state

SILENT_S: Final = 0.5
"""A loop that has shown nothing for so long: what is shown counts as old."""
LOOK_S: Final = 0.5
"""How often a run is looked for."""


class Seen(Enum):
    """Last view of a run."""

    WAITING = "waiting"
    """None goes on in this folder."""
    RUNNING = "running"
    SILENT = "silent"
    """Its loop has died or stands still."""
    ENDED = "ended"


class WatchedRun:
    """The run whose log lies in a folder; when it has ended, the next one there.

    Args:
        folder: As ``run`` is given it with ``--out``.
    """

    def __init__(self, folder: Path, clock_ns: Callable[[], int] = time.monotonic_ns) -> None:
        self.folder, self._clock_ns = folder, clock_ns
        self.seen = Seen.WAITING
        self.about: dict[str, Any] = {}  # What the run says of itself; empty before the first
        self.figures: dict[str, Any] = {}  # What was last seen, :meth:`Figures.of`; empty before the first snapshot
        self.trail = Trail()
        self.why = ""  # Why a run that goes on cannot be watched, or empty
        self.runs = 0
        self._words: SharedWords | None = None
        self._reader: SnapshotReader | None = None
        self._actions: Actions | None = None
        self._made: Figures | None = None
        self._metrics: RunMetrics | None = None
        self._looked = self._last_ns = 0
        self._left: Path | None = None
        self.last: Any = None

    def poll(self, clients: int = 0) -> bool:
        """Look: attach to a run that goes on, take what is new, say that the panel lives.

        Args:
            clients: Pages that are connected, told to the run.
        """
        now = self._clock_ns()
        if self._words is None:
            if now - self._looked >= round(LOOK_S / NS):
                self._looked = now
                self._attach()
            return False
        words, reader = self._words.words, self._reader
        if reader is None or self._made is None or self._metrics is None:
            return False
        words[Panel.NS], words[Panel.CLIENTS] = now, clients
        shots = reader.take()
        if len(shots):
            self._last_ns = now
            self.seen = Seen.RUNNING
            self.figures = self._made.of(shots, now, reader.missed)
            self._metrics.add(shots, reader.missed)
            self.trail.add(shots, self._made.frames, planned=bool(self.about["planned"]))
            self.last = shots[-1]
        if reader.ended or words[Life.ENDED]:
            self.seen = Seen.ENDED
            self._leave()
        elif not len(shots) and self._silent_s(now) > SILENT_S:
            self.seen = Seen.SILENT
            if not self._words.path.exists():  # killed, and cleared away
                self._leave()
        return bool(len(shots))

    def _silent_s(self, now: int) -> float:
        """Since the loop last said that it lives; a robot that does not send yet is no silence of the loop."""
        words = self._words
        lived = 0 if words is None else int(words.words[Life.LOOP_NS])
        return (now - max(lived, self._last_ns)) * NS

    def _attach(self) -> None:
        words: SharedWords | None = None
        try:
            words = find(self.folder, machine_file().parent)
            if words.path == self._left or words.words[Life.ENDED]:
                words.close()
                return
            self._require_alone(words)
            reader = SnapshotReader(snapshot_path(words.path))
        except CounterflexError as fault:
            if words is not None:
                self.why = str(fault)
                words.close()
            return
        self._words, self._reader, self.about, self.why = words, reader, reader.about, ""
        with contextlib.suppress(CounterflexError):
            self._actions = Actions(actions_path(words.path))
        self._made, self.trail, self.figures = Figures(reader.about), Trail(), {}
        self._metrics = RunMetrics(reader.about)
        words.words[Panel.PID], words.words[Panel.NS] = os.getpid(), self._clock_ns()
        self.seen, self._last_ns = Seen.RUNNING, self._clock_ns()
        self.runs += 1
        self.note({"who": "panel", "action": "panel opened", "done": True})

    def _require_alone(self, words: SharedWords) -> None:
        pid = int(words.words[Panel.PID])
        if panel_state(int(words.words[Panel.NS]), self._clock_ns()) == THERE and pid != os.getpid():
            raise OutputError(
                "another panel watches this run",
                where=str(self.folder),
                value=f"process {pid}",
                hint="Open its page: one panel serves many browsers",
            )

    def require_free(self) -> None:
        """Refuse to watch a run that another panel watches. Raises OutputError: there is one."""
        try:
            words = find(self.folder, machine_file().parent)
        except CounterflexError:
            return
        with words:
            self._require_alone(words)

    def stop_now(self) -> None:
        """Ask the loop to stop, without waiting for what comes of it: one number is written into its memory."""
        if self._words is not None:
            self._words.words[Request.STOP] = 1

    def request(self, action: str, who: str, source: str) -> dict[str, Any]:
        """Ask something of the loop and note who did; waits up to 0.3 s.

        Args:
            action: ``stop``, ``reset`` or ``arm``.

        Raises:
            CounterflexError: No run goes on, or its loop does not answer. A stop stays asked for.
        """
        words = self._words
        facts = {"who": who, "from": source, "action": action}
        if words is None:
            raise OutputError("no run goes on", where=str(self.folder), hint="Start counterflex run")
        try:
            answer = ask(words.words, action, where=str(self.folder), clock=Clock(self._clock_ns))
        except CounterflexError as fault:
            self.note({**facts, "done": False, "refused": str(fault)[:60]})
            raise
        self.note({**facts, "done": answer["done"], "refused": answer["refused"][:60], "state": answer["state"]})
        return answer

    def note(self, facts: dict[str, Any]) -> None:
        """Have something that an operator did written into the run log."""
        if self._actions is not None:
            self._actions.note(PANEL_LANE, facts)

    def open_metrics(self) -> str:
        """The run as OpenMetrics text; of a run that is silent or has ended only that it is."""
        goes_on = self._metrics if self.seen is Seen.RUNNING else None
        return exposition(self.seen.value, [one.value for one in Seen], self.age_s(), goes_on)

    def age_s(self) -> float | None:
        """Return how old what is shown is, s; None before the first snapshot."""
        return None if self._last_ns == 0 else (self._clock_ns() - self._last_ns) * NS

    def _leave(self) -> None:
        if self._words is not None:
            self._words.words[Panel.NS] = 0
            self._left = self._words.path
            self._words.close()
        if self._reader is not None:
            self._reader.close()
        if self._actions is not None:
            self._actions.close()
        self._words = self._reader = self._actions = None

    def close(self) -> None:
        """Say goodbye to the run; a cell that asks for a panel holds."""
        if self._words is not None:
            self.note({"who": "panel", "action": "panel closed", "done": True})
        self._leave()
