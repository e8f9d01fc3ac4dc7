"""Robust weighted least squares with priors, and honest standard deviations.

Minimises ``sum_b sum_rows w |r / s_b|^2 + sum_priors u^2`` over the fit coordinates ``u`` of the free parameters.
Inside, SciPy's trust-region least squares with exact Jacobians; outside, the robust weights ``w`` of the rows and the
factors ``s_b`` of the blocks are brought up to date until they rest (iteratively reweighted least squares).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import chi2

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, silent
from counterflex.identify.fit import Fit, Outlier
from counterflex.identify.observability import examine
from counterflex.identify.parameters import Parameters
from counterflex.identify.residuals import Residuals

USUAL = 0.999
"""Share of good rows that keep full weight."""
_ROUNDS = 30
_RESTS = 1e-3


@dataclass(frozen=True)
class Stop:
    """When the solver stops.

    Attributes:
        tolerance: Relative change of cost, step or gradient at which the inner solver rests.
        evaluations: Most evaluations of one inner solve.
    """

    tolerance: float = 1e-10
    evaluations: int = 200


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

    A row keeps weight 1 while its residual is among the :data:`USUAL` share of what noise gives, then loses it
    (Hampel's three parts: constant influence up to twice that size, none beyond four times). Each block's residuals
    are divided by a factor of at least 1 that makes their median what the stated standard deviations promise, so that
    neither optimistic standard deviations nor what the model lacks makes the result look better than it is.

    Args:
        parameters: What to find.
        blocks: Measurements.
        robust: False gives every row full weight.
        start: (p,) SI values to start from; None is nominal.
        stop: When to stop.
        progress: Told about rounds.

    Returns:
        The fit; parameters that the data do not see stay at their priors.

    Raises:
        InputError: Nothing to fit, or residuals that are not finite at the start.
    """
    free = np.flatnonzero(parameters.free)
    if len(free) == 0 or not blocks or sum(len(b.group) for b in blocks) == 0:
        raise InputError("there is nothing to fit", value=f"{len(free)} free parameters, {len(blocks)} blocks")
    stop = stop if stop is not None else Stop()
    lower, upper = parameters.bounds()
    prior = np.array([p.has_prior for p in parameters.items], dtype=np.bool_)[free].astype(np.float64)
    full = parameters.coordinates(parameters.nominal if start is None else start)
    counter = 0

    def values(u: Float) -> Float:
        full[free] = u
        return parameters.values(full)

    def weighted(rows: Float, weight: Float, factor: float) -> Float:
        out: Float = (rows * np.sqrt(weight)[:, None] / factor).reshape(-1)
        return out

    weights = [np.ones(len(b.group)) for b in blocks]
    factors = [1.0] * len(blocks)
    u = np.clip(full[free], lower[free], upper[free])
    first = [b.evaluate(values(u)) for b in blocks]
    for block, rows in zip(blocks, first, strict=True):
        if not np.all(np.isfinite(rows)):
            row = int(np.argwhere(~np.isfinite(rows))[0, 0])
            raise InputError("a residual is not finite", where=f"{block.name}: row {row}")
    if robust:
        factors = [_factor(rows) for rows in first]
        weights = [_weights(rows, factor) for rows, factor in zip(first, factors, strict=True)]

    def cost(u: Float) -> Float:
        nonlocal counter
        counter += 1
        x = values(u)
        parts = [weighted(b.evaluate(x), w, s) for b, w, s in zip(blocks, weights, factors, strict=True)]
        return np.concatenate([*parts, prior * u])

    def slope(u: Float) -> Float:
        x = values(u)
        scale = parameters.slope(x)[free]
        parts = [
            (b.jacobian(x)[:, :, free] * scale * (np.sqrt(w) / s)[:, None, None]).reshape(-1, len(free))
            for b, w, s in zip(blocks, weights, factors, strict=True)
        ]
        return np.concatenate([*parts, np.diag(prior)])

    reason = ""
    for turn in range(_ROUNDS):
        result = least_squares(
            cost,
            u,
            slope,
            bounds=(lower[free], upper[free]),
            method="trf",
            x_scale=1.0,
            ftol=stop.tolerance,
            xtol=stop.tolerance,
            gtol=stop.tolerance,
            max_nfev=stop.evaluations,
        )
        u, reason = np.asarray(result.x), str(result.message)
        met = [b.evaluate(values(u)) for b in blocks]
        new_factors = [_factor(r) for r in met]
        new_weights = [_weights(r, s) if robust else np.ones(len(r)) for r, s in zip(met, new_factors, strict=True)]
        change = max(
            [float(np.max(np.abs(a - b), initial=0.0)) for a, b in zip(weights, new_weights, strict=True)]
            + [abs(math.log(a / b)) for a, b in zip(factors, new_factors, strict=True)]
        )
        weights, factors = new_weights, new_factors
        progress(min(0.95, (turn + 1) / 10), f"round {turn + 1}")
        if change < _RESTS:
            break
    else:
        reason += f" Weights still changed by {change:.2g} after {_ROUNDS} rounds."
    x = values(u)
    J = slope(u)
    data_rows = J[: -len(free)]
    information = data_rows.T @ data_rows
    covariance = _inverse(information + np.diag(prior))
    sigma_u = np.sqrt(np.diag(covariance))
    sigma = np.zeros(len(parameters))
    sigma[free] = sigma_u * parameters.slope(x)[free]
    used = float(np.trace(covariance @ information))
    squares = sum(float(np.sum(w[:, None] * r**2)) for w, r in zip(weights, met, strict=True))
    count = sum(float(np.sum(w) * r.shape[1]) for w, r in zip(weights, met, strict=True))
    dof = count - used
    found = examine(parameters, free, data_rows, sigma_u, prior > 0.0)
    return Fit(
        parameters=parameters,
        values=x,
        sigma=sigma,
        covariance=covariance,
        free_index=free.astype(np.int64),
        seen=found.seen,
        residuals=tuple(met),
        weights=tuple(weights),
        outliers=_outliers(blocks, met, weights, factors),
        sigma_factors=tuple(factors),
        chi2_reduced=squares / dof if dof > 0.0 else math.nan,
        dof=dof,
        rank=found.rank,
        condition=found.condition,
        hidden=found.hidden,
        reason=reason,
        evaluations=counter,
    )


