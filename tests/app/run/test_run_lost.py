"""A loop that is left alone: it holds the feed, ramps out where the robot stands, stops the robot, and ends."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from counterflex.integrations.kuka.simulated import RsiContext
from counterflex.protocols.processes.control_array import Life, Shown
from counterflex.protocols.session.session import SessionChecks
from counterflex.runtime.state.supervisor import Cause, State
from counterflex_lab.faults.process_rig import ProcessRig
from counterflex_lab.faults.rig import Rig


@pytest.fixture
def rig() -> Iterator[Rig]:
    with Rig(force=lambda _: np.array([0.0, 450.0, 0.0]), context=RsiContext()) as made:
        yield made


def beating(rig: Rig, cycles: int) -> None:
    for _ in range(cycles):
        rig.control[Life.RUN_NS] = rig.clock_ns()
        rig.cycle()


def test_who_is_silent_is_lost_within_100_ms_and_taken_back_when_he_speaks_again(rig: Rig) -> None:
    rig.activate()
    beating(rig, 200)
    assert rig.state == State.ACTIVE
    cycles = 0
    while rig.state == State.ACTIVE:
        rig.cycle()
        cycles += 1
    assert rig.loop.cause == Cause.RUN_LOST
    assert 80 <= 4 * cycles <= 100
    assert rig.robot.feed_hold
    beating(rig, 70)
    assert rig.state == State.ACTIVE


def test_nobody_is_missed_who_has_never_spoken_or_whose_robot_waits() -> None:
    with Rig(force=lambda _: np.array([0.0, 450.0, 0.0]), context=RsiContext()) as rig:
        rig.activate().run(200)
        assert rig.state == State.ACTIVE
    with Rig(context=RsiContext(), checks=SessionChecks(run_silent_s=None)) as rig:
        rig.control[Life.RUN_NS] = 1
        rig.activate().run(200)
        assert rig.state == State.ACTIVE


def test_who_has_died_does_not_come_back(rig: Rig) -> None:
    rig.activate().run(200)
    before = float(np.linalg.norm(rig.robot.correction[:3]))
    rig.control[Life.GONE] = 1
    rig.run(2)
    assert (rig.state, rig.loop.cause) == (State.HOLD, Cause.RUN_LOST)
    assert rig.robot.feed_hold
    assert rig.control[Shown.CAUSE] == Cause.RUN_LOST
    rig.run(600)
    assert rig.robot.stopped == "Stop"
    assert float(np.linalg.norm(rig.robot.correction[:3])) < 1e-6 < before
    assert State.ACTIVE not in rig.seen.state[-600:]


def test_a_robot_that_does_not_hold_its_feed_is_stopped_with_the_correction_as_it_is(rig: Rig) -> None:
    rig._holds_feed = False
    rig.activate().run(200)
    rig.control[Life.GONE] = 1
    rig.run(200)
    assert rig.state == State.FAULT
    assert rig.robot.stopped == "Stop"
    assert float(np.linalg.norm(rig.robot.correction[:3])) > 1e-5


if hasattr(signal, "SIGKILL"):

    @pytest.mark.parametrize("who", ["starter", "recorder"])
    def test_a_kill_is_seen_by_the_loop_in_its_next_cycles(tmp_path: Path, who: str) -> None:
        """Real processes; the robot waits for every answer, so that cycles count and not the speed of the machine."""
        with ProcessRig(tmp_path) as rig:
            rig.start_recorder("log")
            rig.start_starter()
            rig.start_loop()
            rig.activate()
            rig.run(60)
            assert rig.state == State.ACTIVE
            victim, loop = (rig.starter if who == "starter" else rig.recorder), rig.loop
            assert victim is not None
            assert loop is not None
            first = len(rig.corrections)
            os.kill(victim.pid or 0, signal.SIGKILL)
            victim.join()
            rig.cycle(300.0)
            rig.cycle(300.0)
            assert rig.robot.feed_hold
            while rig.cycle(0.0, patience_s=0.2):
                pass
            loop.join()
            assert loop.exitcode == 0
            assert rig.robot.stopped == "Stop"
            assert np.linalg.norm(rig.robot.correction[:3]) < 1e-6
            assert rig.steps(first).max() < 0.081e-3
            assert (rig.control[Life.ENDED], rig.control[Life.GONE]) == (1, 1)
