"""Processes that are killed, stopped, or cannot write: R12, R22 to R24, R28, R29."""

from __future__ import annotations

import gc
import math
import os
import signal
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Final

import numpy as np

from counterflex.app.run.missing import counted
from counterflex.core.units import MM
from counterflex.files.logs.segments import read_log
from counterflex.protocols.processes.control_array import Request
from counterflex.runtime.record_ring import RecordRing
from counterflex.runtime.state.supervisor import State
from counterflex_lab.faults.demonstration import PERIOD_S
from counterflex_lab.faults.process_rig import ProcessRig
from counterflex_lab.faults.scenario import Effort, Outcome, Scenario

_LOST_S: Final = 0.1
_LIMIT_M: Final = 0.08 * MM
_LONGEST_S: Final = 20.0
_RECEIVED = 1


def _push(k: int) -> float:
    """A force that comes and goes, so that the correction is mostly on its way."""
    return 150.0 + 150.0 * math.sin(0.05 * k)


def _killed_loop(effort: Effort) -> Outcome:
    """R12: killed at random; the robot holds; a loop that is started again is not armed."""
    kills = effort.pick(100, 2)
    rng = np.random.default_rng(effort.seed)
    worst, armed, unread, stopped = 0.0, 0, 0, 0
    with tempfile.TemporaryDirectory() as place, ProcessRig(Path(place), effort.seed) as rig:
        folder = rig.start_recorder("log")
        rig.start_loop()
        for _ in range(kills):
            rig.activate()
            rig.run(int(rng.integers(20, 300)), _push)
            loop = rig.loop
            if loop is None or loop.pid is None:
                continue
            os.kill(loop.pid, signal.SIGKILL)
            first = len(rig.corrections)
            late = rig.robot.late
            while not rig.robot.stopped and rig.robot.late < late + 200:
                rig.cycle(200.0, patience_s=0.01)
            stopped += rig.robot.stopped == "RSITimeout"
            # The answer to the last telegram may have been on its way: one step within the limits.
            worst = max(worst, float(rig.steps(first).max(initial=0.0)))
            loop.join(5.0)
            rig.new_session()
            rig.start_loop()
            for _ in range(80):
                rig.robot.frees["Enable"] = 1.0
                rig.cycle()
                armed += rig.state > State.READY
        time.sleep(0.3)
        records, unread = counted(folder)
    return Outcome(
        worst == 0.0 and armed == 0 and stopped == kills and unread == 0,
        f"{kills} kills: the robot held what it had and stopped by its timeout {stopped} times; started again it was "
        f"armed {armed} times; {records} records, {unread} missing",
        worst,
        10 * PERIOD_S,
        {"kills": float(kills), "records": float(records)},
    )


def _orphaned(who: str) -> Callable[[Effort], Outcome]:
    """R12, R24: who started the loop, or who records it, is killed at random; the loop ends the cut by itself."""

    def run(effort: Effort) -> Outcome:
        kills = effort.pick(20, 2)
        rng = np.random.default_rng(effort.seed)
        seen = Killed()
        for k in range(kills):
            with tempfile.TemporaryDirectory() as place, ProcessRig(Path(place), effort.seed + k) as rig:
                folder = rig.start_recorder("log")
                rig.start_starter()
                rig.start_loop()
                rig.activate()
                rig.run(int(rng.integers(75, 200)), _push, period_s=PERIOD_S)
                _kill(rig, rig.starter if who == "starter" else rig.recorder, folder, seen)
        log = f"; at most {1e3 * max(seen.lost_s):.0f} ms of the log lost" if who == "recorder" else ""
        return Outcome(
            seen.good == kills and max(seen.held_s) <= _LOST_S and seen.worst_m <= _LIMIT_M * 1.02,
            f"{kills} kills: feed hold asked for after {1e3 * float(np.median(seen.held_s)):.0f} ms (median), at most "
            f"{1e3 * max(seen.held_s):.0f} ms; ramped out to zero, robot told to stop, loop ended by itself "
            f"{seen.good} times, within {max(seen.ended_s):.2f} s{log}",
            seen.worst_m,
            max(seen.held_s),
            {"kills": float(kills), "most_held_s": max(seen.held_s), "most_lost_s": max(seen.lost_s)},
        )

    return run


