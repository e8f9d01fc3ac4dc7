"""Load of an axis at a station, and how far the tool goes when that axis loses motion."""

from __future__ import annotations

import math

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.robot.elasticity.kernels.records import CHAIN, Compact
from counterflex.robot.elasticity.kernels.scalar import balance_torque, chain_pass, joint_trig


@kernel(
    "void(Chain, float64[:, :, ::1], float64[:, :, ::1], float64[:, :, :, ::1], float64[:, ::1], float64[:, :, ::1],"
    " float64[:, :, ::1])",
    waits=True,
    Chain=CHAIN,
    entry=True,
)
def burdens(chain: Compact, q: Float, w: Float, normals: Float, tips: Float, torque: Float, gain: Float) -> None:
    """Torque on every axis by process, own weight and counterbalance, and motion of the tip by a turn of the axis.

    Args:
        chain: Compact chain.
        q: (m, r, 6) rad; NaN where a posture is not possible.
        w: (m, r, 6) N, N m about the tip, base axes; (m, 1, 6) where it is the same at all rotations.
        normals: (m, r, k, 3) or (m, 1, k, 3) directions that matter, base axes.
        tips: (m, 3) m, tips where the robot carries the part; (0, 3): the tip is the last frame of the chain.
        torque: (m, r, 6) N m, written: positive in the positive direction of the angle.
        gain: (m, r, 6) m/rad, written: ``|N J_i|``.
    """
    last = len(chain.stations) - 1
    frame, delta, trig = np.empty((last + 1, 12)), np.zeros((last, 6)), np.empty(12)
    around = chain.surroundings[0]
    g = around.gravity[:]
    for n in range(q.shape[0]):
        for r in range(q.shape[1]):
            if math.isnan(q[n, r, 0]):
                continue
            joint_trig(q[n, r], trig)
            chain_pass(chain, trig, delta, 0, frame)
            tip = frame[last]
            if tips.shape[0] > 0:
                tip[9:12] = tips[n]
            t = r if w.shape[1] > 1 else 0
            sx, sy, sz = 0.0, 0.0, 0.0
            for k in range(last):
                i = last - 1 - k
                f, s = frame[i], chain.stations[i]
                a, b, c = s.com[0], s.com[1], s.com[2]
                sx += s.mass * (f[9] + f[0] * a + f[1] * b + f[2] * c)
                sy += s.mass * (f[10] + f[3] * a + f[4] * b + f[5] * c)
                sz += s.mass * (f[11] + f[6] * a + f[7] * b + f[8] * c)
                if s.drive < 0:
                    continue
                zx, zy, zz = s.sign * f[2], s.sign * f[5], s.sign * f[8]
                x, y, z = tip[9] - f[9], tip[10] - f[10], tip[11] - f[11]
                hx, hy, hz = sx - s.carried * f[9], sy - s.carried * f[10], sz - s.carried * f[11]
                mx = w[n, t, 3] + y * w[n, t, 2] - z * w[n, t, 1] + hy * g[2] - hz * g[1]
                my = w[n, t, 4] + z * w[n, t, 0] - x * w[n, t, 2] + hz * g[0] - hx * g[2]
                mz = w[n, t, 5] + x * w[n, t, 1] - y * w[n, t, 0] + hx * g[1] - hy * g[0]
                load = zx * mx + zy * my + zz * mz
                for other in range(last):
                    if abs(chain.stations[other].balanced) == s.drive + 1:
                        load += balance_torque(around, q[n, r, s.drive])
                torque[n, r, s.drive] = load
                vx, vy, vz = zy * z - zz * y, zz * x - zx * z, zx * y - zy * x
                square = 0.0
                for d in range(normals.shape[2]):
                    along = vx * normals[n, t, d, 0] + vy * normals[n, t, d, 1] + vz * normals[n, t, d, 2]
                    square += along * along
                gain[n, r, s.drive] = math.sqrt(square)
