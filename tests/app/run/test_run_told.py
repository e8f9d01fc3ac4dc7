"""What a run tells at its end: its true causes, no loop that stands still, a summary after every interrupt."""

from __future__ import annotations

import json
import os
import pickle
import select
import signal
import subprocess
import sys
import time
from operator import methodcaller
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from counterflex.app.run import run as online
from counterflex.app.run.end import RunCauses
from counterflex.app.run.process import cycle_on
from counterflex.app.run.recorder import SUMMARY
from counterflex.app.run.status import StatusReader
from counterflex.core.arrays import Float, Int
from counterflex.protocols.processes.control_array import CONTROL, Life, Request
from counterflex.protocols.session.comparison import compared, comparison_lines
from counterflex.runtime.record_ring import WIDTH, RecordRing, column
from counterflex.runtime.state.supervisor import Cause, State


def rows(*cycles: tuple[State, Cause, Cause, int]) -> Float:
    out = np.zeros((len(cycles), WIDTH))
    for row, (state, cause, soft, elapsed) in zip(out, cycles, strict=True):
        row[column("out_state")], row[column("out_cause")], row[column("out_soft")] = state, cause, soft
        row[column("elapsed")] = elapsed
    return out


def test_what_is_lacking_before_and_behind_a_flawless_run_is_no_cause_of_it() -> None:
    causes = RunCauses()
    causes.add(rows((State.IDLE, Cause.FORCE_STALE, Cause.FORCE_STALE, 1), (State.READY, Cause.NONE, Cause.NONE, 1)))
    causes.add(rows((State.ARMED, Cause.NONE, Cause.NONE, 1), (State.ACTIVE, Cause.NONE, Cause.NONE, 1)))
    causes.add(rows((State.RAMP_OUT, Cause.PROGRAM, Cause.NONE, 1), (State.READY, Cause.PROGRAM, Cause.NONE, 1)))
    causes.add(rows(*[(State.IDLE, Cause.TELEGRAMS_STOPPED, Cause.TELEGRAMS_STOPPED, 0)] * 3))
    assert causes.names == ["program"]


def test_a_fault_has_its_own_cause_alone() -> None:
    causes = RunCauses()
    causes.add(rows((State.ACTIVE, Cause.NONE, Cause.NONE, 1), (State.FAULT, Cause.WRONG_FRAME, Cause.NONE, 1)))
    causes.add(rows((State.FAULT, Cause.WRONG_FRAME, Cause.TELEGRAMS_LATE, 0)))
    assert causes.names == ["wrong_frame"]


def test_what_kept_a_run_from_arming_is_its_cause_and_what_was_lacking_first_is_not() -> None:
    causes = RunCauses()
    causes.add(rows((State.IDLE, Cause.FORCE_STALE, Cause.FORCE_STALE, 1)))
    causes.add(rows((State.IDLE, Cause.FRAME_OFFSET, Cause.FRAME_OFFSET, 1)))
    causes.add(rows((State.IDLE, Cause.TELEGRAMS_STOPPED, Cause.TELEGRAMS_STOPPED, 0)))
    assert causes.names == ["frame_offset"]
    disarmed = RunCauses()
    disarmed.add(rows((State.ARMED, Cause.NONE, Cause.NONE, 1), (State.READY, Cause.OFF_PATH, Cause.OFF_PATH, 1)))
    assert disarmed.names == ["off_path"]


@pytest.mark.parametrize("ended", [0, 1])
def test_a_loop_that_has_ended_does_not_stand_still(ended: int) -> None:
    ring = RecordRing()
    try:
        control: Int = np.zeros(CONTROL, dtype=np.int64)
        control[Life.LOOP_NS], control[Life.ENDED] = time.monotonic_ns() - 10**10, ended
        reader = StatusReader(ring.name, control)
        reader._last = np.zeros(WIDTH)
        status = reader.look()
        reader.close()
    finally:
        ring.close()
    assert status is not None
    assert (status.still_s == 0.0) == bool(ended)


