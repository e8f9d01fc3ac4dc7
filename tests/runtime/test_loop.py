"""The online step: signs, sizes, projections, blending, learning, limits, faults, and the same result every time."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import counterflex
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.records import records
from counterflex.core.units import MM, UM
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.geometry import pose, rotation
from counterflex.robot.elasticity.chain import forward, jacobian
from counterflex.robot.elasticity.compliance import deflection
from counterflex.runtime.cycle_inputs import CycleInputs
from counterflex.runtime.loop import Loop
from counterflex.runtime.loop_plan import LoopPlan
from counterflex.runtime.plausibility.kernel import DOUBT_IDLE
from counterflex.runtime.settings import Delays, ForceMode, OnlineSettings, Pilot, TrackerMode
from counterflex.runtime.state.chosen import SETTINGS
from counterflex.runtime.state.cycle import CYCLE
from counterflex.runtime.state.memory import STATE
from counterflex.runtime.state.result import RESULT
from counterflex.runtime.state.supervisor import Cause, State
from counterflex.runtime.step.limit import limit
from counterflex.signals.limiter import MotionLimit

CELL: Cell = read_cell(Path(counterflex.__file__).parent / "app" / "demo" / "cell.toml")
Q = np.radians([0.0, -90.0, 120.0, 0.0, 30.0, 0.0])
R = rotation.about_x(np.pi)
FEED = 0.025
WIDE: dict[str, Any] = {"translation": MotionLimit(4.0 * MM, 0.2, 50.0), "hard_factor": 2.0}


def straight(force: tuple[float, float, float] = (0.0, 0.0, 0.0), begin: float = 0.03, end: float = 0.17) -> LoopPlan:
    """A path along part x with a force between two places."""
    x = np.linspace(0.0, 0.2, 801)
    p = np.stack([x, np.zeros_like(x), np.zeros_like(x)], axis=1)
    cutting = ((x > begin) & (x < end)).astype(np.float64)
    w = np.zeros((len(x), 6))
    w[:, :3] = np.array(force) * cutting[:, None]
    return LoopPlan(p, x / FEED, w, cutting, np.zeros((len(x), 6)))


def armed(plan: LoopPlan | None, chosen: OnlineSettings) -> Loop:
    loop = Loop(CELL.chain, chosen, CELL.T_base_part, plan)
    start = pose.make(R, np.zeros(3))
    for arm, enable in ((False, False), (True, False), (False, True)):
        loop.feed(CycleInputs(T_part_tcp=start, q=Q, arm=arm, enable=enable))
        loop.run()
    assert loop.state == State.ACTIVE
    return loop


def mill(loop: Loop, x: float, w: Float | None = None, **inputs: Any) -> Float:
    given = np.zeros(6) if w is None else w
    loop.feed(
        CycleInputs(T_part_tcp=pose.make(R, np.array([x, 0.0, 0.0])), q=Q, w_tcp_part=given, enable=True, **inputs)
    )
    loop.run()
    return loop.correction.copy()


def six(force: tuple[float, float, float]) -> Float:
    return np.array([*force, 0.0, 0.0, 0.0])


def part_deflection(w_part: Float) -> Float:
    R_base_part = CELL.T_base_part[:3, :3]
    w_base = np.concatenate([R_base_part @ w_part[:3], R_base_part @ w_part[3:]])
    out: Float = R_base_part.T @ deflection(CELL.chain, Q, w_base)[:3]
    return out


def test_a_steady_force_is_undone_across_the_feed_and_not_along_it() -> None:
    w = six((-150.0, 400.0, -80.0))
    loop = armed(straight(), OnlineSettings(force=ForceMode.MEASURED, **WIDE))
    for k in range(400):
        found = mill(loop, 0.05 + 1e-4 * k, w)
    expected = -part_deflection(w)
    assert found[0] == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(found[1:3], expected[1:], rtol=1e-9)


@pytest.mark.parametrize("turns", [(0.6, -0.4), (-1.1, 0.9), (0.3, 2.5)])
def test_a_part_that_stands_askew_about_two_axes_is_corrected_in_its_own_frame(turns: tuple[float, float]) -> None:
    """``c = -R^T C R w`` with a rotation that is not its own transpose, for force, correction and axis angles."""
    w = six((-150.0, 400.0, -80.0))
    T_base_part = pose.make(rotation.about_z(turns[0]) @ rotation.about_x(turns[1]), CELL.T_base_part[:3, 3])
    R_base_part = T_base_part[:3, :3]
    loop = Loop(CELL.chain, OnlineSettings(force=ForceMode.MEASURED, **WIDE), T_base_part, straight())
    for arm, enable in ((False, False), (True, False), (False, True)):
        loop.feed(CycleInputs(T_part_tcp=pose.make(R, np.zeros(3)), q=Q, arm=arm, enable=enable))
        loop.run()
    for k in range(400):
        found = mill(loop, 0.05 + 1e-4 * k, w)
    w_base = np.concatenate([R_base_part @ w[:3], R_base_part @ w[3:]])
    expected = -R_base_part.T @ deflection(CELL.chain, Q, w_base)[:3]
    assert np.linalg.norm(expected[1:]) > 50 * UM
    np.testing.assert_allclose(found[1:3], expected[1:], rtol=1e-9)
    moved = R_base_part.T @ (jacobian(CELL.chain, Q) @ loop.axes)[:3]
    np.testing.assert_allclose(moved, found[:3], atol=1e-9)


@pytest.mark.parametrize("turns", [(0.6, -0.4), (0.3, 2.5)])
def test_a_turned_correction_is_turned_into_axis_angles_of_a_part_askew(turns: tuple[float, float]) -> None:
    """``J(q) dq = (R c, R phi)``: orientation takes the part's axes to the base as translation does."""
    T_base_part = pose.make(rotation.about_z(turns[0]) @ rotation.about_x(turns[1]), CELL.T_base_part[:3, 3])
    both = np.kron(np.eye(2), T_base_part[:3, :3])
    chosen = OnlineSettings(force=ForceMode.MEASURED, orientation=True, **WIDE)
    loop = Loop(CELL.chain, chosen, T_base_part, straight())
    for arm, enable in ((False, False), (True, False), (False, True)):
        loop.feed(CycleInputs(T_part_tcp=pose.make(R, np.zeros(3)), q=Q, arm=arm, enable=enable))
        loop.run()
    for k in range(400):
        found = mill(loop, 0.05 + 1e-4 * k, six((-150.0, 400.0, -80.0)))
    assert np.linalg.norm(found[3:]) > 1e-4
    moved = both.T @ jacobian(CELL.chain, Q) @ loop.axes
    np.testing.assert_allclose(moved, found, atol=1e-9)


