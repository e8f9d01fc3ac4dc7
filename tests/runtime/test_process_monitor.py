"""Process monitoring: frames, bounds, rates of false alarms, reactions; the rates are measured, not believed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy import stats

import counterflex
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.records import Record, records
from counterflex.core.units import MM
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.geometry import pose, rotation
from counterflex.runtime.cycle import take_fast
from counterflex.runtime.cycle_inputs import CycleInputs
from counterflex.runtime.loop import Loop
from counterflex.runtime.loop_plan import LoopPlan
from counterflex.runtime.monitoring.events import Event
from counterflex.runtime.monitoring.fast_force import take_samples
from counterflex.runtime.monitoring.monitor_kernel import feed_frame
from counterflex.runtime.monitoring.plan import bounds, lost_tooth
from counterflex.runtime.monitoring.records import MEMORY, RESULTS, SETTINGS, WEAR
from counterflex.runtime.monitoring.settings import MonitorSettings, Reaction, decision_interval, run_length
from counterflex.runtime.monitoring.spindle_lines import folded
from counterflex.runtime.monitoring.wear import add_ratio, normal_of_student, trend
from counterflex.runtime.settings import ForceMode, OnlineSettings
from counterflex.runtime.state.supervisor import Cause, State
from counterflex.signals.limiter import MotionLimit

CELL: Cell = read_cell(Path(counterflex.__file__).parent / "app" / "demo" / "cell.toml")
Q = np.radians([0.0, -90.0, 120.0, 0.0, 30.0, 0.0])
R = rotation.about_x(np.pi)
FEED = 25.0 * MM
unit = st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda v: np.linalg.norm(v) > 0.1)


def frame_of(v: Float, a: Float, memory: Float) -> Float:
    out = np.zeros(9)
    feed_frame(v[0], v[1], v[2], a[0], a[1], a[2], memory, out)
    return out.reshape(3, 3)


@settings(max_examples=200, deadline=None)
@given(st.lists(unit, min_size=1, max_size=6), unit)
def test_feed_frame_is_right_handed_on_any_path(path: list[tuple[float, ...]], axis: tuple[float, ...]) -> None:
    a = np.array(axis) / np.linalg.norm(axis)
    memory = np.zeros(6)
    for step in path:
        v = np.array(step) / np.linalg.norm(step)
        F = frame_of(v, a, memory)
        np.testing.assert_allclose(F @ F.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(F) == pytest.approx(1.0)
        np.testing.assert_allclose(F[0], v, atol=1e-12)
        if np.linalg.norm(np.cross(a, v)) > 0.03:
            assert abs(F[1] @ a) < 1e-12
            assert F[2] @ a > 0.0


def test_feed_frame_goes_on_where_the_tool_plunges() -> None:
    up = np.array([0.0, 0.0, 1.0])
    memory = np.zeros(6)
    level = frame_of(np.array([1.0, 0.0, 0.0]), up, memory)
    np.testing.assert_allclose(level, np.eye(3), atol=1e-15)
    plunge = frame_of(-up, up, memory)
    np.testing.assert_allclose(plunge[1], level[1], atol=1e-12)
    still = frame_of(np.zeros(3), up, memory)
    np.testing.assert_allclose(still, plunge, atol=1e-12)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000))
def test_bounds_enclose_the_force_wherever_the_tool_may_be(seed: int) -> None:
    """A plan read up to 60 ms early or late of its known delay never leaves the bounds."""
    rng = np.random.default_rng(seed)
    time = np.cumsum(rng.uniform(0.001, 0.05, 80))
    force = 300.0 * rng.standard_normal((80, 3)) * (rng.random(80) < 0.7)[:, None]
    late, width = rng.uniform(0.0, 0.1), 0.06
    out = np.empty((80, 3))
    bounds(time, np.cumsum(rng.uniform(0.0, 1e-3, 80)), force, late, width, 0.0, out)
    for shift in rng.uniform(-width, width, 20):
        there = np.stack([np.interp(time - late + shift, time, force[:, k]) for k in range(3)], axis=1)
        size = np.linalg.norm(there, axis=1)
        assert np.all(size <= out[:, 1] * (1.0 + 1e-9))
    dense = np.linspace(time[0], time[-1], 4000)
    rows = np.linalg.norm(force, axis=1)
    for i in range(80):
        near = np.abs(time - (time[i] - late)) <= width
        if near.any():
            assert out[i, 0] <= rows[near].min() * (1.0 + 1e-12)
    assert len(dense) == 4000


def test_a_lost_tooth_leaves_what_the_next_one_takes_over() -> None:
    assert lost_tooth(np.array([2]), 1.0)[0] == pytest.approx(0.0)  # force in proportion to the chip: nothing is lost
    assert lost_tooth(np.array([3]), 0.75)[0] == pytest.approx(1.0 - (1.0 + 2.0**0.75) / 3.0)
    assert lost_tooth(np.array([4]), 0.0)[0] == pytest.approx(0.25)  # force of the edge alone: one of four
    assert lost_tooth(np.array([1, 0]), 0.75).tolist() == [1.0, 1.0]


def test_run_length_against_simulation() -> None:
    """Siegmund's formula against cumulative sums of normal values, with and without a shift."""
    rng = np.random.default_rng(5)
    for interval, shift in ((3.0, 0.0), (4.0, 1.0)):
        lengths = []
        for _ in range(400):
            total, n = 0.0, 0
            while total <= interval:
                total = max(0.0, total + rng.standard_normal() + shift - 0.5)
                n += 1
            lengths.append(n)
        assert np.mean(lengths) == pytest.approx(run_length(interval, shift), rel=0.2)
    for length in (100.0, 5e4):
        assert run_length(decision_interval(length)) == pytest.approx(length, rel=1e-6)


