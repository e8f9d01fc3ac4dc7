"""The elastic robot in motion: inertia, damping and stiffness of a posture, and a path to move along.

The bodies of the chain are taken as compact: a point mass in its centre of gravity with the inertia of a sphere of
:data:`DENSITY_KG_M3`. The inertia of the motors, Coriolis and centrifugal forces are left out: working feeds, and
frequencies below the bandwidth of the speed loops.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, Int, as_float
from counterflex.core.errors import ModelError
from counterflex.core.units import DEG, MS
from counterflex.plan.elastic_motion_kernel import AXES, Motion
from counterflex.robot import play
from counterflex.robot.chain import ElasticChain, forward, frames
from counterflex.robot.description import Servo
from counterflex.signals.preview import Mode

STEP_S: Final = 0.5 * MS
DENSITY_KG_M3: Final = 3000.0
"""Of a robot's link as a whole, hollow castings with drives."""
DAMPING_S: Final = 2.5 * MS
"""beta of the damping D = beta K: a ratio of 0.07 at 8 Hz, to which drives and friction add theirs. Assumed;
with 1.5 ms the spindle on its holder chattered in the model at a cut that the simulated cell did quietly."""
_OVERDAMPED: Final = 0.7
"""Poles with a larger damping ratio are no modes."""
_INERTIA_RAD: Final = 2.0 * DEG
"""Change of an axis after which inertia is taken anew."""
_JACOBIAN_RAD: Final = 0.1 * DEG
"""Change of an axis after which the Jacobian is: levers change the deflection in proportion."""


def matrices(chain: ElasticChain, q: Float) -> tuple[Float, Float, Float, Float]:
    """Inertia, stiffness and Jacobians of a posture.

    Coordinates: the six link angles in the controller's direction, then every other elastic displacement of the chain
    in the order of segments and of ``tx ty tz rx ry rz``.

    Args:
        chain: Masses and compliances.
        q: (6,) rad.

    Returns:
        M (n, n) kg m2, kg m, kg; stiffness (n,) N m/rad, N/m; J (6, n) motion of the tool's tip per coordinate: m,
        rad in base axes; J_drive (6, 6) what a motor angle does beyond its column of J, where a gear gives way about
        another axis than it turns (a bearing beside it).
    """
    angles = as_float("q", q, (6,))[None]
    T = frames(chain, angles)[0]
    tip = forward(chain, angles)[0, :3, 3]
    sign = chain.sign[chain.joint >= 0]
    elements = [(int(chain.torsion[a]), 5, float(sign[a])) for a in range(AXES)]
    turning = {segment for segment, _, _ in elements}
    soft_ones = np.argwhere(chain.compliance > 0.0).tolist()
    elements += [(segment, k, 1.0) for segment, k in soft_ones if k != 5 or segment not in turning]
    n = len(elements)
    origin = np.stack([T[segment, :3, 3] for segment, _, _ in elements])
    axis = np.stack([s * T[segment, :3, k % 3] for segment, k, s in elements])
    turns = np.array([k >= 3 for _, k, _ in elements])
    place = np.array([segment for segment, _, _ in elements])
    angular = np.where(turns[:, None], axis, 0.0)

    def at(point: Float) -> Float:
        out: Float = np.where(turns[:, None], np.cross(axis, point - origin), axis)
        return out

    M = np.zeros((n, n))
    for body in range(chain.n):
        mass = float(chain.mass[body])
        if mass <= 0.0:
            continue
        carried = (place <= body)[:, None]
        v = np.where(carried, at((T[body] @ np.append(chain.com[body], 1.0))[:3]), 0.0)
        w = np.where(carried, angular, 0.0)
        radius = (0.75 * mass / (math.pi * DENSITY_KG_M3)) ** (1.0 / 3.0)
        M += mass * (v @ v.T) + 0.4 * mass * radius**2 * (w @ w.T)
    soft = np.array([max(chain.compliance[segment, k], play.STIFFEST_RAD_NM) for segment, k, _ in elements])
    J: Float = np.concatenate([at(tip), angular], axis=1).T
    driven = np.flatnonzero(chain.joint >= 0)
    turn = sign[:, None] * T[driven, :3, 2]
    J_drive = np.concatenate([np.cross(turn, tip - T[driven, :3, 3]), turn], axis=1).T - J[:, :AXES]
    return M, 1.0 / soft, J, J_drive


