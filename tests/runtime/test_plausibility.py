"""Tests during operation (R14, R16 to R19): what is wrong is found in a simulated plant, what is right goes on."""

from __future__ import annotations

import itertools
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import counterflex
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import DEG, MM, UM
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.geometry import pose, rotation
from counterflex.robot.elasticity.compliance import deflection
from counterflex.runtime.cycle_inputs import CycleInputs
from counterflex.runtime.estimator.fusion import FusionTuning
from counterflex.runtime.loop import Loop
from counterflex.runtime.loop_plan import LoopPlan
from counterflex.runtime.plausibility import kernel as pk
from counterflex.runtime.plausibility.limits import Plausibility
from counterflex.runtime.settings import Delays, ForceMode, OnlineSettings, TrackerMode, TrackerTuning
from counterflex.runtime.state.supervisor import Cause, State
from counterflex.signals.limiter import MotionLimit

CELL: Cell = read_cell(Path(counterflex.__file__).parent / "app" / "demo" / "cell.toml")
Q = np.radians([0.0, -90.0, 120.0, 0.0, 30.0, 0.0])
R = rotation.about_x(np.pi)
FEED = 0.025
WIDE = MotionLimit(4.0 * MM, 0.2, 50.0)
ARM = {"translation": WIDE, "hard_factor": 2.0, "fusion": FusionTuning(mode=(8.0, 0.1))}
"""Of an arm that swings."""
SIGNED = [
    np.array(p)
    for rows in itertools.permutations(np.eye(3))
    for p in (np.diag(s) @ np.array(rows) for s in itertools.product((1.0, -1.0), repeat=3))
]
TURNS = [p for p in SIGNED if np.linalg.det(p) > 0.0]
FORCE = np.array([-120.0, 300.0, -90.0])


def straight(force: Float = FORCE, begin: float = 0.03, end: float = 0.17) -> LoopPlan:
    x = np.linspace(0.0, 0.2, 801)
    cutting = ((x > begin) & (x < end)).astype(np.float64)
    w = np.zeros((len(x), 6))
    w[:, :3] = force * cutting[:, None]
    p = np.stack([x, 0.0 * x, 0.0 * x], axis=1)
    return LoopPlan(p, x / FEED, w, cutting, np.zeros((len(x), 6)))


class Plant:
    """A robot on a straight path that answers with dead time and lag, turns the correction by P, and bends.

    Attributes:
        P: (3, 3) what the robot makes of a correction; identity is right.
        T: (3, 3) what the tracker makes of a deviation.
        deviation: (3,) of the tool, m.
    """

    def __init__(
        self, plan: LoopPlan | None, *, P: Float | None = None, T: Float | None = None, **options: Any
    ) -> None:
        self.P, self.T = np.eye(3) if P is None else P, np.eye(3) if T is None else T
        delays = Delays(tracker_s=0.0)
        chosen = OnlineSettings(**{**ARM, "delays": delays, **options})
        self.loop = Loop(CELL.chain, chosen, CELL.T_base_part, plan)
        self.queue = [np.zeros(3)] * (round(delays.dead_s / 4e-3) + 1)
        self.y, self.v = np.zeros(3), np.zeros(3)
        self.w0, self.zeta = delays.natural_per_s, delays.damping
        self.x, self.k, self.deviation = 0.0, 0, np.zeros(3)
        self.rng = np.random.default_rng(3)

    def cycle(
        self,
        load: Float | None = None,
        off: Float | None = None,
        *,
        sensed: Float | None = None,
        seen: bool = True,
        jump: Float | None = None,
        move: bool = True,
        reports: bool = True,
        **inputs: Any,
    ) -> State:
        """One cycle: a force (3,) N acts, ``off`` (3,) m is an error of the robot; ``jump`` one of the tracker."""
        self.x += FEED * 4e-3 * move
        self.queue = [*self.queue[1:], self.P @ self.loop.correction[:3]]
        for _ in range(8):
            self.v = self.v + 0.5e-3 * (self.w0**2 * (self.queue[0] - self.y) - 2.0 * self.zeta * self.w0 * self.v)
            self.y = self.y + 0.5e-3 * self.v
        load = np.zeros(3) if load is None else load
        bent = bending(load)
        self.deviation = self.y + bent + (0.0 if off is None else off)
        nominal = np.array([self.x, 0.0, 0.0])
        force = load if sensed is None else sensed
        tracked = self.loop.settings.tracker != TrackerMode.NONE and seen
        actual = nominal + self.T @ self.deviation + (0.0 if jump is None else jump)
        actual = actual + 5e-6 * self.rng.standard_normal(3)
        inputs.setdefault("enable", self.k > 80)
        inputs.setdefault("arm", self.k == 70)
        inputs.setdefault("tracker_age", 0 if tracked else 5)
        self.loop.feed(
            CycleInputs(
                T_part_tcp=pose.make(R, nominal),
                q=Q,
                w_tcp_part=np.r_[force, np.zeros(3)] + np.r_[2.0 * self.rng.standard_normal(3), np.zeros(3)],
                T_part_actual=pose.make(R, actual) if tracked else None,
                T_part_reported=pose.make(R, nominal + self.y) if reports else None,
                **inputs,
            )
        )
        self.loop.run()
        self.k += 1
        return self.loop.state

    def ready(self, move: bool = True, **inputs: Any) -> Plant:
        """Until the correction acts."""
        for _ in range(90):
            self.cycle(move=move, **inputs)
        assert self.loop.state == State.ACTIVE
        return self


