"""Figures of a fit that people are shown: held-out errors, intervals, their widths; judged by NumPy and SciPy alone."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy import stats

from counterflex.core.arrays import Bool, Float, Int
from counterflex.identify.solver.fit import Fit
from counterflex.identify.solver.holdout import GROSS, Folds, HeldOut, cross_validate, score_separate
from counterflex.identify.solver.intervals import (
    agreement,
    contradicted,
    covariance_si,
    coverage_factor,
    intervals,
    of_linear,
)
from counterflex.identify.solver.jackknife import (
    added,
    long_run,
    parts_of_groups,
    with_correlation,
    with_groups_once,
    with_jackknife,
)
from counterflex.identify.solver.parameters import Parameter, Parameters
from counterflex.identify.solver.residuals import Residuals
from counterflex.identify.solver.solve import solve

QUICK = settings(max_examples=25)
seed = st.integers(0, 2**31)


@dataclass(frozen=True, eq=False)
class Line:
    """Measurements ``y = a + b t`` with a standard deviation for each row."""

    t: Float
    y: Float
    sigma: Float
    group: Int
    name: str = "line"
    components: tuple[str, ...] = ("y m",)

    def evaluate(self, x: Float) -> Float:
        out: Float = (self.y - x[0] - x[1] * self.t)[:, None] / self.sigma
        return out

    def jacobian(self, x: Float) -> Float:
        del x
        out: Float = -np.stack([np.ones_like(self.t), self.t], axis=-1)[:, None, :] / self.sigma[:, :, None]
        return out

    def subset(self, rows: Bool) -> Line:
        return replace(self, t=self.t[rows], y=self.y[rows], sigma=self.sigma[rows], group=self.group[rows])


def line(rng: np.random.Generator, n: int, scale: float = 1.0, noise: float = 1.0) -> Line:
    t, sigma = rng.uniform(-1.0, 2.0, n), np.full((n, 1), 1e-3 * scale)
    return Line(t, 2.0 + 3.0 * t + noise * sigma[:, 0] * rng.standard_normal(n), sigma, np.arange(n))


def parameters(prior: float = np.inf, nominal: float = 0.0, free: bool = True) -> Parameters:
    return Parameters.of([
        Parameter("a", "m", 0.0, np.inf), Parameter("b", "m", nominal, prior, free=free, scale=1.0)
    ])  # fmt: skip


def held(nominal: Float, identified: Float, gross: Bool) -> HeldOut:
    n = len(nominal)
    return HeldOut(np.zeros(n, np.int64), np.arange(n), np.zeros(n, np.int64), nominal, identified, gross, ())


@QUICK
@given(seed, st.floats(0.05, 0.95))
def test_held_out_figures_are_identified_first_and_without_gross_rows(number: int, share: float) -> None:
    rng = np.random.default_rng(number)
    nominal, identified = rng.uniform(1.0, 2.0, 40), rng.uniform(0.1, 0.5, 40)
    gross = rng.random(40) < 0.2
    nominal[gross], identified[gross] = 1e3, 1e3
    found, kept = held(nominal, identified, gross), ~gross
    one, two = identified[kept], nominal[kept]
    assert found.count == kept.sum()
    assert found.mean() == pytest.approx((one.mean(), two.mean()))
    assert found.rms() == pytest.approx((np.sqrt(np.mean(one**2)), np.sqrt(np.mean(two**2))))
    assert found.largest() == pytest.approx((one.max(), two.max()))
    assert found.quantile(share) == pytest.approx((np.quantile(one, share), np.quantile(two, share)))


@settings(max_examples=8)
@given(seed, st.sampled_from(["both", "nominal", "identified"]))
def test_a_row_that_one_model_alone_misses_is_judged(number: int, missed_by: str) -> None:
    """Gross is what both models miss. A row that only one of them predicts is what a hold-out is for."""
    rng = np.random.default_rng(number)
    block = line(rng, 120)
    row = int(rng.integers(120))
    t, y = block.t.copy(), block.y.copy()
    if missed_by == "both":
        t[row], y[row] = 0.5, 200.0
    elif missed_by == "nominal":  # far along the line: the slope that was identified predicts it
        t[row], y[row] = 10.0, 2.0 + 3.0 * 10.0
    else:  # a level: the nominal slope of 0 predicts it as well as the others, the identified one does not
        t[row], y[row] = 2.0, float(np.mean(np.delete(y, row)))
    data = replace(block, t=t, y=y)
    found = cross_validate(parameters(), [data], needed=("a",), folds=Folds(5, seed=1))
    missed = [values[row] > GROSS * np.median(values) for values in (found.identified, found.nominal)]
    assert missed == [missed_by in ("both", "identified"), missed_by in ("both", "nominal")]
    assert found.gross.tolist() == [missed_by == "both" and k == row for k in range(120)]
    assert found.count == 120 - int(missed_by == "both")


@QUICK
@given(seed, st.floats(0.01, 100.0))
def test_gross_rows_are_those_that_both_models_miss_beside_their_own_block(number: int, coarse: float) -> None:
    """Errors at random, some far off for one model or for both, in blocks of different size and length."""
    rng = np.random.default_rng(number)
    blocks = [replace(line(rng, n), name=name) for n, name in ((7, "fine"), (15, "coarse"), (4, "few"))]
    scale = {"fine": 1.0, "coarse": coarse, "few": rng.uniform(0.1, 10.0)}
    made: dict[str, Float] = {
        b.name: scale[b.name]
        * rng.uniform(0.5, 1.5, (2, len(b.t)))
        * np.where(rng.random((2, len(b.t))) < 0.3, GROSS * rng.uniform(0.6, 2.0), 1.0)
        for b in blocks
    }
    known = parameters().nominal

    def error(block: Residuals, x: Float) -> Float:
        assert isinstance(block, Line)
        out: Float = made[block.name][int(np.array_equal(x, known))]
        return out

    found = score_separate(parameters(), [line(rng, 9)], blocks, error=error)
    expected = []
    for b in blocks:
        missed = [row > GROSS * np.median(row) for row in made[b.name]]
        expected += (missed[0] & missed[1]).tolist()
    assert found.gross.tolist() == expected
    assert found.identified.tolist() == np.concatenate([made[b.name][0] for b in blocks]).tolist()
    assert found.nominal.tolist() == np.concatenate([made[b.name][1] for b in blocks]).tolist()


@QUICK
@given(seed, st.floats(0.2, 5.0), st.floats(0.2, 5.0))
def test_a_covariance_does_not_depend_on_how_a_value_is_fitted(number: int, first: float, second: float) -> None:
    """In units of any size, or by its logarithm: all of it is that of the line of least squares, the cross term too."""
    block = line(np.random.default_rng(number), 30)
    items = [
        Parameter("held", "m", 7.0, 1.0, free=False),
        Parameter("a", "m", 1.0, np.inf, scale=first),
        Parameter("b", "m", 2.0, np.inf, lower=1e-3, log=True, scale=second),
    ]
    fit = solve(Parameters.of(items), [Behind(block)], robust=False)
    A = np.stack([np.ones(30), block.t], axis=1)
    expected = max(fit.sigma_factors) ** 2 * 1e-6 * np.linalg.inv(A.T @ A)
    found = covariance_si(fit)
    np.testing.assert_allclose(found[1:, 1:], expected, rtol=0.02)
    assert not found[0].any()
    assert not found[:, 0].any()
    np.testing.assert_allclose(np.sqrt(np.diag(found)), fit.sigma, rtol=1e-9)


@dataclass(frozen=True, eq=False)
class Behind:
    """A line whose two values stand behind another one that it does not depend on."""

    of: Line
    name: str = "behind"
    components: tuple[str, ...] = ("y m",)

    @property
    def sigma(self) -> Float:
        return self.of.sigma

    @property
    def group(self) -> Int:
        return self.of.group

    def evaluate(self, x: Float) -> Float:
        return self.of.evaluate(x[1:])

    def jacobian(self, x: Float) -> Float:
        return np.pad(self.of.jacobian(x[1:]), ((0, 0), (0, 0), (1, 0)))

    def subset(self, rows: Bool) -> Behind:
        return replace(self, of=self.of.subset(rows))


@QUICK
@given(seed, st.floats(0.5, 0.99))
def test_a_mirrored_quantity_has_a_mirrored_interval(number: int, level: float) -> None:
    """What is predicted under a force of the other sign: the same width, the ends exchanged and turned."""
    rng = np.random.default_rng(number)
    fit = solve(parameters(), [line(rng, 12)], robust=False)
    G = rng.normal(size=(5, 2))
    one, other = (of_linear(fit, s * G, s * (G @ fit.values), level) for s in (1.0, -1.0))
    np.testing.assert_allclose(other.sigma, one.sigma, rtol=1e-12)
    np.testing.assert_allclose(other.lower, -one.upper, rtol=1e-12)
    np.testing.assert_allclose(other.upper, -one.lower, rtol=1e-12)
    assert np.all(one.lower < one.value)
    assert np.all(one.value < one.upper)


@QUICK
@given(seed, st.floats(0.5, 0.99), st.sampled_from([1.0, 4.0]), st.integers(6, 60))
def test_intervals_are_those_of_the_line_of_least_squares(number: int, level: float, noise: float, n: int) -> None:
    """Two-sided; of Student's width where the scatter had to be taken from the data, wider with fewer rows."""
    rng = np.random.default_rng(number)
    block = line(rng, n, noise=noise)
    fit = solve(parameters(), [block], robust=False)
    exact = np.polyfit(block.t, block.y, 1)[::-1]
    np.testing.assert_allclose(fit.values, exact, rtol=1e-6)
    A = np.stack([np.ones(n), block.t], axis=1)
    factor = max(1.0, float(np.sqrt(np.sum((block.y - A @ exact) ** 2) / 1e-6 / (n - 2))))
    sigma = factor * 1e-3 * np.sqrt(np.diag(np.linalg.inv(A.T @ A)))
    np.testing.assert_allclose(fit.sigma, sigma, rtol=1e-3)
    k = coverage_factor(fit, level)
    tail = 0.5 + 0.5 * level
    assert k == pytest.approx(stats.t.ppf(tail, n - 2) if factor > 1.0 else stats.norm.ppf(tail), rel=1e-6)
    ends = intervals(fit, level)
    np.testing.assert_allclose(ends.mean(axis=1), fit.values, rtol=1e-9)
    np.testing.assert_allclose(np.diff(ends, axis=1)[:, 0], 2.0 * k * fit.sigma, rtol=1e-9)
    np.testing.assert_allclose(np.sqrt(np.diag(covariance_si(fit))), fit.sigma, rtol=1e-9)
    G = np.array([[1.0, 0.5], [2.0, -1.0]])
    derived = of_linear(fit, G, G @ fit.values, level)
    expected = np.sqrt(np.diag(G @ covariance_si(fit) @ G.T))
    np.testing.assert_allclose(derived.sigma, expected, rtol=1e-9)
    np.testing.assert_allclose(derived.upper - derived.value, derived.value - derived.lower, rtol=1e-6)


