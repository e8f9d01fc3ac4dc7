"""Every posture at every point: the grid of rotations and branches, tried by compiled kernels in threads."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.errors import ModelError
from counterflex.core.jit import thread_count
from counterflex.core.progress import Progress, silent
from counterflex.geometry import pose, rotation
from counterflex.path.toolpath import tool_orientation
from counterflex.plan.inputs import CorrectionLimits
from counterflex.plan.posture.branches_kernel import SLOTS, arm_record
from counterflex.plan.posture.cut_path import LoadedPath, fractions
from counterflex.plan.posture.survey_kernel import CODES, POWER, CandidateGrid, Points, Survey, survey_edges
from counterflex.plan.relative_motion import RelativeMotion, part_carried, tool_carried
from counterflex.robot.elasticity.chain import ElasticChain, forward
from counterflex.robot.model.controller_axes import room

_PARTS = 32
"""Pieces of the path that are shared among the threads, and after which progress is told."""


@dataclass(frozen=True, eq=False)
class RobotHere:
    """A robot with its tool, and the part in its cell."""

    chain: ElasticChain  # elastic chain as it is known to be
    controller_chain: ElasticChain  # geometry as the controller has it; its angles are what is commanded
    T_base_part: Float  # (4, 4) pose of the part; says nothing where the robot carries it
    limits: CorrectionLimits  # margins to joint limits and wrist singularity
    joint_speeds_rad_s: Float | None = None  # (6,) largest speeds, or None where they are not known
    joint_accelerations_rad_s2: Float | None = None  # (6,) of the drives, or None where they are not known
    acceleration_m_s2: float = 1.0  # with which the controller changes the speed of the tool
    # by axis 0..5 the largest angle from 0 that its cables allow, where known
    cables_rad: Mapping[int, float] = field(default_factory=dict)
    # (4, 4) tool frame of a spindle that stands, against which the robot holds the part; None: it holds the tool
    T_base_tcp: Float | None = None

    @property
    def T_base_standing(self) -> Float:
        """(4, 4) pose of what stands in the cell: the part, or the spindle against which the robot holds the part."""
        return self.T_base_part if self.T_base_tcp is None else self.T_base_tcp

    def facing(self, T_base_standing: Float) -> RobotHere:
        """The robot with what stands in its cell elsewhere: the part, or the spindle where it holds the part."""
        if self.T_base_tcp is None:
            return replace(self, T_base_part=T_base_standing)
        return replace(self, T_base_tcp=T_base_standing)

    def relative_motion(self, q: Float) -> RelativeMotion:
        """Motion of the tool relative to the part by that of the hand, in postures q (n, 6) rad."""
        if self.T_base_tcp is None:
            return tool_carried(self.T_base_part)
        Ts_base_part = forward(self.controller_chain, q)
        return part_carried(self.T_base_tcp, pose.inverse(Ts_base_part) @ self.T_base_tcp)

    @property
    def joint_limits_rad(self) -> Float:
        """(6, 2) rad, margins taken off and cables regarded."""
        out: Float = self.controller_chain.joint_limits_rad + self.limits.joint_margin_rad * np.array([1.0, -1.0])
        for axis, angle in self.cables_rad.items():
            out[axis] = np.clip(out[axis], -angle, angle)
        return np.ascontiguousarray(out)

    def room(self, q: Float) -> Float:
        """(..., 6) rad, distance of each axis from its limits, margins taken off; negative outside. ``q`` (..., 6)."""
        axes = self.controller_chain.axes
        own: Float = room(axes, self.joint_limits_rad, q)
        if not axes.coupled:
            return own
        return np.minimum(own, room(axes, self.controller_chain.joint_limits_rad, q) - self.limits.joint_margin_rad)

    def grid(self, rotations_rad: Float) -> CandidateGrid:
        """Grid of candidates for the kernels. Raises ModelError: the robot has no closed-form geometry."""
        chain = self.controller_chain
        if chain.opw is None:
            raise ModelError(
                "a posture is chosen among closed-form solutions, which this robot does not have",
                where=chain.name,
                limit="a spherical wrist, axes 2 and 3 parallel",
                hint="Give the robot by catalogue name or by its lengths ([robot.geometry])",
            )
        return CandidateGrid(
            arm_record(chain.opw),
            np.cos(rotations_rad),
            np.sin(rotations_rad),
            self.joint_limits_rad,
            float(np.sin(self.limits.wrist_rad)),
        )


def base_points(path: LoadedPath, T_base_part: Float, rows: Int) -> Points:
    """The path in base axes, as the kernels read it.

    Args:
        path: In the part frame.
        T_base_part: (4, 4) pose of the part.
        rows: (m + 1,) stations.
    """
    R = T_base_part[:3, :3]
    upright = tool_orientation(path.axis_part, 0.0)
    w = (path.w_tcp_part.reshape(-1, 2, 3) @ R.T).reshape(-1, 6)
    return Points(
        np.ascontiguousarray(pose.transform(T_base_part, path.p_part)),
        np.ascontiguousarray(upright[:, :, 0] @ R.T),
        np.ascontiguousarray(upright[:, :, 2] @ R.T),
        np.ascontiguousarray(w),
        np.ascontiguousarray(path.normals_part @ R.T),
        np.ascontiguousarray(path.weight_m),
        np.ascontiguousarray(fractions(path.time_s, rows)),
        np.eye(4)[None],
        0,
    )


def hand_points(path: LoadedPath, robot: RobotHere, rows: Int) -> Points:
    """The path in base axes at rotation 0, with the flange of a robot that carries the tool or the part.

    Where it carries the part, the load is that on the hand: the opposite of that on the tool.
    """
    T_flange_hand = robot.controller_chain.T_flange_tcp
    if robot.T_base_tcp is None:
        return base_points(path, robot.T_base_part, rows)._replace(
            T_tcp_flange=np.ascontiguousarray(pose.inverse(T_flange_hand)[None])
        )
    T_base_tcp, n = robot.T_base_tcp, len(path)
    upright = pose.make(tool_orientation(path.axis_part, 0.0), path.p_part)
    Rs_base_part = T_base_tcp[:3, :3] @ np.swapaxes(upright[:, :3, :3], 1, 2)
    w = np.einsum("nij,nhj->nhi", Rs_base_part, path.w_tcp_part.reshape(-1, 2, 3)).reshape(-1, 6)
    return Points(
        np.ascontiguousarray(np.tile(T_base_tcp[:3, 3], (n, 1))),
        np.ascontiguousarray(np.tile(T_base_tcp[:3, 0], (n, 1))),
        np.ascontiguousarray(np.tile(T_base_tcp[:3, 2], (n, 1))),
        np.ascontiguousarray(-w),
        np.ascontiguousarray(np.einsum("nij,nkj->nki", Rs_base_part, path.normals_part)),
        np.ascontiguousarray(path.weight_m),
        np.ascontiguousarray(fractions(path.time_s, rows)),
        np.ascontiguousarray(pose.inverse(T_flange_hand @ upright)),
        1,
    )


def load_by_rotation(points: Points, rows: Int, rotations_rad: Float) -> tuple[Float, Float]:
    """Load and directions at rows of a path by the rotation about the tool axis.

    Returns:
        (m, r, 6) and (m, r, k, 3) base axes; r = 1 where the robot carries the tool, which then says nothing.
    """
    w, normals = points.w[rows][:, None], points.normals[rows][:, None]
    if points.part_carried == 0:
        return np.ascontiguousarray(w), np.ascontiguousarray(normals)
    turns = rotation.exp(rotations_rad[:, None] * points.z[0])  # the part turns the other way: about z, not -z
    both = np.einsum("rij,mhj->mrhi", turns, w.reshape(len(rows), 2, 3)).reshape(len(rows), len(turns), 6)
    out = np.einsum("rij,mkj->mrki", turns, normals[:, 0])
    return np.ascontiguousarray(both), np.ascontiguousarray(out)


def survey_path(
    path: LoadedPath, robot: RobotHere, rotations_rad: Float, rows: Int, progress: Progress = silent
) -> Survey:
    """Try every rotation and branch at every point of a path.

    A plain function of the path in its part frame with forces and normals, of where the part is, and of the robot with
    its end effector: another pose of the part or another mounting of the spindle is another ``robot``.

    ``rotations_rad``: (r,) rad, rotations about the tool axis that are tried; ``rows``: (m + 1,) stations,
    :func:`counterflex.plan.posture.cut_path.stations`.

    Raises:
        ModelError: The robot has no closed-form geometry.
    """
    grid, points = robot.grid(rotations_rad), hand_points(path, robot, rows)
    m, r, n = len(rows) - 1, len(rotations_rad), len(path)
    survey = Survey(
        np.zeros((m, r, SLOTS)),
        np.zeros((m, r, SLOTS)),
        np.full((m + 1, r, SLOTS, 6), np.nan),
        np.full(n, np.inf),
        np.zeros((n, CODES), dtype=np.int64),
    )
    share = np.linspace(0, n, min(m, _PARTS) + 1)
    parts = np.unique(np.clip(np.searchsorted(rows, share), 0, m))

    work = partial(survey_edges, robot.chain.compact, grid, points, rows, survey)
    with ThreadPoolExecutor(thread_count()) as threads:
        for done, _ in enumerate(threads.map(work, parts[:-1].tolist(), parts[1:].tolist()), start=1):
            progress(done / (len(parts) - 1))
    if robot.controller_chain.axes.coupled:
        survey.q[np.any(robot.room(survey.q) < 0.0, axis=-1)] = np.nan
    return survey


def constant_costs(survey: Survey) -> Float:
    """Cost of a posture that stays as it is all along, deflection alone.

    Returns:
        (r, 8) m: ``(sum weight size^POWER / sum weight)^(1/POWER)`` but for the division by the weights, which a caller
        knows; infinite where a point of the path cannot be reached so. Unit m^((POWER + 1) / POWER).
    """
    out: Float = np.sum(survey.early + survey.late, axis=0) ** (1.0 / POWER)
    return out
