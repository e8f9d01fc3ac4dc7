"""Least squares within bounds, when bounds are in the way: Gauss-Newton steps by exact bounded linear least squares.

A method that keeps away from bounds creeps along them; this one rests on them and leaves them again. Each step solves
``min |R d + z|^2`` within the bounds and a trust box by SciPy's active-set method (BVLS).

Source: Stark and Parker 1995 (bounded-variable least squares); Nocedal and Wright, Numerical Optimization, chapter 4.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Float

_WIDEST: Final = 10.0
_POOR: Final = 0.25
_GOOD: Final = 0.75


@dataclass(frozen=True, eq=False)
class Rest:
    """Where an inner fit came to rest.

    Attributes:
        x: (f,) values.
        status: As SciPy has them: 0 too many evaluations, 1 gradient, 2 misfit, 3 values.
        jac: (k, f) derivative there.
    """

    x: Float
    status: int
    jac: Float


def within_bounds(
    reduced: Callable[[Float], Float | None], u: Float, lower: Float, upper: Float, tolerance: float, most: int
) -> Rest:
    """Minimise half the square of a residual within bounds.

    Args:
        reduced: Triangle (k, f + 1) of derivative and residual (last column), or None where it cannot be computed.
        u: (f,) start, within the bounds; ``reduced`` is known there.
        lower: (f,).
        upper: (f,).
        tolerance: Relative change of misfit and values, and size of the projected gradient, at which it rests.
        most: Most evaluations.
    """
    here = reduced(u)
    if here is None:
        return Rest(u, 0, np.zeros((0, len(u))))
    box = _WIDEST
    status = 0
    for _ in range(most - 1):
        R, z = here[:, :-1], here[:, -1]
        gradient = R.T @ z
        if np.max(np.abs(u - np.clip(u - gradient, lower, upper))) < tolerance:
            status = 1
            break
        low, high = np.maximum(lower - u, -box), np.minimum(upper - u, box)
        d = np.clip(
            scipy.optimize.lsq_linear(R, -z, bounds=(low, np.maximum(high, low + 1e-300)), method="bvls").x, low, high
        )
        step = float(np.max(np.abs(d)))
        if step < tolerance * (tolerance + float(np.max(np.abs(u)))):
            status = 3
            break
        size = float(z @ z)
        hoped = size - float(np.sum((R @ d + z) ** 2))
        there = reduced(np.clip(u + d, lower, upper))
        gained = -np.inf if there is None else size - float(there[:, -1] @ there[:, -1])
        ratio = gained / max(hoped, 1e-300)
        if ratio < _POOR:
            box = 0.25 * step
        elif ratio > _GOOD:
            box = max(box, 2.0 * step)
        if gained > 0.0 and there is not None:
            u, here = np.clip(u + d, lower, upper), there
        if abs(gained) < tolerance * size and ratio > _POOR:
            status = 2
            break
    return Rest(u, status, here[:, :-1])