def test_the_interval_of_a_positive_value_keeps_its_ratio_and_of_a_held_one_has_no_width() -> None:
    rng = np.random.default_rng(1)
    items = [
        Parameter("a", "m", 1.0, np.inf, lower=1e-6, log=True, scale=1.0),
        Parameter("b", "m", 3.0, 1.0, free=False),
    ]
    fit = solve(Parameters.of(items), [line(rng, 8, scale=300.0)])
    wide = replace(fit, sigma=np.array([0.5 * fit.values[0], 0.2]))
    ends = intervals(wide)
    assert ends[0, 1] / wide.values[0] == pytest.approx(wide.values[0] / ends[0, 0])
    assert ends[0, 0] > 0.0
    assert ends[1].tolist() == [3.0, 3.0]


@QUICK
@given(seed, st.floats(0.0, 10.0))
def test_considered_errors_add_as_squares(number: int, share: float) -> None:
    fit = solve(parameters(), [line(np.random.default_rng(number), 20)], robust=False)
    more = added(fit, share**2 * fit.covariance)
    np.testing.assert_allclose(more.sigma, fit.sigma * np.sqrt(1.0 + share**2))
    np.testing.assert_allclose(more.covariance, fit.covariance * (1.0 + share**2))


def ar1(rng: np.random.Generator, n: int, a: float) -> Float:
    e = rng.standard_normal(n)
    out = np.empty(n)
    out[0] = e[0] / np.sqrt(1.0 - a * a)
    for k in range(1, n):
        out[k] = a * out[k - 1] + e[k]
    return out


