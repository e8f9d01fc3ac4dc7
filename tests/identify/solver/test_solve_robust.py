"""The solver: against other solvers and closed forms, far starts, gross errors, priors, bounds, factors, reasons."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.errors import InputError
from counterflex.core.progress import silent
from counterflex.identify.solver.parameters import Parameter, Parameters
from counterflex.identify.solver.solve import Stop, hampel_weights, sizes, solve, usual_size


@dataclass(frozen=True, eq=False)
class Line:
    """y = A x measured with noise: one component a row."""

    A: Float
    y: Float
    sigma: Float
    group: Int
    name: str = "line"
    components: tuple[str, ...] = ("y 1",)

    @classmethod
    def of(cls, A: Float, y: Float, sigma: float, group: Int | None = None) -> Line:
        rows = np.arange(len(y), dtype=np.int64)
        return cls(A, y, np.full((len(y), 1), sigma), rows if group is None else group)

    def evaluate(self, x: Float) -> Float:
        out: Float = (self.y - self.A @ x)[:, None] / self.sigma
        return out

    def jacobian(self, x: Float) -> Float:
        out: Float = -self.A[:, None, : len(x)] / self.sigma[:, :, None]
        return out

    def subset(self, rows: Bool) -> Line:
        return replace(self, A=self.A[rows], y=self.y[rows], sigma=self.sigma[rows], group=self.group[rows])


def _free(count: int, prior: float = np.inf) -> Parameters:
    return Parameters.of(Parameter(f"x{i}", "1", 0.0, prior) for i in range(count))


def test_linear_problem_is_the_closed_form() -> None:
    rng = np.random.default_rng(0)
    A, x, known = rng.standard_normal((40, 3)), np.array([1.0, -2.0, 0.5]), np.array([0.3, 0.5, 2.0])
    y = A @ x + 0.2 * rng.standard_normal(40)
    parameters = Parameters.of(Parameter(f"x{i}", "1", 0.0, s) for i, s in enumerate(known))
    fit = solve(parameters, [Line.of(A, y, 0.2)], robust=False)
    s2 = (0.2 * fit.sigma_factors[0]) ** 2
    C = np.linalg.inv(A.T @ A / s2 + np.diag(1.0 / known**2))
    assert np.allclose(fit.values, C @ (A.T @ y / s2), rtol=1e-6)
    assert np.allclose(fit.sigma, np.sqrt(np.diag(C)), rtol=1e-6)
    assert np.allclose(fit.correlation, C / np.sqrt(np.outer(np.diag(C), np.diag(C))), rtol=1e-6)
    assert fit.converged
    assert "converged" in fit.reason


def test_agrees_with_another_solver_on_a_nonlinear_problem(arm: Any) -> None:
    rng = np.random.default_rng(1)
    parameters = arm.parameters()
    points = arm.points(arm.truth(parameters, rng), rng, count=60)
    fit = solve(parameters, [points], robust=False)
    free = parameters.free
    x = parameters.nominal.copy()
    s = fit.sigma_factors[0]

    def cost(v: Float) -> Float:
        x[free] = v
        u = parameters.coordinates(x)
        known = np.array([p.has_prior and p.free for p in parameters])
        return np.concatenate([points.evaluate(x).reshape(-1) / s, u[known]])

    start = parameters.nominal[free]
    other = least_squares(cost, start, x_scale=np.maximum(np.abs(start), 0.1), xtol=1e-15, ftol=1e-15, gtol=1e-15)
    assert np.all(np.abs(other.x - fit.values[free]) < 1e-3 * fit.sigma[free])


@pytest.mark.parametrize("share", [0.05, 0.3])
def test_far_start_and_gross_errors(arm: Any, share: float) -> None:
    """Frame metres and radians off, rows off by 500 mm to one side: 5000 standard deviations."""
    for seed in range(4):
        rng = np.random.default_rng(seed)
        parameters = arm.parameters()
        truth = arm.truth(parameters, rng)
        truth[:3] = rng.uniform(-1.0, 1.0, 3) * [5.0, 5.0, 2.5]
        points = arm.points(truth, rng, count=200, load_n=2000.0)
        bad = rng.random(200) < share
        points.measured[bad] += 0.5 + 0.05 * rng.standard_normal((int(bad.sum()), 2))
        fit = solve(parameters, [points])
        off = (fit.values - truth)[parameters.free] / fit.sigma[parameters.free]
        assert np.max(np.abs(off)) < 4.0
        assert {o.row for o in fit.outliers} >= set(np.flatnonzero(bad).tolist())
        assert len(fit.outliers) <= bad.sum() + 2
        assert fit.outliers[0].size > 1000.0
        assert fit.sigma_factors[0] < 1.3
        assert fit.converged


def test_optimistic_standard_deviations_are_widened(arm: Any) -> None:
    rng = np.random.default_rng(2)
    parameters = arm.parameters()
    truth = arm.truth(parameters, rng)
    honest = arm.points(truth, rng, count=150, sigma=1e-3)
    claimed = replace(honest, sigma=honest.sigma / 10.0)
    fit, right = solve(parameters, [claimed]), solve(parameters, [honest])
    assert fit.sigma_factors[0] == pytest.approx(10.0, rel=0.15)
    assert fit.chi2_reduced == pytest.approx(100.0, rel=0.3)
    assert np.allclose(fit.sigma, right.sigma, rtol=0.15)


def test_blocks_are_judged_apart() -> None:
    rng = np.random.default_rng(3)
    A = rng.standard_normal((200, 2))
    x = np.array([1.0, 2.0])
    good = Line.of(A, A @ x + 0.1 * rng.standard_normal(200), 0.1)
    poor = Line.of(A, A @ x + 2.0 * rng.standard_normal(200), 0.1)
    fit = solve(_free(2), [good, poor])
    assert fit.sigma_factors[0] < 1.2
    assert fit.sigma_factors[1] == pytest.approx(20.0, rel=0.15)
    alone = solve(_free(2), [good])
    assert np.allclose(fit.sigma, alone.sigma, rtol=0.15)


def test_narrow_priors_do_not_hold_good_data_back() -> None:
    """A nominal 5 prior standard deviations off, data 1e4 times finer than the misfit at nominal."""
    rng = np.random.default_rng(4)
    A = rng.standard_normal((12, 2))
    x = np.array([0.5, -0.5])
    fit = solve(_free(2, prior=0.1), [Line.of(A, A @ x + 5e-5 * rng.standard_normal(12), 5e-5)])
    assert np.allclose(fit.values, x, atol=1e-3)
    assert fit.sigma_factors[0] < 3.0


def test_repeats_with_an_error_in_common_tell_less() -> None:
    rng = np.random.default_rng(5)
    poses, repeats = 30, 8
    A = np.repeat(rng.standard_normal((poses, 2)), repeats, axis=0)
    group = np.repeat(np.arange(poses), repeats)
    noise = 0.1 * rng.standard_normal(poses * repeats)
    shared = np.repeat(0.1 * rng.standard_normal(poses), repeats)
    x = np.array([1.0, 2.0])
    fit = solve(_free(2), [Line.of(A, A @ x + noise + shared, 0.1, group)])
    means = np.linalg.inv(A[::repeats].T @ A[::repeats]) * (0.01 + 0.01 / repeats)
    assert np.allclose(fit.sigma, np.sqrt(np.diag(means)), rtol=0.35)
    apart = solve(_free(2), [Line.of(A, A @ x + noise, 0.1, group)])
    assert apart.sigma_factors[0] < 1.3


def test_bounds_hold_and_are_named() -> None:
    rng = np.random.default_rng(6)
    A = rng.standard_normal((50, 2))
    parameters = Parameters.of(
        [Parameter("stiff", "1", 0.5, np.inf, lower=0.0), Parameter("other", "1", 0.0, np.inf, upper=9.0)]
    )
    fit = solve(parameters, [Line.of(A, A @ [-0.3, 2.0] + 0.01 * rng.standard_normal(50), 0.01)])
    assert fit.value("stiff") == pytest.approx(0.0, abs=1e-4)
    assert fit.at_bound == ("stiff",)
    free = solve(parameters, [Line.of(A, A @ [0.3, 2.0] + 0.01 * rng.standard_normal(50), 0.01)])
    assert free.at_bound == ()


def test_logarithmic_parameter_stays_positive() -> None:
    rng = np.random.default_rng(7)
    A = rng.standard_normal((50, 1))
    parameters = Parameters.of([Parameter("c", "1", 1.0, 1.0, log=True)])
    fit = solve(parameters, [Line.of(A, A @ [3.0] + 0.01 * rng.standard_normal(50), 0.01)])
    assert fit.value("c") == pytest.approx(3.0, abs=4 * fit.sigma_of("c"))
    assert fit.sigma_of("c") == pytest.approx(0.01 / np.linalg.norm(A), rel=0.3)
    against = solve(parameters, [Line.of(A, A @ [-3.0] + 0.01 * rng.standard_normal(50), 0.01)])
    assert against.value("c") > 0.0


def test_unseen_parameters_stay_at_their_priors(arm: Any) -> None:
    rng = np.random.default_rng(8)
    parameters = arm.parameters()
    points = arm.points(parameters.nominal, rng, load_n=0.0)
    fit = solve(parameters, [points])
    for name in ("axis1.compliance", "axis2.compliance"):
        i = parameters.index(name)
        assert fit.values[i] == pytest.approx(parameters.nominal[i])
        assert fit.sigma[i] == pytest.approx(0.5 * parameters.nominal[i], rel=1e-6)
        assert fit.seen[i] == "prior"
    assert fit.rank == 6
    assert fit.dof == pytest.approx(80.0 - 6.0, abs=0.2)


def test_one_more_free_parameter_without_data_or_prior_changes_nothing() -> None:
    rng = np.random.default_rng(9)
    A = rng.standard_normal((40, 2))
    y = A @ [1.0, 2.0] + 0.1 * rng.standard_normal(40)
    fit = solve(_free(2), [Line.of(A, y, 0.1)])
    more = solve(_free(3), [Line.of(np.hstack([A, np.zeros((40, 1))]), y, 0.1)])
    assert np.allclose(more.values, [*fit.values, 0.0], atol=1e-6)
    assert np.allclose(more.sigma[:2], fit.sigma, rtol=1e-4)
    assert more.sigma[2] > 1e3
    assert more.seen[2] == "prior"


def test_very_different_sizes_cost_no_digits() -> None:
    """A parameter seen 1e9 times better than its neighbour leaves the neighbour's prior as it is."""
    A = np.diag([1e12, 1.0, 0.0])
    parameters = Parameters.of(
        [Parameter("a", "1", 0.0, np.inf), Parameter("b", "1", 0.0, 1.0), Parameter("c", "1", 0.0, 2.0)]
    )
    fit = solve(parameters, [Line.of(A, np.array([1e12, 1.0, 0.0]), 1.0)], robust=False)
    assert np.allclose(fit.sigma, [1e-12, np.sqrt(0.5), 2.0], rtol=1e-6)


