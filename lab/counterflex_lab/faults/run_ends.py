"""End ``counterflex run`` in the cut: killed, interrupted, asked to, its log gone: R12, R23, R28, R36."""

from __future__ import annotations

import itertools
import math
import os
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np

from counterflex.core.units import MM
from counterflex_lab.faults.aftermath import LARGEST_STEP_M
from counterflex_lab.faults.demonstration import PERIOD_S
from counterflex_lab.faults.run_rig import RunRig, command
from counterflex_lab.faults.scenario import Effort, Outcome, Scenario

_HELD_S: Final = 0.1
_END_S: Final = 15.0
_LOG_LOST: Final = 5


def _killed(effort: Effort) -> Outcome:
    """The process that a person started is killed; those that it started are left alone."""
    with tempfile.TemporaryDirectory() as place, RunRig(Path(place), effort.seed) as rig:
        rig.activate()
        rig.cut(100)
        children = rig.children()
        first = len(rig.times)
        begin = time.monotonic()
        os.kill(rig.process.pid, signal.SIGKILL)
        end = time.monotonic() + _END_S
        died = begin
        while time.monotonic() < end and not rig.robot.stopped and _living(children):
            rig.cycle(enable=True, force_n=300.0, patience_s=1.0)
            died = died if rig.process.poll() is not None and died > begin else time.monotonic()
        held = itertools.compress(rig.times[first:], rig.feed_held[first:])
        hold_s = min((max(0.0, time_s - died) for time_s in held), default=math.inf)
        rest = float(np.linalg.norm(rig.robot.correction[:3]))
        step = float(rig.steps(first).max(initial=0.0))
        while time.monotonic() < end and _living(children):  # a robot that has stopped sends nothing any more
            time.sleep(0.05)
        survivors = _living(children)
        _, records, missing = rig.repaired()
    safe = hold_s <= _HELD_S and (rest == 0.0 or rig.robot.stopped != "") and step <= LARGEST_STEP_M
    return Outcome(
        safe and not survivors and missing == 0,
        f"feed held {1e3 * hold_s:.0f} ms after the system had ended it, correction {rest / MM:.3f} mm at the end, "
        f"robot: {rig.robot.stopped or 'stands'}; {len(survivors)} processes left; log repaired: {records} records, "
        f"{missing} missing",
        step,
        hold_s,
    )


def _powerless(effort: Effort) -> Outcome:
    """All its processes are killed at once, as when the power goes."""
    with tempfile.TemporaryDirectory() as place, RunRig(Path(place), effort.seed) as rig:
        rig.activate()
        rig.cut(300)
        first = len(rig.times)
        for number in (*rig.children(), rig.process.pid):
            os.kill(number, signal.SIGKILL)
        while not rig.robot.stopped and len(rig.times) < first + 100:
            rig.cycle(enable=True, force_n=300.0)
        step = float(rig.steps(first).max(initial=0.0))
        stopped = rig.robot.stopped
        done, records, missing = rig.repaired()
        lost_s = PERIOD_S * (first - records)
    return Outcome(
        stopped == "RSITimeout" and step <= LARGEST_STEP_M and len(done) == 1 and missing == 0,
        f"the robot held what it had and stopped by its timeout ({stopped}); log repaired: {records} records, "
        f"{missing} missing between them, {max(0.0, lost_s):.2f} s at the end never written",
        step,
    )


def _without_recorder(effort: Effort) -> Outcome:
    """The process that writes the log is killed; the others are left alone."""
    with tempfile.TemporaryDirectory() as place, RunRig(Path(place), effort.seed) as rig:
        rig.activate()
        rig.cut(100)
        os.kill(rig.recorder(), signal.SIGKILL)
        first = len(rig.times)
        status = rig.until_ended()
        feed_held = any(rig.feed_held[first:])
        rest = float(np.linalg.norm(rig.robot.correction[:3]))
        step = float(rig.steps(first).max(initial=0.0))
        stopped = rig.robot.stopped
        _, records, missing = rig.repaired()
    return Outcome(
        feed_held and status == _LOG_LOST and (rest == 0.0 or stopped != "") and step <= LARGEST_STEP_M and records > 0,
        f"{'feed held' if feed_held else 'feed NOT held'}, correction {rest / MM:.3f} mm at the end, "
        f"exit status {status}; log repaired: {records} records, {missing} missing between them",
        step,
    )


def _living(numbers: list[int]) -> list[int]:
    """Those that have not ended; one that waits for its parent to look at it has."""
    out = []
    for number in numbers:
        try:
            state = Path(f"/proc/{number}/stat").read_text(encoding="ascii").rsplit(")", 1)[1].split()[0]
        except OSError:
            continue
        if state != "Z":
            out.append(number)
    return out