@dataclass
class Killed:
    """Outcome of several kills."""

    held_s: list[float] = field(default_factory=list)  # until the robot was asked to hold its feed
    ended_s: list[float] = field(default_factory=list)  # until the loop's process had ended
    lost_s: list[float] = field(default_factory=list)  # of the log, at the moment of the kill
    worst_m: float = 0.0  # largest step of the correction in force
    good: int = 0  # how often everything went as it should


def _kill(rig: ProcessRig, victim: BaseProcess | None, folder: Path, seen: Killed) -> None:
    loop = rig.loop
    if victim is None or victim.pid is None or loop is None:
        return
    reader = RecordRing(rig.ring.name)
    reader.rewind(max(0, reader.count - 2))
    first = len(rig.corrections)
    begin = time.monotonic()
    os.kill(victim.pid, signal.SIGKILL)
    last = reader.take()[-1]
    reader.close()
    while not rig.robot.feed_hold and time.monotonic() < begin + 1.0:
        due = time.monotonic() + PERIOD_S
        rig.cycle(200.0)
        time.sleep(max(0.0, due - time.monotonic()))
    seen.held_s.append(time.monotonic() - begin)
    while rig.cycle(0.0, patience_s=0.2) and time.monotonic() < begin + _LONGEST_S:
        pass
    loop.join(_LONGEST_S)
    seen.ended_s.append(time.monotonic() - begin)
    seen.worst_m = max(seen.worst_m, float(rig.steps(first).max(initial=0.0)))
    rows, _, _ = read_log(folder)
    seen.lost_s.append(float(last[_RECEIVED] - rows[-1, _RECEIVED]) * 1e-9)
    correction_m = float(np.linalg.norm(rig.robot.correction[:3]))
    seen.good += rig.robot.stopped == "Stop" and correction_m < 1e-6 and loop.exitcode == 0


def _stopped_recorder(effort: Effort) -> Outcome:
    """R29: the process that logs and shows stands still."""
    seconds = effort.pick(10, 1)
    with tempfile.TemporaryDirectory() as place, ProcessRig(Path(place), effort.seed) as rig:
        folder = rig.start_recorder("log")
        rig.start_loop()
        rig.activate()
        recorder = rig.recorder
        pid = 0 if recorder is None or recorder.pid is None else recorder.pid
        begin = len(rig.corrections)
        late = rig.robot.late
        os.kill(pid, signal.SIGSTOP)
        rig.run(round(seconds / PERIOD_S), _push, period_s=PERIOD_S)
        os.kill(pid, signal.SIGCONT)
        state = rig.state
        rig.run(50, _push, period_s=PERIOD_S)
        time.sleep(0.3)
        _, gaps = counted(folder)
        worst = float(rig.steps(begin).max())
        missed = rig.robot.late - late
    return Outcome(
        state == State.ACTIVE and missed == 0 and gaps == 0 and worst <= _LIMIT_M * 1.02,
        f"the loop stayed active, {missed} answers missing; {gaps} records lost, the ring holds 16 s",
        worst,
        None,
    )


def _full_disk(effort: Effort) -> Outcome:
    """R23: files cannot grow any more."""
    with tempfile.TemporaryDirectory() as place, ProcessRig(Path(place), effort.seed) as rig:
        folder = rig.start_recorder("log", 400_000)
        rig.start_loop()
        rig.activate()
        begin = len(rig.corrections)
        rig.run(effort.pick(3_000, 1_500), _push, period_s=0.5 * PERIOD_S)
        state, late = rig.state, rig.robot.late
        time.sleep(1.3)
        rig.run(100, _push, period_s=PERIOD_S)
        time.sleep(0.3)
        rows, _, cut = read_log(folder)
        worst = float(rig.steps(begin).max())
        segments = len(list(folder.glob("run-*.mcap")))
    return Outcome(
        state == State.ACTIVE and late == 0 and segments > 1 and len(rows) > 100 and worst <= _LIMIT_M * 1.02,
        f"the loop stayed active, {late} answers missing; {segments} segments, {len(cut)} cut short, {len(rows)} "
        "records read back",
        worst,
        None,
        {"segments": float(segments), "records": float(len(rows))},
    )


