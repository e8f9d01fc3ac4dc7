"""The estimator: least squares over all samples at once, late samples, gating, what is left when sensors fail."""

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
from counterflex.core.records import Record, records
from counterflex.core.units import MM, UM
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.geometry import pose, rotation
from counterflex.robot.elasticity.chain import jacobian
from counterflex.robot.elasticity.compliance import deflection
from counterflex.runtime.cycle_inputs import CycleInputs
from counterflex.runtime.estimator import fusion_kernel as fk
from counterflex.runtime.estimator.fusion import FusionTuning, Source, level
from counterflex.runtime.loop import Loop
from counterflex.runtime.loop_plan import LoopPlan
from counterflex.runtime.settings import Delays, ForceMode, OnlineSettings, Pilot, TrackerMode, TrackerTuning
from counterflex.runtime.state.memory import FUSION
from counterflex.runtime.state.supervisor import Cause, State
from counterflex.signals.arrival import ArrivalClock
from counterflex.signals.limiter import MotionLimit

CELL: Cell = read_cell(Path(counterflex.__file__).parent / "app" / "demo" / "cell.toml")
Q = np.radians([0.0, -90.0, 120.0, 0.0, 30.0, 0.0])
R = rotation.about_x(np.pi)
FEED = 0.025
STEP = FEED * 4e-3
FORCE = np.array([-150.0, 400.0, -120.0, 0.0, 0.0, 0.0])
WIDE = MotionLimit(4.0 * MM, 0.2, 50.0)
QUIET = FusionTuning(factor_drift=1e-12, model_drift=1e-12, offset_drift_m=1e-15, turn_drift_rad=1e-15, gate=1e9)


def begun(tuning: FusionTuning) -> Record:
    fusion: Record = records(FUSION)[0]
    tuning.begin(fusion)
    return fusion


def batch(rows: list[tuple[Float, float, float]], tuning: FusionTuning) -> tuple[Float, Float]:
    """Least squares over prior and all scalars at once, by QR: state and covariance."""
    prior = np.repeat([tuning.factor, tuning.model, tuning.offset_m], 3)
    start = np.r_[np.ones(3), np.zeros(6)]
    A = np.vstack([np.diag(1.0 / prior)] + [h[None] / np.sqrt(r) for h, _, r in rows])
    b = np.concatenate([start / prior, [y / np.sqrt(r) for _, y, r in rows]])
    scale = prior
    q, triangle = np.linalg.qr(A * scale)
    x: Float = scale * np.linalg.solve(triangle, q.T @ b)
    inverse = np.linalg.inv(triangle)
    return x, scale[:, None] * (inverse @ inverse.T) * scale


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000))
def test_without_drift_it_is_least_squares_over_all_samples(seed: int) -> None:
    rng = np.random.default_rng(seed)
    fusion, rows = begun(QUIET), []
    for _ in range(40):
        h = rng.standard_normal(9) * np.repeat([300.0, 1.0, 0.0], 3) if rng.random() < 0.5 else np.zeros(9)
        variance = 64.0
        if not h.any():
            h = np.concatenate([np.tile(1e-3 * rng.standard_normal(3), 2), rng.standard_normal(3)])
            variance = (30e-6) ** 2
        y = float(h @ np.r_[1.2, 0.9, 1.0, 0.1, -0.05, 0.0, 1e-4, -2e-4, 5e-5] + np.sqrt(variance) * rng.normal())
        fusion.row[:] = h
        fk.update(fusion, y, variance, 1e9)
        rows.append((h, y, variance))
    x, covariance = batch(rows, QUIET)
    sigma = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(fusion.estimate, x, atol=1e-7 * sigma.max() / sigma.min() * sigma.min())
    found = fusion.covariance
    np.testing.assert_allclose(found / np.outer(sigma, sigma), covariance / np.outer(sigma, sigma), atol=1e-6)


