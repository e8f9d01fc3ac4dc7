"""Commanded motion of a robot controller, cycle by cycle: its program, slowed down or held, and corrected from outside.

Nothing here moves: the commanded angles go to a simulated robot (:mod:`counterflex.twin.live.live_cell`) or to one that
follows them exactly (:mod:`counterflex.twin.devices.exact_robot`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from counterflex.core.arrays import Float, as_float
from counterflex.core.errors import ReachError
from counterflex.geometry import pose, rotation
from counterflex.path.toolpath import ToolPath
from counterflex.robot.model.opw import BRANCHES, branches
from counterflex.robot.model.opw_chain import from_opw
from counterflex.twin.devices.path_answer import AnswerState, PathAnswer
from counterflex.twin.plant.controller import CommandedReference, Controller

_SAME_M = 1e-7
_AHEAD = 250  # Cycles of the program that are looked through for the place of a guided tool: a second at 4 ms


@dataclass(frozen=True, eq=False)
class Report:
    """Report of the controller after a cycle."""

    time_s: float  # simulated time
    T_part_nominal: Float  # (4, 4) commanded pose without correction, as the controller computes it
    T_part_actual: Float  # (4, 4) pose from motor encoders and nominal geometry, correction included
    q_command: Float  # (6,) rad commanded angles without correction
    q_actual: Float  # (6,) rad motor encoders
    cutting_program: bool  # the program runs (not waiting before its start, not at its end)
    finished: bool  # the program has come to its end
    # (6,) N m, mean torque of the drives over the cycle on the link side, positive in the positive direction of each
    # axis; zero where nothing is simulated that has one
    drive_torque: Float = field(default_factory=lambda: np.zeros(6))


class OwnBacklash:
    """A controller's own compensation of play: half of it, in the direction in which each axis was commanded last.

    Real controllers add it where they plan the axes themselves: to a program and to Cartesian corrections of it, and
    not to axis corrections, which go to the drives as they are (Haehn2020 section 3.3).

    Args:
        half_rad: (6,) rad.
    """

    _MOVING_RAD = 1e-7
    _TAKEN_UP_S = 0.02

    def __init__(self, half_rad: Float, period_s: float) -> None:
        self._half = as_float("half_rad", half_rad, (6,))
        self._step: Float = self._half * period_s / self._TAKEN_UP_S
        self._direction: Float = np.zeros(6)
        self._last: Float | None = None
        self.value: Float = np.zeros(6)

    def __call__(self, q: Float) -> Float:
        """(6,) rad to be added to the planned angles (6,) of this cycle."""
        if self._last is not None:
            moved = q - self._last
            self._direction = np.where(np.abs(moved) > self._MOVING_RAD, np.sign(moved), self._direction)
        self._last = q.copy()
        change = np.clip(self._half * self._direction - self.value, -self._step, self._step)
        self.value = self.value + change
        return self.value


class CommandedMotion:
    """A program on a controller that takes corrections.

    Args:
        path: Tool path of the program, part frame.
        controller: What the controller has been told.
        answer: How its path planning answers a correction.
        own_backlash_rad: (6,) half the play that it compensates itself, see :class:`OwnBacklash`; None is none.

    Attributes:
        reference: The program at the interpolation cycle.
        poses: (n, 4, 4) its tool poses, part frame.
        at: Place in it, cycles; between two where it was slowed down.
        running: It has been started.
    """

    def __init__(
        self,
        path: ToolPath,
        controller: Controller,
        answer: PathAnswer | None = None,
        own_backlash_rad: Float | None = None,
    ) -> None:
        self.controller = controller
        self.reference = CommandedReference.interpolated(path, controller)
        reference = self.reference
        self.poses = controller.tool_poses(reference.p_part_command, reference.axis_part, reference.turned_rad)
        self.at = 0.0
        self.running = False
        answer = answer if answer is not None else PathAnswer()
        half = np.zeros(6) if own_backlash_rad is None else own_backlash_rad
        self.own_backlash = OwnBacklash(half, controller.cycle_s)
        self._cartesian = AnswerState(answer, controller.cycle_s)
        self._axes = AnswerState(answer, controller.cycle_s)
        self._arm = from_opw("controller", controller.opw, controller.joint_limits_rad)
        self._branch = BRANCHES.index(controller.branch)
        self._T_tcp_flange = pose.inverse(controller.T_flange_tcp)
        self._T_part_base = pose.inverse(controller.T_base_part)

    @property
    def cycles(self) -> int:
        """Cycles that the program takes at full speed."""
        return len(self.reference.time_s)

    @property
    def finished(self) -> bool:
        """Return whether the program has come to its end."""
        return self.at >= self.cycles - 1

    def advance(
        self, cartesian: Float, axes: Float | None = None, override: float = 1.0, T_part_guided: Float | None = None
    ) -> tuple[Float, Float, Float]:
        """Command the next cycle.

        Args:
            cartesian: (6,) correction of the pose, m and rotation vector, in part axes about the commanded tip.
            axes: (6,) rad added to the commanded angles, or None.
            override: Speed of the program, 0 .. 1.
            T_part_guided: (4, 4) where the tool is to be instead of where the program has it; corrections are then
                left out, and the place in the program is the nearest one ahead. None follows the program.

        Returns:
            Angles (6,) rad and pose (4, 4) of the program without correction, and the corrected angles (6,) rad.

        Raises:
            ReachError: The pose cannot be reached.
        """
        if T_part_guided is not None:
            return self._guided(T_part_guided)
        if self.running:
            self.at = min(float(self.cycles - 1), self.at + override)
        pose_offset = self._cartesian(cartesian)
        axis_offset = self._axes(np.zeros(6) if axes is None else axes)
        q_nominal, T_part_nominal = self.commanded(self.at)
        q_next = q_nominal
        if np.any(pose_offset != 0.0):
            q_next = self._corrected(T_part_nominal, pose_offset, q_nominal)
        return q_nominal, T_part_nominal, q_next + self.own_backlash(q_next) + axis_offset

    def commanded(self, at: float) -> tuple[Float, Float]:
        """Angles and pose of the program at a place of its interpolation, between samples where it was slowed down."""
        k = min(int(at), len(self.poses) - 2)
        u = at - k
        q = (1.0 - u) * self.reference.q_ref[k] + u * self.reference.q_ref[k + 1]
        T = self.poses[k].copy()
        T[:3, 3] = (1.0 - u) * self.poses[k, :3, 3] + u * self.poses[k + 1, :3, 3]
        if u > 0.0:
            turn = rotation.log(self.poses[k + 1, :3, :3] @ T[:3, :3].T)
            T[:3, :3] = rotation.exp(u * turn) @ T[:3, :3]
        return q, T

    def forward(self, q: Float) -> Float:
        """Pose (4, 4) of the tool in the part frame by the nominal geometry: what the controller shows."""
        T_base_flange: Float = np.eye(4)
        for joint, segment in enumerate(self._arm.segments):
            angle = segment.sign * float(q[joint]) + segment.offset_rad
            T_base_flange = T_base_flange @ segment.T_prev_seg
            x, y = T_base_flange[:, 0].copy(), T_base_flange[:, 1]
            c, s = math.cos(angle), math.sin(angle)
            T_base_flange[:, 0], T_base_flange[:, 1] = c * x + s * y, c * y - s * x
        T_base_flange = T_base_flange @ self._arm.T_last_flange
        hand = T_base_flange @ self.controller.T_flange_tcp
        T_base_tcp = self.controller.T_base_tcp
        held: Float = self._T_part_base @ hand if T_base_tcp is None else pose.inverse(hand) @ T_base_tcp
        return held

    def _guided(self, T_part_tcp: Float) -> tuple[Float, Float, Float]:
        """Angles and pose of the program nearby, and the angles of a pose that comes from outside."""
        if self.running:
            begin = int(self.at)
            away = np.linalg.norm(self.reference.p_part_command[begin : begin + _AHEAD] - T_part_tcp[:3, 3], axis=1)
            nearest = np.flatnonzero(away <= away.min() + _SAME_M)[-1]  # behind a dwell at the same point
            self.at = max(self.at, float(begin + int(nearest)))
        q_nominal, T_part_nominal = self.commanded(self.at)
        return q_nominal, T_part_nominal, self._inverse(T_part_tcp, q_nominal, T_part_tcp[:3, 3])

    def _corrected(self, T_part_nominal: Float, offset: Float, q_nominal: Float) -> Float:
        T_part_tcp = T_part_nominal.copy()
        T_part_tcp[:3, 3] += offset[:3]
        T_part_tcp[:3, :3] = rotation.exp(offset[3:]) @ T_part_tcp[:3, :3]
        return self._inverse(T_part_tcp, q_nominal, offset[:3])

    def _inverse(self, T_part_tcp: Float, q_nominal: Float, named: Float) -> Float:
        T_base_tcp = self.controller.T_base_tcp
        hand = self.controller.T_base_part @ T_part_tcp
        if T_base_tcp is not None:
            hand = T_base_tcp @ pose.inverse(T_part_tcp)
        T_base_flange: Float = hand @ self._T_tcp_flange
        q = branches(self.controller.opw, T_base_flange[None])[0, self._branch]
        if not np.all(np.isfinite(q)):
            raise ReachError("the corrected pose is out of reach", value=np.round(named * 1e3, 3).tolist())
        turned: Float = q + 2.0 * np.pi * np.round((q_nominal - q) / (2.0 * np.pi))
        return turned


class RobotController(Protocol):
    """One session of a controller, cycle by cycle, without a socket."""

    counter: int
    """Of the telegram to be answered."""
    late: int
    """Late or unusable answers so far."""
    stopped: str
    """Why the motion was stopped, or empty."""
    refused: str
    """Why the last answer was refused, or empty."""
    correction: Float
    """(6,) correction in force as the protocol has it, m and rad."""
    axes: Float
    """(6,) correction of the axes in force, rad."""
    stat: int
    """0, 1 correcting, 2 limited."""
    override: float
    """Speed of the program that the answer asks for, 0..1."""
    feed_hold: bool
    """The answer asks for a feed hold."""
    enabled: bool
    """The program is where corrections are wanted."""

    @property
    def cycle_s(self) -> float:
        """Time between telegrams."""

    @property
    def guides(self) -> bool:
        """Poses from outside guide the robot, no program."""

    @property
    def only_sends(self) -> bool:
        """Nothing is expected back."""

    def telegram(self, report: Report) -> bytes:
        """The telegram of the next cycle."""

    def answers(self, data: bytes) -> bool:
        """Return whether a datagram is the answer to the newest telegram, as far as the protocol lets it be seen."""

    def answer(self, data: bytes | None) -> None:
        """Take the answer of the cycle (the last datagram), or None."""

    def pose_correction(self) -> Float:
        """(6,) Cartesian correction in force: m and rotation vector, part axes."""

    def guided_pose(self) -> Float | None:
        """(4, 4) where the tool is to be in the part frame, in place of a program; None with a program."""


class PlayedController(RobotController, Protocol):
    """One that can be played for hours: it hears what the loop says of itself, and begins anew when it was stopped."""

    reported_state: int
    """What the sensor program says it is doing; negative where it does not."""

    def again(self, ahead_ms: int) -> PlayedController:
        """Another session of the same program, its counter so far ahead of this one's."""
