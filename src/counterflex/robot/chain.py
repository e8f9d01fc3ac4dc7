"""The elastic chain: robot and end effector packed into arrays, with rigid kinematics.

All positions are in m, angles in rad, poses 4x4. ``q`` are the six angles the robot controller shows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Float, Int, as_float, frozen
from counterflex.core.errors import ModelError
from counterflex.core.units import STANDARD_GRAVITY
from counterflex.robot.description import Counterbalance, EndEffector, Opw, Robot, Segment

JOINTS = 6
_ROTATION_TOLERANCE = 1e-8  # largest deviation of R R^T from identity
_REACH_LIMIT = 20.0  # m; a longer link is a unit mistake
_MASS_LIMIT = 2e4  # kg
_SOFTEST_TRANSLATION = 1e-4  # m/N, a stiffness of 1e4 N/m
_SOFTEST_ROTATION = 1e-2  # rad/(N m), a stiffness of 100 N m/rad
_GRAVITY_LIMIT = 100.0  # m/s2


@dataclass(frozen=True, eq=False)
class ElasticChain:
    """Robot and end effector as one serial chain of n segments, packed for computing.

    ``T_base_tcp = prod_i (fixed_i Rz(sign_i q_joint_i + offset_i) E_i) T_last_tcp`` with the elastic displacement ``E``
    of :mod:`counterflex.robot.description`. Build it with :meth:`build`, which checks everything.

    Attributes:
        name: Name of the robot.
        names: n names of the segments.
        fixed: (n, 4, 4) pose of each segment's frame before its drive in the previous segment.
        joint: (n,) driven axis 0..5, or -1.
        sign: (n,) +1 or -1.
        offset: (n,) rad.
        compliance: (n, 6) ``tx ty tz rx ry rz`` in m/N and rad/(N m), in the segment's frame; 0 is rigid.
        mass: (n,) kg.
        com: (n, 3) m, centre of gravity of each body in its segment's frame.
        T_last_tcp: (4, 4) tool centre point in the last segment.
        flange_segment: Index of the segment that carries the flange (-1: the base).
        T_segment_flange: (4, 4) flange in that segment.
        T_flange_tcp: (4, 4) rigid pose of the TCP in the flange.
        joint_limits_rad: (6, 2) lower, upper.
        joint_speeds_rad_s: (6,) or None.
        opw: Closed-form geometry or None.
        counterbalance: Or None.
        gravity: (3,) m/s2 in base axes.
    """

    name: str
    names: tuple[str, ...]
    fixed: Float
    joint: Int
    sign: Float
    offset: Float
    compliance: Float
    mass: Float
    com: Float
    T_last_tcp: Float
    flange_segment: int
    T_segment_flange: Float
    T_flange_tcp: Float
    joint_limits_rad: Float
    joint_speeds_rad_s: Float | None
    opw: Opw | None
    counterbalance: Counterbalance | None
    gravity: Float

    @property
    def n(self) -> int:
        """Number of segments."""
        return len(self.names)

    @classmethod
    def build(
        cls,
        robot: Robot,
        end_effector: EndEffector | None = None,
        gravity_base: tuple[float, float, float] | Float = (0.0, 0.0, -STANDARD_GRAVITY),
    ) -> ElasticChain:
        """Pack a robot and its end effector, after checking them.

        Args:
            robot: The robot.
            end_effector: What hangs on the flange; None makes the flange the TCP.
            gravity_base: (3,) m/s2, the field in base axes; the default is a robot standing on the floor.

        Raises:
            ModelError: A joint 0..5 is missing, doubled or out of order; a pose is no rigid motion; a compliance or
                mass is negative, not finite or far outside what robots are made of (mostly a unit mistake).
        """
        tool = end_effector if end_effector is not None else EndEffector((), np.eye(4))
        segments = (*robot.segments, *tool.segments)
        T_segment_flange = _rigid(robot.T_last_flange, f"{robot.name}: T_last_flange")
        T_last_tcp = _rigid(tool.T_last_tcp, "end effector: T_last_tcp")
        n, n_robot = len(segments), len(robot.segments)
        fixed = np.empty((n, 4, 4))
        T_flange_tcp = np.eye(4)
        for i, segment in enumerate(segments):
            fixed[i] = _segment(segment, f"{robot.name}: segment {segment.name!r}")
            if i >= n_robot:
                if segment.joint is not None:
                    raise ModelError("a segment of the end effector cannot be driven", where=segment.name)
                T_flange_tcp = T_flange_tcp @ fixed[i]
        T_flange_tcp = T_flange_tcp @ T_last_tcp
        if n > n_robot:
            fixed[n_robot] = T_segment_flange @ fixed[n_robot]
        else:
            T_last_tcp = T_segment_flange @ T_last_tcp
        driven = [s.joint for s in segments if s.joint is not None]
        if driven != list(range(JOINTS)):
            raise ModelError(
                "every driven axis must appear once, from the base outward",
                where=robot.name,
                value=driven,
                limit=list(range(JOINTS)),
            )
        balance = robot.counterbalance
        if balance is not None:
            _check_counterbalance(balance, robot.name)
        return cls(
            name=robot.name,
            names=tuple(s.name for s in segments),
            fixed=frozen(fixed),
            joint=_frozen_int([-1 if s.joint is None else s.joint for s in segments]),
            sign=frozen(np.array([s.sign for s in segments], dtype=np.float64)),
            offset=frozen(np.array([s.offset_rad for s in segments], dtype=np.float64)),
            compliance=frozen(np.array([s.compliance for s in segments], dtype=np.float64).reshape(n, 6)),
            mass=frozen(np.array([s.mass_kg for s in segments], dtype=np.float64)),
            com=frozen(np.array([s.p_seg_com for s in segments], dtype=np.float64).reshape(n, 3)),
            T_last_tcp=frozen(T_last_tcp),
            flange_segment=n_robot - 1,
            T_segment_flange=frozen(T_segment_flange),
            T_flange_tcp=frozen(T_flange_tcp),
            joint_limits_rad=frozen(_limits(robot)),
            joint_speeds_rad_s=None if robot.joint_speeds_rad_s is None else frozen(_speeds(robot)),
            opw=robot.opw,
            counterbalance=balance,
            gravity=frozen(_gravity(gravity_base)),
        )


def joint_angles(q: Float) -> Float:
    """Return ``q`` as a checked (..., 6) float64 array.

    Raises:
        InputError: Wrong shape or not finite.
    """
    array = as_float("q", q)
    if array.ndim < 1 or array.shape[-1] != JOINTS:
        array = as_float("q", q, (None, JOINTS))  # raises with the expected shape
    return array


def frames(chain: ElasticChain, q: Float) -> Float:
    """Rigid poses of all segment frames, after their drives.

    Args:
        chain: The chain.
        q: (..., 6) rad controller angles.

    Returns:
        (..., n, 4, 4) T_base_segment.
    """
    q = joint_angles(q)
    local = np.broadcast_to(chain.fixed, (*q.shape[:-1], chain.n, 4, 4)).copy()
    driven = np.flatnonzero(chain.joint >= 0)
    theta = chain.sign[driven] * q[..., chain.joint[driven]] + chain.offset[driven]
    c, s = np.cos(theta)[..., None], np.sin(theta)[..., None]
    turned = local[..., driven, :, :]
    x, y = turned[..., 0].copy(), turned[..., 1].copy()
    turned[..., 0] = c * x + s * y
    turned[..., 1] = c * y - s * x
    local[..., driven, :, :] = turned
    for i in range(1, chain.n):
        local[..., i, :, :] = local[..., i - 1, :, :] @ local[..., i, :, :]
    return local


def forward(chain: ElasticChain, q: Float) -> Float:
    """Rigid pose of the TCP, without load and weight.

    Args:
        chain: The chain.
        q: (..., 6) rad controller angles.

    Returns:
        (..., 4, 4) T_base_tcp.
    """
    out: Float = frames(chain, q)[..., -1, :, :] @ chain.T_last_tcp
    return out


def flange(chain: ElasticChain, q: Float) -> Float:
    """Rigid pose of the flange. ``q`` (..., 6) rad -> (..., 4, 4) T_base_flange."""
    out: Float = frames(chain, q)[..., chain.flange_segment, :, :] @ chain.T_segment_flange
    return out


def jacobian(chain: ElasticChain, q: Float) -> Float:
    """Geometric Jacobian of the rigid chain at the TCP.

    Column j is ``[z x (p_base_tcp - p_base_joint), z]`` with z the positive direction of axis j, so that
    ``[v, omega] = J dq/dt`` in base axes with q the controller angles.

    Args:
        chain: The chain.
        q: (..., 6) rad controller angles.

    Returns:
        (..., 6, 6): rows m/rad (linear), then rad/rad.
    """
    Ts = frames(chain, q)
    tip = (Ts[..., -1, :, :] @ chain.T_last_tcp)[..., :3, 3]
    driven = np.flatnonzero(chain.joint >= 0)
    axis = chain.sign[driven, None] * Ts[..., driven, :3, 2]
    lever = tip[..., None, :] - Ts[..., driven, :3, 3]
    columns = np.concatenate([np.cross(axis, lever), axis], axis=-1)
    out: Float = np.ascontiguousarray(np.swapaxes(columns, -1, -2))
    return out


def forward_elastic(chain: ElasticChain, q: Float, w_tcp_base: Float | None = None, *, gravity: bool = False) -> Float:
    """Pose of the TCP with every elastic element displaced by the load.

    Args:
        chain: The chain.
        q: (..., 6) rad controller angles.
        w_tcp_base: (..., 6) N, N m, about the TCP in base axes; None is no load.
        gravity: Add own weight and payload.

    Returns:
        (..., 4, 4) T_base_tcp.
    """
    from counterflex.robot.compliance import elastic_pose

    return elastic_pose(chain, q, w_tcp_base, gravity=gravity)


def _frozen_int(values: list[int]) -> Int:
    array = np.array(values, dtype=np.int64)
    array.flags.writeable = False
    return array


def _finite(value: object, shape: tuple[int, ...], where: str) -> Float:
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as fault:
        raise ModelError("not an array of numbers", where=where, value=repr(value)[:80]) from fault
    if array.shape != shape:
        raise ModelError("wrong shape", where=where, value=array.shape, limit=shape)
    if not np.all(np.isfinite(array)):
        raise ModelError("a number is not finite", where=where, value=array.tolist())
    return array


def _rigid(value: object, where: str) -> Float:
    T = _finite(value, (4, 4), where)
    R = T[:3, :3]
    if np.max(np.abs(R @ R.T - np.eye(3))) > _ROTATION_TOLERANCE or np.linalg.det(R) < 0.0:
        raise ModelError("the pose does not hold a proper rotation", where=where, value=np.round(R, 6).tolist())
    if np.any(T[3] != (0.0, 0.0, 0.0, 1.0)):
        raise ModelError("the last row of a pose must be 0 0 0 1", where=where, value=T[3].tolist())
    if np.max(np.abs(T[:3, 3])) > _REACH_LIMIT:
        raise ModelError(
            "a link is implausibly long", where=where, value=T[:3, 3].tolist(), limit=f"{_REACH_LIMIT:g} m",
            hint="Lengths inside are in m",
        )  # fmt: skip
    return T


def _segment(segment: Segment, where: str) -> Float:
    """Check one segment and return its fixed pose."""
    if segment.joint is not None and segment.joint not in range(JOINTS):
        raise ModelError("no such driven axis", where=where, value=segment.joint, limit="0..5 or None")
    if segment.sign not in (1.0, -1.0):
        raise ModelError("the sign of a drive must be +1 or -1", where=where, value=segment.sign)
    _finite(segment.offset_rad, (), f"{where} offset_rad")
    compliance = _finite(segment.compliance, (6,), f"{where} compliance")
    if np.any(compliance < 0.0):
        raise ModelError("a compliance is negative", where=where, value=compliance.tolist(), limit=">= 0")
    for part, limit, unit in (
        (compliance[:3], _SOFTEST_TRANSLATION, "m/N"),
        (compliance[3:], _SOFTEST_ROTATION, "rad/(N m)"),
    ):
        if np.any(part > limit):
            raise ModelError(
                "a compliance is implausibly large", where=where, value=float(part.max()), limit=f"<= {limit:g} {unit}",
                hint="Check the unit of the stiffness (N m/rad, N/m)",
            )  # fmt: skip
    mass = float(_finite(segment.mass_kg, (), f"{where} mass_kg"))
    if not 0.0 <= mass <= _MASS_LIMIT:
        raise ModelError("a mass is out of range", where=where, value=mass, limit=f"0..{_MASS_LIMIT:g} kg")
    com = _finite(segment.p_seg_com, (3,), f"{where} p_seg_com")
    if np.max(np.abs(com)) > _REACH_LIMIT:
        raise ModelError(
            "a centre of gravity is implausibly far out", where=where, value=com.tolist(), limit=f"{_REACH_LIMIT:g} m",
            hint="Lengths inside are in m",
        )  # fmt: skip
    return _rigid(segment.T_prev_seg, f"{where} T_prev_seg")


def _limits(robot: Robot) -> Float:
    limits = _finite(robot.joint_limits_rad, (JOINTS, 2), f"{robot.name}: joint_limits_rad")
    if np.any(limits[:, 0] >= limits[:, 1]):
        raise ModelError("a lower joint limit is not below the upper one", where=robot.name, value=limits.tolist())
    if np.max(np.abs(limits)) > 1000.0:
        raise ModelError("joint limits are implausibly large", where=robot.name, hint="Angles inside are in rad")
    return limits


def _speeds(robot: Robot) -> Float:
    speeds = _finite(robot.joint_speeds_rad_s, (JOINTS,), f"{robot.name}: joint_speeds_rad_s")
    if np.any(speeds <= 0.0):
        raise ModelError("a joint speed limit is not positive", where=robot.name, value=speeds.tolist())
    return speeds


def _gravity(value: object) -> Float:
    gravity = _finite(value, (3,), "gravity_base")
    if np.linalg.norm(gravity) > _GRAVITY_LIMIT:
        raise ModelError(
            "gravity is implausibly strong", value=gravity.tolist(), limit=f"{_GRAVITY_LIMIT:g} m/s2",
            hint="It is given in m/s2",
        )  # fmt: skip
    return gravity


def _check_counterbalance(balance: Counterbalance, where: str) -> None:
    if balance.joint not in range(JOINTS):
        raise ModelError("the counterbalance acts on no driven axis", where=where, value=balance.joint, limit="0..5")
    numbers = (
        balance.anchor_column_m, balance.anchor_arm_m, balance.piston_area_m2,
        balance.gas_constant_j, balance.gas_volume_max_m3,
    )  # fmt: skip
    if not all(np.isfinite(v) and v > 0.0 for v in numbers) or not np.isfinite(balance.q_min_force_rad):
        raise ModelError("a number of the counterbalance is not positive and finite", where=where, value=numbers)
    stroke = 2.0 * min(balance.anchor_arm_m, balance.anchor_column_m)
    if stroke * balance.piston_area_m2 >= balance.gas_volume_max_m3:
        raise ModelError(
            "the stroke of the counterbalance is larger than its gas volume", where=where,
            value=stroke * balance.piston_area_m2, limit=f"< {balance.gas_volume_max_m3:g} m3",
        )  # fmt: skip
