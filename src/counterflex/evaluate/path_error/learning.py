"""Iterative learning from part to part: response of the tool, error that the next part would show, best next step.

The tool follows a further displacement ``x`` that a program takes back by ``A x``, with

    A = I - sum_k r_k P_k,    P_k x = gain_k x + delay_k dx/dt.

A gain of ``-0.2`` is a tool that follows by 1.2; a positive delay is a tool that comes late. Every ``P_k`` is scaled so
that ``r_k`` has the standard deviation 1 before a part was measured. Two consecutive parts show
``e_after - e_before + x = sum_k r_k P_k x``, from which the response r is estimated (least squares, weighted by the
noise of both scans and the scatter of parts): a secant in a few directions.

The error is carried from part to part by a Kalman filter. A step adds the uncertainty of the response to the variance;
a scan replaces the prediction where its own variance is smaller. So the newest part counts most, and parts of one and
the same program are averaged. The next step minimises the expected square of the next error, each row weighted by the
inverse of its variance (norm-optimal iterative learning with an uncertain response):

    min_x  E |e - A x|^2_W + |dx/dt|^2 / RATE^2 + |x|^2 / SIZE^2

Rows that no part shows have the weight 0: there the step fades from the nearest seen row within ``SIZE / RATE``. It is
zero in a run of feed that no part shows.

Source: Bristow, Tharayil and Alleyne 2006, A survey of iterative learning control; Owens 2016, Iterative learning
control: an optimization paradigm, ch. 9 and 10.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np
import scipy

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.errors import InputError
from counterflex.core.units import MM, UM, plain
from counterflex.evaluate.path_error.contacts import UNREST_M, Contacts
from counterflex.evaluate.path_error.estimate import PathError

LOCAL: Final = 0.05
"""Standard deviation of the response of single places about the law above, as a share of the step: assumed."""
SCATTER_M: Final = 8.0 * UM
"""Standard deviation of parts of one program about each other before two were measured. Assumed: half of what a pose
repeatability of 0.05 mm allows, which ISO 9283 states as three standard deviations."""
_SCATTER_FREEDOM: Final = (4.0, 6.0)
"""Degrees of freedom of that figure, and of one pair of parts: its scatter is smooth, so many rows are few values."""
RATE_M_S: Final = 4.0 * MM
SIZE_M: Final = 8.0 * MM
"""Weak limits of a step: it fades over two seconds, 50 mm at 25 mm/s, where no part shows an error. A lead-in that ends
sooner turns the axes round before the tool is in the cut."""
_FEW: Final = 30  # Rows below which two parts say nothing about scatter or response
SPREAD: Final = 1.5
"""Factor within which the size of what the tool may do besides is known (log-normal): friction differs among robots."""
RESTLESS: Final = 0.6
"""Scatter of parts by narrow errors, as a share of scatter times unrest. Third parts of the groove, tuning seeds 1 to 8
of three families: with 0, 0.35, 0.6 of it 6, 1, 0 of 24 exceed their interval, at 1.64, 1.51, 1.14 times the median."""
_SHARE: Final = 0.997
_SEED: Final = 21


@dataclass(frozen=True, eq=False)
class MeasuredError:
    """Error of the path of one part, at the n rows of the path."""

    taken_m: Float  # (n, 3) m, displacement of the tool that its program took back because of earlier parts
    error_m: Float  # (n, 3) m, error that it left; zero where none is believed
    sigma_m: Float  # (n, 3) m, standard deviations of the error
    seen: Bool  # (n, 3) True where the part shows the component


@dataclass(frozen=True, eq=False)
class ToolResponse:
    """Ways in which the tool may follow a further displacement late, too little or too far; k ways, n rows."""

    time_s: Float  # (n,) s, non-decreasing
    group: Int  # (n,) number of the run of feed
    gain: Float  # (k, n, 3) share of the displacement, one standard deviation each
    delay_s: Float  # (k, n, 3) s, time of delay, one standard deviation each
    aside_m: float = 0.0  # standard deviation of the lost motion of an axis that turns back, m

    @cached_property
    def rate(self) -> Any:
        """(n, n) sparse matrix, derivative by time from the two neighbours within the group; 1/s."""
        n = len(self.time_s)
        low, high = np.maximum(np.arange(n) - 1, 0), np.minimum(np.arange(n) + 1, n - 1)
        low = np.where(self.group[low] == self.group, low, np.arange(n))
        high = np.where(self.group[high] == self.group, high, np.arange(n))
        step = self.time_s[high] - self.time_s[low]
        slope = np.where(step > 0.0, 1.0 / np.where(step > 0.0, step, 1.0), 0.0)
        rows = np.concatenate([np.arange(n), np.arange(n)])
        return scipy.sparse.csr_matrix((np.concatenate([slope, -slope]), (rows, np.concatenate([high, low]))), (n, n))

    def patterns(self, step_m: Float) -> Float:
        """(k, n, 3) m, what each way adds to the error after a step (n, 3) m."""
        out: Float = self.gain * step_m + self.delay_s * (self.rate @ step_m)
        return out

    def aside(self, step_m: Float) -> float:
        """Standard deviation of the lost motion after a step, m: at most a quarter of the step."""
        return min(self.aside_m, 0.25 * float(np.max(np.abs(step_m), initial=0.0)))


@dataclass(frozen=True, eq=False)
class Learned:
    """Error that the next part would show if its program did not change, and how the tool follows a change."""

    error_m: Float  # (n, 3) m
    sigma_m: Float  # (n, 3) m, its standard deviation, with the scatter of the next part left out
    seen: Bool  # (n, 3) True where any part shows the component
    response: Float  # (k,) response, in prior standard deviations
    covariance: Float  # (k, k)
    scatter_m: float  # standard deviation of a part about what repeats, m, > 0
    between_m: float  # the same from parts of one program alone, m; nan without two of them
    inflation: float  # factor of the standard deviations: errors after steps over the expected ones, >= 1

    def best_step(self, following: ToolResponse) -> Float:
        """(n, 3) m, displacement that the next program takes back besides: the norm-optimal step of the module."""
        out = np.zeros_like(self.error_m)
        for axis in range(3):
            rows = self.seen[:, axis]
            if np.any(rows):
                within = np.isin(following.group, following.group[rows])
                out[:, axis] = np.where(within, self._step_of_axis(following, axis), 0.0)
        return out

    def _step_of_axis(self, following: ToolResponse, axis: int) -> Float:
        """(n,) m, solution of the normal equations of one axis."""
        D, n = following.rate, len(self.error_m)
        eye, diagonal = scipy.sparse.identity(n, format="csr"), scipy.sparse.diags
        weight = np.where(self.seen[:, axis], 1.0 / (self.sigma_m[:, axis] ** 2 + self.scatter_m**2), 0.0)
        W = diagonal(weight)
        gain, delay_s = following.gain[:, :, axis], following.delay_s[:, :, axis]
        A = eye - diagonal(self.response @ gain) - diagonal(self.response @ delay_s) @ D
        normal = A.T @ W @ A + LOCAL**2 * W + (D.T @ D) / RATE_M_S**2 + eye / SIZE_M**2
        size, vectors = np.linalg.eigh(self.covariance)
        for s, v in zip(np.maximum(size, 0.0), vectors.T, strict=True):
            way = diagonal(v @ gain) + diagonal(v @ delay_s) @ D
            normal = normal + s * (way.T @ W @ way)
        out: Float = scipy.sparse.linalg.spsolve(normal.tocsc(), A.T @ (weight * self.error_m[:, axis]))
        return out


def learned(parts: Sequence[MeasuredError], following: ToolResponse) -> Learned:
    """Combine the parts of one program, corrected from one to the next.

    Args:
        parts: One or more, in the order in which they were made.
        following: How the tool may follow, before these parts.

    Raises:
        InputError: There is none, or their paths have different lengths.
    """
    if not parts:
        raise InputError("no part was measured")
    if len({part.error_m.shape for part in parts}) > 1:
        raise InputError("the parts were made by programs of different lengths")
    between, scatter = scatter_of(parts)
    response, covariance = response_of(parts, following, scatter)
    mean, variance = parts[0].error_m, np.where(parts[0].seen, parts[0].sigma_m ** 2 + scatter**2, np.inf)
    ratios = []
    for before, part in itertools.pairwise(parts):
        step, noise = part.taken_m - before.taken_m, part.sigma_m**2 + scatter**2
        if np.any(step):
            mean, variance = _after_step(mean, variance, step, following, response, covariance)
            known = part.seen & np.isfinite(variance)
            if int(np.sum(known)) >= _FEW:
                ratios.append(np.mean((part.error_m - mean)[known] ** 2 / (variance + noise)[known]))
        share = np.where(part.seen, _share_of_scan(variance, noise), 0.0)
        mean = mean + share * (part.error_m - mean)
        variance = np.where(part.seen, share * noise, variance)
    seen = np.isfinite(variance)
    sigma = np.where(seen, np.sqrt(np.where(seen, variance, 0.0)), np.max([p.sigma_m for p in parts], axis=0))
    inflation = max(1.0, float(np.sqrt(np.mean(ratios)))) if ratios else 1.0
    return Learned(mean, sigma, seen, response, covariance, scatter, between, inflation)


def _after_step(
    mean: Float, variance: Float, step: Float, following: ToolResponse, response: Float, covariance: Float
) -> tuple[Float, Float]:
    """Error and variance (n, 3) that are predicted after a step."""
    patterns = following.patterns(step)
    doubt = np.einsum("knc,kl,lnc->nc", patterns, covariance, patterns)
    after: Float = mean - step + np.tensordot(response, patterns, 1)
    return after, variance + doubt + (LOCAL * step) ** 2 + following.aside(step) ** 2


def _share_of_scan(variance: Float, noise: Float) -> Float:
    """Gain of the Kalman filter; 1 where nothing was known before."""
    known = np.isfinite(variance)
    out: Float = np.where(known, np.where(known, variance, 0.0) / (np.where(known, variance, 0.0) + noise), 1.0)
    return out


def scatter_of(parts: Sequence[MeasuredError]) -> tuple[float, float]:
    """Scatter of parts of one and the same program beyond the noise of their scans, m: of them alone, and in all.

    The second is never zero: :data:`SCATTER_M` counts beside the pairs.
    """
    excess = []
    for i, one in enumerate(parts):
        for other in parts[i + 1 :]:
            both = one.seen & other.seen
            if np.array_equal(one.taken_m, other.taken_m) and int(np.sum(both)) >= _FEW:
                half = 0.5 * (one.error_m - other.error_m)[both] ** 2
                own = 0.5 * (one.sigma_m**2 + other.sigma_m**2)[both]
                excess.append(max(0.0, float(np.mean(half - own))))
    alone = float(np.sqrt(np.mean(excess))) if excess else float("nan")
    before, pair = _SCATTER_FREEDOM
    square = (before * SCATTER_M**2 + pair * sum(excess)) / (before + pair * len(excess))
    return alone, float(np.sqrt(square))


def response_of(parts: Sequence[MeasuredError], following: ToolResponse, scatter_m: float) -> tuple[Float, Float]:
    """Estimate how the tool follows from each step and the two parts before and after it.

    Returns:
        response (k,) and its covariance (k, k), in prior standard deviations.
    """
    k = len(following.gain)
    precision, right = np.eye(k), np.zeros(k)
    for before, part in itertools.pairwise(parts):
        step, both = part.taken_m - before.taken_m, before.seen & part.seen
        if not np.any(step[both]) or int(np.sum(both)) < _FEW:
            continue
        variance = before.sigma_m**2 + part.sigma_m**2 + 2.0 * scatter_m**2 + (LOCAL * step) ** 2
        aside = following.aside(step) * np.broadcast_to(np.eye(3)[:, None, :], (3, *step.shape))
        H = np.concatenate([following.patterns(step), aside])[:, both] / np.sqrt(variance[both])
        z = (part.error_m - before.error_m + step)[both] / np.sqrt(variance[both])
        N, b = H @ H.T, H @ z
        residual = z - np.linalg.solve(N + np.eye(len(N)), b) @ H
        alike = _alike(residual, both)
        N, b = N / alike, b / alike
        inner = np.linalg.inv(N[k:, k:] + np.eye(3))  # lost motion is of this step alone
        precision += N[:k, :k] - N[:k, k:] @ inner @ N[k:, :k]
        right += b[:k] - N[:k, k:] @ inner @ b[k:]
    covariance = np.asarray(np.linalg.inv(precision), dtype=np.float64)
    return covariance @ right, covariance


def _alike(residual: Float, both: Bool) -> float:
    """Rows that say as much as one independent one, >= 1: correlation of neighbours, and size beyond the expected."""
    full = np.zeros(both.shape)
    full[both] = residual
    joined = both[1:] & both[:-1]
    square = float(np.mean(residual**2)) or 1.0
    lag = float(np.mean((full[1:] * full[:-1])[joined])) / square if np.any(joined) else 0.0
    lag = float(np.clip(lag, 0.0, 0.995))
    return max(1.0, square) * (1.0 + lag) / (1.0 - lag)


@dataclass(frozen=True)
class ExpectedSurface:
    """Deviation of the surface that 99.7 % of the places stay below, m, without the noise of the scan."""

    now_m: float  # of the measured part
    median_m: float  # of the next one
    low_m: float  # 5 % of what may be are below
    high_m: float  # 5 % are above

    def shown(self) -> dict[str, Any]:
        """Shop units."""
        return plain(
            self,
            "now_p997_um=now_m:1 next_p997_um=median_m:1 next_5_percent_um=low_m:1 next_95_percent_um=high_m:1",
        )


def surface_now(estimate: PathError, contacts: Contacts) -> float:
    """Deviation of the measured part's surface that 99.7 % of the places stay below, m, without noise of the scan."""
    return _figure(contacts, np.mean(estimate.draws_m, axis=0))


