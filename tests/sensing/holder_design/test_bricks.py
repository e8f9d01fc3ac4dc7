"""Finite elements of bricks against closed forms: a square tube as a cantilever, a bar, rigid motion, convergence."""

from __future__ import annotations

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.sensing.holder_design.bricks import Bricks, Solved, solve

E_PA, NU = 210e9, 0.3
G_PA = E_PA / (2.0 * (1.0 + NU))
A_M, T_M, L_M = 0.1, 0.01, 0.6


def tube(cells: int, length_m: float = L_M) -> Bricks:
    """A square tube along z."""
    planes = np.array([-0.5 * A_M, -0.5 * A_M + T_M, 0.0, 0.5 * A_M - T_M, 0.5 * A_M])
    filled = np.ones((4, 4, cells), dtype=np.bool_)
    filled[1:3, 1:3] = False
    return Bricks(planes, planes, np.linspace(0.0, length_m, cells + 1), filled)


@pytest.fixture(scope="module")
def solved() -> Solved:
    return solve(tube(24), E_PA, NU)


INNER_M = A_M - 2.0 * T_M
AREA_M2 = A_M**2 - INNER_M**2
I_M4 = (A_M**4 - INNER_M**4) / 12.0
SHEAR = 20.0 * (1.0 + NU) / (48.0 + 39.0 * NU)
"""Shear coefficient of a thin-walled square tube (Cowper 1966)."""


def compliance(one: Solved) -> Float:
    return np.asarray(np.linalg.inv(one.stiffness), dtype=np.float64)


def test_bending_is_timoshenko_s_and_not_euler_bernoulli_s(solved: Solved) -> None:
    """Wall a tenth of the width: Cowper's thin-wall coefficient and the held ends leave 1.5 %."""
    C = compliance(solved)
    bernoulli = L_M**3 / (3.0 * E_PA * I_M4)
    timoshenko = bernoulli + L_M / (SHEAR * G_PA * AREA_M2)
    assert C[0, 0] == pytest.approx(timoshenko, rel=0.015)
    assert C[1, 1] == pytest.approx(C[0, 0], rel=1e-9)
    assert C[0, 0] > 1.04 * bernoulli
    assert C[4, 4] == pytest.approx(L_M / (E_PA * I_M4), rel=0.015)
    assert C[0, 4] == pytest.approx(L_M**2 / (2.0 * E_PA * I_M4), rel=0.015)


def test_tension_and_torsion(solved: Solved) -> None:
    """Tension: the ends cannot contract. Torsion: Bredt's tube and the walls' own; warping is held at both ends."""
    C = compliance(solved)
    assert C[2, 2] == pytest.approx(L_M / (E_PA * AREA_M2), rel=0.01)
    middle = A_M - T_M
    J = middle**3 * T_M + 4.0 * middle * T_M**3 / 3.0
    assert C[5, 5] == pytest.approx(L_M / (G_PA * J), rel=0.06)


def test_strain_half_way_is_that_of_the_bending_moment(solved: Solved) -> None:
    points = np.array([[0.5 * A_M, 0.01, 0.5 * L_M - 1e-6], [-0.5 * A_M, 0.0, 0.5 * L_M], [0.5 * A_M - T_M, 0.0, 0.3]])
    eps = solved.strain(points) @ compliance(solved)[:, 0]
    expected = -0.5 * L_M * points[:, 0] / (E_PA * I_M4)
    np.testing.assert_allclose(eps[:, 2, 2], expected, rtol=2e-3)
    np.testing.assert_allclose(eps[:, 1, 1], -NU * expected, rtol=0.03)


def test_stiffness_is_symmetric_positive_and_settles_with_the_mesh() -> None:
    values = []
    for cells in (6, 12, 24):
        k = solve(tube(cells), E_PA, NU).stiffness
        np.testing.assert_allclose(k, k.T, rtol=0.0, atol=1e-9 * np.abs(k).max())
        assert np.linalg.eigvalsh(k)[0] > 0.0
        values.append(np.linalg.inv(k)[0, 0])
    steps = np.diff(values)
    assert np.all(steps > 0.0), "displacement elements are too stiff, and less so with more of them"
    assert steps[1] < 0.5 * steps[0]
    assert steps[1] < 5e-3 * values[-1]


def test_a_body_that_falls_apart_and_bad_constants_are_refused() -> None:
    body = tube(6)
    body.filled[:, :, 3] = False
    with pytest.raises(InputError, match="falls apart"):
        solve(body, E_PA, NU)
    with pytest.raises(InputError, match="Poisson"):
        solve(tube(6), E_PA, 0.5)
    with pytest.raises(InputError, match="do not increase"):
        Bricks(np.array([0.0, 0.0]), np.array([0.0, 1.0]), np.array([0.0, 1.0]), np.ones((1, 1, 1), dtype=np.bool_))
    with pytest.raises(InputError, match="outside of the body"):
        solve(tube(6), E_PA, NU).strain(np.array([[0.0, 0.0, 0.1]]))