def test_student_values_become_normal_ones() -> None:
    for nu in (2.0, 5.0, 30.0):
        for t in (-3.0, -0.5, 0.0, 1.0, 4.0):
            assert normal_of_student(t, nu) == pytest.approx(stats.norm.ppf(stats.t.cdf(t, nu)), abs=0.03)


def wear_alarms(seed: int, metres: float, rise_per_m: float, interval: float) -> tuple[bool, float, float]:
    """Ratios of two kinds of cut with errors of model and scatter that the detector does not know."""
    rng = np.random.default_rng(seed)
    wear, found = records(WEAR)[0], records(RESULTS)[0]
    alarm = False
    offsets, scatter = rng.uniform(0.8, 1.2, 2), rng.uniform(0.01, 0.04)
    s = 0.0
    while s < metres:
        s += 0.02
        kind = int(rng.random() < 0.5)
        ratio = offsets[kind] * (1.0 + rise_per_m * s) + scatter * rng.standard_normal()
        add_ratio(wear, 3 + kind, s, ratio)
        alarm = alarm or wear.cusum > interval
    trend(wear, s, found)
    return alarm, found.trend, found.trend_sigma


def test_wear_alarms_at_the_stated_rate_and_sees_a_rise() -> None:
    """One false alarm in 10 m stated: of 60 cuts of 2 m about 11 may alarm; with a rise of 15 % per metre all do."""
    interval = decision_interval(10.0 / 0.02)
    false = sum(wear_alarms(seed, 2.0, 0.0, interval)[0] for seed in range(60))
    assert false <= stats.binom.ppf(0.9999, 60, 1.0 - np.exp(-2.0 / 10.0))
    seen = [wear_alarms(seed, 2.0, 0.15, interval) for seed in range(60, 90)]
    assert all(alarm for alarm, _, _ in seen)
    errors = np.array([(slope - 0.15) / sigma for _, slope, sigma in seen])
    assert np.median(np.abs(errors)) < 6.0  # the two kinds rise by different amounts, offset times 15 %


