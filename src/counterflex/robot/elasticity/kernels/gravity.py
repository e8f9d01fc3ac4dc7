"""Torque of own weight about the axes, compiled: one point, no allocation."""

from __future__ import annotations

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.robot.elasticity.kernels.records import CHAIN, Compact
from counterflex.robot.elasticity.kernels.scalar import balance_torque, chain_pass, joint_trig


@kernel("void(Chain, float64[::1], float64[:, ::1], float64[:, ::1], float64[::1], float64[::1])", Chain=CHAIN)
def weight_torque(chain: Compact, q: Float, frame: Float, still: Float, trig: Float, out: Float) -> None:
    """Torque of weight, payload and counterbalance about each axis, positive in its positive direction; rigid geometry.

    ``T_j = sign_j z_j . sum_k m_k (p_k - p_j) x g`` over the bodies k from the axis outward, and the counterbalance's
    on its axis, as :func:`counterflex.robot.elasticity.play.axis_torque` for a batch.

    Args:
        chain: Compact chain.
        q: (6,) rad.
        frame: (m + 1, 12) work array.
        still: (m, 6) zeros.
        trig: (12,) work array.
        out: (6,) N m, written.
    """
    m = len(chain.stations) - 1
    joint_trig(q, trig)
    chain_pass(chain, trig, still, 0, frame)
    surroundings = chain.surroundings[0]
    gx, gy, gz = surroundings.gravity[0], surroundings.gravity[1], surroundings.gravity[2]
    sx, sy, sz = 0.0, 0.0, 0.0
    for k in range(6):
        out[k] = 0.0
    for n in range(m):
        i = m - 1 - n
        f, s = frame[i], chain.stations[i]
        mass, carried = s.mass, s.carried
        a, b, c = s.com[0], s.com[1], s.com[2]
        sx += mass * (f[9] + f[0] * a + f[1] * b + f[2] * c)
        sy += mass * (f[10] + f[3] * a + f[4] * b + f[5] * c)
        sz += mass * (f[11] + f[6] * a + f[7] * b + f[8] * c)
        joint = s.drive
        if joint >= 0:
            hx, hy, hz = sx - carried * f[9], sy - carried * f[10], sz - carried * f[11]
            mx, my, mz = hy * gz - hz * gy, hz * gx - hx * gz, hx * gy - hy * gx
            out[joint] += s.sign * (f[2] * mx + f[5] * my + f[8] * mz)
        turning = s.balanced
        if turning != 0:
            out[abs(turning) - 1] += balance_torque(surroundings, q[abs(turning) - 1])
