"""KUKA poses (X Y Z in mm, A B C in deg, ``Rz(A) Ry(B) Rx(C)``) to SI and back, compiled."""

from __future__ import annotations

import math

from counterflex.core.arrays import Float, Int
from counterflex.core.jit import kernel
from counterflex.core.units import DEG, MM

_DEG, _MM = DEG, MM


@kernel("void(float64[::1], int64[::1], float64[::1], int64)", entry=True)
def read_pose(values: Float, place: Int, out: Float, at: int) -> None:
    """Pose of six values as rotation by rows and position.

    Args:
        values: Numbers of a telegram.
        place: (6,) where X Y Z A B C stand.
        out: Written from ``at`` on: nine and three numbers, m.
    """
    a, b, c = values[place[3]] * _DEG, values[place[4]] * _DEG, values[place[5]] * _DEG
    ca, sa, cb, sb, cc, sc = math.cos(a), math.sin(a), math.cos(b), math.sin(b), math.cos(c), math.sin(c)
    out[at], out[at + 1], out[at + 2] = ca * cb, ca * sb * sc - sa * cc, ca * sb * cc + sa * sc
    out[at + 3], out[at + 4], out[at + 5] = sa * cb, sa * sb * sc + ca * cc, sa * sb * cc - ca * sc
    out[at + 6], out[at + 7], out[at + 8] = -sb, cb * sc, cb * cc
    for k in range(3):
        out[at + 9 + k] = values[place[k]] * _MM


@kernel("void(float64[::1], float64[::1], int64[::1])")
def write_correction(correction: Float, values: Float, place: Int) -> None:
    """A correction (6,) m and rotation vector as X Y Z A B C in mm and deg.

    ``R = Exp(rotation vector)`` is turned into A B C exactly.
    """
    x, y, z = correction[3], correction[4], correction[5]
    angle = math.sqrt(x * x + y * y + z * z)
    s = math.sin(angle) / angle if angle > 1e-12 else 1.0
    h = (1.0 - math.cos(angle)) / (angle * angle) if angle > 1e-6 else 0.5
    r00, r10, r20 = 1.0 - h * (y * y + z * z), s * z + h * x * y, -s * y + h * x * z
    r21, r22 = s * x + h * y * z, 1.0 - h * (x * x + y * y)
    for k in range(3):
        values[place[k]] = correction[k] / _MM
    values[place[3]] = math.atan2(r10, r00) / _DEG
    values[place[4]] = math.atan2(-r20, math.hypot(r00, r10)) / _DEG
    values[place[5]] = math.atan2(r21, r22) / _DEG


@kernel("void(float64[::1], int64[::1], float64[::1], int64)")
def read_axes(values: Float, place: Int, out: Float, at: int) -> None:
    """Six angles in deg to rad, written from ``at`` on."""
    for k in range(6):
        out[at + k] = values[place[k]] * _DEG


@kernel("void(float64[::1], int64[::1], int64[::1], float64[::1], float64[::1])", entry=True)
def read_stand(values: Float, pose: Int, axes: Int, nominal: Float, q: Float) -> None:
    """:func:`read_pose` and :func:`read_axes` in one call."""
    read_pose(values, pose, nominal, 0)
    read_axes(values, axes, q, 0)


@kernel("void(float64[::1], float64[::1], int64[::1])")
def write_axes(axes: Float, values: Float, place: Int) -> None:
    """Six angles in rad as deg."""
    for k in range(6):
        values[place[k]] = axes[k] / _DEG
