"""Measure whether this machine keeps time for the online loop, as the loop would run; judge it, keep it for arming."""

from __future__ import annotations

import math
import multiprocessing
import os
import platform
import signal
import socket
import tempfile
import time
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib import resources
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex import __version__
from counterflex.app.run.log import micro
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError, OutputError
from counterflex.core.progress import Progress, silent
from counterflex.core.units import plain
from counterflex.evaluate.loop_timing import ENOUGH_CYCLES, Judgement, LoopSamples, Percentiles, TimingVerdict, judge
from counterflex.files.cell.cell import read_cell
from counterflex.files.machine_file import StoredVerdict, against, machine_file, read_verdict, write_verdict
from counterflex.geometry import pose, rotation
from counterflex.protocols.system import timing_probe
from counterflex.protocols.system.machine import Machine, look, processor_times
from counterflex.protocols.system.realtime import Granted, prepare
from counterflex.runtime.cycle_inputs import CycleInputs
from counterflex.runtime.loop import Loop
from counterflex.runtime.loop_plan import LoopPlan
from counterflex.runtime.record_ring import RING_BYTES, WIDTH, RecordRing
from counterflex.runtime.settings import ForceMode, OnlineSettings, TrackerMode

_WRITE_S: Final = 0.1
_SYNC_EVERY: Final = 10
_PATH_ROWS: Final = 500
_START: Final = 8  # Cycles until the loop is active; from then on only the place changes
_Q: Final = np.radians([0.0, -90.0, 120.0, 0.0, 30.0, 0.0])


@dataclass(frozen=True, eq=False)
class Checkup:
    """Measurement of this machine and its meaning."""

    machine: Machine
    granted: Granted  # What it allowed the loop's process
    samples: LoopSamples
    judgement: Judgement

    def described(self) -> dict[str, Any]:
        """All of it, for printing; times in microseconds."""
        samples, judgement = self.samples, self.judgement
        parts = {
            "wake-up latency": samples.late_s,
            "step": samples.compute_s,
            "echo of another process": samples.echo_s,
            "reply": samples.reply_s,
            "log written": samples.write_s,
            "log on the disk": samples.sync_s,
        }
        return {
            "verdict": str(judgement.verdict),
            "fits": judgement.verdict != TimingVerdict.UNFIT,
            "reasons": list(judgement.reasons),
            "cycles": judgement.reply.n,
            "period_ms": samples.period_s * 1e3,
            "budget_us": round(judgement.budget_s * 1e6, 1),
            "in_time": judgement.in_time,
            "times_us": {name: micro(Percentiles.of(part)) for name, part in parts.items() if len(part)},
            "host": platform.node(),
            "kernel": platform.release(),
            "realtime_kernel": self.machine.realtime_kernel,
            **plain(samples, "cores governor clock_source steal:4 fifo locked"),
            "refused": list(self.granted.reasons),
            "shared_memory": samples.ring_fits,
            "counterflex": __version__,
        }


def demo_loop() -> Loop:
    """A loop of the demonstration cell that uses all it can: force, plan and tracker."""
    with resources.as_file(resources.files("counterflex.app") / "demo" / "cell.toml") as file:
        cell = read_cell(file)
    x = np.linspace(0.0, 0.2, _PATH_ROWS)
    w = np.zeros((_PATH_ROWS, 6))
    w[:, :3] = 40.0, 250.0, -60.0
    ones, none = np.ones(_PATH_ROWS), np.zeros((_PATH_ROWS, 6))
    plan = LoopPlan(np.stack([x, 0.0 * x, 0.0 * x], axis=1), x / 0.025, w, ones, none)
    settings = OnlineSettings(force=ForceMode.SCALE, tracker=TrackerMode.OBSERVER)
    return Loop(cell.chain, settings, cell.T_base_part, plan)


def feed(loop: Loop, k: int) -> None:
    """One cycle of the loop on its way along the plan and back, armed, with a force and a tracker sample."""
    there = 1e-4 * (k % 4000)
    x = min(there, 0.4 - there)
    if k < _START:
        T = pose.make(rotation.about_x(np.pi), np.array([x, 0.0, 0.0]))
        force = np.array([45.0, 260.0, -65.0, 0.0, 0.0, 0.0])
        loop.feed(CycleInputs(T_part_tcp=T, q=_Q, w_tcp_part=force, T_part_actual=T, arm=k == 2, enable=k > 4))
    else:
        loop.given.nominal[9] = loop.given.actual[9] = x
    loop.run()


def _echo_process(own: socket.socket) -> None:
    """The other side, prepared alike: a robot controller does not wait for other programs of this machine either."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the process that started this one ends it
    prepare()
    timing_probe.echo(own)


def _loop_process(cycles: int, peer: tuple[str, int], pipe: Any) -> None:
    """The loop's side, in a process prepared as the online loop's."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        loop = demo_loop()
        for k in range(20):
            feed(loop, k)
        loop.reset()
        granted = prepare()
        period = loop.settings.period_s
        pipe.send((period, granted, timing_probe.measure(lambda k: feed(loop, k), cycles, period, peer)))
    except BaseException as fault:
        pipe.send(fault)


