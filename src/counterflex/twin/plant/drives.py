"""Axis servo: cascade of position P and speed PI with speed feed-forward, on the motor angle.

With full feed-forward the cascade is a PID on the motor angle, ``tau = kp e + kv de/dt + integral(ki e)``. A drive
without feed-forward follows with the lag of a first-order filter, which therefore sits in front of it: see
:func:`first_order_lag`.
"""

from __future__ import annotations

import math
import random
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, Int, as_float, as_positive
from counterflex.core.jit import kernel
from counterflex.twin.truth.truth import Drive

# Motor currents of the simulated robot, as its controller shows them: torque constants, ripple, resolution.
# The torque of a drive on the link side is its current times a constant: that of the motor times the gear ratio. The
# data sheet's are :data:`DATA_SHEET_NM_A`; those of a robot differ by a few percent (magnets, temperature, efficiency).

DATA_SHEET_NM_A: Final = (320.0, 340.0, 300.0, 190.0, 175.0, 110.0)
"""N m on the link side per A, of the axes 1 to 6: motors of 1.2 to 1.5 N m/A behind gears of 90 to 250."""
SHARE: Final = 0.03
"""Standard deviation of a robot's constants from the data sheet's."""
RIPPLE_A: Final = 0.05
"""Standard deviation of the mean over a cycle: cogging and the current sensor."""


class MotorCurrents:
    """Motor currents as the controller of one robot shows them."""

    def __init__(self, seed: int) -> None:
        rng = np.random.Generator(np.random.PCG64(random.Random(f"counterflex-currents-1:{seed}").getrandbits(64)))
        self._per_nm: Float = 1.0 / (np.array(DATA_SHEET_NM_A) * (1.0 + SHARE * rng.standard_normal(6)))
        self._rng = rng

    def __call__(self, drive_torque: Float) -> Float:
        """(6,) A from the mean torque of the drives over a cycle (6,) N m, both positive with the axis."""
        current: Float = drive_torque * self._per_nm + RIPPLE_A * self._rng.standard_normal(6)
        return current


def gains(drives: tuple[Drive, ...]) -> Float:
    """PID gains ``kp, kv, ki`` (6, 3) in N m/rad, N m s/rad, N m/(rad s), see :class:`.truth.Drive`."""
    out = np.empty((len(drives), 3))
    for row, d in zip(out, drives, strict=True):
        speed_gain = d.speed_bandwidth_per_s * d.servo_inertia_kg_m2
        row[:] = (
            speed_gain * (d.position_gain_per_s + 1.0 / d.integral_time_s),
            speed_gain,
            speed_gain * d.position_gain_per_s / d.integral_time_s,
        )
    return out


@kernel()
def apply_drives(
    qpos: Float,
    qvel: Float,
    motor: Int,
    q_ref: Float,
    qd_ref: Float,
    pid: Float,
    integral: Float,
    step_s: float,
    force: Float,
    torque: Float,
) -> None:
    """Add the drive torques to ``force`` and integrate the I part.

    Args:
        qpos: (n,) coordinates.
        qvel: (n,) speeds.
        motor: (6,) coordinate of each motor.
        q_ref: (6,) rad.
        qd_ref: (6,) rad/s.
        pid: (6, 3) gains.
        integral: (6,) N m, updated.
        force: (n,) generalised forces, added to.
        torque: (6,) N m, set to the drive torques.
    """
    for i in range(6):
        c = motor[i]
        error = q_ref[i] - qpos[c]
        tau = pid[i, 0] * error + pid[i, 1] * (qd_ref[i] - qvel[c]) + integral[i]
        integral[i] += pid[i, 2] * error * step_s
        torque[i] = tau
        force[c] += tau


def following_gains(drives: tuple[Drive, ...], everywhere_per_s: float | None = None) -> Float:
    """Kv of each axis that trails its reference (6,) 1/s; infinite where speed feed-forward is full.

    ``everywhere_per_s``: For axes whose drive says nothing; None is full feed-forward.
    """
    rest = math.inf if everywhere_per_s is None else everywhere_per_s
    return np.array([rest if d.following_gain_per_s is None else d.following_gain_per_s for d in drives])


class FollowingLag:
    """Response of the drives to their references, cycle by cycle: :func:`first_order_lag` per axis.

    ``gains_per_s``: (n,) Kv; infinite follows at once. ``start``: (n,) rad, where they stand.
    """

    def __init__(self, gains_per_s: Float, cycle_s: float, start: Float) -> None:
        x = np.asarray(gains_per_s, dtype=np.float64) * cycle_s
        trailing = np.isfinite(x)
        safe = np.where(trailing, x, 1.0)
        self._decay: Float = np.where(trailing, np.exp(-safe), 0.0)
        mean = np.where(trailing, (1.0 - np.exp(-safe)) / safe, 0.0)
        self._before: Float = mean - self._decay
        self._now: Float = 1.0 - mean
        self.reset(start)

    def reset(self, start: Float) -> None:
        """Stand at ``start`` (n,) rad."""
        self._commanded: Float = np.array(start, dtype=np.float64)
        self._followed: Float = self._commanded.copy()

    def __call__(self, q: Float) -> Float:
        """Take the angles (n,) of the end of this cycle; returns where the drives' references are by then."""
        self._followed = self._decay * self._followed + self._before * self._commanded + self._now * q
        self._commanded = np.array(q, dtype=np.float64)
        return self._followed


def first_order_lag(q: Float, cycle_s: float, gain_per_s: float) -> Float:
    """Reference behind a first-order lag, exact for a reference that is linear between samples.

    ``dy/dt = Kv (q - y)``, ``y(0) = q(0)``; at steady speed v it trails by ``v / Kv``.

    Args:
        q: (n, m) samples, any unit.
        cycle_s: Time between samples, s.
        gain_per_s: Kv, 1/s.

    Returns:
        (n, m).
    """
    q = as_float("reference", q, (None, None))
    rate = as_positive("gain_per_s", gain_per_s)
    decay = math.exp(-rate * as_positive("cycle_s", cycle_s))
    mean = (1.0 - decay) / (rate * cycle_s)
    out = np.array(q)
    for k in range(1, len(q)):
        out[k] = decay * out[k - 1] + (mean - decay) * q[k - 1] + (1.0 - mean) * q[k]
    return out
