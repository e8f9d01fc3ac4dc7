"""The sensor program's side of ABB EGM: what both ways of correcting share. Waits, keeps the newest message, counts."""

from __future__ import annotations

import time
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, as_positive
from counterflex.core.errors import ProtocolError
from counterflex.geometry import pose
from counterflex.links.robot_port import Counters, RobotPort, Verdict
from counterflex.runtime import layout as at
from counterflex.wire.egm import RobotState, read_robot

LARGEST_DATAGRAM: Final = 4096
_WRAP: Final = 1 << 32
_RESTART: Final = 250
"""Messages by which the sequence number may jump ahead within one session."""
_BACK: Final = 10
"""Messages in a row with growing numbers, all older than the newest: the controller counts anew."""
_CADENCE: Final = 16
"""Messages without a gap after which the cycle of the controller is known."""


class EgmLink:
    """One EGM session: receives.

    A message is one cycle: cycles are counted by the sequence number, time by the controller's clock, whose cycle is
    4.032 ms where EGM says 4.

    Args:
        host: Address to listen on; loopback unless told otherwise.
        port: UDP port; 0 a free one.
        peers: Addresses whose messages are taken; None takes the first that comes, and from then on only that one.
        period_s: Time between messages: SampleRate of the RAPID program.
        T_part_frame: (4, 4) frame of the messages in the part frame; None: the program reports in its work object,
            which is the part frame.

    Attributes:
        counters: See :class:`counterflex.links.robot_port.Counters`.
        elapsed: Messages from the one before to the newest one, by the sequence number; 0 when none came.
        restarted: The newest message belongs to another session than the one before.
        enable: The program runs a movement that can be corrected.
        clamped: The controller limits the motion (utilization above 100 %).
        force: (6,) N, N m that the robot measures itself, of the newest message, or None.

    Raises:
        OutputError: The port cannot be bound.
    """

    def __init__(
        self,
        *,
        host: str = "127.0.0.1",
        port: int = 6510,
        peers: tuple[str, ...] | None = None,
        period_s: float = 24e-3,
        T_part_frame: Float | None = None,
    ) -> None:
        self.period_s = as_positive("period_s", period_s)
        self._T_part_frame = T_part_frame
        self._T_frame_part = None if T_part_frame is None else pose.inverse(T_part_frame)
        self._port = RobotPort(host, port, LARGEST_DATAGRAM, peers)
        self.counters: Counters = self._port.counters
        self.elapsed = 0
        self.restarted = False
        self.enable = False
        self.clamped = False
        self.force: Float | None = None
        self._state: RobotState | None = None
        self._last: RobotState | None = None
        self._behind, self._before = 0, -1
        self._cadence: list[float] | None = []
        self._sequence = 0
        self._clock_zero = time.monotonic_ns()
        self._q: Float = np.zeros(6)
        self._T_part_actual: Float = np.eye(4)
        self._T_part_planned: Float | None = None

    @property
    def address(self) -> tuple[str, int]:
        """Where messages are expected."""
        return self._port.address

    @property
    def counter(self) -> int:
        """Clock of the controller in the newest message, ms."""
        return 0 if self._state is None else self._state.time_ms

    @property
    def empty(self) -> bool:
        """The newest message says nothing of where the robot is."""
        return self._state is None or self._state.q is None or self._state.T_frame_tcp is None

    @property
    def guided(self) -> bool:
        """Motors are on, the program runs, and it is in a movement that takes what we send."""
        state = self._state
        return state is not None and state.motors_on and state.rapid_running and state.guided

    def wait(self, timeout_s: float) -> bool:
        """Wait for a message, then take all that are there and keep the newest good one.

        Args:
            timeout_s: Longest wait.

        Returns:
            Whether there is a message to be answered.

        Raises:
            ProtocolError: Messages come in another cycle than the link was told.
        """
        self.elapsed, self.restarted = 0, False
        found = self._port.wait(timeout_s, self._read)
        if found:
            self._count()
        return found

    def _read(self, length: int) -> Verdict:
        try:
            state = read_robot(self._port.data[:length].tobytes())
        except ProtocolError:
            return Verdict.MALFORMED
        if self._state is None:
            self._state = state
            return Verdict.NEW
        step = _step(self._state.sequence, state.sequence)
        if step <= 0 and step > -_RESTART and not self._counts_anew(state):
            return Verdict.OLD
        self._behind, self._before = 0, -1
        self._state = state
        return Verdict.NEW

    def _counts_anew(self, state: RobotState) -> bool:
        """A session that was begun again soon: its clock went on while its numbers went back, or they keep growing."""
        newest = self._state
        if newest is None:
            return False
        if newest.time_ms and state.time_ms and _step(newest.time_ms, state.time_ms) > 0:
            return True
        self._behind = self._behind + 1 if state.sequence > self._before else 0
        self._before = state.sequence
        return self._behind >= _BACK

    def _count(self) -> None:
        state, last, counters = self._state, self._last, self.counters
        if state is None:
            return
        step = 1 if last is None else _step(last.sequence, state.sequence)
        if not 0 < step <= _RESTART:
            step, self.restarted = 1, True
        self.elapsed = step
        counters.lost += step - 1
        counters.telegrams += 1
        if last is not None and not self.restarted:
            self._watch_cadence(last, state, step)
        self._last = state
        self.enable = self.guided
        self.clamped = state.utilization is not None and state.utilization > 1.0
        self.force = state.force
        if state.q is not None and state.T_frame_tcp is not None:
            self._q[:] = state.q
            self._T_part_actual = self._in_part(state.T_frame_tcp)
            planned = state.T_frame_tcp_planned
            self._T_part_planned = None if planned is None else self._in_part(planned)

    def _watch_cadence(self, last: RobotState, state: RobotState, step: int) -> None:
        if self._cadence is None or not last.time_ms or not state.time_ms:
            return
        self._cadence.append(_step(last.time_ms, state.time_ms) * 1e-3 / step)
        if len(self._cadence) < _CADENCE:
            return
        found = sum(self._cadence) / len(self._cadence)
        self._cadence = None
        if abs(found - self.period_s) > 0.2 * self.period_s:
            raise ProtocolError(
                "the controller sends in another cycle",
                where=f"{self.address[0]}:{self.address[1]}",
                value=f"{found * 1e3:.1f} ms",
                limit=f"{self.period_s * 1e3:g} ms",
                hint="Make SampleRate of the RAPID program and period_ms of the table [online] the same",
            )

    def _in_part(self, T_frame_tcp: Float) -> Float:
        if self._T_part_frame is None:
            return T_frame_tcp
        T_part_tcp: Float = self._T_part_frame @ T_frame_tcp
        return T_part_tcp

    def fill_actual(self, given: Float) -> bool:
        """Write the pose that the controller reports (encoders, nominal geometry) as measured."""
        put_pose(given, at.G_ACTUAL, self._T_part_actual)
        return True

    def _numbered(self) -> tuple[int, int]:
        """Sequence number and clock of our next message."""
        sequence = self._sequence
        self._sequence = (self._sequence + 1) % _WRAP
        return sequence, ((time.monotonic_ns() - self._clock_zero) // 1_000_000) % _WRAP

    def close(self) -> None:
        """Free the port."""
        self._port.close()


def put_pose(given: Float, place: int, T: Float) -> None:
    """Write a pose (4, 4) into inputs of the step: rotation by rows, position."""
    given[place : place + 9] = T[:3, :3].reshape(-1)
    given[place + 9 : place + 12] = T[:3, 3]


def _step(before: int, after: int) -> int:
    """Difference of two 32-bit counters that wrap around."""
    return (after - before + _WRAP // 2) % _WRAP - _WRAP // 2
