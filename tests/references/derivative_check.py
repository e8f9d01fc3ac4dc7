"""Whether a Jacobian is the derivative of its residuals: central differences approach it with the step squared."""

from __future__ import annotations

import itertools
import math
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, as_float
from counterflex.core.errors import InputError
from counterflex.identify.solver.residuals import Residuals

HALVINGS: Final = 5
_EPS: Final = float(np.finfo(np.float64).eps)
_CLEAR: Final = 8.0


def convergence_order(block: Residuals, x: Float, steps: Float | float) -> Float:
    """Order with which central differences approach the Jacobian, parameter by parameter.

    ``e(h) = max |(r(x + h e_i) - r(x - h e_i)) / 2h - J e_i|`` over a row of halved steps; the order is
    ``log2(e(h) / e(h / 2))`` of the smallest two steps whose error stands clear of rounding. An exact Jacobian gives
    2 (or more where the third derivative vanishes); a wrong one gives 0, since the error stops falling.

    Args:
        block: Residuals and Jacobian to compare.
        x: (p,) SI, where.
        steps: (p,) or one number, SI: the largest step of each parameter; about what it may be off.

    Returns:
        (p,) orders; infinity where the differences agree within rounding already at the largest step (the residual is
        linear or quadratic in that parameter, or does not depend on it).

    Raises:
        InputError: A step is not above zero, or the Jacobian is not (rows, components, p).
    """
    x = as_float("x", x, (None,))
    reach = np.broadcast_to(as_float("steps", steps), x.shape)
    if not np.all(reach > 0.0):
        raise InputError("a step must be above zero", value=float(np.min(reach)))
    exact = as_float("Jacobian", block.jacobian(x))
    here = as_float("residuals", block.evaluate(x))
    if exact.shape != (*here.shape, len(x)):
        raise InputError("the Jacobian has the wrong shape", value=exact.shape, limit=(*here.shape, len(x)))
    out = np.empty(len(x))
    for i in range(len(x)):
        rounding = _rounding(block, x, i, float(reach[i]), here, exact[..., i])
        errors = [_error(block, x, i, float(reach[i]) / 2.0**k, exact[..., i], rounding) for k in range(HALVINGS)]
        out[i] = _order(errors)
    return out


def _rounding(block: Residuals, x: Float, i: int, step: float, here: Float, exact: Float) -> float:
    """What rounding does to a residual: its change over next to no step, less what the Jacobian says."""
    worst = _EPS * float(np.max(np.abs(here), initial=1.0))
    for share in (1e-12, -1.7e-12, 2.9e-12):
        near = x.copy()
        near[i] += share * step
        change = block.evaluate(near) - here - exact * (near[i] - x[i])
        worst = max(worst, float(np.max(np.abs(change), initial=0.0)))
    return worst


def _error(block: Residuals, x: Float, i: int, step: float, exact: Float, rounding: float) -> tuple[float, float]:
    """Largest difference of one column, and how much of it rounding can explain."""
    up, down = x.copy(), x.copy()
    up[i] += step
    down[i] -= step
    width = up[i] - down[i]
    change = (block.evaluate(up) - block.evaluate(down)) / width
    return float(np.max(np.abs(change - exact), initial=0.0)), 2.0 * rounding / width


def _order(errors: list[tuple[float, float]]) -> float:
    order = math.inf
    for (wide, _), (narrow, noise) in itertools.pairwise(errors):
        if narrow <= _CLEAR * noise:
            break
        order = math.log2(wide / narrow) if wide > 0.0 else 0.0
    return order
