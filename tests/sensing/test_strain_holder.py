"""Strain-gauge holder: the bridge, the closed-form cheeks, matrices of any tool, and what bridges see."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.geometry import rotation
from counterflex.sensing.strain_holder import (
    PRINTED_M,
    Gauge,
    HolderBeam,
    StrainHolder,
    force_matrix,
    printed_condition,
    regressed_matrix,
    sight,
    strain_of_voltage,
    tool_matrix,
)

BEAM = HolderBeam(0.18, 0.16, 0.015, 0.12)
GAUGES = (
    Gauge((-0.0875, 0.03, 0.03)),
    Gauge((-0.0875, -0.03, 0.14)),
    Gauge((0.0875, 0.03, 0.03)),
    Gauge((0.0875, -0.03, 0.14)),
    Gauge((0.0725, 0.0, 0.09), math.radians(45.0)),
    Gauge((0.08, 0.06, 0.05)),
)
TCP = np.array([0.07, 0.01, 0.42])


def _voltage(strain: Float) -> Float:
    """Signal of a full bridge with k = 2 at 5 V, not linearised; strain (..., 4) of R1 to R4, R2 and R4 across."""
    r = 1.0 + 2.0 * strain
    out: Float = 5.0 * (r[..., 0] / (r[..., 0] + r[..., 1]) - r[..., 3] / (r[..., 2] + r[..., 3]))
    return out


def holder() -> StrainHolder:
    return StrainHolder.designed(BEAM, GAUGES, TCP, 0.2e-6)


def test_bridge_shows_bending_and_hides_heat() -> None:
    """A bar in tension: gauges along it see eps, across it -nu eps; U / Us = k (1 + nu) eps / 2."""
    eps, nu = 100e-6, 0.3
    volts = _voltage(np.array([eps, -nu * eps, eps, -nu * eps]))
    assert volts == pytest.approx(5.0 * 2.0 * (1.0 + nu) * eps / 2.0, rel=1e-3)
    assert float(strain_of_voltage(volts)) == pytest.approx(eps, rel=1e-3)
    warm = 500e-6
    assert _voltage(np.full(4, warm)) == pytest.approx(0.0, abs=1e-15)
    both = _voltage(np.array([eps, -nu * eps, eps, -nu * eps]) + warm)
    assert both == pytest.approx(float(volts), rel=2e-3)


@given(st.floats(-1e-3, 1e-3))
def test_bridge_reading_is_odd_and_nearly_linear(eps: float) -> None:
    volts = _voltage(np.array([eps, -0.3 * eps, eps, -0.3 * eps]))
    assert abs(float(strain_of_voltage(volts)) - eps) <= 1e-3 * abs(eps) + 1e-15


def test_axial_force_is_shared_by_both_cheeks() -> None:
    S = BEAM.sensitivity([Gauge((s * 0.0875, 0.0, 0.07)) for s in (-1.0, 1.0)])
    np.testing.assert_allclose(S[:, 2], 1.0 / (2.0 * 0.015 * 0.12 * 210e9))


def test_bending_across_the_cheeks_is_that_of_a_cantilever() -> None:
    """A force along y at the clamped end's height h bends both cheeks as one: M y / (E 2 I), M = F (h - z)."""
    z, y, h = 0.05, 0.03, 0.42
    S = BEAM.sensitivity([Gauge((0.0875, y, z))])[0]
    strain = S @ np.array([0.0, 1.0, 0.0, -h, 0.0, 0.0])  # moment of a force along y at height h: -h about x
    inertia = 2.0 * 0.015 * 0.12**3 / 12.0
    assert strain == pytest.approx(-(h - z) * y / (210e9 * inertia), rel=1e-12)


def test_a_force_along_x_bends_cheeks_like_a_portal_frame() -> None:
    """Rigid ring: cheeks bend in double curvature, moment F/2 (z - L/2) plus a couple of axial forces."""
    faces = BEAM.sensitivity([Gauge((0.0875, 0.0, z)) for z in (0.02, 0.09, 0.16)])
    inner = BEAM.sensitivity([Gauge((0.0725, 0.0, z)) for z in (0.02, 0.09, 0.16)])
    load = np.array([1.0, 0, 0, 0, 0.18, 0.0])  # along x at the ring
    bending = 0.5 * (faces - inner) @ load
    assert bending[0] * bending[2] < 0.0
    assert abs(bending[1]) < 0.02 * abs(bending[0])


def test_loads_of_the_cheeks_balance_any_load() -> None:
    w = np.random.default_rng(0).standard_normal(6)
    left, right = (t @ w for t in BEAM.tip_loads())
    np.testing.assert_allclose(left[:3] + right[:3], w[:3], atol=1e-12)
    levers = np.array([[-0.08, 0.0, 0.18], [0.08, 0.0, 0.18]])
    moment = sum(f[3:] + np.cross(p, f[:3]) for f, p in zip((left, right), levers, strict=True))
    np.testing.assert_allclose(moment, w[3:], atol=1e-12)


