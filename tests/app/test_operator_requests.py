"""What an operator asks of a run, against the loop on the virtual clock: done, or refused with the reason."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from counterflex.app.fault_scenarios.rig import Rig
from counterflex.app.operator_requests import OperatorRequests, request
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.links.control_array import Request
from counterflex.links.operator_port import Asked
from counterflex.runtime import record_ring as record
from counterflex.runtime.supervisor import State
from counterflex.twin.fake_rsi import RsiContext


class Port:
    """Stands for the port: requests of the test, answers for it."""

    def __init__(self) -> None:
        self.asked: list[Asked] = []
        self.answers: list[dict[str, Any]] = []

    def poll(self) -> list[Asked]:
        found, self.asked = self.asked, []
        return found

    def answer(self, _: Asked, said: dict[str, Any]) -> None:
        self.answers.append(said)


def steady(_: float) -> Float:
    return np.array([0.0, 450.0, 0.0])


class Run:
    """A rig whose control array the operator's requests write, with a clock of cycles."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, *, may_arm: bool = True) -> None:
        self.rig = Rig(force=steady, context=RsiContext())
        self.port = Port()
        self.requests = OperatorRequests(self.port, self.rig.control, may_arm=may_arm)  # type: ignore[arg-type]
        monkeypatch.setattr(time, "monotonic", lambda: self.rig.now_s)

    def ask(self, action: str, cycles: int = 90) -> dict[str, Any]:
        self.port.asked.append(Asked(action, ("127.0.0.1", 1), self.rig.now_s))
        for _ in range(cycles):
            if self.requests.serve(self.row()):
                self.rig.control[Request.ARM] = 1
            if self.port.answers:
                break
            self.rig.cycle()
        return self.port.answers.pop()

    def row(self) -> Float:
        loop = self.rig.loop
        row = np.zeros(record.WIDTH)
        row[record.RESULTS : record.OUTCOME] = loop.results
        row[record.OUTCOME : record.MONITOR] = loop.outcome
        return row


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch) -> Iterator[Run]:
    made = Run(monkeypatch)
    yield made
    made.rig.close()


def test_stop_ramps_out_with_the_feed_held_and_only_arm_arms_again(run: Run) -> None:
    rig = run.rig
    rig.activate().run(200)
    said = run.ask("stop")
    assert (said["done"], said["state"], said["feed_hold"]) == (True, "ramp_out", True)
    rig.run(600)
    assert rig.loop.outcome[0] in (State.IDLE, State.READY, State.FAULT)
    assert np.linalg.norm(rig.robot.correction[:3]) < 1e-6
    assert rig.robot.stopped == "Stop"
    rig.restart_robot(rig.robot.counter + 60_000)
    rig.enable = rig.feed = False
    rig.run(50)
    assert run.ask("reset")["state"] in ("idle", "ready")
    rig.run(200)
    assert rig.state == State.READY  # stopped stays stopped
    rig.control[Request.ARM] = 0
    assert run.ask("arm")["state"] == "armed"


def test_a_reset_does_not_leave_a_fault_while_a_correction_is_in_force(run: Run) -> None:
    rig = run.rig
    rig.activate().run(200)
    rig.sense, rig._holds_feed = False, False
    while rig.state != State.FAULT:
        rig.cycle()
    said = run.ask("reset")
    assert not said["done"]
    assert said["state"] == "fault"
    assert "end the robot program" in said["refused"]
    rig.paused = True
    rig.run(200)  # silence: the robot has stopped, nothing is in force
    said = run.ask("reset")
    assert (said["done"], said["state"]) == (True, "idle"), said
    rig.paused, rig.enable, rig.feed, rig.sense = False, False, False, True
    rig.restart_robot(rig.robot.counter + 60_000)
    rig.run(200)
    assert rig.seen.state[-1] == State.READY
    assert State.ACTIVE not in rig.seen.state[-450:]


def test_what_only_watches_is_not_armed_from_outside(monkeypatch: pytest.MonkeyPatch) -> None:
    run = Run(monkeypatch, may_arm=False)
    run.rig.run(200)
    assert run.rig.state == State.READY
    said = run.ask("arm")
    assert not said["done"]
    assert "--arm" in said["refused"]
    assert run.rig.state == State.READY
    run.rig.close()


def test_status_says_why_and_what_is_no_request_is_refused(run: Run) -> None:
    run.rig.run(10)
    said = run.ask("status")
    assert (said["state"], said["done"], said["correction_mm"]) == ("idle", True, 0.0)
    assert not run.ask("arm")["done"]
    assert run.ask("format the disk")["refused"] == "no such request"
    with pytest.raises(InputError):
        request("log", "dance")
