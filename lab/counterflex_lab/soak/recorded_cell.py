"""A cell that works for hours in real time and costs little: a recorded pass, played there and back on real sockets.

Every millisecond a force record and a pose, every 4 ms a telegram; the answers are timed and act on what is reported.
Halfway between two telegrams a datagram of the same length can go to a program that only sends it back: how long that
takes says what the machine and its network stack need by themselves, at the same time and under the same load. The
robot program obeys a feed hold, and is started again when it was stopped
(:mod:`counterflex_lab.soak.played_program`).
"""

from __future__ import annotations

import contextlib
import select
import socket
import time
from collections import deque
from collections.abc import Callable
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import MM, MS
from counterflex.protocols.tracker.telegram import DATAGRAM, MAGIC
from counterflex.twin.devices.commanded_motion import PlayedController
from counterflex.twin.devices.force_device import ForceDevice
from counterflex.twin.devices.path_answer import AnswerState, PathAnswer
from counterflex.twin.live.live_cell import Report
from counterflex_lab.soak.played_program import Phase, PlayedProgram
from counterflex_lab.soak.recorded_pass import SAMPLES, RecordedPass
from counterflex_lab.soak.timed_block import NOT_REPORTED, Block, Times

_ECHO_AT: Final = 2
"""Millisecond of the cycle at which the echo is asked."""
GATE: Final = 1500
"""Cycles for which the robot stands at the beginning of the pass; then its program enables the correction."""
_SCATTERED: Final = 4099
_W_SCATTER: Final = np.array([0.1, 0.1, 0.1, 0.01, 0.01, 0.01])
"""N and N m, beside the noise of the pass."""
_P_SCATTER_M: Final = 2e-6
_LATEST: Final = 0.5
"""Of a cycle: what is due longer ago is not sent any more. A controller keeps its time: nobody has answered it then."""
_SESSION_MS: Final = 60_000
"""By how much the counter of another session is ahead."""


