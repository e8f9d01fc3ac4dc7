"""Choice of measurements: the few of many candidates that make the expected standard deviations small.

Each candidate (a pose, a pose with its load) brings information ``J_i^T J_i`` about the fit coordinates, with ``J_i``
its weighted Jacobian; with the priors ``M_0`` the expected covariance after measuring the set S is
``C = (M_0 + sum_S J_i^T J_i)^-1``. Chosen greedily, then improved by exchange (Fedorov 1972, chapter 3), for the least
``log det C`` or the least ``trace(L C L^T)``, the variance of what is to be predicted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Bool, Float, Int, as_float
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, silent
from counterflex.identify.solver.parameters import Parameters
from counterflex.identify.solver.residuals import Residuals


def greedy(J: Float, count: int, fixed: int = 0) -> tuple[Int, Float]:
    """Rows that raise ``det(1 + sum J^T J)`` most, one by one; each may be taken once.

    ``J``: (n, k, f) weighted derivatives in fit coordinates, where every prior is 1. ``fixed``: So many of the first
    rows are taken whatever they bring, before all others. Returns (count,) rows and the (f, f) covariance they give
    together with the priors. Raises InputError: more than there are.
    """
    n, k, f = J.shape
    if count > n:
        raise InputError("measurements to choose", value=count, limit=f"at most the {n} candidates")
    C = np.eye(f)
    remaining = np.ones(n, dtype=np.bool_)
    chosen = []
    for place in range(count):
        S = np.eye(k) + J @ C @ np.swapaxes(J, 1, 2)
        gain = np.where(remaining, np.linalg.slogdet(S)[1], -np.inf)
        best = place if place < fixed else int(np.argmax(gain))
        CJ = C @ J[best].T
        C = C - CJ @ np.linalg.solve(S[best], CJ.T)
        C = 0.5 * (C + C.T)
        remaining[best] = False
        chosen.append(best)
    return np.array(chosen, dtype=np.int64), C


VAGUE: Final = 1e-6
"""Information that stands for no prior: a standard deviation of 1000 ordinary changes."""
PASSES: Final = 3
SHORTLIST: Final = 300
"""Candidates that a pass of exchange tries: those that would add most to what is chosen at its beginning."""
_GAIN = 1e-6


@dataclass(frozen=True, eq=False)
class DesignChoice:
    """Chosen measurements."""

    indices: Int  # (n,) candidates, in the order of what each adds: the first m are a good choice of m
    covariance: Float  # (f, f) expected covariance of the free parameters in fit coordinates


@dataclass(frozen=True, eq=False)
class Candidates:
    """Information of candidate measurements about the free parameters."""

    ids: Int  # (c,) the group of each candidate: rows of one group, over all blocks, are one measurement
    jacobian: Float  # (c, k, f) weighted Jacobian in fit coordinates, rows of zeros where a candidate has fewer than k


def candidates_of(parameters: Parameters, blocks: Sequence[Residuals], x: Float | None = None) -> Candidates:
    """Information of every group of rows.

    ``blocks``: Candidate measurements; what they measured does not matter, only their Jacobian. ``x``: (p,) SI values
    at which they are judged; None is nominal.
    """
    x = parameters.nominal if x is None else x
    free = np.flatnonzero(parameters.free)
    scale = parameters.slope(x)[free]
    ids = np.unique(np.concatenate([b.group for b in blocks]))
    rows = [b.jacobian(x)[:, :, free] * scale for b in blocks]
    filled = np.zeros(len(ids), dtype=np.int64)
    spots = []
    for block, J in zip(blocks, rows, strict=True):
        place = np.searchsorted(ids, block.group)
        order = np.argsort(place, kind="stable")
        sizes = np.bincount(place, minlength=len(ids))
        within = np.arange(len(place)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
        spot = np.empty(len(place), dtype=np.int64)
        spot[order] = filled[place[order]] + within * J.shape[1]
        filled += sizes * J.shape[1]
        spots.append((place, spot))
    out = np.zeros((len(ids), int(np.max(filled, initial=0)), len(free)))
    for J, (place, spot) in zip(rows, spots, strict=True):
        out[place[:, None], spot[:, None] + np.arange(J.shape[1])] = J
    return Candidates(ids, out)


def prior_information(parameters: Parameters) -> Float:
    """(f,) information of the priors on the free parameters in fit coordinates: 1, or :data:`VAGUE` without prior."""
    return np.array([1.0 if p.has_prior else VAGUE for p in parameters if p.free])


def expected_sigma(parameters: Parameters, covariance: Float, x: Float | None = None) -> dict[str, float]:
    """Expected standard deviations of the free parameters by name, SI.

    ``covariance``: (f, f) in fit coordinates. ``x``: (p,) SI values; None is nominal.
    """
    slope = parameters.slope(parameters.nominal if x is None else x)
    free = np.flatnonzero(parameters.free)
    sigma = np.sqrt(np.diag(covariance)) * slope[free]
    return {parameters.names[i]: float(s) for i, s in zip(free, sigma, strict=True)}


def choose(
    jacobian: Float,
    count: int,
    information: Float,
    *,
    target: Float | None = None,
    already: Sequence[int] = (),
    passes: int = PASSES,
    progress: Progress = silent,
) -> DesignChoice:
    """Choose measurements.

    Args:
        jacobian: (c, k, f) weighted Jacobians of the candidates in fit coordinates.
        count: How many to choose, those in ``already`` included.
        information: (f,) or (f, f) what is known before: priors, and measurements that are there already.
        target: (t, f) derivative of what is to be predicted by the fit coordinates, in units in which its errors weigh
            alike; the sum of its variances is made small. None makes the determinant of the covariance small.
        already: Candidates that are chosen in any case.
        passes: Most passes of exchange.
        progress: Told about passes.

    Raises:
        InputError: More than there are candidates, or information that is not positive definite.

    Source: Fedorov 1972, Theory of optimal experiments; Atkinson and Donev 1992, chapters 10 and 15.
    """
    J = as_float("jacobian", jacobian, (None, None, None))
    c, _, f = J.shape
    if not 1 <= count <= c or len(set(already)) > count or not all(0 <= i < c for i in already):
        raise InputError("cannot choose that many measurements", value=count, limit=f"1 .. {c} candidates")
    matrices = as_float("information", information)
    M = np.diag(matrices) if matrices.ndim == 1 else matrices.copy()
    if M.shape != (f, f):
        raise InputError("the prior information has the wrong shape", value=matrices.shape, limit=(f, f))
    weigh = _Weighing(J, M, None if target is None else as_float("target", target, (None, f)))
    chosen: list[int] = []
    for i in dict.fromkeys(already):
        weigh.add(i)
        chosen.append(i)
    fixed = len(chosen)
    open_ = np.ones(c, dtype=np.bool_)
    open_[chosen] = False
    while len(chosen) < count:
        best = int(np.argmax(np.where(open_, weigh.gains(), -np.inf)))
        weigh.add(best)
        chosen.append(best)
        open_[best] = False
        progress(0.5 * len(chosen) / count, "choosing measurements")
    for turn in range(passes):
        if not _exchange(weigh, chosen, fixed, open_):
            break
        progress(0.5 + 0.5 * (turn + 1) / passes, "exchanging measurements")
    return DesignChoice(_ordered(J, M, chosen, fixed, weigh.target), weigh.covariance())


class _Weighing:
    """The information of what is chosen, and what each candidate would add."""

    def __init__(self, J: Float, M: Float, target: Float | None) -> None:
        self.J, self.M = J, M.copy()
        if target is not None and len(target) > J.shape[2]:
            target = np.asarray(np.linalg.qr(target, mode="r"))
        self.target = target
        self._factor()

    def _factor(self) -> None:
        try:
            self.root = scipy.linalg.cholesky(self.M, lower=True)
        except scipy.linalg.LinAlgError as fault:
            raise InputError(
                "a parameter has no prior at all", hint="Give every parameter a prior, or the weak information of VAGUE"
            ) from fault

    def add(self, i: int, sign: float = 1.0) -> None:
        self.M += sign * self.J[i].T @ self.J[i]
        self._factor()

    def covariance(self) -> Float:
        half = scipy.linalg.solve_triangular(self.root, np.eye(len(self.M)), lower=True)
        out: Float = half.T @ half
        return out

    def cost(self) -> float:
        """Criterion to be minimised: log det C or trace(L C L^T)."""
        if self.target is None:
            return float(-2.0 * np.sum(np.log(np.diag(self.root))))
        return float(np.sum(scipy.linalg.solve_triangular(self.root, self.target.T, lower=True) ** 2))

    def gains(self, among: Int | None = None) -> Float:
        """(c,) by how much each candidate, or each of those named, would lower the cost."""
        J = self.J if among is None else self.J[among]
        c, k, f = J.shape
        half = scipy.linalg.solve_triangular(self.root, J.reshape(-1, f).T, lower=True, check_finite=False).T.reshape(
            c, k, f
        )
        grown = half @ np.swapaxes(half, 1, 2) + np.eye(k)
        if self.target is None:
            out: Float = 2.0 * np.sum(np.log(np.diagonal(np.linalg.cholesky(grown), axis1=1, axis2=2)), axis=1)
            return out
        aim = scipy.linalg.solve_triangular(self.root, self.target.T, lower=True)
        projected = (half.reshape(c * k, f) @ (aim @ aim.T)).reshape(c, k, f) @ np.swapaxes(half, 1, 2)
        gain: Float = np.sum(np.linalg.inv(grown) * projected, axis=(1, 2))
        return gain


def _exchange(weigh: _Weighing, chosen: list[int], fixed: int, open_: Bool) -> bool:
    """One pass: each chosen candidate is replaced by a better one, where there is one."""
    changed = False
    short = np.argsort(-np.where(open_, weigh.gains(), -np.inf), kind="stable")[:SHORTLIST]
    for place in range(fixed, len(chosen)):
        old, before = chosen[place], weigh.cost()
        try:
            weigh.add(old, -1.0)
        except InputError:
            weigh.add(old)
            continue
        open_[old] = True
        among = np.unique(np.append(short, old))
        best = int(among[np.argmax(np.where(open_[among], weigh.gains(among), -np.inf))])
        weigh.add(best)
        if best != old and before - weigh.cost() <= _GAIN * max(1.0, abs(before)):
            weigh.add(best, -1.0)
            weigh.add(old)
            best = old
        chosen[place] = best
        open_[best] = False
        changed |= best != old
    return changed


def _ordered(J: Float, M: Float, chosen: Sequence[int], fixed: int, target: Float | None) -> Int:
    """The chosen ones, those not fixed in the order of what each adds."""
    rest = np.array(chosen[fixed:], dtype=np.int64)
    weigh = _Weighing(J[rest], M, target)
    for i in chosen[:fixed]:
        weigh.M += J[i].T @ J[i]
    weigh._factor()
    remaining = np.ones(len(rest), dtype=np.bool_)
    order = []
    for _ in rest:
        i = int(np.argmax(np.where(remaining, weigh.gains(), -np.inf)))
        weigh.add(i)
        remaining[i] = False
        order.append(int(rest[i]))
    return np.array([*chosen[:fixed], *order], dtype=np.int64)
