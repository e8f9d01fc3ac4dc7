"""Deviation of the tool while a program runs: the cut, and where the tool is beside the programmed path."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Bool, Float
from counterflex.core.progress import Progress
from counterflex.cutting.stock import HeightMap
from counterflex.path.toolpath import FEED, ToolPath
from counterflex.plan.cut import Cut, at_points, cut
from counterflex.plan.elastic_motion import commanded, motion_along
from counterflex.plan.elastic_motion_kernel import AXES, MotionArrays
from counterflex.plan.inputs import Setting
from counterflex.plan.lowest_mode import can_move, damping_of
from counterflex.plan.relative_motion import RelativeMotion
from counterflex.plan.sag_and_play import in_touched_frame, play_deviation
from counterflex.signals.preview import Mode


@dataclass(frozen=True, eq=False)
class PlannedRobot:
    """A robot that is to run a path, for :func:`run`."""

    setting: Setting  # what is known of it
    path: ToolPath  # the programmed path
    q: Float  # (n, 6) rad along it
    relative: RelativeMotion  # how the tool moves relative to the part
    compliance_part: Float  # (n, 6, 6) compliance at the tip, part axes
    sag_part: Float  # (n, 3) m, deviation of the unloaded tool
    touched: tuple[Float, Float] | None  # datum points and the angles at them, or None
    mode: Mode  # lowest mode
    w_tcp_base: Float | None = None  # (n, 6) N, N m expected along it, that compliance curves are taken at; or None

    @functools.cached_property
    def programmed(self) -> MotionArrays:
        """The robot in motion along the path as it is programmed; every trial starts from it."""
        s, path = self.setting, self.path
        return motion_along(
            s.chain,
            self.relative,
            self.q,
            self.q,
            path.time_s,
            damping_of(s.chain, self.mode),
            shaken=shaken_rows(path),
            acceleration_m_s2=s.acceleration_m_s2,
            w_tcp_base=self.w_tcp_base,
        )


def shaken_rows(path: ToolPath) -> Bool:
    """(n,) rows that are fed to behind another one that is: there the programmed speed changes as it is written."""
    fed = path.kind == FEED
    out: Bool = fed & np.concatenate([[False], fed[:-1]])
    return out


def run(
    robot: PlannedRobot, stock: HeightMap, q_command: Float, correction: Float, progress: Progress
) -> tuple[Cut, Float]:
    """Cut with the robot in motion: inertia, drives, play and friction, and the force that follows the tool.

    A chain without masses answers a force and a correction through its one measured mode instead, and what its axes
    lose is added as if it came at rest.

    Args:
        robot: See :class:`PlannedRobot`.
        stock: The blank; left as it is.
        q_command: (n, 6) rad commanded, corrections included.
        correction: (n, 3) m, part axes: the same as a displacement.
        progress: Progress callback, fraction 0 to 1.

    Returns:
        The cut, and the deviation (n, 6) m, rad of the tool from the programmed path in part axes.
    """
    setting, path = robot.setting, robot.path
    moving = can_move(setting.chain)
    motion = None
    if moving:
        answered = answered_late(path.time_s, robot.q, q_command, setting.shaping.lead_s)
        motion = commanded(robot.programmed, answered)
    result = cut(
        path,
        path.p_part_tcp + robot.sag_part,
        stock.copy(),
        setting.cutter_of,
        setting.law,
        compliance_part=robot.compliance_part,
        mode=robot.mode,
        correction_part=None if moving else correction,
        motion=motion,
        progress=progress,
    )
    off = result.displacement_part.copy()
    if moving:
        off[:, :3] = in_touched_frame(setting.chain, robot.relative, path.p_part_tcp, robot.touched, off[:, :3])
    else:
        off[:, :3] += lost_motion(robot, q_command, at_points(result.w_tcp_part, result.volume_m3 > 0.0))
    off[:, :3] += robot.sag_part
    return result, off


def answered_late(time_s: Float, q: Float, q_command: Float, lag_s: float) -> Float:
    """(n, 6) rad, where the motors are told to be once the controller has answered.

    It follows the even feed without error but every change of it, which corrections are, late.

    Args:
        time_s: (n,) s.
        q: (n, 6) rad along the programmed path.
        q_command: (n, 6) rad, corrections included.
        lag_s: s, how much later a correction is answered than a force.
    """
    if lag_s == 0.0:
        return q_command
    added = q_command - q
    return q + np.stack([np.interp(time_s - lag_s, time_s, added[:, a]) for a in range(AXES)], axis=1)


def lost_motion(robot: PlannedRobot, q_command: Float, w_part: Float) -> Float:
    """(n, 3) m, what play, friction and yielding drives add at rest, see :func:`play_deviation`."""
    s = robot.setting
    return play_deviation(
        s.chain,
        robot.relative,
        robot.path.p_part_tcp,
        q_command,
        w_part,
        robot.path.time_s,
        robot.touched,
        robot.mode,
    )