def test_what_was_held_fades_at_the_ramp_of_its_own_kind() -> None:
    """Translation and rotation have ramps of their own; neither takes that of the other."""
    settings, state, cycle, result = (records(kind)[0] for kind in (SETTINGS, STATE, CYCLE, RESULT))
    settings.period = 4e-3
    settings.translation[:] = settings.rotation[:] = 1.0, 1e3, 1e6
    settings.ramp[:] = 1.0, 5e-3, 1.0
    settings.ramp_rotation[:] = 1.0, 40e-3, 1.0
    state.correction[:] = 1e-3, 0.0, 0.0, 0.0, 4e-3, 0.0
    state.supervisor.state, cycle.elapsed = State.ACTIVE, 1
    sizes = []
    for k in range(10):
        cycle.held = int(k == 0)
        limit(1.0, settings, state, cycle, result)
        held = state.bumpless
        sizes.append((np.linalg.norm(held[:3]), np.linalg.norm(held[3:])))
    fall = -np.diff(np.array([(1e-3, 4e-3), *sizes]), axis=0)
    np.testing.assert_allclose(fall[:, 0], 5e-3 * 4e-3, rtol=1e-9)
    np.testing.assert_allclose(fall[:, 1], 40e-3 * 4e-3, rtol=1e-9)


