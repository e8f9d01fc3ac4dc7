"""Bounds in the way: exact solutions with many of them active, from starts on them; triangles keep what they reduce."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.optimize import lsq_linear, minimize

from counterflex.core.arrays import Float
from counterflex.identify.solver.stacked_residuals import triangle, within_bounds


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10_000), rows=st.integers(1, 400), columns=st.integers(1, 9))
def test_a_triangle_keeps_squares_and_products(seed: int, rows: int, columns: int) -> None:
    rng = np.random.default_rng(seed)
    A, w = rng.standard_normal((rows, columns)), rng.random(rows)
    R = triangle(A, w)
    assert np.array_equal(R, np.triu(R))
    B = A * w[:, None]
    assert np.allclose(R.T @ R, B.T @ B, atol=1e-10 * rows)


@pytest.mark.parametrize("seed", range(10))
def test_linear_problems_are_solved_exactly(seed: int) -> None:
    rng = np.random.default_rng(seed)
    A, b = rng.standard_normal((60, 20)), 5.0 * rng.standard_normal(60)
    lower, upper = np.full(20, -0.2), np.full(20, 0.3)

    def reduced(u: Float) -> Float:
        return np.column_stack([A, A @ u - b])

    start = np.where(rng.random(20) < 0.5, lower, upper)
    found = within_bounds(reduced, start, lower, upper, 1e-10, 100)
    exact = lsq_linear(A, b, bounds=(lower, upper), method="bvls", tol=1e-14).x
    assert found.status > 0
    assert np.allclose(found.x, exact, atol=1e-7)
    assert np.sum((found.x == lower) | (found.x == upper)) >= 3


@pytest.mark.parametrize("seed", range(6))
def test_nonlinear_problem_against_another_method(seed: int) -> None:
    """Decays with positive amplitudes, half of which are truly zero, from a start on the bounds."""
    rng = np.random.default_rng(100 + seed)
    t = np.linspace(0.0, 3.0, 80)
    true = np.array([1.0, 0.0, 0.5, 0.0])
    rates = np.array([0.5, 1.5, 3.0])

    def model(u: Float) -> Float:
        out: Float = u[0] + u[1] * np.exp(-rates[0] * t) + u[2] * np.exp(-rates[1] * t * (1.0 + u[3]))
        return out

    y = model(true) + 0.02 * rng.standard_normal(80)

    def reduced(u: Float) -> Float | None:
        if np.any(u < 0.0):
            return None
        fast = np.exp(-rates[1] * t * (1.0 + u[3]))
        J = np.column_stack([np.ones(80), np.exp(-rates[0] * t), fast, -u[2] * rates[1] * t * fast])
        return np.column_stack([J, model(u) - y])

    lower, upper = np.zeros(4), np.full(4, 5.0)
    found = within_bounds(reduced, np.array([0.0, 0.0, 1.0, 0.0]), lower, upper, 1e-12, 200)
    other = min(
        (
            minimize(
                lambda u: 0.5 * np.sum((model(u) - y) ** 2), s, bounds=[(0.0, 5.0)] * 4, method="L-BFGS-B", tol=1e-15
            )
            for s in (true + 0.1, np.full(4, 0.5))
        ),
        key=lambda r: float(r.fun),
    )
    assert found.status > 0
    assert np.all((found.x >= lower) & (found.x <= upper))
    assert 0.5 * np.sum((model(found.x) - y) ** 2) <= other.fun * (1.0 + 1e-6)
