"""The online loop for hours against a simulated cell in real time: does it grow, does it become slow?

A machine that stands still for some cycles makes the loop hold, or stop the robot, as it should. The simulated robot
program obeys, and this job is the operator: it acknowledges and arms again by the requests of ``counterflex operator``,
so that the rest of the time is measured too. All of it is counted.
"""

from __future__ import annotations

import math
import multiprocessing
import os
import socket
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex import __version__
from counterflex.app.environment import environment
from counterflex.app.run import log as run_log, session as online_session
from counterflex.app.run.operator_requests import request
from counterflex.core import atomic
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, in_parts, silent
from counterflex.files.summary_file import write_summary
from counterflex.protocols.system import timing_probe
from counterflex.protocols.system.machine import processor_times
from counterflex.protocols.system.realtime import RealtimePreparation, prepared
from counterflex.protocols.system.signals import heard_when_asked
from counterflex_lab.reproduce.closed_loop import free_port
from counterflex_lab.soak import replayed_cell as steady
from counterflex_lab.soak.figures import figures, minute
from counterflex_lab.soak.onlookers import Onlookers
from counterflex_lab.soak.operator import SteadyOperator
from counterflex_lab.soak.processes import (
    BLOCK,
    PERIOD_S,
    SAMPLE_S,
    cell_process,
    echo_process,
    end_processes,
    next_message,
    run_process,
)
from counterflex_lab.soak.timed_block import Block

MINUTES: Final = "minutes.csv"
MEMORY: Final = "memory.csv"
SUMMARY: Final = "summary.json"
LOG: Final = "log"
_LOOKED_S: Final = 0.5
"""How often the operator looks."""
_ABSENT_S: Final = 60.0
"""Without a telegram for so long, the loop ends by itself: longer than a robot program needs to be started again."""
_PREPARE_S: Final = 60.0
"""Time to plan and record the pass, about: its weight in the progress that is shown."""


@dataclass(frozen=True)
class SoakSettings:
    """Settings of a long run."""

    minutes: float = 60.0  # how long
    force: str = "scale"  # mode of the table ``[online]``
    tracker: str = "observer"  # likewise
    keep_log: bool = False  # keep the run log; about 1 GB per hour
    onlookers: bool = False  # panel and OPC UA server run beside it, each with a client that goes on reading


@dataclass
class _Watched:
    """Results of a run."""

    operator: SteadyOperator  # requests
    interrupted: bool = False  # it was ended early, by a signal
    blocks: list[Block] = field(default_factory=list)  # what the simulated cell timed, minute by minute
    samples: list[dict[str, float]] = field(default_factory=list)  # memory and load, every 5 s
    run: dict[str, Any] = field(default_factory=dict)  # summary of the recorder
    stolen: float = 0.0  # share of the processors' time that the host took
    realtime: dict[str, RealtimePreparation] = field(default_factory=dict)  # by process
    # counts of what the clients of panel and OPC UA server got, and how the servers ended
    onlookers: dict[str, Any] = field(default_factory=dict)


