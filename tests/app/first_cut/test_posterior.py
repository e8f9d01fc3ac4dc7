"""Constants from measured faces: laws of the estimate on faces whose displacement is known in closed form."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.app.first_cut.posterior import (
    OTHERWISE,
    MeasuredCoordinates,
    Patterns,
    doubts,
    estimated,
    left_out,
    share_left,
)
from counterflex.core.arrays import Float
from counterflex.core.units import MM, UM
from counterflex.files.cell.cell import read_cell

CELL = read_cell(Path(__file__).parents[3] / "examples" / "cells" / "kr300_d16_small.toml")
NAMES = ("axis2", "axis3", "spindle")
PLACES = 36
LOST = 12
"""Play and friction of six axes."""
COUNT = 3 + len(NAMES) + 1 + LOST + 3
seeds = st.integers(0, 2**31)


def patterns(seed: int) -> Patterns:
    """Faces along three axes under forces of many directions; drives and play yield a tenth of the deflection."""
    rng = np.random.default_rng(seed)
    elements = 0.15 * MM * rng.standard_normal((3, len(NAMES), PLACES))
    drives, play = 0.1 * elements.sum(axis=1), 20.0 * UM * rng.standard_normal((LOST, PLACES))
    planned = elements.sum(axis=(0, 1)) + drives.sum(axis=0) + play.sum(axis=0)
    return Patterns(planned, elements, drives, play, np.eye(3)[:, np.arange(PLACES) % 3])


def measured(off_m: Float) -> MeasuredCoordinates:
    k = np.arange(PLACES)
    return MeasuredCoordinates(k, k % 3, k // 3, k + 1, off_m, 15.0 * UM)


@settings(max_examples=20)
@given(seeds)
def test_derivatives_are_those_of_the_coordinates(seed: int) -> None:
    one, rng = patterns(seed), np.random.default_rng(seed + 1)
    theta = 0.3 * rng.standard_normal(COUNT)
    theta[-3:] *= MM
    _, H = one.at(theta)
    for i, step in enumerate(1e-6 * np.eye(len(theta))):
        slope = (one.at(theta + step)[0] - one.at(theta - step)[0]) / 2e-6
        np.testing.assert_allclose(H[:, i], slope, rtol=1e-6, atol=1e-9)


@settings(max_examples=10)
@given(seeds)
def test_faces_as_planned_change_nothing(seed: int) -> None:
    one = patterns(seed)
    fit = estimated(NAMES, one, measured(one.predicted_m), CELL)
    np.testing.assert_allclose(fit.value, 0.0, atol=1e-9)
    np.testing.assert_allclose(fit.left_m, 0.0, atol=1e-12)


@settings(max_examples=10)
@given(seeds, st.floats(0.6, 1.7), st.floats(0.6, 1.7))
def test_a_softer_cell_and_a_larger_force_are_found_together(seed: int, force: float, soft: float) -> None:
    """Their product is what faces show: the deflection is found, however it is shared out between them."""
    one = patterns(seed)
    theta = np.zeros(COUNT)
    theta[:3], theta[3 : 3 + len(NAMES)] = np.log(force), np.log(soft)
    off, _ = one.at(theta)
    fit = estimated(NAMES, one, measured(off), CELL)
    size = float(np.sqrt(np.mean(off**2)))
    assert float(np.sqrt(np.mean(fit.left_m**2))) < 0.05 * size + 5.0 * UM
    product = np.mean(np.log(fit.factors.force)) + np.mean(np.log(fit.factors.elements))
    assert abs(product - np.log(force * soft)) < 0.2


@settings(max_examples=10)
@given(seeds, st.integers(0, PLACES - 1), st.sampled_from([-2.0, 2.0]))
def test_a_slip_of_the_pen_leaves_the_others_right(seed: int, place: int, slip_mm: float) -> None:
    one = patterns(seed)
    off = one.predicted_m.copy()
    off[place] += slip_mm * MM
    fit = estimated(NAMES, one, measured(off), CELL)
    others = np.arange(PLACES) != place
    assert float(np.sqrt(np.mean(fit.left_m[others] ** 2))) < 25.0 * UM
    assert abs(fit.left_m[place]) > 1.0 * MM


@settings(max_examples=10)
@given(seeds)
def test_more_faces_leave_less_doubt_and_never_more_than_before(seed: int) -> None:
    one = patterns(seed)
    every = measured(one.predicted_m)
    shares = []
    for count in (9, 18, 36):
        rows = np.arange(count)
        fit = estimated(NAMES, one.only(rows), every.only(rows), CELL)
        shares.append(share_left(fit, one)[0])
    assert 0.0 < shares[2] <= shares[1] <= shares[0] < 1.0


@settings(max_examples=5)
@given(seeds)
def test_faces_left_out_are_foretold_by_the_others(seed: int) -> None:
    one = patterns(seed)
    theta = np.zeros(COUNT)
    theta[:3] = np.log(1.4)
    off, _ = one.at(theta)
    foretold, _ = left_out(NAMES, one, measured(off), CELL)
    assert np.sqrt(np.mean(foretold**2)) < 0.5 * np.sqrt(np.mean((off - one.predicted_m) ** 2))


@settings(max_examples=10)
@given(seeds)
def test_faces_that_no_constant_explains_widen_the_doubt_by_what_they_are_off(seed: int) -> None:
    """Constants as the model has them leave it; an error of each face of its own, as large as it is."""
    one, rng = patterns(seed), np.random.default_rng(seed + 1)
    off, _ = one.at(np.r_[np.log(1.4) * np.ones(3), np.zeros(COUNT - 3)])
    for error_m, least, most in ((0.0, 1.0, 1.5), (0.3 * MM, 2.0, np.inf)):
        given_ = measured(off + error_m * rng.choice([-1.0, 1.0], PLACES // 3)[np.arange(PLACES) // 3])
        fit, (left, sigma) = estimated(NAMES, one, given_, CELL), left_out(NAMES, one, given_, CELL)
        wide, k = fit.widened(left, sigma), 3 + len(NAMES)
        ratio = wide.covariance[:k, :k] / fit.covariance[:k, :k]
        np.testing.assert_allclose(ratio, ratio[0, 0])
        more = np.diag(wide.covariance - ratio[0, 0] * fit.covariance)[k:-3]
        np.testing.assert_allclose(more, OTHERWISE * np.diag(fit.before)[k:-3])  # what other programs ask of them
        assert least <= ratio[0, 0] <= most
        assert ratio[0, 0] == pytest.approx(max(1.0, np.mean((left / sigma) ** 2)))


@settings(max_examples=10)
@given(seeds, st.integers(0, 2))
def test_a_mirrored_axis_is_doubted(seed: int, axis: int) -> None:
    one = patterns(seed)
    right = measured(1.3 * one.predicted_m)
    assert doubts(estimated(NAMES, one, right, CELL), right, one.predicted_m, CELL) == []
    wrong = measured(np.where(right.axis == axis, -right.off_m, right.off_m))
    first, *_ = doubts(estimated(NAMES, one, wrong, CELL), wrong, one.predicted_m, CELL)
    assert f"along {'xyz'[axis]} lie on the other side" in first


@settings(max_examples=10)
@given(seeds)
def test_readings_of_a_wrong_unit_are_doubted(seed: int) -> None:
    one = patterns(seed)
    wrong = measured(one.predicted_m / 1000.0)
    assert "unit of the readings" in " ".join(doubts(estimated(NAMES, one, wrong, CELL), wrong, one.predicted_m, CELL))


@settings(max_examples=10)
@given(seeds, st.integers(0, 2), st.sampled_from([-1.0, 1.0]))
def test_a_frame_that_is_off_is_doubted(seed: int, axis: int, off_mm: float) -> None:
    one = patterns(seed)
    shifted = measured(one.predicted_m + np.where(np.arange(PLACES) % 3 == axis, off_mm * MM, 0.0))
    fit = estimated(NAMES, one, shifted, CELL)
    (told,) = [text for text in doubts(fit, shifted, one.predicted_m, CELL) if "part frame and the zero" in text]
    assert f"{'xyz'[axis]} {off_mm:+.0f}"[:3] in told


@settings(max_examples=10)
@given(seeds)
def test_written_standard_deviations_leave_the_doubt_that_was_found(seed: int) -> None:
    """Independent values of the elements, each with its written spread, scatter the faces as the estimate does."""
    one, k = patterns(seed), len(NAMES)
    fit = estimated(NAMES, one, measured(one.predicted_m), CELL)
    spread = np.sqrt(np.diag(fit.before))[3 : 3 + k] * share_left(fit, one)[1]
    rng, H = np.random.default_rng(seed), one.at(fit.value)[1]
    kept = list(range(3 + k))
    found = rng.multivariate_normal(np.zeros(len(kept)), fit.covariance[np.ix_(kept, kept)], 4000) @ H[:, kept].T
    written = spread * rng.standard_normal((4000, k)) @ H[:, 3 : 3 + k].T
    assert np.sqrt(np.mean(written**2)) == pytest.approx(np.sqrt(np.mean(found**2)), rel=0.1)
