"""Error that repeats from part to part, and what a program has to take back in all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float
from counterflex.core.errors import InputError
from counterflex.evaluate.path_error.contacts import Contacts, left_on
from counterflex.evaluate.path_error.estimate import PathError

RESPONSE: Final = 0.1
"""Standard deviation of the factor by which the tool follows a further correction: force and drives answer to it."""
SPREAD: Final = 1.5
"""Factor within which the size of what the tool may do besides is known (log-normal): friction differs among robots."""
_SHARE: Final = 0.997
_SEED: Final = 21


@dataclass(frozen=True)
class Expected:
    """Deviation of the surface that 99.7 % of the places stay below, m, without the noise of the scan."""

    now_m: float  # of the measured part
    median_m: float  # of the next one
    low_m: float  # 5 % of what may be are below
    high_m: float  # 5 % are above


def expected(estimate: PathError, contacts: Contacts, taken_m: Float, unsure_m: Float | None = None) -> Expected:
    """Predict the surface of the next part.

    Args:
        estimate: Error of the measured part's path.
        contacts: Of the places with the path.
        taken_m: (k, 3) m, what the next program takes back of the error.
        unsure_m: (j, k, 3) m, independent patterns of what the tool may do besides, one standard deviation each.
    """
    rng = np.random.default_rng(_SEED)
    factors = 1.0 + RESPONSE * rng.standard_normal(len(estimate.draws_m))
    patterns = np.zeros((0, *taken_m.shape)) if unsure_m is None else unsure_m
    scale = SPREAD ** rng.standard_normal((len(factors), 1))
    sizes = scale * rng.standard_normal((len(factors), len(patterns)))
    besides = np.einsum("dj,jkc->dkc", sizes, patterns)
    after = [
        _figure(contacts, draw - factor * taken_m + other)
        for draw, factor, other in zip(estimate.draws_m, factors, besides, strict=True)
    ]
    low, median, high = np.quantile(after, (0.05, 0.5, 0.95)).tolist()
    return Expected(_figure(contacts, np.mean(estimate.draws_m, axis=0)), median, low, high)


def _figure(contacts: Contacts, error_m: Float) -> float:
    return float(np.quantile(np.abs(left_on(contacts, error_m)), _SHARE))


_FEW: Final = 30
"""Rows below which the scatter of parts is not estimated."""


@dataclass(frozen=True, eq=False)
class MeasuredError:
    """Error of the path of one part, at the n rows of the path."""

    taken_m: Float  # (n, 3) m, displacement of the tool that its program took back because of earlier parts
    error_m: Float  # (n, 3) m, error that it left; zero where none is believed
    sigma_m: Float  # (n, 3) m, standard deviations of the error
    seen: Bool  # (n, 3) True where the part shows the component


@dataclass(frozen=True, eq=False)
class Repeated:
    """Error that all parts together show."""

    total_m: Float  # (n, 3) m, displacement that the next program has to take back
    sigma_m: Float  # (n, 3) m, its standard deviation
    between_m: float  # standard deviation of a part about what repeats, m; nan with one part of a program


def repeated(parts: Sequence[MeasuredError]) -> Repeated:
    """Combine parts of one program, corrected from one to the next.

    Part j says that ``z_j = taken_j + error_j`` has to be taken back. Its variance is that of its error, that of parts
    about each other, and ``(0.1 error_j)^2``: the tool follows a further correction to a tenth only (:data:`RESPONSE`),
    so a part that was far from its target says less about it than the next one. The weights are the inverse variances.

    Args:
        parts: One or more, in the order in which they were made.

    Raises:
        InputError: There is none, or their paths have different lengths.
    """
    if not parts:
        raise InputError("no part was measured")
    if len({part.error_m.shape for part in parts}) > 1:
        raise InputError("the parts were made by programs of different lengths")
    between = _between(parts)
    spread = 0.0 if np.isnan(between) else between
    weights = [1.0 / (p.sigma_m**2 + spread**2 + (RESPONSE * p.error_m) ** 2 + 1e-18) for p in parts]
    weights = [np.where(p.seen, w, 1e-6 * w) for p, w in zip(parts, weights, strict=True)]
    whole = np.sum(weights, axis=0)
    total: Float = np.sum([w * (p.taken_m + p.error_m) for p, w in zip(parts, weights, strict=True)], axis=0) / whole
    unseen = ~np.any([p.seen for p in parts], axis=0)
    total[unseen] = (parts[-1].taken_m + parts[-1].error_m)[unseen]
    return Repeated(total, np.sqrt(1.0 / whole), between)


def _between(parts: Sequence[MeasuredError]) -> float:
    """Scatter of parts of one and the same program beyond what their measurements explain, m."""
    excess = []
    for i, one in enumerate(parts):
        for other in parts[i + 1 :]:
            if not np.array_equal(one.taken_m, other.taken_m):
                continue
            both = one.seen & other.seen
            if int(np.sum(both)) >= _FEW:
                half = 0.5 * (one.error_m - other.error_m)[both] ** 2
                own = 0.5 * (one.sigma_m**2 + other.sigma_m**2)[both]
                excess.append(float(np.mean(half - own)))
    return float(np.sqrt(max(0.0, float(np.mean(excess))))) if excess else float("nan")