def _sizes(rows: Float) -> Float:
    out: Float = np.sqrt(np.sum(rows**2, axis=1) / rows.shape[1])
    return out


def _factor(rows: Float) -> float:
    """Median size of a block's residuals over what unit noise gives, at least 1."""
    if len(rows) == 0:
        return 1.0
    expected = math.sqrt(float(chi2.ppf(0.5, rows.shape[1])) / rows.shape[1])
    return max(1.0, float(np.median(_sizes(rows))) / expected)


def _weights(rows: Float, factor: float) -> Float:
    """Hampel's weights of rows: 1 up to the usual size t, t / size up to 2 t, falling to 0 at 4 t."""
    t = math.sqrt(float(chi2.ppf(USUAL, rows.shape[1])) / rows.shape[1])
    size = np.maximum(_sizes(rows) / factor / t, 1e-300)
    out: Float = np.where(
        size <= 1.0, 1.0, np.where(size <= 2.0, 1.0 / size, np.clip((4.0 - size) / 2.0, 0.0, 1.0) / size)
    )
    return out


def _outliers(
    blocks: Sequence[Residuals], rows: Sequence[Float], weights: Sequence[Float], factors: Sequence[float]
) -> tuple[Outlier, ...]:
    found = [
        Outlier(block.name, int(i), float(size[i]), float(weight[i]))
        for block, size, weight in (
            (b, _sizes(r) / s, w) for b, r, w, s in zip(blocks, rows, weights, factors, strict=True)
        )
        for i in np.flatnonzero(weight < 0.5)
    ]
    return tuple(sorted(found, key=lambda item: -item.size))


def _inverse(A: Float) -> Float:
    """Inverse of a symmetric positive semidefinite matrix; directions without information get a huge variance."""
    values, vectors = np.linalg.eigh(0.5 * (A + A.T))
    floor = max(float(values[-1]), 1e-300) * 1e-15
    out: Float = (vectors / np.maximum(values, floor)) @ vectors.T
    return out
