"""Gears whose stiffness changes with the torque and that have hysteresis: torques in place of the straight spring's."""

from __future__ import annotations

import math

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.jit import kernel
from counterflex.twin.plant.friction import play_torque
from counterflex.twin.truth.other import GearCurve

COLUMNS = 8  # torque_1, torque_2, share_1..3, hysteresis N m, its share of the load, its slip rad


def gear_parameters(gears: tuple[GearCurve, ...]) -> Float:
    """The curves as (6, 8) numbers; a row of zeros is a straight spring."""
    out = np.zeros((6, COLUMNS))
    for g in gears:
        out[g.axis] = (*g.torque_nm, *g.share, g.hysteresis_nm, g.hysteresis_share, g.hysteresis_rad)
    return out


@kernel()
def gear_torque(angle: float, stiffness: float, half_band: float, curve: Float) -> float:
    """Torque of the curve behind a dead band on the wind-up ``angle``, N m, against it."""
    x = abs(angle) - half_band
    if x <= 0.0:
        return 0.0
    knee_1 = curve[0] / (curve[2] * stiffness)
    knee_2 = knee_1 + (curve[1] - curve[0]) / (curve[3] * stiffness)
    if x <= knee_1:
        torque = curve[2] * stiffness * x
    elif x <= knee_2:
        torque = curve[0] + curve[3] * stiffness * (x - knee_1)
    else:
        torque = curve[1] + curve[4] * stiffness * (x - knee_2)
    return float(-torque if angle > 0.0 else torque)


def wind_up(torque: float, stiffness: float, curve: Float) -> float:
    """Wind-up beyond the dead band at which the curve balances ``torque`` N m, with its sign; inverse of the curve."""
    load = abs(torque)
    x = min(load, curve[0]) / curve[2]
    x += min(max(load - curve[0], 0.0), curve[1] - curve[0]) / curve[3]
    x += max(load - curve[1], 0.0) / curve[4]
    return math.copysign(x / stiffness, torque)


@kernel()
def apply_gears(
    qpos: Float,
    torsion: Int,
    stiffness: Float,
    half_band: Float,
    curves: Float,
    slip_force: Float,
    slip_angle: Float,
    force: Float,
) -> None:
    """Add to ``force`` what curved gears have more than straight springs, hysteresis included, and advance it.

    Args:
        qpos: (n,) coordinates.
        torsion: (6,) coordinate of each torsion, -1 where rigid.
        stiffness: (6,) N m/rad.
        half_band: (6,) rad.
        curves: (6, 8) of :func:`gear_parameters`.
        slip_force: (6,) N m, of the hysteresis elements, updated.
        slip_angle: (6,) rad, wind-up at the last call, updated.
        force: (n,) generalised forces, added to.
    """
    for i in range(6):
        t = torsion[i]
        if t < 0 or curves[i, 2] == 0.0:
            continue
        x = qpos[t]
        torque = gear_torque(x, stiffness[i], half_band[i], curves[i])
        limit = curves[i, 5] + curves[i, 6] * abs(torque)
        f = slip_force[i] - (curves[i, 5] + curves[i, 6] * curves[i, 1]) / curves[i, 7] * (x - slip_angle[i])
        f = min(max(f, -limit), limit)
        slip_force[i] = f
        slip_angle[i] = x
        force[t] += torque - play_torque(x, stiffness[i], half_band[i]) + f
