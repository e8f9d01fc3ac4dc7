"""What an operator asks of a run, against the loop on the virtual clock: done, or refused with the reason."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from counterflex.app.run.operator_requests import Clock, ask, request
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError, OutputError
from counterflex.integrations.kuka.simulated import RsiContext
from counterflex.protocols.processes.control_array import Life, Request
from counterflex.runtime.state.supervisor import State
from counterflex_lab.faults.rig import Rig


def steady(_: float) -> Float:
    return np.array([0.0, 450.0, 0.0])


class Run:
    """A rig whose shared numbers the operator writes, with a clock of cycles."""

    def __init__(self, *, may_arm: bool = True) -> None:
        self.rig = Rig(force=steady, context=RsiContext())
        self.rig.control[Life.MAY_ARM] = int(may_arm)
        self.cycles = 0

    def ask(self, action: str) -> dict[str, Any]:
        self.cycles = 0

        def wait(_: float) -> None:
            self.cycles += 1
            self.rig.cycle()

        return ask(self.rig.control, action, clock=Clock(self.rig.clock_ns, wait))


@pytest.fixture
def run() -> Iterator[Run]:
    made = Run()
    yield made
    made.rig.close()


def test_stop_ramps_out_with_the_feed_held_and_only_arm_arms_again(run: Run) -> None:
    rig = run.rig
    rig.activate().run(200)
    said = run.ask("stop")
    assert (said["done"], said["state"], said["feed_hold"]) == (True, "hold", True)
    assert run.cycles <= 2  # the next cycle takes it
    rig.run(60)
    assert rig.loop.result.state == State.RAMP_OUT  # it stands
    rig.run(600)
    assert rig.loop.result.state in (State.IDLE, State.READY, State.FAULT)
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


def test_arm_of_a_run_that_acts_does_not_arm_it_again_later(run: Run) -> None:
    """Once the program has switched the correction off, only a new request arms."""
    rig = run.rig
    rig.activate().run(200)
    said = run.ask("arm")
    assert (said["done"], said["state"]) == (True, "active")
    assert not rig.control[Request.ARM]
    rig.control[Request.ARM] = 1  # by whatever wrote it: overtaken, as it acts
    rig.run(2)
    assert not rig.control[Request.ARM]
    rig.sense, rig.enable = False, False
    rig.run(900)
    assert rig.state in (State.READY, State.IDLE)
    assert not rig.control[Request.ARM]


def test_arm_does_not_take_back_a_stop_that_is_on_its_way(run: Run) -> None:
    rig = run.rig
    rig.activate().run(200)
    rig.control[Request.STOP] = 1
    run.ask("arm")
    rig.run(5)
    assert rig.control[Request.STOP]
    assert rig.state == State.RAMP_OUT


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


def test_what_only_watches_is_not_armed_from_outside() -> None:
    run = Run(may_arm=False)
    run.rig.run(200)
    assert run.rig.state == State.READY
    said = run.ask("arm")
    assert not said["done"]
    assert "--arm" in said["refused"]
    assert run.rig.state == State.READY
    run.rig.close()


def test_an_arm_that_was_refused_does_not_act_later(run: Run) -> None:
    rig = run.rig
    rig.run(200)
    rig.enable = True  # the robot program has switched the correction on too early
    rig.run(3)
    said = run.ask("arm")
    assert not said["done"]
    rig.enable = False
    rig.run(100)
    assert rig.state == State.READY


def test_status_says_why_how_old_and_how_hard(run: Run) -> None:
    rig = run.rig
    said = run.ask("status")
    assert (said["state"], said["done"], said["correction_mm"], said["robot_heard"]) == ("idle", True, 0.0, False)
    assert said["age_ms"] == {"robot": None, "force": None}
    assert not run.ask("arm")["done"]
    rig.activate().run(300)
    said = run.ask("status")
    assert said["state"] == "active"
    assert said["robot_heard"]
    assert said["force_n"] == pytest.approx(450.0, rel=0.02)
    assert (said["place"], said["planned_n"]) == (None, None)  # this loop has no plan
    assert 0.0 <= said["age_ms"]["force"] <= 8.0
    rig.sense = False
    rig.run(5)
    assert 16.0 <= run.ask("status")["age_ms"]["force"] <= 28.0
    assert run.ask("status")["age_ms"]["robot"] <= 8.0
    with pytest.raises(InputError):
        run.ask("format the disk")
    with pytest.raises(InputError):
        request("log", "dance")


def test_foreign_senders_are_counted_in_the_status(run: Run) -> None:
    rig = run.rig
    rig.run(100)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        stranger.bind(("127.0.0.1", 0))
        for _ in range(7):
            rig.to_loop(b"<Rob/>", stranger)
        rig.run(3)
    assert run.ask("status")["foreign"] == 7


def test_a_loop_that_stands_still_does_not_take_a_stop_for_done(run: Run) -> None:
    rig = run.rig
    rig.activate().run(100)
    rig.frozen = True
    rig.run(20)
    said = run.ask("stop")
    assert not said["done"]
    assert "not stopped yet" in said["refused"]
    assert rig.control[Request.STOP] == 1  # it stays asked for
    rig.run(300)
    with pytest.raises(OutputError, match="does not answer"):
        run.ask("status")