def test_the_covariance_stays_symmetric_and_positive_over_a_million_updates() -> None:
    """Hundred thousand cycles with samples a million times better than the prior."""
    tuning = FusionTuning()
    fusion, growth = begun(tuning), tuning.packed(4e-3)
    rng = np.random.default_rng(3)
    directions = rng.standard_normal((100_000, 9)) * np.repeat([1e3, 1e3, 1.0], 3)
    for row in directions:
        fk.drift(fusion, growth[:3], growth[3:6], growth[6], growth[7])
        fusion.row[:] = row
        fk.update(fusion, 0.0, 1e-12, 5.0)
    found = fusion.covariance
    np.testing.assert_array_equal(found, found.T)
    scale = np.sqrt(np.diag(found))
    assert np.all(scale > 0.0)
    assert np.linalg.eigvalsh(found / np.outer(scale, scale)).min() > 0.0


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000))
def test_the_order_of_samples_does_not_matter_without_drift(seed: int) -> None:
    """A sample that comes late, with the row of its own time, counts as one that came in time."""
    rng = np.random.default_rng(seed)
    rows = [np.concatenate([np.tile(1e-3 * rng.standard_normal(3), 2), rng.standard_normal(3)]) for _ in range(30)]
    values = [float(h @ np.r_[1.1, 0.9, 1.0, 0.1, 0.0, 0.0, 1e-4, 0.0, -1e-4] + 3e-5 * rng.normal()) for h in rows]
    found = []
    for order in (range(30), rng.permutation(30)):
        fusion = begun(QUIET)
        for i in order:
            fusion.row[:] = rows[i]
            fk.update(fusion, values[i], (30e-6) ** 2, 1e9)
        found.append(np.r_[fusion.estimate, fusion.covariance.reshape(-1)])
    scale = np.repeat([0.25, 0.15, 5e-4], 3)
    np.testing.assert_allclose(found[0][:9] / scale, found[1][:9] / scale, atol=1e-7)
    np.testing.assert_allclose(found[0][9:], found[1][9:], atol=1e-6)


def test_a_wild_value_moves_little_and_a_lasting_change_is_followed() -> None:
    tuning = FusionTuning()
    growth = tuning.packed(4e-3)
    frame = np.eye(3).reshape(-1)
    force = np.array([20.0, 8.0, 1e-3, 0.0])

    def feed(fusion: Record, factor: float, cycles: int, gate: float) -> Record:
        w = np.array([0.0, 400.0, 0.0, 0.0, 0.0, 0.0])
        for _ in range(cycles):
            fk.drift(fusion, growth[:3], growth[3:6], growth[6], growth[7])
            fk.take_force(fusion, factor * w, w, w, frame, np.array([8.0, *force[1:]]), 0.0, gate)
        return fusion

    open_, gated = (feed(begun(tuning), 1.0, 500, g) for g in (1e9, 5.0))
    before = gated.estimate[1]
    feed(open_, 20.0, 1, 1e9)
    feed(gated, 20.0, 1, 5.0)
    assert abs(open_.estimate[1] - before) > 0.3
    assert abs(gated.estimate[1] - before) < 0.01
    feed(gated, 1.5, 1000, 5.0)
    assert gated.estimate[1] == pytest.approx(1.5, abs=0.02)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.2, 40.0), st.floats(2.0, 8.0))
