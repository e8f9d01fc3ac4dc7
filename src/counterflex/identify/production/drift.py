"""Growth of a tool's force over its life: a factor for each run against the length that the tool had cut.

Each run gives the factor s by which its force exceeds that of one law, the height of the work in it unknown. Over the
runs of one edge stands the line ``s = a (1 + b L)``; runs scatter about it by more than their own standard deviations
(another blank, clamping, touch-off), which is found by the method of moments (DerSimonian and Laird 1986) and widens
the interval of the slope, Student's t with the runs less two. A change of the tool is stated, or seen: a fall of the
factor that no line explains.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.stats import norm
from scipy.stats import t as student

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.errors import InputError
from counterflex.identify.production.residuals import LAW, ProductionResiduals

FALL: Final = 0.05
"""Least fall of the factor that passes for a new edge."""
FALL_SIGMAS: Final = 4.0
"""And by so many standard deviations: 1 in 30 000 by chance."""
LEVEL: Final = 0.90
"""Probability of the intervals."""
_FLOOR: Final = 0.005


@dataclass(frozen=True)
class RunFactor:
    """The force of a run by one law.

    Attributes:
        factor: Measured by expected force.
        sigma: Its standard deviation: noise, zero, height of the work.
    """

    factor: float
    sigma: float


@dataclass(frozen=True, eq=False)
class Drift:
    """Growth of the force, by the runs of one tool in their order.

    Attributes:
        edge: (n,) number of the edge of each run, 0 the first.
        before_m: (n,) length that its edge had cut at the middle of each run.
        seen: Runs at which a new edge was seen although none was stated.
        level: (edges,) factor of each edge when new.
        slope: Growth per metre, of a new edge's force.
        slope_sigma: Its standard deviation.
        low: Lower end of the interval of the slope (:data:`LEVEL`).
        high: Upper end.
        scatter: Standard deviation of runs beside their own.
        grown: Growth of the last edge at the end of the last run, share of its force when new.
        grown_low: Lower end of its interval.
        grown_high: Upper end.
        is_known: Whether there are runs enough for a slope.
    """

    edge: Int
    before_m: Float
    seen: tuple[int, ...]
    level: Float
    slope: float
    slope_sigma: float
    low: float
    high: float
    scatter: float
    grown: float
    grown_low: float
    grown_high: float
    is_known: bool

    @property
    def is_significant(self) -> bool:
        """Whether the force grows, or falls, by more than chance."""
        return self.is_known and (self.low > 0.0 or self.high < 0.0)

    def at(self, length_m: Float) -> Float:
        """Growth factor of an edge that has cut so far."""
        out: Float = 1.0 + self.slope * length_m
        return out

    def length_to(self, limit: float, confidence: str = "middle") -> float:
        """Length (m) at which the force has grown by a share; infinite where it does not grow."""
        slope = {"middle": self.slope, "early": self.high, "late": self.low}[confidence]
        return limit / slope if slope > 0.0 else math.inf


def run_factor(block: ProductionResiduals, x: Float) -> RunFactor:
    """Factor of one run's force, its tops found beside it, bounds and give as they are in x.

    Args:
        block: Stretches of one run; its growth is not used.
        x: (p,) constants and geometry.
    """
    inside = x.copy()
    tops = [i for i, p in enumerate(block.geometry.parameters) if p.name.startswith("top.")]
    mine = [i for i in tops if np.any(block.geometry.top == i)]
    inside[[LAW + i for i in mine]] = 0.0
    bare = ProductionResiduals(block.pieces, block.geometry, block.cutter, block.h_ref_m, block.group)
    only_law = bare.predict(inside)
    fixed = inside.copy()
    fixed[:3], fixed[6:9] = 0.0, 0.0
    geometry = bare.predict(fixed)
    columns = [((only_law - geometry) / block.sigma).reshape(-1)]
    columns += [(-block.jacobian(x)[:, :, LAW + i]).reshape(-1) for i in mine]
    A = np.stack(columns, axis=1)
    y = ((block.pieces.force - geometry) / block.sigma).reshape(-1)
    prior = np.array([0.0] + [1.0 / block.geometry.parameters.items[i].prior_sigma ** 2 for i in mine])
    info = A.T @ A + np.diag(prior)
    value = np.linalg.solve(info, A.T @ y)
    rest = (y - A @ value).reshape(-1, 3)
    # Components and stretches of one contact err alike: they count as one.
    contacts = np.unique(block.group)
    square = sum(float(np.mean(rest[block.group == g] ** 2)) for g in contacts)
    excess = max(1.0, square / max(len(contacts) - 1, 1) if len(contacts) > 1 else square)
    share = len(block.pieces) / len(contacts)
    covariance = np.linalg.inv(info / (excess * share) + np.diag(prior) * (1.0 - 1.0 / (excess * share)))
    return RunFactor(float(value[0]), math.sqrt(float(covariance[0, 0])))


def drift(factors: list[RunFactor], cut_m: Float, is_new: Bool) -> Drift:
    """Growth over runs in the order in which they were cut.

    Args:
        factors: Of each run.
        cut_m: (n,) length that each run cut.
        is_new: (n,) runs stated to begin with a new edge; the first does.

    Raises:
        InputError: No run, or lengths below zero.
    """
    n = len(factors)
    if n == 0 or np.any(cut_m <= 0.0):
        raise InputError("no run to follow the force over", value=n)
    s = np.array([f.factor for f in factors])
    sigma = np.maximum(np.array([f.sigma for f in factors]), _FLOOR)
    starts = np.array(is_new, dtype=np.bool_)
    starts[0] = True
    seen: list[int] = []
    while (at := _fall(s, sigma, cut_m, starts)) is not None:
        starts[at] = True
        seen.append(at)
    edge, before = _edges(cut_m, starts)
    edges = int(edge[-1]) + 1
    A = np.column_stack([edge == e for e in range(edges)] + [before]).astype(np.float64)
    is_known = n - edges >= 1 and float(np.ptp(before)) > 0.0
    if not is_known:
        level = np.array([np.average(s[edge == e], weights=sigma[edge == e] ** -2) for e in range(edges)])
        nan = math.nan
        return Drift(
            edge, before, tuple(seen), level, 0.0, nan, -math.inf, math.inf, 0.0, 0.0, -math.inf, math.inf, False
        )
    scatter = _scatter(A, s, sigma)
    value, covariance = _weighted(A, s, sigma**2 + scatter**2)
    level = value[:-1]
    dof = n - edges - 1
    factor = (
        float(student.ppf(0.5 + 0.5 * LEVEL, dof)) if scatter > 0.0 and dof > 0 else float(norm.ppf(0.5 + 0.5 * LEVEL))
    )
    base = float(level[edge[-1]])
    slope = float(value[-1]) / base
    slope_sigma = math.sqrt(float(covariance[-1, -1])) / base
    reach = float(before[-1] + 0.5 * cut_m[-1])
    grown, spread = slope * reach, slope_sigma * reach
    return Drift(
        edge, before, tuple(sorted(seen)), level, slope, slope_sigma, slope - factor * slope_sigma,
        slope + factor * slope_sigma, scatter, grown, grown - factor * spread, grown + factor * spread, True,
    )  # fmt: skip


def _edges(cut_m: Float, starts: Bool) -> tuple[Int, Float]:
    """(n,) number of the edge, and length it had cut at the middle of each run."""
    edge = np.cumsum(starts) - 1
    before, total = np.zeros(len(cut_m)), 0.0
    for i, length in enumerate(cut_m):
        total = 0.0 if starts[i] else total
        before[i] = total + 0.5 * length
        total += length
    return edge.astype(np.int64), before


def _weighted(A: Float, y: Float, variance: Float) -> tuple[Float, Float]:
    weight = 1.0 / variance
    out: Float = np.asarray(np.linalg.pinv(A.T @ (A * weight[:, None])), dtype=np.float64)
    return out @ (A.T @ (weight * y)), out


def _scatter(A: Float, y: Float, sigma: Float) -> float:
    """Standard deviation beside sigma by the method of moments."""
    dof = len(y) - A.shape[1]
    if dof < 1:
        return 0.0
    weight = sigma**-2
    value, covariance = _weighted(A, y, sigma**2)
    q = float(np.sum(weight * (y - A @ value) ** 2))
    trace = float(np.sum(weight) - np.trace(covariance @ (A.T @ (A * (weight**2)[:, None]))))
    return math.sqrt(max(0.0, (q - dof) / trace)) if trace > 0.0 else 0.0


def _fall(s: Float, sigma: Float, cut_m: Float, starts: Bool) -> int | None:
    """Run before which the factor falls by more than the line and its scatter explain, the clearest; or None."""
    best, where = 0.0, None
    for k in range(1, len(s)):
        if starts[k]:
            continue
        trial = starts.copy()
        trial[k] = True
        edge, before = _edges(cut_m, trial)
        own = edge[k]
        near = (edge == own) | (edge == own - 1)
        A = np.column_stack([edge[near] == own - 1, edge[near] == own, before[near]]).astype(np.float64)
        rows = int(np.sum(near))
        if rows < 3:  # two runs: no line
            A = A[:, :2]
        value, covariance = _weighted(A, s[near], sigma[near] ** 2)
        last = float(np.max(before[near & (edge == own - 1)]))
        grown = float(value[2]) * last if A.shape[1] > 2 else 0.0
        c = np.zeros(A.shape[1])
        c[0], c[1] = -1.0, 1.0
        if A.shape[1] > 2:
            c[2] = -last
        fall = float(value[1] - value[0]) - grown
        spread = math.sqrt(max(float(c @ covariance @ c), 1e-18))
        size = -fall / spread
        if -fall > FALL * float(value[0]) and size > FALL_SIGMAS and size > best:
            best, where = size, k
    return where