def test_correction_as_axis_angles_moves_the_tool_alike() -> None:
    loop = armed(straight(), OnlineSettings(force=ForceMode.MEASURED, **WIDE))
    for k in range(300):
        found = mill(loop, 0.05 + 1e-4 * k, six((0.0, 300.0, 0.0)))
    moved = CELL.T_base_part[:3, :3].T @ (jacobian(CELL.chain, Q) @ loop.axes)[:3]
    np.testing.assert_allclose(moved, found[:3], atol=1e-9)
    shifted = (forward(CELL.chain, Q + loop.axes) - forward(CELL.chain, Q))[:3, 3]
    np.testing.assert_allclose(CELL.T_base_part[:3, :3].T @ shifted, found[:3], atol=2e-6)


@pytest.mark.parametrize("mode", [ForceMode.PILOT, ForceMode.SCALE])
def test_with_the_plan_the_correction_is_gone_when_the_force_is(mode: ForceMode) -> None:
    """Pairs: at the exit the measured force alone comes late by its filters, the plan does not."""
    plan = straight((0.0, 400.0, 0.0))
    lead = 0.1
    late, ahead = (
        armed(plan, OnlineSettings(force=m, pilot=Pilot(lead_s=lead), **WIDE)) for m in (ForceMode.MEASURED, mode)
    )
    step = FEED * 4e-3
    for k in range(int(0.17 / step) + 3):
        x = k * step
        w = six((0.0, 400.0 if 0.03 < x < 0.17 else 0.0, 0.0))
        a, b = mill(late, x, w), mill(ahead, x, w)
    full = abs(part_deflection(six((0.0, 400.0, 0.0)))[1])
    assert abs(a[1]) > 0.8 * full
    assert abs(b[1]) < 0.2 * full


def test_pilot_control_brings_a_late_force_forward_pair() -> None:
    """A force that rises over half a second, as planned: the published form lags behind it, the other does not."""
    plan = straight((0.0, 400.0, 0.0))
    rise = np.clip((plan.time_s - 1.2) / 0.5, 0.0, 1.0) * np.clip((6.8 - plan.time_s) / 0.5, 0.0, 1.0)
    w = six((0.0, 400.0, 0.0)) * rise[:, None]
    plan = replace(plan, w_tcp_part=w)
    published = armed(plan, OnlineSettings(pilot=Pilot(lead_s=0.0), **WIDE))
    brought = armed(replace(plan, w_ahead_part=w), OnlineSettings(pilot=Pilot(lead_s=None), **WIDE))
    late, off = [], []
    for k in range(1500):
        x = k * FEED * 4e-3
        now = np.array([np.interp(x / FEED, plan.time_s, c) for c in w.T])
        wanted = -part_deflection(now)[1]
        late.append(mill(published, x, now)[1] - wanted)
        off.append(mill(brought, x, now)[1] - wanted)
    assert np.max(np.abs(late)) > 0.05 * abs(part_deflection(six((0.0, 400.0, 0.0)))[1])
    assert np.max(np.abs(off)) < 0.2 * np.max(np.abs(late))


@pytest.mark.parametrize("left", [0.0, 0.3])
def test_a_program_that_an_operator_slows_before_an_exit_is_not_corrected_the_other_way(left: float) -> None:
    """The command ahead of time has ended, the measured force falls: nothing is taken off a force that is not there."""
    plan = straight((0.0, 400.0, 0.0))
    w_ahead = np.stack([np.interp(plan.time_s + 0.1, plan.time_s, c) for c in plan.w_tcp_part.T], axis=1)
    loop = armed(replace(plan, w_ahead_part=w_ahead), OnlineSettings(pilot=Pilot(lead_s=None), **WIDE))
    step = FEED * 4e-3
    places = np.arange(0.0, 0.169, step)
    for x in places:
        mill(loop, x, six((0.0, 400.0 if x > 0.03 else 0.0, 0.0)))
    for k in range(300):
        mill(loop, places[-1] + 0.1 * step * min(k, 5), six((0.0, 400.0 * left, 0.0)))
        assert loop.result.wrench[1] > min(0.0, loop.result.measured[1]) - 1e-6


