"""Feed override: speeds for a tolerance against a robot of its own, limits of the speed asked for, pairs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import counterflex
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import MM, UM
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.geometry import pose, rotation
from counterflex.robot.elasticity.compliance import deflection
from counterflex.runtime.cycle_inputs import CycleInputs
from counterflex.runtime.loop import Loop
from counterflex.runtime.loop_plan import LoopPlan
from counterflex.runtime.monitoring.override_kernel import falling
from counterflex.runtime.monitoring.override_plan import slowed_time, speed_plan, within_rate
from counterflex.runtime.monitoring.override_settings import OverrideSettings
from counterflex.runtime.settings import ForceMode, OnlineSettings, Pilot
from counterflex.runtime.state.supervisor import State
from counterflex.signals.limiter import MotionLimit
from counterflex.signals.preview import Ahead, Mode, Shaping

CELL: Cell = read_cell(Path(counterflex.__file__).parent / "app" / "demo" / "cell.toml")
Q = np.radians([0.0, -90.0, 120.0, 0.0, 30.0, 0.0])
R = rotation.about_x(np.pi)
FEED, T = 25.0 * MM, 4e-3
EXPONENT = 0.75
ONLINE = OnlineSettings(force=ForceMode.SCALE, translation=MotionLimit(3.0 * MM, 40.0 * MM, 2.5), hard_factor=2.0)
ONLINE = replace(ONLINE, pilot=Pilot(lead_s=ONLINE.delays.correction_s))
WISH = OverrideSettings(tolerance_m=60.0 * UM, least=0.25)


def slot() -> LoopPlan:
    """Along x, with an abrupt exit: the force goes within 2 mm."""
    x = np.arange(0.0, 0.14, 0.25 * MM)
    share = np.clip((x - 0.03) / (8.0 * MM), 0.0, 1.0) * np.clip((0.11 - x) / (2.0 * MM), 0.0, 1.0)
    w = np.zeros((len(x), 6))
    w[:, 1] = 300.0 * share
    return LoopPlan(
        np.stack([x, 0.0 * x, 0.0 * x], axis=1),
        x / FEED,
        w,
        (share > 0.0).astype(float),
        np.zeros((len(x), 6)),
        need_m=-np.array([bend(force) for force in w]),
    )


def bend(w_part: Float) -> Float:
    R_base_part = CELL.T_base_part[:3, :3]
    w_base = np.concatenate([R_base_part @ w_part[:3], R_base_part @ w_part[3:]])
    out: Float = R_base_part.T @ deflection(CELL.chain, Q, w_base)[:3]
    out[0] = 0.0
    return out


class Robot:
    """Dead time and a second-order lag, integrated by itself in steps of 0.5 ms."""

    def __init__(self) -> None:
        delays = ONLINE.delays
        self.queue = [np.zeros(3)] * (round(delays.dead_s / T) + 1)
        self.x, self.v = np.zeros(3), np.zeros(3)
        self.w, self.zeta = delays.natural_per_s, delays.damping

    def __call__(self, correction: Float) -> Float:
        self.queue = [*self.queue[1:], correction.copy()]
        for _ in range(8):
            self.v = self.v + 0.5e-3 * (self.w**2 * (self.queue[0] - self.x) - 2.0 * self.zeta * self.w * self.v)
            self.x = self.x + 0.5e-3 * self.v
        return self.x


def mill(override: OverrideSettings | None, pressing: float = 1.0) -> tuple[float, float, Float]:
    """Mill the slot on a robot that goes as fast as asked: largest error, time, speeds."""
    loop = Loop(CELL.chain, ONLINE, CELL.T_base_part, slot(), override=override)
    start = pose.make(R, np.zeros(3))
    for arm, enable in ((False, False), (True, False), (False, True)):
        loop.feed(CycleInputs(T_part_tcp=start, q=Q, arm=arm, enable=enable))
        loop.run()
    plan, robot = slot(), Robot()
    errors, speeds = [], []
    x = 0.0
    while x < 0.139:
        speed = loop.monitor.speed
        x += FEED * T * speed
        force = np.array([np.interp(x, plan.p_part[:, 0], plan.w_tcp_part[:, k]) for k in range(6)])
        force *= pressing * speed**EXPONENT
        there = bend(force) + robot(loop.correction[:3])
        loop.feed(CycleInputs(T_part_tcp=pose.make(R, np.array([x, 0.0, 0.0])), q=Q, w_tcp_part=force, enable=True))
        loop.run()
        errors.append(np.linalg.norm(there[1:]))
        speeds.append(speed)
    assert loop.state == State.ACTIVE
    return float(max(errors)), len(errors) * T, np.array(speeds)


def test_going_slower_where_the_correction_cannot_follow_pair() -> None:
    plain, time, full = mill(None)
    slowed, longer, speeds = mill(WISH)
    assert np.all(full == 1.0)
    assert slowed < 0.7 * plain
    assert time < longer < 2.0 * time
    assert speeds.min() >= WISH.least
    assert np.abs(np.diff(speeds)).max() <= WISH.change_per_s * T * (1.0 + 1e-9)
    assert speeds[-1] == pytest.approx(1.0)


def test_predicted_errors_are_those_of_the_robot() -> None:
    """The plan's own figure against the robot of this file, at full speed and slowed down."""
    plan = slot()
    found = speed_plan(plan.time_s, plan.need_m, None, replace(ONLINE, timing_s=1e-6), WISH)
    plain, _, _ = mill(None)
    assert found.error_before_m.max() == pytest.approx(plain, rel=0.15)
    assert found.error_after_m.max() < found.error_before_m.max()
    assert found.extra_s > 0.0