class ReplayedCell:
    """The played cell.

    Args:
        controller: Its side of the protocol, 4 ms.
        sensor: Sends the force readings, or None.
        answer: How the controller answers a correction.
    """

    def __init__(
        self,
        played: RecordedPass,
        controller: PlayedController,
        sensor: ForceDevice | None = None,
        answer: PathAnswer | None = None,
        program: PlayedProgram | None = None,
    ) -> None:
        self.played, self.controller, self.sensor = played, controller, sensor
        self.program = program if program is not None else PlayedProgram(GATE)
        self._answer = AnswerState(answer if answer is not None else PathAnswer(), controller.cycle_s)
        self._sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(3)]
        self._robot, self._echo, self._tracker = self._sockets
        for one in (self._robot, self._echo):
            one.bind(("127.0.0.1", 0))
        for one in self._sockets:
            one.setblocking(False)
        self._sequence = self._readings = 0
        rng = np.random.default_rng(0)
        self._w_scatter: Float = rng.standard_normal((_SCATTERED, 6)) * _W_SCATTER
        self._p_scatter: Float = rng.standard_normal((_SCATTERED, 3)) * _P_SCATTER_M
        self._moved: Float = np.zeros(3)
        self._largest = 0.0
        self._refused = 0
        self._due = self._time_s = 0.0
        self._places = deque([0] * (played.lag + 1), played.lag + 1)  # where the robot is, it is late
        self._stamp_zero_ns = time.monotonic_ns() - round(time.perf_counter() * 1e9)

    def run(
        self,
        peer: tuple[str, int],
        cycles: int,
        *,
        tracker: tuple[str, int] | None = None,
        echo: tuple[str, int] | None = None,
        block: int = 15_000,
        on_block: Callable[[Block], None] = lambda _: None,
        ended: Callable[[], bool] = lambda: False,
    ) -> None:
        """Play in real time; another call goes on where the last one ended.

        Args:
            peer: Where telegrams go.
            cycles: How many of 4 ms.
            tracker: Where poses go, or None.
            echo: Where the datagram goes that is sent back, or None.
            block: Cycles that are told together.
            on_block: Told every block, the last one shorter.
            ended: Asked after each cycle whether it is the last one.
        """
        period = self.controller.cycle_s
        times = Times(block)
        begin = due = max(self._due, time.perf_counter())
        for k in range(cycles):
            running, held_before = self.program.phase != Phase.ENDED, self.program.held_cycles
            row, telegram = self._prepared(running=running)
            late_s = _until(due)
            missed = int(late_s / period + 1.0 - _LATEST)
            if missed > 0:
                self._miss(missed, running=running)
                times.missed += missed
                due += missed * period
                row, telegram = self._prepared(running=running)
                _until(due)
            if self.sensor is not None and k % 250 == 0:
                self.sensor.poll()
            self._instruments(row, 0, tracker, due)
            data, reply_s, echo_s, woken_s = self._millisecond_by_millisecond(
                row, telegram, due, peer if running else None, tracker, echo
            )
            if running:
                times.add(reply_s, echo_s, late_s, max(late_s, woken_s), self._take(data))
                why = self._go_on(answered=data is not None)
                if why:
                    times.ended.append((time.perf_counter() - begin, why))
                    self._another_session()
            else:
                times.paused += 1
                self.program.cycle(NOT_REPORTED, answered=False, feed_hold=False, stopped="")
            times.held_cycles += self.program.held_cycles - held_before
            self._due = due = due + period
            self._time_s += period
            last = k == cycles - 1 or ended()
            if (k + 1) % block == 0 or last:
                on_block(times.block(self._largest, self.refused))
                times = Times(block)
            if last:
                return

    def _millisecond_by_millisecond(
        self,
        row: int,
        telegram: bytes,
        due: float,
        peer: tuple[str, int] | None,
        tracker: tuple[str, int] | None,
        echo: tuple[str, int] | None,
    ) -> tuple[bytes | None, float, float, float]:
        """Send the telegram, unless ``peer`` is None, and further readings, and wait for the answer between them."""
        # Returns the answer or None, how long it took, how long the echo took, and the latest waking, s.
        data: bytes | None = None
        reply_s, echo_s, woken_s = np.nan, np.nan, 0.0
        answers, sent = self.controller.answers, time.perf_counter()
        if peer is not None:
            _send(self._robot, telegram, peer)
        for tick in range(SAMPLES):
            end = due + (tick + 1) * MS
            if data is None and peer is not None:
                data, reply_s = self._await(self._robot, sent, end - 0.1 * MS, answers)
            if tick == SAMPLES - 1:
                break
            woken_s = max(woken_s, _until(end))
            self._instruments(row, tick + 1, tracker, end)
            if echo is not None and peer is not None and tick + 1 == _ECHO_AT:
                echo_s = self._echoed(telegram, echo, end + 0.9 * MS, answers)
        return data, reply_s, echo_s, woken_s

    @property
    def refused(self) -> int:
        """Answers that the controller did not take, since the start, over all sessions."""
        return self._refused + self.controller.late

    def _take(self, data: bytes | None) -> int:
        """Let the controller have an answer; what the sensor program said in it."""
        self.controller.answer(data)
        self._take_in()
        return NOT_REPORTED if self.controller.refused else self.controller.reported_state

    def _take_in(self) -> None:
        """Let the controller apply its correction for a cycle."""
        in_force = self._answer(self.controller.pose_correction())
        self._moved = self.played.R_tracker_part @ in_force[:3]
        self._largest = max(self._largest, float(np.max(np.abs(in_force[:3]))))

    def _go_on(self, *, answered: bool) -> str:
        one = self.controller
        return self.program.cycle(one.reported_state, answered=answered, feed_hold=one.feed_hold, stopped=one.stopped)

    def _another_session(self) -> None:
        """The program was ended: no correction is in effect any more."""
        self._refused += self.controller.late
        self.controller = self.controller.again(_SESSION_MS)
        self._answer.reset()
        self._places.extend([0] * len(self._places))
        self._moved = np.zeros(3)

    def _miss(self, cycles: int, *, running: bool) -> None:
        """The robot went on while this machine stood still: its counters too, and no answer came."""
        # The first of these telegrams has been made already, and the next one counts on by itself.
        self._time_s += cycles * self.controller.cycle_s
        if running:
            self.controller.counter += round((cycles - 1) * self.controller.cycle_s / MS)
            self.controller.late += cycles
            for _ in range(cycles):  # what was corrected last is held meanwhile, and goes on being answered
                self._take_in()
            before = self.program.place
            self.program.go_on(cycles)
            self._places.extend(min(before + k, self.program.place) for k in range(1, cycles))

    def _prepared(self, *, running: bool) -> tuple[int, bytes]:
        """Row of the pass that robot and instruments show, and the telegram."""
        self._places.append(self.program.place)
        commanded, row = self.played.there_and_back(self._places[-1]), self.played.reached(self._places[0])
        self.controller.enabled = self.program.enabled
        return row, self._telegram(commanded, row) if running else b""

    def _telegram(self, commanded: int, row: int) -> bytes:
        played = self.played
        T_part_actual = played.T_part_actual[row].copy()
        T_part_actual[:3, 3] += self._answer.value[:3]
        report = Report(
            time_s=self._time_s,
            T_part_nominal=played.T_part_nominal[commanded],
            T_part_actual=T_part_actual,
            q_command=played.q_command[commanded],
            q_actual=played.q_actual[row],
            cutting_program=True,
            finished=False,
        )
        return self.controller.telegram(report)

    def _instruments(self, row: int, tick: int, tracker: tuple[str, int] | None, due: float) -> None:
        """Readings of a millisecond: no two are the same, also while the robot stands and its row is played again."""
        # A pose is stamped with the time at which it is measured, however late this machine sends it.
        k = self._readings = (self._readings + 1) % _SCATTERED
        if self.sensor is not None:
            self.sensor.send(self.played.w_sensor[row, tick] + self._w_scatter[k])
        if tracker is not None:
            self._sequence = (self._sequence + 1) & 0xFFFFFFFF
            p = (self.played.p_tracker_target[row, tick] + self._moved + self._p_scatter[k]) / MM
            quat = self.played.quat_wxyz[row, tick]
            stamp = self._stamp_zero_ns + round(due * 1e9)
            _send(self._tracker, DATAGRAM.pack(MAGIC, self._sequence, stamp, 0, 0, *p, *quat, 0.015), tracker)

    def _echoed(self, telegram: bytes, echo: tuple[str, int], end: float, answers: Callable[[bytes], bool]) -> float:
        """Send a telegram to who only sends it back; how long that took, s."""
        sent = time.perf_counter()
        _send(self._echo, telegram, echo)
        return self._await(self._echo, sent, end, answers)[1]

    @staticmethod
    def _await(
        own: socket.socket, sent: float, end: float, answers: Callable[[bytes], bool]
    ) -> tuple[bytes | None, float]:
        """Wait for the datagram that answers: it and its age, or None and not-a-number."""
        while (remaining := end - time.perf_counter()) > 0.0:
            if not select.select([own], [], [], remaining)[0]:
                break
            try:
                data = own.recv(65536)
            except (BlockingIOError, ConnectionError):
                continue
            now = time.perf_counter()
            if answers(data):
                return data, now - sent
        return None, np.nan

    def close(self) -> None:
        """Free the sockets."""
        for one in self._sockets:
            one.close()
        if self.sensor is not None:
            self.sensor.close()


def _until(due: float) -> float:
    """Sleep until then; how much later it is, s."""
    remaining = due - time.perf_counter()
    if remaining > 0.0:
        time.sleep(remaining)
    return time.perf_counter() - due


def _send(own: socket.socket, data: bytes, peer: tuple[str, int]) -> None:
    with contextlib.suppress(BlockingIOError, ConnectionError):
        own.sendto(data, peer)