def bending(force: Float) -> Float:
    return np.array(_bending(*force.tolist()))


@lru_cache(maxsize=4096)
def _bending(*force: float) -> tuple[float, ...]:
    """Most cycles bear the force of the cycle before."""
    R_base_part = CELL.T_base_part[:3, :3]
    w = np.concatenate([R_base_part @ np.array(force), np.zeros(3)])
    return tuple((R_base_part.T @ deflection(CELL.chain, Q, w)[:3]).tolist())


def blend_in(k: int, cycles: int) -> float:
    return min(1.0, k / cycles)


def test_there_are_48_signed_permutations_and_24_are_turns() -> None:
    assert len({p.tobytes() for p in SIGNED}) == 48
    assert len(TURNS) == 24


@pytest.mark.parametrize("index", range(48))
def test_a_robot_that_turns_or_mirrors_the_correction_is_found_by_its_own_report(index: int) -> None:
    """R19: every wrong order or sign of axes that changes this correction by more than half is a fault in time.

    What is left alone does little: the part of the correction that goes astray is below the limit itself.
    """
    P = SIGNED[index]
    plant = Plant(straight(), P=P, force=ForceMode.MEASURED).ready()
    found, since = -1, -1
    for k in range(400):
        state = plant.cycle(FORCE * blend_in(k, 50) if plant.x > 0.03 else None)
        c = plant.loop.step_state.in_effect[:3]
        astray = float(np.linalg.norm((P @ c - c)[1:]))
        if since < 0 and np.linalg.norm(c) > 0.1 * MM and astray > 0.1 * MM:
            since = k
        if state == State.FAULT:
            found = k
            break
    c = plant.loop.correction[:3]
    astray = float(np.linalg.norm((P @ c - c)[1:]))
    if found >= 0:
        assert plant.loop.cause == Cause.WRONG_FRAME
        assert (found - since) * 4e-3 <= 0.5
        assert not np.array_equal(P, np.eye(3))
    else:
        assert astray <= 0.51 * np.linalg.norm(c) or astray < 0.1 * MM


def test_a_correction_that_the_robot_leaves_out_is_found() -> None:
    """R19: a correction that has no effect is as wrong as one in another frame."""
    plant = Plant(straight(), force=ForceMode.MEASURED)
    for k in range(500):
        plant.y[:] = plant.v[:] = 0.0
        plant.queue = [np.zeros(3)] * len(plant.queue)
        if plant.cycle(FORCE * blend_in(k - 120, 50) if k > 120 else None) == State.FAULT:
            break
    assert plant.loop.cause == Cause.WRONG_FRAME


