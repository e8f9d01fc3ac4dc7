"""A broken tooth that does not show: laws of sampling, correlation of sampled lines, and trials beside the speed."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, strategies as st

from counterflex.runtime.monitoring.events import Event
from counterflex.runtime.monitoring.hidden_tooth import SLIPS, hidden_teeth, hidden_tooth, is_hidden
from counterflex.runtime.monitoring.monitor import Monitor
from counterflex.runtime.monitoring.settings import MonitorSettings
from counterflex.runtime.monitoring.spindle_lines import CLEAR, NOTCH_S, RESOLVED, is_apart
from counterflex_lab.monitor_trial import EXPONENT, Cut, Incident, run_trial, trial_plan

speeds = st.floats(20.0, 480.0)
teeth_of = st.integers(2, 8)
RATE = 1000.0


def overlap(first_hz: float, second_hz: float, period_s: float) -> float:
    """Correlation of two sampled sines in a window that forgets with the time constant of the notches."""
    keep = math.exp(-period_s / NOTCH_S)
    sums = [
        (1.0 - keep) / (1.0 - keep * np.exp(2j * np.pi * (first_hz + sign * second_hz) * period_s)) for sign in (-1, 1)
    ]
    return float(max(abs(one) for one in sums))


@given(turn_per_s=speeds, teeth=teeth_of)
def test_mirrored_and_repeated_speeds_hide_the_same(turn_per_s: float, teeth: int) -> None:
    """Samples do not tell N from n - N, nor from N + n: every order folds to the same place."""
    assume(not any(_at_a_limit(turn_per_s, order, teeth) for order in range(1, 6 * teeth + 1)))
    found = is_hidden(turn_per_s, teeth, 1.0 / RATE)
    assert is_hidden(RATE - turn_per_s, teeth, 1.0 / RATE) == found
    assert is_hidden(RATE + turn_per_s, teeth, 1.0 / RATE) == found


@given(turn_per_s=speeds, teeth=teeth_of, order=st.integers(1, 12))
def test_lines_are_apart_where_their_samples_do_not_correlate(turn_per_s: float, teeth: int, order: int) -> None:
    """Two lines d apart correlate with ``1 / sqrt(1 + (2 pi d tau)^2)`` where their images are far."""
    assume(order % teeth != 0)
    apart = is_apart(turn_per_s / RATE, order, teeth, 1.0 / RATE)
    passing = [overlap(order * turn_per_s, k * teeth * turn_per_s, 1.0 / RATE) for k in range(1, 7)]
    if apart:
        limits = [1.0 / math.hypot(1.0, CLEAR if k < 2 else RESOLVED) for k in range(6)]
        assert all(value < limit * 1.15 for value, limit in zip(passing, limits, strict=True))
    else:
        hidden_slow = overlap(order * turn_per_s, 0.0, 1.0 / RATE) > 1.0 / math.hypot(1.0, 2.0 * np.pi * 41.0 * NOTCH_S)
        assert hidden_slow or max(passing) > 0.9 / math.hypot(1.0, CLEAR)


@pytest.mark.parametrize("teeth", range(2, 9))
def test_a_spindle_at_a_fraction_of_the_sampling_rate_hides_the_first_order(teeth: int) -> None:
    """At n / (z + 1) turns a second order 1 lies at n / (z + 1) and order z at n - n / (z + 1): one place."""
    turn = 1.0 / (teeth + 1)
    assert not is_apart(turn, 1, teeth, 1.0 / RATE)
    assert is_apart(turn, teeth, teeth, 1.0 / RATE) == (turn * RATE > 40.0)


@given(turn_per_s=speeds)
def test_a_single_tooth_takes_all_force_and_is_never_hidden(turn_per_s: float) -> None:
    assert hidden_tooth(turn_per_s, 1, 1.0 / RATE) is None


@given(turn_per_s=speeds, teeth=teeth_of)
def test_a_slow_sensor_hides_every_tooth_and_proposes_no_speed(turn_per_s: float, teeth: int) -> None:
    found = hidden_tooth(turn_per_s, teeth, 2e-3)
    assert found is not None
    assert (found.slips, found.seen_rpm, found.mostly) == (SLIPS, None, True)
    assert "600 Hz" in found.sentence


@given(turn_per_s=speeds, teeth=teeth_of)
def test_the_proposed_speed_hides_nothing(turn_per_s: float, teeth: int) -> None:
    found = hidden_tooth(turn_per_s, teeth, 1.0 / RATE)
    if found is not None and found.seen_rpm is not None:
        assert hidden_tooth(found.seen_rpm / 60.0, teeth, 1.0 / RATE) is None
        assert f"{found.seen_rpm:g} rpm" in found.sentence


def test_each_speed_and_tool_is_reported_once_and_unknown_ones_not_at_all() -> None:
    cuts = [(250.0, 3), (250.0, 3), (0.0, 3), (200.0, 0), (200.0, 4), (13_000 / 60.0, 3)]
    assert [(one.speed_rpm, one.teeth) for one in hidden_teeth(cuts, 1.0 / RATE)] == [(12_000.0, 4), (15_000.0, 3)]


@pytest.mark.parametrize(("rpm", "teeth"), [(15_000, 3), (20_000, 3), (12_000, 4), (12_000, 2)])
def test_a_broken_tooth_shows_at_the_proposed_speed_and_seldom_before(rpm: int, teeth: int) -> None:
    """Trials tooth by tooth, whose signal knows nothing of the closed form."""
    found = hidden_tooth(rpm / 60.0, teeth, 1.0 / RATE)
    assert found is not None
    assert found.mostly
    assert found.seen_rpm is not None
    settings = MonitorSettings(force_limit_n=2000.0, exponent=EXPONENT)
    cut = Cut(speed_rpm=float(rpm), teeth=teeth)

    def seen(one: Cut) -> int:
        incident = Incident(Event.BREAKAGE, at_m=0.04 + 0.6 * one.feed_m_s, size=1)
        trials = [run_trial(settings, 1.2 * one.feed_m_s + 0.07, incident, seed, one) for seed in range(1200, 1204)]
        return sum(Event.BREAKAGE in trial.events for trial in trials)

    assert seen(replace(cut, speed_rpm=found.seen_rpm)) >= 3 > seen(cut)


@pytest.mark.parametrize(("rpm", "hidden"), [(15_000.0, [15_000.0]), (13_000.0, [])])
def test_the_monitor_reports_the_cuts_of_its_plan(rpm: float, hidden: list[float]) -> None:
    settings = MonitorSettings(force_limit_n=2000.0, exponent=EXPONENT)
    plan = trial_plan(0.05, Cut(speed_rpm=rpm))
    monitor = Monitor(settings, None, plan.packed(), plan.watched(settings), 5e-3, 2e-3)
    assert [one.speed_rpm for one in monitor.hidden_teeth()] == hidden


def _at_a_limit(turn_per_s: float, order: int, teeth: int) -> bool:
    """A place or a distance so near to a limit that rounding decides."""
    turn = turn_per_s / RATE
    near = 1e-9
    flips = {is_apart(turn + delta, order, teeth, 1.0 / RATE) for delta in (-near, 0.0, near)}
    return len(flips) > 1
