"""Which drives have periodic errors, decided by what they do to data not used.

Around a fit of the geometry everything is linear to first order, so each choice of orders is tried by a linear least
squares with priors on four fifths of the poses and scored on the rest. An axis gets the order of the ladder that lowers
the mean position error of the held-out poses most, if by more than :data:`GAIN`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.identify.arm_geometry import ArmGeometry, PeriodicTerm
from counterflex.identify.fit import Fit
from counterflex.identify.geometry_setup import Setup
from counterflex.identify.holdout import fold_of_groups
from counterflex.identify.pose_residuals import TrackerResiduals

LADDER: Final = (0, 1, 2, 4, 8, 12, 16, 20, 24)
GAIN: Final = 0.02
ENOUGH: Final = 150
"""Fewest poses with which periodic errors are looked for at all."""
_AXES = 6
_SEED = 7  # other folds than those that the headline figure uses


def choose_orders(setup: Setup, fit: Fit, prior_rad: float) -> dict[int, int]:
    """Orders 1..k of the periodic errors of each axis that hold-out wants.

    Args:
        setup: Of the geometry without periodic errors.
        fit: Of its blocks.
        prior_rad: Standard deviation of an amplitude.

    Returns:
        k by axis 0..5, only where above 0.
    """
    pairs = [(b, w) for b, w in zip(setup.blocks, fit.weights, strict=True) if isinstance(b, TrackerResiduals)]
    if sum(len(b.group) for b, _ in pairs) < ENOUGH:
        return {}
    top = LADDER[-1]
    p = len(fit.values)
    x = np.concatenate([fit.values, np.zeros(2 * top * _AXES)])
    terms = tuple(
        PeriodicTerm(axis, k, p + 2 * (axis * top + k - 1), p + 2 * (axis * top + k - 1) + 1)
        for axis in range(_AXES)
        for k in range(1, top + 1)
    )
    step = np.array([q.unit_step * (v if q.log else 1.0) for q, v in zip(setup.parameters, fit.values, strict=True)])
    known = np.array([q.has_prior for q in setup.parameters])
    scale = np.concatenate([step, np.full(2 * top * _AXES, prior_rad)])
    prior = np.concatenate([known, np.ones(2 * top * _AXES)]).astype(np.float64)
    folds = fold_of_groups([b.group for b, _ in pairs], seed=_SEED)
    tables = []
    for (block, weight), factor, fold in zip(pairs, _factors(setup, fit), folds, strict=True):
        if not isinstance(block.arm, ArmGeometry):
            continue
        wide = replace(block, arm=replace(block.arm, layout=replace(block.arm.layout, periodic=terms)))
        J = -wide.jacobian(x) * scale
        tables.append((J, block.evaluate(fit.values), np.sqrt(weight) / factor, block.sigma[:, :3], fold))
    # Priors pull towards nominal, not towards the fit.
    pull = np.concatenate([fit.parameters.coordinates(fit.values), np.zeros(2 * top * _AXES)]) * prior
    score = _Score(tables, prior, pull, p, top)
    chosen = dict.fromkeys(range(_AXES), 0)
    best = score.of(chosen)
    for _ in range(2):
        before = best
        for axis in range(_AXES):
            trials = {k: score.of({**chosen, axis: k}) for k in LADDER if k != chosen[axis]}
            k, error = min(trials.items(), key=lambda item: item[1])
            if error < best * (1.0 - GAIN):
                chosen[axis], best = k, error
        if best > before * (1.0 - GAIN):
            break
    return {axis: k for axis, k in chosen.items() if k > 0}


def _factors(setup: Setup, fit: Fit) -> list[float]:
    return [f for b, f in zip(setup.blocks, fit.sigma_factors, strict=True) if isinstance(b, TrackerResiduals)]


class _Score:
    """Mean position error of held-out poses, by linear least squares, for any choice of orders."""

    def __init__(
        self, tables: Sequence[tuple[Float, Float, Float, Float, Int]], prior: Float, pull: Float, p: int, top: int
    ) -> None:
        self.p, self.top, self.prior, self.pull = p, top, prior, pull
        self.tables = tables
        self.folds = sorted({int(f) for *_, fold in tables for f in np.unique(fold)})
        self.normal: dict[int, tuple[Float, Float]] = {}
        for f in self.folds:
            A, y = np.zeros((len(prior), len(prior))), np.zeros(len(prior))
            for J, r, w, _, fold in tables:
                use = fold != f
                rows = (J[use] * w[use, None, None]).reshape(-1, len(prior))
                A += rows.T @ rows
                y += rows.T @ (r[use] * w[use, None]).reshape(-1)
            self.normal[f] = (A, y)

    def of(self, orders: dict[int, int]) -> float:
        keep = np.concatenate(
            [np.arange(self.p)]
            + [self.p + 2 * axis * self.top + np.arange(2 * k) for axis, k in sorted(orders.items())]
        ).astype(np.int64)
        errors = []
        for f in self.folds:
            A, y = self.normal[f]
            M = A[np.ix_(keep, keep)] + np.diag(self.prior[keep]) + 1e-9 * np.eye(len(keep))
            u = np.linalg.solve(M, y[keep] - self.pull[keep])
            for J, r, w, sigma, fold in self.tables:
                mine = (fold == f) & (w > 0.0)
                off = (r[mine, :3] - J[mine][:, :3][:, :, keep] @ u) * sigma[mine]
                errors.append(np.linalg.norm(off, axis=1))
        return float(np.mean(np.concatenate(errors)))