def lowest_mode(M: Float, stiffness: Float, beta_s: float, servo: tuple[Servo | None, ...]) -> Mode:
    """Lowest mode of a posture while the drives hold it.

    The eigenvalue of smallest frequency of the linear equations (no play, no friction) that is damped by less than
    :data:`_OVERDAMPED`.

    Args:
        M: (n, n) inertia.
        stiffness: (n,), K is diagonal.
        beta_s: s, damping D is beta K.
        servo: Of the six axes.

    Raises:
        ModelError: Nothing swings: the chain has no masses.
    """
    n = len(stiffness)
    inverse = np.linalg.pinv(M, hermitian=True)
    K = np.diag(stiffness)
    A = np.zeros((2 * n + 2 * AXES, 2 * n + 2 * AXES))
    lag = slice(2 * n, 2 * n + AXES)
    A[:n, n : 2 * n] = np.eye(n)
    A[n : 2 * n, :n] = -inverse @ K
    A[n : 2 * n, n : 2 * n] = -beta_s * inverse @ K
    A[n : 2 * n, lag] = inverse @ K[:, :AXES]
    for a, entry in enumerate(servo):
        if entry is None:
            continue
        through = np.zeros(len(A))
        through[a], through[2 * n + a] = stiffness[a], -stiffness[a]
        row = through / entry.speed_gain_nm_s
        row[2 * n + AXES + a] -= 1.0 / entry.integral_time_s
        A[2 * n + AXES + a] = row
        A[2 * n + a] = row
        A[2 * n + a, 2 * n + a] -= entry.position_gain_per_s
        A[n : 2 * n] += beta_s * np.outer(inverse @ K[:, a], A[2 * n + a])
    poles = np.linalg.eigvals(A)
    poles = poles[poles.imag > 1e-6 * np.abs(poles)]
    poles = poles[-poles.real < _OVERDAMPED * np.abs(poles)]
    if len(poles) == 0:
        raise ModelError("the chain has no masses, so it has no modes", hint="Give mass_kg of the bodies")
    lowest = poles[np.argmin(np.abs(poles))]
    return Mode(float(np.abs(lowest)), float(-lowest.real / np.abs(lowest)))


