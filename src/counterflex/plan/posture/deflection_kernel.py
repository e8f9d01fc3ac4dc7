"""Deflection in given directions, many poses at a time: the linear elastic chain without its matrix.

``u = n^T C(q) w`` summed over the elements: with l the lever from an element to the tip, m its moment and a its axes,
``u = sum c_a (m . a) ((l x n) . a)`` for rotations and ``sum c_a (f . a) (n . a)`` for translations. It is the product
of :func:`counterflex.robot.elasticity.compliance.cartesian_compliance` with a wrench, at a third of its cost.
"""

from __future__ import annotations

import math

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.robot.elasticity.kernels.records import CHAIN, Compact
from counterflex.robot.elasticity.kernels.scalar import chain_pass, growth_at, joint_trig


@kernel("float64(Chain, float64[:, ::1], float64[::1], float64[::1], float64[::1])", Chain=CHAIN)
def deflection_along(chain: Compact, frame: Float, q: Float, w: Float, n: Float) -> float:
    """Linear deflection of the tip along one direction.

    Args:
        chain: Compact chain.
        frame: (m + 1, 12) as :func:`counterflex.robot.elasticity.kernels.scalar.chain_pass` leaves it.
        q: (6,) rad, for compliances that differ by region.
        w: (6,) N, N m about the tip, base axes.
        n: (3,) direction, base axes.

    Returns:
        m, positive along n.
    """
    m = len(chain.stations) - 1
    tip = frame[m]
    regions = len(chain.regions) > 0
    total = 0.0
    for i in range(m):
        f, s = frame[i], chain.stations[i]
        if s.rotates != 0:
            x, y, z = tip[9] - f[9], tip[10] - f[10], tip[11] - f[11]
            mx = w[3] + y * w[2] - z * w[1]
            my = w[4] + z * w[0] - x * w[2]
            mz = w[5] + x * w[1] - y * w[0]
            lx, ly, lz = y * n[2] - z * n[1], z * n[0] - x * n[2], x * n[1] - y * n[0]
            for a in range(3):
                c = s.compliance[3 + a]
                if c != 0.0:
                    if regions:
                        c *= growth_at(chain.regions, i, 3 + a, q)
                    moment = mx * f[a] + my * f[3 + a] + mz * f[6 + a]
                    total += c * moment * (lx * f[a] + ly * f[3 + a] + lz * f[6 + a])
        if s.slides != 0:
            for a in range(3):
                c = s.compliance[a]
                if c != 0.0:
                    if regions:
                        c *= growth_at(chain.regions, i, a, q)
                    force = w[0] * f[a] + w[1] * f[3 + a] + w[2] * f[6 + a]
                    total += c * force * (n[0] * f[a] + n[1] * f[3 + a] + n[2] * f[6 + a])
    return total


@kernel(
    "void(Chain, float64[:, ::1], float64[:, ::1], float64[:, :, ::1], float64[::1], int64, int64)",
    waits=True,
    Chain=CHAIN,
    entry=True,
)
def deflection_sizes(chain: Compact, q: Float, w: Float, normals: Float, out: Float, first: int, last: int) -> None:
    """Sizes ``|N d|`` of the deflection in the directions that matter, for the poses first..last-1.

    Args:
        chain: Compact chain.
        q: (n, 6) rad.
        w: (n, 6) N, N m about the tip, base axes.
        normals: (n, k, 3) directions square to each other, base axes; a zero row counts nothing.
        out: (n,) m, written.
        first: First pose.
        last: One behind the last.
    """
    m = len(chain.stations) - 1
    frame, delta, trig = np.empty((m + 1, 12)), np.zeros((m, 6)), np.empty(12)
    for row in range(first, last):
        joint_trig(q[row], trig)
        chain_pass(chain, trig, delta, 0, frame)
        total = 0.0
        for k in range(normals.shape[1]):
            along = deflection_along(chain, frame, q[row], w[row], normals[row, k])
            total += along * along
        out[row] = math.sqrt(total)
