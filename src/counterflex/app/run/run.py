"""Correct while milling: the loop in a process of its own, the recorder in another, and this one that watches both."""

from __future__ import annotations

import contextlib
import hashlib
import multiprocessing
import pickle
import threading
import time
from collections.abc import Callable
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex import __version__
from counterflex.app.environment import environment
from counterflex.app.run.child import child
from counterflex.app.run.end import AS_REQUESTED, ended_how
from counterflex.app.run.process import END_S, first_word, loop_process, signals_wait
from counterflex.app.run.recorder import SUMMARY, NoLog, Recorder, recorder_process
from counterflex.app.run.session import RunSettings, one_protocol
from counterflex.app.run.status import Status, StatusReader
from counterflex.core import file_content
from counterflex.core.arrays import Int
from counterflex.core.errors import OutputError
from counterflex.core.units import NS
from counterflex.files.logs.run_log import LAYOUT, RunLogWriter
from counterflex.files.summary_file import write_summary
from counterflex.protocols.processes.actions import Actions, actions_path
from counterflex.protocols.processes.control_array import CONTROL, Course, Kept, Life, Request, Shown, Tally
from counterflex.protocols.processes.living import SILENT_S, Beat
from counterflex.protocols.processes.one_run import OneRun
from counterflex.protocols.processes.operator_words import OperatorFile
from counterflex.protocols.processes.shared_words import SharedWords
from counterflex.protocols.processes.snapshot import SnapshotMemory
from counterflex.protocols.session.comparison import compared, not_closed_line
from counterflex.protocols.session.tracker_off import tracker_off
from counterflex.runtime.record_ring import RecordRing

_POLL_S: Final = 0.02
_SHOWN_S: Final = 0.5
RECORDER_END_S: Final = 30.0
"""How long the recorder may take to finish the log, as long as it says that it lives; else it has :data:`END_S`."""
_STOOD: Final = "the recorder stood still and was ended: 0.1 s before that may be missing, log repair counts it"
_DISK_STANDS: Final = "neither the recorder nor the disk responds; log repair counts the missing records"


def run(
    settings: RunSettings,
    out: str | Path,
    *,
    watch: Callable[[Status], None] = lambda _: None,
    most_s: float | None = None,
    started: Callable[[tuple[str, int]], None] = lambda _: None,
    ended: Callable[[], bool] = lambda: False,
    warn: Callable[[str], None] = lambda _: None,
    preparing: Callable[[float, int], None] = lambda _, __: None,
) -> dict[str, Any]:
    """Run the loop and the recorder in processes of their own and watch them from this one.

    Args:
        settings: See :class:`RunSettings`.
        out: Folder of the run log.
        watch: Told the status twice a second.
        most_s: End after so long; None goes on until the telegrams stop.
        started: Told the address at which telegrams are expected, once.
        ended: Whether the robot is known to be gone; asked now and then.
        warn: Told of what is unusual in the cell file and of what monitoring cannot see, a line each.
        preparing: Told again and again, until the robot is waited for, for how many seconds the loop has got ready and
            how many kernels were compiled.

    Returns:
        Summary: cycles, times, states, losses, how it ended, what process monitoring found; also written as
        ``summary.json``.

    Raises:
        CounterflexError: As :func:`open_session`, and when the log cannot be begun.
        KeyboardInterrupt: The second one; after the first the correction is ramped out and the summary returned.
    """
    settings = one_protocol(settings)
    supervised: Supervised | None = None
    try:
        with signals_wait():
            supervised = Supervised(settings, Path(out).absolute())
        where, unusual = supervised.begin(preparing)
        for line in unusual:
            warn(line)
        started(where)
        begin = time.monotonic()
        try:
            supervised.watch(watch, ended, None if most_s is None else begin + most_s)
            summary = supervised.loop_report()
        except KeyboardInterrupt:  # the second one: the loop ramps out and ends by itself, and is still told
            with signals_wait():
                supervised.control[Request.END] = 1
                supervised.loop.join(2.0 * END_S)  # for as long as it may take
                _summarise(supervised, supervised.summary(), settings, Path(out), begin)
            raise
        return _summarise(supervised, summary, settings, Path(out), begin)
    finally:
        if supervised is not None:
            with signals_wait():  # bounded; cut short it would leave memory and locks behind
                supervised.close()


