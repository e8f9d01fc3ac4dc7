"""Smoothing of deviations along a path: straight lines and swings stay, noise goes down as stated."""

from __future__ import annotations

import numpy as np

from counterflex.evaluate.tool_path.readings import ToolReadings
from counterflex.evaluate.tool_path.tracked_path import pieces, smoothed

N = 600
WHOLE = [(0, N)]
ONES = np.ones(N)


SPACING = 1e-4


def test_a_straight_line_stays_as_it_is_to_its_ends() -> None:
    line = 3e-5 + 1e-6 * np.arange(N, dtype=np.float64)
    out, sigma = smoothed(line, WHOLE, ONES, 1e-5, SPACING)
    np.testing.assert_allclose(out, line, atol=1e-12)
    assert sigma[N // 2] < 2e-6 < sigma[0]


def test_noise_on_a_straight_line_falls_as_stated() -> None:
    rng = np.random.default_rng(1)
    noise = rng.normal(scale=1e-5, size=(60, N))
    both = [smoothed(one, WHOLE, ONES, 1e-5, SPACING) for one in noise]
    off, sigma = np.array([out for out, _ in both]), np.array([s for _, s in both])
    assert np.sqrt(np.mean(off**2)) < 2.5e-6
    assert 0.7 < np.sqrt(np.mean((off / sigma) ** 2)) < 1.1


def test_a_swing_is_kept_and_the_quiet_stretch_beside_it_is_smoothed() -> None:
    rng = np.random.default_rng(2)
    s = SPACING * np.arange(N)
    behind = np.maximum(s - 0.03, 0.0)
    swing = 5e-4 * (1.0 - np.exp(-behind / 1.5e-3) * np.cos(behind / 0.5e-3))
    both = [smoothed(swing + rng.normal(scale=1e-5, size=N), WHOLE, ONES, 1e-5, SPACING) for _ in range(40)]
    off, sigma = np.array([out - swing for out, _ in both]), np.array([v for _, v in both])
    near, far = np.abs(s - 0.033) < 3e-3, s < 0.029
    assert np.sqrt(np.mean(off[:, near] ** 2)) < 7e-6  # raw: 10
    assert np.sqrt(np.mean(off[:, far] ** 2)) < 2.5e-6
    assert 0.8 < np.sqrt(np.mean((off[:, near] / sigma[:, near]) ** 2)) < 1.2


def test_short_runs_and_readings_without_noise_stay() -> None:
    values = np.random.default_rng(3).normal(size=N) * 1e-5
    out, _ = smoothed(values, [(k, k + 5) for k in range(0, N, 5)], ONES, 1e-5, SPACING)
    np.testing.assert_array_equal(out, values)
    np.testing.assert_array_equal(smoothed(values, WHOLE, ONES, 0.5e-6, SPACING)[0], values)


def test_nothing_is_smoothed_across_corners_and_holes() -> None:
    way = np.tile([1.0, 0.0, 0.0], (30, 1))
    way[10:] = [0.0, 1.0, 0.0]
    broken = np.zeros(30, np.bool_)
    broken[20] = True
    kind = np.ones(30, np.int64)
    kind[25:] = 0
    assert pieces(way, broken, kind) == [(0, 10), (10, 20), (20, 25), (25, 30)]


def test_noise_of_readings_is_told_from_their_motion() -> None:
    rng = np.random.default_rng(3)
    t = np.linspace(0.0, 2.0, 2000)
    p = np.stack([0.025 * t, 0.01 * np.sin(3.0 * t), 0.0 * t], axis=1)
    assert ToolReadings(p).noise_m() < 1e-8
    assert np.isclose(ToolReadings(p + rng.normal(scale=2e-5, size=p.shape)).noise_m(), 2e-5, rtol=0.05)
