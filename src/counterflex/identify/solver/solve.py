"""Robust weighted least squares with priors, and honest standard deviations.

Minimises ``sum_b sum_rows w |r / s_b|^2 + sum_priors u^2`` over the fit coordinates ``u`` of the free parameters.
Inside, SciPy's trust-region least squares with exact Jacobians; outside, the robust weights ``w`` of the rows and the
factors ``s_b`` of the blocks are brought up to date until they rest (iteratively reweighted least squares). The start
may be far off and a good part of the rows grossly wrong: the first rounds weigh rows as least absolute deviations do.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.progress import Progress, silent
from counterflex.identify.solver.fit import Fit, Outlier
from counterflex.identify.solver.observability import examine
from counterflex.identify.solver.parameters import Parameters
from counterflex.identify.solver.residuals import Residuals
from counterflex.identify.solver.stacked_residuals import Stacked

# Robust weights of rows, the spread of a block, and what both do to the standard deviations.
# A row's *size* is ``sqrt(mean_c r_c^2)`` of its weighted residual: 1 in the mean for noise of the stated standard
# deviation. Weights follow Hampel's three parts, so that a gross error has no influence at all.
#
# Source: Hampel et al. 1986, Robust Statistics, sections 2.6 and 6.3; Huber 1981, section 7.6 (covariance).

USUAL: Final = 0.999
"""Share of good rows that keep full weight."""
FEWEST: Final = 4
"""Rows below which a block has no outliers: nothing says which of them would be the bad one."""
_LARGEST_SHRINK: Final = 3.0


def sizes(rows: Float) -> Float:
    """(n,) size of weighted residuals (n, k)."""
    out: Float = np.sqrt(np.sum(rows**2, axis=1) / max(rows.shape[1], 1))
    return out


@cache
def usual_size(components: int, share: float = USUAL) -> float:
    """Size that this share of rows of so many components stays below, for noise of unit variance."""
    return math.sqrt(float(scipy.stats.chi2.ppf(share, components)) / components)


def spread(rows: Float, used: float = 0.0) -> float:
    """Median size over what unit noise gives, at least 1.

    Residuals of a fit are smaller than the noise: with ``used`` of the ``n k`` numbers taken up by parameters they are
    ``sqrt(1 - used / (n k))`` of it, which is undone (by a factor of 3 at most).

    Args:
        rows: (n, k) weighted residuals.
        used: Effective number of parameters that these rows determine.
    """
    n, k = rows.shape
    if n == 0 or k == 0:
        return 1.0
    # Bounded: a block that is nearly used up by its parameters would else divide what is left by almost nothing.
    remaining = max(1.0 - used / (n * k), 1.0 / _LARGEST_SHRINK**2)
    return max(1.0, float(np.median(sizes(rows))) / usual_size(k, 0.5) / math.sqrt(remaining))


def median_weights(rows: Float) -> Float:
    """(n,) weights for a start that may be far off: 1 up to the median size, then as its inverse (least absolutes)."""
    if len(rows) < FEWEST:
        return np.ones(len(rows))
    size = sizes(rows)
    typical = float(np.median(size))
    out: Float = np.minimum(1.0, typical / np.maximum(size, 1e-300)) if typical > 0.0 else np.ones(len(rows))
    return out


def hampel_weights(rows: Float, scale: float) -> Float:
    """(n,) weights: 1 up to the usual size t, t / size up to 2 t, falling to 0 at 4 t.

    ``rows``: (n, k) weighted residuals.
    """
    if len(rows) < FEWEST or rows.shape[1] == 0:
        return np.ones(len(rows))
    s = np.maximum(sizes(rows) / scale / usual_size(rows.shape[1]), 1e-300)
    influence = np.where(s <= 2.0, np.minimum(s, 1.0), np.clip((4.0 - s) / 2.0, 0.0, 1.0))
    out: Float = influence / s
    return out


def excess(rows: Float, weights: Float, scale: float, used: float, group: Int) -> float:
    """Variance of what was estimated over that promised by ``(J^T W J)^-1``, at least 1 (the square of a Birge ratio).

    ``v = sum(psi^2) / (sum(w) k - used) (sum(w) / sum(psi'))^2`` with ``psi = w r`` (Huber's covariance of a robust
    estimate, gathered into one factor): 1 for noise as stated, the Birge ratio squared for noise of another size, and
    what the weights lose for heavy tails. Where the residuals of a group have a part in common (more than chance
    gives), its repeats tell less than their number promises, and v grows by ``sum_g |sum psi|^2 / sum |psi|^2``.

    Args:
        rows: (n, k) weighted residuals at the solution.
        weights: (n,) of :func:`hampel_weights`.
        used: Effective number of parameters that these rows determine.
        group: (n,) ids of rows that belong together.
    """
    n, k = rows.shape
    total = float(np.sum(weights))
    remaining = k * total - used
    if n == 0 or k == 0 or total <= 0.0 or remaining <= 0.0:
        return 1.0
    psi = rows * weights[:, None]
    # Where Hampel's curve falls the slope is negative; with many rows there Huber's formula would divide by zero.
    slope = max(float(np.sum(_slope(rows, weights, scale))), 0.2 * total)
    v = float(np.sum(psi**2)) * total**2 / slope**2 / remaining
    return float(max(1.0, v) * _in_common(psi, group))


def _slope(rows: Float, weights: Float, scale: float) -> Float:
    """(n,) derivative of w r by r, mean over its directions: ``w + size w' / k``."""
    k = rows.shape[1]
    if np.all(weights == 1.0):
        return weights
    s = sizes(rows) / scale / usual_size(k)
    fall = np.where(s <= 1.0, 0.0, np.where(s <= 2.0, -weights, np.where(s < 4.0, -2.0 / np.maximum(s, 1.0), 0.0)))
    out: Float = weights + fall / k
    return out


def _in_common(psi: Float, group: Int) -> float:
    ids, place = np.unique(group, return_inverse=True)
    squares = float(np.sum(psi**2))
    if len(ids) < 5 or len(ids) == len(group) or squares <= 0.0:
        return 1.0
    sums = np.zeros((len(ids), psi.shape[1]))
    np.add.at(sums, place, psi)
    ratio = float(np.sum(sums**2)) / squares
    members = len(group) / len(ids)
    by_chance = math.sqrt(2.0 / (len(ids) * psi.shape[1]) * (1.0 - 1.0 / members))
    return ratio if ratio > 1.0 + 2.0 * by_chance else 1.0


OUTLIER: Final = 0.5
"""Robust weight below which a row is named as an outlier."""
_COARSE_ROUNDS = 15
_COARSE_GAIN = 0.05
_ROUNDS = 40
_DAMPED_AFTER = 10
_AT_REST = 1e-2
_COARSE_TOLERANCE = 1e-2
_LASTS = 0.75
"""Of the rounds that may still be needed, so many after each: most fits need far fewer than they may take."""
_LOOSE = 1e-6
_FEW = 10
_AT_BOUND = 1e-4
_MISFIT_FACTOR = 2.0
_BOLDER = (0.1, 0.0)
_REASONS = {
    0: "stopped after {n} evaluations of the last round without convergence: check the residuals before using the "
    "result",
    1: "converged: no small change of the values improves the fit",
    2: "converged: the misfit decreases no further",
    3: "converged: the values change no further",
    4: "converged: neither misfit nor values change further",
}


@dataclass(frozen=True)
class Stop:
    """Limits at which the solver stops."""

    tolerance: float = 1e-9  # relative change of cost, step or gradient at which the inner solver rests
    evaluations: int = 200  # most evaluations of one inner solve


def solve(
    parameters: Parameters,
    blocks: Sequence[Residuals],
    *,
    robust: bool = True,
    start: Float | None = None,
    stop: Stop | None = None,
    progress: Progress = silent,
) -> Fit:
    """Fit the free parameters to measurements and priors.

    A row keeps weight 1 while its residual is among the usual share of what noise gives, then loses it
    (:mod:`counterflex.identify.solver.solve`). Each block's standard deviations are widened by a factor of at least
    1 that holds for what its residuals show, so that neither optimistic standard deviations, heavy tails, repeats
    with errors in common nor what the model lacks makes the result look better than it is.

    ``start``: (p,) SI values to start from; None is nominal. Held parameters stay at nominal.

    Returns:
        The fit; parameters that the data do not see stay at their priors.

    Raises:
        InputError: Nothing to fit, or residuals that are not finite at the start.
    """
    stop = stop if stop is not None else Stop()
    problem = Stacked(parameters, blocks, start)
    problem.check_finite()
    u = problem.start
    if robust:
        # Hampel's weights alone would call most rows outliers of a start that is off: it needs one near the solution.
        u = _coarse(problem, u, stop, progress)
    state = _settle(problem, _State.at(problem, u, robust), robust, stop, progress)
    for share in _BOLDER:
        if _priors_too_tight(problem, state, share):
            bold = _State.at(problem, state.u, robust)
            bold.factors = _believed_more(state.factors, share)
            bold = _settle(problem, bold, robust, stop, progress)
            # Both are rests of the same iteration; the posterior says which of the two explains more with less.
            if bold.surprise(problem) < state.surprise(problem):
                state = bold
    # The rounds before rest on a loose tolerance: weights change in between, so only the last fit has to be exact.
    result = problem.fit(state.u, state.weights, state.factors, stop.tolerance, stop.evaluations)
    state.u = result.x
    reason = _REASONS[result.status].format(n=stop.evaluations)
    if not state.rested:
        reason += f"; the weights of the rows still changed after {_ROUNDS} rounds"
    return _fit(problem, state, reason, result.status > 0 and state.rested)


class _State:
    """Values, and the weights and factors that belong to them."""

    def __init__(self, u: Float, weights: list[Float], scales: list[float], factors: list[float]) -> None:
        self.u, self.weights, self.scales, self.factors = u, weights, scales, factors
        self.used = [0.0] * len(weights)
        self.rested = False

    @classmethod
    def at(cls, problem: Stacked, u: Float, robust: bool) -> _State:
        """Weights of the residuals at u, factors as large as their spread."""
        rows = problem.rows(u)
        scales = [spread(r) for r in rows]
        weights = [hampel_weights(r, s) if robust else np.ones(len(r)) for r, s in zip(rows, scales, strict=True)]
        return cls(u, weights, scales, list(scales))

    def renew(self, problem: Stacked, robust: bool, damped: bool) -> None:
        """Weights and factors of the residuals as they now are."""
        rows = problem.rows(self.u)
        _, self.used = problem.covariance(problem.triangles(self.u, self.weights, self.factors))
        for b, (block, r) in enumerate(zip(problem.blocks, rows, strict=True)):
            if robust:
                self.scales[b] = spread(r, self.used[b])
                weights = hampel_weights(r, self.scales[b])
                # Geometric mean: a row at a corner of the weights may jump between two values from round to round for
                # ever.
                self.weights[b] = np.sqrt(weights * self.weights[b]) if damped else weights
            self.factors[b] = math.sqrt(excess(r, self.weights[b], self.scales[b], self.used[b], block.group))

    def surprise(self, problem: Stacked) -> float:
        """Minus the logarithm of the posterior with the factors at their best, but for a constant."""
        counts = [float(np.sum(w)) * r.shape[1] for w, r in zip(self.weights, problem.rows(self.u), strict=True)]
        spreads = sum(n * math.log(s) for n, s in zip(counts, self.factors, strict=True))
        return float(spreads + 0.5 * np.sum((self.u * problem.known) ** 2))


def _coarse(problem: Stacked, u: Float, stop: Stop, progress: Progress) -> Float:
    """Towards the least absolute residuals, until their median hardly falls any more."""
    typical = [spread(r) for r in problem.rows(u)]
    for turn in range(_COARSE_ROUNDS):
        weights = [median_weights(r) for r in problem.rows(u)]
        result = problem.fit(u, weights, typical, _COARSE_TOLERANCE, min(_FEW, stop.evaluations))
        moved = result.x
        now = [spread(r) for r in problem.rows(moved)]
        gain = max(math.log(a / b) for a, b in zip(typical, now, strict=True))
        u, typical = moved, now
        progress(0.3 * (1.0 - _LASTS ** (turn + 1)), f"start, round {turn + 1}")
        if gain < _COARSE_GAIN:
            break
    return u


def _settle(problem: Stacked, state: _State, robust: bool, stop: Stop, progress: Progress) -> _State:
    """Rounds of fitting and weighing until the values move by next to nothing of their standard deviations."""
    for turn in range(_ROUNDS):
        result = problem.fit(state.u, state.weights, state.factors, _LOOSE, min(_FEW, stop.evaluations))
        step = result.x - state.u
        # Steps in standard deviations of the data: a direction that nothing sees may wander without delaying the rest.
        moved = math.sqrt(float(np.sum((result.jac @ step) ** 2)) / len(step))
        state.u = result.x
        before = list(state.factors)
        state.renew(problem, robust, turn >= _DAMPED_AFTER)
        progress(0.3 + 0.6 * (1.0 - _LASTS ** (turn + 1)), f"round {turn + 1}")
        grown = max(abs(math.log(a / b)) for a, b in zip(before, state.factors, strict=True))
        if turn > 0 and moved < _AT_REST and grown < _AT_REST:
            state.rested = True
            break
    return state


def _believed_more(factors: Sequence[float], share: float) -> list[float]:
    return [1.0 + share * (s - 1.0) for s in factors]


def _priors_too_tight(problem: Stacked, state: _State, share: float) -> bool:
    """Return whether to believe the data more would make residuals much smaller, by the tangent at the solution."""
    # Wide factors and narrow priors can hold each other up: residuals are large because the priors hold, and the priors
    # hold because the residuals are large.
    if max(state.factors) < _MISFIT_FACTOR or not np.any(problem.known):
        return False
    less = _believed_more(state.factors, share)
    parts = problem.triangles(state.u, state.weights, less)
    covariance, _ = problem.covariance(parts)
    pull = problem.known * state.u
    for part in parts:
        pull = pull + part[:, :-1].T @ part[:, -1]
    step = covariance @ pull
    rows = problem.rows(state.u)
    residuals = [
        (both[:, -1] - both[:, :-1] @ step).reshape(r.shape)
        for both, r in zip(problem.slopes(state.u), rows, strict=True)
    ]
    return any(spread(a) > 1.3 * spread(b) for a, b in zip(rows, residuals, strict=True))


def _fit(problem: Stacked, state: _State, reason: str, converged: bool) -> Fit:
    parameters, free = problem.parameters, problem.free
    rows = problem.rows(state.u)
    parts = problem.triangles(state.u, state.weights, state.factors)
    covariance, used = problem.covariance(parts)
    x = problem.values(state.u)
    sigma_u = np.sqrt(np.diag(covariance))
    sigma = np.zeros(len(parameters))
    sigma[free] = sigma_u * parameters.slope(x)[free]
    squares = sum(float(np.sum(w[:, None] * r**2)) for w, r in zip(state.weights, rows, strict=True))
    dof = sum(float(np.sum(w)) * r.shape[1] for w, r in zip(state.weights, rows, strict=True)) - sum(used)
    observability = examine(parameters, free, np.concatenate(parts)[:, :-1], sigma_u, problem.known > 0.0)
    at_bound = _at_bound(problem, state.u)
    return Fit(
        parameters=parameters,
        values=x,
        sigma=sigma,
        covariance=covariance,
        free_index=free,
        seen=tuple(
            # Its covariance is that of a value free to move both ways, which one at a bound is not.
            "partly" if name in at_bound and how == "determined" else how
            for name, how in zip(parameters.names, observability.seen, strict=True)
        ),
        residuals=tuple(rows),
        weights=tuple(state.weights),
        outliers=_outliers(problem.blocks, rows, state),
        sigma_factors=tuple(state.factors),
        chi2_reduced=squares / dof if dof > 0.0 else math.nan,
        dof=dof,
        rank=observability.rank,
        condition=observability.condition,
        hidden=observability.hidden,
        reason=reason,
        evaluations=problem.evaluations,
        converged=converged,
        at_bound=tuple(name for name in at_bound if observability.seen[parameters.index(name)] == "determined"),
    )


def _outliers(blocks: Sequence[Residuals], rows: Sequence[Float], state: _State) -> tuple[Outlier, ...]:
    outliers = [
        Outlier(block.name, int(i), float(size[i]), float(weight[i]))
        for block, size, weight in (
            (b, sizes(r) / s, w) for b, r, w, s in zip(blocks, rows, state.weights, state.scales, strict=True)
        )
        for i in np.flatnonzero(weight < OUTLIER)
    ]
    return tuple(sorted(outliers, key=lambda item: -item.size))


def _at_bound(problem: Stacked, u: Float) -> tuple[str, ...]:
    """Names of the free parameters that rest against a bound."""
    near: Bool = (u - problem.lower < _AT_BOUND * (1.0 + np.abs(problem.lower))) | (
        problem.upper - u < _AT_BOUND * (1.0 + np.abs(problem.upper))
    )
    return tuple(problem.parameters.names[i] for i in problem.free[near])
