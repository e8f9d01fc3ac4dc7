"""What of an error lasts: laws of a running mean over uneven rows."""

from __future__ import annotations

import numpy as np

from counterflex.plan.static_correction import lasting

RNG = np.random.default_rng(3)
TIME = np.cumsum(np.where(RNG.random(2000) < 0.1, 0.0, 0.008 * RNG.random(2000)))


def test_what_stays_lasts_as_a_whole() -> None:
    np.testing.assert_allclose(lasting(np.full((2000, 2), 3.0), TIME, 0.6), 3.0, rtol=1e-12)


def test_a_steady_change_lasts_away_from_the_ends() -> None:
    inside = np.abs(TIME - 0.5 * TIME[-1]) < 0.5 * TIME[-1] - 0.5
    np.testing.assert_allclose(lasting(TIME[:, None], TIME, 0.6)[inside, 0], TIME[inside], atol=1e-4)


def test_a_swing_of_a_period_does_not() -> None:
    swing = np.sin(2.0 * np.pi * TIME / 0.12)[:, None]
    inside = np.abs(TIME - 0.5 * TIME[-1]) < 0.5 * TIME[-1] - 0.5
    assert np.max(np.abs(lasting(swing, TIME, 0.6)[inside])) < 0.03
