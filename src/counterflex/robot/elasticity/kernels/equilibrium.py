"""Scalar kernel of the elastic equilibrium: loads where the bodies are after deflection."""

from __future__ import annotations

import math

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.robot.elasticity.kernels.records import CHAIN, Compact
from counterflex.robot.elasticity.kernels.regions import growth_at
from counterflex.robot.elasticity.kernels.scalar import balance_torque, chain_pass, loads


@kernel(
    "int64(Chain, float64[::1], float64[::1], float64[::1], int64, float64[:, ::1], float64[:, ::1])",
    Chain=CHAIN,
)
def settle(chain: Compact, trig: Float, q: Float, w: Float, gravity: int, delta: Float, frame: Float) -> int:
    """Equilibrium with the loads on the deflected geometry, by fixed-point iteration from the rigid one.

    Each virtual joint (three slides, then hinges z, y', x'') carries the generalised force of everything beyond it
    where that is after deflection; the wrench keeps its base axes and follows the TCP. ``frame`` ends deflected.

    Returns:
        Iterations used, or -1 where they did not converge.
    """
    m = len(chain.stations) - 1
    chain_pass(chain, trig, delta, 0, frame)
    loads(chain, frame, q, w, gravity, delta)
    surroundings = chain.surroundings[0]
    gx, gy, gz = surroundings.gravity[0], surroundings.gravity[1], surroundings.gravity[2]
    last = 1e300
    for count in range(1, 60):
        chain_pass(chain, trig, delta, 1, frame)
        tip = frame[m]
        sx, sy, sz = 0.0, 0.0, 0.0
        change = 0.0
        for k in range(m):
            i = m - 1 - k
            f, s = frame[i], chain.stations[i]
            a, b, c = delta[i, 0], delta[i, 1], delta[i, 2]
            px = f[9] + f[0] * a + f[1] * b + f[2] * c
            py = f[10] + f[3] * a + f[4] * b + f[5] * c
            pz = f[11] + f[6] * a + f[7] * b + f[8] * c
            ca, sa, cb, sb = math.cos(delta[i, 3]), math.sin(delta[i, 3]), math.cos(delta[i, 4]), math.sin(delta[i, 4])
            cc, sc = math.cos(delta[i, 5]), math.sin(delta[i, 5])
            # axes after the hinge about z (h: x', y'), after the one about y' (x''), and of the body (y3, z3)
            hx, hy, hz = cc * f[0] + sc * f[1], cc * f[3] + sc * f[4], cc * f[6] + sc * f[7]
            yx, yy, yz = cc * f[1] - sc * f[0], cc * f[4] - sc * f[3], cc * f[7] - sc * f[6]
            xx, xy, xz = cb * hx - sb * f[2], cb * hy - sb * f[5], cb * hz - sb * f[8]
            vx, vy, vz = cb * f[2] + sb * hx, cb * f[5] + sb * hy, cb * f[8] + sb * hz
            lx, ly, lz = tip[9] - px, tip[10] - py, tip[11] - pz
            fx, fy, fz = w[0], w[1], w[2]
            mx = w[3] + ly * fz - lz * fy
            my = w[4] + lz * fx - lx * fz
            mz = w[5] + lx * fy - ly * fx
            twist = 0.0
            if gravity != 0:
                mass = s.mass
                a, b, c = s.com[0], s.com[1], s.com[2]
                b, c = ca * b - sa * c, sa * b + ca * c
                sx += mass * (px + a * xx + b * yx + c * vx)
                sy += mass * (py + a * xy + b * yy + c * vy)
                sz += mass * (pz + a * xz + b * yz + c * vz)
                carried = s.carried
                ox, oy, oz = sx - carried * px, sy - carried * py, sz - carried * pz
                fx += carried * gx
                fy += carried * gy
                fz += carried * gz
                mx += oy * gz - oz * gy
                my += oz * gx - ox * gz
                mz += ox * gy - oy * gx
                if s.balanced != 0:
                    twist = balance_torque(surroundings, q[abs(s.balanced) - 1])
                    twist = twist if s.balanced > 0 else -twist
            for d in range(6):
                if d == 0:
                    load = f[0] * fx + f[3] * fy + f[6] * fz
                elif d == 1:
                    load = f[1] * fx + f[4] * fy + f[7] * fz
                elif d == 2:
                    load = f[2] * fx + f[5] * fy + f[8] * fz
                elif d == 3:
                    load = xx * mx + xy * my + xz * mz
                elif d == 4:
                    load = yx * mx + yy * my + yz * mz
                else:
                    load = f[2] * mx + f[5] * my + f[8] * mz + twist
                new = s.compliance[d] * load
                if len(chain.regions) > 0:
                    new *= growth_at(chain.regions, i, d, q)
                change = max(change, abs(new - delta[i, d]))
                delta[i, d] = new
        if change < 1e-17 or (change >= last and change < 1e-14):
            chain_pass(chain, trig, delta, 1, frame)
            return count
        last = change
    return -1