def run(settings: SoakSettings, out: str | Path, *, progress: Progress = silent) -> dict[str, Any]:
    """Run it and write ``summary.json``, ``minutes.csv`` and ``memory.csv`` into a folder.

    Args:
        settings: See :class:`SoakSettings`.
        out: Folder.
        progress: Progress callback, fraction 0 to 1.

    Returns:
        The summary: times to answer beside those of a do-nothing echo, growth with its standard error, every hold and
        fault with what the operator did.

    A request to end (Ctrl-C, SIGTERM) once cycles are timed ends the run in order, and all of it is written.

    Raises:
        InputError: ``minutes`` out of range.
        OutputError: A process of the run ended early.
        KeyboardInterrupt: Nothing was timed yet, or it came a second time; then nothing is written.
    """
    if not 0.02 <= settings.minutes <= 10_000.0:
        raise InputError("minutes to run", value=settings.minutes, limit="0.02 .. 10000")
    part = in_parts(progress, {"preparing": _PREPARE_S, "soaking": 60.0 * settings.minutes})
    with atomic.atomic_folder(out) as staging, tempfile.TemporaryDirectory() as work:
        job = steady.prepare(
            Path(work), _cycles(settings), force=settings.force, tracker=settings.tracker, progress=part["preparing"]
        )
        log = staging / LOG if settings.keep_log else Path(work) / LOG
        watched = _watched(settings, job, log, part["soaking"])
        minutes = [minute(k, block) for k, block in enumerate(watched.blocks)]
        _write_table(staging / MINUTES, minutes)
        _write_table(staging / MEMORY, watched.samples)
        samples = watched.samples
        summary = {
            "job": "soak",
            "minutes": settings.minutes,
            "interrupted": watched.interrupted,
            "force": settings.force,
            "tracker": settings.tracker,
            **figures(watched.blocks, minutes, samples),
            "operator": {"requests": dict(watched.operator.counts), "events": watched.operator.events},
            "run": watched.run,
            "load": {"mean": float(np.mean([s["load"] for s in samples])), "stolen": round(watched.stolen, 4)},
            "realtime": {name: {"fifo": one.fifo, "locked": one.locked} for name, one in watched.realtime.items()},
            "onlookers": watched.onlookers,
            "log": _log_figures(log),
            "machine": environment(),
            "counterflex": __version__,
        }
        write_summary(staging / SUMMARY, summary)
    return summary


def _cycles(settings: SoakSettings) -> int:
    return round(settings.minutes * 60.0 / PERIOD_S)


def _watched(settings: SoakSettings, job: steady.SteadyJob, log: Path, progress: Progress) -> _Watched:
    context = multiprocessing.get_context("spawn")
    cycles = _cycles(settings)
    tracker_port = free_port(socket.SOCK_DGRAM) if settings.tracker != "none" else None
    cell_end, cell_pipe = context.Pipe()
    run_end, run_pipe = context.Pipe()
    ended, halt = context.Event(), context.Event()
    own = timing_probe.echo_socket()
    echo_address = own.getsockname()
    echo = context.Process(target=echo_process, args=(own,), daemon=True)
    cell = context.Process(target=cell_process, args=(job.rsi, job.played, cycles, cell_pipe, halt), daemon=True)
    started = [echo, cell]
    out = _Watched(SteadyOperator(lambda action: request(log, action)))
    before = processor_times()
    onlookers: Onlookers | None = None
    try:
        cell.start()
        force = next_message(cell_end, cell)
        loop = context.Process(target=run_process, args=(_run_settings(job, force, tracker_port), log, run_pipe, ended))
        loop.start()
        started.append(loop)
        address, pids = next_message(run_end, loop)
        pids = {"run": loop.pid, "loop": pids["loop"], "recorder": pids["recorder"], "cell": cell.pid}
        if settings.onlookers:
            onlookers = Onlookers(log)
            pids |= onlookers.pids()
        tracker = None if tracker_port is None else ("127.0.0.1", tracker_port)
        echo.start()  # it waits for 10 s at most
        timing_probe.await_echo(echo_address)
        cell_end.send((address, tracker, echo_address))
        with heard_when_asked() as asked:
            _Watch(out, _Looks(log, pids, onlookers), cell_end, cell, cycles, progress).watch(asked, halt)
        if not any(len(block.reply_s) for block in out.blocks):
            raise KeyboardInterrupt  # nothing was timed
        fast = ("loop", "cell")
        out.realtime = {name: prepared(pids[name]) for name in fast} | {"echo": prepared(echo.pid)}
        if onlookers is not None:
            out.onlookers = {**onlookers.counts(), "exit_status": onlookers.close()}
        ended.set()
        out.run = next_message(run_end, loop)
        cell_end.send(None)
    finally:
        ended.set()
        own.close()
        if onlookers is not None:
            onlookers.close()
        end_processes(started, echo)
    after = processor_times()
    out.stolen = (after[1] - before[1]) / max(1, after[0] - before[0])
    return out


def _run_settings(job: steady.SteadyJob, force: Any, tracker_port: int | None) -> online_session.RunSettings:
    return online_session.RunSettings(
        job.cell,
        ("rsi", job.rsi),
        job.plan,
        compensated=False,
        port=0,
        force=force[0],
        force_http_port=force[1][1],
        tracker_port=tracker_port,
        arm=True,
        quiet_s=_ABSENT_S,
    )