def test_wear_trend_and_its_deviation_are_those_of_least_squares() -> None:
    rng = np.random.default_rng(3)
    s = np.sort(rng.uniform(0.0, 3.0, 40))
    y = 1.1 + 0.07 * s + 0.02 * rng.standard_normal(40)
    wear, found = records(WEAR)[0], records(RESULTS)[0]
    for a, b in zip(s, y, strict=True):
        add_ratio(wear, 2, a, b)
    trend(wear, 3.0, found)
    line = stats.linregress(s, y)
    assert found.trend == pytest.approx(line.slope, rel=1e-9)
    # Neighbours may be alike: never more certain than least squares.
    assert line.stderr <= found.trend_sigma < 1.5 * line.stderr
    assert 10.0 < found.trend_degrees <= 38.0


@pytest.mark.parametrize(("alike", "metres"), [(0.0, 0.4), (0.0, 2.0), (0.8, 0.6), (0.8, 3.0)])
def test_wear_trend_is_as_uncertain_as_it_says(alike: float, metres: float) -> None:
    """Ratios without a trend, neighbours alike: of 300 jobs hardly more than 5 % say one that is none (95 %)."""
    rng = np.random.default_rng(8)
    n, covered, told = round(metres / 0.02), 0, 0
    for _ in range(300):
        x = rng.standard_normal(n)
        for k in range(1, n):
            x[k] = alike * x[k - 1] + np.sqrt(1.0 - alike**2) * x[k]
        wear, found = records(WEAR)[0], records(RESULTS)[0]
        for k in range(n):
            add_ratio(wear, 2, 0.02 * (k + 0.5), 1.0 + 0.03 * x[k])
        trend(wear, metres, found)
        if found.trend_degrees > 0.0:
            told += 1
            covered += abs(found.trend) <= stats.t.ppf(0.975, found.trend_degrees) * found.trend_sigma
    assert told > 30
    assert told - covered <= stats.binom.ppf(0.995, 300, 0.05)


def test_a_few_stretches_of_cut_tell_no_trend() -> None:
    wear, found = records(WEAR)[0], records(RESULTS)
    for k in range(8):
        add_ratio(wear, 2, 0.02 * k, 1.0 + 0.02 * k)
    trend(wear, 0.16, found[0])
    assert found.tobytes() == records(RESULTS).tobytes()


@pytest.mark.parametrize(("turns", "expected"), [(650.0, 350.0), (216.7, 216.7), (1300.0, 300.0), (1000.0, 0.0)])
def test_a_line_above_half_the_rate_folds_back(turns: float, expected: float) -> None:
    assert folded(turns * 1e-3) == pytest.approx(expected * 1e-3, abs=1e-12)
    k = np.arange(2000)
    spectrum = np.abs(np.fft.rfft(np.cos(2.0 * np.pi * turns * 1e-3 * k + 0.3) * np.hanning(2000)))
    assert np.argmax(spectrum) / 2000.0 == pytest.approx(expected * 1e-3, abs=1e-3)


SAMPLING = records(SETTINGS)
SAMPLING[0].sample_period, SAMPLING[0].energy_time = 1e-3, 0.04


