"""A stop in the cut: held, ramped out where the robot stands, stopped with its correction where it does not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import counterflex
from counterflex.core.arrays import Float
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.geometry import pose, rotation
from counterflex.runtime.cycle_inputs import CycleInputs
from counterflex.runtime.loop import Loop
from counterflex.runtime.loop_plan import LoopPlan
from counterflex.runtime.primitives.history import SPAN
from counterflex.runtime.settings import ForceMode, OnlineSettings
from counterflex.runtime.state.supervisor import Cause, State
from counterflex.runtime.step.supervise import DEBOUNCE

CELL: Cell = read_cell(Path(counterflex.__file__).parent / "app" / "demo" / "cell.toml")
Q = np.radians([0.0, -90.0, 120.0, 0.0, 30.0, 0.0])
R = rotation.about_x(np.pi)
FORCE = np.array([-120.0, 700.0, -90.0])
CUTS = ((0.005, 0.06), (0.07, 0.18))
STEP_M = 1e-4
BRAKES_M = 20e-6
"""What the correction moves at most until it stands where it is to be frozen: its own speed is braked, not cut off."""


def cut_at(x: float) -> bool:
    return any(a < x < b for a, b in CUTS)


def made(*, planned: bool) -> Loop:
    x = np.linspace(0.0, 0.2, 801)
    cuts = np.array([float(cut_at(each)) for each in x])
    w = np.zeros((len(x), 6))
    w[:, :3] = FORCE * cuts[:, None]
    plan = LoopPlan(np.stack([x, 0.0 * x, 0.0 * x], axis=1), x / 0.025, w, cuts, np.zeros((len(x), 6)))
    online = OnlineSettings(force=ForceMode.MEASURED, normal_only=planned)
    return Loop(CELL.chain, online, CELL.T_base_part, plan if planned else None)


LOOPS = {planned: made(planned=planned) for planned in (True, False)}


class Job:
    """A program of two cuts, 0.1 mm a cycle, a force in each; the robot obeys a feed hold or does not."""

    def __init__(self, *, planned: bool = True, obeys: bool = True) -> None:
        self.loop, self.obeys = LOOPS[planned], obeys
        self.loop.reset()
        self.x, self.cycles, self.still = 0.0, 0, 1000
        self.moved = 0.0
        self.stopped = self.stop = False
        self.enable = True

    def cycle(self, *, moves: bool | None = None, **inputs: Any) -> State:
        obeyed = self.held and self.obeys
        goes = (not obeyed if moves is None else moves) and not self.stopped
        self.x += STEP_M * goes
        self.still = 0 if goes else self.still + 1
        w = np.zeros(6)
        w[:3] = FORCE if cut_at(self.x) and goes else 0.0
        before = self.correction.copy()
        self.loop.feed(
            CycleInputs(
                T_part_tcp=pose.make(R, np.array([self.x, 0.0, 0.0])),
                q=Q,
                w_tcp_part=w,
                **({"enable": self.enable, "stop": self.stop} | inputs),
            )
        )
        self.loop.run()
        self.cycles += 1
        if goes and cut_at(self.x):
            self.moved += float(np.linalg.norm(self.correction - before))
        self.stopped = self.stopped or bool(self.loop.result.stop)
        return self.state

    def active(self, x: float) -> Job:
        for arm in (False, False, True):
            self.cycle(enable=False, arm=arm)
        while self.x < x:
            self.cycle()
        assert self.state == State.ACTIVE
        return self

    def end(self, **inputs: Any) -> int:
        """Cycles until it has come to an end."""
        begin = self.cycles
        while self.state in (State.ACTIVE, State.HOLD, State.RAMP_OUT):
            self.cycle(**inputs)
            assert self.cycles - begin < 1500
        return self.cycles - begin

    @property
    def state(self) -> State:
        return self.loop.state

    @property
    def correction(self) -> Float:
        return self.loop.correction[:3]

    @property
    def held(self) -> bool:
        return bool(self.loop.result.feed_hold)


@pytest.mark.parametrize("planned", [True, False])
@pytest.mark.parametrize("who", ["operator", "program"])
def test_a_robot_that_disobeys_the_feed_hold_keeps_its_correction_and_is_told_to_stop(who: str, planned: bool) -> None:
    """The correction was ramped out, 1.07 mm in 0.54 s, while the robot cut on."""
    job = Job(planned=planned, obeys=False).active(0.03)
    kept = job.correction.copy()
    assert np.linalg.norm(kept) > 0.3e-3
    if who == "operator":
        job.stop = True
    else:
        job.enable = False
        for _ in range(DEBOUNCE - 1):
            job.cycle()
    job.cycle()
    assert job.state == State.HOLD
    assert job.held
    assert job.end() <= job.loop.settings.supervisor.hold + 2
    assert (job.state, job.loop.cause) == (State.FAULT, Cause.HELD_TOO_LONG)
    assert job.stopped
    assert np.linalg.norm(job.correction - kept) < BRAKES_M


@pytest.mark.parametrize("planned", [True, False])
def test_a_robot_that_stands_is_ramped_out_as_soon_as_it_does(planned: bool) -> None:
    job = Job(planned=planned).active(0.03)
    job.stop = True
    job.moved = 0.0
    while job.cycle() == State.HOLD:
        assert job.held
    assert job.still <= SPAN + 1
    assert job.state == State.RAMP_OUT
    job.end()
    assert (job.state, job.loop.cause) == (State.READY, Cause.OPERATOR)
    assert job.moved < BRAKES_M
    assert job.held
    assert job.stopped


def test_out_of_the_cut_the_ramp_begins_at_once_and_the_next_cut_is_not_entered_with_it() -> None:
    """A robot that disobeys the feed hold comes into the next cut with what is left, and is told to stop there."""
    job = Job(obeys=False).active(CUTS[0][1] + 2e-3)  # the force has left its filter
    job.stop = True
    assert job.cycle() == State.RAMP_OUT
    assert job.held
    job.x = CUTS[1][0] - 3 * STEP_M  # the gap is short
    job.moved = 0.0
    job.end()
    assert (job.state, job.loop.cause) == (State.FAULT, Cause.HELD_TOO_LONG)
    assert np.linalg.norm(job.correction) > 0.15e-3
    assert job.moved < BRAKES_M


@pytest.mark.parametrize("enable", [True, False])
def test_a_robot_that_goes_on_in_the_cut_while_it_is_ramped_out_is_held_again(enable: bool) -> None:
    """A dwell, or a person who lets the feed go: what is left of the correction stays, the robot is told to stop."""
    job = Job().active(0.03)
    job.stop = True
    while job.cycle() != State.RAMP_OUT:
        pass
    for _ in range(20):
        job.cycle()
    job.obeys, job.enable, job.moved = False, enable, 0.0
    kept = job.correction.copy()
    job.cycle()
    job.end()
    assert (job.state, job.loop.cause) == (State.FAULT, Cause.HELD_TOO_LONG)
    assert job.stopped
    assert np.linalg.norm(job.correction - kept) < 2 * BRAKES_M


def test_a_stop_is_not_forgotten_while_it_is_held() -> None:
    """Asked once, in a hold that would end by itself: it ends the correction."""
    job = Job().active(0.03)
    job.cycle(soft=Cause.FORCE_STALE)
    job.cycle(stop=True)
    for _ in range(job.loop.settings.supervisor.good + 5):
        assert job.cycle(moves=True) != State.ACTIVE


_EVENT = st.tuples(
    st.sampled_from(["goes", "stands", "as asked"]),
    st.sampled_from(["", "", "enable off", "enable on", "stale", "lose"]),
    st.integers(1, 60),
)


@settings(max_examples=20, deadline=None)
@given(st.booleans(), st.floats(0.02, 0.05), st.sampled_from(["stop", "enable"]), st.lists(_EVENT, max_size=8))
def test_after_a_stop_in_the_cut_the_correction_moves_only_where_the_robot_stands_and_it_comes_to_an_end(
    planned: bool, x: float, who: str, events: list[tuple[str, str, int]]
) -> None:
    job = Job(planned=planned).active(x)
    job.stop, job.enable = who == "stop", who != "enable"
    job.moved = 0.0
    pieces = 1
    for motion, event, cycles in events:
        if event.startswith("enable") and who == "stop":
            job.enable = event.endswith("on")
        moves = {"goes": True, "stands": False}.get(motion)
        pieces += 1
        for _ in range(cycles):
            if job.state == State.ACTIVE:
                job.moved = 0.0  # it is not taken for switched off yet
            inputs: dict[str, Any] = {"soft": Cause.FORCE_STALE} if event == "stale" else {}
            if event == "lose":
                inputs["elapsed"] = 0 if job.cycles % 3 else 3
            job.cycle(moves=moves, **inputs)
            assert job.moved < pieces * BRAKES_M
    ramp = np.linalg.norm(job.correction) / 2e-3 / 4e-3 * 1.5 + 100
    assert job.end() < job.loop.settings.supervisor.hold + ramp
    assert job.state in (State.READY, State.IDLE, State.FAULT)


@pytest.mark.parametrize("enable", [True, False])
@pytest.mark.parametrize("why", ["a check", "never switched on", "the operator"])
def test_a_cut_that_begins_uncorrected_although_it_was_armed_is_held(why: str, enable: bool) -> None:
    """A soft cause disarmed for good, and a program that does not wait for the state cut on silently."""
    job = Job(obeys=False)
    for arm in (False, False, True):
        job.cycle(enable=False, arm=arm)
    assert int(job.state) == State.ARMED
    if why == "a check":
        job.cycle(enable=False, soft=Cause.FORCE_STALE)
    elif why == "the operator":
        job.stop = True
    job.enable = enable and why != "never switched on"
    while job.x < CUTS[0][0]:
        job.cycle()
        assert not job.held
    for _ in range(DEBOUNCE + 3):
        job.cycle()
    assert job.held
    assert job.stopped
    assert int(job.state) == State.READY
    named = {"a check": Cause.FORCE_STALE, "never switched on": Cause.ENABLE_LOST, "the operator": Cause.OPERATOR}
    assert job.loop.cause == named[why]
    job.stop, job.enable = False, False
    job.cycle(arm=True)
    assert int(job.state) == State.READY  # nobody has seen it yet
    job.cycle(reset=True)
    assert not job.held
    for _ in range(DEBOUNCE - 2):  # off for as long as an off takes
        job.cycle(arm=True)
    assert int(job.state) == State.ARMED


def test_standing_in_the_cut_is_no_cut_that_begins() -> None:
    job = Job()
    job.x = 0.03
    for arm in (*[False] * 30, True):
        job.cycle(enable=False, arm=arm, moves=False)
    assert int(job.state) == State.ARMED
    for _ in range(100):
        job.cycle(enable=False, moves=False)
    assert int(job.state) == State.ARMED
    assert not job.held