def _summarise(
    supervised: Supervised, report: dict[str, Any], settings: RunSettings, out: Path, begin: float
) -> dict[str, Any]:
    """Complete the summary and write it, unless the disk stands still."""
    summary = report | {"seconds": round(time.monotonic() - begin, 2)}
    summary["ended"] = ended_how(summary, arm=settings.arm)
    if not supervised.disk_stands:
        with contextlib.suppress(OutputError):  # a folder that is gone is told as a log that is lost
            head = {"job": "run", "cell": settings.cell.name, "run": supervised.number}
            write_summary(out / SUMMARY, {**head, **summary})
    return summary


class Supervised:
    """The processes of a run, seen by the one that starts them.

    Args:
        settings: See :class:`RunSettings`.
        out: Folder of the run log, absolute.

    Attributes:
        control: See :mod:`counterflex.protocols.processes.control_array`.
        number: Of the first segment of the log; None before it has begun.
        disk_stands: The log cannot be written to, and whoever tries waits without end.
    """

    def __init__(self, settings: RunSettings, out: Path) -> None:
        self._settings, self._out = settings, out
        self._context = multiprocessing.get_context("spawn")
        self._words = SharedWords(CONTROL)
        self._snapshots = SnapshotMemory(self._words.path)
        self._actions = Actions(actions_path(self._words.path), make=True)
        self.control: Int = np.frombuffer(self._words.words, dtype=np.int64)
        self._ring = RecordRing()
        self._operator: OperatorFile | None = None
        self._one: OneRun | None = None
        self._beat: Beat | None = None
        self._status: StatusReader | None = None
        self._about: dict[str, Any] = {}
        self._trouble = ""
        self.disk_stands = False
        self._interrupted = False
        self.number: int | None = None
        self._fault: BaseException | None = None
        self._pipes: list[Any] = []
        self._up: list[BaseProcess] = []
        shared = (self._ring.name, self._words.path, out)
        self.loop, self._loop_pipe = self._process("loop", Life.LOOP_NS, loop_process, settings, *shared)
        self.recorder, self._recorder_pipe = self._process("recorder", Life.RECORDER_NS, recorder_process, *shared)

    def _process(self, name: str, lives: Life, target: Callable[..., None], *args: Any) -> tuple[BaseProcess, Any]:
        ours, theirs = self._context.Pipe()
        job = pickle.dumps((target, args))
        process = self._context.Process(
            target=child, name=name, args=(job, self._words.path, int(lives), theirs), daemon=True
        )
        self._pipes += [ours, theirs]
        return process, ours

    def begin(self, preparing: Callable[[float, int], None] = lambda _, __: None) -> tuple[tuple[str, int], list[str]]:
        """Start them.

        Args:
            preparing: Told again and again, while they get ready, for how many seconds they have and how many kernels
                they have compiled.

        Returns:
            Where telegrams are expected, what is unusual in the cell file, and what monitoring cannot see.

        Raises:
            CounterflexError: What the loop or the recorder could not do.
        """
        with signals_wait():
            self._one = OneRun(self._out)
            # From the beginning: a loop whose run is killed while it compiles must see that, too.
            self._beat = Beat(self.control, Life.RUN_NS, Life.RUN_PID)
            for process in (self.loop, self.recorder):
                process.start()
        for theirs in self._pipes[1::2]:
            theirs.close()
        # While the others get ready: once the robot sends, recorder and permission to arm must not wait for it.
        from counterflex.protocols.system.system_calls import unlocked_beat

        self._unlocked_beat = unlocked_beat
        where, loop_sha256, layout, unusual, hidden, before = first_word(
            self.loop,
            self._loop_pipe,
            "the loop's process",
            lambda: int(self.control[Life.LOOP_NS]),
            lambda waited_s: preparing(waited_s, int(self.control[Course.COMPILED])),
        )
        self._up.append(self.loop)
        self._about = {**_about(self._settings, loop_sha256), LAYOUT: layout, "not_looked_at": hidden}
        if before:
            self._about["not_closed"] = before
        with contextlib.suppress(OSError):  # who has died is told below
            self._recorder_pipe.send(self._about)
        self._up.append(self.recorder)
        self.number = self._about["run"] = first_word(
            self.recorder, self._recorder_pipe, "the recorder's process", lambda: int(self.control[Life.RECORDER_NS])
        )
        return where, [*unusual, *hidden, *([not_closed_line(before)] if before else [])]

    def _permit(self) -> None:
        """Let it arm and be operated. From here on an interrupt only asks it to end: a correction may be in effect."""
        self.control[Life.MAY_ARM] = self.control[Request.ARM] = int(self._settings.arm)
        self._operator = OperatorFile(self._out, self._words.path)
        self._status = StatusReader(self._ring.name, self.control)
        beat_on = self._unlocked_beat()  # the loop has compiled it: this process reads it from the cache
        if beat_on is not None and self._beat is not None:
            self._beat.unlock(beat_on)

    def watch(self, watch: Callable[[Status], None], ended: Callable[[], bool], end_s: float | None) -> None:
        """Let the loop arm, and watch until it has ended; the first interrupt asks it to end.

        Args:
            watch: Told the status twice a second.
            ended: Whether the robot is known to be gone.
            end_s: When to ask it to end, monotonic; None: not by the time.

        Raises:
            KeyboardInterrupt: The second one.
            CounterflexError: What ended the loop.
        """
        due = [self._permit]
        while self.loop.is_alive():
            try:
                if due:
                    due.pop()()
                self._watch(watch, ended, end_s)
            except KeyboardInterrupt:
                if self._interrupted:
                    raise
                self._interrupted = True
                self.control[Request.END] = 1  # the loop ramps out first; a second time it is left alone
        self._hear()
        if self._fault is not None:
            raise self._fault

    def _watch(self, watch: Callable[[Status], None], ended: Callable[[], bool], end_s: float | None) -> None:
        shown = time.monotonic()
        while self.loop.is_alive():
            self._hear()
            now = time.monotonic()
            if now - shown > _SHOWN_S and self._status is not None:
                shown = now
                status = self._status.look(self._trouble)
                if status is not None:
                    watch(status)
            if (end_s is not None and now > end_s) or ended():
                self.control[Request.END] = 1
            time.sleep(_POLL_S)

    def _hear(self) -> None:
        with contextlib.suppress(EOFError, OSError):
            while self._loop_pipe.poll():
                message = self._loop_pipe.recv()
                if isinstance(message, BaseException):
                    self._fault = message
                else:
                    self._trouble = str(message)

    def loop_report(self) -> dict[str, Any]:
        """The summary; the first interrupt does not lose it: the loop has ended, and so will what is waited for.

        Raises:
            KeyboardInterrupt: The second one.
        """
        try:
            return self.summary()
        except KeyboardInterrupt:
            if self._interrupted:
                raise
            self._interrupted = True
            return self.summary()

    def summary(self) -> dict[str, Any]:
        """Counts of the recorder; where it died or stands still, what is still there is written and counted here."""
        recorded = self._recorder_summary()
        died = recorded is None and not self.recorder.is_alive()
        if recorded is None:
            recorded = self._inherited() if died else self._instead()
        self.recorder.join(END_S)
        exit_code = self.loop.exitcode
        return {
            **recorded,
            "trouble": self._trouble,
            "recorder_died": died,
            "tracker_off": tracker_off(self.control),
            "compared": compared(self.control),
            "malformed": int(self.control[Tally.MALFORMED]),
            "another_port": int(self.control[Course.ANOTHER_PORT]) or None,
            "unanswered": int(self.control[Course.UNANSWERED]) or None,
            "holds_feed": not self.control[Life.CANNOT_HOLD],
            "not_looked_at": self._about.get("not_looked_at", []),
            "not_closed": self._about.get("not_closed"),
            "loop_ended": AS_REQUESTED if exit_code == 0 and self.control[Life.ENDED] else f"died ({exit_code})",
        }

    def _recorder_summary(self) -> dict[str, Any] | None:
        """Its summary; None where it has died or does not come to its end: a bounded wait, longer while it lives."""
        begin = time.monotonic()
        with contextlib.suppress(EOFError, OSError):
            while not self._recorder_pipe.poll(_POLL_S):
                silent_s = (time.monotonic_ns() - int(self.control[Life.RECORDER_NS])) * NS
                if time.monotonic() - begin > (END_S if silent_s > SILENT_S else RECORDER_END_S):
                    return None
            with signals_wait():
                summary: dict[str, Any] = self._recorder_pipe.recv()
            return summary
        self.recorder.join(END_S)
        return None

    def _instead(self) -> dict[str, Any]:
        """The recorder stands still: it is ended, and what it has not taken is written here, if the disk takes it."""
        taken = int(self.control[Kept.TAKEN])
        self.recorder.kill()
        self.recorder.join(END_S)
        summaries: list[dict[str, Any]] = []
        if not self.recorder.is_alive():
            writer = threading.Thread(target=self._inherit_into, args=(summaries,), daemon=True)
            writer.start()
            writer.join(RECORDER_END_S)
        if summaries:
            return summaries[0] | {"log_trouble": _STOOD}
        self.disk_stands = True
        recorder = Recorder(self._ring.name, NoLog(), self.control)
        recorder.take()
        summaries.append(recorder.summary())
        recorder.close()
        counts = {"cycles": int(self.control[Shown.CYCLES]), "records": taken, "records_lost": self._ring.count - taken}
        return summaries[-1] | counts | {"log_trouble": _DISK_STANDS}

    def _inherit_into(self, summaries: list[dict[str, Any]]) -> None:
        with contextlib.suppress(OSError):
            summaries.append(self._inherited())

    def _inherited(self) -> dict[str, Any]:
        """The recorder has died: go on with the log behind what it has taken, as far as the ring still has it."""
        log = RunLogWriter(self._out, self._about)
        recorder = Recorder(self._ring.name, log, self.control, skipped=int(self.control[Kept.TAKEN]))
        try:
            recorder.take()
        finally:
            log.close()
            recorder.close()
        return recorder.summary()

    def close(self) -> None:
        """Ask the loop to end, wait for it, free everything; what does not end is left alone and ends by itself."""
        self.control[Request.END] = 1
        if self._operator is not None:
            self._operator.close()
        self._recorder_pipe.close()
        for process in (self.loop, self.recorder):
            if process.pid is not None:
                if process not in self._up:  # nothing is corrected yet, nothing is written
                    process.kill()
                process.join(END_S)
        if self.recorder.pid is not None and (time.monotonic_ns() - int(self.control[Life.RECORDER_NS])) * NS > END_S:
            self.recorder.kill()  # it stands still: who waits for it would wait without end
        self._loop_pipe.close()
        if self._status is not None:
            self._status.close()
        if self._beat is not None:
            self._beat.close()
        self._ring.close()
        del self.control
        self._snapshots.close()
        self._actions.close()
        self._words.remove()
        self._words.close()
        if self._one is not None:
            self._one.close()


def _about(settings: RunSettings, loop_sha256: str) -> dict[str, Any]:
    files = {"cell": settings.cell, **settings.robot_files, "plan": settings.plan, "program": settings.program}
    hashes = {
        name: hashlib.sha256(file_content.content(p)).hexdigest()
        for name, p in files.items()
        if p and Path(p).is_file()
    }
    return {
        "counterflex": __version__,
        "files": {name: str(p) for name, p in files.items() if p},
        "sha256": hashes,
        "loop_sha256": loop_sha256,
        "machine": environment(),
        "compensated": settings.compensated,
        "wall_minus_monotonic_ns": time.time_ns() - time.monotonic_ns(),
    }