@pytest.mark.parametrize("a", [-0.5, 0.0, 0.6, 0.9])
def test_long_run_variance_is_that_of_the_process_for_windows_of_any_length(a: float) -> None:
    """Of x_k = a x_(k-1) + e_k it is 1 / (1 - a)^2, for records of 500 and of 8000 rows; signs change nothing."""
    for n, wide in ((500, 0.5), (8000, 0.2)):
        found = [float(long_run(ar1(np.random.default_rng(k), n, a)[:, None])[0, 0]) for k in range(12)]
        assert np.mean(found) == pytest.approx(1.0 / (1.0 - a) ** 2, rel=wide)
    scores = ar1(np.random.default_rng(1), 500, a)[:, None]
    np.testing.assert_allclose(long_run(-scores), long_run(scores))


def test_correlated_rows_widen_an_interval_and_white_ones_do_not_narrow_it_to_nothing() -> None:
    """Scatter of the mean over many records against the stated standard deviation, correlated and white."""
    n = 400
    for a in (0.0, 0.8):
        values, stated = [], []
        for k in range(60):
            rng = np.random.default_rng(k)
            t = np.linspace(-1.0, 1.0, n)
            block = Line(t, 2.0 + 1e-3 * ar1(rng, n, a) * np.sqrt(1.0 - a * a), np.full((n, 1), 1e-3), np.arange(n))
            fit = with_correlation(solve(parameters(), [block], robust=False), [block])
            values.append(fit.values[0] - 2.0)
            stated.append(fit.sigma[0])
        assert float(np.mean(stated)) == pytest.approx(float(np.std(values)), rel=0.3)
    exact = Line(t, 2.0 + 3.0 * t, np.full((n, 1), 1e-3), np.arange(n))
    plain = solve(parameters(), [exact], robust=False)
    assert np.all(with_correlation(plain, [exact]).sigma >= 0.5 * plain.sigma * (1.0 - 1e-9))


