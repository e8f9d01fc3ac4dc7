"""What repeats from part to part, and what a program has to take back in all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float
from counterflex.core.errors import InputError
from counterflex.evaluate.path_error.expected import RESPONSE

_FEW: Final = 30
"""Rows below which the scatter of parts is not estimated."""


@dataclass(frozen=True, eq=False)
class MeasuredError:
    """Error of the path of one part, at the n rows of the path.

    Attributes:
        taken_m: (n, 3) m, displacement of the tool that its program took back because of earlier parts.
        error_m: (n, 3) m, error that it left; zero where none is believed.
        sigma_m: (n, 3) m, standard deviations of the error.
        seen: (n, 3) True where the part shows the component.
    """

    taken_m: Float
    error_m: Float
    sigma_m: Float
    seen: Bool


@dataclass(frozen=True, eq=False)
class Repeated:
    """What all parts together say.

    Attributes:
        total_m: (n, 3) m, displacement that the next program has to take back.
        sigma_m: (n, 3) m, its standard deviation.
        between_m: Standard deviation of a part about what repeats, m; nan with one part of a program.
    """

    total_m: Float
    sigma_m: Float
    between_m: float


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
