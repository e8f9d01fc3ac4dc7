"""How ``counterflex run`` ends in the cut: killed, interrupted, asked to, its log gone: R12, R23, R28, R38."""

from __future__ import annotations

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

from counterflex.app.fault_scenarios.network import LARGEST_STEP_M
from counterflex.app.fault_scenarios.run_rig import RunRig, command
from counterflex.app.fault_scenarios.scenario import Effort, Outcome, Scenario
from counterflex.core.units import MM

_HELD_S: Final = 0.1
_END_S: Final = 10.0


def _killed(effort: Effort) -> Outcome:
    """The process that a person started is killed; those that it started are left alone."""
    with tempfile.TemporaryDirectory() as place, RunRig(Path(place), effort.seed) as rig:
        rig.activate()
        rig.cut(100)
        children = rig.children()
        first = len(rig.times)
        begin = time.monotonic()
        os.kill(rig.process.pid, signal.SIGKILL)
        rig.process.wait()
        end = time.monotonic() + _END_S
        while time.monotonic() < end and not rig.robot.stopped and _living(children):
            rig.cycle(enable=True, force_n=300.0)
        held = next((k for k in range(first, len(rig.held)) if rig.held[k]), None)
        held_s = float("inf") if held is None else rig.times[held] - begin
        rest = float(np.linalg.norm(rig.robot.correction[:3]))
        step = float(rig.steps(first).max(initial=0.0))
        time.sleep(0.5)
        left = _living(children)
        done, records, missing = rig.repaired()
    safe = held_s <= _HELD_S and (rest == 0.0 or rig.robot.stopped != "") and step <= LARGEST_STEP_M
    return Outcome(
        safe and not left and missing == 0,
        f"feed held after {1e3 * held_s:.0f} ms, correction {rest / MM:.3f} mm at the end, robot: "
        f"{rig.robot.stopped or 'stands'}; {len(left)} processes left; log repaired: {len(done)} segment, {records} "
        f"records, {missing} missing",
        step,
        held_s,
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


def _ended(
    ask: Callable[[RunRig], None], status: int, *, words: str = "", log: bool = True
) -> Callable[[Effort], Outcome]:
    """Something ends it in the cut: ramped out with the feed held, the exit status says it, the log reads back.

    Args:
        ask: Does it.
        status: Expected.
        words: Among what it prints.
        log: A log must be left, whole.
    """

    def run(effort: Effort) -> Outcome:
        with tempfile.TemporaryDirectory() as place, RunRig(Path(place), effort.seed) as rig:
            rig.activate()
            rig.cut(100)
            first = len(rig.times)
            begin = time.monotonic()
            ask(rig)
            found = rig.until_ended()
            held = next((k for k in range(first, len(rig.held)) if rig.held[k]), None)
            held_s = float("inf") if held is None else rig.times[held] - begin
            rest = float(np.linalg.norm(rig.robot.correction[:3]))
            step = float(rig.steps(first).max(initial=0.0))
            said = rig.said()
            happened = f"feed held after {1e3 * held_s:.0f} ms, correction {rest / MM:.3f} mm at the end"
            happened += f", exit status {found}"
            good = True
            if log:
                done, records, missing = rig.repaired()
                good = missing == 0 and records > 0
                happened += f"; log: {records} records, {missing} missing, {len(done)} segments to repair"
        passed = found == status and held is not None and good and words in said
        passed &= rest == 0.0 or rig.robot.stopped != ""
        return Outcome(passed and step <= LARGEST_STEP_M, happened, step, held_s)

    return run


def _signal(number: signal.Signals) -> Callable[[RunRig], None]:
    def ask(rig: RunRig) -> None:
        os.kill(rig.process.pid, number)

    return ask


def _operator(rig: RunRig) -> None:
    asked = subprocess.Popen(command("operator", "stop", str(rig.log)), stdout=subprocess.DEVNULL)
    end = time.monotonic() + _END_S
    while asked.poll() is None and time.monotonic() < end:
        rig.cycle(enable=True, force_n=300.0)
    for _ in range(300):
        rig.cycle(enable=True, force_n=300.0)
    os.kill(rig.process.pid, signal.SIGINT)


def _removed(rig: RunRig) -> None:
    shutil.rmtree(rig.log)
    for _ in range(700):
        rig.cycle(enable=True, force_n=300.0)
    os.kill(rig.process.pid, signal.SIGINT)


_REQUIRED: Final = "ramped out with the feed held; exit status {}; the log reads back without a gap"
SCENARIOS: Final = (
    Scenario(
        "R12",
        "killed-run",
        "kill -9 of counterflex run in the cut; the loop's process is left alone",
        "feed held within 100 ms, ramped out or told to stop, no process left; log repair has every record",
        _killed,
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
        "the folder of the log is removed in the cut, then SIGINT",
        "said; ended with another exit status than a run whose log is there",
        _ended(_removed, 5, words="log", log=False),
        realtime=True,
    ),
)
