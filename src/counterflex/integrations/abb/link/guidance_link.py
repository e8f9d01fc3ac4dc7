"""EGM position guidance: the robot has no path of its own; every 4 ms it is sent the planned and corrected pose."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, as_positive
from counterflex.core.errors import ProtocolError
from counterflex.core.units import DEG, MM
from counterflex.geometry import pose, rotation
from counterflex.integrations.abb.link.link import EgmLink, put_pose
from counterflex.integrations.abb.link.telegram import write_guidance
from counterflex.path.path_speed import PoseStream
from counterflex.runtime.state.supervisor import State, risen

_PATIENCE: Final = 250  # Cycles for which a robot that is to start may stand elsewhere
_REST: Final = 250  # Cycles that a robot waits before its path begins, where the loop is not armed
_LAGGING_CYCLES: Final = 25  # Cycles for which it may not follow


class Phase(IntEnum):
    """Of a guided run."""

    WAITING = 0
    RUNNING = 1
    ENDED = 2


@dataclass(frozen=True)
class GuidanceSettings:
    """Settings of the streaming of a path."""

    lag_s: float = 70e-3  # How late the robot is where it was sent: dead time of the exchange, low-pass, ``1 / k``
    # State of the loop in which the path may begin: ARMED; or IDLE to watch only: then it begins a second after the
    # robot waits for it, as long as the loop has no fault
    start: State = State.ARMED
    tolerance_m: float = 1.0 * MM  # Largest distance of the robot from the beginning of the path at the start
    tolerance_rad: float = 0.5 * DEG  # Largest angle, likewise
    follow_m: float = 2.0 * MM  # Distance from where it was sent, lag taken off, above which the robot does not follow
    blend_s: float = 0.5  # Time in which what it stood off at the start is taken back
    # Send the speed along the path too: no lag behind the path, but a robot that hears no more goes on with it until
    # its CommTimeout
    speed_reference: bool = False

    def __post_init__(self) -> None:
        """Check ranges."""
        as_positive("lag_s", self.lag_s, zero=True)
        for name in ("tolerance_m", "tolerance_rad", "follow_m", "blend_s"):
            as_positive(name, getattr(self, name))


class EgmGuidanceLink(EgmLink):
    """Answers with ``EgmSensor``: a pose, and if wanted a speed reference.

    While the robot waits it is sent where it stands, once two messages in a row show it there: it would go to a pose of
    one message that is wrong. The path begins when the loop allows it and the robot stands at
    its beginning; from there the reference goes over to the path without a step. The feed is held by not going on
    along the path. A telegram that was lost is not made up for: the path waits. Told to stop, the link brings the
    reference to rest on the path and then says nothing more; the controller stops by its CommTimeout.

    What the loop is told as commanded pose is where the robot is now by the plan: the streamed pose ``lag_s`` ago.

    Args:
        stream: Poses of the path as the program would send them, part frame.
        guidance: See :class:`GuidanceSettings`.
        settings: As for :class:`counterflex.integrations.abb.link.link.EgmLink`.
    """

    def __init__(self, stream: PoseStream, guidance: GuidanceSettings, **settings: object) -> None:
        super().__init__(period_s=stream.period_s, **settings)  # type: ignore[arg-type]
        self.stream, self.guidance = stream, guidance
        self.phase = Phase.WAITING  # See :class:`Phase`
        lag = max(1, round(guidance.lag_s / stream.period_s))
        first = stream.pose(0.0)
        self._nominal: Float = np.tile(first, (lag, 1, 1))
        self._sent: Float = np.tile(first[:3, 3], (lag, 1))
        self._place = 0
        self._T_hold: Float | None = None
        self._T_before: Float | None = None
        self._stands = False  # Where the message before had it
        self._offset: Float = np.zeros(6)
        self._faded, self._fade = 0, max(1, round(guidance.blend_s / stream.period_s))
        self._stopping = False
        self._waited, self._away, self._lagging = 0, 0, 0

    def wait(self, timeout_s: float) -> bool:
        """As :meth:`counterflex.integrations.abb.link.link.EgmLink.wait`.

        Raises:
            ProtocolError: The controller ended the movement before the end of the path, or began another session.
        """
        received = super().wait(timeout_s)
        if received:
            self._watch()
        return received

    def _watch(self) -> None:
        stands = self._look_where_it_stands()
        if self.restarted or not self.guided:  # one that has restarted may guide again, from another place
            self._T_hold = None
            if self.phase == Phase.RUNNING:
                self.phase = Phase.ENDED
                if not self.stream.finished and not self._stopping:
                    what = "began another session" if self.restarted else "ended the guided movement"
                    raise ProtocolError(
                        f"the controller {what} before the end of the path",
                        value=f"{self.stream.at * self.period_s:.2f} s of {self.stream.duration_s:.2f} s",
                        hint="Its event log says why: convergence (CondTime), a limit, motors off, a stop",
                    )
        elif stands:
            self._T_hold = self._T_part_actual.copy()
        running = self.phase == Phase.RUNNING
        if running:
            off = math.dist(self._T_part_actual[:3, 3].tolist(), self._sent[self._place].tolist())
            self._lagging = self._lagging + 1 if off > self.guidance.follow_m else 0
        self.clamped = self.clamped or self._lagging >= _LAGGING_CYCLES
        self.enable = running and self.guided and not self.stream.finished

    def _look_where_it_stands(self) -> bool:
        """Return whether the newest message shows where a robot stands of which that is not known."""
        before, self._T_before = self._T_before, self._T_part_actual
        if self._T_hold is not None:
            return False
        self._stands = before is not None and self._within(*_difference(self._T_part_actual, before))
        return self._stands

    def fill(self, nominal: Float, q: Float) -> None:
        """Write the planned pose that the robot should be at, and its axis angles."""
        put_pose(nominal, self._nominal[self._place])
        q[:] = self._q

    def fill_reported(self, out: Float) -> bool:
        """Write the measured pose: unlike the planned one of :meth:`fill`, what was sent contains the correction.

        False while the robot waits, and until the reference has gone over to the path: it stands elsewhere.
        """
        if self.phase != Phase.RUNNING or self._faded < self._fade:
            return False
        put_pose(out, self._T_part_actual)
        return True

    def answer(
        self,
        correction: Float,
        axes: Float | None = None,
        *,
        stop: bool = False,
        feed_hold: bool = False,
        override: float = 1.0,
        state: State = State.IDLE,
    ) -> bool:
        """Go on along the path and send the pose; see :class:`counterflex.protocols.robot.link.RobotLink`.

        Returns:
            Whether an answer was sent: not, where a number is not finite, the robot is to stop and the reference is
            at rest, or it has not said twice where it is.

        Raises:
            ProtocolError: The robot is to start, but stands elsewhere.
        """
        self._stopping = stop
        if axes is not None or self.empty or not all(map(math.isfinite, correction.tolist())):
            return False
        held = stop or feed_hold
        if self.phase == Phase.WAITING and not held:
            self._start(state)
        twist = None
        if self.phase == Phase.RUNNING:
            self.stream.advance(0.0 if held else override)
            nominal = self._on_path()
            if self.guidance.speed_reference:
                twist = self.stream.twist()
        else:
            # Where it stands it stands with what was corrected before: that is not added once more.
            nominal = self._T_part_actual if self._T_hold is None else self._T_hold
            stop |= not self._stands
        T = nominal.copy()
        if self.phase == Phase.RUNNING:
            T[:3, 3] += correction[:3]
            T[:3, :3] = rotation.exp(correction[3:]) @ T[:3, :3]
            self._remember(nominal, T)
        if stop and (self.phase != Phase.RUNNING or self.stream.rate == 0.0):
            return False
        return self._send(T, twist)

    def _start(self, state: State) -> None:
        if self._T_hold is None:
            return
        self._waited += 1
        if self.guidance.start == State.ARMED:
            allowed = state in (State.ARMED, State.ACTIVE)
        else:
            allowed = self._waited > _REST and state in (State.IDLE, State.READY, State.ARMED)
        if not allowed:
            return
        first = self.stream.pose(0.0)
        self._offset[:3], self._offset[3:] = _difference(self._T_hold, first)
        away, turned = float(np.linalg.norm(self._offset[:3])), float(np.linalg.norm(self._offset[3:]))
        if self._within(self._offset[:3], self._offset[3:]):
            self.phase = Phase.RUNNING
            return
        self._away += 1
        if self._away > _PATIENCE:
            raise ProtocolError(
                "the robot does not stand at the beginning of the path",
                value=f"{away / MM:.2f} mm and {turned / DEG:.2f} deg away",
                limit=f"{self.guidance.tolerance_m / MM:g} mm and {self.guidance.tolerance_rad / DEG:g} deg",
                hint="Check tool, work object and frame of EGMActPose, and that the plan belongs to the program",
            )

    def _within(self, away: Float, turned: Float) -> bool:
        """Return whether a distance (3,) m and a rotation vector (3,) are within what a robot may stand off."""
        limits = self.guidance
        return bool(np.linalg.norm(away) <= limits.tolerance_m and np.linalg.norm(turned) <= limits.tolerance_rad)

    def _on_path(self) -> Float:
        """Pose of the path, and what is left of the way from where the robot stood."""
        T = self.stream.pose()
        if self._faded < self._fade:
            self._faded += 1
            remaining = 1.0 - risen(self._faded, self._fade)
            T[:3, 3] += remaining * self._offset[:3]
            T[:3, :3] = rotation.exp(remaining * self._offset[3:]) @ T[:3, :3]
        return T

    def _remember(self, nominal: Float, sent: Float) -> None:
        """Keep what goes out now; :attr:`_place` is then what went out ``lag_s`` ago."""
        self._nominal[self._place], self._sent[self._place] = nominal, sent[:3, 3]
        self._place = (self._place + 1) % len(self._nominal)

    def _send(self, T_part_tcp: Float, twist: Float | None) -> bool:
        T = T_part_tcp
        if self._T_frame_part is not None:
            T = self._T_frame_part @ T_part_tcp
            if twist is not None:
                R = self._T_frame_part[:3, :3]
                twist = np.r_[R @ twist[:3], R @ twist[3:]]
        sequence, clock_ms = self._numbered()
        return self._port.send(write_guidance(sequence, T, clock_ms, twist))


def _difference(T: Float, T_from: Float) -> tuple[Float, Float]:
    """Pose minus another one: (3,) m and rotation vector (3,)."""
    return T[:3, 3] - T_from[:3, 3], rotation.log(T[:3, :3] @ T_from[:3, :3].T)


def commanded_poses(Rs_part_tcp: Float, p_part_tcp: Float, contained: Float) -> Float:
    """Poses (n, 4, 4) that a program sends.

    Args:
        Rs_part_tcp: (n, 3, 3) nominal orientations.
        p_part_tcp: (n, 3) m, nominal points.
        contained: (n, 6) correction that the program contains, m and rotation vector.
    """
    out: Float = pose.make(rotation.exp(contained[:, 3:]) @ Rs_part_tcp, p_part_tcp + contained[:, :3])
    return out