@QUICK
@given(st.lists(st.integers(1, 30), min_size=6, max_size=60))
def test_parts_keep_groups_whole_whatever_their_size(sizes: list[int]) -> None:
    group = np.repeat(np.arange(len(sizes)) * 3 + 5, sizes)
    rows = len(group)
    block = Line(np.zeros(rows), np.zeros(rows), np.ones((rows, 1)), group)
    (part,) = parts_of_groups([block])
    count = len(np.unique(part))
    assert count == min(40, len(sizes))
    in_part = [len(np.unique(group[part == k])) for k in np.unique(part)]
    assert sum(in_part) == len(sizes)
    assert max(in_part) - min(in_part) <= 1


@QUICK
@given(seed, st.integers(5, 12), st.integers(1, 4))
def test_the_jackknife_of_a_level_is_the_scatter_of_its_parts(number: int, count: int, rows: int) -> None:
    """Of K means: ``sum (mean_k - mean)^2 / (K (K - 3))``, wider than Student's own for what K parts can tell."""
    rng = np.random.default_rng(number)
    group = np.repeat(np.arange(count), rows)
    y = 2.0 + np.repeat(rng.normal(size=count), rows) + 1e-3 * rng.standard_normal(count * rows)
    block = Line(np.zeros(len(y)), y, np.full((len(y), 1), 1e-3), group)
    fit = solve(parameters(free=False), [block], robust=False)
    found = with_jackknife(fit, [block], [group])
    means = y.reshape(count, rows).mean(axis=1)
    expected = np.sqrt(np.sum((means - means.mean()) ** 2) / (count * (count - 3)))
    assert found.sigma[0] == pytest.approx(max(expected, fit.sigma[0]), rel=1e-6)
    np.testing.assert_allclose(np.sqrt(np.diag(covariance_si(found)))[0], found.sigma[0], rtol=1e-9)
    assert found.sigma[1] == 0.0
    few = [np.minimum(group, 3)]
    assert with_jackknife(fit, [block], few) is fit  # four parts say nothing of their spread


