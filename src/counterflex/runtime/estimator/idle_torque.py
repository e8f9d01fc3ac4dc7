"""Motor currents without a cut: friction and error of the weight, per axis and direction of motion. Pure.

Dry friction turns round with the direction in which an axis moves, and builds up over a way (presliding). Part of it
acts on the motor and part on the link: when a force comes, the link yields to it and the correction moves the motor
back, and either turns a slow axis round. So each axis has two idle torques, one per direction: the mean of what it
showed in air, or beside a measured force, while presliding of motor and link was at its end in that direction. Only an
axis of which this holds, in a direction whose idle torque is known, tells of the force.
"""

from __future__ import annotations

from typing import Final

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.core.records import Record
from counterflex.runtime.primitives.loop_types import LOOP_TYPES

PRESLIDING_RAD: Final = 1e-4
"""Way over which dry friction builds up from nothing; twice as much turns it round. That of robots is shorter."""
_TURNED: Final = 0.8
_LEAST: Final = 25.0
_MEMORY: Final = 125.0


@kernel("float64(float64, State, int64)", inline=True, **LOOP_TYPES)
def _presliding(q: float, state: Record, k: int) -> float:
    """Elastic part of the way of a sliding contact, -1 .. 1: ``z = clamp(z + dq / presliding)``."""
    if state.has_angles > 0.0:
        z = state.presliding[k] + (q - state.angles_before[k]) / PRESLIDING_RAD
        state.presliding[k] = min(max(z, -1.0), 1.0)
    state.angles_before[k] = q
    return float(state.presliding[k])


@kernel("void(float64[::1], float64[::1], float64[::1], float64[::1])")
def less_force(w: Float, jac: Float, R_base_part: Float, torque: Float) -> None:
    """Take the torque ``J^T w`` of a force off that of the axes.

    Args:
        w: (6,) N, N m about the TCP, part axes.
        jac: (36,) Jacobian of the TCP, base axes, by rows: translation first.
        R_base_part: (9,) by rows.
        torque: (6,) N m; changed.
    """
    R = R_base_part
    for part in range(2):
        a, b, c = w[3 * part], w[3 * part + 1], w[3 * part + 2]
        for k in range(3):
            base = R[3 * k] * a + R[3 * k + 1] * b + R[3 * k + 2] * c
            for j in range(6):
                torque[j] -= jac[6 * (3 * part + k) + j] * base


@kernel("int64(float64[::1], float64[::1], float64[::1], boolean, State, float64[::1])", **LOOP_TYPES)
def follow_idle(motor: Float, link: Float, torque: Float, learn: bool, state: Record, idle: Float) -> int:
    """Learn the idle torques, and say which hold now.

    Args:
        motor: (6,) rad, angles of the motors, correction included.
        link: (6,) rad, of the links under the force.
        torque: (6,) N m of the axes, without the process where ``learn``.
        learn: They are idle torques: the plan cuts air, or the measured force has been taken off.
        state: Of the step; changed.
        idle: (6,) N m that each axis shows without a cut, as it moves now; written.

    Returns:
        Bit per axis whose idle torque is known.
    """
    known = 0
    for k in range(6):
        on_motor, on_link = _presliding(motor[k], state, k), _presliding(link[k], state, 6 + k)
        turned = min(abs(on_motor), abs(on_link)) >= _TURNED and on_motor * on_link > 0.0
        side = k if on_motor > 0.0 else 6 + k
        seen = state.idle_cycles[side]
        if turned and learn:
            seen = min(seen + 1.0, _MEMORY)
            state.idle_torque[side] += (torque[k] - state.idle_torque[side]) / seen
            state.idle_cycles[side] = seen
        idle[k] = state.idle_torque[side]
        if turned and seen >= _LEAST:
            known |= 1 << k
    state.has_angles = 1.0
    return known
