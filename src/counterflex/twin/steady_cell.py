"""A cell that works for hours in real time and costs little: a recorded pass, played there and back on real sockets.

Every millisecond a force record and a pose, every 4 ms a telegram; the answers are timed and act on what is reported.
Halfway between two telegrams a datagram of the same length can go to a program that only sends it back: how long that
takes says what the machine and its network stack need by themselves, at the same time and under the same load.
"""

from __future__ import annotations

import contextlib
import select
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import MM, MS
from counterflex.twin.fake_rsi import FakeRsi
from counterflex.twin.live_cell import Report
from counterflex.twin.netft_server import NetftServer
from counterflex.twin.path_answer import AnswerState, PathAnswer
from counterflex.twin.recorded_pass import SAMPLES, RecordedPass
from counterflex.wire.tracker_pose import DATAGRAM, MAGIC

_ECHO_AT: Final = 2
"""Millisecond of the cycle at which the echo is asked."""
GATE: Final = 1500
"""Cycles for which the robot stands at the beginning of the pass; then its program enables the correction."""


@dataclass(frozen=True, eq=False)
class Block:
    """What was timed in a number of cycles.

    Attributes:
        reply_s: (n,) from sending a telegram to having its answer; not-a-number where none came within the cycle.
        echo_s: (n,) the same of the datagram that is only sent back.
        late_s: (n,) how late this side sent the telegram.
        largest_m: Largest correction in force.
        refused: Answers that the controller did not take, since the start.
    """

    reply_s: Float
    echo_s: Float
    late_s: Float
    largest_m: float
    refused: int


class SteadyCell:
    """The played cell.

    Args:
        played: What is played.
        rsi: The controller's side of RSI, 4 ms.
        netft: Where force readings go, or None.
        answer: How the controller answers a correction.
    """

    def __init__(
        self, played: RecordedPass, rsi: FakeRsi, netft: NetftServer | None = None, answer: PathAnswer | None = None
    ) -> None:
        self.played, self.rsi, self.netft = played, rsi, netft
        self._answer = AnswerState(answer if answer is not None else PathAnswer(), rsi.context.cycle_s)
        self._sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(3)]
        self._robot, self._echo, self._tracker = self._sockets
        for one in (self._robot, self._echo):
            one.bind(("127.0.0.1", 0))
        for one in self._sockets:
            one.setblocking(False)
        self._sequence = 0
        self._moved: Float = np.zeros(3)

    def run(
        self,
        peer: tuple[str, int],
        cycles: int,
        *,
        tracker: tuple[str, int] | None = None,
        echo: tuple[str, int] | None = None,
        block: int = 15_000,
        told: Callable[[Block], None] = lambda _: None,
    ) -> str:
        """Play in real time.

        Args:
            peer: Where telegrams go.
            cycles: How many of 4 ms.
            tracker: Where poses go, or None.
            echo: Where the datagram goes that is sent back, or None.
            block: Cycles that are told together.
            told: Told every block, the last one shorter.

        Returns:
            ``finished``, or why the controller stopped.
        """
        period = self.rsi.context.cycle_s
        reply, back, late = (np.full(block, np.nan) for _ in range(3))
        largest = 0.0
        begin = time.perf_counter() + period
        for k in range(cycles):
            i = k % block
            row = self.played.there_and_back(max(0, k - GATE))
            self.rsi.frees["Enable"] = float(k >= GATE)
            telegram = self._telegram(row, k)
            due = begin + k * period
            _until(due)
            if self.netft is not None and k % 250 == 0:
                self.netft.poll()
            self._instruments(row, 0, tracker)
            data: bytes | None = None
            sent = time.perf_counter()
            late[i] = sent - due
            _send(self._robot, telegram, peer)
            for tick in range(SAMPLES):
                end = due + (tick + 1) * MS
                if data is None:
                    data, reply[i] = self._await(self._robot, sent, end - 0.1 * MS, f"<IPOC>{self.rsi.counter}</IPOC>")
                if tick == SAMPLES - 1:
                    break
                _until(end)
                self._instruments(row, tick + 1, tracker)
                if echo is not None and tick + 1 == _ECHO_AT:
                    asked = time.perf_counter()
                    _send(self._echo, telegram, echo)
                    _, back[i] = self._await(self._echo, asked, end + 0.9 * MS, f"<IPOC>{self.rsi.counter}</IPOC>")
            self.rsi.answer(data)
            in_force = self._answer(self.rsi.pose_correction())
            self._moved = self.played.R_tracker_part @ in_force[:3]
            largest = max(largest, float(np.max(np.abs(in_force[:3]))))
            if i == block - 1 or k == cycles - 1 or self.rsi.stopped:
                told(Block(reply[: i + 1].copy(), back[: i + 1].copy(), late[: i + 1].copy(), largest, self.rsi.late))
                for times in (reply, back, late):
                    times[:] = np.nan
            if self.rsi.stopped:
                return self.rsi.stopped
        return "finished"

    def _telegram(self, row: int, k: int) -> bytes:
        played = self.played
        T_part_actual = played.T_part_actual[row].copy()
        T_part_actual[:3, 3] += self._answer.value[:3]
        report = Report(
            time_s=k * self.rsi.context.cycle_s,
            T_part_nominal=played.T_part_nominal[row],
            T_part_actual=T_part_actual,
            q_command=played.q_command[row],
            q_actual=played.q_actual[row],
            cutting_program=True,
            finished=False,
        )
        return self.rsi.telegram(report)

    def _instruments(self, row: int, tick: int, tracker: tuple[str, int] | None) -> None:
        if self.netft is not None:
            self.netft.send(self.played.w_sensor[row, tick])
        if tracker is not None:
            self._sequence = (self._sequence + 1) & 0xFFFFFFFF
            p = (self.played.p_tracker_target[row, tick] + self._moved) / MM
            quat = self.played.quat_wxyz[row, tick]
            now = time.monotonic_ns()
            _send(self._tracker, DATAGRAM.pack(MAGIC, self._sequence, now, 0, 0, *p, *quat, 0.015), tracker)

    @staticmethod
    def _await(own: socket.socket, asked: float, end: float, mark: str) -> tuple[bytes | None, float]:
        """Wait for the datagram that holds a mark: it and its age, or None and not-a-number."""
        wanted = mark.encode("ascii")
        while (left := end - time.perf_counter()) > 0.0:
            if not select.select([own], [], [], left)[0]:
                break
            try:
                data = own.recv(65536)
            except (BlockingIOError, ConnectionError):
                continue
            now = time.perf_counter()
            if wanted in data:
                return data, now - asked
        return None, np.nan

    def close(self) -> None:
        """Free the sockets."""
        for one in self._sockets:
            one.close()
        if self.netft is not None:
            self.netft.close()


def _until(due: float) -> None:
    left = due - time.perf_counter()
    if left > 0.0:
        time.sleep(left)


def _send(own: socket.socket, data: bytes, peer: tuple[str, int]) -> None:
    with contextlib.suppress(BlockingIOError, ConnectionError):
        own.sendto(data, peer)
