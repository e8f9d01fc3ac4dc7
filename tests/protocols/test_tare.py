"""The zero of a force sensor: means, limits, and that a refused one is tried again."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays

from counterflex.core.arrays import Float
from counterflex.protocols.session.tare import CYCLES, Tare


@given(arrays(np.float64, 6, elements=st.floats(-20.0, 20.0)), st.integers(0, 1000), st.floats(0.0, 4.0))
def test_the_zero_is_the_mean_where_that_is_within_the_limits(level: Float, seed: int, noise: float) -> None:
    rng = np.random.default_rng(seed)
    readings = level + noise * rng.standard_normal((CYCLES, 6))
    tare = Tare(15.0, 5.0)
    for k, w in enumerate(readings):
        assert (tare.accepted, tare.refusals) == (False, 0), k
        tare.take(w)
    mean = readings.mean(axis=0)
    np.testing.assert_allclose(tare.mean, mean, atol=1e-12)
    halves = readings[: CYCLES // 2].mean(axis=0) - readings[CYCLES // 2 :].mean(axis=0)
    fits = all(
        np.linalg.norm(w[:3]) <= share * 15.0 and np.linalg.norm(w[3:]) <= share * 5.0
        for w, share in ((mean, 1.0), (halves, 0.2))
    )
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


def test_a_load_that_changes_meanwhile_is_no_zero() -> None:
    """25 N, put right to 1 N in the middle of a mean: 13 N would be within the limit, and no zero of anything."""
    tare = Tare(15.0, 5.0)
    for k in range(2 * CYCLES):
        tare.take(np.array([25.0 if k < CYCLES // 2 else 1.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
        assert tare.accepted == (k == 2 * CYCLES - 1)
    assert tare.zero[0] == pytest.approx(1.0)


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