def fast(signal: Float, turn: float, teeth: int = 3) -> Record:
    """What the fast samples say at the end of a signal along y."""
    memory, samples = records(MEMORY), np.zeros((4, 6))
    for k in range(len(signal) // 4):
        samples[:, 1] = signal[4 * k : 4 * k + 4]
        take_samples(samples, 4, 4 * k, turn, teeth, SAMPLING, memory)
    out: Record = memory[0].fast
    return out


def test_harmonics_of_the_spindle_are_told_from_what_does_not_turn_with_it() -> None:
    turn = 13_000.0 / 60.0
    k = np.arange(1200) * 1e-3
    of_spindle = 50.0 * np.sin(2.0 * np.pi * turn * k) + 120.0 * np.sin(2.0 * np.pi * 3.0 * turn * k + 1.0)
    quiet = fast(of_spindle + 300.0, turn)
    loud = fast(of_spindle + 300.0 + 60.0 * np.sin(2.0 * np.pi * 180.0 * k), turn)
    assert quiet.ready == quiet.separate == 1.0
    assert quiet.residual < 2.0
    assert quiet.tooth == pytest.approx(120.0, rel=0.1)
    assert quiet.turn == pytest.approx(50.0, rel=0.15)
    assert loud.residual == pytest.approx(60.0 / np.sqrt(2.0), rel=0.25)


def turning(rpm: float, orders: dict[int, float], seconds: float = 2.0) -> Float:
    """Lines of a spindle by their order, sampled at 1 kHz as they are, folded or not."""
    t = np.arange(round(1000.0 * seconds)) * 1e-3
    out: Float = np.zeros(len(t))
    for order, amplitude in orders.items():
        out = out + amplitude * np.sin(2.0 * np.pi * order * rpm / 60.0 * t + 0.7 * order)
    return out


@pytest.mark.parametrize(
    ("rpm", "teeth"), [(10_000, 3), (15_000, 2), (30_000, 1), (7_500, 4), (9_900, 3), (12_000, 5), (14_900, 2)]
)
@pytest.mark.parametrize("slower", [0.0, 0.003, 0.007])
def test_tooth_passing_at_the_edge_of_the_band_leaves_nothing(rpm: int, teeth: int, slower: float) -> None:
    """About 500 Hz at 1 kHz, the spindle as commanded or slower: its lines are followed, and chatter stays."""
    lines = {teeth: 100.0, 2 * teeth: 40.0, 3 * teeth: 15.0} | ({1: 20.0} if teeth > 1 else {})
    quiet = turning(rpm * (1.0 - slower), lines)
    found = fast(quiet, rpm / 60.0, teeth)
    assert found.ready == 1.0
    assert found.residual < 0.25 * 100.0  # 0.4 of the root mean square of such lines counts as theirs
    t = 1e-3 * np.arange(len(quiet))
    loud = [
        fast(quiet + 60.0 * np.sin(2.0 * np.pi * hz * t), rpm / 60.0, teeth).residual
        for hz in (88.0, 117.0, 152.0, 205.0, 271.0, 345.0, 423.0)
    ]
    assert np.median(loud) > 0.7 * 60.0 / np.sqrt(2.0)


@pytest.mark.parametrize(
    ("rpm", "teeth", "separate"),
    [(15_000, 3, 0.0), (12_000, 4, 0.0), (20_000, 3, 0.0), (13_000, 3, 1.0), (10_000, 3, 1.0), (8_000, 4, 1.0)],
)
def test_lines_that_fall_on_the_tooth_passing_are_not_told_apart(rpm: int, teeth: int, separate: float) -> None:
    """15 000 rpm, three teeth: 750 Hz folds to 250 Hz, which is once per turn; 20 000 rpm: it folds to nothing."""
    signal = turning(0.997 * rpm, {teeth: 100.0, 1: 10.0})
    assert fast(signal, rpm / 60.0, teeth).separate == separate


def test_an_unknown_spindle_speed_and_a_slow_sensor_show_no_chatter() -> None:
    assert fast(turning(13_000.0, {3: 100.0}), 0.0).ready == 0.0
    slow = records(SETTINGS)
    slow[0].sample_period, slow[0].energy_time = 10e-3, 0.04
    memory, samples = records(MEMORY), np.zeros((1, 6))
    for k in range(200):
        take_samples(samples, 1, k, 216.7, 3, slow, memory)
    assert memory[0].fast.ready == 0.0


def test_missing_samples_are_waited_out() -> None:
    memory = records(MEMORY)
    samples = np.random.default_rng(0).standard_normal((4, 6))
    for k in range(100):
        take_samples(samples, 4, 4 * k, 216.7, 3, SAMPLING, memory)
    assert memory[0].fast.ready == 1.0
    take_samples(samples, 4, 408, 216.7, 3, SAMPLING, memory)
    assert memory[0].fast.ready == 0.0


def test_samples_that_were_not_kept_are_not_looked_at() -> None:
    """After a pause more samples come than there are rows: the rest enters the mean only."""
    loop = active()
    take_fast(*loop.rows, np.full((512, 6), 3.0), 700, 0)
    assert loop.monitor.fast.samples == 512
    assert np.all(np.isfinite(loop.monitor.columns[0]))


def slot() -> LoopPlan:
    x = np.arange(0.0, 0.16, 0.25 * MM)
    w = np.zeros((len(x), 6))
    cutting = ((x > 0.03) & (x < 0.13)).astype(float)
    w[:, :3] = np.array([-100.0, 300.0, -60.0]) * cutting[:, None]
    n = len(x)
    return LoopPlan(
        np.stack([x, 0.0 * x, 0.0 * x], axis=1),
        x / FEED,
        w,
        cutting,
        np.zeros((n, 6)),
        teeth=np.full(n, 3),
        turn_per_s=np.full(n, 216.7),
    )


def active(reaction: dict[Event, Reaction] | None = None, arm: bool = True, **changes: float) -> Loop:
    chosen = MonitorSettings(**changes)  # type: ignore[arg-type]
    if reaction is not None:
        chosen = replace(chosen, reaction=chosen.reaction | reaction)
    wide = OnlineSettings(force=ForceMode.MEASURED, translation=MotionLimit(6.0 * MM, 0.2, 50.0), hard_factor=3.0)
    loop = Loop(CELL.chain, wide, CELL.T_base_part, slot(), monitor=chosen)
    start = pose.make(R, np.zeros(3))
    for given_arm, enable in ((False, False), (arm, False), (False, True)):
        loop.feed(CycleInputs(T_part_tcp=start, q=Q, arm=given_arm, enable=enable))
        loop.run()
    return loop


def mill(
    loop: Loop, factor: float, until: float, begin: float = 0.0, seed: int = 1, *, obey: bool = False
) -> set[Event]:
    """Go along the slot with the plan's force times a factor, to a feed hold where that is obeyed; the events met."""
    rng = np.random.default_rng(seed)
    plan = slot()
    met: set[Event] = set()
    for x in np.arange(begin, until, FEED * 4e-3):
        w = np.zeros(6)
        for k in range(3):
            w[k] = factor * np.interp(x, plan.p_part[:, 0], plan.w_tcp_part[:, k])
        w[:3] += rng.standard_normal(3)
        loop.feed(CycleInputs(T_part_tcp=pose.make(R, np.array([x, 0.0, 0.0])), q=Q, w_tcp_part=w, enable=True))
        loop.run()
        met |= {e for e in Event if int(loop.monitor.outcome.new) >> e & 1}
        if obey and loop.result.feed_hold:
            break
    return met


def test_force_in_the_feed_frame_is_the_force_and_beside_it_the_predicted_one() -> None:
    loop = active()
    assert mill(loop, 1.0, 0.08) == set()
    found = loop.monitor.results
    np.testing.assert_allclose(found.force, [-100.0, 300.0, -60.0], atol=4.0)
    np.testing.assert_allclose(found.expected, [-100.0, 300.0, -60.0], atol=0.5)
    assert found.ratio == pytest.approx(1.0, abs=0.02)
    assert found.rate == pytest.approx(1.0, abs=1e-3)
    assert found.distance == pytest.approx(0.08, abs=0.2 * MM)


def test_a_sound_cut_and_pairs_of_what_can_go_wrong() -> None:
    assert mill(active(), 1.0, 0.155) == set()
    assert mill(active(), 1.15, 0.155) == set()
    assert mill(active(), 0.02, 0.155) == {Event.MISSING_CUT}
    assert Event.OVERLOAD in mill(active(), 2.0, 0.155)
    assert Event.OVERLOAD in mill(active(force_limit_n=300.0), 1.0, 0.155)


def test_overload_holds_the_feed_until_a_person_resets() -> None:
    loop = active()
    assert loop.state == State.ACTIVE
    assert Event.OVERLOAD in mill(loop, 2.0, 0.06, obey=True)
    held = pose.make(R, loop.given.nominal[9:].copy())
    stopped = 0
    for _ in range(700):  # longer than a hold may last: the correction has gone, the feed is held all the same
        loop.feed(CycleInputs(T_part_tcp=held, q=Q, w_tcp_part=np.zeros(6), enable=True))
        loop.run()
        assert loop.result.feed_hold == 1
        stopped += int(loop.result.stop)
    assert loop.result.state == State.READY
    assert stopped == loop.settings.supervisor.stop  # and the program is told to stop once the correction has gone
    assert loop.result.feed_hold == 1
    assert loop.result.soft == Cause.PROCESS_OVERLOAD
    loop.feed(CycleInputs(T_part_tcp=held, q=Q, w_tcp_part=np.zeros(6), enable=True, reset=True))
    loop.run()
    for _ in range(3):
        loop.feed(CycleInputs(T_part_tcp=held, q=Q, w_tcp_part=np.zeros(6), enable=True))
        loop.run()
    assert loop.result.feed_hold == 0
    assert loop.monitor.events == ()


def test_reactions_are_as_chosen_and_none_without_being_armed() -> None:
    warned = active({Event.OVERLOAD: Reaction.WARN})
    assert Event.OVERLOAD in mill(warned, 2.0, 0.08)
    assert warned.state == State.ACTIVE
    stopped = active({Event.OVERLOAD: Reaction.STOP})
    mill(stopped, 2.0, 0.06)
    assert stopped.state == State.FAULT
    assert stopped.cause == Cause.PROCESS_OVERLOAD
    assert stopped.result.silent == 1  # told to stop for half a second, then left to its own timeout
    watching = active(arm=False)
    assert Event.OVERLOAD in mill(watching, 2.0, 0.08)
    assert watching.result.feed_hold == 0
    assert watching.state == State.READY


def test_a_feed_that_stands_still_is_no_missing_cut() -> None:
    """The force decays where the feed is held; nothing is missing on a path that is not travelled."""
    loop = active()
    mill(loop, 1.0, 0.08)
    held = pose.make(R, np.array([0.08, 0.0, 0.0]))
    for k in range(300):
        w = np.array([-100.0, 300.0, -60.0, 0.0, 0.0, 0.0]) * np.exp(-k / 10.0)
        loop.feed(CycleInputs(T_part_tcp=held, q=Q, w_tcp_part=w, enable=True))
        loop.run()
        assert loop.monitor.outcome.new == 0


@pytest.mark.parametrize("bad", [{"filter_s": 0.0}, {"exponent": 1.5}, {"model_probability": 0.7}, {"margin_n": -1.0}])
def test_settings_that_are_none_are_refused(bad: dict[str, float]) -> None:
    with pytest.raises(InputError, match="monitor"):
        MonitorSettings(**bad)  # type: ignore[arg-type]


def shaken(amplitude_n: float, hz: float, decay_s: float = np.inf, until: float = 0.155) -> set[Event]:
    """The slot with a slow vibration of the force across the feed from 60 mm on."""
    loop, plan, met = active(), slot(), set()
    rng = np.random.default_rng(2)
    for x in np.arange(0.0, until, FEED * 4e-3):
        w = np.zeros(6)
        for k in range(3):
            w[k] = np.interp(x, plan.p_part[:, 0], plan.w_tcp_part[:, k])
        since = max(0.0, (x - 0.06) / FEED)
        cutting = w[1] > 0.0 and since > 0.0
        w[:3] += rng.standard_normal(3)
        w[1] += amplitude_n * cutting * np.sin(2.0 * np.pi * hz * since) * np.exp(-since / decay_s)
        loop.feed(CycleInputs(T_part_tcp=pose.make(R, np.array([x, 0.0, 0.0])), q=Q, w_tcp_part=w, enable=True))
        loop.run()
        met |= {e for e in Event if int(loop.monitor.outcome.new) >> e & 1}
    return met


@pytest.mark.parametrize("hz", [2.7, 8.5, 30.0])
def test_a_vibration_of_the_arm_that_goes_on_is_told_from_one_that_dies_away(hz: float) -> None:
    """100 N on 331 N of mean force: for ever, and dying away as the arm does at a damping ratio of 0.1 (8.5 Hz)."""
    assert Event.LOW_CHATTER in shaken(100.0, hz)
    assert Event.LOW_CHATTER not in shaken(100.0, hz, decay_s=0.19)
    assert Event.LOW_CHATTER not in shaken(15.0, hz)


def events_of_samples(signal: Float) -> set[Event]:
    """The slot at the plan's force with a signal of the sensor at 1 kHz on top, across the feed."""
    loop, plan, met = active(), slot(), set()
    samples = np.zeros((4, 6))
    for k, x in enumerate(np.arange(0.0, 0.155, FEED * 4e-3)):
        for i in range(4):
            for j in range(3):
                samples[i, j] = np.interp(x + 1e-3 * i * FEED, plan.p_part[:, 0], plan.w_tcp_part[:, j])
        samples[:, 1] += signal[4 * k : 4 * k + 4]
        w = np.zeros(6)
        w[:3] = samples[:, :3].mean(axis=0)
        take_fast(*loop.rows, samples, 4, 4 * k)
        loop.feed(CycleInputs(T_part_tcp=pose.make(R, np.array([x, 0.0, 0.0])), q=Q, w_tcp_part=w, enable=True))
        loop.run()
        met |= {e for e in Event if int(loop.monitor.outcome.new) >> e & 1}
    return met


@pytest.mark.parametrize(("hz", "there"), [(14.0, False), (36.0, False), (120.0, True), (300.0, True)])
def test_a_swing_of_the_arm_is_no_chatter(hz: float, there: bool) -> None:
    """150 N within half a second from the air before the cut on: 14 and 36 Hz are the arm, 120 and 300 Hz are not."""
    t = 1e-3 * np.arange(6400)
    burst = 150.0 * np.sin(2.0 * np.pi * hz * t) * ((t > 0.6) & (t < 1.1))
    assert (Event.CHATTER in events_of_samples(burst + np.random.default_rng(4).standard_normal(len(t)))) == there


def test_steps_of_the_force_are_no_chatter() -> None:
    """Entries and exits in the middle of nowhere, 300 N at once, every 0.3 s."""
    t = 1e-3 * np.arange(6400)
    steps = 300.0 * ((t / 0.3).astype(int) % 2) * (t < 1.2)
    assert Event.CHATTER not in events_of_samples(steps + np.random.default_rng(5).standard_normal(len(t)))


def test_inertia_out_of_the_cut_does_not_blind_the_cut() -> None:
    """The spindle's 86 kg are felt wherever the program accelerates; a missing cut is seen all the same."""

    def run(missing: bool) -> set[Event]:
        loop, plan, met = active(inertia_kg=80.0), slot(), set()
        rng = np.random.default_rng(6)
        x, v, z = -0.02, 0.0, 0.0
        while x < 0.155:
            wanted = FEED if x > -5.0 * MM else 4.0 * FEED
            a = float(np.clip((wanted - v) / 4e-3, -1.0, 1.0))
            v, x = v + 4e-3 * a, x + 4e-3 * v
            w = np.zeros(6)
            for k in range(3):
                w[k] = np.interp(x, plan.p_part[:, 0], plan.w_tcp_part[:, k]) * (not (missing and x > 0.08))
            z = 0.9 * z - 0.1 * 86.0 * a
            w[0] += z
            w[:3] += rng.standard_normal(3)
            loop.feed(CycleInputs(T_part_tcp=pose.make(R, np.array([x, 0.0, 0.0])), q=Q, w_tcp_part=w, enable=True))
            loop.run()
            met |= {e for e in Event if int(loop.monitor.outcome.new) >> e & 1}
        return met

    assert run(False) == set()
    assert Event.MISSING_CUT in run(True)


def test_a_force_beyond_what_the_spindle_takes_holds_the_feed_in_its_second_cycle() -> None:
    """One cycle may be the sensor's own; the answer of the second, 8 ms after the first, asks for the hold."""
    loop = active(force_limit_n=900.0)
    assert mill(loop, 1.0, 0.08) == set()
    place = pose.make(R, np.array([0.08, 0.0, 0.0]))
    held = []
    for _ in range(3):
        loop.feed(CycleInputs(T_part_tcp=place, q=Q, w_tcp_part=np.array([0.0, 1000.0, 0, 0, 0, 0]), enable=True))
        loop.run()
        held.append(bool(loop.result.feed_hold))
    assert held == [False, True, True]
