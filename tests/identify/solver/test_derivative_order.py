"""The check of Jacobians passes exact ones and catches wrong ones, however small the fault."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from derivative_check import convergence_order

STEPS = np.array([0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 1e-6, 1e-6])


def _points(arm: Any) -> tuple[Any, Float]:
    rng = np.random.default_rng(6)
    truth = arm.truth(arm.parameters(), rng)
    return arm.points(truth, rng), truth


def test_an_exact_jacobian_has_order_two(arm: Any) -> None:
    points, truth = _points(arm)
    order = convergence_order(points, truth, STEPS)
    assert np.all(order > 1.9)
    assert np.all(np.isinf(order[[0, 1, 3, 4]]))
    assert np.all(order[[2, 5, 6]] < 2.1)


@pytest.mark.parametrize("fault", [1e-6, 1e-3, -2.0])
def test_a_wrong_jacobian_is_caught(arm: Any, fault: float, monkeypatch: pytest.MonkeyPatch) -> None:
    points, truth = _points(arm)
    exact = type(points).jacobian
    scale = np.ones(9)
    scale[[3, 6]] += fault
    monkeypatch.setattr(type(points), "jacobian", lambda self, x: exact(self, x) * scale)
    order = convergence_order(points, truth, 0.01 * STEPS)
    assert np.all(order[[3, 6]] < 1.5)
    assert np.all(np.delete(order, [3, 6]) > 1.9)


def test_shapes_and_steps_are_checked(arm: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    points, truth = _points(arm)
    with pytest.raises(InputError, match="step must be above zero"):
        convergence_order(points, truth, 0.0)
    exact = type(points).jacobian
    monkeypatch.setattr(type(points), "jacobian", lambda self, x: exact(self, x)[..., :4])
    with pytest.raises(InputError, match="wrong shape"):
        convergence_order(points, truth, STEPS)
