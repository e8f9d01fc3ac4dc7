"""Everything that acts on the chain besides its own springs and weight, one call for each step of the plant."""

from __future__ import annotations

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.jit import kernel
from counterflex.twin.plant.drives import apply_drives
from counterflex.twin.plant.friction import apply_friction
from counterflex.twin.plant.loads import apply_loads


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
