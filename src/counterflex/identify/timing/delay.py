"""Dead time, lag and clock of one channel against another, fitted in continuous time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final, Literal

import numpy as np
import scipy

from counterflex.core.arrays import Float, Int
from counterflex.core.errors import InputError
from counterflex.core.units import MS
from counterflex.identify.solver.fit import Fit
from counterflex.identify.solver.holdout import HeldOut, cross_validate
from counterflex.identify.solver.jackknife import stretches, widened, with_correlation, with_jackknife
from counterflex.identify.solver.parameters import Parameter, Parameters
from counterflex.identify.solver.solve import Stop, solve
from counterflex.identify.timing.residuals import Basis, DelayResiduals, Order, Places
from counterflex.identify.timing.stamped import Stamped
from counterflex.signals.lag import coarse_shift

LAG_BOUNDS_S: Final = (1e-5, 2.0)
STRETCHES: Final = 20
"""Stretches of a record that hold-out keeps together."""
SAME_CLOCK_S: Final = 1.0
"""Largest delay that is looked for between channels of one clock."""
MOST_ROWS: Final = {"own": 3000, "matrix": 1000}
"""Samples of the answer that are used, by mixing; of longer records every second, third, ... one."""
GROSS: Final = 10.0
"""Samples whose residual exceeds this many times the median are left out as outliers."""
_GRID_PER_SAMPLE = 2
_MOST_GRID = 400_000
_SIGNIFICANT = 3.0
_STEPS = 12


@dataclass(frozen=True, eq=False)
class Extra:
    """A known signal that takes part in the answer beside the reference."""

    name: str  # of its parameters, followed by the component's label
    unit: str  # SI unit of the coefficient
    values: Float  # (n, m) at the stamps of the reference, one column per component of the answer
    nominal: Float  # (m,) coefficient known before
    scale: float  # ordinary size of the coefficient


@dataclass(frozen=True, eq=False)
class Pair:
    """A channel and the one it follows."""

    name: str  # of the pair, first part of its parameters' names
    reference: Stamped
    answer: Stamped
    labels: tuple[str, ...]  # (m,) of the answer's components, for parameter names
    components: tuple[str, ...]  # (m,) of the answer's components with unit
    # `own`: each component follows its own of the reference; `matrix`: any of them (other axes)
    mixing: Literal["own", "matrix"] = "own"
    each: bool = False  # each component has a delay of its own
    derivative: int = 0  # the answer follows this derivative of the reference by time (2: a force of inertia)
    # the second derivative of what leads takes part as well: what inertia bends grows with the square of the frequency
    # and must not be taken for a lag
    inertia: bool = False
    extras: tuple[Extra, ...] = ()  # further known signals
    delay_s: float = 0.0  # known before, s
    lag: bool = False  # a lag large enough to be told from a dead time is to be expected

    @property
    def same_clock(self) -> bool:
        """Return whether one clock stamped both."""
        return self.reference.clock == self.answer.clock


@dataclass(frozen=True, eq=False)
class Delay:
    """Result for a pair."""

    pair: Pair
    block: DelayResiduals
    parameters: Parameters
    fit: Fit  # with standard deviations that allow for correlated residuals
    order: Order  # of the lag that was fitted
    held_out: HeldOut  # errors on stretches of time that their fit had not seen

    def value(self, name: str) -> float:
        """SI value of a parameter by the last part of its name."""
        return self.fit.value(f"{self.pair.name}.{name}")

    def sigma(self, name: str) -> float:
        """SI standard deviation of a parameter by the last part of its name."""
        return self.fit.sigma_of(f"{self.pair.name}.{name}")


def find_delay(pair: Pair, order: Order | Literal["auto"] = "auto", *, robust: bool = True) -> Delay:
    """Fit delay, lag, gains and, between two clocks, drift of a pair of channels.

    ``order``: Of the lag; ``auto`` takes first order where one is to be expected and its time stands three standard
    deviations clear of zero. Without a lag the delay is that of slow motion, dead time and lag together.

    Returns:
        The fit. Standard deviations are the largest of the sandwich estimate of
        :mod:`counterflex.identify.solver.jackknife`, the jackknife over ten stretches in order of time
        (:mod:`counterflex.identify.solver.jackknife`: what the model lacks lasts as long as a motion does, which the
        sandwich cuts off) and the jackknife over the folds held out.

    Raises:
        InputError: The reference does not move, or the records do not overlap.
    """
    shift = _coarse(pair)
    if order != "auto" or not pair.lag:
        return _fitted(pair, "none" if order == "auto" else order, shift, robust)
    plain = _fitted(pair, "none", shift, robust)
    lagged = _fitted(pair, "first", shift, robust)
    # Both: a lag can be significant and still predict no better, when it only mimics what the model lacks.
    clear = lagged.value("lag") > _SIGNIFICANT * lagged.sigma("lag") and lagged.value("lag") > 10.0 * LAG_BOUNDS_S[0]
    better = lagged.held_out.rms()[0] < plain.held_out.rms()[0]
    return lagged if clear and better else plain


def build(pair: Pair, order: Order, shift_s: float) -> tuple[Parameters, DelayResiduals, Float, tuple[str, ...]]:
    """Parameters, residuals, start values and the names that any use has to find first (offsets and gains).

    ``shift_s``: Rough delay, s: where the search starts.
    """
    basis, columns = _basis(pair)
    answer = pair.answer
    m = answer.values.shape[1]
    margin = min(0.2, 0.05 * (basis.end_s - basis.start_s))
    seen_at = answer.time_s - shift_s
    rows = (seen_at >= basis.start_s + margin) & (seen_at <= basis.end_s - margin)
    if int(rows.sum()) < 10 * m:
        raise InputError(
            "the records hardly overlap", where=answer.where, value=f"{int(rows.sum())} samples", limit=f">= {10 * m}"
        )
    used = np.flatnonzero(rows)[:: max(1, -(-int(rows.sum()) // MOST_ROWS[pair.mixing]))]
    time, values = answer.time_s[used], answer.values[used]
    items, places, needed = _parameters(pair, order, basis, columns, values, shift_s)
    parameters = Parameters.of(items)
    block = DelayResiduals(
        name=pair.name,
        group=np.minimum(np.arange(len(time)) * STRETCHES // len(time), STRETCHES - 1).astype(np.int64),
        components=pair.components,
        sigma=answer.sigma[used],
        time_s=time,
        measured=values,
        middle_s=float(0.5 * (time[0] + time[-1])),
        basis=basis,
        places=places,
        count=len(items),
    )
    start = parameters.nominal
    start[list(places.delay)] = shift_s
    if places.lag >= 0:
        start[places.lag] = 3.0 * MS
    _linear_start(block, start, [*places.offset, *(i for row in places.gain for i in row if i >= 0)])
    return parameters, block, start, needed


def _parameters(
    pair: Pair, order: Order, basis: Basis, columns: Sequence[Sequence[int]], values: Float, shift_s: float
) -> tuple[list[Parameter], Places, tuple[str, ...]]:
    """Parameters in their order, their places, and the names of offsets and gains."""
    m, size = values.shape[1], np.maximum(np.std(values, axis=0), 1e-12)
    items: list[Parameter] = []
    add = partial(_added, items, pair.name)
    before = pair.delay_s if pair.same_clock else shift_s
    if pair.each:
        delay = tuple(add(f"delay{label}", "s", before, 10.0 * MS) for label in pair.labels)
    else:
        delay = (add("delay", "s", before, 10.0 * MS),) * m
    drift = -1 if pair.same_clock else add("drift", "1", 0.0, 1e-3)
    low, high = LAG_BOUNDS_S
    lag = -1 if order == "none" else add("lag", "s", low, 50.0 * MS, lower=low, upper=high)
    damping = add("damping", "1", 0.7, 0.2, lower=0.01, upper=10.0) if order == "second" else -1
    offset, begin = [], len(items)
    for c, label in enumerate(pair.labels):
        mean, unit = float(np.mean(values[:, c])), pair.components[c].rsplit(" ", 1)[1]
        offset.append(add(f"offset{label}", unit, mean, float(abs(mean) + size[c])))
    gain = _gains(pair, basis, columns, size, add)
    needed = tuple(item.name for item in items[begin:])
    first = basis.values.shape[1] - m * len(pair.extras)
    for e, extra in enumerate(pair.extras):
        for c, label in enumerate(pair.labels):
            gain[c, first + e * m + c] = add(f"{extra.name}{label}", extra.unit, float(extra.nominal[c]), extra.scale)
    gains = tuple(tuple(int(i) for i in row) for row in gain)
    return items, Places(delay, tuple(offset), gains, drift, lag, damping), needed


def _gains(pair: Pair, basis: Basis, columns: Sequence[Sequence[int]], size: Float, add: Callable[..., int]) -> Int:
    """(m, B) places of the gains, and with inertia of the second derivatives behind them; -1 elsewhere."""
    gain = np.full((len(pair.labels), basis.values.shape[1]), -1, dtype=np.int64)
    moving = int(basis.lagged.sum()) // (2 if pair.inertia else 1)
    nominal = 1.0 if pair.mixing == "own" and pair.derivative == 0 else 0.0
    for c, label in enumerate(pair.labels):
        for b in columns[c]:
            spread = max(float(np.std(basis.values[:, b])), 1e-15)
            suffix = label if pair.mixing == "own" else f"{label}{b + 1}"
            gain[c, b] = add(f"gain{suffix}", "1", nominal, float(size[c]) / spread)
            if pair.inertia:
                spread = max(float(np.std(basis.values[:, moving + b])), 1e-15)
                gain[c, moving + b] = add(f"inertia{suffix}", "s2", 0.0, float(size[c]) / spread)
    return gain


def _added(items: list[Parameter], pair: str, name: str, unit: str, nominal: float, scale: float, **more: float) -> int:
    items.append(Parameter(f"{pair}.{name}", unit, nominal, np.inf, scale=scale, **more))  # type: ignore[arg-type]
    return len(items) - 1


def _fitted(pair: Pair, order: Order, shift: float, robust: bool) -> Delay:
    parameters, block, start, needed = build(pair, order, shift)
    start = _refined(parameters, block, start)
    if robust:
        size = np.sqrt(np.mean(block.evaluate(start) ** 2, axis=1))
        block = block.subset(size <= GROSS * float(np.median(size)))
        start = _refined(parameters, block, start)
    stop = Stop(tolerance=1e-9, evaluations=20)
    independent = solve(parameters, [block], robust=False, start=start, stop=stop)
    jackknife = with_jackknife(independent, [block], stretches([block]))
    fit = widened(with_correlation(independent, [block]), np.diag(jackknife.covariance))
    held_out = cross_validate(
        parameters, [block], needed=needed, start=fit.values, robust=False, stop=Stop(tolerance=1e-7, evaluations=10)
    )
    return Delay(pair, block, parameters, _with_jackknife(fit, held_out.fits), order, held_out)


def _refined(parameters: Parameters, block: DelayResiduals, start: Float) -> Float:
    """A few Gauss-Newton steps within the bounds: all but two of the kinds of parameters are linear."""
    x = start.copy()
    low = np.array([p.lower for p in parameters])
    high = np.array([p.upper for p in parameters])
    best = float(np.sum(block.evaluate(x) ** 2))
    for _ in range(_STEPS):
        r = block.evaluate(x).reshape(-1)
        J = block.jacobian(x).reshape(len(r), -1)
        scale = np.maximum(np.linalg.norm(J, axis=0), 1e-300)
        A = J / scale
        move = np.linalg.lstsq(A.T @ A, -(A.T @ r), rcond=1e-12)[0] / scale
        share = 1.0
        while share > 1e-3:
            trial = np.clip(x + share * move, low, high)
            cost = float(np.sum(block.evaluate(trial) ** 2))
            if cost < best:
                break
            share *= 0.5
        else:
            break
        gain, x, best = 1.0 - cost / best, trial, cost
        if gain < 1e-9:
            break
    return x


def _with_jackknife(fit: Fit, parts: Sequence[Fit]) -> Fit:
    """Standard deviations at least those of the jackknife over the folds."""
    k = len(parts)
    values = np.array([part.values for part in parts])
    spread = np.sqrt((k - 1) / k * np.sum((values - values.mean(axis=0)) ** 2, axis=0))
    return replace(fit, sigma=np.maximum(fit.sigma, spread))


def _coarse(pair: Pair) -> float:
    """Rough delay: the best cross-correlation among the components that can belong together."""
    reference, answer = pair.reference, pair.answer
    lead = _derived(reference, pair.derivative)
    m, k = answer.values.shape[1], lead.shape[1]
    step = min(reference.step_s, answer.step_s)
    limit = SAME_CLOCK_S if pair.same_clock else None
    best, best_shift = 0.0, 0.0
    sizes = np.std(lead, axis=0)
    for c in range(m):
        for b in [c] if pair.mixing == "own" else range(k):
            if sizes[b] < 1e-3 * sizes.max() or np.std(answer.values[:, c]) == 0.0:
                continue
            shift, match = coarse_shift(
                reference.time_s, lead[:, b], answer.time_s, answer.values[:, c], step_s=step, limit_s=limit
            )
            if abs(match) > best:
                best, best_shift = abs(match), shift
    if best == 0.0:
        raise InputError(
            "nothing moves in the record, so it contains no information on time",
            where=reference.where,
            hint="Record a chirp or steps that are large against the noise",
        )
    return best_shift


def _derived(stamped: Stamped, order: int) -> Float:
    if order == 0:
        return stamped.values
    out: Float = scipy.interpolate.CubicSpline(stamped.time_s, stamped.values)(stamped.time_s, order)
    return out


def _basis(pair: Pair) -> tuple[Basis, list[list[int]]]:
    """Signals on an even grid, and which of the reference's columns each component of the answer follows."""
    reference, m = pair.reference, pair.answer.values.shape[1]
    step = min(reference.step_s, pair.answer.step_s) / _GRID_PER_SAMPLE
    length = reference.time_s[-1] - reference.time_s[0]
    count = min(int(length / step), _MOST_GRID)
    step = length / count
    grid = reference.time_s[0] + step * np.arange(count + 1)
    spline = scipy.interpolate.CubicSpline(reference.time_s, reference.values)
    lead = spline(grid, pair.derivative)
    size = np.std(lead, axis=0)
    if pair.mixing == "own":
        columns = [[c] for c in range(m)]
    else:
        moving = [int(b) for b in np.flatnonzero(size > 1e-3 * size.max())]
        lead = lead[:, moving]
        columns = [list(range(len(moving)))] * m
    if pair.inertia:
        lead = np.hstack([lead, _second_derivative(lead, step)])
    parts = [lead, *(scipy.interpolate.CubicSpline(reference.time_s, extra.values)(grid) for extra in pair.extras)]
    values = np.hstack(parts)
    lagged = np.arange(values.shape[1]) < lead.shape[1]
    return Basis(float(grid[0]), step, values, lagged), columns


def _second_derivative(values: Float, step: float) -> Float:
    out: Float = np.gradient(np.gradient(values, step, axis=0), step, axis=0)
    return out


def _linear_start(block: DelayResiduals, start: Float, places: Sequence[int]) -> None:
    """Offsets and gains by linear least squares at the start's delay and lag; written into ``start``."""
    chosen = sorted(set(places))
    start[chosen] = 0.0
    r = block.evaluate(start).reshape(-1)
    J = block.jacobian(start).reshape(len(r), -1)[:, chosen]
    scale = np.maximum(np.linalg.norm(J, axis=0), 1e-300)
    start[chosen] = -np.linalg.lstsq(J / scale, r, rcond=1e-10)[0] / scale
