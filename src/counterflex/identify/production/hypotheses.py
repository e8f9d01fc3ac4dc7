"""Hypotheses about the force factors of successive runs, and their evidence.

A hypothesis is a shape of the growth over the length that an edge has cut, and events at single runs. Its columns are
linear in unknowns with normal priors, so that the evidence is exact for each standard deviation of the scatter of runs
beside their own; over that scatter the evidence is summed::

    s = level + edge + sum of steps + trend(L),   s_i ~ N(x_i b, sigma_i^2 + scatter^2),   b ~ N(b_0, S)

Growth, wear and chipping belong to an edge and end with it; another material stays until it ends. Sizes are shares of
the median factor.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Bool, Float, Int

LEVEL_SIGMA: Final = 0.5
"""Prior of the level: hardly any."""
EDGE_SIGMA: Final = 0.05
"""Standard deviation of the force of a new edge from edge to edge."""
STEP_SIGMA: Final = 0.25
"""Standard deviation of the size of a jump."""
LOST_SIGMA: Final = 0.03
"""Doubt about the share that a lost tooth carried: run-out, other teeth that chip with it."""
TREND_SIGMA: Final = 0.3
"""Standard deviation of the growth over the longest life, and of what bends it at the end."""
BREAK_IN_SIGMA: Final = 0.15
"""Standard deviation of the fast growth of a fresh edge."""
MODEL_SCATTER: Final = 0.01
"""Median scatter of runs beside their own standard deviation before any is seen: blanks, clamping, touch-off."""
LONGEST_STRETCH: Final = 8
"""Runs of the longest passing change that is looked for as one event."""
_SCATTERS: Final = np.geomspace(0.001, 0.15, 12)
_BATCH: Final = 4_000_000  # numbers of one batch of designs


class Kind(Enum):
    """Events between two runs."""

    NEW_EDGE = "new edge"
    CHIPPED = "chipped edge"
    LOST_TOOTH = "lost tooth"
    MATERIAL = "other material"
    PASSING = "passing change"


RATE: Final = {
    Kind.NEW_EDGE: 0.03,
    Kind.CHIPPED: 0.01,
    Kind.LOST_TOOTH: 0.005,
    Kind.MATERIAL: 0.01,
    Kind.PASSING: 0.005,
}
"""Prior probability of an event at a run that nobody stated: an edge is changed some times in a hundred runs."""


@dataclass(frozen=True)
class ToolEvent:
    """A change between runs."""

    kind: Kind
    at: int  # first run after it
    until: int = 0  # first run after a passing change; 0 for the others

    @property
    def prior(self) -> float:
        """Logarithm of the prior odds."""
        return math.log(RATE[self.kind] / (LONGEST_STRETCH if self.kind is Kind.PASSING else 1.0))


@dataclass(frozen=True)
class HypothesisShape:
    """Growth over the length cut, as columns that are 0 for a new edge."""

    name: str
    prior: float
    # kind of the second column: `""` none, `"fast"` exponential approach, `"late"` a power, `"knee"` a second slope
    # from a length on
    bends: str = ""
    at: float = 0.0  # its power, or its length as a share of the longest life

    def columns(self, length: Float, *, slope: bool = False) -> list[Float]:
        """Columns, or their derivatives, at lengths by the longest life."""
        if self.name == "constant":
            return []
        out: list[Float] = [np.ones_like(length) if slope else length]
        if self.bends == "fast":
            rest = np.exp(-length / self.at)
            out.append(rest / self.at if slope else 1.0 - rest)
        elif self.bends == "late":
            out.append(self.at * length ** (self.at - 1.0) if slope else length**self.at)
        elif self.bends == "knee":
            after = 1.0 / (1.0 - self.at)
            out.append(
                after * np.asarray(length > self.at, dtype=np.float64)
                if slope
                else after * np.maximum(0.0, length - self.at)
            )
        return out

    @property
    def sigmas(self) -> list[float]:
        """Prior standard deviation of each column."""
        if self.name == "constant":
            return []
        return [TREND_SIGMA, *([BREAK_IN_SIGMA] if self.bends == "fast" else [TREND_SIGMA] if self.bends else [])]


CONSTANT: Final = HypothesisShape("constant", 0.3)
LINE: Final = HypothesisShape("drift", 0.4)
SHAPES: Final = (
    CONSTANT,
    LINE,
    *(HypothesisShape("break-in", 0.05, "fast", at) for at in (0.06, 0.12, 0.25)),
    *(HypothesisShape("accelerating", 0.025, "late", power) for power in (2.0, 3.0, 5.0)),
    *(HypothesisShape("accelerating", 0.025, "knee", at) for at in (0.45, 0.6, 0.75)),
)


@dataclass(frozen=True, eq=False)
class Series:
    """Factors of runs in their order."""

    factor: Float  # (n,) of each run
    sigma: Float  # (n,) standard deviations
    cut_m: Float  # (n,) length that each cut
    starts: Bool  # (n,) runs stated to begin with a new edge; the first does
    lost_share: float  # share of the force that is lost with one tooth; 0 where it is not known

    @cached_property
    def scale(self) -> float:
        """Median factor."""
        return float(np.median(self.factor))

    def edges(self, events: Sequence[ToolEvent]) -> tuple[Int, Float]:
        """(n,) number of the edge, and the length that it had cut at the middle of each run."""
        starts = self.starts.copy()
        for event in events:
            starts[event.at] |= event.kind is Kind.NEW_EDGE
        edge = np.cumsum(starts) - 1
        total = np.cumsum(self.cut_m) - self.cut_m
        first = np.flatnonzero(starts)
        before: Float = total - total[first][edge] + 0.5 * self.cut_m
        return edge.astype(np.int64), before


@dataclass(frozen=True, eq=False)
class Design:
    """Columns of one hypothesis."""

    events: tuple[ToolEvent, ...]
    shape: HypothesisShape
    rows: Float  # (n, p) columns at each run
    mean: Float  # (p,) prior means
    sigma: Float  # (p,) prior standard deviations
    rising: tuple[int, ...]  # column of each jump that only goes up
    start: Float  # (p,) force of the first run of the present edge
    growth: Float  # (p,) growth from there to the last run, jumps apart
    slope: Float  # (p,) its derivative at the last run, per metre
    steps: tuple[int, ...]  # columns of jumps of the present edge

    @property
    def prior(self) -> float:
        """Logarithm of the prior probability, apart from a constant."""
        return math.log(self.shape.prior) + sum(event.prior for event in self.events)


def design(series: Series, events: tuple[ToolEvent, ...], shape: HypothesisShape) -> Design:
    """Columns of a hypothesis."""
    n, scale = len(series.factor), series.scale
    edge, before = series.edges(events)
    last = int(edge[-1])
    columns, mean, sigma = [np.ones(n)], [scale], [LEVEL_SIGMA * scale]
    for number in range(1, last + 1):
        columns.append((edge == number).astype(np.float64))
        mean, sigma = [*mean, 0.0], [*sigma, EDGE_SIGMA * scale]
    run, rising, steps = np.arange(n), [], []
    for event in events:
        if event.kind is Kind.NEW_EDGE:
            continue
        until = n
        if event.kind in (Kind.CHIPPED, Kind.LOST_TOOTH):
            until = event.at + int(np.sum(edge[event.at :] == edge[event.at]))
        elif event.kind is Kind.PASSING:
            until = event.until
        lost = event.kind is Kind.LOST_TOOTH
        if event.kind is Kind.CHIPPED:
            rising.append(len(columns))
        if until == n and edge[event.at] == last and event.kind is not Kind.LOST_TOOTH:
            steps.append(len(columns))
        columns.append(((run >= event.at) & (run < until)).astype(np.float64))
        mean.append(-series.lost_share * scale if lost else 0.0)
        sigma.append((LOST_SIGMA if lost else STEP_SIGMA) * scale)
    longest = float(np.max(before + 0.5 * series.cut_m))
    length = before / longest
    bent, slopes = shape.columns(length), shape.columns(length[-1:], slope=True)
    X = np.stack([*columns, *bent], axis=1)
    first = int(np.argmax(edge == last))
    trend, slope = np.zeros(X.shape[1]), np.zeros(X.shape[1])
    trend[len(columns) :] = X[-1, len(columns) :] - X[first, len(columns) :]
    slope[len(columns) :] = np.concatenate([[], *slopes]) / longest
    mean += [0.0] * len(bent)
    sigma += [one * scale for one in shape.sigmas]
    return Design(
        events, shape, X, np.array(mean), np.array(sigma), tuple(rising), X[first], trend, slope, tuple(steps),
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Weighed:
    """A hypothesis and its posterior."""

    design: Design
    log_weight: Float  # (t,) logarithm of the evidence times the priors, by scatter
    mean: Float  # (t, p) of the unknowns
    covariance: Float  # (t, p, p) theirs


def scatters(series: Series) -> Float:
    """(t,) standard deviations of the scatter that are summed over."""
    out: Float = _SCATTERS * series.scale
    return out


def weigh(series: Series, designs: Sequence[Design]) -> list[Weighed]:
    """Evidence of hypotheses, in batches."""
    widest = max(d.rows.shape[1] for d in designs)
    count = max(1, _BATCH // (len(series.factor) * widest * len(_SCATTERS)))
    out: list[Weighed] = []
    for first in range(0, len(designs), count):
        out += _batch(series, designs[first : first + count])
    return out


def _batch(series: Series, designs: Sequence[Design]) -> list[Weighed]:
    n, widest = len(series.factor), max(d.rows.shape[1] for d in designs)
    X, m0 = np.zeros((len(designs), n, widest)), np.zeros((len(designs), widest))
    s0 = np.ones((len(designs), widest))  # a column of zeros keeps its prior and leaves the evidence alone
    for i, d in enumerate(designs):
        p = d.rows.shape[1]
        X[i, :, :p], m0[i, :p], s0[i, :p] = d.rows, d.mean, d.sigma
    variance = series.sigma**2 + scatters(series)[:, None] ** 2
    rest = series.factor - np.einsum("cnp,cp->cn", X, m0)
    weighted = X[:, None] / variance[None, :, :, None]
    A = np.swapaxes(X, 1, 2)[:, None] @ weighted
    A[:, :, np.arange(widest), np.arange(widest)] += s0[:, None] ** -2
    b = np.einsum("ctnp,cn->ctp", weighted, rest)
    covariance = np.linalg.inv(A)
    moved = np.einsum("ctpq,ctq->ctp", covariance, b)
    square = rest**2 @ (1.0 / variance).T - np.einsum("ctp,ctp->ct", b, moved)
    log = -0.5 * (square + np.sum(np.log(variance), axis=1) + np.linalg.slogdet(A)[1])
    log -= np.sum(np.log(s0), axis=1)[:, None]
    # Half a Student distribution of 4 degrees of freedom over the scatter, on a logarithmic grid.
    log += np.log(_SCATTERS) - 2.5 * np.log1p(0.25 * (_SCATTERS / MODEL_SCATTER) ** 2)
    out = []
    for i, d in enumerate(designs):
        p = d.rows.shape[1]
        mean: Float = np.asarray(m0[i, :p] + moved[i, :, :p], dtype=np.float64)
        cov: Float = np.asarray(covariance[i, :, :p, :p], dtype=np.float64)
        own: Float = np.array(log[i] + d.prior, dtype=np.float64)
        for j in d.rising:  # prior and posterior of what only rises, cut off at 0
            own += scipy.special.log_ndtr(mean[:, j] / np.sqrt(cov[:, j, j])) + math.log(2.0)
        out.append(Weighed(d, own, mean, cov))
    return out


def log_sum(values: Float) -> float:
    """Logarithm of the sum of numbers that are given by their logarithms."""
    most = float(np.max(values))
    return most + math.log(float(np.sum(np.exp(values - most))))


def score(weighed: Sequence[Weighed]) -> float:
    """Logarithm of the evidence of hypotheses together."""
    return log_sum(np.concatenate([w.log_weight for w in weighed]))
