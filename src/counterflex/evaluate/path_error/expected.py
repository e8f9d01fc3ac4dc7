"""What a correction of the path leaves on the surface, before a second part is cut."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
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
    """Deviation of the surface that 99.7 % of the places stay below, m, without the noise of the scan.

    Attributes:
        now_m: Of the measured part.
        median_m: Of the next one.
        low_m: 5 % of what may be are below.
        high_m: 5 % are above.
    """

    now_m: float
    median_m: float
    low_m: float
    high_m: float


def expected(estimate: PathError, contacts: Contacts, taken_m: Float, unsure_m: Float | None = None) -> Expected:
    """Predict the surface of the next part.

    Args:
        estimate: Error of the measured part's path.
        contacts: Of the places with the path.
        taken_m: (k, 3) m, what the next program takes back of the error.
        unsure_m: (j, k, 3) m, independent patterns of what the tool may do besides, one standard deviation each.
    """
    rng = np.random.default_rng(_SEED)

    def figure(error: Float) -> float:
        return float(np.quantile(np.abs(left_on(contacts, error)), _SHARE))

    factors = 1.0 + RESPONSE * rng.standard_normal(len(estimate.draws_m))
    patterns = np.zeros((0, *taken_m.shape)) if unsure_m is None else unsure_m
    scale = SPREAD ** rng.standard_normal((len(factors), 1))
    sizes = scale * rng.standard_normal((len(factors), len(patterns)))
    besides = np.einsum("dj,jkc->dkc", sizes, patterns)
    after = [
        figure(draw - factor * taken_m + other)
        for draw, factor, other in zip(estimate.draws_m, factors, besides, strict=True)
    ]
    low, median, high = np.quantile(after, (0.05, 0.5, 0.95)).tolist()
    return Expected(figure(np.mean(estimate.draws_m, axis=0)), median, low, high)
