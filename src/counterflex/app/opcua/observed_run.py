"""A run seen from the OPC UA server: found by its log folder and read only; it asks one thing of it, to acknowledge."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from counterflex.app.panel.figures import Figures
from counterflex.app.panel.watched_run import LOOK_S, SILENT_S, Seen
from counterflex.app.run.operator_requests import ask
from counterflex.core.errors import CounterflexError, OutputError
from counterflex.core.units import NS
from counterflex.files.machine_file import machine_file
from counterflex.protocols.processes.actions import COMMAND_LANE, Actions, actions_path
from counterflex.protocols.processes.control_array import Life
from counterflex.protocols.processes.operator_words import find
from counterflex.protocols.processes.shared_words import SharedWords
from counterflex.protocols.processes.snapshot import SnapshotReader, snapshot_path


class ObservedRun:
    """The run whose log lies in a folder; when it has ended, the next one there. The run does not notice.

    Args:
        folder: As ``run`` is given it with ``--out``.
        clock_ns: Monotonic.

    Attributes:
        seen: Whether there is a run, and whether its loop lives.
        about: What the run says of itself; empty before the first.
        figures: What was last seen, :meth:`counterflex.app.panel.figures.Figures.of`; empty before the first snapshot.
        last: Last snapshot, or None.
        why: Why a run that goes on cannot be read, or empty.
    """

    def __init__(self, folder: Path, clock_ns: Callable[[], int] = time.monotonic_ns) -> None:
        self.folder, self._clock_ns = folder, clock_ns
        self.seen = Seen.WAITING
        self.about: dict[str, Any] = {}
        self.figures: dict[str, Any] = {}
        self.last: Any = None
        self.why = ""
        self._words: SharedWords | None = None
        self._reader: SnapshotReader | None = None
        self._made: Figures | None = None
        self._left: Path | None = None
        self._looked = self._last_ns = 0

    def poll(self) -> None:
        """Look: attach to a run that goes on, take what is new."""
        now = self._clock_ns()
        words, reader, made = self._words, self._reader, self._made
        if words is None or reader is None or made is None:
            if now - self._looked >= round(LOOK_S / NS):
                self._looked = now
                self._attach()
            return
        shots = reader.take()
        if len(shots):
            self._last_ns, self.seen, self.last = now, Seen.RUNNING, shots[-1]
            self.figures = made.of(shots, now, reader.missed)
        if reader.ended or words.words[Life.ENDED]:
            self.seen = Seen.ENDED
            self.close()
        elif not len(shots) and (now - max(int(words.words[Life.LOOP_NS]), self._last_ns)) * NS > SILENT_S:
            self.seen = Seen.SILENT
            if not words.path.exists():  # killed, and cleared away
                self.close()

    def _attach(self) -> None:
        words: SharedWords | None = None
        try:
            words = find(self.folder, machine_file().parent)
            if words.path == self._left or words.words[Life.ENDED]:
                words.close()
                return
            self._reader = SnapshotReader(snapshot_path(words.path))
        except CounterflexError as fault:
            if words is not None:
                self.why = str(fault)
                words.close()
            return
        self._words, self.about, self.why = words, self._reader.about, ""
        self._made, self.figures, self.last = Figures(self.about), {}, None
        self.seen, self._last_ns = Seen.RUNNING, self._clock_ns()

    def acknowledge(self, who: str) -> dict[str, Any]:
        """Ask the loop to acknowledge, and note who did in the run log; waits up to 0.3 s.

        Args:
            who: Name of the user.

        Returns:
            ``done``, or why not (``refused``); ``state`` and more of
            :func:`counterflex.app.run.operator_requests.ask`.

        Raises:
            CounterflexError: No run goes on, or its loop does not answer.
        """
        if self._words is None:
            raise OutputError("no run goes on", where=str(self.folder))
        answer = ask(self._words.words, "reset", where=str(self.folder))
        facts = {"who": who, "from": "opcua", "action": "reset", "done": bool(answer["done"]), "state": answer["state"]}
        with contextlib.suppress(CounterflexError):
            actions = Actions(actions_path(self._words.path))
            actions.note(COMMAND_LANE, facts | ({"refused": answer["refused"]} if answer["refused"] else {}))
            actions.close()
        return answer

    def close(self) -> None:
        """Leave the run."""
        if self._words is not None:
            self._left = self._words.path
            self._words.close()
        if self._reader is not None:
            self._reader.close()
        self._words = self._reader = self._made = None