def test_a_gated_value_counts_with_the_variance_that_explains_it(seed: int, apart: float, gate: float) -> None:
    """State and covariance are those of a plain update whose noise makes the innovation ``gate`` deviations large."""
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((9, 9)) * np.repeat([0.3, 0.1, 1e-4], 3)
    fusion, P = records(FUSION)[0], A.T @ A
    x, h = (
        rng.standard_normal(9) * np.repeat([1.0, 0.1, 1e-4], 3),
        rng.standard_normal(9) / np.repeat([0.3, 0.1, 1e-4], 3),
    )
    fusion.estimate[:], fusion.covariance[:], fusion.row[:] = x, P, h
    spread, variance = float(h @ P @ h), 2.0
    innovation = apart * np.sqrt(spread + variance)
    assert fk.update(fusion, float(h @ x) + innovation, variance, gate) == pytest.approx(apart)
    taken = max(variance, innovation**2 / gate**2 - spread)
    K = P @ h / (spread + taken)
    joseph = (np.eye(9) - np.outer(K, h)) @ P @ (np.eye(9) - np.outer(K, h)).T + taken * np.outer(K, K)
    scale = np.sqrt(np.diag(P))
    np.testing.assert_allclose((fusion.estimate - x - K * innovation) / scale, 0.0, atol=1e-9 * apart)
    found = fusion.covariance
    np.testing.assert_allclose(found / np.outer(scale, scale), joseph / np.outer(scale, scale), atol=1e-9)


# ---- The loop ----------------------------------------------------------------------------------------------------


def straight(begin: float = 0.03, end: float = 0.17, model: float = 1.0) -> LoopPlan:
    x = np.linspace(0.0, 0.2, 801)
    p = np.stack([x, np.zeros_like(x), np.zeros_like(x)], axis=1)
    cutting = ((x > begin) & (x < end)).astype(np.float64)
    return LoopPlan(p, x / FEED, model * FORCE * cutting[:, None], cutting, np.zeros((len(x), 6)))


def part_deflection(w_part: Float) -> Float:
    R_base_part = CELL.T_base_part[:3, :3]
    w_base = np.concatenate([R_base_part @ w_part[:3], R_base_part @ w_part[3:]])
    out: Float = R_base_part.T @ deflection(CELL.chain, Q, w_base)[:3]
    return out


def chosen(**change: Any) -> OnlineSettings:
    given_: dict[str, Any] = {
        "force": ForceMode.FUSED,
        "pilot": Pilot(lead_s=0.06),
        "delays": Delays(dead_s=16e-3, tracker_s=0.0),
        "translation": WIDE,
        "hard_factor": 2.0,
        "tuning": TrackerTuning(noise_m=30 * UM),
        "fusion": FusionTuning(mode=(8.0, 0.1)),
    }
    return OnlineSettings(**{**given_, **change})


class Bench:
    """A loop and a cell that bends by a factor of the model, answers corrections as the loop thinks, and stands off."""

    def __init__(
        self, plan: LoopPlan | None, options: OnlineSettings, stiff: float = 1.0, off: Float | None = None
    ) -> None:
        self.loop = Loop(CELL.chain, options, CELL.T_base_part, plan)
        self.stiff, self.off = stiff, np.zeros(3) if off is None else off
        self.bend = part_deflection(FORCE)
        self.rng = np.random.default_rng(4)
        self.k = 0
        self.history: list[Float] = []
        self.errors: list[float] = []
        self._sent: list[Float] = [np.zeros(3)] * 4
        self._y = np.zeros((3, 3))
        self._bent = np.zeros((2, 3))
        for arm, enable in ((False, False), (True, False), (False, True)):
            self.cycle(arm=arm, enable=enable)
        assert self.loop.state == State.ACTIVE

    def cycle(
        self,
        factor: float = 1.0,
        *,
        force: bool = True,
        late: int | None = 0,
        every: int = 1,
        has: Source = Source.FORCE | Source.TRACKER,
        wild: Float | None = None,
        said: float | None = None,
        **inputs: Any,
    ) -> None:
        """One cycle at the next place; the tracker's sample is ``late`` cycles old (``said`` s), or there is none."""
        x = STEP * self.k
        cut = 0.03 < x < 0.17
        w = factor * FORCE * cut
        self._bent[0] += 0.35 * (self.stiff * factor * self.bend * cut - self._bent[0])  # an arm takes 20 ms to bend
        self._bent[1] += 0.35 * (self._bent[0] - self._bent[1])
        deviation = self._bent[1] + self._answered() + self.off
        actual = np.array([x, 0.0, 0.0]) + deviation
        self.errors.append(float(np.linalg.norm(deviation[1:])))
        self.history.append(actual + 10e-6 * self.rng.standard_normal(3))
        T_part_actual, when = None, None
        if late is not None and self.k % every == 0 and self.k >= late:
            p = self.history[self.k - late] + (0.0 if wild is None else wild)
            T_part_actual, when = pose.make(R, p), 4e-3 * late if said is None else said
        inputs.setdefault("enable", True)
        inputs.setdefault("force_age", 0 if force else 99)
        inputs.setdefault("tracker_age", 0 if late is not None else 10_000)
        self.loop.feed(
            CycleInputs(
                T_part_tcp=pose.make(R, np.array([x, 0.0, 0.0])),
                q=inputs.pop("q", Q),
                w_tcp_part=w + np.r_[5.0 * self.rng.standard_normal(3), np.zeros(3)] if force else None,
                T_part_actual=T_part_actual,
                tracker_late_s=when,
                sources=has,
                **inputs,
            )
        )
        self.loop.run()
        self._sent.append(self.loop.correction[:3].copy())
        self.k += 1

    def _answered(self) -> Float:
        """Dead time of four cycles and a second-order lag, integrated finely."""
        w, zeta, h = 2.0 * np.pi * 5.0, 0.7, 4e-3 / 40
        target = self._sent[-4]
        for _ in range(40):
            self._y[1] += h * (w * w * (target - self._y[0]) - 2.0 * zeta * w * self._y[1])
            self._y[0] += h * self._y[1]
        out: Float = self._y[0].copy()
        return out