def test_few_rows_have_no_outliers() -> None:
    A = np.ones((3, 1))
    fit = solve(_free(1), [Line.of(A, np.array([1.0, 1.0, 50.0]), 0.1)])
    assert fit.outliers == ()
    assert fit.value("x0") == pytest.approx(52.0 / 3.0)
    assert fit.sigma_factors[0] > 100.0


def test_weights_are_continuous_and_redescending() -> None:
    t = usual_size(3)
    size = np.linspace(0.0, 5.0, 2001) * t
    rows = size[:, None] * np.ones((1, 3))
    assert np.allclose(sizes(rows), size)
    w = hampel_weights(rows, 1.0)
    assert np.all(w[size <= t] == 1.0)
    assert np.all(w[size >= 4.0 * t] == 0.0)
    assert np.max(np.abs(np.diff(w))) < 0.01
    assert np.max(w * size) == pytest.approx(t)


def test_too_few_evaluations_are_said(arm: Any) -> None:
    rng = np.random.default_rng(10)
    parameters = arm.parameters()
    truth = arm.truth(parameters, rng)
    truth[:3] = [4.0, -3.0, 2.0]
    fit = solve(parameters, [arm.points(truth, rng)], stop=Stop(evaluations=1))
    assert not fit.converged
    assert "without convergence" in fit.reason


def test_refusals_and_progress(arm: Any) -> None:
    rng = np.random.default_rng(11)
    parameters = arm.parameters()
    points = arm.points(parameters.nominal, rng)
    with pytest.raises(InputError, match="nothing to fit"):
        solve(parameters.with_fixed(parameters.names), [points])
    with pytest.raises(InputError, match="nothing to fit"):
        solve(parameters, [points.subset(np.zeros(40, dtype=np.bool_))])
    with pytest.raises(InputError, match="start"):
        solve(parameters, [points], start=np.zeros(2))
    points.measured[7, 1] = np.nan
    with pytest.raises(InputError, match="points: row 7"):
        solve(parameters, [points])
    points.measured[7, 1] = 0.0
    told: list[float] = []

    def progress(fraction: float, what: str = "") -> None:
        told.append(fraction)

    solve(parameters, [points], progress=progress)
    assert told == sorted(told)
    assert 0.0 < told[0] <= told[-1] <= 1.0
    silent(1.0)