def test_where_the_tolerance_holds_nothing_is_slowed() -> None:
    plan = slot()
    found = speed_plan(plan.time_s, plan.need_m, None, ONLINE, replace(WISH, tolerance_m=2.0 * MM))
    np.testing.assert_array_equal(found.speed, 1.0)
    assert found.extra_s == 0.0
    left = np.where((plan.time_s > 2.0) & (plan.time_s < 2.2), 120.0 * UM, 10.0 * UM)
    program = speed_plan(plan.time_s, None, left, ONLINE, WISH)
    inside = left > WISH.tolerance_m
    assert np.all(program.speed[inside] <= 0.55)
    assert program.error_after_m.max() <= WISH.tolerance_m * 1.05
    assert program.speed[0] == program.speed[-1] == 1.0


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.3, 10.0))
def test_speeds_change_within_their_rate_and_never_rise(seed: int, rate: float) -> None:
    rng = np.random.default_rng(seed)
    time = np.cumsum(rng.uniform(0.0, 0.05, 60))
    wished = rng.uniform(0.1, 1.0, 60)
    speed = wished.copy()
    within_rate(time, speed, rate)
    assert np.all(speed <= wished)
    assert speed.min() == wished.min()
    real = np.diff(time) / (0.5 * (speed[1:] + speed[:-1]))
    assert np.all(np.abs(np.diff(speed)) <= rate * real * (1.0 + 1e-9) + 1e-12)


@pytest.mark.parametrize(("value", "expected"), [(0.0, 1.0), (0.8, 1.0), (0.9, 0.65), (1.0, 0.3), (5.0, 0.3)])
def test_speed_falls_towards_a_limit(value: float, expected: float) -> None:
    assert falling(value, 0.8, 0.3) == pytest.approx(expected)


def test_a_force_near_its_limit_slows_down() -> None:
    """The slot presses harder than planned: below an overload, but near it."""
    _, _, calm = mill(replace(WISH, tolerance_m=10.0 * MM))
    _, _, near = mill(replace(WISH, tolerance_m=10.0 * MM), 1.55)
    assert calm.min() == 1.0
    assert near.min() < 0.8


def test_nothing_is_asked_for_while_only_watching() -> None:
    loop = Loop(CELL.chain, ONLINE, CELL.T_base_part, slot(), override=WISH)
    for x in np.arange(0.0, 0.12, FEED * T):
        loop.feed(CycleInputs(T_part_tcp=pose.make(R, np.array([x, 0.0, 0.0])), q=Q, w_tcp_part=np.zeros(6)))
        loop.run()
        assert loop.monitor.speed == 1.0
        assert loop.monitor.outcome.slowed == 0
    assert loop.result.state == State.READY


@pytest.mark.parametrize("bad", [{"least": 0.0}, {"least": 1.5}, {"tolerance_m": 0.0}, {"change_per_s": -1.0}])
def test_settings_that_are_none_are_refused(bad: dict[str, float]) -> None:
    with pytest.raises(InputError, match="override"):
        OverrideSettings(**bad)


def test_what_is_commanded_ahead_is_shaped_for_the_slower_program_pair() -> None:
    """A command shaped for full speed begins too far ahead of a slow tool; shaped again it fits."""
    delays = ONLINE.delays
    modes = (Mode(2.0 * np.pi * 8.5, 0.1), Mode(delays.natural_per_s, delays.damping))
    ahead = Ahead(0.6, modes, Shaping(0.02, delays.dead_s))
    unshaped = slot()
    plan = replace(unshaped, ahead=ahead, w_ahead_part=ahead.command(unshaped.w_tcp_part, unshaped.time_s))
    online = replace(ONLINE, pilot=Pilot(lead_s=None), timing_s=1e-6)
    slowed = plan.at_speeds(online, replace(WISH, tolerance_m=30.0 * UM), EXPONENT)
    assert slowed.speed is not None
    assert slowed.w_ahead_part is not None
    assert plan.w_ahead_part is not None
    assert slowed.speed.min() < 0.8
    when = slowed_time(plan.time_s, slowed.speed)
    force = slowed.speed**EXPONENT
    errors = {}
    for name, w in (("again", slowed.w_ahead_part), ("as it was", plan.w_ahead_part)):
        robot, arm, swung, worst = Robot(), Swing(), Swing(), 0.0
        for t in np.arange(0.0, when[-1], T):
            sent, there = (np.interp(t, when, column * force) for column in (w[:, 1], unshaped.w_tcp_part[:, 1]))
            undone = arm(robot(np.array([sent, 0.0, 0.0]))[0])
            worst = max(worst, abs(0.4 * there + 0.6 * swung(there) - undone))
        errors[name] = worst
    assert errors["again"] < 0.6 * errors["as it was"]


class Swing:
    """An arm's mode, 8.5 Hz with a damping ratio of 0.1, integrated by itself in steps of 0.5 ms."""

    def __init__(self) -> None:
        self.x, self.v, self.w = 0.0, 0.0, 2.0 * np.pi * 8.5

    def __call__(self, force: float) -> float:
        for _ in range(8):
            self.v += 0.5e-3 * (self.w**2 * (force - self.x) - 0.2 * self.w * self.v)
            self.x += 0.5e-3 * self.v
        return self.x


def test_time_at_a_slower_speed_is_that_of_the_integral() -> None:
    time = np.linspace(0.0, 2.0, 401)
    np.testing.assert_allclose(slowed_time(time, np.full(401, 0.5)), 2.0 * time, rtol=1e-12)
    ramp = 1.0 - 0.35 * time
    np.testing.assert_allclose(slowed_time(time, ramp), -np.log(ramp) / 0.35, rtol=1e-4)  # integral dt / s
