"""Torque of own weight about the axes, compiled: one point, no allocation."""

from __future__ import annotations

from counterflex.core.arrays import Float, Int
from counterflex.core.jit import kernel
from counterflex.robot.elasticity.kernels.scalar import (
    BALANCED,
    CARRIED,
    COM,
    DRIVE,
    GRAVITY,
    MASS,
    SIGN,
    balance_torque,
    chain_pass,
    joint_trig,
)


@kernel(
    "void(float64[:, ::1], int64[:, ::1], float64[::1], float64[:, ::1], float64[:, ::1], float64[::1], float64[::1])"
)
def weight_torque(real: Float, kind: Int, q: Float, frame: Float, still: Float, trig: Float, out: Float) -> None:
    """Torque of weight, payload and counterbalance about each axis, positive in its positive direction; rigid geometry.

    ``T_j = sign_j z_j . sum_k m_k (p_k - p_j) x g`` over the bodies k from the axis outward, and the counterbalance's
    on its axis, as :func:`counterflex.robot.elasticity.play.axis_torque` for a batch.

    Args:
        real: Compact chain, see :mod:`counterflex.robot.elasticity.kernels.scalar`.
        kind: Likewise.
        q: (6,) rad.
        frame: (m + 1, 12) work array.
        still: (m, 6) zeros.
        trig: (12,) work array.
        out: (6,) N m, written.
    """
    m = kind.shape[0] - 1
    joint_trig(q, trig)
    chain_pass(real, kind, m, trig, still, 0, frame)
    gx, gy, gz = real[m + 1, GRAVITY], real[m + 1, GRAVITY + 1], real[m + 1, GRAVITY + 2]
    sx, sy, sz = 0.0, 0.0, 0.0
    for k in range(6):
        out[k] = 0.0
    for n in range(m):
        i = m - 1 - n
        f, mass, carried = frame[i], real[i, MASS], real[i, CARRIED]
        a, b, c = real[i, COM], real[i, COM + 1], real[i, COM + 2]
        sx += mass * (f[9] + f[0] * a + f[1] * b + f[2] * c)
        sy += mass * (f[10] + f[3] * a + f[4] * b + f[5] * c)
        sz += mass * (f[11] + f[6] * a + f[7] * b + f[8] * c)
        joint = kind[i, DRIVE]
        if joint >= 0:
            hx, hy, hz = sx - carried * f[9], sy - carried * f[10], sz - carried * f[11]
            mx, my, mz = hy * gz - hz * gy, hz * gx - hx * gz, hx * gy - hy * gx
            out[joint] += real[i, SIGN] * (f[2] * mx + f[5] * my + f[8] * mz)
        turning = kind[i, BALANCED]
        if turning != 0:
            out[abs(turning) - 1] += balance_torque(real[m + 1], q[abs(turning) - 1])
