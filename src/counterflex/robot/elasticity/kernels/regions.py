"""Scalar kernels of compliances that differ by region of the joint space.

Regions stand in ``real`` behind the stations, the TCP and the surroundings, one row each: station, direction 0..5,
axis 0..5, number k of angles, up to :data:`MOST_ANGLES` angles (rad), as many factors. See
:mod:`counterflex.robot.model.elastic_region`.
"""

from __future__ import annotations

import math
from typing import Final

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel

STATION: Final = 0
DIRECTION: Final = 1
AXIS: Final = 2
COUNT: Final = 3
ANGLE: Final = 4
MOST_ANGLES: Final = 8
FACTOR: Final = ANGLE + MOST_ANGLES
FADE: Final = math.radians(10.0)
"""Equals :data:`counterflex.robot.model.elastic_region.FADE_RAD`."""


@kernel("float64(float64[::1], float64)")
def factor_at(row: Float, angle: float) -> float:
    """Factor of one region at the angle of its axis: linear between its angles, fading to 1 beyond them."""
    last = int(row[COUNT]) - 1
    low: float = row[ANGLE]
    high: float = row[ANGLE + last]
    if angle <= low:
        first: float = row[FACTOR]
        return 1.0 + (first - 1.0) * max(0.0, 1.0 - (low - angle) / FADE)
    if angle >= high:
        end: float = row[FACTOR + last]
        return 1.0 + (end - 1.0) * max(0.0, 1.0 - (angle - high) / FADE)
    k = 0
    while angle > row[ANGLE + k + 1]:
        k += 1
    a: float = row[ANGLE + k]
    share = (angle - a) / (row[ANGLE + k + 1] - a)
    out: float = row[FACTOR + k] + share * (row[FACTOR + k + 1] - row[FACTOR + k])
    return out


@kernel("float64(float64[:, ::1], int64, int64, int64, float64[::1])")
def growth_at(real: Float, m: int, station: int, direction: int, q: Float) -> float:
    """Factor of all regions together on one spring."""
    out = 1.0
    for r in range(m + 2, real.shape[0]):
        if int(real[r, STATION]) == station and int(real[r, DIRECTION]) == direction:
            out *= factor_at(real[r], q[int(real[r, AXIS])])
    return out


@kernel("void(float64[:, ::1], int64, float64[::1], float64[:, ::1])")
def grow(real: Float, m: int, q: Float, delta: Float) -> None:
    """Multiply elastic displacements (m, 6) by the factors of the regions at the angles q (6,) rad."""
    for r in range(m + 2, real.shape[0]):
        delta[int(real[r, STATION]), int(real[r, DIRECTION])] *= factor_at(real[r], q[int(real[r, AXIS])])