def test_a_drifting_zero_is_seen_in_air_with_a_shaped_plan() -> None:
    """What is commanded ahead of time never fades to nothing; what tells air from cut is the plan's force."""
    plan = straight((0.0, 400.0, 0.0), begin=0.15)
    w_ahead = plan.w_tcp_part + 1e-9
    loop = armed(replace(plan, w_ahead_part=w_ahead), OnlineSettings(pilot=Pilot(lead_s=None), **WIDE))
    for k in range(1000):
        mill(loop, 1e-4 * k, six((0.0, 60.0, 0.0)))
        if loop.result.doubt & DOUBT_IDLE:
            return
    raise AssertionError("60 N in air are not doubted")


def test_pilot_control_lets_the_force_contradict_the_plan() -> None:
    """A quarter more force than planned is undone as a whole where it stays."""
    plan = straight((0.0, 400.0, 0.0))
    loop = armed(replace(plan, w_ahead_part=plan.w_tcp_part), OnlineSettings(pilot=Pilot(lead_s=None), **WIDE))
    for k in range(1000):
        x = k * FEED * 4e-3
        found = mill(loop, x, six((0.0, 500.0 if x > 0.03 else 0.0, 0.0)))
    np.testing.assert_allclose(found[1], -part_deflection(six((0.0, 500.0, 0.0)))[1], rtol=1e-3)


def test_the_factor_of_the_force_is_learnt_and_applied_ahead() -> None:
    loop = armed(straight((-100.0, 300.0, -50.0)), OnlineSettings(force=ForceMode.SCALE, **WIDE))
    rng = np.random.default_rng(1)
    for k in range(1200):
        x = 1e-4 * k
        w = six((-130.0, 360.0, -50.0)) if 0.03 < x < 0.17 else np.zeros(6)
        w[:3] += 5.0 * rng.standard_normal(3)
        found = mill(loop, x, w)
    np.testing.assert_allclose(loop.scale, [1.3, 1.2, 1.0], atol=0.06)
    np.testing.assert_allclose(found[1], -part_deflection(six((-130.0, 360.0, -50.0)))[1], rtol=0.05)


@pytest.mark.parametrize("mode", [ForceMode.SCALE, ForceMode.FUSED])
def test_a_pause_in_the_cut_teaches_nothing(mode: ForceMode) -> None:
    """A program that stands leaves no force; when it goes on the correction must be what it was before."""
    w = six((0.0, 300.0, 0.0))
    loop = armed(straight((0.0, 300.0, 0.0)), OnlineSettings(force=mode, **WIDE))
    for k in range(300):
        before = mill(loop, 0.04 + 1e-4 * k, w)
    factor = loop.scale
    for k in range(1500):
        mill(loop, 0.07, w if k < 20 else None)
    for k in range(20):
        mill(loop, 0.07 + 1e-4 * k, None if k < 15 else w)
    np.testing.assert_allclose(loop.scale, factor, atol=0.02)
    for k in range(20, 40):
        after = mill(loop, 0.07 + 1e-4 * k, w)
    np.testing.assert_allclose(after, before, atol=0.02 * float(np.linalg.norm(before)))


