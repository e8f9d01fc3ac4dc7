"""Telegrams that hold nothing but their counter: answered before anything is in force, afterwards no telegrams."""

from __future__ import annotations

from dataclasses import replace

from counterflex.app.fault_scenarios.rig import Rig
from counterflex.runtime.supervisor import State


def empty_cycle(rig: Rig) -> None:
    rig.robot.context = replace(rig.robot.context, empty_first=True)
    rig.robot._sent = 0
    rig.cycle()


def test_a_robot_of_which_nothing_is_said_any_more_stops_like_one_that_is_silent() -> None:
    with Rig() as rig:
        rig.activate().run(130)
        held = rig.robot.correction.copy()
        begin = rig.cycle_count
        for _ in range(14):
            empty_cycle(rig)
        states = rig.seen.state[begin:]
        assert State.HOLD in states[:5]
        assert states[-1] == State.FAULT
        assert (abs(rig.robot.correction - held) < 1e-9).all()


def test_before_arming_they_are_answered_with_zero() -> None:
    with Rig() as rig:
        for _ in range(20):
            empty_cycle(rig)
        assert rig.state == State.IDLE
        assert rig.seen.age[5:] == [0] * 15
        assert not rig.robot.correction.any()
        rig.run(150)
        assert int(rig.state) == State.READY
