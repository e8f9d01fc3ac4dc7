"""Life of a tool by the force factors of its runs: which events there were, and how far the force has grown.

Hypotheses of :mod:`counterflex.identify.production.hypotheses` are compared by their odds: growth that is a line, fast
at first or accelerating, with new edges, jumps, lost teeth and other materials at runs that nobody stated. Events are
added one by one while they raise the odds, then moved, exchanged and taken back. An event is named from odds of
:data:`NAMED` on; the growth is that of all hypotheses near the best one, each by its probability.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.errors import InputError
from counterflex.identify.production.hypotheses import (
    CONSTANT,
    LINE,
    LONGEST_STRETCH,
    SHAPES,
    Kind,
    Series,
    ToolEvent,
    Weighed,
    design,
    log_sum,
    scatters,
    score,
    weigh,
)
from counterflex.identify.production.residuals import LAW, ProductionResiduals


@dataclass(frozen=True)
class RunFactor:
    """The force of a run by one law."""

    factor: float  # measured by expected force
    sigma: float  # its standard deviation: noise, zero, height of the work


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


NAMED: Final = 20.0
"""Odds, for an event against none, from which on it is named."""
LEVEL: Final = 0.90
"""Probability of the intervals."""
MOST_EVENTS: Final = 12
_FLOOR: Final = 0.005  # least standard deviation of a factor
_CLOSE: Final = 12  # candidates of a round that are weighed with every shape
_DRAWS: Final = 4000


@dataclass(frozen=True)
class NamedEvents:
    """An event that the factors show."""

    at: int  # first run after it
    until: int  # first run after a passing change; 0 for the others
    size: float  # change of the force, share of the factor before; of a new edge, its fall
    odds: float  # for an event at this run against none
    kinds: tuple[tuple[Kind, float], ...]  # probability of each kind, the most probable first

    @property
    def kind(self) -> Kind:
        """The most probable one."""
        return self.kinds[0][0]


@dataclass(frozen=True, eq=False)
class ForceDrift:
    """Growth of the force, by the runs of one tool in their order."""

    edge: Int  # (n,) number of the edge of each run, 0 the first
    before_m: Float  # (n,) length that its edge had cut at the middle of each run
    events: tuple[NamedEvents, ...]  # named, in their order
    shape: str  # name of the most probable shape of the growth
    shape_chance: float
    factor: Float  # (n,) expected factor of each run, scatter apart
    force: Float  # (n,) the same by the first run's
    force_sigma: Float  # (n,) its standard deviation
    slope: float  # growth per metre of cut at the last run, share of the force of the first run of its edge
    low: float  # lower end of the interval of the slope (LEVEL)
    high: float
    scatter: float  # standard deviation of runs beside their own
    grown: float  # growth of the force from the first run of the last edge to the last run, jumps up included
    grown_low: float  # lower end of its interval
    grown_high: float
    is_known: bool  # whether there are runs enough for a growth

    @property
    def seen(self) -> dict[int, float]:
        """Probability of a new edge at runs at which one was seen although none was stated."""
        return {e.at: e.kinds[0][1] for e in self.events if e.kind is Kind.NEW_EDGE}

    @property
    def is_significant(self) -> bool:
        """Return whether the force changes from run to run by more than chance."""
        return bool(self.events) or (self.is_known and (self.low > 0.0 or self.high < 0.0))

    def length_to(self, limit: float, confidence: str = "middle") -> float:
        """Length (m) yet to be cut until the force has grown by a share, at its present slope; infinite for never."""
        slope, grown = {
            "middle": (self.slope, self.grown),
            "early": (self.high, self.grown_high),
            "late": (self.low, self.grown_low),
        }[confidence]
        if grown >= limit:
            return 0.0
        return (limit - grown) / slope if slope > 0.0 else math.inf


def drift(factors: Sequence[RunFactor], cut_m: Float, is_new: Bool, lost_share: float = 0.0) -> ForceDrift:
    """Life of a tool over runs in the order in which they were cut.

    ``cut_m``: (n,) length that each run cut. ``is_new``: (n,) runs stated to begin with a new edge; the first does.
    ``lost_share``: Share of the force that is lost with one tooth; 0 where it is not known. Raises InputError: no run,
    or lengths below zero.
    """
    n = len(factors)
    if n == 0 or np.any(cut_m <= 0.0):
        raise InputError("no run to follow the force over", value=n)
    s = np.array([f.factor for f in factors])
    sigma = np.maximum(np.array([f.sigma for f in factors]), _FLOOR)
    starts = np.array(is_new, dtype=np.bool_)
    starts[0] = True
    search = _DriftSearch(Series(s, sigma, cut_m, starts, lost_share))
    events = search.best()
    named = tuple(sorted((search.named(e, events) for e in events), key=lambda one: one.at))
    edge, before = search.series.edges(events)
    is_known = n - int(edge[-1]) - 1 >= 1 and bool(np.any(np.bincount(edge) > 1))
    return _drift(search, events, named, edge, before, is_known)


class _DriftSearch:
    """Event sets of one series, each weighed once with every shape."""

    def __init__(self, series: Series) -> None:
        self.series = series
        self._known: dict[tuple[ToolEvent, ...], list[Weighed]] = {}
        self._scores: dict[tuple[ToolEvent, ...], float] = {}
        self._added: dict[tuple[ToolEvent, ...], list[tuple[ToolEvent, ...]]] = {}

    def score(self, events: tuple[ToolEvent, ...]) -> float:
        """Logarithm of the evidence of an event set, over all shapes."""
        if events not in self._scores:
            self._scores[events] = score(self.weighed([events])[0])
        return self._scores[events]

    def weighed(self, sets: Sequence[tuple[ToolEvent, ...]]) -> list[list[Weighed]]:
        """Hypotheses of event sets, over all shapes."""
        needed = [events for events in dict.fromkeys(sets) if events not in self._known]
        if needed:
            weighed = weigh(self.series, [design(self.series, events, shape) for events in needed for shape in SHAPES])
            for i, events in enumerate(needed):
                self._known[events] = weighed[i * len(SHAPES) : (i + 1) * len(SHAPES)]
        return [self._known[events] for events in sets]

    def best(self) -> tuple[ToolEvent, ...]:
        """Event set of the largest odds among those that single changes lead to; every event in it pays."""
        events: tuple[ToolEvent, ...] = ()
        for _ in range(MOST_EVENTS):
            more = self._best_of(self.additions(events))
            if more is None or self.score(more) - self.score(events) < math.log(NAMED):
                return events
            events = self._settled(more)
        return events

    def near(self, events: tuple[ToolEvent, ...]) -> list[tuple[ToolEvent, ...]]:
        """The set, and those one change away from it."""
        return [events, *self.additions(events), *self._changes(events), *self._removals(events)]

    def named(self, event: ToolEvent, events: tuple[ToolEvent, ...]) -> NamedEvents:
        """An event of the best set, its odds, and the kinds that it may be."""
        rest = tuple(e for e in events if e != event)
        kinds: dict[Kind, float] = {}
        for kind in Kind:
            other = self._of_kind(event, kind)
            if other is not None:
                kinds[kind] = self.score(_ordered((*rest, other)))
        total = log_sum(np.array(list(kinds.values())))
        shares = sorted(((k, math.exp(v - total)) for k, v in kinds.items()), key=lambda one: -one[1])
        odds = math.exp(min(50.0, total - self.score(rest)))
        return NamedEvents(event.at, event.until, self._size(event, events), odds, tuple(shares))

    def additions(self, events: tuple[ToolEvent, ...]) -> list[tuple[ToolEvent, ...]]:
        """Sets with one event more, the few that simple shapes find the most probable."""
        if events not in self._added:
            self._added[events] = self._more(events)
        return self._added[events]

    def _more(self, events: tuple[ToolEvent, ...]) -> list[tuple[ToolEvent, ...]]:
        taken = {e.at for e in events}
        n, starts = len(self.series.factor), self.series.starts
        more = [
            _ordered((*events, event))
            for at in range(1, n)
            if at not in taken and not starts[at]
            for event in self._at(at)
        ]
        if not more:
            return []
        weighed = weigh(self.series, [design(self.series, e, shape) for e in more for shape in (CONSTANT, LINE)])
        scores = [score(weighed[2 * i : 2 * i + 2]) for i in range(len(more))]
        return [more[i] for i in np.argsort(scores)[::-1][:_CLOSE]]

    def _at(self, at: int) -> list[ToolEvent]:
        """Events that there may be at a run."""
        n = len(self.series.factor)
        out = [ToolEvent(kind, at) for kind in Kind if kind is not Kind.PASSING and self._is_possible(kind)]
        return out + [ToolEvent(Kind.PASSING, at, to) for to in range(at + 1, min(n, at + 1 + LONGEST_STRETCH))]

    def _is_possible(self, kind: Kind) -> bool:
        return kind is not Kind.LOST_TOOTH or self.series.lost_share > 0.0

    def _of_kind(self, event: ToolEvent, kind: Kind) -> ToolEvent | None:
        """The event as one of another kind; None where it cannot be."""
        if kind is event.kind:
            return event
        return None if kind is Kind.PASSING or not self._is_possible(kind) else ToolEvent(kind, event.at)

    def _changes(self, events: tuple[ToolEvent, ...]) -> list[tuple[ToolEvent, ...]]:
        """Sets with one event moved by a run or of another kind, two made one that passes, or one made two."""
        taken, out = {e.at for e in events}, []
        for event in events:
            rest = tuple(e for e in events if e != event)
            out += [_ordered((*rest, *others)) for others in self._in_place_of(event, taken)]
            for later in rest:
                if later.at > event.at and Kind.PASSING not in (event.kind, later.kind):
                    others = tuple(e for e in rest if e != later)
                    out.append(_ordered((*others, ToolEvent(Kind.PASSING, event.at, later.at))))
        return out

    def _in_place_of(self, event: ToolEvent, taken: set[int]) -> Iterator[tuple[ToolEvent, ...]]:
        """One event of another kind, or a run earlier or later; one that passes as its two ends."""
        for kind in Kind:
            other = self._of_kind(event, kind)
            if other is not None and other != event:
                yield (other,)
        for at in (event.at - 1, event.at + 1):
            if 0 < at < len(self.series.factor) and at not in taken and not self.series.starts[at]:
                until = event.until if event.until > at else 0
                if event.kind is not Kind.PASSING or until:
                    yield (ToolEvent(event.kind, at, until),)
        if event.kind is Kind.PASSING and event.until not in taken:
            for kind in (Kind.CHIPPED, Kind.MATERIAL):
                yield ToolEvent(kind, event.at), ToolEvent(Kind.NEW_EDGE, event.until)

    def _removals(self, events: tuple[ToolEvent, ...]) -> list[tuple[ToolEvent, ...]]:
        return [tuple(e for e in events if e != event) for event in events]

    def _best_of(self, sets: list[tuple[ToolEvent, ...]]) -> tuple[ToolEvent, ...] | None:
        if not sets:
            return None
        self.weighed(sets)  # in one batch
        return max(sets, key=self.score)

    def _settled(self, events: tuple[ToolEvent, ...]) -> tuple[ToolEvent, ...]:
        """The set after changes that raise its odds, and without events that no longer pay."""
        for _ in range(4 * MOST_EVENTS):
            other = self._best_of(self._changes(events))
            less = self._best_of(self._removals(events))
            if less is not None and self.score(events) - self.score(less) < math.log(NAMED):
                events = less
            elif other is not None and self.score(other) > self.score(events) + 1e-9:
                events = other
            else:
                break
        return events

    def _size(self, event: ToolEvent, events: tuple[ToolEvent, ...]) -> float:
        """Change of the expected factor at an event, share of that before it."""
        one = max(self.weighed([events])[0], key=lambda w: float(np.max(w.log_weight)))
        expected = one.design.rows @ one.mean[int(np.argmax(one.log_weight))]
        return float(expected[event.at] / expected[event.at - 1] - 1.0)


def _ordered(events: tuple[ToolEvent | None, ...]) -> tuple[ToolEvent, ...]:
    return tuple(sorted((e for e in events if e is not None), key=lambda e: (e.at, e.until)))


def _drift(
    search: _DriftSearch,
    events: tuple[ToolEvent, ...],
    named: tuple[NamedEvents, ...],
    edge: Int,
    before: Float,
    is_known: bool,
) -> ForceDrift:
    """Growth over all hypotheses near the best one, by draws from their mixture."""
    near = [w for group in search.weighed(search.near(events)) for w in group]
    weight = np.concatenate([w.log_weight for w in near])
    weight = np.exp(weight - log_sum(weight))
    own = [(w.design.shape.name, float(np.sum(np.exp(w.log_weight)))) for w in _scaled(search.weighed([events])[0])]
    shapes: dict[str, float] = {}
    for name, share in own:
        shapes[name] = shapes.get(name, 0.0) + share
    shape, share = max(shapes.items(), key=lambda one: one[1])
    tau = scatters(search.series)
    grown, slope, expected = _draws(near, weight, len(tau))
    force = expected / expected[:, :1]
    low, high = 0.5 - 0.5 * LEVEL, 0.5 + 0.5 * LEVEL
    known = (float(np.median(slope)), *np.quantile(slope, [low, high]).tolist())
    growth = (float(np.median(grown)), *np.quantile(grown, [low, high]).tolist())
    if not is_known:
        known, growth = (0.0, -math.inf, math.inf), (0.0, -math.inf, math.inf)
    scatter = float(np.sum(weight.reshape(-1, len(tau)) @ tau))
    return ForceDrift(
        edge, before, named, shape, share, np.mean(expected, axis=0), np.mean(force, axis=0), np.std(force, axis=0),
        known[0], known[1], known[2], scatter, growth[0], growth[1], growth[2], is_known,
    )  # fmt: skip


def _scaled(weighed: Sequence[Weighed]) -> list[Weighed]:
    """The same with evidences that sum to 1."""
    total = score(weighed)
    return [Weighed(w.design, w.log_weight - total, w.mean, w.covariance) for w in weighed]


def _draws(near: Sequence[Weighed], weight: Float, count: int) -> tuple[Float, Float, Float]:
    """Growth, slope, and expected factor of each run, drawn from the mixture with a fixed seed."""
    # Fixed: the same runs must give the same life of a tool in every report.
    rng = np.random.default_rng(0)
    number = np.floor(np.cumsum(weight) * _DRAWS + 0.5).astype(np.int64)
    number = np.diff(number, prepend=0)
    grown, slope, expected = [], [], []
    for i in np.flatnonzero(number).tolist():
        w, t = near[i // count], i % count
        root = np.linalg.cholesky(w.covariance[t] + 1e-15 * np.eye(w.mean.shape[1]))
        b = w.mean[t] + rng.standard_normal((number[i], w.mean.shape[1])) @ root.T
        d = w.design
        level = b @ d.start
        steps = sum((np.maximum(0.0, b[:, j]) for j in d.steps), np.zeros(len(b)))
        grown.append((b @ d.growth + steps) / level)
        slope.append(b @ d.slope / level)
        expected.append(b @ d.rows.T)
    return np.concatenate(grown), np.concatenate(slope), np.concatenate(expected)
