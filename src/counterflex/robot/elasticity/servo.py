"""Yield of the motors of the axes to a load that changes: a position loop P around a speed loop PI.

With K the gain of the speed loop, Kv that of the position loop and Ti its integral time, a torque tau on the motor
turns it away from its command by::

    e(s) = tau(s) s / (K (s + Kv) (s + 1/Ti))

A steady torque leaves nothing; a step of tau leaves up to ``0.4 tau / (K Kv)`` for a tenth of a second, which is why
entries, exits and reversals of an axis (its friction turns round) show a bump. Inertia (frequencies above Kv and 1/Ti)
and the acceleration of the commanded motion are left out. tau is what comes through the gear plus dry friction at the
motor, which yields ``slip`` after a reversal.

Source: cascade control of feed drives, for example Altintas 2012, Manufacturing Automation, ch. 6.
"""

from __future__ import annotations

import math

import numpy as np

from counterflex.core.arrays import Float, as_float
from counterflex.core.errors import InputError
from counterflex.core.jit import kernel
from counterflex.robot.model.description import Servo

_POLE_SEPARATION = 1e-6  # relative distance kept between the two poles


@kernel(
    "void(float64[::1], float64[::1], float64[::1], float64, float64, float64, float64, float64, float64[::1])",
    entry=True,
)
def yielding(
    q: Float,
    load: Float,
    time_s: Float,
    gain: float,
    fast: float,
    slow: float,
    friction: float,
    slip: float,
    out: Float,
) -> None:
    """Error of one axis; exact for a torque that is linear in time between the points.

    Args:
        q: (n,) rad, commanded.
        load: (n,) N m through the gear, in the positive direction of the angle.
        time_s: (n,) non-decreasing.
        gain: K, N m s/rad.
        fast: one pole, 1/s.
        slow: the other, 1/s, different.
        friction: N m at the motor.
        slip: rad.
        out: (n,) rad, written.
    """
    friction_torque, before, first, second = 0.0, 0.0, 0.0, 0.0
    for n in range(q.shape[0]):
        if n > 0 and friction > 0.0:
            friction_torque = min(max(friction_torque - friction / slip * (q[n] - q[n - 1]), -friction), friction)
        # At rest the integral part has taken up the first load: only what changes turns the motor.
        torque = load[n] - load[0] + friction_torque
        h = time_s[n] - time_s[n - 1] if n > 0 else 0.0
        if h > 0.0:
            # Exact for a torque that runs straight between two points, so that the error does not depend on how finely
            # a path is sampled.
            decay = math.exp(-fast * h)
            mean = (1.0 - decay) / (fast * h)
            first = decay * first + ((mean - decay) * before + (1.0 - mean) * torque) / fast
            decay = math.exp(-slow * h)
            mean = (1.0 - decay) / (slow * h)
            second = decay * second + ((mean - decay) * before + (1.0 - mean) * torque) / slow
        out[n] = (fast * first - slow * second) / (gain * (fast - slow))
        before = torque


def servo_error(servo: tuple[Servo | None, ...], q: Float, load: Float, time_s: Float) -> Float:
    """Motor angle minus commanded angle along a path, from a state at rest under the first load.

    Args:
        servo: Of each axis, None for one that never yields.
        q: (n, k) rad, commanded angles.
        load: (n, k) N m on the motors through the gears, positive in the positive direction of the angles.
        time_s: (n,) s, non-decreasing.

    Returns:
        (n, k) rad.

    Raises:
        InputError: Shapes do not match or time runs backwards.
    """
    angles = as_float("q", q, (None, len(servo)))
    torque = as_float("load", load, angles.shape)
    time = np.ascontiguousarray(as_float("time_s", time_s, (len(angles),)))
    if np.any(np.diff(time) < 0.0):
        raise InputError("time of the path runs backwards", value=float(np.diff(time).min()), limit=">= 0")
    out = np.zeros(angles.shape)
    column = np.empty(len(angles))
    for axis, entry in enumerate(servo):
        if entry is None:
            continue
        fast, slow = entry.position_gain_per_s, 1.0 / entry.integral_time_s
        if abs(fast - slow) < _POLE_SEPARATION * slow:
            # Partial fractions divide by the distance of the poles.
            fast = slow * (1.0 + _POLE_SEPARATION)
        yielding(
            np.ascontiguousarray(angles[:, axis]), np.ascontiguousarray(torque[:, axis]), time,
            entry.speed_gain_nm_s, fast, slow, entry.friction_nm, entry.slip_rad, column,
        )  # fmt: skip
        out[:, axis] = column
    return out
