"""Choice of measurements: against exhaustive search, theory and chance; expected against found covariance."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.identify.design.choice import candidates_of, choose, expected_sigma, prior_information
from counterflex.identify.solver.solve import solve


def _covariance(J: Float, information: Float, chosen: Any) -> Float:
    M = np.diag(information) + sum(J[i].T @ J[i] for i in chosen)
    out: Float = np.linalg.inv(M)
    return out


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10_000), trace=st.booleans())
def test_near_the_best_of_all_choices(seed: int, trace: bool) -> None:
    rng = np.random.default_rng(seed)
    J, known = rng.standard_normal((9, 2, 4)), np.full(4, 0.1)
    target = rng.standard_normal((5, 4)) if trace else None

    def cost(chosen: Any) -> float:
        C = _covariance(J, known, chosen)
        return float(np.trace(target @ C @ target.T)) if target is not None else math.log(np.linalg.det(C))

    found = choose(J, 4, known, target=target, passes=10)
    assert len(set(found.indices.tolist())) == 4
    assert np.allclose(found.covariance, _covariance(J, known, found.indices))
    every = sorted(cost(s) for s in itertools.combinations(range(9), 4))
    mine = cost(found.indices)
    # An exchange stops where no single one helps: among the best of the 126, and never far behind the best.
    assert sum(value < mine - 1e-9 for value in every) <= 8
    # No single exchange of what was chosen is better.
    for i in range(4):
        for j in set(range(9)) - set(found.indices.tolist()):
            other = [*found.indices[:i], j, *found.indices[i + 1 :]]
            assert cost(other) >= mine - 1e-5 * max(1.0, abs(mine))


def test_a_line_is_measured_at_its_ends() -> None:
    x = np.linspace(-1.0, 1.0, 41)
    J = np.stack([np.ones(41), x], axis=1)[:, None, :]
    found = choose(J, 10, np.full(2, 1e-9), passes=20)
    assert set(found.indices.tolist()) == {0, 1, 2, 3, 4, 36, 37, 38, 39, 40}


def test_a_cubic_is_measured_at_the_points_of_theory() -> None:
    """D-optimal points of a cubic on [-1, 1]: the ends and +-1/sqrt(5) (Fedorov 1972)."""
    x = np.sort(np.concatenate([np.linspace(-1.0, 1.0, 201), [-1.0 / math.sqrt(5.0), 1.0 / math.sqrt(5.0)]]))
    J = np.vander(x, 4)[:, None, :]
    found = choose(J, 4, np.full(4, 1e-9), passes=20)
    assert np.allclose(np.sort(x[found.indices]), [-1.0, -1.0 / math.sqrt(5.0), 1.0 / math.sqrt(5.0), 1.0], atol=0.011)


def test_better_than_chance_and_as_expected(arm: Any) -> None:
    rng = np.random.default_rng(3)
    parameters = arm.parameters()
    truth = arm.truth(parameters, rng)
    many = arm.points(truth, rng, count=400)
    candidates = candidates_of(parameters, [many], truth)
    assert candidates.jacobian.shape == (400, 2, 8)
    known = prior_information(parameters)
    found = choose(candidates.jacobian, 12, known)
    chosen = np.isin(many.group, candidates.ids[found.indices])
    fit = solve(parameters, [many.subset(chosen)], robust=False, start=truth)
    expected = expected_sigma(parameters, found.covariance, truth)
    for name in ("link1.length", "axis2.offset", "axis1.compliance"):
        assert expected[name] == pytest.approx(fit.sigma_of(name), rel=0.1)
    logdet = np.linalg.slogdet(found.covariance)[1]
    by_chance = [
        np.linalg.slogdet(_covariance(candidates.jacobian, known, rng.choice(400, 12, replace=False)))[1]
        for _ in range(50)
    ]
    assert logdet < min(by_chance)


def test_first_ones_are_a_good_choice_of_fewer(arm: Any) -> None:
    rng = np.random.default_rng(4)
    parameters = arm.parameters()
    J = candidates_of(parameters, [arm.points(parameters.nominal, rng, count=200)]).jacobian
    known = prior_information(parameters)
    order = choose(J, 16, known).indices
    eight = choose(J, 8, known)
    first = np.linalg.slogdet(_covariance(J, known, order[:8]))[1]
    assert first < np.linalg.slogdet(eight.covariance)[1] + 2.0


def test_what_is_there_already_is_kept_and_counts(arm: Any) -> None:
    rng = np.random.default_rng(5)
    parameters = arm.parameters()
    J = candidates_of(parameters, [arm.points(parameters.nominal, rng, count=60)]).jacobian
    found = choose(J, 6, prior_information(parameters), already=[7, 50])
    assert found.indices[:2].tolist() == [7, 50]
    again = choose(J, 6, prior_information(parameters), already=[7, 50])
    assert np.array_equal(found.indices, again.indices)


def test_rows_of_a_group_are_one_candidate(arm: Any) -> None:
    rng = np.random.default_rng(6)
    parameters = arm.parameters()
    twice = arm.points(parameters.nominal, rng, count=20, repeats=2)
    once = arm.points(parameters.nominal, rng, count=4)
    candidates = candidates_of(parameters, [twice, once])
    assert candidates.jacobian.shape == (10, 6, 8)
    J, H = twice.jacobian(parameters.nominal), once.jacobian(parameters.nominal)
    free = np.flatnonzero(parameters.free)
    own = [J[i][:, free] * parameters.slope(parameters.nominal)[free] for i in np.flatnonzero(twice.group == 3)]
    own += [H[i][:, free] * parameters.slope(parameters.nominal)[free] for i in np.flatnonzero(once.group == 3)]
    stacked = np.vstack(own)
    assert np.allclose(candidates.jacobian[3].T @ candidates.jacobian[3], stacked.T @ stacked)


def test_refusals() -> None:
    J = np.ones((3, 1, 2))
    with pytest.raises(InputError, match="that many"):
        choose(J, 4, np.ones(2))
    with pytest.raises(InputError, match="no prior at all"):
        choose(J, 2, np.zeros(2))
