"""Stray points are told from a surface by how crowded they are, also where they are far more."""

from __future__ import annotations

import numpy as np
import pytest

from counterflex.evaluate.inspection.cloud import crowded


@pytest.mark.parametrize("stray", [0, 2_000, 400_000])
def test_stray_points_about_a_surface_are_left_out(stray: int) -> None:
    rng = np.random.default_rng(1)
    surface = np.column_stack([rng.uniform(0.0, 60.0, (30_000, 2)), rng.normal(scale=0.02, size=30_000)])
    beside = rng.uniform(-30.0, 90.0, (stray, 3))
    kept = crowded(np.concatenate([surface, beside]), 0.3)
    assert np.mean(kept[: len(surface)]) > 0.99
    far = np.abs(beside[:, 2]) > 5.0
    assert np.mean(kept[len(surface) :][far]) < 0.02 if stray else True
