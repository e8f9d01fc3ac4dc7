"""Averages along the path and the shape of a correction in time: laws."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from counterflex.core.arrays import Float, Int
from counterflex.core.errors import InputError
from counterflex.plan.response import Shaping, shaped
from counterflex.plan.smoothing import moving_average

seeds = st.integers(0, 2**32 - 1)


def series(seed: int, n: int = 60, groups: int = 3) -> tuple[Float, Float, Int]:
    rng = np.random.default_rng(seed)
    steps = np.where(rng.random(n) < 0.15, 0.0, rng.uniform(0.05, 1.0, n))  # with dwells
    station = np.cumsum(steps) - steps[0]
    group = np.sort(rng.integers(0, groups, n))
    return rng.normal(size=(n, 2)), station, group


@given(seeds, st.floats(0.0, 30.0), st.floats(-1e3, 1e3))
@settings(max_examples=60, deadline=None)
def test_a_constant_is_kept(seed: int, window: float, level: float) -> None:
    _, station, group = series(seed)
    values = np.full((len(station), 2), level)
    rounding = 1e-15 * (1.0 + station[-1]) / max(window, 1e-9 * (1.0 + station[-1]))  # of the running integral
    found = moving_average(values, station, window, group)
    assert found == pytest.approx(values, abs=(1e-9 + 10.0 * rounding) * (1.0 + abs(level)))


@given(seeds, st.floats(0.01, 30.0))
@settings(max_examples=60, deadline=None)
def test_groups_are_never_mixed(seed: int, window: float) -> None:
    values, station, group = series(seed)
    whole = moving_average(values, station, window, group)
    other = values.copy()
    other[group == 1] += 1e3
    changed = moving_average(other, station, window, group)
    assert changed[group != 1] == pytest.approx(whole[group != 1], abs=1e-8)
    for number in np.unique(group):
        rows = group == number
        assert np.all(whole[rows].max(axis=0) <= values[rows].max(axis=0) + 1e-9)
        assert np.all(whole[rows].min(axis=0) >= values[rows].min(axis=0) - 1e-9)


@given(seeds, st.floats(0.1, 5.0))
@settings(max_examples=60, deadline=None)
def test_the_ends_of_a_group_are_kept(seed: int, window: float) -> None:
    values, station, group = series(seed)
    found = moving_average(values, station, window, group)
    for number in np.unique(group):
        rows = np.flatnonzero(group == number)
        assert found[rows[0]] == pytest.approx(values[rows[0]])
        assert found[rows[-1]] == pytest.approx(values[rows[-1]])


def test_the_integral_of_a_pulse_away_from_the_ends_is_kept() -> None:
    station = np.linspace(0.0, 10.0, 201)
    values = np.where(np.abs(station - 5.0) < 0.8, 1.0, 0.0)[:, None]
    found = moving_average(values, station, 2.0, np.zeros(201, dtype=np.int64))
    assert found.sum() == pytest.approx(values.sum(), rel=1e-12)
    assert found[found > 1e-12].max() < 1.0
    assert float(found[:, 0] @ station) == pytest.approx(float(values[:, 0] @ station), rel=1e-9)


def test_a_ramp_stays_a_ramp() -> None:
    station = np.linspace(0.0, 10.0, 101)
    values = (station - 0.5 * 0.1)[:, None]  # the mean over each segment
    found = moving_average(values, station, 1.0, np.zeros(101, dtype=np.int64))
    assert found[1:] == pytest.approx(values[1:], abs=1e-12)


def test_no_window_returns_the_values_and_a_negative_one_is_refused() -> None:
    values, station, group = series(1)
    assert np.array_equal(moving_average(values, station, 0.0, group), values)
    assert moving_average(values[:0], station[:0], 1.0, group[:0]).shape == (0, 2)
    for bad in (-1.0, float("nan")):
        with pytest.raises(InputError):
            moving_average(values, station, bad, group)


def as_int(values: Float) -> Int:
    out: Int = values.astype(np.int64)
    return out


def step_in_time(n: int = 400) -> tuple[Float, Float, Int]:
    time: Float = np.arange(n, dtype=np.float64) * 0.005
    values: Float = np.where((time > 0.5) & (time < 1.5), 1.0, 0.0)[:, None]
    return values, time, as_int(np.zeros(n))


def test_shaping_turns_a_jump_into_a_slope_of_the_stated_width() -> None:
    values, time, group = step_in_time()
    found = shaped(values, time, group, Shaping(smoothing_s=0.1, lead_s=0.0))[:, 0]
    assert np.all(np.diff(found[time < 1.0]) >= -1e-12)
    rising = time[(found > 1e-9) & (found < 1.0 - 1e-9) & (time < 1.0)]
    assert np.ptp(rising) == pytest.approx(0.2, abs=0.015)  # two averages
    assert found[time == time[np.argmin(np.abs(time - 0.5))]] == pytest.approx(0.5, abs=0.1)
    assert found.sum() == pytest.approx(values.sum(), rel=1e-9)


def test_lead_sends_the_same_earlier() -> None:
    values, time, group = step_in_time()
    plain = shaped(values, time, group, Shaping(0.05, 0.0))[:, 0]
    early = shaped(values, time, group, Shaping(0.05, 0.04))[:, 0]
    assert early[:-8] == pytest.approx(plain[8:], abs=1e-9)


@given(seeds, st.floats(0.0, 3.0), st.floats(0.0, 3.0))
@settings(max_examples=60, deadline=None)
def test_shaping_leaves_far_rows_exactly_zero(seed: int, smoothing: float, lead: float) -> None:
    values, time, group = series(seed, n=80)
    values[:20] = values[40:] = 0.0
    found = shaped(values, time, group, Shaping(smoothing, lead))
    active = time[20:40]
    for row in range(80):
        near = np.any(np.abs(active[group[20:40] == group[row]] - time[row]) <= smoothing + lead + 1e-12)
        if not near:
            assert np.all(found[row] == 0.0)
    assert np.all(np.abs(found) <= np.abs(values).max() + 1e-9)


def test_nothing_shaped_is_what_it_was() -> None:
    values, time, group = step_in_time()
    assert np.array_equal(shaped(values, time, group, Shaping(0.0, 0.0)), values)
    zero = np.zeros_like(values)
    assert np.all(shaped(zero, time, group, Shaping(0.1, 0.05)) == 0.0)


def test_shaping_is_checked() -> None:
    with pytest.raises(InputError):
        Shaping(-0.1, 0.0)
    with pytest.raises(InputError):
        Shaping(0.0, float("inf"))
