"""Masses from a tap test: recovered, better in a posture that was not tapped, and their intervals true."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError, InputError
from counterflex.files.tap_test import read_tap_test
from counterflex.plan.elastic_motion import matrices
from counterflex.plan.modes import frequency_response, modes
from counterflex.plan.tap_fit import Tap, fit_masses, frac
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.robot.model import catalog

TAPPED = np.array([0.2, -1.4, 1.9, 0.3, 0.7, -0.4])
ELSEWHERE = [np.array([-0.9, -0.8, 1.2, -1.1, 1.3, 0.5]), np.array([0.4, -1.0, 1.0, 0.2, 1.1, 0.1])]
BETA = 2e-3
HZ = np.arange(4.0, 40.0, 0.75)


@pytest.fixture(scope="module")
def arm() -> ElasticChain:
    return ElasticChain.build(catalog.load("kuka_kr300_r2500_ultra"))


def tapped(chain: ElasticChain, beta: float, seed: int) -> Tap:
    """All nine pairs of directions with 3 % noise."""
    M, stiffness, J, _ = matrices(chain, TAPPED)
    omega = 2.0 * np.pi * HZ
    G = frequency_response(M, stiffness, J, beta, (None,) * 6, omega)[:, :3, :3]
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal(G.shape) + 1j * rng.standard_normal(G.shape)
    G = G + 0.02 * np.abs(G) * noise
    f, i, k = np.meshgrid(omega, range(3), range(3), indexing="ij")
    return Tap(f.ravel(), np.eye(3)[k.ravel()], np.eye(3)[i.ravel()], G.ravel())


def other(chain: ElasticChain, seed: int) -> ElasticChain:
    """A robot whose masses are off by 25 % each and whose compliances all by one factor."""
    rng = np.random.default_rng(seed)
    mass = chain.mass * np.exp(0.25 * rng.standard_normal(chain.n))
    return replace(chain, mass=mass, compliance=chain.compliance * math.exp(0.2 * rng.standard_normal()))


def lowest(chain: ElasticChain, q: Float) -> Float:
    return modes(*matrices(chain, q)[:2]).omega_rad_s[:3]


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_frequencies_are_better_where_nobody_tapped(seed: int, arm: ElasticChain) -> None:
    true = other(arm, seed)
    fit = fit_masses(arm, TAPPED, tapped(true, BETA, seed), 4e-3, np.full(arm.n, 0.25), 0.35)
    known = fit.applied(arm)
    before = max(np.max(np.abs(lowest(arm, q) / lowest(true, q) - 1.0)) for q in ELSEWHERE)
    after = max(np.max(np.abs(lowest(known, q) / lowest(true, q) - 1.0)) for q in ELSEWHERE)
    assert after < 0.04
    assert after < 0.5 * before
    assert fit.damping_s == pytest.approx(BETA, rel=0.1)
    measured = tapped(true, BETA, seed).receptance
    assert frac(measured, fit.after) > 0.99 > frac(measured, fit.before)
    off = np.log(fit.factor * arm.mass[fit.bodies] / true.mass[fit.bodies])
    assert np.all(np.abs(off) < 3.5 * np.maximum(fit.sigma, 0.02))


def test_what_moves_nothing_stays_with_its_prior(arm: ElasticChain) -> None:
    """The column about a vertical axis carries no inertia of a body on that axis: its mass cannot be seen there."""
    fit = fit_masses(arm, TAPPED, tapped(arm, BETA, 0), BETA, np.full(arm.n, 0.15), 0.35)
    assert not np.all(fit.seen)
    assert np.any(fit.seen)
    assert np.all(np.abs(np.log(fit.factor)) < 0.1)


def test_frac_is_one_for_what_is_proportional() -> None:
    one = np.array([1.0 + 2.0j, -0.5j, 0.3])
    assert frac(one, 3.0j * one) == pytest.approx(1.0)
    assert frac(np.array([1.0, 0.0j]), np.array([0.0, 1.0j])) == pytest.approx(0.0)


def test_accelerance_and_receptance_are_the_same_file(tmp_path: Path) -> None:
    one, two = tmp_path / "a.csv", tmp_path / "b.csv"
    one.write_text("# tip\nfrequency_hz,force,motion,real_um_n,imag_um_n\n10,x,-z,1.5,-0.5\n")
    w2 = (2.0 * math.pi * 10.0) ** 2 * 1e-6
    two.write_text(f"motion,force,frequency_hz,imag_m_s2_n,real_m_s2_n\n-z,+x,10,{0.5 * w2},{-1.5 * w2}\n")
    a, b = read_tap_test(one), read_tap_test(two)
    np.testing.assert_allclose(a.receptance, [1.5e-6 - 0.5e-6j])
    np.testing.assert_allclose(b.receptance, a.receptance)
    np.testing.assert_array_equal(a.motion_base, [[0.0, 0.0, -1.0]])


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("", "no rows"),
        ("frequency_hz,force\n10,x\n", "other columns"),
        ("frequency_hz,force,motion,real_um_n,imag_um_n\n0,x,x,1,1\n", "above 0"),
        ("frequency_hz,force,motion,real_um_n,imag_um_n\n5,up,x,1,1\n", "unknown direction"),
        ("frequency_hz,force,motion,real_um_n,imag_um_n\n5,x,x,nan,1\n", "finite"),
        ("frequency_hz,force,motion,real_um_n,imag_um_n\n5,x,x,1\n", "values in a line"),
    ],
)
def test_a_damaged_file_is_told(text: str, names: str, tmp_path: Path) -> None:
    file = tmp_path / "tap.csv"
    file.write_text(text)
    with pytest.raises(FileFormatError, match=names):
        read_tap_test(file)


def test_too_few_rows_are_refused(arm: ElasticChain) -> None:
    few = Tap(np.ones(3), np.eye(3), np.eye(3), np.ones(3, dtype=np.complex128))
    with pytest.raises(InputError, match="too few rows"):
        fit_masses(arm, TAPPED, few, BETA, np.full(arm.n, 0.15), 0.35)
