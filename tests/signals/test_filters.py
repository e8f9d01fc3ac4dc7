"""Online filters against SciPy, and the delay they state."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.signal import butter, lfilter

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.signals.filters import Smoother, Smoothing

T = 4e-3


def run(smoothing: Smoothing, signal: Float, start: float = 0.0) -> Float:
    smoother, out = Smoother(smoothing, 1), np.zeros(1)
    smoother.reset(np.array([start]))
    result = np.empty(len(signal))
    for i, value in enumerate(signal):
        smoother(np.array([value]), out)
        result[i] = out[0]
    return result


@given(st.floats(0.5, 100.0), st.integers(1, 20), st.integers(0, 100))
def test_agrees_with_scipy(corner: float, average: int, seed: int) -> None:
    signal = np.random.default_rng(seed).standard_normal(200)
    b, a = butter(2, corner, fs=1.0 / T)
    expected = lfilter(np.ones(average) / average, [1.0], lfilter(b, a, signal))
    np.testing.assert_allclose(run(Smoothing(corner, average, T), signal), expected, atol=1e-12)


@given(st.floats(1.0, 50.0), st.integers(1, 20))
def test_a_ramp_comes_late_by_the_stated_delay(corner: float, average: int) -> None:
    smoothing = Smoothing(corner, average, T)
    time: Float = np.arange(3000, dtype=np.float64) * T
    late = (time - run(smoothing, time))[-1]
    assert late == pytest.approx(smoothing.delay_s, rel=1e-6)


@given(st.floats(-1e3, 1e3), st.just(0.0) | st.floats(1e-3, 50.0), st.integers(1, 20))
def test_rest_stays_rest(value: float, corner: float, average: int) -> None:
    out = run(Smoothing(corner, average, T), np.full(50, value), start=value)
    np.testing.assert_allclose(out, value, rtol=1e-12, atol=1e-12)


def test_left_out_parts_change_nothing() -> None:
    signal = np.random.default_rng(1).standard_normal(50)
    np.testing.assert_array_equal(run(Smoothing(0.0, 1, T), signal), signal)


@pytest.mark.parametrize("bad", [(200.0, 1), (5e-324, 1), (1e-5, 1), (-1.0, 1), (10.0, 0), (float("nan"), 1)])
def test_impossible_filters_are_refused(bad: tuple[float, int]) -> None:
    with pytest.raises(InputError):
        Smoothing(bad[0], bad[1], T)
