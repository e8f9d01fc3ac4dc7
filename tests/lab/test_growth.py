"""Slopes with standard errors, and percentiles in constant memory, against NumPy and known scatter."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st

from counterflex.core.errors import InputError
from counterflex.evaluate.loop_timing import LatencyHistogram
from counterflex_lab.soak.figures import growth


def test_slope_and_standard_error_are_those_of_polyfit() -> None:
    rng = np.random.default_rng(1)
    t = np.sort(rng.uniform(0.0, 3.0, 200))
    x = 5.0 + 0.7 * t + 0.1 * rng.standard_normal(200)
    found = growth(t, x)
    assert found is not None
    (slope, _), cov = np.polyfit(t, x, 1, cov=True)
    assert found.slope == pytest.approx(slope)
    assert found.standard_error == pytest.approx(np.sqrt(cov[0, 0]))


def test_nine_of_ten_intervals_of_two_standard_errors_hold_the_truth() -> None:
    rng = np.random.default_rng(2)
    t = np.linspace(0.0, 1.0, 60)
    inside = 0
    for _ in range(300):
        found = growth(t, 0.3 * t + rng.standard_normal(60))
        assert found is not None
        inside += abs(found.slope - 0.3) < 2.0 * found.standard_error
    assert 0.9 < inside / 300 < 0.99


def test_what_is_no_line() -> None:
    assert growth(np.array([0.0, 1.0]), np.array([0.0, 1.0])) is None
    assert growth(np.zeros(5), np.arange(5.0)) is None
    known = growth(np.arange(5.0), np.array([0.0, 2.0, np.nan, 6.0, 8.0]))
    assert known is not None
    assert known.slope == pytest.approx(2.0)
    with pytest.raises(InputError):
        growth(np.arange(3.0), np.arange(4.0))


@given(st.lists(st.floats(0.02, 1e6), min_size=1, max_size=300), st.floats(0.01, 1.0))
def test_percentiles_are_at_most_one_percent_above_a_value_that_was_met(values: list[float], share: float) -> None:
    histogram = LatencyHistogram()
    for part in np.array_split(np.array(values), 3):
        histogram.add(part)
    exact = np.sort(values)[max(0, int(np.ceil(share * len(values) - 1e-9)) - 1)]
    assert histogram.n == len(values)
    assert exact * (1.0 - 1e-9) <= histogram.at(share) <= 1.0101 * exact
    assert histogram.largest == max(values)


def test_what_is_no_time_is_refused() -> None:
    histogram = LatencyHistogram()
    assert histogram.at(0.5) == 0.0
    for bad in (-1.0, np.nan, np.inf):
        with pytest.raises(InputError):
            histogram.add(np.array([bad]))
    with pytest.raises(InputError):
        histogram.at(0.0)