def _ended(ask: Callable[[RunRig], None], status: int) -> Callable[[Effort], Outcome]:
    """Something ends it in the cut: ramped out with the feed held, the exit status says it, the log reads back.

    Args:
        ask: Does it.
        status: Expected.
    """

    def run(effort: Effort) -> Outcome:
        with tempfile.TemporaryDirectory() as place, RunRig(Path(place), effort.seed) as rig:
            rig.activate()
            rig.cut(100)
            first = len(rig.times)
            begin = time.monotonic()
            ask(rig)
            exit_status = rig.until_ended()
            hold = next((k for k in range(first, len(rig.feed_held)) if rig.feed_held[k]), None)
            hold_s = float("inf") if hold is None else rig.times[hold] - begin
            rest = float(np.linalg.norm(rig.robot.correction[:3]))
            step = float(rig.steps(first).max(initial=0.0))
            happened = f"feed held after {1e3 * hold_s:.0f} ms, correction {rest / MM:.3f} mm at the end"
            happened += f", exit status {exit_status}"
            done, records, missing = rig.repaired()
            happened += f"; log: {records} records, {missing} missing, {len(done)} segments to repair"
        passed = exit_status == status and hold is not None and missing == 0 and records > 0
        passed &= rest == 0.0 or rig.robot.stopped != ""
        return Outcome(passed and step <= LARGEST_STEP_M, happened, step, hold_s)

    return run


def _signal(number: signal.Signals) -> Callable[[RunRig], None]:
    def ask(rig: RunRig) -> None:
        os.kill(rig.process.pid, number)

    return ask


def _operator(rig: RunRig) -> None:
    command_process = subprocess.Popen(command("operator", "stop", str(rig.log)), stdout=subprocess.DEVNULL)
    end = time.monotonic() + _END_S
    while command_process.poll() is None and time.monotonic() < end:
        rig.cycle(enable=True, force_n=300.0)
    for _ in range(300):
        rig.cycle(enable=True, force_n=300.0)
    os.kill(rig.process.pid, signal.SIGINT)


def _removed(effort: Effort) -> Outcome:
    """The folder of the log is removed; the cut goes on to the end of the program, as it is set by default."""
    with tempfile.TemporaryDirectory() as place, RunRig(Path(place), effort.seed) as rig:
        rig.activate()
        rig.cut(100)
        before = rig.output()
        shutil.rmtree(rig.log)
        rig.cut(500)
        while_it_ran = rig.output()[len(before) :]
        for k in range(450):  # out of the cut, then the program switches the correction off
            rig.cycle(enable=k < 200)
        end = time.monotonic() + _END_S
        while rig.process.poll() is None and time.monotonic() < end:
            time.sleep(0.05)
        status, step = rig.process.poll(), float(rig.steps().max())
    message = next((line.strip() for line in while_it_ran.splitlines() if "LOGGING STOPPED" in line), "")
    message = " ".join(message.split())[-90:]
    return Outcome(
        message != "" and status == _LOG_LOST and step <= LARGEST_STEP_M,
        f"said while it ran: {message or 'nothing'}; exit status {status}",
        step,
    )


_REQUIRED: Final = "ramped out with the feed held; exit status {}; the log reads back without a gap"
SCENARIOS: Final = (
    Scenario(
        "R12",
        "killed-command",
        "kill -9 of counterflex run in the cut; the loop's process is left alone",
        "feed held within 100 ms of its end, ramped out or told to stop, no process left; log repair has every record",
        _killed,
        realtime=True,
    ),
    Scenario(
        "R24",
        "killed-recorder-of-run",
        "kill -9 of the process that writes the log, in the cut",
        "feed held, ramped out or told to stop; exit status 5; log repair has what was written",
        _without_recorder,
        realtime=True,
    ),
    Scenario(
        "R36",
        "power-loss",
        "all processes of counterflex run killed at once in the cut",
        "the correction at the robot stays, it stops by its timeout; log repair has every record but the last 100 ms",
        _powerless,
        realtime=True,
    ),
    Scenario(
        "R28",
        "interrupted",
        "SIGINT to counterflex run in the cut",
        _REQUIRED.format(130),
        _ended(_signal(signal.SIGINT), 130),
        realtime=True,
    ),
    Scenario(
        "R28",
        "terminated",
        "SIGTERM to counterflex run in the cut",
        _REQUIRED.format(143),
        _ended(_signal(signal.SIGTERM), 143),
        realtime=True,
    ),
    Scenario(
        "R28",
        "operator-stop",
        "counterflex operator stop in the cut, then SIGINT",
        _REQUIRED.format(130),
        _ended(_operator, 130),
        realtime=True,
    ),
    Scenario(
        "R23",
        "log-removed",
        "the folder of the log is removed in the cut; the program goes on to its end",
        "said while it runs; exit status 5",
        _removed,
        realtime=True,
    ),
)
