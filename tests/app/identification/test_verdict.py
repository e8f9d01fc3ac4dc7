"""Outcome of an identification: better, confirmed, or refused, on a law whose truth is drawn from its own priors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from counterflex.app.identification.identify import judged
from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.errors import ModelError
from counterflex.identify.recipe import Figure, Identification
from counterflex.identify.solver.fit import Fit
from counterflex.identify.solver.holdout import cross_validate
from counterflex.identify.solver.intervals import agreement, contradicted
from counterflex.identify.solver.parameters import Parameter, Parameters
from counterflex.identify.solver.solve import solve

NOISE = 0.05
COUNT = 4
PARAMETERS = Parameters.of(
    [
        *(Parameter(f"k{i}", "N", 1.0, 0.3) for i in range(COUNT - 1)),
        Parameter("place", "m", 0.0, np.inf),
    ]
)


@dataclass(frozen=True, eq=False)
class Linear:
    """Rows ``measured = A x + noise``; the last column is a place that nothing is known of."""

    A: Float
    measured: Float
    group: Int
    sigma: Float
    name: str = "rows"
    components: tuple[str, ...] = ("f N",)

    def evaluate(self, x: Float) -> Float:
        out: Float = ((self.measured - self.A @ x) / self.sigma[:, 0])[:, None]
        return out

    def jacobian(self, x: Float) -> Float:  # noqa: ARG002
        out: Float = (-self.A / self.sigma)[:, None, :]
        return out

    def subset(self, rows: Bool) -> Linear:
        return Linear(self.A[rows], self.measured[rows], self.group[rows], self.sigma[rows])


def identified(truth: Float, rng: np.random.Generator, rows: int = 24) -> Identification:
    A = rng.standard_normal((rows, COUNT))
    measured = A @ truth + NOISE * rng.standard_normal(rows)
    block = Linear(A, measured, np.arange(rows, dtype=np.int64), np.full((rows, 1), NOISE))
    fit = solve(PARAMETERS, [block])
    mean = cross_validate(PARAMETERS, [block], needed=("place",)).mean()
    return Identification("linear", {"linear": fit}, (Figure("holdout_mean_n", "mean error", *mean),), (), ())


@pytest.mark.long
def test_true_former_values_are_confirmed_and_never_refused() -> None:
    """Half of the fits predict rows held out worse than the truth does: that is noise, not a fault of the data."""
    rng = np.random.default_rng(0)
    truth = np.array([1.0, 1.0, 1.0, 7.0])
    outcomes = []
    for _ in range(60):
        result, outcome = judged(identified(truth, rng), separate=False)
        outcomes.append(outcome)
        fit = result.fits["linear"]
        if outcome == "confirmed":
            np.testing.assert_array_equal(fit.values[:-1], 1.0)
            assert np.all(fit.sigma[:-1] < 0.3 * 0.3)
            assert np.all(fit.sigma[:-1] > 0.5 * NOISE / np.sqrt(24.0))
            assert fit.values[-1] == pytest.approx(7.0, abs=0.1)
            assert "Confirmed" in result.remarks[0]
            assert not result.changes
    assert outcomes.count("confirmed") >= 50


@pytest.mark.long
def test_the_probability_of_agreement_is_uniform_where_the_former_values_are_true() -> None:
    rng = np.random.default_rng(1)
    truth = np.array([1.0, 1.0, 1.0, 7.0])
    chances = np.array([agreement(identified(truth, rng).fits.values()).chance for _ in range(120)])
    assert np.mean(chances < 0.1) == pytest.approx(0.1, abs=0.09)
    assert np.mean(chances) == pytest.approx(0.5, abs=0.12)


@pytest.mark.parametrize("off", [0.3, 2.0])
def test_other_values_replace_the_former_ones(off: float) -> None:
    rng = np.random.default_rng(2)
    for _ in range(10):
        found = identified(np.array([1.0 + off, 1.0, 1.0 - off, 7.0]), rng)
        result, outcome = judged(found, separate=False)
        assert outcome == "better"
        assert not agreement(found.fits.values()).agrees
        assert result.fits["linear"] is found.fits["linear"]


def test_values_far_from_their_priors_are_named() -> None:
    found = identified(np.array([1.0, 3.1, 1.0, 7.0]), np.random.default_rng(3))
    ((name, distance),) = contradicted(found.fits["linear"])
    assert name == "k1"
    assert distance == pytest.approx(7.0, abs=0.3)
    assert any(
        "contradict what was known before" in line and "k1 (7." in line
        for line in judged(found, separate=False)[0].remarks
    )


def test_values_that_contradict_the_former_ones_and_predict_worse_are_refused() -> None:
    """An error that grows although the values differ beyond noise, or by far more than noise gives, is no agreement."""
    found = identified(np.array([1.3, 1.0, 1.0, 7.0]), np.random.default_rng(4))
    worse = (Figure("holdout_mean_n", "mean error", 3.0, 1.0),)
    with pytest.raises(ModelError, match="worse than the cell file"):
        judged(Identification("linear", found.fits, worse, (), ()), separate=False)
    same = identified(np.array([1.0, 1.0, 1.0, 7.0]), np.random.default_rng(5))
    with pytest.raises(ModelError, match="No gain on the data of --holdout"):
        judged(Identification("linear", same.fits, worse, (), ()), separate=True)


def test_a_fit_of_unknown_places_alone_agrees_with_nothing() -> None:
    places = Parameters.of([Parameter("place", "m", 0.0, np.inf)])
    rng = np.random.default_rng(6)
    block = Linear(np.ones((9, 1)), 3.0 + NOISE * rng.standard_normal(9), np.arange(9), np.full((9, 1), NOISE))
    fit: Fit = solve(places, [block])
    assert agreement([fit]).directions == 0
