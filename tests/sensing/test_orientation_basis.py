"""Functions of the orientation: independent, of the rotation alone, and what the printed quaternion terms span."""

from __future__ import annotations

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.geometry import rotation
from counterflex.sensing.flange_sensor import COUNTS, degree_of, orientation_basis, orientation_basis_slope


def turns(count: int, seed: int = 0) -> Float:
    q = np.random.default_rng(seed).standard_normal((count, 4))
    return rotation.from_quat_wxyz(q)


def test_the_functions_are_orthonormal_over_all_rotations() -> None:
    phi = np.hstack([np.ones((40_000, 1)), orientation_basis(turns(40_000), 2)])
    gram = phi.T @ phi / len(phi)
    np.testing.assert_allclose(gram, np.eye(35), atol=0.04)


def test_no_column_repeats_another() -> None:
    phi = np.hstack([np.ones((500, 1)), orientation_basis(turns(500, 1), 2)])
    assert np.linalg.matrix_rank(phi) == 35
    assert np.linalg.cond(phi) < 3.0


def test_the_fifteen_printed_terms_hold_ten_functions_of_the_orientation() -> None:
    q = np.random.default_rng(2).standard_normal((300, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    products = np.stack([q[:, i] * q[:, j] for i in range(4) for j in range(i, 4)], axis=1)
    printed = np.hstack([np.ones((300, 1)), q, products])
    assert np.linalg.matrix_rank(printed) == 14  # the squares add up to the constant
    ours = np.hstack([np.ones((300, 1)), orientation_basis(rotation.from_quat_wxyz(q), 1)])
    assert np.linalg.matrix_rank(ours) == 10
    assert np.linalg.matrix_rank(np.hstack([ours, products]), tol=1e-9) == 10  # the same space
    flipped = np.hstack([np.ones((300, 1)), orientation_basis(rotation.from_quat_wxyz(-q), 1)])
    np.testing.assert_allclose(flipped, ours, atol=1e-14)


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_slope_is_the_derivative(degree: int) -> None:
    R = turns(7, 3)
    slope = orientation_basis_slope(R, degree)
    assert slope.shape == (7, COUNTS[degree], 3)
    for k in range(3):
        step = np.zeros(3)
        step[k] = 1e-5
        up = orientation_basis(R @ rotation.exp(step), degree)
        down = orientation_basis(R @ rotation.exp(-step), degree)
        np.testing.assert_allclose((up - down) / 2e-5, slope[..., k], atol=1e-9)


def test_other_degrees_are_refused() -> None:
    with pytest.raises(InputError, match="degree"):
        orientation_basis(np.eye(3), 3)
    with pytest.raises(InputError, match="functions of the orientation"):
        degree_of(15)
