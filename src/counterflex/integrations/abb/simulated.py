"""A robot controller's side of ABB EGM, cycle by cycle: what it sends, what it makes of what comes. No socket.

Models what real controllers do: *path correction* moves the program's path in y and z of the path frame, once per
sample of 24 ms or a multiple; *position guidance* has no program, it goes after the pose it was sent last with
``speed = k (pose - where it is) + speed reference``, low-pass filtered, late, ramped in, its speed limited, and ends
when it has stood within its window for long enough. There is no coupling of message and answer: the last message counts
until another comes, the speed it asks for too, until CommTimeout ends the movement.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from counterflex.core.arrays import Float, as_positive
from counterflex.core.errors import CounterflexError, InputError
from counterflex.core.units import DEG, MM, MS
from counterflex.geometry import pose, rotation
from counterflex.integrations.abb.link.telegram import RobotState, read_guidance, read_path_correction
from counterflex.robot.model.controller_axes import AS_MODEL, ControllerAxes
from counterflex.twin.devices.commanded_motion import Report

TIMEOUT: Final = "ERR_UDPUC_COMM"
"""RAPID's error number when nothing came for CommTimeout."""
CONVERGED: Final = "converged"
FREE: Final = 0
CORRECTING: Final = 1
LIMITED: Final = 2


@dataclass(frozen=True)
class EgmContext:
    """Facts of the RAPID program and of the configuration of the controller."""

    mode: Literal["path", "pose"] = "path"  # ``path``: EGMActMove, EGMMoveL; ``pose``: EGMActPose, EGMRunPose
    cycle_s: float = 24.0 * MS  # SampleRate: multiples of 24 ms for path correction, of 4 ms for guidance
    timeout_s: float = 0.1  # CommTimeout
    robotware: int = 7  # 6 or 7: how the robot's own force is written
    gain_per_s: float = 20.0  # Default Proportional Position Gain times PosCorrGain, 0 .. 20.
    low_pass_hz: float = 20.0  # Of the reference; 0 leaves it out
    dead_s: float = 12.0 * MS  # Time until a reference acts
    speed_m_s: float = 0.5  # Limit of the speed, from MaxSpeedDeviation and the arm's length
    turn_rad_s: float = 1.0  # The same for the orientation
    ramp_in_s: float = 0.1  # RampInTime
    window_m: float = 0.05 * MM  # egm_minmax of x, y, z
    window_rad: float = 0.05 * DEG  # Of rx, ry, rz
    condition_s: float = 30.0  # CondTime
    first_ms: int = 86_400_000  # Clock of the controller at the first message
    axes: ControllerAxes = AS_MODEL  # How the controller counts the axes

    def __post_init__(self) -> None:
        """Check ranges. Raises InputError: a setting that no controller takes."""
        if self.mode not in ("path", "pose"):
            raise InputError("mode of EGM", value=self.mode, limit="path or pose")
        unit = 24.0 if self.mode == "path" else 4.0
        rest = math.remainder(self.cycle_s / MS, unit)
        if self.cycle_s <= 0.0 or abs(rest) > 1e-6:
            raise InputError("SampleRate of EGM", value=f"{self.cycle_s / MS:g} ms", limit=f"multiples of {unit:g} ms")
        if not 0.0 <= self.gain_per_s <= 20.0:
            raise InputError("position gain of EGM", value=self.gain_per_s, limit="0 .. 20 1/s")
        if self.robotware not in (6, 7):
            raise InputError("RobotWare", value=self.robotware, limit="6 or 7")
        for name in ("timeout_s", "speed_m_s", "turn_rad_s", "window_m", "window_rad", "condition_s"):
            as_positive(name, getattr(self, name))
        for name in ("low_pass_hz", "dead_s", "ramp_in_s"):
            as_positive(name, getattr(self, name), zero=True)