def motion_along(
    chain: ElasticChain,
    T_base_part: Float,
    q_ref: Float,
    q_command: Float,
    time_s: Float,
    damping_s: float = DAMPING_S,
    step_s: float = STEP_S,
) -> Motion:
    """What :func:`counterflex.plan.elastic_motion_kernel.advance` needs for a path, at rest at its first row.

    Args:
        chain: The elastic robot with play and drives.
        T_base_part: (4, 4), gives the axes of wrench and deviation.
        q_ref: (rows, 6) rad along the programmed path.
        q_command: (rows, 6) rad that are commanded.
        time_s: (rows,) s.
        damping_s: beta of the damping D = beta K.
        step_s: Length of a step.

    Raises:
        InputError: Shapes do not match.
    """
    rows = len(as_float("time_s", time_s, (None,)))
    nominal = np.ascontiguousarray(as_float("q_ref", q_ref, (rows, 6)))
    command = np.ascontiguousarray(as_float("q_command", q_command, (rows, 6)))
    posture, chosen = postures(nominal, _INERTIA_RAD)
    place, places = postures(nominal, _JACOBIAN_RAD)
    servo = chain.servo or (None,) * AXES
    stiffness = matrices(chain, nominal[0])[1]
    n, count = len(stiffness), len(chosen)
    answer, keep = np.empty((count, n, n)), np.empty((count, n, n))
    J, J_drive = np.empty((len(places), 6, n)), np.empty((len(places), 6, AXES))
    R = np.kron(np.eye(2), T_base_part[:3, :3])
    held = np.diag((0.5 * step_s * damping_s + 0.25 * step_s**2) * stiffness)
    for k, row in enumerate(chosen):
        M = matrices(chain, nominal[row])[0]
        inverse = np.linalg.inv(M + held)
        answer[k], keep[k] = step_s * inverse, inverse @ (M - held)
    for k, row in enumerate(places):
        _, _, J_link, J_motor = matrices(chain, nominal[row])
        J[k], J_drive[k] = R.T @ J_link, R.T @ J_motor
    weight = play.axis_torque(chain, nominal)
    band, limit, slip = play.arrays(chain)
    gains = np.array(
        [
            (0.0, 0.0, 1.0, 0.0, 1.0)
            if s is None
            else (s.speed_gain_nm_s, s.position_gain_per_s, s.integral_time_s, s.friction_nm, s.slip_rad)
            for s in servo
        ]
    ).T.copy()
    return Motion(
        step_s=step_s,
        time_s=np.ascontiguousarray(time_s, dtype=np.float64),
        q_command=command,
        q_ref=nominal,
        weight=weight,
        posture=posture,
        place=place,
        answer=answer,
        keep=keep,
        J_tcp_part=J,
        J_drive_part=J_drive,
        stiffness=stiffness,
        damping=damping_s * stiffness[:AXES],
        half_band=band,
        limit=limit,
        slip=slip,
        speed_gain=gains[0],
        position_gain=gains[1],
        integral_time=gains[2],
        motor_friction=gains[3],
        motor_slip=gains[4],
        x=np.zeros(n),
        rate=np.zeros(n),
        drives=np.zeros((7, AXES)),
        held=np.zeros(limit.shape),
        clock=np.zeros(2),
        program=np.zeros(AXES),
        load=np.zeros(n),
        fresh=np.zeros(n),
    )


def postures(q: Float, apart_rad: float) -> tuple[Int, list[int]]:
    """Rows of a path that stand for those near them.

    Args:
        q: (rows, 6) rad.
        apart_rad: Change of an axis after which another row stands.

    Returns:
        (rows,) number of the posture of each row, and the rows that are the postures.
    """
    chosen: list[int] = []
    out = np.zeros(len(q), dtype=np.int64)
    start = 0
    while start < len(q):
        near = np.max(np.abs(q[start:] - q[start]), axis=1) <= apart_rad
        end = start + (len(near) if np.all(near) else int(np.argmin(near)))
        out[start:end] = len(chosen)
        chosen.append(start)
        start = end
    return out, chosen


def _still() -> Motion:
    """A motion without coordinates: the tool is bent by something else."""
    none, six, rows = np.zeros(0), np.zeros(AXES), np.zeros((0, AXES))
    no_index = np.zeros(0, dtype=np.int64)
    return Motion(
        step_s=STEP_S,
        time_s=none,
        q_command=rows,
        q_ref=rows,
        weight=rows,
        posture=no_index,
        place=no_index,
        answer=np.zeros((0, 0, 0)),
        keep=np.zeros((0, 0, 0)),
        J_tcp_part=np.zeros((0, 6, 0)),
        J_drive_part=np.zeros((0, 6, AXES)),
        stiffness=none,
        damping=six,
        half_band=six,
        limit=np.zeros((AXES, 0)),
        slip=np.zeros((AXES, 0)),
        speed_gain=six,
        position_gain=six,
        integral_time=six,
        motor_friction=six,
        motor_slip=six,
        x=none,
        rate=none,
        drives=np.zeros((7, AXES)),
        held=np.zeros((AXES, 0)),
        clock=np.zeros(2),
        program=six,
        load=none,
        fresh=none,
    )


STILL: Final = _still()
"""Stands for no motion where a kernel asks for one."""
