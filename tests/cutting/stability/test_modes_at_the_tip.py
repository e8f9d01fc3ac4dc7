"""Modes at the tool tip: static compliance, modes fitted to a response."""

from __future__ import annotations

import numpy as np
import pytest

from counterflex.core.errors import InputError
from counterflex.cutting.stability import lobes
from counterflex.cutting.stability.modes import TipModes, modes_along
from counterflex.cutting.stability.process import process_of_arc
from counterflex.cutting.stability.response import Response, fitted_modes


def test_static_response_is_the_compliance_of_the_springs() -> None:
    modes = modes_along(
        np.array([10.0, 12.0]), np.full(2, 0.05), np.array([4e5, 6e5]), np.array([[3.0, 0, 0], [0, 0, 1]])
    )
    static = modes.response(np.array([0.0]))[0].real
    np.testing.assert_allclose(static, np.diag([1 / 4e5, 0.0, 1 / 6e5]), atol=1e-15)


TOOL = modes_along(
    np.array([850.0, 1400.0, 980.0]), np.array([0.03, 0.02, 0.025]), np.array([2e7, 4e7, 2.5e7]), np.eye(3)[[0, 0, 1]]
)


def test_modes_of_a_noisy_response() -> None:
    """1 % of noise: frequencies within 0.5 %, stiffness and damping within 5 %, lobes within 3 %."""
    omega = 2.0 * np.pi * np.arange(200.0, 3000.0, 4.0)
    random = np.random.default_rng(2)
    exact = TOOL.response(omega)
    noise = random.normal(size=(2, *exact.shape))
    noisy = exact + 0.01 * np.abs(exact).max() * (noise[0] + 1j * noise[1]) * (exact != 0.0)
    modes, rest = fitted_modes(Response(omega, noisy))
    order = np.argsort(TOOL.omega_rad_s)
    assert len(modes) == 3
    assert rest < 0.1
    np.testing.assert_allclose(modes.omega_rad_s, TOOL.omega_rad_s[order], rtol=5e-3)
    np.testing.assert_allclose(modes.damping_ratio, TOOL.damping_ratio[order], rtol=0.05)
    A = process_of_arc(0.0, 2.0, 1.2e9, 4e8, 3).mean
    grid = lobes.frequencies_for(TOOL)
    least = [lobes.curves(A, m.response(grid))[0].min() for m in (modes, TOOL)]
    assert least[0] == pytest.approx(least[1], rel=0.03)


@pytest.mark.parametrize(
    ("omega", "zeta"),
    [(np.array([0.0]), np.array([0.1])), (np.array([10.0]), np.array([1.0]))],
    ids=["still", "creeps"],
)
def test_bad_modes(omega: np.ndarray, zeta: np.ndarray) -> None:
    with pytest.raises(InputError):
        TipModes(omega, zeta, np.ones((3, 1)))
