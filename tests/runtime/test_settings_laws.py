"""Laws of what the loop is set up from: delays, gains of axes, plans at two speeds, records dropped and replayed."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.signal import lfilter

from counterflex.core.arrays import Float
from counterflex.core.records import Record, records
from counterflex.core.units import MM
from counterflex.runtime import record_ring as record
from counterflex.runtime.axis_gains import AxisGains
from counterflex.runtime.loop_constants import pack_settings
from counterflex.runtime.loop_plan import LoopPlan
from counterflex.runtime.monitoring.override_plan import slowed_time
from counterflex.runtime.monitoring.override_settings import OverrideSettings
from counterflex.runtime.monitoring.settings import low_chatter_time
from counterflex.runtime.plausibility.limits import Plausibility
from counterflex.runtime.record_ring import CYCLE, MOST, ROWS, WIDTH, RecordRing
from counterflex.runtime.replay import Replay
from counterflex.runtime.settings import Delays, ForceMode, OnlineSettings, Pilot, TrackerMode, force_delay
from counterflex.runtime.state.chosen import SETTINGS
from counterflex.runtime.state.doubts import LIMITS
from counterflex.signals.limiter import MotionLimit
from counterflex.signals.preview import Ahead, Mode, Shaping

QUICK = settings(max_examples=40)
seed = st.integers(0, 2**31)
gain = st.floats(0.0, 3.0)


@QUICK
@given(st.floats(0.0, 0.05), st.floats(5.0, 60.0), st.floats(0.3, 1.5))
def test_a_correction_is_late_by_its_dead_time_and_the_slope_of_its_phase(
    dead: float, omega: float, zeta: float
) -> None:
    """Delay of a slow signal through w^2 / (s^2 + 2 zeta w s + w^2) behind a dead time, by its phase at 1 % of w."""
    slow = 0.01 * omega
    response = omega**2 / (omega**2 - slow**2 + 2j * zeta * omega * slow) * np.exp(-1j * slow * dead)
    late = -float(np.angle(response)) / slow
    assert Delays(dead_s=dead, natural_per_s=omega, damping=zeta).correction_s == pytest.approx(late, rel=1e-3)


@QUICK
@given(st.floats(0.0, 0.1), st.floats(0.0, 0.1), st.floats(0.0, 0.05))
def test_gains_undo_the_lag_of_following_to_second_order(lag: float, more: float, dead: float) -> None:
    """A parabola that comes through a dead time and a lag of first order misses itself by just what the gains add.

    The second gain holds the delay of the correction besides, times the first.
    """
    follow = lag + more
    delays = Delays(dead_s=dead, follow_s=follow, follow_lag_s=lag)
    first, second = delays.lag_gains
    # p(t) = t^2 / 2 seen through the lag and the dead time, at a late instant
    t = 50.0 * max(follow, 1e-3)
    through_lag = 0.5 * (t - more) ** 2 - lag * (t - more) + lag**2
    missing = 0.5 * t**2 - through_lag
    assert first * t - (delays.correction_s * first - second) == pytest.approx(missing, abs=1e-9)


@QUICK
@given(gain, gain, gain, st.floats(0.0, 0.1), seed)
def test_gains_of_an_axis_are_those_of_the_difference_equation(
    p: float, i: float, d: float, tau: float, n: int
) -> None:
    """P + I dt / (1 - z^-1) + D filtered, sample by sample; idle is no gain at all."""
    gains = AxisGains(p, i, d * 1e-2, tau, 1.0)
    period = 4e-3
    assert gains.idle == (p == i == d == 0.0)
    error = np.random.default_rng(n).normal(size=300)
    back = math.exp(-period / tau) if tau > 0.0 else 0.0
    slope = np.diff(error, prepend=0.0) / period
    wanted = p * error + i * period * np.cumsum(error) + lfilter([(1.0 - back) * d * 1e-2], [1.0, -back], slope)
    gain_, step, rate, decay, _ = gains.packed(period)
    integral = np.cumsum(step * error)
    slow = lfilter([rate], [1.0, -decay], np.diff(error, prepend=0.0))
    np.testing.assert_allclose(gain_ * error + integral + slow, wanted, atol=1e-9)


@QUICK
@given(st.integers(0, 2), st.just(0.0) | st.floats(1e-9, 3.0))
def test_a_controller_with_a_single_gain_is_not_idle(which: int, size: float) -> None:
    """Whichever it is: only what answers no error at all does nothing."""
    gains = [0.0, 0.0, 0.0]
    gains[which] = size
    one = AxisGains(gains[0], gains[1], gains[2], 0.01, 1.0)
    answer = one.response(np.array([0.5, 3.0, 20.0]), 4e-3)
    assert one.idle == (not np.any(answer)) == (size == 0.0)


def packed(settings: OnlineSettings, plan: LoopPlan | None = None) -> Record:
    """Constants of the step."""
    out = records(SETTINGS, 1)[0]
    pack_settings(out, settings, np.eye(4), plan)
    return out


@QUICK
@given(st.floats(0.01, 1.0), st.floats(0.5, 40.0), st.floats(0.01, 2.0))
def test_translation_and_rotation_ramp_out_in_one_share_of_their_speed(share: float, mm_s: float, turn: float) -> None:
    """Whichever is faster: radius and acceleration stay those of correcting."""
    move, spin = MotionLimit(2.0 * MM, mm_s * MM, 1.25), MotionLimit(0.005, turn, 3.0)
    found = packed(OnlineSettings(translation=move, rotation=spin, ramp_m_s=share * mm_s * MM))
    assert found.ramp.tolist() == pytest.approx([2.0 * MM, share * mm_s * MM, 1.25])
    assert found.ramp_rotation.tolist() == pytest.approx([0.005, share * turn, 3.0])


@QUICK
@given(st.sampled_from(ForceMode), st.integers(0, 20), st.integers(0, 20), st.integers(0, 20), st.booleans())
def test_what_a_tracker_shows_is_looked_up_as_late_as_it_is(
    force: ForceMode, dead: int, tracker: int, follow: int, designed: bool
) -> None:
    """In cycles: a correction acts after its dead time, and a tracker tells of it later by its age.

    The estimator of all sources looks at the correction of now, so there the age counts in the place of the pose alone.
    """
    T = 4e-3
    mode = TrackerMode.NONE if force == ForceMode.FUSED else TrackerMode.DESIGNED if designed else TrackerMode.OBSERVER
    settings = OnlineSettings(
        force=force, tracker=mode, delays=Delays(dead_s=dead * T, tracker_s=tracker * T, follow_s=follow * T)
    )
    found = packed(settings)
    assert found.correction_back == dead + (0 if force == ForceMode.FUSED else tracker)
    assert (found.nominal_back, found.reported_back) == (follow + tracker, follow)
    ahead = settings.lead_s if force == ForceMode.SCALE else -force_delay(settings)
    assert found.deflection_back == max(0, round(ahead / T + tracker))


@QUICK
@given(
    st.sampled_from([ForceMode.PILOT, ForceMode.SCALE]), st.floats(0.0, 0.1) | st.none(), st.booleans(), st.booleans()
)
def test_a_plan_that_is_shaped_is_read_in_place_and_any_other_ahead(
    force: ForceMode, lead_s: float | None, shaped: bool, planned: bool
) -> None:
    """A lead that is stated is kept; shaping has the delays in it already."""
    settings = OnlineSettings(force=force, pilot=Pilot(lead_s=lead_s))
    n = 4
    made = LoopPlan(np.eye(4)[:, :3], np.arange(float(n)), np.zeros((n, 6)), np.ones(n), np.zeros((n, 6)))
    made = replace(made, w_ahead_part=np.zeros((n, 6)) if shaped else None)
    found = packed(settings, made if planned else None)
    in_place = shaped and planned and lead_s is None
    assert found.reads_ahead == in_place
    assert found.lead == (0.0 if in_place else settings.lead_s)
    assert found.preview == (settings.delays.correction_s if in_place else settings.lead_s)
    assert found.has_plan == planned
    assert found.reference_late == (0.0 if planned else force_delay(settings))


CYCLES = {
    "answer_cycles": "answer_s", "answer_late": "answer_late_s", "early_cycles": "early_s",
    "early_late": "early_late_s", "residual_cycles": "residual_s", "return_samples": "return_s",
    "direction_cycles": "direction_s",
    "idle_cycles": "idle_s", "share_samples": "rejected_s", "silent_cycles": "silent_s", "step_back": "step_back_s",
}  # fmt: skip


@QUICK
@given(seed, st.sampled_from([1e-3, 4e-3, 12e-3]), st.floats(2.0, 30.0), st.floats(0.01, 0.5))
def test_every_time_limit_is_counted_in_cycles_of_its_own(
    number: int, period: float, hz: float, damping: float
) -> None:
    """Each by its own time, never none; what settles is waited for twice; a swing fades by its damping."""
    rng = np.random.default_rng(number)
    times = {name: float(v) for name, v in zip(CYCLES.values(), rng.uniform(1e-4, 2.0, len(CYCLES)), strict=True)}
    settle = float(rng.uniform(0.05, 1.0))
    out = records(LIMITS, 1)[0]
    Plausibility(**times, settle_s=settle).pack(out, period, (hz, damping))
    for name, time in CYCLES.items():
        assert out[name] == max(1, round(times[time] / period))
    assert out.settle_cycles == max(1, round(2.0 * settle / period))
    assert out.settle_gain == pytest.approx(1.0 - math.exp(-period / settle))
    assert out.step_fade == pytest.approx(math.exp(-damping * 2.0 * math.pi * hz * period))
    assert out.step_memory == pytest.approx(math.exp(-0.5 * hz * period))
    Plausibility().pack(out, period, None)
    assert (out.step_fade, out.step_memory, out.sign_samples) == (0.0, 0.0, 0)


@QUICK
@given(st.floats(0.0, 3.0), st.floats(1.0, 20.0))
def test_a_ring_up_to_twenty_times_the_limit_is_no_slow_vibration(ring_s: float, times: float) -> None:
    """``A exp(-t / ring)`` has fallen below the limit before it counts; 0.6 s of vibration always counts last."""
    found = low_chatter_time(ring_s)
    assert found >= max(0.6, ring_s * math.log(times))
    assert found <= max(0.6, ring_s * math.log(20.5))


def plan(points: Float, contained: Float) -> LoopPlan:
    n = len(points)
    return LoopPlan(points, np.arange(float(n)), np.zeros((n, 6)), np.ones(n), contained)


@QUICK
@given(seed, st.floats(0.0, 3e-3))
def test_the_feed_of_a_compensated_plan_is_that_of_the_program(number: int, size: float) -> None:
    """Whatever the points contain, directions are those of the points without it."""
    rng = np.random.default_rng(number)
    nominal = np.cumsum(rng.uniform(1e-3, 5e-3, (20, 3)), axis=0)
    contained = np.zeros((20, 6))
    contained[:, :3] = rng.normal(size=(20, 3)) * size
    plain = plan(nominal, np.zeros((20, 6))).packed()["direction"]
    found = plan(nominal + contained[:, :3], contained).packed()["direction"]
    np.testing.assert_allclose(found, plain, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0)
    back = plan(nominal[::-1], np.zeros((20, 6))).packed()["direction"]
    np.testing.assert_allclose(back[:-1], -plain[:-1][::-1], atol=1e-9)


@settings(max_examples=8, deadline=None)
@given(seed, st.floats(0.0, 1.0), st.booleans())
def test_what_is_commanded_at_two_speeds_is_shaped_for_the_force_that_is_there(
    number: int, exponent: float, lost: bool
) -> None:
    """The loop multiplies by the speed's power: so stored, it gives what the smaller force of the slower time needs."""
    rng = np.random.default_rng(number)
    time = np.cumsum(rng.uniform(2e-3, 6e-3, 400))
    pulse = np.exp(-(((time - 0.5 * time[-1]) / 0.05) ** 2))[:, None]
    points, none = np.cumsum(rng.uniform(0.0, 1e-4, (400, 3)), axis=0), np.zeros((400, 6))
    wrench = pulse * rng.normal(size=6) * 300.0
    of_drives = 0.1 * wrench if lost else None
    ahead = Ahead(0.6, (Mode(2.0 * np.pi * 8.5, 0.1), Mode(30.0, 0.7)), Shaping(0.02, 0.012))
    made = LoopPlan(
        points, time, wrench, np.ones(400), none, need_m=pulse * np.array([0.0, 0.8, -0.4]) * MM, ahead=ahead,
        w_ahead_part=ahead.command(wrench, time), w_lost_part=of_drives,
    )  # fmt: skip
    wish = OverrideSettings(tolerance_m=0.03 * MM, least=0.25)
    online = OnlineSettings(force=ForceMode.SCALE, pilot=Pilot(lead_s=None))
    slowed = made.at_speeds(online, wish, exponent)
    assert slowed.speed is not None
    assert slowed.w_ahead_part is not None
    assert slowed.speed.min() < 1.0
    loop = slowed.speed[:, None] ** exponent  # what the step multiplies all forces of the plan by
    later = slowed_time(time, slowed.speed)
    needed = ahead.command(wrench * loop, later, 0.0 if of_drives is None else of_drives)
    np.testing.assert_allclose(slowed.w_ahead_part * loop, needed, atol=1e-9)
    still = made.at_speeds(online, replace(wish, tolerance_m=1.0), exponent)
    np.testing.assert_array_equal(still.w_ahead_part, made.w_ahead_part)


