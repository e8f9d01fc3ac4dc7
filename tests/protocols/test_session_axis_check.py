"""A whole session whose telegrams hold wrong axis angles: held in the same cycle, corrected from right angles only."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import counterflex
from counterflex.core.arrays import Float
from counterflex.core.units import DEG, MM
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.geometry import pose
from counterflex.protocols.processes.control_array import REQUESTS, Request
from counterflex.protocols.robot.port import Counters
from counterflex.protocols.session.senses import Sensing
from counterflex.protocols.session.session import OnlineSession, SessionChecks
from counterflex.protocols.session.telegram_watch import WatchSettings
from counterflex.robot.elasticity.chain import forward
from counterflex.runtime.loop import Loop
from counterflex.runtime.plausibility.axis_check import ABOUT, EXACT, AxisCheck
from counterflex.runtime.settings import ForceMode, OnlineSettings, Output
from counterflex.runtime.state.supervisor import Cause, State

CELL: Cell = read_cell(Path(counterflex.__file__).parent / "app" / "demo" / "cell.toml")
BEGIN = np.radians([2.0, -90.0, 120.0, 5.0, 30.0, -8.0])
SPEED = np.radians([2.0, 1.5, -1.5, 2.0, 1.5, 3.0])  # rad/s
GATE, CYCLES = 120, 700
Telegram = Callable[[int, Float], None]


class _Robot:
    """Stands for the link: stands, then moves all axes; its TOOL is 5 mm beside the cell's."""

    commanded_is, measured_is = EXACT, ABOUT
    holds_feed = True

    def __init__(self, spoil: Telegram) -> None:
        self.spoil = spoil
        self.cycle, self.counter, self.elapsed = -1, 1000, 1
        self.restarted = self.empty = self.clamped = False
        self.enable, self.job = False, 0
        self.counters = Counters()
        self.tool = pose.make(p=np.array([3.0, -4.0, 0.0]) * MM)
        self.base = np.eye(4)
        self.sent: list[Float] = []
        self.axes: list[Float] = []
        self.held: list[bool] = []

    def wait(self, _: float) -> bool:
        self.cycle += 1
        self.counter += 4
        self.enable = self.cycle >= GATE
        return True

    def _pose(self, out: Float) -> None:
        T = self.base @ pose.inverse(CELL.T_base_part) @ forward(CELL.controller_chain, self.q) @ self.tool
        out[:] = np.r_[T[:3, :3].reshape(-1), T[:3, 3]]

    @property
    def q(self) -> Float:
        out: Float = BEGIN + SPEED * 4e-3 * max(0, self.cycle - GATE)
        return out

    def fill(self, nominal: Float, q: Float) -> None:
        self._pose(nominal)
        q[:] = self.q
        self.spoil(self.cycle, q)

    def fill_actual(self, pose_: Float) -> bool:
        self._pose(pose_)
        return True

    def fill_reported(self, _: Float) -> bool:
        return False

    def forget(self) -> None:
        """Nobody is known."""

    def answer(self, correction: Float, axes: Float | None = None, **said: object) -> bool:
        self.sent.append(correction.copy())
        self.axes.append(np.zeros(6) if axes is None else axes.copy())
        self.held.append(bool(said["feed_hold"]))
        return True


class _Force:
    """Stands for a sensor that shows a growing force once the program is corrected."""

    saturated = frozen = False
    good, first = 1, -1

    def __init__(self, robot: _Robot) -> None:
        self._robot, self.samples = robot, np.zeros((1, 6))

    @property
    def w_sensor(self) -> Float:
        return np.array([0.0, max(0.0, 0.5 * (self._robot.cycle - GATE)), 0.0, 0.0, 0.0, 0.0])

    def drain(self) -> int:
        return 1


class _Shown:
    """The reading is the process wrench, beyond doubt."""

    doubt = 0

    def __call__(self, _q: Float, w: Float, _age: float) -> Float:
        return w.copy()


def nothing(_: int, __: Float) -> None:
    """Telegrams as they should be."""


