"""Greedy D-optimal choice: the rows that raise the determinant of the information most, one by one."""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.errors import InputError


def greedy(J: Float, count: int, fixed: int = 0) -> tuple[Int, Float]:
    """Rows that raise ``det(1 + sum J^T J)`` most, one by one; each may be taken once.

    ``J``: (n, k, f) weighted derivatives in fit coordinates, where every prior is 1. ``fixed``: So many of the first
    rows are taken whatever they bring, before all others.

    Returns:
        (count,) rows and the (f, f) covariance they give together with the priors.

    Raises:
        InputError: More than there are.
    """
    n, k, f = J.shape
    if count > n:
        raise InputError("measurements to choose", value=count, limit=f"at most the {n} candidates")
    C = np.eye(f)
    remaining = np.ones(n, dtype=np.bool_)
    chosen = []
    for place in range(count):
        S = np.eye(k) + J @ C @ np.swapaxes(J, 1, 2)
        gain = np.where(remaining, np.linalg.slogdet(S)[1], -np.inf)
        best = place if place < fixed else int(np.argmax(gain))
        CJ = C @ J[best].T
        C = C - CJ @ np.linalg.solve(S[best], CJ.T)
        C = 0.5 * (C + C.T)
        remaining[best] = False
        chosen.append(best)
    return np.array(chosen, dtype=np.int64), C