@settings(max_examples=10, deadline=None)
@given(st.lists(st.integers(1, 2 * ROWS), min_size=1, max_size=4))
def test_records_dropped_are_counted_over_the_whole_run(counts: list[int]) -> None:
    """Taken and dropped make what was written, however often and however late they are taken."""
    ring = RecordRing()
    try:
        written = taken = 0
        for count in counts:
            for _ in range(count):
                ring.row()[WIDTH - 1] = written
                ring.commit()
                written += 1
            rows = ring.take()
            taken += len(rows)
            assert rows[:, WIDTH - 1].tolist() == list(range(written - min(count, MOST), written))
        assert ring.dropped + taken == written
    finally:
        ring.close()


@QUICK
@given(st.lists(st.integers(1, 6), min_size=1, max_size=40), st.lists(st.integers(0, 40), max_size=4))
def test_cycles_that_are_missing_are_counted_whatever_pieces_they_come_in(steps: list[int], cuts: list[int]) -> None:
    """Records and what is missing before them make the last cycle; a gap stands behind the last record before it."""
    cycles = 1 + np.cumsum(steps)  # the first one is missing, so nothing can be computed
    loop: Any = SimpleNamespace(reset=lambda: None, inputs=None)
    replay = Replay(loop)
    rows = np.zeros((len(cycles), WIDTH))
    rows[:, CYCLE] = cycles
    for piece in np.split(rows, sorted(cuts)):
        replay(piece)
    before = np.concatenate([[0], cycles[:-1]])
    expected = [(int(a), int(b - a - 1)) for a, b in zip(before, cycles, strict=True) if b != a + 1]
    assert [(gap.after, gap.missing) for gap in replay.gaps] == expected
    assert sum(gap.missing for gap in replay.gaps) + len(cycles) == cycles[-1]
    assert (replay.skipped, replay.compared, replay.difference) == (len(cycles), 0, None)


