"""The whole online system on a virtual clock: controller, line, instruments, loop, recorder, panel, people.

The loop's own process runs as it does in a cell (:func:`counterflex.app.run.process.cycle_on`); where it waits for a
telegram, everything else goes on until one arrives::

    cycle_on -> session.cycle -> link.wait -> VirtualWire.receive -> World.wait: all else

No socket, no sleep, no clock of the computer: a story depends on its seed alone.
"""

from __future__ import annotations

import contextlib
import heapq
import itertools
from collections.abc import Callable
from typing import Any, Final

import numpy as np

from counterflex.app.run.process import cycle_on
from counterflex.app.run.recorder import Recorder
from counterflex.app.run.session import RunSettings
from counterflex.core.arrays import Float, Int
from counterflex.core.errors import ProtocolError
from counterflex.protocols.processes.control_array import CONTROL, Kept, Life, Panel, Request
from counterflex.protocols.processes.last_answer import LastAnswer
from counterflex.protocols.session.session import OnlineSession
from counterflex.runtime.record_ring import RecordRing
from counterflex.runtime.state.supervisor import State
from counterflex_lab.composed import bench
from counterflex_lab.composed.cell import KeptLog, Others, opened
from counterflex_lab.composed.controllers import ENDED, Answer, controller_of
from counterflex_lab.composed.disk import DiskLog
from counterflex_lab.composed.holder import Bridges
from counterflex_lab.composed.line import Line
from counterflex_lab.composed.people import People
from counterflex_lab.composed.robot import Robot
from counterflex_lab.composed.story import Active, Fault, Story
from counterflex_lab.composed.wires import VirtualInbox, VirtualWire
from counterflex_lab.devices import FakeEgm, FakeRsi

LOOP_ADDRESS: Final = ("192.168.0.1", 49152)
_ROBOT_HOST: Final = (192 << 24) | (168 << 16) | 10
_STRANGER: Final = ((192 << 24) | (168 << 16) | 99) << 16 | 40000
_START_NS: Final = 1_000_000_000_000
_REPLY_S: Final = 0.2e-3
_STATES: Final = tuple(State)
_CYCLE, _TELEGRAM, _ANSWER = 0, 1, 2
_OLDEST: Final = 6000
"""Telegrams that are kept to be sent again."""
_AGAIN_S: Final = 2.0
"""Until a loop that has ended is started again."""


def _address(peer: int) -> tuple[str, int]:
    return ".".join(str(peer >> shift & 255) for shift in (40, 32, 24, 16)), peer & 0xFFFF


class Over(BaseException):
    """The story is told."""


class Killed(BaseException):
    """The loop's process is killed."""


