"""Smoothing of deviations along a path: straight lines stay, noise goes down as promised, steps are not smeared."""

from __future__ import annotations

import numpy as np

from counterflex.evaluate.tool_path.readings import ToolReadings
from counterflex.evaluate.tool_path.smoothing import adapted, half_window_m, pieces, smoothed

N = 600
WHOLE = [(0, N)]
ONES = np.ones(N)


def test_a_straight_line_stays_as_it_is_to_its_ends() -> None:
    line = 3e-5 + 1e-6 * np.arange(N, dtype=np.float64)
    out, factor = smoothed(line, WHOLE, 20, ONES)
    np.testing.assert_allclose(out, line, atol=1e-15)
    assert np.isclose(factor[N // 2], 1.0 / np.sqrt(41.0))


def test_noise_falls_by_the_stated_factor() -> None:
    rng = np.random.default_rng(1)
    noise = rng.normal(scale=1e-5, size=(200, N))
    out = np.array([smoothed(one, WHOLE, 15, ONES)[0] for one in noise])
    factor = smoothed(noise[0], WHOLE, 15, ONES)[1]
    np.testing.assert_allclose(out.std(axis=0), 1e-5 * factor, rtol=0.25)


def test_a_step_is_kept_and_the_rest_is_smoothed() -> None:
    rng = np.random.default_rng(2)
    step = np.where(np.arange(N) < N // 2, 0.0, 5e-4)
    out, sigma = adapted(step + rng.normal(scale=1e-5, size=N), WHOLE, 25, ONES, 1e-5)
    off = np.abs(out - step)
    assert off.max() < 6e-5
    far = np.abs(np.arange(N) - N // 2) > 40
    assert np.sqrt(np.mean(off[far] ** 2)) < 4e-6
    assert np.median(sigma[far]) < 3e-6


def test_nothing_is_smoothed_across_corners_and_holes() -> None:
    way = np.tile([1.0, 0.0, 0.0], (30, 1))
    way[10:] = [0.0, 1.0, 0.0]
    broken = np.zeros(30, np.bool_)
    broken[20] = True
    kind = np.ones(30, np.int64)
    kind[25:] = 0
    assert pieces(way, broken, kind) == [(0, 10), (10, 20), (20, 25), (25, 30)]


def test_the_window_is_as_wide_as_the_noise_asks_for() -> None:
    assert half_window_m(2e-6, 1e4) == 0.0
    n = 2.0 * half_window_m(9e-6, 1e4) * 1e4
    assert np.isclose(9e-6 / np.sqrt(n), 3e-6)
    assert half_window_m(1e-3, 1e4) == 2.5e-3


def test_noise_of_readings_is_told_from_their_motion() -> None:
    rng = np.random.default_rng(3)
    t = np.linspace(0.0, 2.0, 2000)
    p = np.stack([0.025 * t, 0.01 * np.sin(3.0 * t), 0.0 * t], axis=1)
    assert ToolReadings(p).noise_m() < 1e-8
    assert np.isclose(ToolReadings(p + rng.normal(scale=2e-5, size=p.shape)).noise_m(), 2e-5, rtol=0.05)