class Echo:
    """Stands for a loop: answers each cycle with the next of the given rows."""

    def __init__(self, rows: Float) -> None:
        self.left = list(rows)
        ends = (record.OUTCOME, record.MONITOR, record.MONITOR_OUTCOME, record.CYCLE)
        first, second, third, fourth = (np.zeros(b - a) for a, b in zip((record.RESULTS, *ends), ends, strict=False))
        self.answers, self._parts = (first, second), (first, second, third, fourth)
        self.inputs = np.zeros(record.FLAGS - record.GIVEN), np.zeros(record.RESULTS - record.FLAGS)
        self.monitor = SimpleNamespace(columns=(np.zeros(record.SENSOR - record.FAST), third, fourth))

    def reset(self) -> None:
        """Nothing is remembered."""

    def run(self) -> None:
        """One cycle."""
        row, at = self.left.pop(0), record.RESULTS
        for part in self._parts:
            part[:] = row[at : at + len(part)]
            at += len(part)


@QUICK
@given(st.integers(1, 30), st.lists(st.tuples(st.integers(0, 29), st.integers(0, 400)), max_size=4), st.integers(0, 30))
def test_a_replay_names_the_first_number_that_differs(n: int, changed: list[tuple[int, int]], cut: int) -> None:
    """First cycle and first column in it, however the records are cut; what came before it was compared."""
    rows = np.random.default_rng(n).normal(size=(n, WIDTH))
    rows[:, CYCLE], rows[:, 0] = np.arange(1, n + 1), 4.0 * np.arange(n)
    logged = rows.copy()
    places = {(k % n, record.RESULTS + c % (CYCLE - record.RESULTS)) for k, c in changed}
    for place in places:
        logged[place] += 1.0
    loop: Any = Echo(rows)
    replay = Replay(loop)
    for piece in (logged[:cut], logged[cut:]):
        replay(piece)
    if not places:
        assert (replay.difference, replay.compared) == (None, n)
        return
    row, col = min(places)
    found = replay.difference
    assert found is not None
    assert (found.cycle, found.counter_ms, found.column) == (row + 1, 4 * row, record.COLUMNS[col])
    assert (found.logged, found.replayed) == (logged[row, col], rows[row, col])
    assert found.columns == sum(k == row for k, _ in places)
    assert replay.compared == row


def test_delays_that_are_replaced_stay_apart() -> None:
    one = Delays()
    assert replace(one, dead_s=0.02).correction_s - one.correction_s == pytest.approx(0.02 - one.dead_s)