class FakeEgm:
    """One EGM session of a simulated controller.

    Args:
        context: Settings of the controller.
        T_part_frame: (4, 4) frame of its messages in the part frame; None: they are in the part frame.

    Attributes:
        late: Cycles without a usable message so far, while a movement was corrected or guided.
        stopped: Why the movement was ended, or empty.
        refused: Why the last datagram was refused, or empty.
        stat: 0, 1 correcting, 2 limited.
        override: 1: EGM asks for no other speed.
        feed_hold: False: EGM has no word for it.
    """

    def __init__(self, context: EgmContext, T_part_frame: Float | None = None) -> None:
        self.context = context
        self._T_part_frame = np.eye(4) if T_part_frame is None else T_part_frame
        self._T_frame_part = pose.inverse(self._T_part_frame)
        self.counter = -1  # Sequence number of the newest message
        self.late, self.stopped, self.refused = 0, "", ""
        # (6,) correction of the path in force, m, path frame; zero where poses guide
        self.correction: Float = np.zeros(6)
        self.axes: Float = np.zeros(6)  # (6,) zero: EGM corrects no axes here
        self.stat, self.override, self.feed_hold = FREE, 1.0, False
        self.enabled = False  # The program is in a movement that is corrected or guided
        self.force: Float | None = None  # (6,) N, N m that the robot measures itself, or None; set from outside
        self.utilization = 0.0  # Share of the admitted speed
        self.converged = False  # The tool stands within the window
        self._sent = 0
        self._last = -1
        self._silent_s = self._guided_s = self._standing_s = 0.0
        self._before: Float | None = None
        self._R_part_path: Float | None = None
        self._now: Float | None = None
        self.reference: Float | None = None  # (4, 4) newest pose that guides, part frame, or None
        self._twist: Float = np.zeros(6)
        self._queue: list[tuple[Float, Float]] = []
        self._smooth: Float | None = None

    @property
    def cycle_s(self) -> float:
        """Time between messages."""
        return self.context.cycle_s

    @property
    def guides(self) -> bool:
        """Position guidance: poses from outside guide the robot, no program."""
        return self.context.mode == "pose"

    @property
    def only_sends(self) -> bool:
        """False: something is expected back."""
        return False

    def telegram(self, report: Report) -> bytes:
        """The message of the next cycle."""
        self.counter += 1
        if not self.guides:
            self._follow(report.T_part_nominal)
        if self._now is None:
            self._now = report.T_part_nominal.copy()
        planned = report.T_part_nominal if self.context.mode == "path" else self._now
        running = not self.stopped
        state = RobotState(
            sequence=self.counter & 0xFFFFFFFF,
            time_ms=(self.context.first_ms + round(self._sent * self.context.cycle_s / MS)) & 0xFFFFFFFF,
            q=self.context.axes.shown(report.q_actual),
            T_frame_tcp=self._T_frame_part @ report.T_part_actual,
            T_frame_tcp_planned=self._T_frame_part @ planned,
            motors_on=True,
            guided=self.enabled and running,
            rapid_running=running,
            utilization=self.utilization,
            force=self.force,
            converged=self.converged,
            q_planned=None if report.q_command is None else self.context.axes.shown(report.q_command),
        )
        self._sent += 1
        return state.telegram(robotware=self.context.robotware)

    def answers(self, data: bytes) -> bool:
        """True: a message belongs to no other in particular."""
        return bool(data)

    def answer(self, data: bytes | None) -> None:
        """Return the last datagram of the cycle, or None; without a new one the last one counts."""
        if self.stopped:
            return
        self.refused = self._accept(data)
        self._silent_s = self._silent_s + self.context.cycle_s if self.refused else 0.0
        if not self.enabled:
            self._silent_s = self._guided_s = self._standing_s = 0.0
            self.stat = FREE
            return
        if self.refused:
            self.late += 1
            if self._silent_s >= self.context.timeout_s - 1e-9:
                self.stopped = TIMEOUT
                self.correction = np.zeros(6)
                return
        if self.context.mode == "pose":
            self._go()
        else:
            self.stat = CORRECTING if np.any(self.correction != 0.0) else FREE

    def pose_correction(self) -> Float:
        """(6,) correction of the path in force: m in part axes, no rotation; zero outside of corrected movements."""
        out = np.zeros(6)
        if self.context.mode == "path" and self.enabled and self._R_part_path is not None:
            out[:3] = self._R_part_path @ self.correction[:3]
        return out

    def guided_pose(self) -> Float | None:
        """(4, 4) where the tool is to be, part frame, where poses guide; else None."""
        return self._now if self.guides else None

    def _accept(self, data: bytes | None) -> str:
        if data is None:
            return "no message"
        try:
            if self.context.mode == "path":
                sequence, offset, _ = read_path_correction(data)
            else:
                sequence, T_frame_tcp, twist = read_guidance(data)
        except CounterflexError:
            return "unreadable"
        if sequence == self._last:
            return "repeated"
        self._last = sequence
        if self.context.mode == "path":
            self.correction[1:3] = offset[1:3]
        else:
            R = self._T_part_frame[:3, :3]
            self.reference = self._T_part_frame @ T_frame_tcp
            self._twist = np.concatenate((R @ twist[:3], R @ twist[3:]))
        return ""

    def _follow(self, T_part_tcp: Float) -> None:
        """Axes of the path frame, of the program's motion: x along it, y = x cross z of the tool, z = x cross y."""
        p = T_part_tcp[:3, 3].copy()
        move = p - (p if self._before is None else self._before)
        self._before = p
        length = _length(move)
        if length < 1e-9:
            return
        x = move / length
        y = rotation.cross(x, T_part_tcp[:3, 2])
        size = _length(y)
        if size > 1e-6:
            self._R_part_path = np.array([x, y / size, rotation.cross(x, y / size)]).T.copy()

    def _go(self) -> None:
        """One cycle after the reference."""
        context, now = self.context, self._now
        if now is None:
            return
        self._guided_s += context.cycle_s
        self._queue.append((now if self.reference is None else self.reference, self._twist))
        if len(self._queue) <= round(context.dead_s / context.cycle_s):
            return
        T_target, twist = self._queue.pop(0)
        T_target = self._filtered(T_target)
        turn = rotation.log(T_target[:3, :3] @ now[:3, :3].T)
        error = np.concatenate((T_target[:3, 3] - now[:3, 3], turn))
        ramp = min(1.0, self._guided_s / context.ramp_in_s) if context.ramp_in_s > 0.0 else 1.0
        speed = ramp * (context.gain_per_s * error + twist)
        self.utilization = max(_length(speed[:3]) / context.speed_m_s, _length(speed[3:]) / context.turn_rad_s)
        step = speed * context.cycle_s / max(1.0, self.utilization)
        self.stat = LIMITED if self.utilization > 1.0 else CORRECTING if step.any() else FREE
        self._now = pose.make(rotation.exp(step[3:]) @ now[:3, :3], now[:3, 3] + step[:3])
        self.converged = within = _length(error[:3]) < context.window_m and _length(error[3:]) < context.window_rad
        self._standing_s = self._standing_s + context.cycle_s if within else 0.0
        if self._standing_s >= context.condition_s:
            self.stopped = CONVERGED

    def _filtered(self, T_target: Float) -> Float:
        """Reference behind its low-pass of first order."""
        context = self.context
        if context.low_pass_hz == 0.0 or self._smooth is None:
            self._smooth = T_target
            return T_target
        share = 1.0 - math.exp(-2.0 * math.pi * context.low_pass_hz * context.cycle_s)
        p = self._smooth[:3, 3] + share * (T_target[:3, 3] - self._smooth[:3, 3])
        turn = rotation.log(T_target[:3, :3] @ self._smooth[:3, :3].T)
        self._smooth = pose.make(rotation.exp(share * turn) @ self._smooth[:3, :3], p)
        return self._smooth


def _length(v: Float) -> float:
    """Length of one vector: :func:`numpy.linalg.norm` takes ten times as long for it."""
    return math.sqrt(v.dot(v))
