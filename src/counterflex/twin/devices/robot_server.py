"""A simulated controller on a real socket: it sends every cycle and applies what comes back.

Two ways of keeping time. *Lockstep*: after every telegram it waits for the answer, as long as ``patience_s``; as fast
as both sides can, and the same result every time. *Real time*: a telegram every cycle by the clock; what has not come
when the next is due is late.
"""

from __future__ import annotations

import contextlib
import math
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError, OutputError, SimulationError
from counterflex.core.jit import compile_stated
from counterflex.core.progress import Progress, silent
from counterflex.twin.devices.commanded_motion import Report, RobotController
from counterflex.twin.devices.exact_robot import ControlledRobot
from counterflex.twin.network.faults import FaultSchedule, FaultyLine

FAULTS: Final = ("silent", "dying", "counter")
"""Faults of the instrument itself that the controller can show."""
_AGAIN_S: Final = 0.05
_MOST_REFUSED: Final = 200
"""Telegrams in a row to a port that is closed before the sensor program counts as gone; a controller's own time-out
comes first."""
_LONGEST_ALONE_S: Final = 15.0  # Lockstep: likewise, without an answer for so long
_LATEST: Final = 0.5  # of a cycle: with less left for an answer, cycles are counted anew


@dataclass(frozen=True, eq=False)
class CycleSeen:
    """One cycle as the controller saw it."""

    cycle: int  # from 0
    counter: int  # of its telegram
    sent: bool  # the telegram left unharmed
    reply_s: float  # from sending to the answer, NaN without one
    refused: str  # why no answer was accepted, or empty
    late: int  # answers that were late or refused so far
    stat: int  # 0, 1 correcting, 2 limited
    correction: Float  # (6,) Cartesian correction in force as the protocol has it, m and rad
    axes: Float  # (6,) axis correction in force, rad
    report: Report  # what the controller reported


@dataclass(frozen=True)
class Timing:
    """Clock of a simulated controller, and its longest waits."""

    realtime: bool = False  # keep real time; else lockstep
    # how long it waits for the sensor program to be there, as a robot program does before RSI_ON; 0 does not wait
    wait_s: float = 60.0
    # for which the program waits after the session began, so that everything can settle; the robot program enables the
    # correction at their end
    gate_s: float = 0.6
    # real time: how long an answer may take; None is the whole cycle (a KR C2 leaves 10 of 12 ms)
    answer_s: float | None = None
    patience_s: float = 5.0  # lockstep: how long an answer may take
    # lockstep: longest time, by the controller's clock, for which the feed may be held in one piece
    most_held_s: float = 60.0