def probe(seconds: float, folder: Path, progress: Progress = silent) -> tuple[LoopSamples, Granted, Machine]:
    """Measure for some time, while this process writes what a recorder would.

    Args:
        folder: On the disk of the run log to come; it, or the folder above it that is there.

    Raises:
        InputError: ``seconds`` out of range.
    """
    if not 0.1 <= seconds <= 3600.0:
        raise InputError("time to measure", value=seconds, limit="0.1 .. 3600 s")
    period = OnlineSettings().period_s
    cycles = round(seconds / period)
    context = multiprocessing.get_context("spawn")
    own = timing_probe.echo_socket()
    peer = own.getsockname()
    mine, theirs = context.Pipe()
    with own:
        other = context.Process(target=_echo_process, args=(own,), daemon=True)
        loop = context.Process(target=_loop_process, args=(cycles, peer, theirs), daemon=True)
        before = processor_times()
        try:
            progress(0.0, "starting the loop's process")
            other.start()
            loop.start()
            write_s, sync_s = _write_meanwhile(mine, folder, seconds, progress)
            message = mine.recv()
        finally:
            for process in (loop, other):
                if process.pid is not None:
                    process.terminate()
                    process.join()
    if isinstance(message, BaseException):
        raise message
    period, granted, (late_s, compute_s, echo_s) = message
    after = processor_times()
    machine = look()
    total = after[0] - before[0]
    samples = LoopSamples(
        period_s=period,
        late_s=late_s,
        compute_s=compute_s,
        echo_s=echo_s,
        write_s=write_s,
        sync_s=sync_s,
        fifo=granted.fifo,
        locked=granted.locked,
        cores=machine.cores,
        governor=", ".join(machine.governors),
        clock_source=machine.clock_source,
        steal=(after[1] - before[1]) / total if total > 0 else 0.0,
        ring_fits=_ring_fits(machine),
    )
    return samples, granted, machine


def _write_meanwhile(pipe: Any, folder: Path, seconds: float, progress: Progress) -> tuple[Float, Float]:
    """Write pieces of a log until the loop's process has answered; times until written and until on the disk."""
    place = folder
    while not place.is_dir() and place != place.parent:
        place = place.parent
    piece = np.random.default_rng(0).standard_normal((round(_WRITE_S / 4e-3), WIDTH)).tobytes()
    write_s, sync_s = [], []
    begin = time.monotonic()
    try:
        with tempfile.TemporaryFile(dir=place) as stream:
            while not pipe.poll(_WRITE_S):
                start = time.perf_counter()
                stream.write(piece)
                stream.flush()
                write_s.append(time.perf_counter() - start)
                if len(write_s) % _SYNC_EVERY == 0:
                    start = time.perf_counter()
                    os.fsync(stream.fileno())
                    sync_s.append(time.perf_counter() - start)
                progress(min(1.0, (time.monotonic() - begin) / (seconds + 2.0)), "measuring")
    except OSError as fault:
        raise OutputError(f"the log could not be written here: {fault.strerror or fault}", where=str(place)) from fault
    return np.array(write_s), np.array(sync_s)


def _ring_fits(machine: Machine) -> bool:
    if machine.shared_free_bytes is not None and machine.shared_free_bytes < RING_BYTES:
        return False
    try:
        RecordRing().close()
    except OSError:
        return False
    return True


def run(seconds: float, folder: str | Path, *, keep: bool = True, progress: Progress = silent) -> Checkup:
    """Measure and judge this machine, and keep the verdict for arming.

    Args:
        keep: Keep the verdict; what was measured for too short a time to judge is never kept.

    Raises:
        InputError: ``seconds`` out of range.
        OutputError: Folder or kept verdict cannot be written.
    """
    samples, granted, machine = probe(seconds, Path(folder), progress)
    judgement = judge(samples)
    if keep and judgement.reply.n >= ENOUGH_CYCLES:
        p999 = judgement.reply.p999_s
        stored = StoredVerdict(
            host=platform.node(),
            kernel=platform.release(),
            date=datetime.now(UTC),
            verdict=str(judgement.verdict),
            fits=judgement.verdict != TimingVerdict.UNFIT,
            p999_s=p999 if math.isfinite(p999) else None,
            budget_s=judgement.budget_s,
            reasons=judgement.reasons,
        )
        write_verdict(machine_file(), stored)
    return Checkup(machine, granted, samples, judgement)


def require_fit(now: datetime | None = None) -> None:
    """Refuse to arm on a machine that is not known to keep time.

    Args:
        now: Time; None is now.

    Raises:
        InputError: There is no verdict, or one that is too old, of another machine, or against it.
    """
    path = machine_file()
    why = against(
        read_verdict(path),
        host=platform.node(),
        kernel=platform.release(),
        now=datetime.now(UTC) if now is None else now,
    )
    if why:
        raise InputError(
            why, where="--arm", hint="Run counterflex doctor first; --trust-machine arms all the same", kept=str(path)
        )