def plateau(bench: Bench) -> float:
    """Largest deviation across the feed in the last quarter second."""
    return max(bench.errors[-60:])


def test_force_and_tracker_together_tell_force_stiffness_and_offset_apart() -> None:
    """Force 20 % above the plan, robot 10 % softer than the model, 0.2 mm off in air."""
    off = np.array([0.0, 0.2e-3, -0.1e-3])
    bench = Bench(straight(), chosen(), stiff=1.1, off=off)
    for _ in range(1300):
        bench.cycle(1.2)
    np.testing.assert_allclose(bench.loop.scale[1:], 1.2, atol=0.03)
    np.testing.assert_allclose(bench.loop.offset[1:3], off[1:], atol=60e-6)
    assert plateau(bench) < 40e-6
    assert bench.loop.sources == Source.PLAN | Source.FORCE | Source.TRACKER


@pytest.mark.parametrize(("late", "every"), [(0, 1), (25, 10), (75, 40)])
def test_slow_and_late_photogrammetry_takes_a_model_error_out(late: int, every: int) -> None:
    """Pairs: 250 Hz and fresh, 25 Hz and 100 ms late, 6 Hz and 300 ms late."""
    bench, without = (Bench(straight(), chosen(), stiff=1.3, off=np.array([0.0, 0.1e-3, 0.0])) for _ in range(2))
    for _ in range(1300):
        bench.cycle(late=late, every=every)
        without.cycle(late=None, has=Source.FORCE)
    assert plateau(without) > 0.25e-3
    assert plateau(bench) < 0.25 * plateau(without)


def test_a_late_sample_that_is_taken_for_a_new_one_swings_up() -> None:
    """The time stamp counts: the same samples, 25 Hz and 200 ms late, with and without their age."""
    found = []
    for said in (None, 0.0):
        bench = Bench(straight(), chosen(), stiff=1.3)
        for _ in range(1650):
            bench.cycle(late=50, every=10, said=said)
        found.append(float(np.sqrt(np.mean(np.square(bench.errors[600:])))))
    assert found[0] < 20e-6
    assert found[1] > 10.0 * found[0]


