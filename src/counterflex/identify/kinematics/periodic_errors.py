"""Choose periodic errors of the drives: a few of many orders, taken one by one, decided on data not used.

Around a fit of the geometry everything is linear to first order. Of all harmonics of all axes up to :data:`HIGHEST`
(gears of robots turn some 100 times per turn of the axis and err once or twice in each) that one is taken which lowers
the misfit most, all geometry free beside it, then the next, as long as chance does not explain it (orthogonal matching
pursuit). How many of them stay is decided by the mean position error of poses held out.

Source: J. Tropp, A. Gilbert, IEEE Trans. Inf. Theory 53 (2007) 4655 (orthogonal matching pursuit).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.progress import Progress, share_of, silent
from counterflex.identify.geometry.arm_geometry import ArmGeometry, PeriodicTerm
from counterflex.identify.geometry.pose_residuals import TrackerResiduals
from counterflex.identify.kinematics.setup import CalibrationSetup
from counterflex.identify.solver.fit import Fit
from counterflex.identify.solver.holdout import fold_of_groups

HIGHEST: Final = 220
"""Highest order that is looked for."""
MOST: Final = 90
"""Harmonics in all."""
GAIN: Final = 0.02
"""Least relative decrease of the error of held-out poses."""
ENOUGH: Final = 150
"""Fewest poses with which periodic errors are looked for at all."""
_AXES = 6
_SEED = 7  # other folds than those that the headline figure uses
_CHANCE = 30.0  # decrease of chi-square by two numbers, the best of 1320 pairs: by chance in 1 of 2000 cases
_NEARLY = 1.003
_AT_ZERO = 1e-12
Harmonics = dict[int, tuple[int, ...]]
"""Orders by axis 0..5, only where there are any."""


@dataclass(frozen=True, eq=False)
class _HarmonicTable:
    """One block, linear about the fit: weighted rows (m, c), what an axis does to them, and how to judge them."""

    J: Float  # (m, c, p) minus the Jacobian of the geometry, in fit coordinates
    G: Float  # (m, c, 6) minus the derivative by the angle of each link
    q: Float  # (m, 6) rad
    r: Float  # (m, c) residuals of the fit
    sigma: Float  # (m, 3) m, standard deviations of the position times what the weights make of them; 0 is not judged
    fold: Int

    def columns(self, axis: int, order: int) -> Float:
        """(m, c, 2) sine and cosine of a harmonic."""
        angle = order * self.q[:, axis]
        both = np.stack([np.sin(angle), np.cos(angle) - 1.0], axis=-1)
        out: Float = self.G[:, :, axis, None] * both[:, None, :]
        return out


def choose_harmonics(setup: CalibrationSetup, fit: Fit, prior_rad: float, progress: Progress = silent) -> Harmonics:
    """Harmonics of the drives that hold-out wants. Returns orders by axis 0..5, only where there are any."""
    tables = _tables(setup, fit)
    if sum(len(t.q) for t in tables) < ENOUGH:
        return {}
    p = len(fit.values)
    known = np.array([q.has_prior for q in setup.parameters], dtype=np.float64)
    taken = _pursue(tables, known, prior_rad, share_of(progress, 0.0, 0.5))
    if not taken:
        return {}
    # Priors pull towards nominal, not towards the fit.
    pull = np.concatenate([fit.parameters.coordinates(fit.values) * known, np.zeros(2 * len(taken))])
    errors = _validation_error(
        tables,
        taken,
        np.concatenate([known, np.ones(2 * len(taken))]),
        pull,
        p,
        prior_rad,
        share_of(progress, 0.5, 1.0),
    )
    best = float(np.min(errors))
    # The fewest that predict nearly as well as the best: the minimum of a flat curve is drawn by noise.
    count = int(np.flatnonzero(errors <= _NEARLY * best)[0])
    if errors[count] > (1.0 - GAIN) * errors[0]:
        return {}
    return {
        axis: tuple(sorted(k for a, k in taken[:count] if a == axis)) for axis in sorted({a for a, _ in taken[:count]})
    }


def _tables(setup: CalibrationSetup, fit: Fit) -> list[_HarmonicTable]:
    pairs = [
        (b, w, f)
        for b, w, f in zip(setup.blocks, fit.weights, fit.sigma_factors, strict=True)
        if isinstance(b, TrackerResiduals) and isinstance(b.arm, ArmGeometry)
    ]
    if not pairs:
        return []
    p = len(fit.values)
    step = np.array([q.unit_step * (v if q.log else 1.0) for q, v in zip(setup.parameters, fit.values, strict=True)])
    x = np.concatenate([fit.values, np.zeros(2 * _AXES)])
    terms = tuple(PeriodicTerm(axis, 1, p + 2 * axis, p + 2 * axis + 1) for axis in range(_AXES))
    out = []
    folds = fold_of_groups([b.group for b, _, _ in pairs], seed=_SEED) if sum(len(b.p) for b, _, _ in pairs) > 1 else ()
    for (block, weight, factor), fold in zip(pairs, folds, strict=True):
        arm = block.arm
        if not isinstance(arm, ArmGeometry):
            continue
        wide = replace(block, arm=replace(arm, layout=replace(arm.layout, periodic=terms)))
        root = (np.sqrt(weight) / factor)[:, None]
        J = -wide.jacobian(x) * root[:, :, None]
        both = J[:, :, p:].reshape(*J.shape[:2], _AXES, 2)
        sine, cosine = np.sin(arm.q)[:, None], np.cos(arm.q)[:, None] - 1.0
        size = sine**2 + cosine**2  # at zero every harmonic vanishes, and with it all that is asked of G
        G = np.where(size > _AT_ZERO, both[..., 0] * sine + both[..., 1] * cosine, 0.0) / np.maximum(size, _AT_ZERO)
        scale = np.where(root > 0.0, block.sigma[:, :3] / np.maximum(root, _AT_ZERO), 0.0)
        out.append(_HarmonicTable(J[:, :, :p] * step, G, arm.q, block.evaluate(fit.values) * root, scale, fold))
    return out


def _gram(tables: Sequence[_HarmonicTable], waves: Sequence[Sequence[Float]]) -> Float:
    """(axes, orders, 2, 2) products of sine and cosine of every harmonic, each weighted by what its axis moves."""
    gram = np.zeros((_AXES, HIGHEST, 2, 2))
    for t, wave in zip(tables, waves, strict=True):
        strength = np.sum(t.G**2, axis=1)
        for a in range(_AXES):
            gram[a] += np.einsum("imk,m,jmk->kij", wave[a], strength[:, a], wave[a])
    return gram


def _projected(
    tables: Sequence[_HarmonicTable], waves: Sequence[Sequence[Float]], r: Sequence[Float], new: Sequence[Float]
) -> tuple[Float, Float]:
    """Products of every harmonic with residuals and with directions that are taken already, both by table."""
    right = np.zeros((_AXES, HIGHEST, 2))
    part = np.zeros((_AXES, HIGHEST, 2, new[0].shape[1]))
    for t, wave, left, taken in zip(tables, waves, r, new, strict=True):
        gradient = np.einsum("mca,mc->ma", t.G, left.reshape(t.r.shape))
        across = np.einsum("mca,mcj->maj", t.G, taken.reshape(*t.r.shape, -1))
        for a in range(_AXES):
            right[a] += np.einsum("imk,m->ki", wave[a], gradient[:, a])
            for i in range(2):
                part[a, :, i] += wave[a][i].T @ across[:, a]
    return right, part


def _pursue(
    tables: Sequence[_HarmonicTable], known: Float, prior_rad: float, progress: Progress
) -> list[tuple[int, int]]:
    """Harmonics in the order in which they lower the misfit, one by one, each the best beside all before."""
    orders = np.arange(1, HIGHEST + 1)
    waves = [
        [np.stack([np.sin(t.q[:, [a]] * orders), np.cos(t.q[:, [a]] * orders) - 1.0]) for a in range(_AXES)]
        for t in tables
    ]
    # A basis of the geometry, its priors as further rows; harmonics have no part in these.
    p = len(known)
    rows = np.concatenate([*(t.J.reshape(-1, p) for t in tables), np.diag(known) + 1e-5 * np.eye(p)])
    basis = np.linalg.qr(rows)[0][:-p]
    r = np.concatenate([t.r.reshape(-1) for t in tables])
    r = r - basis @ (basis.T @ r)
    taken: list[tuple[int, int]] = []
    ends = np.cumsum([0, *(t.r.size for t in tables)])
    gram = _gram(tables, waves) + np.eye(2) / prior_rad**2
    shared = np.zeros((_AXES, HIGHEST, 2, 0))
    new = basis
    while len(taken) < MOST:
        right, part = _projected(tables, waves, np.split(r, ends[1:-1]), np.split(new, ends[1:-1]))
        shared = np.concatenate([shared, part], axis=-1)
        A = gram - shared @ np.swapaxes(shared, -1, -2) + 1e-9 * gram.mean() * np.eye(2)
        gain = np.sum(right * np.linalg.solve(A, right[..., None])[..., 0], axis=-1)
        for a, k in taken:
            gain[a, k - 1] = -np.inf
        axis, place = np.unravel_index(int(np.argmax(gain)), gain.shape)
        if gain[axis, place] < _CHANCE:
            break
        taken.append((int(axis), int(place) + 1))
        progress(len(taken) / MOST)
        columns = np.concatenate([t.columns(int(axis), int(place) + 1).reshape(-1, 2) for t in tables])
        # Twice: one pass of Gram and Schmidt leaves rounding along the basis that grows with every harmonic taken.
        for _ in range(2):
            columns = columns - basis @ (basis.T @ columns)
        new = np.linalg.qr(columns)[0]
        basis = np.concatenate([basis, new], axis=1)
        r = r - new @ (new.T @ r)
    return taken


def _validation_error(
    tables: Sequence[_HarmonicTable],
    taken: Sequence[tuple[int, int]],
    prior: Float,
    pull: Float,
    p: int,
    prior_rad: float,
    progress: Progress,
) -> Float:
    """Mean position error of held-out poses with the first 0, 1, 2, ... harmonics."""
    wide = [np.concatenate([t.J, *(t.columns(a, k) * prior_rad for a, k in taken)], axis=-1) for t in tables]
    errors: list[list[Float]] = [[] for _ in range(len(taken) + 1)]
    size = len(prior)
    folds = sorted({int(f) for t in tables for f in np.unique(t.fold)})
    for turn, f in enumerate(folds):
        A, y = np.zeros((size, size)), np.zeros(size)
        for t, J in zip(tables, wide, strict=True):
            rows = J[t.fold != f].reshape(-1, size)
            A += rows.T @ rows
            y += rows.T @ t.r[t.fold != f].reshape(-1)
        for count in range(len(taken) + 1):
            n = p + 2 * count
            M = A[:n, :n] + np.diag(prior[:n]) + 1e-9 * np.eye(n)
            u = np.linalg.solve(M, y[:n] - pull[:n])
            for t, J in zip(tables, wide, strict=True):
                mine = (t.fold == f) & (t.sigma[:, 0] > 0.0)
                off = (t.r[mine, :3] - J[mine][:, :3, :n] @ u) * t.sigma[mine]
                errors[count].append(np.linalg.norm(off, axis=1))
            progress((turn + (count + 1) / (len(taken) + 1)) / len(folds))
    return np.array([float(np.mean(np.concatenate(e))) for e in errors])