def test_a_right_robot_is_left_alone_in_fast_changes() -> None:
    """Steps of the force within one cycle, up and down, and the answer of a robot twice as slow as thought."""
    for slower in (1.0, 0.5):
        plant = Plant(straight(), force=ForceMode.MEASURED).ready()
        plant.w0 *= slower
        for k in range(900):
            plant.cycle(FORCE * (k // 100 % 2) if 0.03 < plant.x < 0.16 else None)
            assert plant.loop.state == State.ACTIVE
        assert np.max(np.abs(plant.y)) > 0.0


@pytest.mark.parametrize(("start_mm", "most_mm"), [(0.12, 0.2), (0.25, 0.22), (0.5, 0.4)])
@pytest.mark.parametrize("reports", [False, True])
def test_a_tracker_loop_of_the_wrong_sign_is_stopped(reports: bool, start_mm: float, most_mm: float) -> None:
    """R19: with and without the controller's report; extra error and time to the fault are bounded."""
    off = np.array([0.0, 0.8, -0.6]) * start_mm * MM
    plant = Plant(straight(), P=-np.eye(3), force=ForceMode.NONE, tracker=TrackerMode.INTEGRATOR).ready(reports=reports)
    least, k = np.inf, 0
    for k in range(1000):
        state = plant.cycle(off=off * blend_in(k + 1, 5), reports=reports)
        size = float(np.linalg.norm(plant.y))
        if size > 0.05 * MM:
            least = min(least, k)
        if state == State.FAULT:
            break
    assert plant.loop.cause in (Cause.DIVERGENCE, Cause.WRONG_FRAME)
    assert (k - least) * 4e-3 <= 0.5
    assert np.linalg.norm(plant.y) <= most_mm * MM


@pytest.mark.parametrize("gain", [0.01, 0.02, 0.03])
@pytest.mark.parametrize("rate_hz", [0.1, 0.2, 0.5, 0.8, 1.5])
def test_an_error_that_swings_under_a_right_sign_is_no_mirror_image(gain: float, rate_hz: float) -> None:
    """The pair to it, where the residual is in quadrature to the correction and moves against it again and again."""
    tuning = TrackerTuning(gain=gain)
    plant = Plant(None, force=ForceMode.NONE, tracker=TrackerMode.INTEGRATOR, tuning=tuning, normal_only=False)
    plant.ready(move=False, reports=False)
    for k in range(600):
        swing = 0.5 * np.sin(2.0 * np.pi * rate_hz * k * 4e-3)
        plant.cycle(off=np.array([0.0, swing, 0.4 * swing]) * MM, move=False, reports=False)
        assert plant.loop.state == State.ACTIVE


@pytest.mark.parametrize("rise", [5, 80, 250])
@pytest.mark.parametrize("gain", [0.01, 0.03])
def test_a_tracker_loop_of_the_right_sign_is_left_alone(rise: int, gain: float) -> None:
    """The pair to it: an error of 0.8 mm that nothing has announced, sudden and slow, is no divergence."""
    tuning = TrackerTuning(gain=gain)
    plant = Plant(straight(), force=ForceMode.NONE, tracker=TrackerMode.INTEGRATOR, tuning=tuning).ready()
    for k in range(900):
        plant.cycle(off=np.array([0.0, 0.8, 0.3]) * MM * blend_in(k, rise))
        assert plant.loop.state == State.ACTIVE
    assert np.linalg.norm(plant.deviation) < 0.02 * MM


def test_the_tracker_must_see_the_tool_where_it_is_before_arming() -> None:
    """R19, frame test: all 24 turns of the tracker's frame and an offset of 3 mm keep the loop from being armed."""
    where = np.array([0.4, 0.7, -0.3])
    for turn in TURNS:
        if np.array_equal(turn, np.eye(3)):
            continue
        plant = Plant(None, force=ForceMode.NONE, tracker=TrackerMode.INTEGRATOR, normal_only=False)
        for k in range(150):
            plant.cycle(move=False, jump=turn @ where - where, arm=k > 70, enable=False)
        assert plant.loop.state <= State.READY
        assert plant.loop.result.doubt & pk.DOUBT_FRAME
    for size, state in ((3.0, State.IDLE), (1.0, State.ARMED)):
        plant = Plant(None, force=ForceMode.NONE, tracker=TrackerMode.INTEGRATOR, normal_only=False)
        for k in range(150):
            plant.cycle(move=False, jump=np.array([0.0, size, 0.0]) * MM, arm=k > 70, enable=False)
        assert (plant.loop.state == State.ARMED) == (state == State.ARMED)


@pytest.mark.parametrize("cycles", [5, 125, 2500])
@pytest.mark.parametrize("jump_mm", [0.0, 1.0])
def test_a_broken_beam_freezes_the_integrator_and_only_the_right_reflector_goes_on(cycles: int, jump_mm: float) -> None:
    """R18: 20 ms, 0.5 s and 10 s; the sum does not move while nothing is seen; back with 1 mm it is not used.

    The pair: without a gap of its own a force keeps the model's part alive, so the loop stays active.
    """
    off = np.array([0.0, 0.2, 0.1]) * MM
    plant = Plant(None, force=ForceMode.MEASURED, tracker=TrackerMode.INTEGRATOR, normal_only=False)
    plant.ready(move=False)
    for _ in range(400):
        plant.cycle(off=off, move=False)
    before = plant.loop.step_state.tracker_integral[:3].copy()
    for _ in range(cycles):
        plant.cycle(off=off, move=False, seen=False)
    np.testing.assert_array_equal(plant.loop.step_state.tracker_integral[:3], before)
    jump = np.array([0.0, 0.0, jump_mm]) * MM
    for _ in range(100):
        plant.cycle(off=off, move=False, jump=jump)
    after = plant.loop.step_state.tracker_integral[:3]
    assert plant.loop.state == State.ACTIVE
    assert (plant.loop.result.doubt & pk.DOUBT_RETURN > 0) == (jump_mm > 0.0)
    if jump_mm:
        np.testing.assert_array_equal(after, before)
    else:
        np.testing.assert_allclose(after, before, atol=10 * UM)


def test_a_tracker_alone_holds_while_its_return_is_doubted() -> None:
    """R18: nothing else to go by."""
    plant = Plant(None, force=ForceMode.NONE, tracker=TrackerMode.INTEGRATOR, normal_only=False).ready(move=False)
    for _ in range(10):
        plant.cycle(move=False, seen=False)
    assert (plant.loop.state, plant.loop.cause) == (State.HOLD, Cause.TRACKER_LOST)
    for _ in range(20):
        plant.cycle(move=False, jump=np.array([0.0, 1.0, 0.0]) * MM)
        assert plant.loop.state in (State.HOLD, State.RAMP_OUT)


@pytest.mark.parametrize("index", range(48))
def test_a_turned_force_sensor_is_found_where_it_turns_the_force_enough(index: int) -> None:
    """R19 without a tracker, by the direction that the plan predicts; what leaves the force about there is not seen."""
    S = SIGNED[index]
    plant = Plant(straight(), force=ForceMode.PILOT).ready()
    angle = float(np.degrees(np.arccos(FORCE @ (S @ FORCE) / (FORCE @ FORCE))))
    for _ in range(370):
        cut = 0.03 < plant.x < 0.17
        if plant.cycle(FORCE if cut else None, sensed=S @ FORCE if cut else None) == State.FAULT:
            break
    if angle > 62.0:
        assert (plant.loop.state, plant.loop.cause) == (State.FAULT, Cause.WRONG_FRAME)
    elif angle < 58.0:
        assert plant.loop.cause != Cause.WRONG_FRAME


def test_a_force_where_the_plan_cuts_air_holds() -> None:
    """R17: the zero has drifted by 20 N since it was checked; 10 N are let pass."""
    for newton, cause in ((10.0, Cause.NONE), (20.0, Cause.FORCE_OFFSET)):
        plant = Plant(straight(begin=0.15), force=ForceMode.PILOT).ready()
        for k in range(300):
            plant.cycle(sensed=np.array([0.0, newton * blend_in(k, 100), 0.0]))
        assert plant.loop.state == (State.ACTIVE if cause == Cause.NONE else State.HOLD) or plant.loop.cause == cause
        assert plant.loop.cause == cause


@pytest.mark.parametrize("mode", [ForceMode.PILOT, ForceMode.SCALE, ForceMode.MEASURED])
def test_a_silent_force_is_bridged_by_the_plan_for_80_ms(mode: ForceMode) -> None:
    """R16: with a plan the prediction goes on, without a step, for 80 ms; where only the measured force counts, not."""
    plant = Plant(straight(), force=mode).ready()
    while plant.x < 0.1:
        plant.cycle(FORCE if plant.x > 0.03 else None)
    held, last = -1, plant.loop.correction.copy()
    for age in range(1, 40):
        state = plant.cycle(FORCE, force_age=age, sensed=np.zeros(3) + FORCE)
        step = np.linalg.norm(plant.loop.correction[:3] - last[:3])
        last = plant.loop.correction.copy()
        assert step < 20 * UM
        if state == State.HOLD:
            held = age
            break
    assert held == (3 if mode == ForceMode.MEASURED else 23)
    assert plant.loop.cause == Cause.FORCE_STALE


def test_limits_that_let_everything_pass_are_refused() -> None:
    """Zero never means unlimited."""
    for change in ({"least_m": 0.0}, {"growth": 0.5}, {"angle_rad": 180.0 * DEG}, {"idle_n": -1.0}):
        with pytest.raises(InputError):
            Plausibility(**change)
