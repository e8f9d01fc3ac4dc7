"""The online loop for hours against a simulated cell in real time: does it grow, does it become slow?

A machine that stands still for some cycles makes the loop hold, or stop the robot, as it should. The simulated robot
program obeys, and this job is the operator: it acknowledges and arms again by the requests of ``counterflex operator``,
so that the rest of the time is measured too. All of it is counted.
"""

from __future__ import annotations

import math
import multiprocessing
import os
import signal
import socket
import tempfile
import threading
import time
from dataclasses import dataclass, field
from multiprocessing.process import BaseProcess
from pathlib import Path
from queue import SimpleQueue
from typing import Any, Final

import numpy as np

from counterflex import __version__
from counterflex.app.environment import environment
from counterflex.app.run import log as run_log
from counterflex.app.run import run as online
from counterflex.app.run import session as online_session
from counterflex.app.run.operator_requests import request
from counterflex.core import atomic
from counterflex.core.errors import InputError, OutputError
from counterflex.core.progress import Progress, silent
from counterflex.files.summary_file import write_summary
from counterflex.protocols.system import timing_probe
from counterflex.protocols.system.machine import processor_times
from counterflex.protocols.system.realtime import Prepared, prepare, prepared
from counterflex.twin.live.recorded_pass import RecordedPass
from counterflex.twin.live.replayed_cell import ReplayedCell
from counterflex.twin.live.timed_block import Block
from counterflex_lab.devices import FakeRsi, NetftServer, RsiContext, read_config
from counterflex_lab.soak import replayed_cell as steady
from counterflex_lab.soak.figures import figures, minute
from counterflex_lab.soak.onlookers import Onlookers
from counterflex_lab.soak.operator import SteadyOperator

MINUTES: Final = "minutes.csv"
MEMORY: Final = "memory.csv"
SUMMARY: Final = "summary.json"
LOG: Final = "log"
_SAMPLE_S: Final = 5.0
_LOOKED_S: Final = 0.5
"""How often the operator looks."""
_ABSENT_S: Final = 60.0
"""Without a telegram for so long, the loop ends by itself: longer than a robot program needs to be started again."""
_LAST_CYCLES: Final = 50
_PREPARED: Final = 0.02
"""Of the progress that is shown: the pass is recorded."""
_LATENESS_ALLOWED: Final = 1 << 30
"""Timeout of the simulated controller, cycles: late answers are counted, they do not end the run."""


@dataclass(frozen=True)
class SoakSettings:
    """What is run.

    Attributes:
        minutes: How long.
        force: Mode of the table ``[online]``.
        tracker: Likewise.
        keep_log: Keep the run log; about 1 GB per hour.
        onlookers: Panel and OPC UA server run beside it, each with a client that goes on reading.
    """

    minutes: float = 60.0
    force: str = "scale"
    tracker: str = "observer"
    keep_log: bool = False
    onlookers: bool = False


