"""Stops of the cell and of the loop, at any moment of a program: the tables of docs/safety.md.

Categories of IEC 60204-1 as the loop meets them. 2: the program stands, the power stays, telegrams go on. 1 and 0: the
power is taken, telegrams end. The loop itself asks for stops of category 2 only: a held feed, then Stop.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest

import counterflex
from counterflex.core.arrays import Float
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.geometry import pose, rotation
from counterflex.runtime.cycle_inputs import CycleInputs
from counterflex.runtime.loop import Loop
from counterflex.runtime.loop_plan import LoopPlan
from counterflex.runtime.settings import ForceMode, OnlineSettings
from counterflex.runtime.state.states import Cause, State
from counterflex.runtime.step.place import FAULT_LOST
from counterflex.runtime.step.supervise import DEBOUNCE, SESSION_S

CELL: Final[Cell] = read_cell(Path(counterflex.__file__).parent / "app" / "demo" / "cell.toml")
Q: Final = np.radians([0.0, -90.0, 120.0, 0.0, 30.0, 0.0])
FORCE: Final = np.array([-120.0, 700.0, -90.0])
STEP_M: Final = 1e-4
CUT: Final = (0.005, 0.06)
MOMENTS: Final = (0.001, 0.0045, 0.006, 0.01, 0.03, 0.0595, 0.0605, 0.07)
"""Places of the program, m: in air, before, at the beginning, in, at the end of and behind the cut."""


def _loop() -> Loop:
    x = np.linspace(0.0, 0.1, 401)
    cuts = ((x > CUT[0]) & (x < CUT[1])).astype(np.float64)
    w = np.zeros((len(x), 6))
    w[:, :3] = FORCE * cuts[:, None]
    plan = LoopPlan(np.stack([x, 0.0 * x, 0.0 * x], axis=1), x / 0.025, w, cuts, np.zeros((len(x), 6)))
    return Loop(CELL.chain, OnlineSettings(force=ForceMode.MEASURED), CELL.T_base_part, plan)


LOOP: Final = _loop()
HOLD: Final = LOOP.settings.supervisor.hold
PERIOD_S: Final = LOOP.settings.period_s
_FASTEST_M_S: Final = LOOP.settings.translation.speed
BRAKES_M: Final = _FASTEST_M_S**2 / (2.0 * 1.25) + _FASTEST_M_S * PERIOD_S
"""What a correction moves at most until it stands where it is to be frozen: it comes from its limit of speed, and is
braked with its limit of acceleration, 1.25 m/s2."""


class Robot:
    """A program with one cut, corrected; `stands` and `silent` are a stop of the cell, whatever the loop asks for."""

    def __init__(self, x: float, *, obeys: bool = True) -> None:
        LOOP.reset()
        self.x, self.obeys = 0.0, obeys
        self.stands = self.silent = self.ended = False
        self.moved_in_cut = 0.0
        self.asked: list[tuple[bool, bool]] = []
        for arm in (False, False, True):
            self.cycle(enable=False, arm=arm)
        while self.x < x:
            self.cycle()
        assert self.state == State.ACTIVE

    @property
    def state(self) -> State:
        return LOOP.state

    @property
    def correction(self) -> Float:
        out: Float = LOOP.correction[:3].copy()
        return out

    def cycle(self, **inputs: Any) -> State:
        held = bool(LOOP.result.feed_hold) and self.obeys
        goes = not (self.stands or self.silent or self.ended or held)
        self.x += STEP_M * goes
        in_cut = CUT[0] < self.x < CUT[1]
        w = np.zeros(6)
        w[:3] = FORCE * (in_cut and goes)
        before = self.correction
        given = {"enable": True, "elapsed": 0 if self.silent else 1} | inputs
        LOOP.feed(
            CycleInputs(
                T_part_tcp=pose.make(rotation.about_x(np.pi), np.array([self.x, 0.0, 0.0])), q=Q, w_tcp_part=w, **given
            )
        )
        LOOP.run()
        if in_cut and goes and self.state != State.ACTIVE:
            self.moved_in_cut += float(np.linalg.norm(self.correction - before))
        self.asked.append((bool(LOOP.result.feed_hold), bool(LOOP.result.stop)))
        self.ended = self.ended or (bool(LOOP.result.stop) and not self.silent)
        return self.state


@pytest.mark.parametrize("x", MOMENTS)
@pytest.mark.parametrize("obeys", [True, False])
def test_the_loop_asks_for_a_held_feed_first_and_for_a_stop_behind_it(x: float, obeys: bool) -> None:
    """Both of category 2: the correction moves in the cut while the robot stands only, and the end is bounded."""
    robot = Robot(x, obeys=obeys)
    robot.asked.clear()
    ramp = LOOP.settings.translation.radius / LOOP.settings.ramp_m_s / PERIOD_S
    for _ in range(round(2 * HOLD + ramp) + 100):
        robot.cycle(stop=True)
    held, stopped = np.array(robot.asked).T
    assert held[0]
    assert held.all()
    assert stopped.any()
    assert int(np.argmax(stopped)) > 0
    assert robot.ended
    assert robot.moved_in_cut < BRAKES_M
    assert robot.state in (State.IDLE, State.READY, State.FAULT)
    if obeys:
        assert np.linalg.norm(robot.correction) < 1e-6


@pytest.mark.parametrize("x", MOMENTS)
def test_a_stop_of_category_2_by_the_cell_is_taken_as_a_program_that_stands(x: float) -> None:
    """Nothing is asked, no cause is told; the correction stays within its limit, and the program goes on corrected."""
    robot = Robot(x)
    robot.stands = True
    robot.asked.clear()
    for _ in range(300):
        assert robot.cycle() == State.ACTIVE
        assert np.linalg.norm(robot.correction) <= LOOP.settings.translation.radius
    assert LOOP.cause == Cause.NONE
    assert not np.any(robot.asked)
    robot.stands = False
    for _ in range(50):
        assert robot.cycle() == State.ACTIVE


@pytest.mark.parametrize("x", MOMENTS)
@pytest.mark.parametrize("cycles", [FAULT_LOST, 60, round(SESSION_S / PERIOD_S) + 130])
def test_a_stop_of_category_1_or_0_freezes_and_has_no_way_back_but_reset_and_arming(x: float, cycles: int) -> None:
    """Telegrams end: nothing moves from the first cycle on, and the power that comes back finds a fault."""
    robot = Robot(x)
    kept = robot.correction
    robot.silent = True
    for k in range(cycles):
        robot.cycle()
        assert np.array_equal(robot.correction, kept) or (
            (k + 1) * PERIOD_S > SESSION_S and not np.any(robot.correction)
        )
        assert robot.state == (State.FAULT if k >= FAULT_LOST - 1 else robot.state)
    assert (robot.state, LOOP.cause) == (State.FAULT, Cause.TELEGRAMS_STOPPED)
    robot.silent, robot.ended = False, False
    robot.cycle(hard=Cause.SESSION_RESTARTED, enable=False)  # the controller was started again
    for arm in (True, False) * 100:
        assert robot.cycle(arm=arm) == State.FAULT
    robot.cycle(enable=False, reset=True)
    for _ in range(40):
        assert int(robot.cycle()) <= State.READY
    assert not np.any(robot.correction)
    robot.cycle(enable=False, reset=True)
    for _ in range(DEBOUNCE - 1):  # off for as long as an off takes
        assert int(robot.state) == State.READY
        robot.cycle(enable=False, arm=True)
    assert int(robot.state) == State.ARMED


@pytest.mark.parametrize("x", MOMENTS)
def test_a_stop_of_the_cell_while_the_loop_already_stops_changes_nothing_in_the_cut(x: float) -> None:
    """A door is opened during a hold, a ramp, or behind it."""
    for cycles in (1, 5, 30, HOLD, HOLD + 40):
        robot = Robot(x)
        for _ in range(cycles):
            robot.cycle(stop=True)
        before = robot.correction
        robot.silent = True
        for _ in range(FAULT_LOST):
            robot.cycle(stop=True)
            assert np.array_equal(robot.correction, before)
        assert robot.state in (State.FAULT, State.IDLE)
        assert robot.moved_in_cut < BRAKES_M
