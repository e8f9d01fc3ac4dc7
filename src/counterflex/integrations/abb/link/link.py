"""The sensor program's side of ABB EGM: what both ways of correcting share. Waits, keeps the newest message, counts."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, as_positive
from counterflex.core.errors import ProtocolError
from counterflex.geometry import pose
from counterflex.integrations.abb.link.telegram import RobotState, read_robot
from counterflex.protocols.robot.port import Counters, RobotPort, Verdict
from counterflex.protocols.robot.session_counter import SessionCounter
from counterflex.protocols.robot.wire import Wire
from counterflex.robot.model.controller_axes import AS_MODEL, ControllerAxes
from counterflex.runtime.plausibility.axis_check import ABSENT, EXACT

LARGEST_DATAGRAM: Final = 4096
_WRAP: Final = 1 << 32
_CADENCE: Final = 16  # Messages after which the cycle of the controller is known


class EgmLink:
    """One EGM session: receives.

    A message is one cycle: cycles are counted by the sequence number, time by the controller's clock, whose cycle is
    4.032 ms where EGM says 4.

    Args:
        host: Address to listen on; loopback unless told otherwise.
        port: UDP port; 0 a free one.
        peer: Address and port of the controller, port 0 for any; None takes the first that sends a good message.
        period_s: Time between messages: SampleRate of the RAPID program.
        T_part_frame: (4, 4) frame of the messages in the part frame; None: the program reports in its work object,
            which is the part frame.
        axes: How the controller counts the axes of its messages.
        wire: What carries the messages; None opens the port.
        clock_ns: Monotonic clock, which the messages sent are stamped by.

    Attributes:
        commanded_is: ABSENT: what is planned is not held against the angles, which are measured.
        measured_is: EXACT: angles and pose of the feedback.

    Raises:
        OutputError: The port cannot be bound.
    """

    def __init__(
        self,
        *,
        host: str = "127.0.0.1",
        port: int = 6510,
        peer: tuple[str, int] | None = None,
        period_s: float = 24e-3,
        T_part_frame: Float | None = None,
        axes: ControllerAxes = AS_MODEL,
        wire: Wire | None = None,
        clock_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._counted = axes
        self.period_s = as_positive("period_s", period_s)
        self._T_part_frame = T_part_frame
        self._T_frame_part = None if T_part_frame is None else pose.inverse(T_part_frame)
        self._port = RobotPort(host, port, LARGEST_DATAGRAM, peer, wire)
        self.counters: Counters = self._port.counters  # See :class:`counterflex.protocols.robot.port.Counters`
        self.elapsed = 0  # Messages from the one before to the newest one, by the sequence number; 0 when none came
        self.restarted = False  # The newest message belongs to another session than the one before
        self.enable = False  # The program runs a movement that can be corrected
        self.holds_feed = True  # Whether there is a word for a feed hold: not in path correction
        self.job = 0
        self.clamped = False  # The controller limits the motion (utilization above 100 %)
        self.force: Float | None = None  # (6,) N, N m that the robot measures itself, of the newest message, or None
        self.commanded_is, self.measured_is = ABSENT, EXACT
        self._state: RobotState | None = None
        self._last: RobotState | None = None
        self._cycle_ms = max(1, round(self.period_s * 1e3))
        self._line = SessionCounter(self._cycle_ms)
        self._cadence: list[float] | None = []
        self._incomplete: int | None = 0
        self._sequence = 0
        self._clock_ns, self._clock_zero = clock_ns, clock_ns()
        self._located = False
        self._q: Float = np.zeros(6)
        self._T_part_actual: Float = np.eye(4)
        self._T_part_planned: Float | None = None

    @property
    def address(self) -> tuple[str, int]:
        """Address at which messages are expected."""
        return self._port.address

    @property
    def counter(self) -> int:
        """Clock of the controller in the newest message, ms; where it sends none, as if it kept its cycle."""
        return self._line.newest if self._state is None or not self._state.time_ms else self._state.time_ms

    @property
    def empty(self) -> bool:
        """No message has said yet where the robot is; one that does not afterwards is malformed."""
        return self._state is None or self._state.q is None or self._state.T_frame_tcp is None

    @property
    def guided(self) -> bool:
        """Motors are on, the program runs, and it is in a movement that takes what we send."""
        state = self._state
        return state is not None and state.motors_on and state.rapid_running and state.guided

    def wait(self, timeout_s: float) -> bool:
        """Wait for a message; see :class:`counterflex.protocols.robot.link.RobotLink`.

        Raises:
            ProtocolError: Messages come in another cycle than the link was told; or the controller's first ones leave
                out what nothing can be corrected without, which is named.
        """
        self.elapsed, self.restarted = 0, False
        received = self._port.wait(timeout_s, self._read)
        if received:
            self._count()
        return received

    def _watch_what_is_there(self, state: RobotState) -> None:
        """Messages that leave out what is needed, before the first whole one."""
        if self._incomplete is None or not state.missing:
            self._incomplete = None
            return
        self._incomplete += 1
        if self._incomplete < _CADENCE:
            return
        raise ProtocolError(
            "the controller's messages leave out what is needed", where=f"{self.address[0]}:{self.address[1]}",
            value=f"no {', '.join(state.missing)}",
            limit="header.seqno, feedBack.joints, feedBack.cartesian and mciState in every message",
            hint="Send the robot's own messages (EGMStreamStart, EGMActMove or EGMActPose), not a shortened copy",
        )  # fmt: skip

    def _read(self, length: int) -> Verdict:
        try:
            state = read_robot(self._port.data[:length].tobytes())
        except ProtocolError:
            return Verdict.MALFORMED
        if self._located and self._lacks(state):
            return Verdict.MALFORMED
        if self._incomplete is not None:
            self._watch_what_is_there(state)
        verdict = self._line.judge(state.sequence * self._cycle_ms)
        if verdict == Verdict.NEW:
            self._state = state
        return verdict

    def _lacks(self, state: RobotState) -> bool:
        """Return whether a message leaves out what those before it had, and what cannot be done without."""
        return state.q is None or state.T_frame_tcp is None

    def _count(self) -> None:
        state, last, counters = self._state, self._last, self.counters
        self.elapsed, self.restarted = self._line.advance()
        counters.lost += self.elapsed - 1
        counters.telegrams += 1
        if state is None:
            return
        if last is not None and not self.restarted:
            self._watch_cadence(last, state)
        self._last = state
        self.enable = self.guided
        self.clamped = state.utilization is not None and state.utilization > 1.0
        self.force = state.force
        if state.q is not None and state.T_frame_tcp is not None:
            self._located = True
            self._q[:] = self._counted.model(state.q)
            self._T_part_actual = self._in_part(state.T_frame_tcp)
            planned = state.T_frame_tcp_planned
            self._T_part_planned = None if planned is None else self._in_part(planned)

    def _watch_cadence(self, last: RobotState, state: RobotState) -> None:
        if self._cadence is None or not last.time_ms or not state.time_ms:
            return
        self._cadence.append(((state.time_ms - last.time_ms) % _WRAP) * 1e-3 / self.elapsed)
        if len(self._cadence) < _CADENCE:
            return
        mean = sum(self._cadence) / len(self._cadence)
        self._cadence = None
        if abs(mean - self.period_s) > 0.2 * self.period_s:
            raise ProtocolError(
                "the controller sends in another cycle", where=f"{self.address[0]}:{self.address[1]}",
                value=f"{mean * 1e3:.1f} ms", limit=f"{self.period_s * 1e3:g} ms",
                hint="Make SampleRate of the RAPID program and period_ms of the table [online] the same",
            )  # fmt: skip

    def _in_part(self, T_frame_tcp: Float) -> Float:
        if self._T_part_frame is None:
            return T_frame_tcp
        T_part_tcp: Float = self._T_part_frame @ T_frame_tcp
        return T_part_tcp

    def fill_actual(self, out: Float) -> bool:
        """Write the pose that the controller reports (encoders, nominal geometry) as measured."""
        put_pose(out, self._T_part_actual)
        return True

    def fill_reported(self, out: Float) -> bool:
        """False: whether the planned pose of a message contains the correction is not documented."""
        del out
        return False

    def fill_currents(self, current: Float) -> bool:
        """False: EGM sends no motor currents; its reference torques come without its path planning only."""
        del current
        return False

    def _numbered(self) -> tuple[int, int]:
        """Sequence number and clock of our next message."""
        sequence = self._sequence
        self._sequence = (self._sequence + 1) % _WRAP
        return sequence, ((self._clock_ns() - self._clock_zero) // 1_000_000) % _WRAP

    def poll(self, period_s: float, most_s: float) -> None:
        """Poll when a telegram is due, see :meth:`RobotPort.poll`."""
        self._port.poll(period_s, most_s)

    def forget(self) -> None:
        """Another session may come from another port of the controller."""
        self._port.forget()

    def close(self) -> None:
        """Free the port."""
        self._port.close()


def put_pose(out: Float, T: Float) -> None:
    """Write a pose (4, 4) into inputs of the step: rotation by rows, position."""
    out[:9] = T[:3, :3].reshape(-1)
    out[9:] = T[:3, 3]


FROZEN: Final = 25
"""Messages with the same six numbers in a row that no living sensor sends."""


class EgmForce:
    """Readings out of the messages of an EGM link, in the axes of the sensor.

    Args:
        link: Whose messages are read; its cycle is that of the force.
        range_n: Largest force that the sensor measures; 95 % of it counts as saturated. None: not watched.
        range_nm: Largest moment, likewise.

    Attributes:
        saturated: It was beyond the range.
        frozen: It has not changed for 25 messages.
    """

    def __init__(self, link: EgmLink, *, range_n: float | None = None, range_nm: float | None = None) -> None:
        self._link = link
        limits = (np.inf if range_n is None else range_n, np.inf if range_nm is None else range_nm)
        self._limit = 0.95 * np.r_[np.full(3, limits[0]), np.full(3, limits[1])]
        self.w_sensor: Float = np.zeros(6)  # (6,) N, N m of the newest message that had a force
        self.samples: Float = np.zeros((1, 6))  # (1, 6) the same
        self.first = -1  # -1: they do not come at 1 kHz
        self.good = 0  # 1 when the newest message had one, else 0
        self.saturated = self.frozen = False
        self._seen = -1
        self._same = 0

    def drain(self) -> int:
        """Take the force of the newest message; returns :attr:`good`."""
        force, telegrams = self._link.force, self._link.counters.telegrams
        self.good = int(force is not None and telegrams != self._seen)
        self._seen = telegrams
        if force is None or not self.good:
            return 0
        self._same = self._same + 1 if np.array_equal(force, self.w_sensor) else 0
        self.frozen = self._same >= FROZEN - 1
        self.saturated = bool(np.any(np.abs(force) > self._limit))
        self.w_sensor[:] = force
        self.samples[0] = force
        return 1

    def close(self) -> None:
        """Nothing to free: the link has the port."""
