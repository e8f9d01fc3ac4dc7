"""The elastic chain: robot and end effector packed into arrays, with rigid kinematics.

All positions are in m, angles in rad, poses 4x4. ``q`` are the six angles of the model;
:mod:`counterflex.robot.model.controller_axes` maps them to what the controller shows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, reduce

import numpy as np

from counterflex.core.arrays import Float, as_float, frozen
from counterflex.core.errors import InputError, ModelError
from counterflex.core.units import STANDARD_GRAVITY
from counterflex.robot.elasticity import chain_checks
from counterflex.robot.elasticity.compact import Segments, compact, frozen_int
from counterflex.robot.elasticity.kernels import batch
from counterflex.robot.elasticity.kernels.records import Compact
from counterflex.robot.model.description import EndEffector, Robot
from counterflex.robot.model.elastic_region import check_curves, check_regions, growth


@dataclass(frozen=True, eq=False)
class ElasticChain(Segments):
    """Robot and end effector as one serial chain. Build it with :meth:`build`, which checks everything."""

    @cached_property
    def compact(self) -> Compact:
        """The chain as the kernels read it, rigid segments merged; made once."""
        return compact(self)

    def compliance_at(self, q: Float) -> Float:
        """Compliances in some postures, regions included.

        Args:
            q: (..., 6) rad.

        Returns:
            (..., n, 6) m/N, rad/(N m); not to be written to.
        """
        if not self.regions:
            return np.broadcast_to(self.compliance, (*np.shape(q)[:-1], *self.compliance.shape))
        out: Float = self.compliance * growth(self.regions, self.names, q)
        return out

    @classmethod
    def build(
        cls,
        robot: Robot,
        end_effector: EndEffector | None = None,
        gravity_base: tuple[float, float, float] | Float = (0.0, 0.0, -STANDARD_GRAVITY),
    ) -> ElasticChain:
        """Pack a robot and its end effector, after checking them.

        Args:
            end_effector: What hangs on the flange; None makes the flange the TCP.
            gravity_base: (3,) m/s2, the field in base axes; the default is a robot standing on the floor.

        Raises:
            ModelError: A joint 0..5 is missing, doubled or out of order; a pose is no rigid motion; a compliance or
                mass is negative, not finite or far outside what robots are made of (mostly a unit mistake).
        """
        tool = end_effector if end_effector is not None else EndEffector((), np.eye(4))
        segments = (*robot.segments, *tool.segments)
        T_segment_flange = chain_checks.rigid_motion(robot.T_last_flange, f"{robot.name}: T_last_flange")
        T_last_tcp = chain_checks.rigid_motion(tool.T_last_tcp, "end effector: T_last_tcp")
        n, n_robot = len(segments), len(robot.segments)
        fixed = _fixed(robot, tool)
        T_flange_tcp = reduce(np.matmul, (*fixed[n_robot:], T_last_tcp), np.eye(4))
        # The first body of the end effector is given in the flange, which lies behind the last segment of the robot.
        if n > n_robot:
            fixed[n_robot] = T_segment_flange @ fixed[n_robot]
        else:
            T_last_tcp = T_segment_flange @ T_last_tcp
        driven = [s.joint for s in segments if s.joint is not None]
        if driven != list(range(chain_checks.JOINTS)):
            raise ModelError(
                "every driven axis must appear once, from the base outward",
                where=robot.name,
                value=driven,
                limit=list(range(chain_checks.JOINTS)),
            )
        compliance = np.array([s.compliance for s in segments], dtype=np.float64).reshape(n, 6)
        names = tuple(s.name for s in segments)
        _check_options(robot, names, compliance)
        return cls(
            name=robot.name,
            names=names,
            fixed=frozen(fixed),
            joint=frozen_int([-1 if s.joint is None else s.joint for s in segments]),
            sign=frozen(np.array([s.sign for s in segments], dtype=np.float64)),
            offset=frozen(np.array([s.offset_rad for s in segments], dtype=np.float64)),
            compliance=frozen(compliance),
            mass=frozen(np.array([s.mass_kg for s in segments], dtype=np.float64)),
            com=frozen(np.array([s.p_seg_com for s in segments], dtype=np.float64).reshape(n, 3)),
            T_last_tcp=frozen(T_last_tcp),
            flange_segment=n_robot - 1,
            T_segment_flange=frozen(T_segment_flange),
            T_flange_tcp=frozen(T_flange_tcp),
            joint_limits_rad=frozen(chain_checks.joint_limits(robot)),
            joint_speeds_rad_s=None if robot.joint_speeds_rad_s is None else frozen(chain_checks.joint_speeds(robot)),
            opw=robot.opw,
            counterbalance=robot.counterbalance,
            gravity=frozen(chain_checks.gravity_field(gravity_base)),
            play=robot.play,
            servo=robot.servo,
            regions=robot.regions,
            curves=robot.curves,
            axes=robot.axes,
        )


def joint_angles(q: Float) -> Float:
    """Return ``q`` as a checked (..., 6) float64 array. Raises InputError: wrong shape or not finite."""
    return _six("q", q)


def points(q: Float, w_tcp_base: Float | None) -> tuple[Float, Float, tuple[int, ...]]:
    """Broadcast angles and wrenches against each other and flatten them for the kernels.

    Args:
        q: (..., 6) rad.
        w_tcp_base: (..., 6) N, N m; None is no load.

    Returns:
        q (n, 6), w (n, 6), and the common leading shape.

    Raises:
        InputError: Wrong shape or not finite.
    """
    q = joint_angles(q)
    w = np.zeros(chain_checks.JOINTS) if w_tcp_base is None else _six("w_tcp_base", w_tcp_base)
    try:
        lead = np.broadcast_shapes(q.shape[:-1], w.shape[:-1])
    except ValueError as fault:
        raise InputError("angles and wrenches do not match", value=(q.shape, w.shape)) from fault
    return _rows(q, lead), _rows(w, lead), lead


def _six(name: str, value: Float) -> Float:
    array = as_float(name, value)
    if array.ndim < 1 or array.shape[-1] != chain_checks.JOINTS or np.ndim(value) < 1:
        raise InputError(f"{name} has the wrong shape", value=np.shape(value), limit="(..., 6)")
    return array


def _rows(array: Float, lead: tuple[int, ...]) -> Float:
    """(n, 6), C-ordered and writable, as the kernels want it."""
    # A broadcast view has strides of 0 and is read-only: compiled kernels with stated types take neither.
    rows: Float = np.require(
        np.broadcast_to(array, (*lead, chain_checks.JOINTS)).reshape(-1, chain_checks.JOINTS), requirements=["C", "W"]
    )
    return rows


def frames(chain: ElasticChain, q: Float) -> Float:
    """Rigid poses of all segment frames, after their drives.

    Args:
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
        q: (..., 6) rad controller angles.

    Returns:
        (..., 4, 4) T_base_tcp.
    """
    return _poses(chain, q, None, batch.RIGID, gravity=False)


def flange(chain: ElasticChain, q: Float) -> Float:
    """Rigid pose of the flange. ``q`` (..., 6) rad -> (..., 4, 4) T_base_flange."""
    out: Float = frames(chain, q)[..., chain.flange_segment, :, :] @ chain.T_segment_flange
    return out


def jacobian(chain: ElasticChain, q: Float) -> Float:
    """Geometric Jacobian of the rigid chain at the TCP.

    Column j is ``[z x (p_base_tcp - p_base_joint), z]`` with z the positive direction of axis j, so that
    ``[v, omega] = J dq/dt`` in base axes with q the controller angles.

    Args:
        q: (..., 6) rad controller angles.

    Returns:
        (..., 6, 6): rows m/rad (linear), then rad/rad.
    """
    rows, _, lead = points(q, None)
    out = np.empty((len(rows), chain_checks.JOINTS * chain_checks.JOINTS))
    batch.jacobian_range(chain.compact, rows, out, 0, len(rows))
    return out.reshape(*lead, chain_checks.JOINTS, chain_checks.JOINTS)


def forward_elastic(
    chain: ElasticChain,
    q: Float,
    w_tcp_base: Float | None = None,
    *,
    gravity: bool = False,
    equilibrium: bool = False,
) -> Float:
    """Pose of the TCP with every elastic element displaced by compliance times load, composed as finite z-y'-x''.

    Args:
        q: (..., 6) rad controller angles.
        w_tcp_base: (..., 6) N, N m, about the TCP in base axes; None is no load.
        gravity: Add own weight and payload, relieved by the counterbalance.
        equilibrium: Take the loads on the deflected geometry instead of the rigid one; see
            :func:`counterflex.robot.elasticity.compliance.deflection`.

    Returns:
        (..., 4, 4) T_base_tcp.

    Raises:
        ModelError: With ``equilibrium``, a point without a stable equilibrium nearby.

    Source: Haehn2020 eq. 2-9.
    """
    return _poses(chain, q, w_tcp_base, batch.SETTLED if equilibrium else batch.ON_RIGID, gravity=gravity)


def _poses(chain: ElasticChain, q: Float, w: Float | None, how: int, *, gravity: bool) -> Float:
    q, w, lead = points(q, w)
    out = np.empty((len(q), 4, 4))
    if len(q) <= batch.CHUNK:
        failed = batch.pose_range(chain.compact, q, w, how, int(gravity), out, 0, len(q))
    else:
        failed = batch.pose_threads(chain.compact, q, w, how, int(gravity), out)
    require_settled(failed)
    return out.reshape(*lead, 4, 4)


def require_settled(failed: int) -> None:
    """Raise a ModelError where an equilibrium was not found for ``failed`` points."""
    if failed:
        raise ModelError(
            f"no elastic equilibrium found at {failed} point(s): the load is far beyond what the chain can carry",
            hint="Check the units of load and compliance",
        )


def _fixed(robot: Robot, tool: EndEffector) -> Float:
    """(n, 4, 4) fixed poses of all segments."""
    for segment in tool.segments:
        if segment.joint is not None:
            raise ModelError("a segment of the end effector cannot be driven", where=segment.name)
    segments = (*robot.segments, *tool.segments)
    poses = [chain_checks.fixed_pose(s, f"{robot.name}: segment {s.name!r}") for s in segments]
    return np.array(poses).reshape(-1, 4, 4)


def _check_options(robot: Robot, names: Sequence[str], compliance: Float) -> None:
    """Check what a robot may have beside its segments."""
    if robot.counterbalance is not None:
        chain_checks.check_counterbalance(robot.counterbalance, robot.name)
    if robot.play is not None:
        chain_checks.check_play(robot.play, robot.name)
    if robot.servo is not None:
        chain_checks.check_servo(robot.servo, robot.name)
    check_regions(robot.regions, names, compliance)
    check_curves(robot.curves, names, compliance)


def rigid_axes(chain: ElasticChain) -> tuple[int, ...]:
    """Axes that nothing turns elastically.

    An axis counts as elastic when its own segment, or one between it and the next drive (the flange for axis 6), has
    a compliance about any of its three directions: an element may sit in a frame of its own behind the drive.

    Args:
        chain: The robot with its end effector.

    Returns:
        Numbers 0..5, rising.
    """
    drives = np.flatnonzero(np.asarray(chain.joint) >= 0)
    ends = np.append(drives[1:], chain.flange_segment + 1)
    turns = np.any(chain.compliance[:, 3:] != 0.0, axis=1)
    return tuple(
        int(chain.joint[begin])
        for begin, end in zip(drives.tolist(), ends.tolist(), strict=True)
        if not turns[begin:end].any()
    )


def axis_deflections(chain: ElasticChain, q: Float, w_tcp_base: Float, axes: tuple[int, ...]) -> Float:
    """Displacement of the TCP for each axis, times the stiffness of that axis: ``J_i (J_i^T w)``.

    With springs ``k_i`` about the axes the TCP yields by ``sum_i J_i (J_i^T w) / k_i`` (linear, on the rigid geometry).

    ``q``: (n, 6) rad; ``w_tcp_base``: (n, 6) N, N m; ``axes``: numbers 0..5.

    Returns:
        (n, axes, 3) N m2/rad, base axes: divided by k in N m/rad, m.
    """
    J = jacobian(chain, q)[..., list(axes)]
    torque = np.einsum("...ia,...i->...a", J, w_tcp_base)
    out: Float = np.swapaxes(J[..., :3, :] * torque[..., None, :], -1, -2)
    return out
