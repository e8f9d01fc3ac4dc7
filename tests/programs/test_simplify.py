"""Laws of the polyline reduction: the bound holds at every sample, ends stay, nothing needless stays."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.arrays import Float, Int
from counterflex.core.errors import InputError
from counterflex.programs.motion_rows import simplify


def deviation(s: Float, p: Float, vertices: Int) -> Float:
    """Distance of each sample from the polyline at its own parameter, written independently with np.interp."""
    at = np.stack([np.interp(s, s[vertices], p[vertices, c]) for c in range(p.shape[1])], axis=1)
    out: Float = np.linalg.norm(at - p, axis=1)
    return out


def fewest(s: Float, p: Float, tolerance: float) -> int:
    """Smallest number of vertices among the samples, by dynamic programming over all chords."""
    n = len(s)
    best = [1] + [n + 1] * (n - 1)
    for b in range(1, n):
        for a in range(b):
            if deviation(s[a : b + 1], p[a : b + 1], np.array([0, b - a])).max() <= tolerance:
                best[b] = min(best[b], best[a] + 1)
    return best[-1]


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    n=st.integers(2, 300),
    rough=st.floats(0.0, 2e-5),
    tolerance=st.floats(1e-7, 1e-4),
)
def test_bound_holds_at_every_sample_and_ends_stay(seed: int, n: int, rough: float, tolerance: float) -> None:
    rng = np.random.default_rng(seed)
    s = np.cumsum(rng.uniform(1e-4, 1e-3, n))
    p = np.cumsum(rng.normal(0.0, 1e-5, (n, 3)), axis=0) + rng.normal(0.0, rough, (n, 3))
    r = np.cumsum(rng.normal(0.0, 1e-5, (n, 3)), axis=0)
    fixed = rng.random(n) < 0.05
    vertices = simplify(s, p, tolerance, rotvec=r, tolerance_rad=2.0 * tolerance, fixed=fixed)
    assert vertices[0] == 0
    assert vertices[-1] == n - 1
    assert np.all(np.diff(vertices) > 0)
    assert set(np.flatnonzero(fixed)) <= set(vertices.tolist())
    assert deviation(s, p, vertices).max() <= tolerance * (1.0 + 1e-9) + 1e-15
    assert deviation(s, r, vertices).max() <= 2.0 * tolerance * (1.0 + 1e-9) + 1e-15


@pytest.mark.parametrize("n", [2, 3, 17, 1000])
def test_a_straight_stretch_needs_its_ends_only(n: int) -> None:
    s = np.linspace(0.0, 1.0, n)
    p = np.outer(s, [1.0, -2.0, 0.5])
    assert simplify(s, p, 1e-9).tolist() == [0, n - 1]


def test_geometrically_straight_but_late_is_not_straight() -> None:
    # All points lie on one line, but the middle one is reached 0.1 too early: geometry alone would drop it.
    s = np.array([0.0, 0.5, 1.0])
    p = np.array([[0.0, 0, 0], [0.6, 0, 0], [1.0, 0, 0]])
    assert simplify(s, p, 0.05).tolist() == [0, 1, 2]
    assert simplify(s, p, 0.11).tolist() == [0, 2]


@pytest.mark.parametrize("tolerance", [1e-4, 1e-3, 1e-2])
def test_as_few_vertices_as_dynamic_programming_on_a_curve(tolerance: float) -> None:
    s = np.linspace(0.0, 1.0, 80)
    p = np.stack([s, s * s, np.exp(s)], axis=1)
    assert len(simplify(s, p, tolerance)) == fewest(s, p, tolerance)


def test_points_at_the_same_place_may_jump() -> None:
    s = np.array([0.0, 1.0, 1.0, 2.0])
    p = np.array([[0.0, 0, 0], [1.0, 0, 0], [1.0, 1e-3, 0], [2.0, 1e-3, 0]])
    assert simplify(s, p, 1e-5).tolist() == [0, 1, 2, 3]


def test_refusals() -> None:
    p = np.zeros((3, 3))
    with pytest.raises(InputError, match="falls"):
        simplify(np.array([0.0, 2.0, 1.0]), p, 1e-6)
    with pytest.raises(InputError, match="tolerance_m"):
        simplify(np.arange(3.0), p, 0.0)
    with pytest.raises(InputError, match="not finite"):
        simplify(np.arange(3.0), p * np.nan, 1e-6)
    assert simplify(np.zeros(0), np.zeros((0, 3)), 1e-6).tolist() == []