class RobotServer:
    """Runs a robot behind the protocol of its controller until its program has ended.

    Args:
        robot: The robot; its cycle divides that of the protocol.
        controller: Its side of the protocol.
        peer: Where telegrams go: host and port of the sensor program.
        faults: Scripted, by the time since the first cycle and the numbers of telegrams and answers.
        observe: Told every cycle.

    Attributes:
        cycles: Telegrams sent.
        stalls: Real time: how often this computer was too slow and a telegram left late.
        stop_reason: Why it ended: ``finished``, ``cycles``, ``died``, ``no more answers from the sensor program``, or
            what stopped the controller.
    """

    def __init__(
        self,
        robot: ControlledRobot,
        controller: RobotController,
        peer: tuple[str, int],
        *,
        timing: Timing | None = None,
        faults: FaultSchedule | None = None,
        observe: Callable[[CycleSeen], None] | None = None,
    ) -> None:
        self._period_s = controller.cycle_s
        self._per_telegram = round(self._period_s / robot.period_s)
        if self._per_telegram < 1 or abs(self._period_s - self._per_telegram * robot.period_s) > 1e-9:
            raise InputError(
                "cycle of the protocol is no multiple of the cell's", value=controller.cycle_s, limit=robot.period_s
            )
        timing = Timing() if timing is None else timing
        answer_s = timing.answer_s
        if answer_s is not None and not 0.0 < answer_s <= self._period_s:
            raise InputError("time for an answer", value=answer_s, limit=f"> 0 and <= {self._period_s:g} s")
        self.robot, self.controller, self.peer = robot, controller, peer
        self.timing, self.gate_cycles = timing, round(timing.gate_s / self._period_s)
        self._held_cycles = 0
        self._met = self._alone = False
        self._refused, self._waited_s = 0, 0.0
        self.cycles = 0
        self.stop_reason = ""
        self.stalls = 0
        self._answer_s = self._period_s if answer_s is None else answer_s
        self._faults = faults if faults is not None else FaultSchedule()
        self._faults.require(FAULTS, "a robot controller")
        self._out, self._in = FaultyLine(self._faults, "out"), FaultyLine(self._faults, "in")
        self._observe = observe
        self._step = 0
        self._sent_at = self._reply_s = math.nan
        self._unharmed = False
        compile_stated(
            "counterflex.core", "counterflex.protocols", "counterflex.integrations"
        )  # no cycle waits for a compilation
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1" if peer[0] in ("127.0.0.1", "localhost") else "0.0.0.0", 0))
        self.address: tuple[str, int] = self._socket.getsockname()
        self._due = time.perf_counter()

    def poll(self) -> None:
        """Called before every cycle, and while waiting for the sensor program."""

    def run(self, *, after: int = 50, most_cycles: int | None = None, progress: Progress = silent) -> str:
        """Run until the program has ended, the controller has stopped, or the cycles are used up.

        Args:
            after: Cycles that go on after the end of the program.
            progress: Progress callback, fraction 0 to 1.

        Returns:
            :attr:`stop_reason`.

        Raises:
            OutputError: As :meth:`meet`, where that was not called before.
            SimulationError: In lockstep the sensor program holds the feed, and nobody gives it free.
        """
        if not self._met:
            self.meet()
        rest = after
        total = self.robot.cycles / self._per_telegram
        self._due = time.perf_counter()
        while most_cycles is None or self.cycles < most_cycles:
            if self.cycles == self.gate_cycles:
                self.robot.start()
            waits = self.robot.finished or getattr(self.robot, "changing", False)
            self.controller.enabled = self.cycles >= self.gate_cycles and not waits
            self.poll()
            condition = self._faults.condition(self.cycles, self.cycles * self._period_s)
            if condition.dead:
                self.stop_reason = "died"
                return self.stop_reason
            feed_held = (self.controller.feed_hold and self.cycles > self.gate_cycles) or condition.silent
            self._require_progress(feed_held)
            report = self._advance(feed_held)
            self.controller.counter += condition.step - self._step
            self._step = condition.step
            self.exchange(self.controller.telegram(report), silent=condition.silent)
            self._tell(report)
            self.cycles += 1
            if self.cycles % 250 == 0:
                progress(min(0.99, self.cycles / total), "milling")
            if self.controller.stopped:
                self.stop_reason = self.controller.stopped
                return self.stop_reason
            if self._alone:
                self.stop_reason = "no more answers from the sensor program"
                return self.stop_reason
            if report.finished:
                rest -= 1
                if rest <= 0:
                    self.stop_reason = "finished"
                    return self.stop_reason
        self.stop_reason = "cycles"
        return self.stop_reason

    def _require_progress(self, feed_held: bool) -> None:
        """A real robot waits for a person; a simulated one that nobody watches must come to an end."""
        self._held_cycles = self._held_cycles + 1 if feed_held else 0
        if not self.timing.realtime and self._held_cycles * self._period_s > self.timing.most_held_s:
            raise SimulationError(
                f"the sensor program has held the feed for {self.timing.most_held_s:g} s, and nobody gives it free",
                where=f"telegram {self.cycles}",
                hint="The run log says why: counterflex log show. A hold by process monitoring waits for counterflex "
                "operator reset; [monitor] says which events hold",
            )

    def _advance(self, feed_held: bool) -> Report:
        """The cycles of the robot until the next telegram."""
        controller = self.controller
        override = 0.0 if feed_held else controller.override
        correction, guided = controller.pose_correction(), controller.guided_pose()
        for _ in range(self._per_telegram):
            report = self.robot.advance(correction, controller.axes, override, guided)
        return report

    def meet(self) -> None:
        """Send telegrams of a robot that stands until the sensor program answers; nothing moves, no cycle is counted.

        Raises:
            OutputError: It does not within ``wait_s``.
        """
        self._met = True
        if self.timing.wait_s <= 0.0 or self.controller.only_sends:
            return
        end = time.perf_counter() + self.timing.wait_s
        nothing = np.zeros(6)
        report = self.robot.advance(nothing)
        self._socket.settimeout(0.1)
        while time.perf_counter() < end:
            self.poll()
            self._send(self.controller.telegram(report))
            try:
                self._socket.recv(65536)
            except TimeoutError:
                continue
            except ConnectionError:  # its port is closed
                time.sleep(_AGAIN_S)
                continue
            return
        raise OutputError(
            "no sensor program answers",
            where=f"{self.peer[0]}:{self.peer[1]}",
            value=f"nothing for {self.timing.wait_s:g} s",
            hint="Start it first, for example counterflex run with the same address and port",
        )

    def exchange(self, telegram: bytes, *, silent: bool = False) -> None:
        """Send a telegram and take what comes until the cycle is over.

        Args:
            silent: It is not sent, and nothing is expected.
        """
        now_s = self.cycles * self._period_s
        self._reply_s, self._unharmed = math.nan, False
        self._sent_at = time.perf_counter()
        self._due += self._period_s
        if self.timing.realtime and self._due - self._sent_at < _LATEST * self._period_s:
            self._due = self._sent_at + self._period_s  # a controller never hurries to catch up
            self.stalls += 1
        if not silent:
            self._out.put(telegram, now_s, partial(self._deliver, telegram))
        answer = self._wait_realtime(now_s) if self.timing.realtime else self._wait_lockstep(now_s)
        if not silent:
            self.controller.answer(answer)

    def _deliver(self, telegram: bytes, data: bytes) -> None:
        self._unharmed |= data == telegram
        self._send(data)

    def _send(self, data: bytes) -> None:
        with contextlib.suppress(ConnectionError):
            self._socket.sendto(data, self.peer)

    def _wait_lockstep(self, now_s: float) -> bytes | None:
        """Wait for the answer to this cycle's telegram, if that went out: faults of the way are known at both ends."""
        datagrams: list[bytes] = []
        self._in.release(now_s, datagrams.append)
        if not self._unharmed or self.controller.only_sends:
            return datagrams[-1] if datagrams else None
        begin = time.perf_counter()
        while (remaining := begin + self.timing.patience_s - time.perf_counter()) > 0.0:
            self._socket.settimeout(remaining)
            try:
                data = self._socket.recv(65536)
            except TimeoutError:
                break
            except ConnectionError:
                self._refused += 1
                break
            self._refused = 0
            if self.controller.answers(data):
                self._reply_s = time.perf_counter() - self._sent_at
                self._in.put(data, now_s, datagrams.append)
                begin, self._waited_s = time.perf_counter(), 0.0
                break
        self._waited_s += time.perf_counter() - begin
        self._alone = self._refused >= _MOST_REFUSED or self._waited_s >= _LONGEST_ALONE_S
        return datagrams[-1] if datagrams else None

    def _wait_realtime(self, now_s: float) -> bytes | None:
        datagrams: list[bytes] = []
        window = self._due - self._period_s + self._answer_s
        while (remaining := self._due - time.perf_counter()) > 0.0:
            if time.perf_counter() > window:
                time.sleep(remaining)  # what comes now is late, and waits in the socket
                break
            self._out.release(self._elapsed(now_s), self._send)
            self._in.release(self._elapsed(now_s), datagrams.append)
            pending = min(self._out.due_s(), self._in.due_s()) - self._elapsed(now_s)
            self._socket.settimeout(max(min(remaining, window - time.perf_counter(), pending), 1e-5))
            try:
                data = self._socket.recv(65536)
            except (TimeoutError, ConnectionError):
                continue
            self._reply_s = time.perf_counter() - self._sent_at
            self._in.put(data, self._elapsed(now_s), datagrams.append)
        if self._answer_s >= self._period_s:
            self._take_waiting(self._elapsed(now_s), datagrams)
        return datagrams[-1] if datagrams else None

    def _elapsed(self, now_s: float) -> float:
        """Simulated time in real time: that of the cycle's begin and what has passed since."""
        return now_s + max(0.0, time.perf_counter() - (self._due - self._period_s))

    def _take_waiting(self, now_s: float, datagrams: list[bytes]) -> None:
        """Take what came while this process itself was held up: it is not late."""
        self._socket.setblocking(False)
        while True:
            try:
                data = self._socket.recv(65536)
            except BlockingIOError:
                return
            except ConnectionError:
                continue
            self._reply_s = time.perf_counter() - self._sent_at
            self._in.put(data, now_s, datagrams.append)

    def _tell(self, report: Report) -> None:
        if self._observe is None:
            return
        controller = self.controller
        self._observe(
            CycleSeen(
                cycle=self.cycles,
                counter=controller.counter,
                sent=self._unharmed,
                reply_s=self._reply_s,
                refused=controller.refused,
                late=controller.late,
                stat=controller.stat,
                correction=controller.correction,
                axes=controller.axes,
                report=report,
            )
        )

    def close(self) -> None:
        """Free the socket."""
        self._socket.close()