def test_it_degrades_step_by_step_and_says_so() -> None:
    both = Source.FORCE | Source.TRACKER
    bench = Bench(straight(), chosen(), stiff=1.1, off=np.array([0.0, 0.1e-3, 0.0]))
    for _ in range(600):
        bench.cycle(1.2)
    assert level(bench.loop.sources) == "plan + force + tracker"
    assert bench.loop.result.degraded == 0
    full = plateau(bench)
    for _ in range(200):
        bench.cycle(1.2, late=None)
    assert level(bench.loop.sources) == "plan + force"
    assert bench.loop.result.degraded == Cause.TRACKER_LOST
    assert bench.loop.state == State.ACTIVE
    for _ in range(100):
        bench.cycle(1.2, force=False)
    assert level(bench.loop.sources) == "plan + tracker"
    assert bench.loop.result.degraded == Cause.FORCE_STALE
    for _ in range(200):
        bench.cycle(1.2, force=False, late=None)
    assert level(bench.loop.sources) == "plan"
    assert bench.loop.result.degraded == Cause.FORCE_STALE
    assert bench.loop.state == State.ACTIVE
    assert plateau(bench) < full + 30e-6
    bench.cycle(1.2, has=both)
    assert level(bench.loop.sources) == "plan + force + tracker"


def test_nothing_left_is_a_hold() -> None:
    bench = Bench(None, chosen(normal_only=False))
    for _ in range(500):
        bench.cycle()
    assert level(bench.loop.sources) == "force + tracker"
    for _ in range(60):
        bench.cycle(force=False)
    assert level(bench.loop.sources) == "tracker"
    assert bench.loop.state == State.ACTIVE
    for _ in range(126):
        bench.cycle(force=False, late=None)
    assert level(bench.loop.sources) == "nothing"
    assert State(int(bench.loop.result.state)) == State.HOLD
    assert bench.loop.cause == Cause.FORCE_STALE


@pytest.mark.parametrize("cause", [Cause.FORCE_SATURATED, Cause.FORCE_INVALID, Cause.FORCE_OFFSET])
def test_a_force_sensor_that_lies_is_left_out(cause: Cause) -> None:
    bench = Bench(straight(), chosen())
    for _ in range(500):
        bench.cycle()
    before = bench.loop.scale
    for _ in range(50):
        bench.cycle(5.0, soft=cause, late=None)
    np.testing.assert_array_equal(bench.loop.scale, before)
    assert bench.loop.state == State.ACTIVE
    assert bench.loop.result.degraded == cause


def test_a_tracker_that_shows_another_target_is_not_believed() -> None:
    bench = Bench(straight(), chosen())
    for _ in range(500):
        bench.cycle()
    before = bench.loop.offset
    for _ in range(10):
        bench.cycle(wild=np.array([0.0, 5e-3, 0.0]))
    np.testing.assert_allclose(bench.loop.offset[:3], before[:3], atol=2e-6)  # the force goes on
    assert Source.TRACKER not in bench.loop.sources
    assert bench.loop.result.degraded == Cause.TRACKER_JUMP
    assert bench.loop.result.rejected == 10
    for _ in range(4):  # three in a row where they should be
        bench.cycle()
    assert Source.TRACKER in bench.loop.sources
    assert bench.loop.result.degraded == 0


def test_motor_currents_find_the_factor_where_there_is_no_sensor() -> None:
    """Pairs: axis torques of the force, 25 % above the plan, with their friction as a constant; and without them."""
    jac = jacobian(CELL.chain, Q)
    R_base_part = CELL.T_base_part[:3, :3]
    friction = np.array([200.0, -300.0, 150.0, 20.0, -30.0, 10.0])
    rng = np.random.default_rng(2)
    found = []
    for currents in (True, False):
        bench = Bench(straight(), chosen())
        for _ in range(1200):
            w = 1.25 * FORCE * (0.03 < STEP * bench.k < 0.17)
            w_base = np.concatenate([R_base_part @ w[:3], R_base_part @ w[3:]])
            torque = jac.T @ w_base + friction + 20.0 * rng.standard_normal(6)
            bench.cycle(
                1.25,
                force=False,
                late=None,
                has=Source.CURRENTS if currents else Source.NOTHING,
                torque=torque if currents else None,
                q=Q + 1e-5 * bench.k,
            )
        found.append((abs(bench.loop.scale[1] - 1.25), plateau(bench), bench.loop.sources))
    assert found[0][2] == Source.PLAN | Source.CURRENTS
    assert found[1][2] == Source.PLAN
    assert found[0][0] < 0.1
    assert found[0][1] < 0.5 * found[1][1]


