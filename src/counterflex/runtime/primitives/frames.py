"""Small vectors and poses of the online step, in place and without allocation."""

from __future__ import annotations

import math

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.core.records import Records
from counterflex.runtime.primitives.loop_types import LOOP_TYPES

MEMORY = 24
"""Numbers of memory: for each signal the last two inputs, then the last two outputs."""


@kernel("void(float64[::1], float64[::1], float64[::1], float64[::1])")
def lag(x: Float, c: Float, memory: Float, out: Float) -> None:
    """One sample: ``y = b0 x + b1 x' + b2 x'' - a1 y' - a2 y''``.

    Args:
        x: (6,) samples.
        c: (5,) ``b0 b1 b2 a1 a2``.
        memory: (24,); changed.
        out: (6,) written; may be ``x``.
    """
    for k in range(6):
        m, u = 4 * k, x[k]
        y = c[0] * u + c[1] * memory[m] + c[2] * memory[m + 1]
        y -= c[3] * memory[m + 2] + c[4] * memory[m + 3]
        memory[m + 1], memory[m] = memory[m], u
        memory[m + 3], memory[m + 2] = memory[m + 2], y
        out[k] = y


@kernel("void(float64[::1], int64, float64[::1], int64)")
def turn_back(R: Float, at: int, x: Float, begin: int) -> None:
    """``x[begin:begin+3] = R^T x`` with R (9,) from ``at`` on, in place."""
    a, b, c = x[begin], x[begin + 1], x[begin + 2]
    for k in range(3):
        x[begin + k] = R[at + k] * a + R[at + 3 + k] * b + R[at + 6 + k] * c


@kernel("void(float64[::1], int64, float64[::1], int64)")
def turn(R: Float, at: int, x: Float, begin: int) -> None:
    """``x[begin:begin+3] = R x``, in place."""
    a, b, c = x[begin], x[begin + 1], x[begin + 2]
    for k in range(3):
        x[begin + k] = R[at + 3 * k] * a + R[at + 3 * k + 1] * b + R[at + 3 * k + 2] * c


@kernel("void(float64[::1], int64, float64[::1], float64[::1], float64[::1])")
def pose_deviation(actual: Float, at: int, nominal: Float, contained: Float, out: Float) -> None:
    """Deviation of a pose from a commanded one whose program contains a correction already.

    Translation difference, and the logarithm of the relative rotation (small: ``(R - R^T) / 2`` with its scale).

    Args:
        actual: Array that holds the pose (12) from ``at`` on.
        nominal: (12,) commanded pose.
        contained: (6,) correction it contains.
        out: (6,) written, m and rad, part axes.
    """
    for k in range(3):
        out[k] = actual[at + 9 + k] - (nominal[9 + k] - contained[k])
    m01 = m02 = m12 = m10 = m20 = m21 = trace = 0.0
    for j in range(3):
        a0, a1, a2 = actual[at + j], actual[at + 3 + j], actual[at + 6 + j]
        n0, n1, n2 = nominal[j], nominal[3 + j], nominal[6 + j]
        m01 += a0 * n1
        m02 += a0 * n2
        m12 += a1 * n2
        m10 += a1 * n0
        m20 += a2 * n0
        m21 += a2 * n1
        trace += a0 * n0 + a1 * n1 + a2 * n2
    x, y, z = 0.5 * (m21 - m12), 0.5 * (m02 - m20), 0.5 * (m10 - m01)
    s = math.sqrt(x * x + y * y + z * z)
    scale = math.atan2(s, 0.5 * (trace - 1.0)) / s if s > 1e-12 else 1.0
    out[3], out[4], out[5] = scale * x + contained[3], scale * y + contained[4], scale * z + contained[5]


@kernel("void(float64[::1], int64, Plan[::1], int64)", **LOOP_TYPES)
def across(x: Float, begin: int, plan: Records, row: int) -> None:
    """Take the component along the feed out of ``x[begin:begin+3]`` (Haehn2020 eq. 10-11)."""
    feed = plan[row].direction[:]
    a, b, c = feed[0], feed[1], feed[2]
    along = x[begin] * a + x[begin + 1] * b + x[begin + 2] * c
    x[begin] -= along * a
    x[begin + 1] -= along * b
    x[begin + 2] -= along * c


@kernel("void(Plan[::1], int64, float64[::1], float64[::1])", **LOOP_TYPES)
def directions(plan: Records, row: int, nominal: Float, frame: Float) -> None:
    """Unit vectors (9,): feed, tool axis cross feed, tool axis; part axes themselves where nothing moves."""
    feed = plan[row].direction[:]
    vx, vy, vz = feed[0], feed[1], feed[2]
    ax, ay, az = nominal[2], nominal[5], nominal[8]
    nx, ny, nz = ay * vz - az * vy, az * vx - ax * vz, ax * vy - ay * vx
    size = math.sqrt(nx * nx + ny * ny + nz * nz)
    for k in range(9):
        frame[k] = 1.0 if k % 4 == 0 else 0.0
    if size < 1e-3:
        return
    nx, ny, nz = nx / size, ny / size, nz / size
    frame[0], frame[1], frame[2] = ny * az - nz * ay, nz * ax - nx * az, nx * ay - ny * ax
    frame[3], frame[4], frame[5] = nx, ny, nz
    frame[6], frame[7], frame[8] = ax, ay, az


@kernel("float64(float64[::1], int64)")
def size_of(x: Float, at: int) -> float:
    """Length of the vector ``x[at:at+3]``."""
    return math.sqrt(x[at] * x[at] + x[at + 1] * x[at + 1] + x[at + 2] * x[at + 2])


@kernel("boolean(float64[::1])")
def all_finite(x: Float) -> bool:
    """Return whether every number is finite."""
    finite = True
    for k in range(x.shape[0]):
        finite = finite and math.isfinite(x[k])
    return finite


@kernel("void(float64[::1], int64, float64)")
def shorten(x: Float, begin: int, by: float) -> None:
    """Make the vector ``x[begin:begin+3]`` shorter by a length, at most to nothing."""
    size = size_of(x, begin)
    scale = (size - by) / size if size > by else 0.0
    for k in range(begin, begin + 3):
        x[k] *= scale
