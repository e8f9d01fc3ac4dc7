"""Largest, 99.7 % and root-mean-square value of a deviation, weighted by the length or area it stands for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Float, as_float
from counterflex.core.errors import InputError


@dataclass(frozen=True)
class Figures:
    """What a set of deviations comes down to.

    Attributes:
        max_m: Largest magnitude, m.
        p997_m: Magnitude that 99.7 % of the length (or area) stays below, m.
        rms_m: Root of the weighted mean square, m.
        extent: Length in m, or area in m2, that the figures stand for; 0 where there was nothing to evaluate.
    """

    max_m: float
    p997_m: float
    rms_m: float
    extent: float


NONE = Figures(0.0, 0.0, 0.0, 0.0)


def weighted_quantile(value: Float, weight: Float, fraction: float) -> float:
    """Smallest value below which (or at which) the given fraction of the total weight lies.

    ``min { v : sum_{value <= v} weight >= fraction sum weight }``: a value that was met, never an interpolated one.

    Args:
        value: (n,) n > 0.
        weight: (n,) >= 0, with a positive sum.
        fraction: In 0..1.

    Raises:
        InputError: Fraction, lengths or weights are out of range.
    """
    value, weight = as_float("value", value, (None,)), as_float("weight", weight, (len(value),))
    total = float(weight.sum())
    if not 0.0 <= fraction <= 1.0:
        raise InputError("quantile fraction is out of range", value=fraction, limit="0..1")
    if np.any(weight < 0.0) or total <= 0.0:
        raise InputError("weights of a quantile are negative or all zero")
    order = np.argsort(value, kind="stable")
    cumulated = np.cumsum(weight[order])
    index = int(np.searchsorted(cumulated, fraction * total * (1.0 - 1e-12)))
    return float(value[order][min(index, len(value) - 1)])


def weighted_figures(deviation: Float, weight: Float | float = 1.0) -> Figures:
    """Largest, 99.7 % and rms magnitude of deviations.

    Args:
        deviation: (n,) signed values or (n, 3) vectors, m.
        weight: Length (m) or area (m2) that each entry stands for; scalar or (n,).

    Returns:
        The figures; all zero with ``extent == 0`` where ``n == 0`` or all weights are zero.
    """
    values = as_float("deviation", deviation)
    magnitude: Float = np.linalg.norm(values, axis=-1) if values.ndim == 2 else np.abs(values)
    weights: Float = np.broadcast_to(np.asarray(weight, dtype=np.float64), magnitude.shape)
    extent = float(weights.sum())
    if extent <= 0.0:
        return NONE
    return Figures(
        max_m=float(magnitude[weights > 0.0].max()),
        p997_m=weighted_quantile(magnitude, weights, 0.997),
        rms_m=float(np.sqrt(np.sum(weights * magnitude**2) / extent)),
        extent=extent,
    )


def reduction(compensated: float, uncompensated: float) -> float | None:
    """``1 - compensated / uncompensated`` of one and the same figure; None where there was nothing to reduce."""
    return None if uncompensated <= 0.0 else 1.0 - compensated / uncompensated