def test_gauges_off_the_surface_are_named() -> None:
    with pytest.raises(InputError, match=r"no surface of a cheek.*72\.5 or 87\.5 mm"):
        BEAM.sensitivity([Gauge((0.081, 0.0, 0.09))])
    with pytest.raises(InputError, match="overlap"):
        HolderBeam(0.18, 0.01, 0.015, 0.12)
    with pytest.raises(InputError, match="bridges of the holder"):
        StrainHolder.designed(BEAM, GAUGES[:2], TCP, 1e-7)


def test_forces_come_back_for_any_tool_length_and_direction() -> None:
    h = holder()
    f = np.array([[120.0, -80, 60], [-30, 200, -150]])
    for p in (TCP, TCP + np.array([0.02, 0.0, 0.06])):
        strain = f @ tool_matrix(h.sensitivity, p).T
        np.testing.assert_allclose(h.forces(strain, h.matrix(p)), f, atol=1e-9)
        R = rotation.exp(np.array([0.2, -0.1, 0.7]))
        np.testing.assert_allclose(h.forces(strain, h.matrix(p, R)), f @ R, atol=1e-9)
    wrong = h.forces(f @ tool_matrix(h.sensitivity, TCP + np.array([0, 0, 0.06])).T, h.matrix())
    assert np.max(np.abs(wrong - f)) > 0.1 * np.max(np.abs(f))


def test_temperature_is_taken_off() -> None:
    h = StrainHolder(
        BEAM, GAUGES, TCP, holder().sensitivity, np.full(6, 3e-6), np.full(6, 0.3e-6), np.full(6, 1e-7), 20.0
    )
    f = np.array([10.0, 20.0, -30.0])
    strain = tool_matrix(h.sensitivity, TCP) @ f + 3e-6 + 0.3e-6 * 4.0
    np.testing.assert_allclose(h.forces(strain, h.matrix(), 24.0), f, atol=1e-9)


def test_generalised_least_squares_has_the_least_variance() -> None:
    """Gauss-Markov theorem: any other unbiased matrix has at least its variance; and it is as large as stated."""
    rng = np.random.default_rng(1)
    K = holder().sensitivity[:, :3] + 1e-9 * rng.standard_normal((6, 3))
    N = np.diag((1e-7 * np.array([1.0, 2, 1, 3, 1, 1])) ** 2)
    best = force_matrix(K, N)
    np.testing.assert_allclose(best @ K, np.eye(3), atol=1e-9)
    plain = np.linalg.pinv(K)
    assert np.all(np.diag(best @ N @ best.T) <= np.diag(plain @ N @ plain.T) + 1e-12)
    np.testing.assert_allclose(np.sqrt(np.diag(best @ N @ best.T)), sight(K, N).sigma_n)


def test_ridge_gives_up_bias_for_variance() -> None:
    K = tool_matrix(holder().sensitivity, TCP)
    N = np.eye(6) * (3e-6) ** 2
    rng = np.random.default_rng(2)
    f = 10.0 * rng.standard_normal((4000, 3))
    s = f @ K.T + 3e-6 * rng.standard_normal((4000, 6))
    free, ridge = (s @ force_matrix(K, N, prior).T - f for prior in (None, 10.0))
    assert np.mean(ridge**2) < 0.5 * np.mean(free**2)
    assert np.mean(ridge**2) == pytest.approx(
        np.trace(np.linalg.inv(K.T @ K / 9e-12 + np.eye(3) / 100.0)) / 3, rel=0.05
    )


def test_an_unseen_direction_needs_a_prior() -> None:
    K = np.zeros((6, 3))
    K[:, :2] = holder().sensitivity[:, :2]
    with pytest.raises(InputError, match="do not determine the force"):
        force_matrix(K, np.eye(6) * 1e-14)
    assert np.allclose(force_matrix(K, np.eye(6) * 1e-14, 100.0)[2], 0.0, atol=1e-6)


def test_regression_recovers_a_matrix_and_its_zero() -> None:
    rng = np.random.default_rng(3)
    M = rng.standard_normal((3, 6)) * 1e7
    s = 1e-6 * rng.standard_normal((60, 6))
    found, zero = regressed_matrix(s, s @ M.T + np.array([5.0, -3, 2]))
    np.testing.assert_allclose(found, M, rtol=1e-6)
    np.testing.assert_allclose(zero, [5.0, -3, 2], atol=1e-6)
    with pytest.raises(InputError, match="too few loads"):
        regressed_matrix(s[:5], s[:5] @ M.T)
    assert np.all(np.isfinite(regressed_matrix(s[:5], s[:5] @ M.T, ridge=0.01)[0]))


def test_printed_matrix_sees_x_and_z_alike() -> None:
    condition, cosine = printed_condition()
    assert condition == pytest.approx(8.58, abs=0.01)
    assert cosine == pytest.approx(0.944, abs=0.001)
    assert PRINTED_M.shape == (3, 6)
    turned = np.array([[-2.17, 1.58, -0.26, 3.45, 13.23, 0.46], [-5.08, -3.31, 0.83, 6.62, 17.61, 2.45]])
    np.testing.assert_array_equal(PRINTED_M[[0, 2]], turned)
