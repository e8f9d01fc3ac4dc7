"""Scalar kernels of compliances that differ by region of the joint space.

Regions are records, :data:`counterflex.robot.elasticity.kernels.records.REGION`. What they mean says
:mod:`counterflex.robot.model.elastic_region`.
"""

from __future__ import annotations

import math
from typing import Final

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.core.records import Record, Records
from counterflex.robot.elasticity.kernels.records import REGION

FADE: Final = math.radians(10.0)
"""Equals :data:`counterflex.robot.model.elastic_region.FADE_RAD`."""


@kernel("float64(Region, float64)", Region=REGION)
def factor_at(region: Record, angle: float) -> float:
    """Factor of one region at the angle of its axis: linear between its angles, fading to 1 beyond them."""
    angles, factors = region.angles[:], region.factors[:]
    last = region.angles_given - 1
    low: float = angles[0]
    high: float = angles[last]
    if angle <= low:
        first: float = factors[0]
        return 1.0 + (first - 1.0) * max(0.0, 1.0 - (low - angle) / FADE)
    if angle >= high:
        end: float = factors[last]
        return 1.0 + (end - 1.0) * max(0.0, 1.0 - (angle - high) / FADE)
    k = 0
    while angle > angles[k + 1]:
        k += 1
    a: float = angles[k]
    share = (angle - a) / (angles[k + 1] - a)
    out: float = factors[k] + share * (factors[k + 1] - factors[k])
    return out


@kernel("float64(Region[::1], int64, int64, float64[::1])", Region=REGION)
def growth_at(regions: Records, station: int, direction: int, q: Float) -> float:
    """Factor of all regions together on one spring."""
    out = 1.0
    for r in range(len(regions)):
        region = regions[r]
        if region.station == station and region.direction == direction:
            out *= factor_at(region, q[region.axis])
    return out


@kernel("void(Region[::1], float64[::1], float64[:, ::1])", Region=REGION)
def grow(regions: Records, q: Float, delta: Float) -> None:
    """Multiply elastic displacements (m, 6) by the factors of the regions at the angles q (6,) rad."""
    for r in range(len(regions)):
        region = regions[r]
        delta[region.station, region.direction] *= factor_at(region, q[region.axis])
