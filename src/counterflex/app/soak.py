"""The online loop for hours against a simulated cell in real time: does it grow, does it become slow?"""

from __future__ import annotations

import math
import multiprocessing
import os
import signal
import socket
import tempfile
import time
from dataclasses import dataclass
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex import __version__
from counterflex.app import online, online_session, steady
from counterflex.app.made_on import made_on
from counterflex.core import atomic
from counterflex.core.errors import InputError, OutputError
from counterflex.core.progress import Progress, silent
from counterflex.core.units import MM
from counterflex.evaluate.growth import Growth, growth
from counterflex.evaluate.loop_timing import percentiles
from counterflex.files.summary_file import write_summary
from counterflex.links import timing_probe
from counterflex.links.machine import processor_times
from counterflex.links.realtime import prepare
from counterflex.twin.fake_rsi import FakeRsi, RsiContext
from counterflex.twin.netft_server import NetftServer
from counterflex.twin.recorded_pass import RecordedPass
from counterflex.twin.steady_cell import Block, SteadyCell
from counterflex.wire.rsi_config import read_config

MINUTES: Final = "minutes.csv"
MEMORY: Final = "memory.csv"
SUMMARY: Final = "summary.json"
LOG: Final = "log"
_SAMPLE_S: Final = 5.0
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
    """

    minutes: float = 60.0
    force: str = "scale"
    tracker: str = "observer"
    keep_log: bool = False


def run(settings: SoakSettings, out: str | Path, *, progress: Progress = silent) -> dict[str, Any]:
    """Run it and write ``summary.json``, ``minutes.csv`` and ``memory.csv`` into a folder.

    Args:
        settings: See :class:`SoakSettings`.
        out: Folder.
        progress: Told the fraction done.

    Returns:
        The summary: times to answer beside those of a do-nothing echo, and growth with its standard error.

    Raises:
        InputError: ``minutes`` out of range.
        OutputError: A process of the run ended early.
    """
    if not 0.02 <= settings.minutes <= 10_000.0:
        raise InputError("minutes to run", value=settings.minutes, limit="0.02 .. 10000")
    with atomic.atomic_folder(out) as staging, tempfile.TemporaryDirectory() as work:
        job = steady.prepare(
            Path(work), _cycles(settings), force=settings.force, tracker=settings.tracker, progress=progress
        )
        log = staging / LOG if settings.keep_log else Path(work) / LOG
        blocks, samples, logged, steal = _watched(settings, job, log, progress)
        minutes = [_minute(k, block) for k, block in enumerate(blocks)]
        _write_table(staging / MINUTES, minutes)
        _write_table(staging / MEMORY, samples)
        summary = {
            "job": "soak",
            "minutes": settings.minutes,
            "force": settings.force,
            "tracker": settings.tracker,
            **_figures(blocks, minutes, samples),
            "run": logged,
            "load": {"mean": float(np.mean([s["load"] for s in samples])), "stolen": round(steal, 4)},
            "machine": made_on(),
            "counterflex": __version__,
        }
        write_summary(staging / SUMMARY, summary)
    return summary


def _cycles(settings: SoakSettings) -> int:
    return round(settings.minutes * 60.0 / 4e-3)


def _watched(
    settings: SoakSettings, job: steady.SteadyJob, log: Path, progress: Progress
) -> tuple[list[Block], list[dict[str, float]], dict[str, Any], float]:
    context = multiprocessing.get_context("spawn")
    cycles = _cycles(settings)
    tracker_port = _free_port() if settings.tracker != "none" else None
    cell_end, cell_pipe = context.Pipe()
    run_end, run_pipe = context.Pipe()
    own = timing_probe.echo_socket()
    echo_address = own.getsockname()
    echo = context.Process(target=_echo_process, args=(own,), daemon=True)
    cell = context.Process(target=_cell_process, args=(job.rsi, job.played, cycles, cell_pipe), daemon=True)
    started = [echo, cell]
    before = processor_times()
    try:
        cell.start()
        force = _said(cell_end, cell)
        run_settings = online_session.RunSettings(
            job.cell,
            job.rsi,
            job.plan,
            compensated=False,
            port=0,
            force=force[0],
            force_http_port=force[1][1],
            tracker_port=tracker_port,
            arm=True,
        )
        loop = context.Process(target=_run_process, args=(run_settings, log, run_pipe))
        loop.start()
        started.append(loop)
        address, pids = _said(run_end, loop)
        pids = {"loop": pids[0], "recorder": loop.pid, "cell": cell.pid}
        tracker = None if tracker_port is None else ("127.0.0.1", tracker_port)
        echo.start()  # it waits for 10 s at most
        timing_probe.await_echo(echo_address)
        cell_end.send((address, tracker, echo_address))
        blocks, samples = _watch(cell_end, cell, pids, settings.minutes, progress)
        logged = _said(run_end, loop)
    finally:
        own.close()
        for process in started:
            if process.pid is not None:
                process.join(3.0 if process is not echo else 0.0)
                process.terminate()
                process.join()
    after = processor_times()
    steal = (after[1] - before[1]) / max(1, after[0] - before[0])
    return blocks, samples, logged, steal


def _watch(
    pipe: Any, cell: BaseProcess, pids: dict[str, int | None], minutes: float, progress: Progress
) -> tuple[list[Block], list[dict[str, float]]]:
    blocks: list[Block] = []
    samples: list[dict[str, float]] = []
    begin = time.monotonic()
    due = begin
    while True:
        due += _SAMPLE_S
        samples.append({"seconds": round(time.monotonic() - begin, 3), **_memory(pids), "load": os.getloadavg()[0]})
        while (left := due - time.monotonic()) > 0.0:
            if pipe.poll(left):
                said = _said(pipe, cell)
                if isinstance(said, str):
                    if said != "finished":
                        raise OutputError("the simulated controller stopped", value=said)
                    return blocks, samples
                blocks.append(said)
            progress(min(0.99, (time.monotonic() - begin) / (60.0 * minutes)), "soaking")


def _memory(pids: dict[str, int | None]) -> dict[str, float]:
    """Resident memory in MB and open files of each process; not-a-number where the system does not say."""
    out: dict[str, float] = {}
    for name, pid in pids.items():
        resident = files = math.nan
        try:
            words = Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()
            resident = int(words[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
            files = float(len(list(Path(f"/proc/{pid}/fd").iterdir())))
        except (OSError, ValueError, IndexError):
            pass
        out[f"{name}_mb"], out[f"{name}_files"] = round(resident, 4), files
    return out


def _minute(k: int, block: Block) -> dict[str, float]:
    reply, echo, late = (percentiles(times) for times in (block.reply_s, block.echo_s, block.late_s))
    return {
        "minute": k + 1,
        "cycles": reply.n,
        "unanswered": int(np.sum(np.isnan(block.reply_s))),
        **{f"reply_{name}_us": value for name, value in _micro(reply).items()},
        **{f"echo_{name}_us": value for name, value in _micro(echo).items()},
        "cell_late_p999_us": _micro(late)["p999"],
        "largest_correction_um": round(block.largest_m / MM * 1e3, 1),
    }


def _micro(found: Any) -> dict[str, float]:
    return {
        "p50": round(found.p50_s * 1e6, 1),
        "p99": round(found.p99_s * 1e6, 1),
        "p999": round(found.p999_s * 1e6, 1),
        "max": round(found.max_s * 1e6, 1),
    }


def _figures(blocks: list[Block], minutes: list[dict[str, float]], samples: list[dict[str, float]]) -> dict[str, Any]:
    reply, echo = (percentiles(np.concatenate([getattr(b, name) for b in blocks])) for name in ("reply_s", "echo_s"))
    hours = np.array([s["seconds"] for s in samples]) / 3600.0
    settled = hours >= 0.1 * hours[-1]
    of_minutes = np.arange(len(minutes)) / 60.0

    def grown(column: str) -> dict[str, float] | None:
        values = np.array([s[column] for s in samples])
        return _growth(growth(hours[settled], values[settled]))

    def grown_minutes(column: str) -> dict[str, float] | None:
        return _growth(growth(of_minutes, np.array([m[column] for m in minutes])))

    return {
        "cycles": int(sum(m["cycles"] for m in minutes)),
        "unanswered": int(sum(m["unanswered"] for m in minutes)),
        "refused": blocks[-1].refused,
        "reply_us": _micro(reply),
        "echo_us": _micro(echo),
        "ratio_p50": round(reply.p50_s / echo.p50_s, 2),
        "growth_per_hour": {
            name: grown(name) for name in ("loop_mb", "recorder_mb", "loop_files", "recorder_files")
        }
        | {name: grown_minutes(name) for name in ("reply_p50_us", "reply_p99_us", "echo_p50_us", "echo_p99_us")},
        "most": {name: max(s[name] for s in samples) for name in ("loop_mb", "recorder_mb", "loop_files")},
    }  # fmt: skip


def _growth(found: Growth | None) -> dict[str, float] | None:
    if found is None:
        return None
    return {"slope": round(found.slope, 4), "standard_error": round(found.standard_error, 4)}


def _write_table(path: Path, rows: list[dict[str, float]]) -> None:
    names = list(rows[0])
    lines = [",".join(names), *(",".join(f"{row[name]:.10g}" for name in names) for row in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _said(pipe: Any, process: BaseProcess) -> Any:
    """What a process says next.

    Raises:
        OutputError: It ended without a word.
    """
    while not pipe.poll(0.2):
        if not process.is_alive() and not pipe.poll(0.0):
            raise OutputError("a process of the run ended early", value=f"exit status {process.exitcode}")
    said = pipe.recv()
    if isinstance(said, BaseException):
        raise said
    return said


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
        cell = SteadyCell(played, fake, netft)
        pipe.send((netft.address, netft.http_address))
        while not pipe.poll(0.02):
            netft.poll()
        peer, tracker, echo = pipe.recv()
        prepare()
        pipe.send(cell.run(peer, cycles, tracker=tracker, echo=echo, told=pipe.send))
    except BaseException as fault:
        pipe.send(fault)


def _run_process(settings: online_session.RunSettings, log: Path, pipe: Any) -> None:
    """The recorder, which starts the loop: what the command ``run`` does."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def started(address: tuple[str, int]) -> None:
        pipe.send((address, [process.pid for process in multiprocessing.active_children()]))

    try:
        pipe.send(online.run(settings, log, started=started))
    except BaseException as fault:
        pipe.send(fault)
