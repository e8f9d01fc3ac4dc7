"""The zero of a force sensor: means, limits, and that a refused one is tried again."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from counterflex.links.tare import CYCLES, Tare


@given(arrays(np.float64, (CYCLES, 6), elements=st.floats(-40.0, 40.0)))
def test_the_zero_is_the_mean_where_that_is_within_the_limits(readings: np.ndarray) -> None:
    tare = Tare(15.0, 5.0)
    for k, w in enumerate(readings):
        assert (tare.accepted, tare.refusals) == (False, 0), k
        tare.take(w)
    mean = readings.mean(axis=0)
    np.testing.assert_allclose(tare.mean, mean, atol=1e-12)
    fits = np.linalg.norm(tare.mean[:3]) <= 15.0 and np.linalg.norm(tare.mean[3:]) <= 5.0
    assert tare.accepted == fits
    np.testing.assert_array_equal(tare.zero, tare.mean if fits else np.zeros(6))


def test_a_refused_zero_is_tried_again_until_the_load_is_right() -> None:
    tare = Tare(15.0, 5.0)
    for _ in range(3 * CYCLES):
        tare.take(np.array([0.0, 0.0, 20.0, 0.0, 0.0, 0.0]))
    assert (tare.accepted, tare.refusals) == (False, 3)
    for _ in range(CYCLES):
        tare.take(np.array([0.0, 0.0, 12.0, 0.0, 0.0, 0.0]))
    assert (tare.accepted, tare.refusals) == (True, 0)
    assert tare.zero[2] == pytest.approx(12.0)


def test_taken_again_the_old_zero_holds_until_there_is_another() -> None:
    tare = Tare(15.0, 5.0)
    for _ in range(CYCLES):
        tare.take(np.full(6, 1.0))
    tare.take(np.full(6, 9.0))
    tare.again()
    assert not tare.accepted
    np.testing.assert_array_equal(tare.zero, np.full(6, 1.0))
    for _ in range(CYCLES):
        tare.take(np.full(6, 2.0))
    np.testing.assert_array_equal(tare.zero, np.full(6, 2.0))


def test_what_is_no_number_is_no_zero() -> None:
    tare = Tare(15.0, 5.0)
    for _ in range(CYCLES):
        tare.take(np.full(6, np.nan))
    assert not tare.accepted
    np.testing.assert_array_equal(tare.zero, np.zeros(6))


def test_a_tested_zero_that_is_not_to_be_taken_stays_nothing() -> None:
    tare = Tare(15.0, 5.0, keep=False)
    for _ in range(CYCLES):
        tare.take(np.full(6, 1.0))
    assert tare.accepted
    np.testing.assert_array_equal(tare.zero, np.zeros(6))