def expected(
    estimate: PathError, contacts: Contacts, change_m: Float, unsure_m: Float, scatter_m: float
) -> ExpectedSurface:
    """Predict the surface of the next part.

    A part differs from the one before even if its program does not: by an offset of the whole part and one of each run
    of feed, which share the variance ``scatter_m^2`` of each axis, and by :data:`RESTLESS` times as much as the nodes
    are restless, independent from one :data:`UNREST_M` to the next: drives turn round there, no two times alike.

    Args:
        estimate: Error of the measured part's path.
        contacts: Of the places with the path.
        change_m: (k, 3) m, expected error of the next part minus that of the measured one, at the nodes.
        unsure_m: (j, k, 3) m, independent patterns of what the tool may do besides, one standard deviation each.
        scatter_m: Standard deviation of parts of one program about each other, m.
    """
    rng = np.random.default_rng(_SEED)
    count = len(estimate.draws_m)
    sizes = SPREAD ** rng.standard_normal((count, 1)) * rng.standard_normal((count, len(unsure_m)))
    besides = np.einsum("dj,jkc->dkc", sizes, unsure_m)
    chain, station = estimate.nodes.chain, estimate.nodes.station_m
    way = np.cumsum(np.abs(np.diff(station, prepend=0.0))) / (0.5 * UNREST_M)
    offset = rng.standard_normal((count, int(chain.max(initial=0)) + 1, 3))[:, chain]
    offset = np.sqrt(0.5) * scatter_m * (offset + rng.standard_normal((count, 1, 3)))
    knot = np.floor(way).astype(np.int64)
    knots, share = rng.standard_normal((count, int(knot[-1]) + 2, 3)), (way - knot)[:, None]
    narrow = knots[:, knot] + share * (knots[:, knot + 1] - knots[:, knot])
    restless = RESTLESS * scatter_m * (estimate.nodes.unrest - 1.0)[:, None]
    after = [_figure(contacts, error) for error in estimate.draws_m + change_m + besides + offset + restless * narrow]
    low, median, high = np.quantile(after, (0.05, 0.5, 0.95)).tolist()
    return ExpectedSurface(surface_now(estimate, contacts), median, low, high)


def _figure(contacts: Contacts, error_m: Float) -> float:
    return float(np.quantile(np.abs(contacts.left_on(error_m)), _SHARE))
