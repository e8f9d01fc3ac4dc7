"""Dry friction as Maxwell slip elements and gear play as a dead band, per axis.

A slip element is a spring whose force is held at its limit: ``f <- clip(f - k dx, -limit, limit)``; it sticks without
creep. Elements 0..2 of an axis act on the link angle (motor angle plus torsion), element 3 on the motor angle. The
play is a dead band in front of the torsion spring, ``tau = -k (rz -+ b)`` outside and 0 inside. Under a load cycle
of one axis the lost motion is ``2 b + 2 Fc / k``.
"""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.jit import kernel
from counterflex.twin.truth.truth import SLIP_ELEMENTS, Drive


def slip_parameters(drives: tuple[Drive, ...]) -> tuple[Float, Float]:
    """Stiffness (6, 4) in N m/rad and limit (6, 4) in N m of the elements; the last column is the motor's."""
    limit = np.array([[*d.link_friction_nm, d.motor_friction_nm] for d in drives], dtype=np.float64)
    slip = np.array([[*d.link_slip_rad, d.motor_slip_rad] for d in drives], dtype=np.float64)
    stiffness: Float = limit / slip
    return stiffness, limit


@kernel()
def play_torque(angle: float, stiffness: float, half_band: float) -> float:
    """Torque of a spring behind a dead band, N m: ``-k (angle - b)`` above b, ``-k (angle + b)`` below -b, else 0."""
    if angle > half_band:
        return -stiffness * (angle - half_band)
    if angle < -half_band:
        return -stiffness * (angle + half_band)
    return 0.0


@kernel()
def apply_friction(
    qpos: Float,
    motor: Int,
    torsion: Int,
    sign: Float,
    torsion_stiffness: Float,
    half_band: Float,
    slip_stiffness: Float,
    slip_limit: Float,
    slip_force: Float,
    slip_angle: Float,
    force: Float,
) -> None:
    """Add torsion springs with play and slip elements to ``force`` and advance the elements.

    Args:
        qpos: (n,) coordinates.
        motor: (6,) coordinate of each motor.
        torsion: (6,) coordinate of each torsion, -1 where rigid.
        sign: (6,) of each driven axis: link angle = q + sign rz.
        torsion_stiffness: (6,) N m/rad.
        half_band: (6,) rad.
        slip_stiffness: (6, 4) N m/rad.
        slip_limit: (6, 4) N m.
        slip_force: (6, 4) N m, updated.
        slip_angle: (6, 2) rad, link and motor angle at the last call, updated.
        force: (n,) generalised forces, added to.
    """
    for i in range(6):
        m, t = motor[i], torsion[i]
        link = qpos[m]
        if t >= 0:
            link += sign[i] * qpos[t]
            force[t] += play_torque(qpos[t], torsion_stiffness[i], half_band[i])
        moved = link - slip_angle[i, 0]
        total = 0.0
        for e in range(SLIP_ELEMENTS):
            f = slip_force[i, e] - slip_stiffness[i, e] * moved
            f = min(max(f, -slip_limit[i, e]), slip_limit[i, e])
            slip_force[i, e] = f
            total += f
        force[m] += total
        if t >= 0:
            force[t] += sign[i] * total
        f = slip_force[i, SLIP_ELEMENTS] - slip_stiffness[i, SLIP_ELEMENTS] * (qpos[m] - slip_angle[i, 1])
        f = min(max(f, -slip_limit[i, SLIP_ELEMENTS]), slip_limit[i, SLIP_ELEMENTS])
        slip_force[i, SLIP_ELEMENTS] = f
        force[m] += f
        slip_angle[i, 0] = link
        slip_angle[i, 1] = qpos[m]
