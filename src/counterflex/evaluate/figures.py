"""Largest, 99.7 % and root-mean-square value of a deviation, weighted by the length or area it stands for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Float, as_float
from counterflex.core.errors import InputError


@dataclass(frozen=True)
class DeviationFigures:
    """Figures of a set of deviations."""

    max_m: float  # largest magnitude, m
    p997_m: float  # magnitude that 99.7 % of the length (or area) stays below, m
    rms_m: float  # root of the weighted mean square, m
    extent: float  # length in m, or area in m2, that the figures stand for; 0 where there was nothing to evaluate

    @classmethod
    def weighted(cls, deviation: Float, weight: Float | float = 1.0) -> DeviationFigures:
        """Largest, 99.7 % and rms magnitude of deviations.

        Args:
            deviation: (n,) signed values or (n, 3) vectors, m.
            weight: Length (m) or area (m2) that each entry stands for; scalar or (n,).

        Returns:
            The figures; all zero with ``extent == 0`` where ``n == 0`` or all weights are zero.

        Raises:
            InputError: A weight is negative.
        """
        values = as_float("deviation", deviation)
        magnitude: Float = np.linalg.norm(values, axis=-1) if values.ndim == 2 else np.abs(values)
        weights: Float = np.broadcast_to(np.asarray(weight, dtype=np.float64), magnitude.shape)
        extent = float(weights.sum())
        if np.any(weights < 0.0):
            raise InputError("a weight of a deviation is negative", value=float(weights.min()), limit=">= 0")
        if extent <= 0.0:
            return NONE
        return cls(
            max_m=float(magnitude[weights > 0.0].max()),
            p997_m=float(np.quantile(magnitude, 0.997, weights=weights, method="inverted_cdf")),  # a value that was met
            rms_m=float(np.sqrt(np.sum(weights * magnitude**2) / extent)),
            extent=extent,
        )


NONE = DeviationFigures(0.0, 0.0, 0.0, 0.0)


def reduction(compensated: float, uncompensated: float) -> float | None:
    """``1 - compensated / uncompensated`` of one and the same figure; None where there was nothing to reduce."""
    return None if uncompensated <= 0.0 else 1.0 - compensated / uncompensated
