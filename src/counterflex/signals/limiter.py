"""Limits on a correction and on its first and second difference, kept together from every state it may be in.

A vector (three numbers) follows a target as fast as its limits allow::

    |y| <= radius,    |v| <= speed,    |v - v_before| <= acceleration T,    y = y_before + T v

What keeps all three at once is the stopping point: where the vector would come to rest if it braked from now on along
its own direction. A velocity is taken only where that point stays inside the radius; braking keeps it where it is, so
there is always one. A state outside the limits (they were narrowed, or the state was set from elsewhere) is never made
worse and is left with the same acceleration.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, as_positive
from counterflex.core.jit import kernel

AT_RADIUS: Final = 1
"""The target lies outside the radius."""
AT_SPEED: Final = 2
"""Held back by speed, acceleration or by the need to stop inside the radius."""
NOT_FINITE: Final = 4
"""The target is not finite: the vector brakes to rest."""
_HALVINGS: Final = 24


@dataclass(frozen=True)
class MotionLimit:
    """Limits of a vector."""

    radius: float  # largest length; m or rad
    speed: float  # largest change per second
    acceleration: float  # largest change of that per second

    def __post_init__(self) -> None:
        """Check that all are above zero: zero never means unlimited."""
        as_positive("limit: radius", self.radius)
        as_positive("limit: speed", self.speed)
        as_positive("limit: acceleration", self.acceleration)

    def packed(self) -> Float:
        """(3,) for the kernel."""
        return np.array([self.radius, self.speed, self.acceleration])


@kernel("float64(float64, float64, float64)")
def stopping_distance(speed: float, acceleration: float, period_s: float) -> float:
    """Way that is still gone after a period with ``speed``, when every later period brakes by ``acceleration T``.

    ``T sum_k max(0, speed - k a T)``, k = 1, 2, ...
    """
    step = acceleration * period_s
    n = math.floor(speed / step)
    return period_s * (n * speed - step * n * (n + 1.0) / 2.0)


@kernel("float64(float64, float64, float64)")
def approach_speed(distance: float, acceleration: float, period_s: float) -> float:
    """Largest speed now that comes to rest within ``distance`` (this period's way included).

    Solves ``T v + stopping_distance(v) = distance`` piece by piece.
    """
    step = acceleration * period_s
    if distance <= 0.0:
        return 0.0
    n = math.floor(0.5 * (math.sqrt(1.0 + 8.0 * distance / (step * period_s)) - 1.0))
    return (distance / period_s + step * n * (n + 1.0) / 2.0) / (n + 1.0)


@kernel("float64(float64[::1], float64, float64, float64, float64, float64)")
def _rest(y: Float, vx: float, vy: float, vz: float, still: float, period_s: float) -> float:
    """Distance from zero of the stopping point after a period with a velocity and a further way ``still``."""
    speed = math.sqrt(vx * vx + vy * vy + vz * vz)
    way = period_s + (still / speed if speed > 0.0 else 0.0)
    x, yy, z = y[0] + way * vx, y[1] + way * vy, y[2] + way * vz
    return math.sqrt(x * x + yy * yy + z * z)


@kernel("boolean(float64[::1], float64, float64, float64, float64, float64, float64, float64)")
def _allowed(
    y: Float, vx: float, vy: float, vz: float, bound: float, top: float, acceleration: float, period_s: float
) -> bool:
    speed = math.sqrt(vx * vx + vy * vy + vz * vz)
    if speed > top * (1.0 + 1e-12):
        return False
    return _rest(y, vx, vy, vz, stopping_distance(speed, acceleration, period_s), period_s) <= bound * (1.0 + 1e-12)


@kernel("int64(float64[::1], float64[::1], float64[::1], float64[::1], float64)")
def limited_step(y: Float, v: Float, target: Float, limit: Float, period_s: float) -> int:
    """Move a vector one period towards its target within its limits.

    Args:
        y: (3,) the vector; changed.
        v: (3,) its change per second over the last period; changed.
        target: (3,) where it should be.
        limit: (3,) of :meth:`MotionLimit.packed`.
        period_s: T.

    Returns:
        0, or bits AT_RADIUS, AT_SPEED, NOT_FINITE. ``y`` and ``v`` must be finite; they stay so.
    """
    radius, fastest, acceleration = limit[0], limit[1], limit[2]
    step = acceleration * period_s
    status = 0
    speed = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    keep = max(0.0, speed - step) / speed if speed > 0.0 else 0.0
    bx, by, bz = keep * v[0], keep * v[1], keep * v[2]
    finite = math.isfinite(target[0]) and math.isfinite(target[1]) and math.isfinite(target[2])
    if not finite:
        v[0], v[1], v[2] = bx, by, bz
        for k in range(3):
            y[k] += period_s * v[k]
        return NOT_FINITE
    size = math.sqrt(target[0] * target[0] + target[1] * target[1] + target[2] * target[2])
    scale = 1.0
    if size > radius:
        scale = radius / size
        status |= AT_RADIUS
    ex, ey, ez = scale * target[0] - y[0], scale * target[1] - y[1], scale * target[2] - y[2]
    distance = math.sqrt(ex * ex + ey * ey + ez * ez)
    requested = min(fastest, approach_speed(distance, acceleration, period_s))
    wx = wy = wz = 0.0
    if distance > 0.0:
        wx, wy, wz = ex / distance * requested, ey / distance * requested, ez / distance * requested
    dx, dy, dz = wx - v[0], wy - v[1], wz - v[2]
    change = math.sqrt(dx * dx + dy * dy + dz * dz)
    if change > step:
        status |= AT_SPEED
        dx, dy, dz = dx * step / change, dy * step / change, dz * step / change
    elif requested * period_s < distance * (1.0 - 1e-9):
        status |= AT_SPEED
    cx, cy, cz = v[0] + dx, v[1] + dy, v[2] + dz
    still = stopping_distance(max(0.0, speed - step), acceleration, period_s)
    rest = _rest(y, bx, by, bz, still, period_s)
    bound = max(radius, rest)
    low, high = 0.0, 1.0
    top = max(fastest, max(0.0, speed - step))
    if not _allowed(y, cx, cy, cz, bound, top, acceleration, period_s):
        status |= AT_SPEED
        for _ in range(_HALVINGS):
            share = 0.5 * (low + high)
            if _allowed(
                y,
                bx + share * (cx - bx),
                by + share * (cy - by),
                bz + share * (cz - bz),
                bound,
                top,
                acceleration,
                period_s,
            ):
                low = share
            else:
                high = share
    else:
        low = 1.0
    v[0], v[1], v[2] = bx + low * (cx - bx), by + low * (cy - by), bz + low * (cz - bz)
    for k in range(3):
        y[k] += period_s * v[k]
    return status