@dataclass
class _Watched:
    """What a run left.

    Attributes:
        blocks: What the simulated cell timed, minute by minute.
        samples: Memory and load, every 5 s.
        operator: Requests.
        run: Summary of the recorder.
        stolen: Share of the processors' time that the host took.
        realtime: By process.
        onlookers: Counts of what the clients of panel and OPC UA server got, and how the servers ended.
    """

    operator: SteadyOperator
    blocks: list[Block] = field(default_factory=list)
    samples: list[dict[str, float]] = field(default_factory=list)
    run: dict[str, Any] = field(default_factory=dict)
    stolen: float = 0.0
    realtime: dict[str, Prepared] = field(default_factory=dict)
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

    Raises:
        InputError: ``minutes`` out of range.
        OutputError: A process of the run ended early.
    """
    if not 0.02 <= settings.minutes <= 10_000.0:
        raise InputError("minutes to run", value=settings.minutes, limit="0.02 .. 10000")
    with atomic.atomic_folder(out) as staging, tempfile.TemporaryDirectory() as work:
        job = steady.prepare(
            Path(work),
            _cycles(settings),
            force=settings.force,
            tracker=settings.tracker,
            progress=lambda fraction, what="": progress(_PREPARED * fraction, what),
        )
        log = staging / LOG if settings.keep_log else Path(work) / LOG
        watched = _watched(settings, job, log, progress)
        minutes = [minute(k, block) for k, block in enumerate(watched.blocks)]
        _write_table(staging / MINUTES, minutes)
        _write_table(staging / MEMORY, watched.samples)
        samples = watched.samples
        summary = {
            "job": "soak",
            "minutes": settings.minutes,
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
    return round(settings.minutes * 60.0 / 4e-3)


def _watched(settings: SoakSettings, job: steady.SteadyJob, log: Path, progress: Progress) -> _Watched:
    context = multiprocessing.get_context("spawn")
    cycles = _cycles(settings)
    tracker_port = _free_port() if settings.tracker != "none" else None
    cell_end, cell_pipe = context.Pipe()
    run_end, run_pipe = context.Pipe()
    ended = context.Event()
    own = timing_probe.echo_socket()
    echo_address = own.getsockname()
    echo = context.Process(target=_echo_process, args=(own,), daemon=True)
    cell = context.Process(target=_cell_process, args=(job.rsi, job.played, cycles, cell_pipe), daemon=True)
    started = [echo, cell]
    out = _Watched(SteadyOperator(lambda action: request(log, action)))
    before = processor_times()
    onlookers: Onlookers | None = None
    try:
        cell.start()
        force = _message(cell_end, cell)
        run_settings = online_session.RunSettings(
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
        loop = context.Process(target=_run_process, args=(run_settings, log, run_pipe, ended))
        loop.start()
        started.append(loop)
        address, pids = _message(run_end, loop)
        pids = {"run": loop.pid, "loop": pids["loop"], "recorder": pids["recorder"], "cell": cell.pid}
        if settings.onlookers:
            onlookers = Onlookers(log)
            pids |= onlookers.pids()
        tracker = None if tracker_port is None else ("127.0.0.1", tracker_port)
        echo.start()  # it waits for 10 s at most
        timing_probe.await_echo(echo_address)
        cell_end.send((address, tracker, echo_address))
        _watch(out, _Looks(log, pids, onlookers), cell_end, cell, settings.minutes, progress)
        fast = ("loop", "cell")
        out.realtime = {name: prepared(pids[name]) for name in fast} | {"echo": prepared(echo.pid)}
        if onlookers is not None:
            out.onlookers = {**onlookers.counts(), "exit_status": onlookers.close()}
        ended.set()
        out.run = _message(run_end, loop)
        cell_end.send(None)
    finally:
        ended.set()
        own.close()
        if onlookers is not None:
            onlookers.close()
        for process in started:
            if process.pid is not None:
                process.join(3.0 if process is not echo else 0.0)
                process.terminate()
                process.join()
    after = processor_times()
    out.stolen = (after[1] - before[1]) / max(1, after[0] - before[0])
    return out


@dataclass(frozen=True)
class _Looks:
    """What is looked at every 5 s.

    Attributes:
        log: Folder of the run log.
        pids: Processes by name.
        onlookers: Those beside the run, if there are any.
    """

    log: Path
    pids: dict[str, int | None]
    onlookers: Onlookers | None

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


def _watch(out: _Watched, looks: _Looks, pipe: Any, cell: BaseProcess, minutes: float, progress: Progress) -> None:
    """Sample memory and load, be the operator, and take what the cell tells, until it has finished."""
    begin = time.monotonic()
    due = look = begin
    times = processor_times()
    while True:
        now = time.monotonic()
        if now >= due:
            due += _SAMPLE_S
            last, times = times, processor_times()
            stolen = (times[1] - last[1]) / max(1, times[0] - last[0])
            out.samples.append(
                {"seconds": round(now - begin, 3), **looks.sample(), "load": os.getloadavg()[0], "stolen": stolen}
            )
            progress(_PREPARED + (0.99 - _PREPARED) * min(1.0, (now - begin) / (60.0 * minutes)), "soaking")
        if now >= look:
            out.operator.look(now - begin)
            look = time.monotonic() + _LOOKED_S
        if pipe.poll(max(0.0, min(due, look) - time.monotonic())):
            message = _message(pipe, cell)
            if message is None:
                return
            out.blocks.append(message)


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


def _message(pipe: Any, process: BaseProcess) -> Any:
    """What a process says next.

    Raises:
        OutputError: It ended silently.
    """
    while not pipe.poll(0.2):
        if not process.is_alive() and not pipe.poll(0.0):
            raise OutputError("a process of the run ended early", value=f"exit status {process.exitcode}")
    message = pipe.recv()
    if isinstance(message, BaseException):
        raise message
    return message


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _echo_process(own: socket.socket) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    prepare()
    timing_probe.echo(own)


def _cell_process(rsi: Path, played: RecordedPass, cycles: int, pipe: Any) -> None:
    """The simulated cell's side, in real time."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        netft = NetftServer()
        fake = FakeRsi(read_config(rsi), RsiContext(timeout=_LATENESS_ALLOWED))
        cell = ReplayedCell(played, fake, netft)
        pipe.send((netft.address, netft.http_address))
        while not pipe.poll(0.02):
            netft.poll()
        peer, tracker, echo = pipe.recv()
        prepare()
        # A pipe that nobody reads for a while must not hold up the robot; the thread has this process' priority.
        tell: SimpleQueue[Any] = SimpleQueue()
        threading.Thread(target=_tell, args=(tell, pipe), daemon=True).start()
    except BaseException as fault:
        pipe.send(fault)
        return
    try:
        cell.run(peer, cycles, tracker=tracker, echo=echo, on_block=tell.put)
        tell.put(None)
        while not pipe.poll(0.0):  # a robot does not fall silent before the loop has ended
            cell.run(peer, _LAST_CYCLES, tracker=tracker)
    except BaseException as fault:
        tell.put(fault)
        time.sleep(_SAMPLE_S)


def _tell(queue: SimpleQueue[Any], pipe: Any) -> None:
    while True:
        pipe.send(queue.get())


def _run_process(settings: online_session.RunSettings, log: Path, pipe: Any, ended: Any) -> None:
    """Starts loop and recorder: what the command ``run`` does."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def started(address: tuple[str, int]) -> None:
        pipe.send((address, {process.name: process.pid for process in multiprocessing.active_children()}))

    try:
        pipe.send(online.run(settings, log, started=started, ended=ended.is_set))
    except BaseException as fault:
        pipe.send(fault)