def test_a_second_interrupt_leaves_a_summary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    control: Int = np.zeros(CONTROL, dtype=np.int64)
    joined: list[float] = []

    class Played:
        disk_stands, number = False, 1

        def __init__(self, *_: object) -> None:
            self.control = control
            self.loop = SimpleNamespace(join=joined.append)

        def begin(self, _: object) -> tuple[tuple[str, int], list[str]]:
            return ("127.0.0.1", 1), []

        def watch(self, *_: object) -> None:
            raise KeyboardInterrupt

        def summary(self) -> dict[str, Any]:
            end = {"by": "operator", "cause": "operator"}
            return {"loop_ended": "as asked", "correction_ended": end, "recorder_died": False, "records_lost": 0} | {
                "log_trouble": "",
                "cycles": 7,
            }

        def close(self) -> None:
            pass

    monkeypatch.setattr(online, "Supervised", Played)
    monkeypatch.setattr(online, "one_protocol", lambda given: given)
    settings = SimpleNamespace(arm=True, cell=tmp_path / "cell.toml")
    with pytest.raises(KeyboardInterrupt):
        online.run(cast(Any, settings), tmp_path)
    assert json.loads((tmp_path / SUMMARY).read_text())["ended"]["how"] == "stopped"
    assert joined
    assert control[Request.END] == 1


def test_an_unreadable_message_of_a_robot_that_waits_is_a_cycle() -> None:
    """In lockstep nothing came after it: neither counted nor told."""
    counters = SimpleNamespace(malformed=0)
    handled: list[bool] = []
    waits = iter([False, False, True])

    def wait(_: float) -> bool:
        counters.malformed += int(not handled)
        return next(waits, False)

    session = SimpleNamespace(
        trouble="",
        another_port=0,
        cycles=1,
        link=SimpleNamespace(counters=counters, wait=wait),
        loop=SimpleNamespace(state=State.READY, result=SimpleNamespace(stop=0)),
        handle_cycle=handled.append,
    )
    control: Int = np.zeros(CONTROL, dtype=np.int64)
    living = SimpleNamespace(gone=lambda: False)
    settings = SimpleNamespace(lockstep=True, quiet_s=0.3)
    cycle_on(cast(Any, session), cast(Any, settings), control, cast(Any, living), None)
    assert handled == [False, True]


def test_lines_say_how_much_and_what_to_do() -> None:
    words = [0] * CONTROL
    numbers: dict[str, Any] = compared(words)
    assert list(comparison_lines(numbers, Cause.NONE, Cause.NONE)) == []
    numbers |= {"missing_mm": 0.21, "missing_most_mm": 0.25, "frame_offset_mm": 3.0, "off_plan_mm": 2.0}
    lines = list(comparison_lines(numbers, Cause.FRAME_OFFSET, Cause.OFF_PATH))
    assert "0.25 mm" in lines[0]
    assert "3.00 mm" in lines[1]
    assert "2.00 mm" in lines[2]


if sys.platform.startswith("linux"):
    PARENT = """
import multiprocessing, pathlib, pickle, sys, time
from counterflex.app.run.child import child
if __name__ == "__main__":
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    job = bytes.fromhex(sys.argv[1])
    process = context.Process(target=child, args=(job, pathlib.Path("/nowhere"), theirs))
    process.start()
    print(process.pid, flush=True)
    process.join()
"""

    def test_a_process_of_a_run_dies_with_the_one_that_started_it_whatever_it_does(tmp_path: Path) -> None:
        """It waits in a system call, as one that waits for the lock of a cache does."""
        script = tmp_path / "parent.py"
        script.write_text(PARENT, encoding="utf-8")
        job = pickle.dumps((methodcaller("poll", None), ())).hex()
        with subprocess.Popen([sys.executable, str(script), job], stdout=subprocess.PIPE, text=True) as parent:
            assert parent.stdout is not None
            number = int(parent.stdout.readline())
            handle = os.pidfd_open(number)
            parent.send_signal(signal.SIGKILL)
        assert select.select([handle], [], [], 60.0)[0]  # ends at once; a minute on a machine that stands still
