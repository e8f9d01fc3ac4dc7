"""Laws of what the loop is set up from: delays, gains of axes, plans at two speeds, records dropped and replayed."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter

from counterflex.core.arrays import Float
from counterflex.runtime.axis_gains import AxisGains
from counterflex.runtime.loop_plan import LoopPlan
from counterflex.runtime.record_ring import MOST, ROWS, WIDTH, RecordRing
from counterflex.runtime.settings import Delays

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


def test_delays_that_are_replaced_stay_apart() -> None:
    one = Delays()
    assert replace(one, dead_s=0.02).correction_s - one.correction_s == pytest.approx(0.02 - one.dead_s)