class World:
    """One cell and what happens to it.

    Args:
        story: What happens.
        looked: Looks at the world at the end of every cycle of the controller.

    Attributes:
        active: Faults that act.
        now_s: Virtual time.
        cycles: Cycles of the controller.
        robot: The machine.
        side: Its controller.
        sends: The controller sends telegrams.
        session: The loop's side, or None while it does not run.
        control: Shared by its processes.
        log: What the recorder has written.
        log_of: Makes the log of a run.
        people: Program and operator.
        age: Cycles since the controller accepted an answer.
        number: Of the controller's session.
        peer: Its address, ``host << 16 | port``.
        disabled: Telegrams in a row without the program's Enable.
        obeyed_other: An answer of another program was accepted in this cycle.
        misdirected: Answers to others than the controller, or an earlier port of it whose telegrams waited: a telegram
            does not say that its session has ended, so the newest of those that are taken together is answered, once.
        compared: Records computed again, of the runs that have ended.
        failed: Exceptions of the loop's program.
        unread: What the logs of the runs that have ended lack.
        differences: What came out otherwise when they were computed again.
        runs: How often the loop was started.
        received_at: When the newest telegram reached the loop's buffer.
    """

    def __init__(self, story: Story, looked: Callable[[World], None]) -> None:
        self.story, self._looked = story, looked
        self.active = Active(story)
        self._rng = np.random.default_rng([story.seed, 1])
        self.period_s = story.period_s
        self._line = Line(self.active, np.random.default_rng([story.seed, 2]), self.period_s)
        self.robot = Robot(
            self.active, np.random.default_rng([story.seed, 3]), self.period_s, measures_axes=story.link != "rsi"
        )
        self._own_force = story.has("force-short")
        self._sampled = story.forced and story.sensor != "egm"
        self._tracked = story.tracked
        self._bridges = None
        if story.has("strain-silent"):
            rng = np.random.default_rng([story.seed, 5])
            self._bridges = Bridges(story.seed, self.active, rng, self.robot.samples_per_cycle)
        self.robot.runs = story.link == "egm-pose"
        self.people = People(self, np.random.default_rng([story.seed, 4]))
        self.side = controller_of(story, self.active, self._rng)
        self.number, self.peer = 0, _ROBOT_HOST << 16 | 30000
        self._at = _address(self.peer)
        self._earlier: dict[tuple[str, int], int] = {}
        self.sends = True
        self.now_s = self._clock_off = self._frozen_until = self.received_at = 0.0
        self.cycles = self.age = self.runs = self.compared = self.disabled = 0
        self.obeyed_other = self._kill = self._not_closed = False
        self.misdirected: list[tuple[str, int]] = []
        self.failed: list[str] = []
        self.unread: list[str] = []
        self.differences: list[str] = []
        self._events: list[tuple[float, int, int, Any]] = []
        self._tie = itertools.count()
        self._arrived: list[Answer] = []
        self._sent: list[bytes] = []
        self._answers: Float = np.zeros((2, 16))
        self.session: OnlineSession | None = None
        self.ring: RecordRing | None = None
        self.recorder: Recorder | None = None
        self.log_of: Callable[[], KeptLog] = lambda: (
            DiskLog(story, self.active, lambda: self.now_s) if story.log == "disk" else KeptLog(story, self.active)
        )
        self.others = Others()
        self._push(0.0, _CYCLE, None)

    # The loop's process.

    def run(self) -> None:
        """Tell the story to its end; whoever ends it before leaves nothing of it, neither memory nor files."""
        try:
            while True:
                self._start()
                try:
                    self._cycle_on()
                except Killed:
                    self._kill, self._not_closed = False, True
                self._end()
                self._until(self.now_s + _AGAIN_S)
        except Over:
            self._end()
        except BaseException:
            self._leave()
            raise

    def _leave(self) -> None:
        with contextlib.ExitStack() as stack:
            stack.enter_context(contextlib.suppress(BufferError))  # of a row that is in use where it was ended
            if self.ring is not None:
                stack.callback(self.ring.close)
            if self.recorder is not None:
                stack.callback(self.recorder.close)
            if self.session is not None:
                stack.callback(self.log.leave)

    def _cycle_on(self) -> None:
        session = self.session
        if session is None:
            return
        settings = RunSettings(cell=bench.CELL, arm=True)
        try:
            ended = cycle_on(session, settings, self.control, self.others, None, self.clock_ns)  # type: ignore[arg-type]
            self.control[Life.ENDED] = 1
            self._not_closed = session.not_closed or not ended
        except ProtocolError as fault:  # told, and the run ends: see loop_process
            if not self.active.begun:
                self.failed.append(f"ends without a fault: {fault}")
        except Exception as fault:
            self.failed.append(f"{type(fault).__name__}: {fault}")

    def _start(self) -> None:
        self.runs += 1
        self.others = Others()
        self.control: Int = np.zeros(CONTROL, dtype=np.int64)
        self.control[Life.MAY_ARM] = 1
        self.ring = ring = RecordRing()
        self.wire = VirtualWire(LOOP_ADDRESS, self.side.largest, self.wait, self._answered, self.clock_ns)
        self.force, self.tracker = VirtualInbox(), VirtualInbox()
        self.session = opened(
            self.story, self.side, self.wire, self.force, self.tracker, ring, self.control, self.clock_ns
        )
        self._answers *= self._not_closed
        self.session.follow(LastAnswer(self._answers), not_closed=self._not_closed)
        self.log = self.log_of()
        self.recorder = Recorder(ring.name, self.log, self.control)  # type: ignore[arg-type]

    def _end(self) -> None:
        if self.session is None:
            return
        self.wire.close()
        if self.recorder is not None:
            if "recorder-stopped" not in self.active.now:
                self.recorder.take()
            self.recorder.close()
        self.log.close()
        self.compared += self.log.replay.compared
        if isinstance(self.log, DiskLog) and self.log.unread:
            self.unread.append(self.log.unread)
        if self.log.replay.difference is not None:
            self.differences.append(str(self.log.replay.difference))
        ring, self.recorder, self.session, self.ring = self.ring, None, None, None
        if ring is not None:
            ring.close()

    def clock_ns(self) -> int:
        """Monotonic clock of the loop's computer."""
        return _START_NS + round((self.now_s + self._clock_off) * 1e9)

    def wait(self, timeout_ns: int) -> None:
        """Let the world go on until a datagram waits for the loop, at most so long; not while its process stands still.

        Raises:
            Over: The story is told.
            Killed: The process is.
        """
        deadline = self.now_s + timeout_ns * 1e-9
        events, waiting = self._events, self.wire.waiting
        while not (waiting and self.now_s >= self._frozen_until):
            latest = self._frozen_until if waiting else max(deadline, self._frozen_until)
            time_s = events[0][0]
            if time_s > latest:
                self.now_s = max(self.now_s, latest)
                return
            self._next()
            if self._kill:
                raise Killed

    def _until(self, end_s: float) -> None:
        """Let the world go on without a loop."""
        while self._events[0][0] <= end_s:
            self._next()
        self.now_s = max(self.now_s, end_s)

    # The line.

    def _push(self, time_s: float, kind: int, what: Any) -> None:
        heapq.heappush(self._events, (time_s, next(self._tie), kind, what))

    def _next(self) -> None:
        time_s, _, kind, what = heapq.heappop(self._events)
        self.now_s = max(self.now_s, time_s)
        if kind == _CYCLE:
            self._cycle()
        elif kind == _ANSWER:
            self._arrived.append(what)
        else:
            data, sender = what
            if self.session is not None:
                self.wire.put(data, sender)
                if sender == self.peer:
                    self.received_at = self.now_s

    def _answered(self, data: bytes, peer: tuple[str, int]) -> None:
        if peer != self._at:
            if self._earlier.get(peer) not in self.wire.taken:
                self.misdirected.append(peer)
            return
        for delay_s, sent in self._line.carried(data, answer=True):
            answer = Answer(sent, self.cycles, int(self.state))
            self._push(self.now_s + _REPLY_S + delay_s, _ANSWER, answer)

    def _telegram(self, data: bytes) -> None:
        now = self.active.now
        for delay_s, sent in self._line.carried(data, answer=False):
            self._push(self.now_s + delay_s, _TELEGRAM, (sent, self.peer))
        if len(self._sent) == _OLDEST:
            del self._sent[: _OLDEST // 2]
        self._sent.append(data)
        if "stranger" in now or "replayed" in now:
            for delay_s, other, strange in self._line.others(self._sent, self._rng):
                what = (self.side.strange(other), _STRANGER) if strange else (other, self.peer)
                self._push(self.now_s + delay_s, _TELEGRAM, what)

    # The controller.

    def restart(self, counter: int, *, port: int | None = None) -> None:
        """The controller begins another session: nothing is in force.

        Args:
            counter: Its first.
            port: It sends from; None keeps it.
        """
        self.side.restart(counter)
        self.number += 1
        self.age = 0
        self.sends = True
        if port is not None:
            self._earlier[self._at] = self.peer
            self.peer = _ROBOT_HOST << 16 | port
            self._at = _address(self.peer)

    def _cycle(self) -> None:
        controller, active = self.controller, self.active
        if self.cycles:
            self._take_answer()
            self._looked(self)
        if self.now_s >= self.story.length_s:
            raise Over
        self.cycles += 1
        for fault in active.advance(self.now_s):
            self._begin(fault)
        now = active.now
        self._drift(now)
        self.people.act()
        controller = self.controller
        self._processes(now)
        stopped = bool(controller.stopped) or not self.sends
        guided = controller.guided_pose()
        if guided is not None and not stopped:
            self.robot.guided(guided[:3, 3])
        else:
            self.robot.move(
                self.correction_m,
                holds=controller.feed_hold,
                stopped=stopped or controller.guides,
                override=controller.override,
            )
        if self.talks and controller.stopped in ("", ENDED):
            enable = self.people.enable(now, self._rng)
            self.disabled = 0 if enable else self.disabled + 1
            if self._own_force:
                self.side.shows_force(self.robot.own_force())
            torque = self.side.drive_torque(int(self.robot.place), self.robot.force)
            report = self.robot.report(self.now_s, torque)
            self._telegram(self.side.telegram(report, enable, self.robot.base_off_m))
        if self.session is not None:
            if self._sampled:
                samples = self.robot.samples() if self._bridges is None else self._bridges.samples(self.robot.force)
                self.force.waiting.extend(samples)
            if self._tracked and (datagram := self.robot.pose(self.now_s)) is not None:
                self.tracker.waiting.append(datagram)
        period = self.period_s * (1.0 + active.size("cycle-drift"))
        self._push(self.now_s + period, _CYCLE, None)

    def _take_answer(self) -> None:
        controller = self.controller
        arrived, self._arrived = self._arrived, []
        self.obeyed_other = False
        if not self.talks or controller.stopped:
            return
        self.obeyed_other = self.side.take(arrived, other="two-senders" in self.active.now)
        self.age = self.age + 1 if controller.refused else 0

    # What happens.

    def _begin(self, fault: Fault) -> None:
        kind = fault.kind
        if kind == "clock-jump":
            self._clock_off += fault.size
        elif kind == "loop-stopped":
            self._frozen_until = max(self._frozen_until, fault.end_s)
        elif kind == "loop-killed":
            self._kill = self.session is not None
        elif kind in ("recorder-killed", "run-killed"):
            self.others.dead = True
            if kind == "recorder-killed" and self.recorder is not None:
                self.recorder.close()
                self.recorder = None
        elif kind == "counter-jump":
            unit = 4 if self.story.link == "rsi" else 1  # RSI counts ms, EGM messages
            self.controller.counter = max(0, self.controller.counter + round(fault.size / 4.0) * unit)
        elif kind == "movement-ended":
            self.controller.stopped = ENDED
        elif kind == "controller-restart":
            self.people.recover(fault.size)
        elif kind.startswith("operator-"):
            self.people.asks(kind.removeprefix("operator-"))

    def _drift(self, now: dict[str, Fault]) -> None:
        if "clock-drift" in now:
            self._clock_off += self.period_s * self.active.size("clock-drift")
        if "loop-starved" in now and self._rng.random() < self.active.size("loop-starved"):
            late = self.period_s * float(self._rng.exponential(0.8))
            self._frozen_until = max(self._frozen_until, self.now_s + late)

    def _processes(self, now: dict[str, Fault]) -> None:
        if self.session is None:
            return
        control, clock = self.control, self.clock_ns()
        if "run-stopped" not in now:
            control[Life.RUN_NS] = clock
        if "panel-gone" not in now:
            control[Panel.NS] = clock
        if self.recorder is not None and "recorder-stopped" not in now:
            control[Life.RECORDER_NS] = clock
            if self.cycles % self.story.poll_cycles == 0:
                self.recorder.take()

    @property
    def state(self) -> State:
        """Of the loop; IDLE while none runs."""
        return State.IDLE if self.session is None else _STATES[self.session.loop.quick_result.state]

    @property
    def talks(self) -> bool:
        """The controller sends telegrams and takes answers: it is neither off nor pauses."""
        return self.sends and "controller-pauses" not in self.active.now

    @property
    def frozen(self) -> bool:
        """The loop's process stands still, or has just begun again."""
        return self.now_s < self._frozen_until + 2.0 * self.period_s

    @property
    def log_trouble(self) -> bool:
        """The loop can see that records are not written."""
        return self.session is not None and bool(self.control[Kept.TROUBLE])

    @property
    def stop_asked(self) -> bool:
        """An operator has asked for a stop."""
        return self.session is not None and bool(self.control[Request.STOP])

    @property
    def correction_m(self) -> Float:
        """(3,) in force at the controller."""
        return self.side.correction_m(int(self.robot.place))

    @property
    def controller(self) -> FakeRsi | FakeEgm:
        """The simulated controller's session."""
        return self.side.device
