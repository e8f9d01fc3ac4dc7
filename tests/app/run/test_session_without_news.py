"""Telegrams that hold nothing but their counter: answered before anything is in force, afterwards no telegrams."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from counterflex.protocols.tracker.link import TrackerLink
from counterflex.protocols.tracker.telegram import BEAM_BROKEN, TrackerPose
from counterflex.runtime.settings import ForceMode, OnlineSettings, TrackerMode
from counterflex.runtime.state.supervisor import Cause, State
from counterflex_lab.faults.rig import Rig


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
        assert rig.robot.feed_hold
        assert rig.robot.stopped == "Stop"


def test_before_arming_they_are_answered_with_zero() -> None:
    with Rig() as rig:
        for _ in range(20):
            empty_cycle(rig)
        assert rig.state == State.IDLE
        assert rig.seen.age[5:] == [0] * 15
        assert not rig.robot.correction.any()
        rig.run(150)
        assert int(rig.state) == State.READY


@pytest.mark.parametrize("status", [None, BEAM_BROKEN])
@pytest.mark.parametrize("force", [ForceMode.NONE, ForceMode.MEASURED])
def test_a_tracker_that_shows_nothing_before_the_start_is_the_cause_of_idle(
    force: ForceMode, status: int | None
) -> None:
    """It stood in idle silently, and nobody knew what it was waiting for."""
    settings = OnlineSettings(force=force, tracker=TrackerMode.INTEGRATOR, normal_only=False)
    tracker = TrackerLink()
    try:
        with Rig(settings=settings, tracker=tracker) as rig:
            for k in range(150):
                if status is not None:
                    pose = TrackerPose(k, 4_000_000 * k, status, 0, np.eye(4), 0.0)
                    rig.robot_socket.sendto(pose.telegram(), tracker.address)
                rig.cycle()
            assert rig.state == State.IDLE
            assert rig.loop.cause == Cause.TRACKER_LOST
    finally:
        tracker.close()


def test_a_force_sensor_that_says_nothing_is_the_cause_of_idle() -> None:
    with Rig() as rig:
        rig.sense = False
        rig.run(150)
        assert rig.state == State.IDLE
        assert rig.loop.cause == Cause.FORCE_STALE