@dataclass(frozen=True)
class _Looks:
    """Samples taken every 5 s."""

    log: Path  # folder of the run log
    pids: dict[str, int | None]  # processes by name
    onlookers: Onlookers | None  # those beside the run, if there are any

    def sample(self) -> dict[str, float]:
        """Memory, open files and threads of each process, size of the log, counts of the clients."""
        written = sum(file.stat().st_size for file in self.log.iterdir() if file.is_file()) if self.log.is_dir() else 0
        counts = {} if self.onlookers is None else self.onlookers.counts()
        return {**_memory(self.pids), "log_mb": round(written / 1e6, 3), **counts}


def _log_figures(log: Path) -> dict[str, Any]:
    """Read the log as ``log show`` does: is it whole?"""
    shown = run_log.show(log)
    of_runs = [
        {key: run[key] for key in ("answered", "waited", "telegrams_lost", "records_lost")} for run in shown["runs"]
    ]
    return {
        "incomplete": shown["incomplete"],
        "segments": len(shown["segments"]),
        "lines": shown["lines"],
        "runs": of_runs,
    }


class _Watch:
    """Samples memory and load, is the operator, and takes what the cell tells, until it has finished.

    Args:
        out: What comes of it; written.
        looks: What is sampled.
        pipe: From the cell.
        cell: Its process.
        cycles: That it is to play.
        progress: Told by what the cell has played: a machine that stands still takes longer than the cycles last.
    """

    def __init__(
        self, out: _Watched, looks: _Looks, pipe: Any, cell: BaseProcess, cycles: int, progress: Progress
    ) -> None:
        self._out, self._looks, self._pipe, self._cell = out, looks, pipe, cell
        self._cycles, self._progress = cycles, progress
        self._begin = self._due = self._look = self._told = time.monotonic()
        self._times = processor_times()
        self._played = 0

    def watch(self, asked: Callable[[], bool], halt: Any) -> None:
        """Go on until the cell has finished.

        Args:
            asked: Whether a signal asks to end.
            halt: Set then: the cell finishes its cycle and tells what it has timed.
        """
        while True:
            if asked() and not self._out.interrupted:
                self._out.interrupted = True
                halt.set()
            now = time.monotonic()
            if now >= self._due:
                self._due += SAMPLE_S
                self._sample(now)
            if now >= self._look:
                self._out.operator.look(now - self._begin)
                self._look = time.monotonic() + _LOOKED_S
            if self._pipe.poll(max(0.0, min(self._due, self._look) - time.monotonic())):
                message = next_message(self._pipe, self._cell)
                if message is None:
                    return
                self._out.blocks.append(message)
                self._played += len(message.reply_s) + message.paused
                self._told = time.monotonic()

    def _sample(self, now: float) -> None:
        before, self._times = self._times, processor_times()
        stolen = (self._times[1] - before[1]) / max(1, self._times[0] - before[0])
        self._out.samples.append(
            {
                "seconds": round(now - self._begin, 3),
                **self._looks.sample(),
                "load": os.getloadavg()[0],
                "stolen": stolen,
            }
        )
        since = min(BLOCK, (now - self._told) / PERIOD_S)
        done = min(1.0, (self._played + since) / self._cycles)
        self._progress(done)


def _memory(pids: dict[str, int | None]) -> dict[str, float]:
    """Resident memory in MB, open files and threads of each process; not-a-number where the system does not say."""
    out: dict[str, float] = {}
    for name, pid in pids.items():
        resident = files = threads = math.nan
        try:
            words = Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()
            resident = int(words[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
            files = float(len(list(Path(f"/proc/{pid}/fd").iterdir())))
            threads = float(len(list(Path(f"/proc/{pid}/task").iterdir())))
        except (OSError, ValueError, IndexError):
            pass
        out[f"{name}_mb"], out[f"{name}_files"], out[f"{name}_threads"] = round(resident, 4), files, threads
    return out


def _write_table(path: Path, rows: list[dict[str, float]]) -> None:
    names = list(rows[0])
    lines = [",".join(names), *(",".join(f"{row[name]:.10g}" for name in names) for row in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
