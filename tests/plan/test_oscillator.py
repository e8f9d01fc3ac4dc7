"""The exact step of the damped oscillator against the matrix exponential, an ODE solver and its own laws."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.plan.bending_kernels import oscillator
from counterflex.plan.sag_and_play import swing
from counterflex.signals.preview import Mode

ZETAS = [1e-3, 0.05, 0.3, 0.999, 1.0, 1.001, 1.5, 20.0]


def matrix(dt: float, omega: float, zeta: float) -> Float:
    a, b, c, d = oscillator(dt, omega, zeta)
    return np.array([[a, b], [c, d]])


def scaled(step: Float, omega: float) -> Float:
    """In units where displacement and rate are alike."""
    out: Float = step * np.array([[1.0, omega], [1.0 / omega, 1.0]])
    return out


@pytest.mark.parametrize("zeta", ZETAS)
@pytest.mark.parametrize("phase", [1e-6, 0.02, 0.7, 3.0, 12.0])
def test_step_is_the_matrix_exponential(zeta: float, phase: float) -> None:
    omega = 50.0
    dt = phase / omega
    expected = expm(np.array([[0.0, 1.0], [-(omega**2), -2 * zeta * omega]]) * dt)
    # At exactly 1 the neighbouring damping 1 + 1e-9 is taken; near 1 the difference of two exponentials cancels.
    assert scaled(matrix(dt, omega, zeta), omega) == pytest.approx(scaled(expected, omega), abs=3e-8)


@pytest.mark.parametrize("zeta", [0.1, 1.0, 3.0])
def test_step_is_what_an_ode_solver_finds(zeta: float) -> None:
    omega, dt = 2 * np.pi * 8, 0.03
    x0, v0 = 1.0, -20.0
    found = solve_ivp(
        lambda _, y: [y[1], -(omega**2) * y[0] - 2 * zeta * omega * y[1]], (0, dt), [x0, v0], rtol=1e-10, atol=1e-12
    ).y[:, -1]
    assert matrix(dt, omega, zeta) @ [x0, v0] == pytest.approx(found, rel=1e-6)


@given(
    st.floats(1e-4, 0.05), st.floats(1e-4, 0.05), st.floats(5.0, 200.0),
    st.one_of(st.floats(1e-3, 0.99), st.floats(1.01, 30.0)),
)  # fmt: skip
@settings(max_examples=60, deadline=None)
def test_two_steps_are_one(first: float, second: float, omega: float, zeta: float) -> None:
    both = scaled(matrix(first + second, omega, zeta), omega)
    product = scaled(matrix(second, omega, zeta) @ matrix(first, omega, zeta), omega)
    assert product == pytest.approx(both, abs=1e-9)


@given(st.floats(0.0, 10.0), st.floats(1.0, 500.0), st.floats(1e-4, 50.0))
@settings(max_examples=60, deadline=None)
def test_energy_never_grows(dt: float, omega: float, zeta: float) -> None:
    step = scaled(matrix(dt, omega, zeta), omega)
    assert np.linalg.norm(step, 2) <= 1.0 + 1e-7
    assert np.all(np.isfinite(step))


def test_no_time_changes_nothing() -> None:
    for zeta in ZETAS:
        assert matrix(0.0, 50.0, zeta) == pytest.approx(np.eye(2), abs=1e-12)


@pytest.mark.parametrize(("omega", "zeta"), [(0.0, 0.1), (50.0, 0.0), (-1.0, 0.1), (float("nan"), 0.1)])
def test_a_mode_needs_a_frequency_and_damping(omega: float, zeta: float) -> None:
    with pytest.raises(InputError):
        Mode(omega, zeta)


def test_swing_is_the_step_response_of_the_mode_and_starts_at_rest() -> None:
    mode = Mode(2.0 * np.pi * 8.0, 0.1)
    time = np.linspace(0.0, 0.5, 1001)
    static = np.where(time[:, None] > 0.0, 1.0, 0.0) * np.array([1.0, -2.0])
    wd = mode.omega_rad_s * np.sqrt(1.0 - mode.damping_ratio**2)
    decay = np.exp(-mode.damping_ratio * mode.omega_rad_s * time)
    rise = 1.0 - decay * (np.cos(wd * time) + mode.damping_ratio * mode.omega_rad_s / wd * np.sin(wd * time))
    np.testing.assert_allclose(swing(static, time, mode), rise[:, None] * np.array([1.0, -2.0]), atol=1e-12)
    np.testing.assert_allclose(swing(np.full((5, 2), 3.0), np.arange(5.0), mode), 3.0)
