"""Torsion of one axis along a path with play and dry friction, and its derivatives by all constants.

The model is that of :mod:`counterflex.robot.elasticity.play`. Where the torsion s balances the axis,
``T + sum clip(f_e - F_e/d_e (moved + s)) - spring(s) = 0``, the derivative follows from the same equation: springs and
sticking elements yield, slipping ones hold their limit; so it is carried from point to point with the state.
"""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.robot.elasticity.play import FLOATING_NM, settle_axis


@kernel()
def follow_with_slopes(
    q: Float,
    torque: Float,
    compliance: float,
    half_band: float,
    limit: Float,
    slip: Float,
    torsion: Float,
    slope: Float,
) -> None:
    """Torsion and its derivatives by ``c, b, F_1 ... F_m, d_1 ... d_m``, from relaxed elements at the first point.

    Args:
        q: (n,) rad, motor angles in order.
        torque: (n,) N m.
        compliance: c > 0, rad/(N m).
        half_band: b, rad.
        limit: (m,) F > 0, N m.
        slip: (m,) d > 0, rad.
        torsion: (n,) rad, written.
        slope: (n, 2 + 2 m), written.
    """
    m = limit.shape[0]
    p = 2 + 2 * m
    force = np.zeros(m)
    d_force = np.zeros((m, p))
    ds = np.zeros(p)
    d_link = np.zeros(p)
    num = np.zeros(p)
    lean = min(max(torque[0] / FLOATING_NM, -1.0), 1.0)
    s = compliance * torque[0] + lean * half_band
    ds[0], ds[1] = torque[0], lean
    link = q[0] + s
    d_link[:] = ds
    torsion[0] = s
    slope[0, :] = ds
    for n in range(1, q.shape[0]):
        moved = q[n] - link
        s = settle_axis(moved, torque[n], s, compliance, half_band, limit, slip, force)
        den = 0.0
        num[:] = 0.0
        if s > half_band:
            den += 1.0 / compliance
            num[0] += (s - half_band) / compliance**2
            num[1] += 1.0 / compliance
        elif s < -half_band:
            den += 1.0 / compliance
            num[0] += (s + half_band) / compliance**2
            num[1] -= 1.0 / compliance
        for e in range(m):
            k = limit[e] / slip[e]
            u = force[e] - k * (moved + s)
            if u > limit[e]:
                num[2 + e] += 1.0
            elif u < -limit[e]:
                num[2 + e] -= 1.0
            else:
                den += k
                for i in range(p):
                    num[i] += d_force[e, i] + k * d_link[i]
                num[2 + e] -= (moved + s) / slip[e]
                num[2 + m + e] += limit[e] / slip[e] ** 2 * (moved + s)
        if den > 0.0:
            for i in range(p):
                ds[i] = num[i] / den
        step = moved + s
        for e in range(m):
            k = limit[e] / slip[e]
            u = force[e] - k * step
            if u > limit[e] or u < -limit[e]:
                side = 1.0 if u > 0.0 else -1.0
                force[e] = side * limit[e]
                d_force[e, :] = 0.0
                d_force[e, 2 + e] = side
            else:
                force[e] = u
                for i in range(p):
                    d_force[e, i] -= k * (ds[i] - d_link[i])
                d_force[e, 2 + e] -= step / slip[e]
                d_force[e, 2 + m + e] += limit[e] / slip[e] ** 2 * step
        link = q[n] + s
        d_link[:] = ds
        torsion[n] = s
        slope[n, :] = ds