def test_what_the_program_already_contains_is_not_corrected_again() -> None:
    plan = straight((0.0, 300.0, 0.0))
    bent = part_deflection(six((0.0, 300.0, 0.0)))
    contained = np.zeros((len(plan.p_part), 6))
    contained[:, :3] = -bent * plan.cutting[:, None]
    plan = replace(plan, p_part=plan.p_part + contained[:, :3], contained=contained)
    loop = armed(plan, OnlineSettings(force=ForceMode.SCALE, compensated=True, **WIDE))
    for k in range(1200):
        x = 1e-4 * k
        inside = 0.03 < x < 0.17
        p = np.array([x, *(-bent[1:] if inside else (0.0, 0.0))])
        loop.feed(CycleInputs(T_part_tcp=pose.make(R, p), q=Q, w_tcp_part=six((0.0, 360.0 * inside, 0.0)), enable=True))
        loop.run()
    assert loop.correction[1] == pytest.approx(-0.2 * bent[1], rel=0.05)


@pytest.mark.parametrize(("name", "place"), [("nominal", 0), ("nominal", 9), ("q", 2)])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_commanded_pose_that_is_not_finite_is_a_fault_in_the_same_cycle(name: str, place: int, bad: float) -> None:
    loop = armed(straight((0.0, 300.0, 0.0)), OnlineSettings(**WIDE))
    for k in range(300):
        before = mill(loop, 0.04 + 1e-4 * k, six((0.0, 300.0, 0.0)))
    loop.given[name][place] = bad
    loop.run()
    assert loop.state == State.FAULT
    assert loop.cause == Cause.NOT_FINITE
    assert loop.result.stop == 1
    assert np.all(np.isfinite(loop.correction))
    assert np.linalg.norm(loop.correction[:3] - before[:3]) < 0.2**2 / (2 * 50.0) + 0.2 * 4e-3
    mill(loop, 0.08, np.zeros(6))
    assert loop.state == State.FAULT


def test_a_stale_force_holds_and_goes_on_when_it_is_back() -> None:
    loop = armed(straight((0.0, 300.0, 0.0)), OnlineSettings(force=ForceMode.MEASURED, **WIDE))
    w = six((0.0, 300.0, 0.0))
    for k in range(400):
        steady = mill(loop, 0.04 + 1e-4 * k, w)
    for age in range(1, 6):
        held = mill(loop, 0.08, w, force_age=age)
        assert loop.state == (State.HOLD if age >= 3 else State.ACTIVE)
    assert loop.result.feed_hold == 1
    np.testing.assert_allclose(held, steady, atol=2e-6)
    for _ in range(60):
        mill(loop, 0.08, w)
    assert loop.state == State.ACTIVE


def test_after_a_hold_the_correction_goes_on_where_it_stood_and_ramps_to_what_is_wanted() -> None:
    """The force is gone while the feed is held; no step when it goes on, and all of the correction in the end."""
    chosen = OnlineSettings(force=ForceMode.MEASURED, **WIDE)
    loop = armed(straight((0.0, 300.0, 0.0)), chosen)
    w = six((0.0, 300.0, 0.0))
    for k in range(400):
        steady = mill(loop, 0.04 + 1e-4 * k, w)
    for age in range(1, 20):
        held = mill(loop, 0.08, np.zeros(6), force_age=age)
    assert loop.state == State.HOLD
    fastest, before = 0.0, held
    for _ in range(150):  # good again, the robot stands still, no force
        now = mill(loop, 0.08, np.zeros(6))
        fastest, before = max(fastest, float(np.linalg.norm(now - before))), now
    assert loop.result.state == State.ACTIVE
    assert fastest <= chosen.ramp_m_s * chosen.period_s * 1.01
    assert np.linalg.norm(now[:3]) < np.linalg.norm(held[:3])
    for k in range(300):
        again = mill(loop, 0.08 + 1e-4 * k, w)
    np.testing.assert_allclose(again[:3], steady[:3], atol=3e-6)


def test_lost_telegrams_hold_then_stop() -> None:
    loop = armed(straight(), OnlineSettings(**WIDE))
    states = []
    for _ in range(11):
        mill(loop, 0.04, None, elapsed=0)
        states.append(loop.state)
    assert states[1] == State.ACTIVE
    assert states[2] == State.HOLD
    assert states[9] == State.FAULT
    assert loop.cause in (Cause.TELEGRAMS_LATE, Cause.TELEGRAMS_STOPPED)


