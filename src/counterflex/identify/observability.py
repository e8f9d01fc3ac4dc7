"""What measurements can see: rank, condition, and which parameters hide behind which, in words."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.identify.fit import Seen
from counterflex.identify.parameters import Parameters

DETERMINED = 0.5
"""Posterior by prior sigma below which the data determine a parameter."""
UNSEEN = 0.9
_RANK = 1e-9
_PARTNER = 0.25


@dataclass(frozen=True)
class Observability:
    """What :func:`examine` finds; see :class:`counterflex.identify.fit.Fit`."""

    seen: tuple[Seen, ...]
    rank: int
    condition: float
    hidden: tuple[str, ...]


def examine(parameters: Parameters, free: Int, jacobian: Float, sigma_u: Float, prior: Bool) -> Observability:
    """Judge a weighted Jacobian in fit coordinates.

    Args:
        parameters: All parameters.
        free: (f,) places of the free ones.
        jacobian: (m, f) of the weighted residuals, without priors.
        sigma_u: (f,) posterior standard deviations in fit coordinates.
        prior: (f,) which have a prior.

    Returns:
        The findings. A weak direction is named where the data tell less about it than the priors (singular value
        below 1) or, without priors, nothing at all.
    """
    tall = len(jacobian) > len(free)  # the triangular factor has the same singular values and right vectors
    _, s, vt = np.linalg.svd(np.linalg.qr(jacobian, mode="r") if tall else jacobian, full_matrices=True)
    spectrum = np.zeros(len(free))
    spectrum[: len(s)] = s
    largest = float(spectrum[0]) if len(spectrum) else 0.0
    rank = int(np.sum(spectrum > largest * _RANK))
    condition = largest / float(spectrum[-1]) if spectrum[-1] > 0.0 else float("inf")
    seen: list[Seen] = ["held"] * len(parameters)
    for place, sigma, known in zip(free, sigma_u, prior, strict=True):
        if not known:
            seen[place] = "determined" if sigma < 1e6 else "prior"
        else:
            seen[place] = "determined" if sigma < DETERMINED else ("prior" if sigma > UNSEEN else "partly")
    names = [parameters.items[i].label or parameters.items[i].name for i in free]
    hidden = []
    for value, direction in zip(spectrum[::-1], vt[::-1], strict=True):
        if value >= 1.0 and value > largest * _RANK:
            break
        parts = [int(i) for i in np.argsort(-np.abs(direction)) if abs(direction[i]) > _PARTNER]
        if len(parts) == 1:
            hidden.append(f"{names[parts[0]]} is not seen by these measurements")
        elif parts:
            lead, rest = names[parts[0]], " and ".join(names[i] for i in parts[1:])
            hidden.append(f"{lead} hides behind {rest}: only their combination is seen")
    return Observability(tuple(seen), rank, condition, tuple(hidden))