def test_what_the_program_contains_is_not_corrected_again() -> None:
    plan = straight()
    contained = np.zeros((len(plan.p_part), 6))
    contained[:, :3] = -part_deflection(FORCE) * plan.cutting[:, None]
    contained[:, 0] = 0.0
    plan = replace(plan, p_part=plan.p_part + contained[:, :3], contained=contained)
    loop = Loop(CELL.chain, chosen(compensated=True), CELL.T_base_part, plan)
    bent = part_deflection(FORCE)
    for k in range(1000):
        x = STEP * k
        cut = 0.03 < x < 0.17
        p = np.array([x, *(-bent[1:] * cut)])
        actual = p + 1.1 * bent * cut
        loop.feed(
            CycleInputs(
                T_part_tcp=pose.make(R, p),
                q=Q,
                w_tcp_part=FORCE * cut,
                T_part_actual=pose.make(R, actual),
                tracker_late_s=0.0,
            )
        )
        loop.run()
    wanted = loop.result.wanted[:3]
    np.testing.assert_allclose(wanted[1:], -0.1 * bent[1:], atol=15e-6)


def test_gains_per_direction_hold_along_their_direction_only() -> None:
    """A feed along part x: across is part y, along the tool part z."""
    found = {}
    for gains in (1.0, (1.0, 0.5, 1.0), (0.0, 1.0, 0.25)):
        options = chosen(force=ForceMode.MEASURED, proportional=gains, normal_only=False)
        loop = Loop(CELL.chain, options, CELL.T_base_part, straight())
        for k in range(300):
            loop.feed(
                CycleInputs(T_part_tcp=pose.make(R, np.array([0.05 + STEP * k, 0.0, 0.0])), q=Q, w_tcp_part=FORCE)
            )
            loop.run()
        found[gains] = loop.result.wanted[:3].copy()
    np.testing.assert_allclose(found[(1.0, 0.5, 1.0)], found[1.0] * [1.0, 0.5, 1.0], rtol=1e-9)
    np.testing.assert_allclose(found[(0.0, 1.0, 0.25)], found[1.0] * [0.0, 1.0, 0.25], rtol=1e-9, atol=1e-12)


def test_settings_that_contradict_each_other_say_so() -> None:
    with pytest.raises(InputError, match="takes the tracker itself"):
        chosen(tracker=TrackerMode.OBSERVER)
    with pytest.raises(InputError, match="per direction"):
        chosen(proportional=(1.0, 1.0))
    with pytest.raises(InputError, match="gate"):
        FusionTuning(gate=0.0)


def test_age_of_samples_from_stamps_of_another_clock() -> None:
    """Clock 1234 s ahead and 50 ppm fast, samples 20 ms to 320 ms late: the age is right to what the clocks drift."""
    rng = np.random.default_rng(0)
    clock = ArrivalClock(0.020)
    worst = 0.0
    for k in range(3000):
        now = 0.04 * k
        late = 0.020 + (0.3 * rng.random() if k > 5 else 0.0) * (k % 7 != 0)
        stamp = (now - late) * (1.0 + 50e-6) + 1234.0
        age = clock.age(now, stamp)
        worst = max(worst, abs(age - late))
    assert worst < 0.2e-3


def test_a_source_whose_clock_was_set_back_is_taken_anew() -> None:
    clock = ArrivalClock(0.004)
    for k in range(100):
        clock.age(0.1 * k, 0.1 * k)
    ages = [clock.age(10.0 + 0.1 * k, 0.1 * k) for k in range(10)]
    assert ages[0] > 2.0
    assert ages[-1] == pytest.approx(0.004, abs=1e-3)
