"""Iterative learning from part to part: response of the tool, error that the next part would show, best next step.

The tool follows a further displacement ``x`` that a program takes back by ``A x``, with

    A = I - sum_k theta_k P_k,    P_k x = gain_k x + delay_k dx/dt.

A gain of ``-0.2`` is a tool that follows by 1.2; a positive delay is a tool that comes late. Every ``P_k`` is scaled so
that ``theta_k`` has the standard deviation 1 before a part was measured. Two consecutive parts show
``e_after - e_before + x = sum_k theta_k P_k x``, from which theta is estimated (least squares, weighted by the noise of
both scans and the scatter of parts): a secant in a few directions.

The error is carried from part to part by a Kalman filter. A step adds the doubt of the response to the variance, a scan
replaces the prediction by what it shows, as far as its variance is smaller; so the newest part counts most, and parts
of one and the same program are averaged. The next step minimises the expected square of the next error, each row
weighted by the inverse of its variance (norm-optimal iterative learning with an uncertain response):

    min_x  E |e - A x|^2_W + |dx/dt|^2 / RATE^2 + |x|^2 / SIZE^2

Rows that no part shows have the weight 0: there the step fades from the nearest seen row within ``SIZE / RATE``, and is
zero in a run of which nothing is seen.

Source: Bristow, Tharayil and Alleyne 2006, A survey of iterative learning control; Owens 2016, Iterative learning
control: an optimization paradigm, ch. 9 and 10.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np
import scipy

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.errors import InputError
from counterflex.core.units import MM, UM
from counterflex.evaluate.path_error.repeated import MeasuredError

LOCAL: Final = 0.05
"""Share of a step by which single places answer differently from the law above: its relative standard deviation."""
SCATTER_M: Final = 8.0 * UM
"""Standard deviation of parts of one program about each other before two were measured: a robot repeats a path in one
direction to 10 to 30 um (ISO 9283 gives the range of 3 standard deviations)."""
_SCATTER_FREEDOM: Final = (4.0, 6.0)
"""Degrees of freedom of that figure, and of one pair of parts: its scatter is smooth, so many rows are few values."""
RATE_M_S: Final = 4.0 * MM
SIZE_M: Final = 8.0 * MM
"""Sizes of a step that nothing asks against: it fades over two seconds where no part shows an error."""
_FEW: Final = 30
"""Rows below which two parts say nothing about scatter or response."""


@dataclass(frozen=True, eq=False)
class Following:
    """Ways in which the tool may follow a further displacement otherwise than at once and whole; k ways, n rows."""

    time_s: Float  # (n,) s, non-decreasing
    group: Int  # (n,) number of the run of feed
    gain: Float  # (k, n, 3) share of the displacement, one standard deviation each
    delay_s: Float  # (k, n, 3) s, time of delay, one standard deviation each
    aside_m: float = 0.0  # standard deviation of what an axis that turns back stays aside by, m

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
        """Standard deviation of what an axis stays aside by after a step, m: no more than a quarter of it."""
        return min(self.aside_m, 0.25 * float(np.max(np.abs(step_m), initial=0.0)))


@dataclass(frozen=True, eq=False)
class Learned:
    """Error that the next part would show if its program did not change, and how the tool follows a change."""

    error_m: Float  # (n, 3) m
    sigma_m: Float  # (n, 3) m, its standard deviation, with the scatter of the next part left out
    seen: Bool  # (n, 3) True where any part shows the component
    theta: Float  # (k,) response, in prior standard deviations
    covariance: Float  # (k, k)
    scatter_m: float  # standard deviation of a part about what repeats, m, > 0
    between_m: float  # the same from parts of one program alone, m; nan without two of them
    mismatch: float  # root mean square of the errors after steps over their expected standard deviation, >= 1


def learned(parts: Sequence[MeasuredError], following: Following) -> Learned:
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
    theta, covariance = response_of(parts, following, scatter)
    mean, variance = parts[0].error_m.copy(), np.where(parts[0].seen, parts[0].sigma_m**2 + scatter**2, np.inf)
    ratios = []
    for before, part in zip(parts, parts[1:], strict=False):
        step = part.taken_m - before.taken_m
        if np.any(step):
            patterns = following.patterns(step)
            mean = mean - step + np.tensordot(theta, patterns, 1)
            doubt = np.einsum("knc,kl,lnc->nc", patterns, covariance, patterns)
            variance = variance + doubt + (LOCAL * step) ** 2 + following.aside(step) ** 2
        noise = part.sigma_m**2 + scatter**2
        known = part.seen & np.isfinite(variance)
        if np.any(step) and int(np.sum(known)) >= _FEW:
            ratios.append(np.mean((part.error_m - mean)[known] ** 2 / (variance + noise)[known]))
        share = np.where(np.isfinite(variance), variance / np.where(np.isfinite(variance), variance + noise, 1.0), 1.0)
        share = np.where(part.seen, share, 0.0)
        mean = mean + share * (part.error_m - mean)
        variance = np.where(part.seen, share * noise, variance)
    seen = np.isfinite(variance)
    sigma = np.sqrt(np.where(seen, variance, 0.0))
    sigma = np.where(seen, sigma, np.max([p.sigma_m for p in parts], axis=0))
    mismatch = max(1.0, float(np.sqrt(np.mean(ratios)))) if ratios else 1.0
    return Learned(mean, sigma, seen, theta, covariance, scatter, between, mismatch)


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


def response_of(parts: Sequence[MeasuredError], following: Following, scatter_m: float) -> tuple[Float, Float]:
    """Estimate how the tool follows from each step and the two parts before and after it.

    Returns:
        theta (k,) and its covariance (k, k), in prior standard deviations.
    """
    k = len(following.gain)
    precision, right = np.eye(k), np.zeros(k)
    for before, part in zip(parts, parts[1:], strict=False):
        step = part.taken_m - before.taken_m
        both = before.seen & part.seen
        if not np.any(step[both]) or int(np.sum(both)) < _FEW:
            continue
        patterns = following.patterns(step)
        y = part.error_m - before.error_m + step
        variance = before.sigma_m**2 + part.sigma_m**2 + 2.0 * scatter_m**2 + (LOCAL * step) ** 2
        aside = following.aside(step) * np.broadcast_to(np.eye(3)[:, None, :], (3, *step.shape))
        H = np.concatenate([patterns, aside])[:, both] / np.sqrt(variance[both])
        z = y[both] / np.sqrt(variance[both])
        for _ in range(2):  # the second time with rows that count as much as their residuals are independent
            alike = 1.0 if _ == 0 else _alike((z - theta @ H), both)
            N = H @ H.T / alike + np.diag(np.concatenate([np.zeros(k), np.ones(3)]))
            b = H @ z / alike
            theta = np.linalg.solve(N + np.diag(np.concatenate([np.ones(k), np.zeros(3)])), b)
        inner = np.linalg.inv(N[k:, k:])
        precision += N[:k, :k] - N[:k, k:] @ inner @ N[k:, :k]
        right += b[:k] - N[:k, k:] @ inner @ b[k:]
    covariance: Float = np.linalg.inv(precision)
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


def best_step(state: Learned, following: Following) -> Float:
    """(n, 3) m, displacement that the next program takes back besides: the norm-optimal step of the module."""
    n, out = len(state.error_m), np.zeros_like(state.error_m)
    D = following.rate
    for axis in range(3):
        rows = state.seen[:, axis]
        if not np.any(rows):
            continue
        within = np.isin(following.group, following.group[rows])
        weight = np.where(rows, 1.0 / (state.sigma_m[:, axis] ** 2 + state.scatter_m**2), 0.0)
        W = scipy.sparse.diags(weight)
        ways = [
            scipy.sparse.diags(gain) + scipy.sparse.diags(delay) @ D
            for gain, delay in zip(following.gain[:, :, axis], following.delay_s[:, :, axis], strict=True)
        ]
        eye = scipy.sparse.identity(n, format="csr")
        A = eye - sum((t * way for t, way in zip(state.theta, ways, strict=True)), start=0.0 * eye)
        normal = A.T @ W @ A + LOCAL**2 * W + (D.T @ D) / RATE_M_S**2 + eye / SIZE_M**2
        size, vectors = np.linalg.eigh(state.covariance)
        for s, v in zip(size, vectors.T, strict=True):
            way = sum((c * one for c, one in zip(v, ways, strict=True)), start=0.0 * eye)
            normal = normal + s * (way.T @ W @ way)
        right = A.T @ (weight * state.error_m[:, axis])
        x = scipy.sparse.linalg.spsolve(normal.tocsc(), right)
        out[:, axis] = np.where(within, x, 0.0)
    return out
