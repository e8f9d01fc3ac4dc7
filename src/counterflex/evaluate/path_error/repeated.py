"""Error of the path that a measured part shows, and the surface that the next part is expected to have."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float
from counterflex.evaluate.path_error.contacts import Contacts, left_on
from counterflex.evaluate.path_error.estimate import PathError

SPREAD: Final = 1.5
"""Factor within which the size of what the tool may do besides is known (log-normal): friction differs among robots."""
_SHARE: Final = 0.997
_SEED: Final = 21


@dataclass(frozen=True, eq=False)
class MeasuredError:
    """Error of the path of one part, at the n rows of the path."""

    taken_m: Float  # (n, 3) m, displacement of the tool that its program took back because of earlier parts
    error_m: Float  # (n, 3) m, error that it left; zero where none is believed
    sigma_m: Float  # (n, 3) m, standard deviations of the error
    seen: Bool  # (n, 3) True where the part shows the component


@dataclass(frozen=True)
class ExpectedSurface:
    """Deviation of the surface that 99.7 % of the places stay below, m, without the noise of the scan."""

    now_m: float  # of the measured part
    median_m: float  # of the next one
    low_m: float  # 5 % of what may be are below
    high_m: float  # 5 % are above


def surface_now(estimate: PathError, contacts: Contacts) -> float:
    """Deviation of the measured part's surface that 99.7 % of the places stay below, m, without noise of the scan."""
    return _figure(contacts, np.mean(estimate.draws_m, axis=0))


def expected(
    estimate: PathError, contacts: Contacts, change_m: Float, unsure_m: Float, scatter_m: float
) -> ExpectedSurface:
    """Predict the surface of the next part.

    A part differs from the one before even if its program does not: by an offset of the whole part and one of each run
    of feed, which share the variance ``scatter_m^2`` of each axis.

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
    chain = estimate.nodes.chain
    offset = rng.standard_normal((count, int(chain.max(initial=0)) + 1, 3))[:, chain]
    offset = np.sqrt(0.5) * scatter_m * (offset + rng.standard_normal((count, 1, 3)))
    after = [_figure(contacts, error) for error in estimate.draws_m + change_m + besides + offset]
    low, median, high = np.quantile(after, (0.05, 0.5, 0.95)).tolist()
    return ExpectedSurface(surface_now(estimate, contacts), median, low, high)


def _figure(contacts: Contacts, error_m: Float) -> float:
    return float(np.quantile(np.abs(left_on(contacts, error_m)), _SHARE))