def test_too_much_is_held_and_far_too_much_is_a_fault() -> None:
    limits = OnlineSettings(force=ForceMode.MEASURED, translation=MotionLimit(0.5 * MM, 0.2, 50.0), hard_factor=1.5)
    size = abs(part_deflection(six((0.0, 100.0, 0.0)))[1])
    for newton, state in ((100.0 * 0.6 * MM / size, State.HOLD), (100.0 * 1.0 * MM / size, State.FAULT)):
        loop = armed(straight(), limits)
        seen = set()
        for _ in range(150):
            correction = mill(loop, 0.05, six((0.0, newton, 0.0)))
            seen.add(loop.state)
            assert np.linalg.norm(correction[:3]) <= 0.5 * MM * (1 + 1e-9)
        assert state in seen


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000))
def test_the_same_inputs_give_the_same_outputs_and_every_limit_holds(seed: int) -> None:
    """Random forces, losses, stops and stale sensors; two loops, bit for bit."""
    chosen = OnlineSettings(force=ForceMode.PILOT)
    one, two = (armed(straight((0.0, 300.0, 0.0)), chosen) for _ in range(2))
    rng = np.random.default_rng(seed)
    last, speed, limit = np.zeros(3), np.zeros(3), chosen.translation
    for k in range(300):
        inputs: dict[str, Any] = {
            "elapsed": int(rng.choice([0, 1, 1, 1, 1, 2])),
            "force_age": int(rng.choice([0, 0, 0, 1, 4])),
            "stop": bool(rng.random() < 0.01),
            "arm": bool(rng.random() < 0.1),
        }
        w = np.concatenate([400.0 * rng.standard_normal(3), np.zeros(3)])
        a, b = (mill(loop, 1e-4 * k, w, **inputs) for loop in (one, two))
        np.testing.assert_array_equal(a, b)
        assert one.state == two.state
        steps = int(inputs["elapsed"])
        if steps == 0:  # nobody asked: nothing moves, and nothing is learnt of the speed
            np.testing.assert_array_equal(a[:3], last)
            continue
        v = (a[:3] - last) / (steps * chosen.period_s)
        assert np.linalg.norm(a[:3]) <= limit.radius * (1 + 1e-9)
        assert np.linalg.norm(v) <= limit.speed * (1 + 1e-9)
        assert np.linalg.norm(v - speed) <= 2 * limit.acceleration * chosen.period_s * steps * (1 + 1e-6)
        last, speed = a[:3], v


class DelayedRobot:
    """Answers a correction with dead time and a second-order lag; a constant error on top."""

    def __init__(self, delays: Delays, error: Float) -> None:
        self.queue = [np.zeros(3)] * (round(delays.dead_s / 4e-3) + 1)
        self.x, self.v, self.error = np.zeros(3), np.zeros(3), error
        self.w, self.zeta = delays.natural_per_s, delays.damping

    def __call__(self, correction: Float) -> Float:
        self.queue = [*self.queue[1:], correction[:3].copy()]
        for _ in range(8):
            a = self.w**2 * (self.queue[0] - self.x) - 2 * self.zeta * self.w * self.v
            self.v = self.v + 0.5e-3 * a
            self.x = self.x + 0.5e-3 * self.v
        out: Float = self.x + self.error
        return out


def settle(mode: TrackerMode, cycles: int) -> Float:
    delays = Delays()
    chosen = OnlineSettings(force=ForceMode.NONE, tracker=mode, delays=replace(delays, tracker_s=0.0), **WIDE)
    loop = armed(straight(), chosen)
    robot, history = DelayedRobot(delays, np.array([0.0, 300.0 * UM, -200.0 * UM])), []
    for k in range(cycles):
        x = 0.02 + 1e-5 * k
        deviation = robot(loop.correction)
        actual = pose.make(R, np.array([x, 0.0, 0.0]) + deviation)
        mill(loop, x, None, T_part_actual=actual)
        history.append(deviation)
    out: Float = np.linalg.norm(np.array(history), axis=1)
    return out


