"""The filter of floors: what passes it, and that maps and scattered points give the same through it."""

from __future__ import annotations

import numpy as np
import pytest

from counterflex.core.arrays import Float, Float32
from counterflex.cutting.stock import HeightMap
from counterflex.evaluate.floor_filter import CUTOFF_M, FloorMap, floor_fit

GRID = HeightMap.from_box((0.0, 0.0, -0.01), (0.02, 0.02, 0.0), 0.2e-3)


def rise_of(values: Float) -> FloorMap:
    """A floor on all of the grid."""
    rise: Float32 = values.astype(np.float32)
    return FloorMap(GRID, rise)


def grid_xy() -> tuple[Float, Float]:
    """X and y of every cell, m."""
    x, y = np.meshgrid(GRID.x_m(), GRID.y_m())
    return x, y


def scattered(count: int = 40_000) -> Float:
    """Places of a scan, (count, 2) m: a hundred each square millimetre."""
    return np.random.default_rng(1).uniform(0.0, 0.02, (count, 2))


PLACES = np.array([[10.03, 9.91], [0.1, 10.0], [0.5, 0.5], [19.9, 5.0]]) * 1e-3


def test_a_plane_passes_up_to_the_edges() -> None:
    x, y = grid_xy()
    expected = 2e-3 * PLACES[:, 0] - 1e-3 * PLACES[:, 1] + 5e-5
    np.testing.assert_allclose(rise_of(2e-3 * x - 1e-3 * y + 5e-5).heights(PLACES), expected, atol=2e-8)
    points = scattered()
    fit = floor_fit(points, PLACES, 1e-4)
    np.testing.assert_allclose(fit.values(2e-3 * points[:, 0] - 1e-3 * points[:, 1] + 5e-5), expected, atol=2e-8)


@pytest.mark.parametrize(("waves", "left"), [(0.25, 0.958), (1.0, 0.5), (3.0, 0.0)])
def test_half_of_a_wave_of_the_cut_off_is_left(waves: float, left: float) -> None:
    x, _ = grid_xy()
    middle = float(GRID.x_m()[50])
    wave = 1e-4 * np.cos(2.0 * np.pi * waves * (x - middle) / CUTOFF_M)
    at = np.array([[middle, GRID.y_m()[50]]])
    # exp(-pi (alpha waves)^2); the weight ends where it is 3 %, which lets through a little
    assert rise_of(wave).heights(at)[0] / 1e-4 == pytest.approx(left, abs=0.03)


def test_a_map_and_a_scan_of_a_step_are_the_same() -> None:
    x, _ = grid_xy()
    edge = 10.0e-3  # between two cells
    at = np.column_stack([np.linspace(8e-3, 12e-3, 21), np.full(21, 10e-3)])
    from_map = rise_of(np.where(x < edge, 0.0, 2e-4)).heights(at)
    points = scattered(160_000)
    from_scan = floor_fit(points, at, 5e-5).values(np.where(points[:, 0] < edge, 0.0, 2e-4))
    np.testing.assert_allclose(from_scan, from_map, atol=8e-6)
    assert np.ptp(from_map) == pytest.approx(2e-4, rel=0.01)


def test_noise_falls_as_the_fit_says() -> None:
    rng = np.random.default_rng(2)
    points = scattered()
    fit = floor_fit(points, PLACES, 1e-4)
    sigma = fit.standard_deviation(np.full(len(points), 2e-5))
    values = np.array([fit.values(rng.normal(scale=2e-5, size=len(points))) for _ in range(400)])
    np.testing.assert_allclose(values.std(axis=0), sigma, rtol=0.15)
    assert sigma[0] < 1.5e-6


def test_off_the_floor_nothing_is_measured() -> None:
    x, _ = grid_xy()
    part = rise_of(np.where(x < 8e-3, 1e-4, np.nan))
    at = np.array([[7.8e-3, 0.01], [8.4e-3, 0.01], [0.015, 0.01], [-1.0, 0.01], [np.nan, 0.01]])
    np.testing.assert_array_equal(np.isfinite(part.heights(at)), [True, False, False, False, False])
    points = scattered()
    points = points[points[:, 0] < 8e-3]
    fit = floor_fit(points, at[:3], 1e-4)
    np.testing.assert_array_equal(np.isfinite(fit.values(np.zeros(len(points)))), [True, False, False])
    empty = floor_fit(np.empty((0, 2)), at[:3], 1e-4)
    assert not np.isfinite(empty.values(np.empty(0))).any()