@QUICK
@given(seed, st.integers(2, 4), st.integers(2, 6))
def test_copies_of_a_few_rows_count_once(number: int, count: int, copies: int) -> None:
    """A row that is there several times is one: the standard deviation of their mean, however often each is written."""
    rng = np.random.default_rng(number)
    level = 2.0 + rng.permutation(count) + 0.1 * rng.normal(size=count)
    group = np.repeat(np.arange(count), copies)
    block = Line(np.zeros(len(group)), level[group], np.full((len(group), 1), 1e-3), group)
    fit = solve(parameters(free=False), [block], robust=False)
    found = with_groups_once(fit, [block])
    assert found.sigma[0] == pytest.approx(np.std(level, ddof=1) / np.sqrt(count), rel=1e-3)
    once = replace(block, group=np.arange(len(group)))
    assert with_groups_once(fit, [once]) is fit


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_value_far_off_what_was_known_is_named_on_either_side(sign: float) -> None:
    fit = solve(parameters(prior=0.1, nominal=3.0 + sign * 0.9), [line(np.random.default_rng(2), 30)])
    ((name, size),) = contradicted(fit)
    assert name == "b"
    assert size == pytest.approx(9.0, rel=0.01)
    near = solve(parameters(prior=0.1, nominal=3.0 + sign * 0.1), [line(np.random.default_rng(2), 30)])
    assert contradicted(near) == ()


@QUICK
@given(seed, st.floats(-30.0, 30.0), st.floats(-30.0, 30.0))
def test_values_far_off_are_named_farthest_first(number: int, a_off: float, b_off: float) -> None:
    """By their own standard deviations, and only those beyond four of them."""
    items = [Parameter("a", "m", 2.0 + 0.1 * a_off, 0.1), Parameter("b", "m", 3.0 + b_off, 1.0)]
    fit = solve(Parameters.of(items), [line(np.random.default_rng(number), 40)], robust=False)
    off = {"a": abs(fit.values[0] - items[0].nominal) / 0.1, "b": abs(fit.values[1] - items[1].nominal)}
    expected = sorted((name for name in off if off[name] > 4.0), key=lambda name: -off[name])
    found = contradicted(fit)
    assert [name for name, _ in found] == expected
    assert [size for _, size in found] == pytest.approx([off[name] for name in expected])


@pytest.mark.parametrize(("prior", "seen"), [(1.0, "determined"), (0.7e-3, "partly"), (1e-4, "prior")])
def test_how_much_comes_from_the_data_is_told_by_what_they_narrow(prior: float, seen: str) -> None:
    """The data give b to 1 mm: of a value known to 1 m it is theirs, of one known to 0.7 mm half, of 0.1 mm nothing."""
    t = np.concatenate([-np.ones(50), np.ones(50)])
    block = Line(t, 2.0 + 3.0 * t, np.full((100, 1), 1e-2), np.arange(100))
    fit: Fit = solve(parameters(prior=prior, nominal=3.0), [block], robust=False)
    assert fit.seen == ("determined", seen)
    assert fit.sigma[1] == pytest.approx(1.0 / np.sqrt(1e6 + prior**-2), rel=1e-3)


@QUICK
@given(seed, st.sampled_from([1.0, 2e-3, 1e-4]), st.floats(-3.0, 3.0), st.integers(1, 3))
def test_agreement_with_what_was_known_is_that_of_its_closed_form(
    number: int, prior: float, off: float, folds: int
) -> None:
    """One known value: ``u^2 / (l (1 - l))`` of each fit is chi-squared; values that the data see make the growth."""
    rng = np.random.default_rng(number)
    fits = []
    for _ in range(folds):
        t = rng.uniform(-1.0, 2.0, 40)
        y = 2.0 + 3.0 * t + 1e-2 * rng.standard_normal(40)
        block = Line(t, y, np.full((40, 1), 1e-2), np.arange(40))
        fits.append(solve(parameters(prior=prior, nominal=3.0 + off * prior), [block], robust=False))
    found = agreement(fits)
    total = count = seen = 0.0
    for fit in fits:
        u, share = (fit.values[1] - 3.0 - off * prior) / prior, (fit.sigma[1] / prior) ** 2
        seen += sum(word != "prior" for word in fit.seen)
        if share < 0.5:
            total, count = total + u**2 / (share * (1.0 - share)), count + 1
    assert found.directions == count
    assert found.chance == pytest.approx(stats.chi2.sf(total, count) if count else 1.0, abs=1e-6)
    assert found.growth == pytest.approx(1.0 + 4.0 * seen / sum(fit.dof for fit in fits))
    assert found.agrees == (found.chance >= 0.01)
