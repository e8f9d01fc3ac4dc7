"""The robot controller: from a tool path to joint references at its interpolation cycle.

It knows the nominal geometry only: closed-form kinematics of the rigid robot, the tool and the part frame as they
were entered. With full speed feed-forward (the default) the drives follow without lag; a controller without it trails
by ``v / Kv``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from counterflex.core.arrays import Float, Int, as_float, as_positive
from counterflex.core.errors import InputError, ModelError, ReachError
from counterflex.core.units import MM
from counterflex.geometry import pose
from counterflex.path.path_speed import Track, build_track
from counterflex.path.tool_rotation import ToolRotation
from counterflex.path.toolpath import ToolPath
from counterflex.robot.model.description import EndEffector, Opw, Robot
from counterflex.robot.model.opw import BRANCHES, branches, nearest_turn, turns
from counterflex.twin.plant.drives import first_order_lag
from counterflex.twin.truth.other import ControllerKind

CYCLE_S = 4.0e-3


@dataclass(frozen=True)
class Controller:
    """Settings of the robot controller."""

    opw: Opw  # geometry of the robot
    joint_limits_rad: Float  # (6, 2)
    T_flange_tcp: Float  # (4, 4) tool
    T_base_part: Float  # (4, 4) part frame as the controller has it
    branch: str = "front up noflip"  # one of BRANCHES
    # turns the tool frame from "x along part x", right-handed about the direction from tip to spindle
    rotation_about_tool_rad: float = 0.0
    blending_m: float = 0.5e-3  # distance of approximate positioning; 0 is exact stop at every corner
    acceleration_m_s2: float = 1.0  # limit along and across the path
    rapid_m_s: float = 0.25
    following_gain_per_s: float | None = None  # Kv of a drive without speed feed-forward, or None for full feed-forward
    cycle_s: float = CYCLE_S
    smoothing_s: float = 0.0  # length of the moving mean over the axis references, 0 for none
    # how the tool turns about its axis along the program, in place of a constant rotation; or None
    turning: ToolRotation | None = None
    # (4, 4) tool frame of a spindle that stands, when the robot holds the part: ``T_flange_tcp`` is the part frame in
    # the flange then, and ``T_base_part`` says nothing. None: the robot holds the tool
    T_base_tcp: Float | None = None

    def __post_init__(self) -> None:
        """Check ranges."""
        as_float("T_flange_tcp", self.T_flange_tcp, (4, 4))
        as_float("T_base_part", self.T_base_part, (4, 4))
        as_float("joint_limits_rad", self.joint_limits_rad, (6, 2))
        if self.branch not in BRANCHES:
            raise InputError("posture of the arm", value=self.branch, limit="one of " + ", ".join(BRANCHES))
        as_positive("blending_m", self.blending_m, zero=True)
        as_positive("acceleration_m_s2", self.acceleration_m_s2)
        as_positive("rapid_m_s", self.rapid_m_s)
        as_positive("cycle_s", self.cycle_s)
        as_positive("smoothing_s", self.smoothing_s, zero=True)
        if self.following_gain_per_s is not None:
            as_positive("following_gain_per_s", self.following_gain_per_s)

    def tool_poses(self, p_part_tcp: Float, axis_part: Float, turned_rad: Float | None = None) -> Float:
        """Poses ``Ts_part_tcp`` (n, 4, 4) of the tool frame, see the class.

        Args:
            p_part_tcp: (n, 3) m, tips.
            axis_part: (n, 3) from tip to spindle.
            turned_rad: (n,) rotation about the axis, or None for the constant one.
        """
        axis = axis_part / np.linalg.norm(axis_part, axis=1, keepdims=True)
        along = np.where(np.abs(axis[:, :1]) < 0.9, np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]))
        x0 = along - np.sum(along * axis, axis=1, keepdims=True) * axis
        x0 /= np.linalg.norm(x0, axis=1, keepdims=True)
        angle = np.reshape(self.rotation_about_tool_rad if turned_rad is None else turned_rad, (-1, 1))
        x = np.cos(angle) * x0 + np.sin(angle) * np.cross(axis, x0)
        return pose.make(np.stack([x, np.cross(-axis, x), -axis], axis=-1), p_part_tcp)

    def joints(self, p_part_tcp: Float, axis_part: Float, turned_rad: Float | None = None) -> Float:
        """Joint angles for tool tips in the controller's part frame, one posture, without jumps.

        Args:
            p_part_tcp: (n, 3) m.
            axis_part: (n, 3) from tip to spindle.
            turned_rad: (n,) rotation about the axis, or None for the constant one.

        Returns:
            (n, 6) rad.

        Raises:
            ReachError: A point is out of reach or of the joint limits in this posture, or the wrist turns over.
        """
        Ts_part_tcp = self.tool_poses(p_part_tcp, axis_part, turned_rad)
        held = self.T_base_part @ Ts_part_tcp
        if self.T_base_tcp is not None:
            held = self.T_base_tcp @ pose.inverse(Ts_part_tcp)
        Ts_base_flange: Float = held @ pose.inverse(self.T_flange_tcp)
        q: Float = branches(self.opw, Ts_base_flange)[:, BRANCHES.index(self.branch)]
        bad = ~np.all(np.isfinite(q), axis=1)
        if bad.any():
            raise self._unreachable("the robot does not reach the tool path", p_part_tcp, bad)
        start = turns(q[0], self.joint_limits_rad)
        q[0] = start[0] if len(start) else nearest_turn(q[0], np.zeros(6), self.joint_limits_rad)
        q = np.unwrap(q, axis=0)
        outside = np.any((q < self.joint_limits_rad[:, 0]) | (q > self.joint_limits_rad[:, 1]), axis=1)
        if outside.any():
            raise self._unreachable("a joint limit is in the way", p_part_tcp, outside)
        return q

    def _unreachable(self, what: str, p: Float, bad: object) -> ReachError:
        first = int(np.argmax(np.asarray(bad)))
        return ReachError(
            what,
            where=f"sample {first}, part {np.round(p[first] / MM, 2).tolist()} mm",
            hint="Move the part, or choose another posture or rotation about the tool",
        )


def controller_of(robot: Robot, end_effector: EndEffector, T_base_part: Float, **settings: object) -> Controller:
    """A controller that has been told a cell's nominal geometry.

    ``T_base_part``: (4, 4) part frame. Raises ModelError: the robot has no closed-form geometry.
    """
    if robot.opw is None:
        raise ModelError(
            "the simulated controller needs the closed-form geometry of the robot",
            value=robot.name,
            hint="Give the robot by catalogue name or by its OPW lengths",
        )
    T = np.eye(4)
    for segment in end_effector.segments:
        T = T @ segment.T_prev_seg
    fields: dict[str, object] = {
        "opw": robot.opw,
        "joint_limits_rad": robot.joint_limits_rad,
        "T_flange_tcp": T @ end_effector.T_last_tcp,
        "T_base_part": T_base_part,
        **settings,
    }
    return Controller(**fields)  # type: ignore[arg-type]


@dataclass(frozen=True)
class CommandedReference:
    """References for the drives, one row per cycle."""

    time_s: Float  # (n,) s
    p_part_command: Float  # (n, 3) m, interpolated tool tip
    axis_part: Float  # (n, 3) interpolated tool axis
    q_ref: Float  # (n, 6) rad
    qd_ref: Float  # (n, 6) rad/s
    source: Int  # (n,) row of the tool path
    turned_rad: Float | None = None  # (n,) rotation about the tool axis, or None where it is constant

    @classmethod
    def interpolated(cls, path: ToolPath, controller: Controller) -> CommandedReference:
        """Run a tool path on the controller.

        ``path``: In the part frame; at least two points. Returns references at the interpolation cycle; speeds are
        central differences. Raises InputError: the path has fewer than two points. Raises ReachError: see
        :meth:`Controller.joints`.
        """
        if len(path) < 2:
            raise InputError("a tool path of fewer than two points cannot be run", value=len(path), limit=">= 2")
        track = build_track(
            path,
            blending_m=controller.blending_m,
            rapid_m_s=controller.rapid_m_s,
            acceleration_m_s2=controller.acceleration_m_s2,
        )
        t, p, axis, source = track.timed(controller.acceleration_m_s2, controller.cycle_s)
        if len(t) < 2:
            raise InputError("the tool path does not move", value=len(path))
        turned = _turned(path, controller, track)
        q = controller.joints(p, axis, turned)
        if controller.smoothing_s > 0.0:
            q = moving_mean(q, max(1, round(controller.smoothing_s / controller.cycle_s)))
        if controller.following_gain_per_s is not None:
            q = first_order_lag(q, controller.cycle_s, controller.following_gain_per_s)
        qd: Float = np.gradient(q, controller.cycle_s, axis=0)
        return cls(time_s=t, p_part_command=p, axis_part=axis, q_ref=q, qd_ref=qd, source=source, turned_rad=turned)


def as_it_is(controller: Controller, kind: ControllerKind | None) -> Controller:
    """The controller with what it makes of programs beside what it was told; the same where that is None."""
    if kind is None:
        return controller
    return replace(controller, blending_m=controller.blending_m * kind.blending_share, smoothing_s=kind.smoothing_s)


def moving_mean(q: Float, count: int) -> Float:
    """Mean over ``count`` samples about each one, the path standing still before its beginning and after its end.

    A controller's filter takes past samples only and is late by half its length, everywhere alike; that delay, which
    moves no point of the path, is left out. An even count is made odd.

    Args:
        q: (n, m) samples at equal steps, any unit.
        count: >= 1.

    Returns:
        (n, m).
    """
    half = count // 2
    if half == 0:
        return q
    padded = np.concatenate([np.repeat(q[:1], half + 1, axis=0), q, np.repeat(q[-1:], half, axis=0)])
    total = np.cumsum(padded - q[0], axis=0)
    out: Float = q[0] + (total[2 * half + 1 :] - total[: -(2 * half + 1)]) / (2 * half + 1)
    return out


def _turned(path: ToolPath, controller: Controller, track: Track) -> Float | None:
    """Rotation about the tool axis at each sample, interpolated as the tool axis is; None where it is constant."""
    if controller.turning is None:
        return None
    at = controller.turning.along(path.p_part_tcp)[track.turned]
    segment, share = track.places(controller.acceleration_m_s2, controller.cycle_s)
    out: Float = (1.0 - share) * at[segment] + share * at[segment + 1]
    return out