def test_tracker_both_ways_take_a_constant_error_out_and_the_observer_sooner() -> None:
    integrator, observer = settle(TrackerMode.INTEGRATOR, 1500), settle(TrackerMode.OBSERVER, 1500)
    start = np.hypot(300.0, 200.0) * UM
    assert integrator[-1] < 0.02 * start
    assert observer[-1] < 0.02 * start
    soon = [int(np.argmax(h < 0.1 * start)) for h in (integrator, observer)]
    assert soon[1] < 0.6 * soon[0]
    assert np.max(observer[soon[1] :]) < 0.15 * start


def test_the_observer_leaves_alone_what_the_force_explains() -> None:
    """Robot and model agree: the tracker shows what the force has told, and the correction is not doubled."""
    w, delays = six((-150.0, 400.0, -80.0)), replace(Delays(), tracker_s=0.0)
    chosen = OnlineSettings(force=ForceMode.MEASURED, tracker=TrackerMode.OBSERVER, delays=delays, **WIDE)
    loop, robot = armed(straight(), chosen), DelayedRobot(delays, part_deflection(w))
    for k in range(200):  # fewer than the loop remembers
        nominal = np.array([0.05 + 1e-5 * k, 0.0, 0.0])
        mill(loop, float(nominal[0]), w, T_part_actual=pose.make(R, nominal + robot(loop.correction)))
    np.testing.assert_allclose(loop.correction[1:3], -part_deflection(w)[1:], rtol=0.05)


def test_settings_that_need_a_plan_say_so() -> None:
    with pytest.raises(InputError, match="needs a plan"):
        Loop(CELL.chain, OnlineSettings(force=ForceMode.PILOT), CELL.T_base_part)
    with pytest.raises(InputError, match="feed direction"):
        Loop(CELL.chain, OnlineSettings(force=ForceMode.MEASURED), CELL.T_base_part)
    with pytest.raises(InputError, match="nothing to correct"):
        OnlineSettings(force=ForceMode.NONE)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_measured_force_that_is_no_number_holds_and_is_not_used(bad: float) -> None:
    """R14: measured rubbish holds in the same cycle, and nothing of it stays in the filters."""
    loop = armed(straight((0.0, 300.0, 0.0)), OnlineSettings(force=ForceMode.MEASURED, **WIDE))
    w = six((0.0, 300.0, 0.0))
    for k in range(300):
        steady = mill(loop, 0.04 + 1e-4 * k, w)
    held = mill(loop, 0.07, six((0.0, bad, 0.0)))
    assert (loop.state, loop.cause) == (State.HOLD, Cause.FORCE_INVALID)
    np.testing.assert_allclose(held, steady, atol=2e-6)
    for _ in range(60):
        found = mill(loop, 0.07, w)
    assert loop.state == State.ACTIVE
    np.testing.assert_allclose(found, steady, atol=2e-6)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_measured_pose_that_is_no_number_is_no_sample(bad: float) -> None:
    """R14: the tracker's sum stands still."""
    chosen = OnlineSettings(force=ForceMode.NONE, tracker=TrackerMode.INTEGRATOR, **WIDE)
    loop = armed(straight(), chosen)
    where = pose.make(R, np.array([0.05, 1e-4, 0.0]))
    for _ in range(100):
        before = mill(loop, 0.05, None, T_part_actual=where)
    where[1, 3] = bad
    held = mill(loop, 0.05, None, T_part_actual=where)
    assert (loop.state, loop.cause) == (State.HOLD, Cause.TRACKER_LOST)
    np.testing.assert_allclose(held, before, atol=2e-6)