def session(robot: _Robot, *, checked: bool = True, output: Output = Output.CARTESIAN) -> OnlineSession:
    settings = OnlineSettings(force=ForceMode.MEASURED, normal_only=False, output=output)
    control = np.zeros(REQUESTS, dtype=np.int64)
    control[Request.ARM] = 1
    made = OnlineSession(
        robot,  # type: ignore[arg-type]
        Loop(CELL.chain, settings, CELL.T_base_part),
        sensing=Sensing(
            force=_Force(robot),  # type: ignore[arg-type]
            wrench=_Shown(),  # type: ignore[arg-type]
            angles=AxisCheck(CELL.controller_chain, CELL.T_base_part, settings.period_s) if checked else None,
        ),
        control=control,
        checks=SessionChecks(settle_cycles=50),
        watch=WatchSettings(clock=False),
    )
    made.loop.run()
    made.loop.reset()
    return made


def test_a_whole_run_without_a_false_alarm() -> None:
    """All axes move by degrees, the tool frame is 5 mm off, the correction acts: nothing is held."""
    robot = _Robot(nothing)
    run = session(robot)
    states = []
    for _ in range(CYCLES):
        run.cycle(0.0)
        states.append(run.loop.state)
    assert State.HOLD not in states
    assert set(states[GATE:]) == {State.ACTIVE}
    assert float(np.linalg.norm(robot.sent[-1][:3])) > 0.05 * MM


@pytest.mark.parametrize("output", list(Output))
def test_one_telegram_with_a2_wrong_is_held_in_its_cycle(output: Output) -> None:
    """A2 + 20 deg: without the check it moves the correction, with it not at all; 50 good cycles later it goes on."""
    wrong = GATE + 300

    def spoil(cycle: int, q: Float) -> None:
        if cycle == wrong:
            q[1] += 20.0 * DEG

    robot, blind = _Robot(spoil), _Robot(spoil)
    run, believing = session(robot, output=output), session(blind, checked=False, output=output)
    for _ in range(wrong):
        run.cycle(0.0)
        believing.cycle(0.0)
    assert run.loop.state == believing.loop.state == State.ACTIVE
    run.cycle(0.0)
    believing.cycle(0.0)
    assert believing.loop.state == State.ACTIVE
    assert (run.loop.state, run.loop.cause) == (State.HOLD, Cause.AXIS_ANGLES)
    assert robot.held[-1]
    assert not robot.held[-2]
    still = float(np.linalg.norm(robot.sent[-1][:3] - robot.sent[-2][:3]))
    assert still < 0.5e-6
    if output == Output.AXES:
        seen = robot.axes[-1] - robot.axes[-2]
        assert float(np.abs(seen).max()) < 1e-6
        assert float(np.abs(blind.axes[-1] - blind.axes[-2]).max()) > 1e-5
    for _ in range(60):
        run.cycle(0.0)
    assert run.loop.state == State.ACTIVE


def test_angles_that_stay_wrong_end_the_correction() -> None:
    """An axis whose sign turns on the way: held; the robot goes on although it is to hold, so it is told to stop."""

    def spoil(cycle: int, q: Float) -> None:
        if cycle >= GATE + 200:
            q[3] *= -1.0

    robot = _Robot(spoil)
    run = session(robot)
    states, largest = [], 0.0
    for k in range(CYCLES):
        run.cycle(0.0)
        states.append(run.loop.state)
        if k > GATE + 200:
            largest = max(largest, float(np.linalg.norm(robot.sent[-1][:3] - robot.sent[GATE + 200][:3])))
    assert states[GATE + 199] == State.ACTIVE
    assert states[GATE + 200] == State.HOLD
    assert State.ACTIVE not in states[GATE + 200 :]
    assert states[-1] == State.FAULT
    assert largest < 1e-6


def test_a_wrong_base_keeps_it_from_being_armed() -> None:
    """30 mm beside the cell's: said, and not armed."""
    robot = _Robot(nothing)
    robot.base = pose.make(p=np.array([30.0, 0.0, 0.0]) * MM)
    run = session(robot)
    for _ in range(GATE):
        run.cycle(0.0)
    assert run.loop.state <= State.READY
    assert run.loop.cause == Cause.FRAME_OFFSET
