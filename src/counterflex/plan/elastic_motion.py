"""The elastic robot in motion: inertia, damping and stiffness of a posture, and a path to move along.

The bodies of the chain are taken as compact: a point mass in its centre of gravity with the inertia of a sphere of
:data:`DENSITY_KG_M3`. The inertia of the motors, Coriolis and centrifugal forces are left out: working feeds, and
frequencies below the bandwidth of the speed loops.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int, as_float, batches
from counterflex.core.units import DEG, MS
from counterflex.plan.bending_kernels import THRUST_SIZE
from counterflex.plan.elastic_motion_kernel import AXES, STATE_ARRAYS, MotionArrays, number_postures
from counterflex.plan.relative_motion import RelativeMotion
from counterflex.robot.elasticity import play
from counterflex.robot.elasticity.chain import ElasticChain, forward, frames
from counterflex.robot.elasticity.compliance import load_factors

STEP_S: Final = 0.5 * MS
DENSITY_KG_M3: Final = 3000.0
"""Of a robot's link as a whole, hollow castings with drives."""
DAMPING_S: Final = 2.5 * MS
"""beta of the damping D = beta K: a ratio of 0.07 at 8 Hz, to which drives and friction add theirs. Assumed;
with 1.5 ms the spindle on its holder chattered in the model at a cut that the simulated cell did quietly."""
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
        rad in base axes; J_drive (6, 6) what a motor angle does beyond its column of J, where a gear yields about
        another axis than it turns (a bearing beside it).
    """
    angles = as_float("q", q, (6,))[None]
    J, J_drive = jacobians(chain, angles)
    return inertia(chain, angles)[0], stiffness_of(chain, angles)[0], J[0], J_drive[0]


def stiffness_of(chain: ElasticChain, q: Float, w_tcp_base: Float | None = None) -> Float:
    """Stiffness of each coordinate of :func:`matrices`.

    Args:
        chain: Compliances, with those that differ by region of the joint space or by load.
        q: (rows, 6) rad.
        w_tcp_base: (rows, 6) N, N m: the load that compliance curves are taken at; None takes the compliances of the
            cell.

    Returns:
        (rows, n) N m/rad, N/m; one row for all where no compliance differs.
    """
    segment, direction, _ = coordinates(chain)
    loads = w_tcp_base if chain.curves else None
    if not chain.regions and loads is None:
        return 1.0 / np.maximum(chain.compliance[None, segment, direction], play.STIFFEST_RAD_NM)
    out = np.empty((len(q), len(segment)))
    for rows in batches(len(q)):
        soft = chain.compliance_at(q[rows])
        if loads is not None:
            soft = soft * load_factors(chain, q[rows], loads[rows])
        soft = soft[:, segment, direction]
        out[rows] = 1.0 / np.maximum(soft, play.STIFFEST_RAD_NM)
    return out


def inertia(chain: ElasticChain, q: Float) -> Float:
    """Inertia of many postures.

    Args:
        chain: Masses and compliances.
        q: (rows, 6) rad.

    Returns:
        (rows, n, n) kg m2, kg m, kg, in the coordinates of :func:`matrices`.
    """
    angles = as_float("q", q, (None, 6))
    segment, direction, sign = coordinates(chain)
    turns = (direction >= 3)[:, None]
    out = np.zeros((len(angles), len(segment), len(segment)))
    for rows in batches(len(angles)):
        T, M = frames(chain, angles[rows]), out[rows]
        origin, axis = _screws(T, segment, direction, sign)
        angular = np.where(turns, axis, 0.0)
        for body in np.flatnonzero(chain.mass > 0.0):
            mass = float(chain.mass[body])
            carried = (segment <= body)[:, None]
            centre = (T[:, body] @ np.append(chain.com[body], 1.0))[:, None, :3]
            v = np.where(carried, np.where(turns, np.cross(axis, centre - origin), axis), 0.0)
            w = np.where(carried, angular, 0.0)
            radius = (0.75 * mass / (math.pi * DENSITY_KG_M3)) ** (1.0 / 3.0)
            M += mass * (v @ np.swapaxes(v, 1, 2)) + 0.4 * mass * radius**2 * (w @ np.swapaxes(w, 1, 2))
    return out


def jacobians(chain: ElasticChain, q: Float) -> tuple[Float, Float]:
    """Motion of the tool's tip per coordinate and per motor angle in many postures.

    Args:
        q: (rows, 6) rad.

    Returns:
        J (rows, 6, n) and J_drive (rows, 6, 6) of :func:`matrices`, base axes.
    """
    angles = as_float("q", q, (None, 6))
    segment, direction, sign = coordinates(chain)
    turns = (direction >= 3)[:, None]
    driven = np.flatnonzero(chain.joint >= 0)
    J, J_drive = np.empty((len(angles), 6, len(segment))), np.empty((len(angles), 6, AXES))
    for rows in batches(len(angles)):
        T = frames(chain, angles[rows])
        tip = forward(chain, angles[rows])[:, None, :3, 3]
        origin, axis = _screws(T, segment, direction, sign)
        linear = np.where(turns, np.cross(axis, tip - origin), axis)
        J[rows] = np.swapaxes(np.concatenate([linear, np.where(turns, axis, 0.0)], axis=2), 1, 2)
        drives = T[:, driven, :3]
        turn = sign[:AXES, None] * drives[..., 2]
        moved = np.concatenate([np.cross(turn, tip - drives[..., 3]), turn], axis=2)
        J_drive[rows] = np.swapaxes(moved, 1, 2) - J[rows, :, :AXES]
    return J, J_drive


def coordinates(chain: ElasticChain) -> tuple[Int, Int, Float]:
    """Segment, direction (0..5 of ``tx ty tz rx ry rz``) and sign of each coordinate; the axes come first."""
    sign = chain.sign[chain.joint >= 0]
    results = [(int(chain.torsion[a]), 5, float(sign[a])) for a in range(AXES)]
    turning = {segment for segment, _, _ in results}
    soft = np.argwhere(chain.compliance > 0.0).tolist()
    results += [(segment, k, 1.0) for segment, k in soft if k != 5 or segment not in turning]
    segment, direction, signs = zip(*results, strict=True)
    return np.array(segment, dtype=np.int64), np.array(direction, dtype=np.int64), np.array(signs)


def _screws(T: Float, segment: Int, direction: Int, sign: Float) -> tuple[Float, Float]:
    """Origin and signed axis (rows, n, 3) of each coordinate from the poses (rows, segments, 4, 4) of the segments."""
    own = T[:, segment, :3]
    axis = np.take_along_axis(own, (direction % 3)[None, :, None, None], axis=3)[..., 0]
    return own[..., 3], sign[:, None] * axis


def motion_along(
    chain: ElasticChain,
    relative: RelativeMotion,
    q_ref: Float,
    q_command: Float,
    time_s: Float,
    damping_s: float = DAMPING_S,
    step_s: float = STEP_S,
    shaken: Bool | None = None,
    acceleration_m_s2: float = math.inf,
    w_tcp_base: Float | None = None,
) -> MotionArrays:
    """Arrays of :func:`counterflex.plan.elastic_motion_kernel.advance` for a path, at rest at its first row.

    Args:
        chain: The elastic robot with play and drives.
        relative: How the tool moves relative to the part, in the rows of the path.
        q_ref: (rows, 6) rad along the programmed path.
        q_command: (rows, 6) rad that are commanded.
        time_s: (rows,) s.
        damping_s: beta of the damping D = beta K.
        step_s: Length of a step.
        shaken: (rows,) True where a change of the programmed speed shakes the arm; None: nowhere.
        acceleration_m_s2: With which the controller changes that speed, at most, > 0.
        w_tcp_base: (rows, 6) N, N m: expected load, see :func:`stiffness_of`.

    Raises:
        InputError: Shapes do not match.
    """
    rows = len(as_float("time_s", time_s, (None,)))
    nominal = np.ascontiguousarray(as_float("q_ref", q_ref, (rows, 6)))
    command = np.ascontiguousarray(as_float("q_command", q_command, (rows, 6)))
    posture, chosen = postures(nominal, _INERTIA_RAD)
    place, places = postures(nominal, _JACOBIAN_RAD)
    stiffness = stiffness_of(chain, nominal, w_tcp_base)
    n = stiffness.shape[1]
    # The matrices are those of the numbered postures; the springs of the axes follow row by row.
    stiff = stiffness_of(chain, nominal[chosen], None if w_tcp_base is None else w_tcp_base[chosen])
    held = (0.5 * step_s * damping_s + 0.25 * step_s**2) * stiff[:, :, None] * np.eye(n)
    M = inertia(chain, nominal[chosen])
    inverse = as_float("inverse", np.linalg.inv(M + held), M.shape)
    answer: Float = np.ascontiguousarray(np.swapaxes(step_s * inverse, 1, 2))
    keep: Float = np.ascontiguousarray(np.swapaxes(inverse @ (M - held), 1, 2))
    X = relative.rows(places).to_part
    J, J_drive = (np.ascontiguousarray(X @ result) for result in jacobians(chain, nominal[places]))
    weight = play.axis_torque(chain, nominal)
    band, limit, slip = play.arrays(chain)
    gains = _loop_gains(chain)
    return MotionArrays(
        step_s=step_s,
        time_s=np.ascontiguousarray(time_s, dtype=np.float64),
        q_command=command,
        q_ref=nominal,
        shaken=np.zeros(rows, dtype=np.int64) if shaken is None else shaken.astype(np.int64),
        acceleration=acceleration_m_s2,
        weight=weight,
        posture=posture,
        place=place,
        answer=answer,
        keep=keep,
        J_tcp_part=J,
        J_drive_part=J_drive,
        stiffness=stiffness,
        damping=damping_s * np.mean(stiffness, axis=0)[:AXES],
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
        drives=np.zeros((8, AXES)),
        held=np.zeros(limit.shape),
        clock=np.zeros(2),
        program=np.zeros(AXES),
        load=np.zeros(n),
        fresh=np.zeros(n),
        thrust=np.zeros(THRUST_SIZE),
        pushed=np.zeros(n),
    )


def _loop_gains(chain: ElasticChain) -> Float:
    """(5, 6) speed gain, position gain, integral time, friction and slip of each axis; gain 0 never yields."""
    rows = [
        (0.0, 0.0, 1.0, 0.0, 1.0)
        if s is None
        else (s.speed_gain_nm_s, s.position_gain_per_s, s.integral_time_s, s.friction_nm, s.slip_rad)
        for s in chain.servo or (None,) * AXES
    ]
    return np.array(rows).T.copy()


def commanded(motion: MotionArrays, q_command: Float) -> MotionArrays:
    """The same path with other commands, at rest at its first row.

    What depends on the programmed path alone is shared, so another trial of a path costs nothing but itself.

    Args:
        motion: Of :func:`motion_along`; it is left as it is.
        q_command: (rows, 6) rad that are commanded.

    Raises:
        InputError: Shapes do not match.
    """
    state = {name: np.zeros_like(getattr(motion, name)) for name in STATE_ARRAYS}
    return motion._replace(q_command=as_float("q_command", q_command, motion.q_ref.shape), **state)


def postures(q: Float, apart_rad: float) -> tuple[Int, Int]:
    """Rows of a path that stand for those behind them: one pass, each row is compared with the last that stands.

    Args:
        q: (rows, 6) rad.
        apart_rad: Change of an axis after which another row stands.

    Returns:
        (rows,) number of the posture of each row, and the rows that are the postures.
    """
    angles = np.ascontiguousarray(as_float("q", q, (None, None)))
    out = np.zeros(len(angles), dtype=np.int64)
    number_postures(angles, apart_rad, out)
    return out, np.flatnonzero(np.diff(out, prepend=-1))


def _still() -> MotionArrays:
    """A motion without coordinates: the tool is bent by something else."""
    none, six, rows = np.zeros(0), np.zeros(AXES), np.zeros((0, AXES))
    no_index = np.zeros(0, dtype=np.int64)
    return MotionArrays(
        step_s=STEP_S,
        time_s=none,
        q_command=rows,
        q_ref=rows,
        shaken=no_index,
        acceleration=0.0,
        weight=rows,
        posture=no_index,
        place=no_index,
        answer=np.zeros((0, 0, 0)),
        keep=np.zeros((0, 0, 0)),
        J_tcp_part=np.zeros((0, 6, 0)),
        J_drive_part=np.zeros((0, 6, AXES)),
        stiffness=np.zeros((0, 0)),
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
        drives=np.zeros((8, AXES)),
        held=np.zeros((AXES, 0)),
        clock=np.zeros(2),
        program=six,
        load=none,
        fresh=none,
        thrust=np.zeros(THRUST_SIZE),
        pushed=none,
    )


STILL: Final = _still()
"""Stands for no motion where a kernel asks for one."""