def _ended(effort: Effort) -> Outcome:
    """R28: asked to end in the cut, the loop ramps out first."""
    with tempfile.TemporaryDirectory() as place, ProcessRig(Path(place), effort.seed) as rig:
        rig.start_loop()
        rig.activate()
        rig.run(200, _push)
        begin = len(rig.corrections)
        rig.control[Request.END] = 1
        before = float(np.linalg.norm(rig.robot.correction[:3]))
        states: list[State] = []
        while rig.cycle(200.0, patience_s=0.2) and len(states) < 1500:
            states.append(rig.state)
        after = float(np.linalg.norm(rig.robot.correction[:3]))
        worst = float(rig.steps(begin).max())
        first = next((k for k, s in enumerate(states) if s == State.RAMP_OUT), -1)
    return Outcome(
        0 <= first <= 2 and after < 1e-6 < before and worst <= _LIMIT_M * 1.02,
        f"ramped out from {before / MM:.2f} mm to zero in {len(states) * PERIOD_S:.2f} s, begun in cycle {first + 1}",
        worst,
        (first + 1) * PERIOD_S,
    )


def _collected(effort: Effort) -> Outcome:
    """R22: a full collection while the loop runs, after everything was built and frozen."""
    import counterflex.app.run.run  # noqa: F401  what a loop's process holds

    gc.collect()
    gc.freeze()
    try:
        times = []
        for _ in range(effort.pick(20, 5)):
            begin = time.perf_counter()
            gc.collect()
            times.append(time.perf_counter() - begin)
    finally:
        gc.unfreeze()
    return Outcome(
        min(times) < 1e-3,
        f"{len(times)} forced collections after freezing took {1e3 * min(times):.2f} to {1e3 * max(times):.2f} ms",
        None,
        None,
        {"longest_s": max(times)},
    )


SCENARIOS: Final = (
    Scenario(
        "R12",
        "killed-loop",
        "kill -9 of the loop's process at random times while it corrects, then started again with the program running",
        "the correction at the robot does not change after it, the robot stops by its timeout, nothing arms by itself",
        _killed_loop,
        realtime=True,
    ),
    Scenario("R22", "forced-collection", "gc.collect() while frozen", "below 1 ms", _collected, realtime=True),
    Scenario(
        "R23",
        "full-disk",
        "the operating system refuses to let the log's file grow",
        "the loop goes on; what was written reads back; another segment is begun",
        _full_disk,
        realtime=True,
    ),
    Scenario(
        "R24",
        "killed-recorder",
        "kill -9 of the recorder's process at random times while the loop corrects",
        "at most 100 ms of the log are lost; within 100 ms the feed is held; ramped out, told to stop, loop ended",
        _orphaned("recorder"),
        realtime=True,
    ),
    Scenario(
        "R12",
        "killed-starter",
        "kill -9 of the process that started the loop, at random times while the loop corrects",
        "within 100 ms the feed is held; ramped out, told to stop, loop ended by itself; the log goes on to the end",
        _orphaned("starter"),
        realtime=True,
    ),
    Scenario(
        "R28",
        "asked-to-end",
        "the operator ends the run in the cut",
        "ramping out begins within 2 cycles; the loop ends with the correction at zero",
        _ended,
    ),
    Scenario(
        "R29",
        "stopped-recorder",
        "SIGSTOP of the process that logs and shows, for 10 s",
        "the loop goes on, no answer is missing, no record is lost",
        _stopped_recorder,
        realtime=True,
    ),
)
