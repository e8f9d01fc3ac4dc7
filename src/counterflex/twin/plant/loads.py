"""Generalised forces of loads on the chain: a wrench at the tool tip, and the gas cylinder of axis 2."""

from __future__ import annotations

import math

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.jit import kernel
from counterflex.robot.model.description import Counterbalance
from counterflex.twin.plant.drives import apply_drives
from counterflex.twin.plant.friction import apply_friction


def balance_parameters(counterbalance: Counterbalance | None) -> Float:
    """The cylinder as (7,) numbers: joint (-1 where there is none), D, k, q_min, A, Z R T m, V_max."""
    if counterbalance is None:
        return np.array([-1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0])
    c = counterbalance
    return np.array(
        [
            float(c.joint),
            c.anchor_column_m,
            c.anchor_arm_m,
            c.q_min_force_rad,
            c.piston_area_m2,
            c.gas_constant_j,
            c.gas_volume_max_m3,
        ]
    )


@kernel()
def balance_torque(angle: float, balance: Float) -> float:
    """Torque of the gas cylinder about its axis, N m, towards the angle of least force.

    ``l = sqrt(D^2 + k^2 - 2 D k cos d)``, ``p = Z R T m / (V_max - (l - (D - k)) A)``, ``tau = -D k sin(d) / l p A``
    with ``d = angle - q_min``; see :class:`~counterflex.robot.model.description.Counterbalance`.
    """
    d = angle - balance[3]
    length = math.sqrt(balance[1] ** 2 + balance[2] ** 2 - 2.0 * balance[1] * balance[2] * math.cos(d))
    pressure = balance[5] / (balance[6] - (length - (balance[1] - balance[2])) * balance[4])
    return float(-balance[1] * balance[2] * math.sin(d) / length * pressure * balance[4])


@kernel(
    "void(float64[::1], float64[:, ::1], float64[:, ::1], boolean[::1], int64[::1], int64[::1], "
    "float64[::1], float64[::1], float64[::1], float64[::1], float64[::1])",
    entry=True,
)
def apply_loads(
    qpos: Float,
    anchor: Float,
    axis: Float,
    hinge: Bool,
    motor: Int,
    torsion: Int,
    sign: Float,
    p_base_tcp: Float,
    w_tcp_base: Float,
    balance: Float,
    force: Float,
) -> None:
    """Add ``J^T w`` of the wrench at the tool tip and the cylinder torque to ``force``.

    Args:
        qpos: (n,) coordinates.
        anchor: (n, 3) m, point each hinge turns about, base frame.
        axis: (n, 3) unit axis of each coordinate, base frame.
        hinge: (n,) rotation (True) or translation.
        motor: (6,) coordinate of each motor.
        torsion: (6,) coordinate of each torsion, -1 where rigid.
        sign: (6,) of each driven axis.
        p_base_tcp: (3,) m.
        w_tcp_base: (6,) N, N m on the tool about the tip in base axes.
        balance: (7,) of :func:`balance_parameters`.
        force: (n,) generalised forces, added to.
    """
    fx, fy, fz = w_tcp_base[0], w_tcp_base[1], w_tcp_base[2]
    if fx != 0.0 or fy != 0.0 or fz != 0.0 or w_tcp_base[3] != 0.0 or w_tcp_base[4] != 0.0 or w_tcp_base[5] != 0.0:
        for c in range(qpos.shape[0]):
            ax, ay, az = axis[c, 0], axis[c, 1], axis[c, 2]
            if hinge[c]:
                rx, ry, rz = p_base_tcp[0] - anchor[c, 0], p_base_tcp[1] - anchor[c, 1], p_base_tcp[2] - anchor[c, 2]
                force[c] += (
                    ax * (ry * fz - rz * fy + w_tcp_base[3])
                    + ay * (rz * fx - rx * fz + w_tcp_base[4])
                    + az * (rx * fy - ry * fx + w_tcp_base[5])
                )
            else:
                force[c] += ax * fx + ay * fy + az * fz
    joint = int(balance[0])
    if joint >= 0:
        m, t = motor[joint], torsion[joint]
        angle = qpos[m] + (sign[joint] * qpos[t] if t >= 0 else 0.0)
        tau = balance_torque(angle, balance)
        force[m] += tau
        if t >= 0:
            force[t] += sign[joint] * tau


@kernel(
    "void(float64[::1], float64[::1], float64[:, ::1], float64[:, ::1], boolean[::1], int64[::1], "
    "int64[::1], float64[::1], float64[::1], float64[::1], float64[::1], float64[::1], float64[::1], "
    "float64[:, ::1], float64[:, ::1], float64[:, ::1], float64[:, ::1], float64[::1], float64[::1], "
    "float64[:, ::1], float64[::1], float64, float64[::1], float64[::1])",
    entry=True,
)
def applied_forces(
    qpos: Float,
    qvel: Float,
    anchor: Float,
    axis: Float,
    hinge: Bool,
    motor: Int,
    torsion: Int,
    sign: Float,
    p_base_tcp: Float,
    w_tcp_base: Float,
    balance: Float,
    torsion_stiffness: Float,
    half_band: Float,
    slip_stiffness: Float,
    slip_limit: Float,
    slip_force: Float,
    slip_angle: Float,
    q_ref: Float,
    qd_ref: Float,
    pid: Float,
    integral: Float,
    step_s: float,
    force: Float,
    torque: Float,
) -> None:
    """Set ``force`` to loads, friction and drives at one step; arguments as there."""
    force[:] = 0.0
    apply_loads(qpos, anchor, axis, hinge, motor, torsion, sign, p_base_tcp, w_tcp_base, balance, force)
    apply_friction(
        qpos, motor, torsion, sign, torsion_stiffness, half_band, slip_stiffness, slip_limit, slip_force, slip_angle,
        force,
    )  # fmt: skip
    apply_drives(qpos, qvel, motor, q_ref, qd_ref, pid, integral, step_s, force, torque)
