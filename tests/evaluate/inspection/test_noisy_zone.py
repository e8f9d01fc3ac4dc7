"""Flatness of a noisy scan is extrapolated to none of its noise."""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float
from counterflex.evaluate.inspection.feature_rows import noiseless

SIGMA = 4e-6


def zones(form: Float, seed: int) -> tuple[float, Float]:
    """The zone of one noisy measurement of a form, and of 24 with the noise once more."""
    rng = np.random.default_rng(seed)
    once = form + rng.normal(scale=SIGMA, size=len(form))
    more = once + rng.normal(scale=SIGMA, size=(24, len(form)))
    return float(np.ptp(once)), np.ptp(more, axis=1)


def test_the_zone_of_a_flat_floor_is_none_and_that_of_a_bump_its_height() -> None:
    flat = np.zeros(300)
    bump = 1e-4 * np.exp(-((np.arange(300) - 150.0) ** 2) / 2.0)
    for form, height in ((flat, 0.0), (bump, 1e-4)):
        raw = np.array([zones(form, seed)[0] - height for seed in range(60)])
        mended = np.array([noiseless(*zones(form, seed)) - height for seed in range(60)])
        assert raw.mean() > 2.5 * SIGMA
        assert abs(mended.mean()) < 0.8 * SIGMA
        assert np.all(mended >= -height)
