"""Dry friction as Maxwell slip elements and gear play as a dead band, per axis.

A slip element is a spring whose force is held at its limit: ``f <- clip(f - k dx, -limit, limit)``; it sticks without
creep. Elements 0..2 of an axis act on the link angle (motor angle plus torsion), element 3 on the motor angle. The
play is a dead band in front of the torsion spring, ``tau = -k (rz -+ b)`` outside and 0 inside. Under a load cycle
of one axis the lost motion is ``2 b + 2 Fc / k``.
"""

from __future__ import annotations

import math

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.jit import kernel
from counterflex.twin.truth.other import BristleFriction
from counterflex.twin.truth.truth import SLIP_ELEMENTS, Drive

# Link-side friction with stiction, load and temperature (LuGre), in place of the slip elements of an axis. Bristles of
# stiffness s hold the link; their torque f follows ``df = -s (dx + |dx| f / g)`` over a link motion dx, which is
# LuGre's equation without micro-damping (Canudas de Wit, Olsson, Astrom and Lischinsky 1995, IEEE Transactions on
# Automatic Control 40(3)) and is integrated exactly over a step. The torque at steady speed v is
#
# ``g(v) = warm Fc (1 + |load| / load_ref) (1 + (stiction - 1) exp(-(v / v_s)^2))`` plus ``viscous v``.
#
# The load and the temperature in it: Bittencourt and Gunnarsson 2012, J. Dyn. Sys., Meas., Control 134(5), 051013, in a
# simpler form: there stiction grows with the load as well, and heat lowers the viscous part more than the dry one.

COLUMNS = 6  # Fc, stiction, v_s, bristle stiffness, viscous, load_ref


def bristle_parameters(frictions: tuple[BristleFriction, ...]) -> Float:
    """The axes as (6, 6) numbers; a row of zeros has no bristles."""
    out = np.zeros((6, COLUMNS))
    for f in frictions:
        stiffness = f.coulomb_nm / f.bristle_rad
        out[f.axis] = (f.coulomb_nm, f.stiction_share, f.stribeck_rad_s, stiffness, f.viscous_nm_s, f.load_nm)
    return out


@kernel("float64(float64, float64, float64, float64[::1])", entry=True)
def bristle_limit(speed: float, load: float, warm: float, row: Float) -> float:
    """g: torque at which the bristles slide steadily at ``speed`` rad/s under ``load`` N m."""
    ratio = speed / row[2]
    return float(warm * row[0] * (1.0 + abs(load) / row[5]) * (1.0 + (row[1] - 1.0) * math.exp(-ratio * ratio)))


@kernel()
def bristle_torque(before: float, moved: float, stiffness: float, limit: float) -> float:
    """Torque of the bristles after a motion ``moved`` rad of the link, from ``before`` N m, at a constant limit."""
    decay = math.exp(-stiffness * abs(moved) / limit)
    if moved > 0.0:
        return before * decay - limit * (1.0 - decay)
    return before * decay + limit * (1.0 - decay)


@kernel(
    "void(float64[::1], float64[::1], int64[::1], int64[::1], float64[::1], float64[::1], "
    "float64[::1], float64[:, ::1], float64[::1], float64[::1], float64[::1])",
    entry=True,
)
def apply_bristles(
    qpos: Float,
    qvel: Float,
    motor: Int,
    torsion: Int,
    sign: Float,
    load: Float,
    warm: Float,
    bristles: Float,
    bristle_force: Float,
    link_angle: Float,
    force: Float,
) -> None:
    """Add the friction of the axes that have bristles to ``force`` and advance them.

    Args:
        qpos: (n,) coordinates.
        qvel: (n,) their speeds.
        motor: (6,) coordinate of each motor.
        torsion: (6,) coordinate of each torsion, -1 where rigid.
        sign: (6,) of each driven axis: link angle = q + sign rz.
        load: (6,) N m, torque of each gear.
        warm: (6,) friction now over that of the warm joint.
        bristles: (6, 6) of :func:`bristle_parameters`.
        bristle_force: (6,) N m, updated.
        link_angle: (6,) rad, at the last call, updated.
        force: (n,) generalised forces, added to.
    """
    for i in range(6):
        if bristles[i, 0] == 0.0:
            continue
        m, t = motor[i], torsion[i]
        link, speed = qpos[m], qvel[m]
        if t >= 0:
            link += sign[i] * qpos[t]
            speed += sign[i] * qvel[t]
        limit = bristle_limit(speed, load[i], warm[i], bristles[i])
        f = bristle_torque(bristle_force[i], link - link_angle[i], bristles[i, 3], limit)
        bristle_force[i] = f
        link_angle[i] = link
        f -= bristles[i, 4] * speed
        force[m] += f
        if t >= 0:
            force[t] += sign[i] * f


def slip_parameters(drives: tuple[Drive, ...]) -> tuple[Float, Float]:
    """Stiffness (6, 4) in N m/rad and limit (6, 4) in N m of the elements; the last column is the motor's."""
    limit = np.array([[*d.link_friction_nm, d.motor_friction_nm] for d in drives], dtype=np.float64)
    slip = np.array([[*d.link_slip_rad, d.motor_slip_rad] for d in drives], dtype=np.float64)
    stiffness: Float = limit / slip
    return stiffness, limit


@kernel("float64(float64, float64, float64)", entry=True)
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
