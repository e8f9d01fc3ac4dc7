"""One online session: telegram in, sensors drained, step, answer out, record handed over. One cycle is one call.

Order, fixed: drain to the newest, validate, sensors, step, answer, record. What is slow or can fail (files, logging,
printing) is done by other processes.
"""

from __future__ import annotations

import functools
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.jit import compile_stated
from counterflex.protocols.processes.control_array import CONTROL, REQUESTS, Course, Kept, Life, Request
from counterflex.protocols.processes.last_answer import LastAnswer
from counterflex.protocols.robot.link import RobotLink
from counterflex.protocols.session.publisher import THERE, Publisher, RecordWriter, panel_state
from counterflex.protocols.session.senses import Senses, Sensing
from counterflex.protocols.session.shared_status import Teller
from counterflex.protocols.session.standing import SessionChecks as SessionChecks, Standing, begin_held
from counterflex.protocols.session.tare import Tare
from counterflex.protocols.session.telegram_watch import AnotherSession, TelegramWatch, WatchSettings
from counterflex.runtime import record_ring as record
from counterflex.runtime.loop import Loop
from counterflex.runtime.loop_plan import feeds_about
from counterflex.runtime.plausibility.axis_check import ABSENT, AxisCheck
from counterflex.runtime.primitives.causes import yielding
from counterflex.runtime.record_ring import RecordRing
from counterflex.runtime.settings import Output
from counterflex.runtime.state.supervisor import Cause, State

_FORGET_PEER_CYCLES = 250
_IDLE, _READY, _ARMED = int(State.IDLE), int(State.READY), int(State.ARMED)
_STATES = tuple(State)
_RESTARTED, _CLAMPED = int(Cause.SESSION_RESTARTED), int(Cause.CLAMPED_BY_ROBOT)
_INTERNAL, _LOG_LOST, _WRONG_JOB = int(Cause.INTERNAL), int(Cause.LOG_LOST), int(Cause.WRONG_JOB)
_RUN_LOST, _PANEL_LOST, _NOT_CLOSED = int(Cause.RUN_LOST), int(Cause.PANEL_LOST), int(Cause.NOT_CLOSED)
_LOG_LATE_ROWS = 125
"""Records that may wait before the loop is armed: half a second."""
_ARM, _STOP, _RESET = int(Request.ARM), int(Request.STOP), int(Request.RESET)
_TAKEN, _TROUBLE = int(Kept.TAKEN), int(Kept.TROUBLE)
_RUN, _GONE = int(Life.RUN_NS), int(Life.GONE)


_ROOMS: Final = ("core", "robot.elasticity.kernels.batch", "signals", "sensing", "runtime", "protocols", "integrations")
"""Where kernels stand that a session may call."""


def compile_kernels() -> None:
    """Compile every kernel that a session may call, or read it from the cache: no cycle waits for a compilation."""
    compile_stated(*(f"counterflex.{room}" for room in _ROOMS))


def _show_plan(link: RobotLink, loop: Loop) -> None:
    """Give a link that sends in axes of the path the plan's feed directions about the last known place."""
    if loop.planned and hasattr(link, "feeds"):
        link.feeds = functools.partial(feeds_about, loop.records[1], loop.step_state.place)


class OnlineSession:
    """Ties links, sensors and loop together.

    Args:
        sensing: None: nothing but what the robot says.
        ring: Where records go, or None.
        control: Of :class:`Request`, written by the operator's side, and where it is long enough (:data:`CONTROL`) of
            all that :mod:`counterflex.protocols.processes.control_array` says; or None.
        watch: Limits beyond which telegrams are no longer good enough.
        clock_ns: Monotonic clock; time of day is never used.

    Attributes:
        wrench: Makes a process wrench of the force sensor's reading, or None.
        cycles: Telegrams answered or passed over in silence.
        compute_ns: Time of the last cycle from the return of the receive call to the return of the send call.
        trouble: What failed in the loop's own program, or empty; it is a fault until it is reset.
        not_closed: The loop that answered this robot before did not end by itself. Until a person resets, this one is
            not armed, and holds the feed of a program that wants the correction, or cuts.
    """

    _publisher: Publisher | None = None
    _last: LastAnswer | None = None
    _standing: Standing | None = None

    def __init__(
        self,
        link: RobotLink,
        loop: Loop,
        *,
        sensing: Sensing | None = None,
        ring: RecordRing | None = None,
        control: Int | None = None,
        checks: SessionChecks | None = None,
        watch: WatchSettings | None = None,
        clock_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        compile_kernels()
        sensing = Sensing() if sensing is None else sensing
        force, tracker = sensing.force, sensing.tracker
        self.link, self.loop, self.force, self.tracker, self.ring = link, loop, force, tracker, ring
        self.wrench, self._angles = sensing.wrench, sensing.angles
        self._q: Float = loop.given.q
        self._given, self._result = loop.quick_given, loop.quick_result
        self._stand: Float = np.zeros(12)
        self._record = None if ring is None else RecordWriter(ring, link, loop, force)
        self._nominal: Float = loop.given.nominal
        self._reported: Float = loop.given.reported
        self.control: Int = np.zeros(REQUESTS, dtype=np.int64) if control is None else control
        self._checks = checks if checks is not None else SessionChecks()
        self._axes = loop.settings.output == Output.AXES
        self._yielding = yielding(loop.records[0]["settings"][0])
        self.watch = TelegramWatch(loop.settings.period_s, watch)
        self._clock_ns = clock_ns
        self._tare = sensing.tare or Tare(self._checks.force_n, self._checks.moment_nm, keep=self._checks.tare)
        self._senses = Senses(sensing, link, loop, self._tare, self._checks.settle_cycles, clock_ns)
        self._tools = sensing.tools
        self._job = self._checks.job
        silent_s = self._checks.run_silent_s
        self._run_silent_ns = None if silent_s is None else round(silent_s * 1e9)
        self._teller: Teller | None = None
        if len(self.control) >= CONTROL:
            self._teller = Teller(
                self.control,
                loop,
                link.counters,
                self._tare,
                force=force is not None,
                tracker=tracker is not None,
                angles=self._angles,
            )
        self.trouble = ""
        self.not_closed = False
        self._silent_cycles = self._repeated = 0
        self._next = AnotherSession(link.counters)
        self._another, self._answered = False, True
        self._repeat = getattr(link, "repeat", None)  # a link that cannot do it leaves it out
        _show_plan(link, loop)
        self.cycles = self.compute_ns = 0

    def follow(self, last: LastAnswer, *, not_closed: bool) -> None:
        """Go on behind another loop of this robot; before the first cycle.

        Args:
            last: What it answered last; what this one answers is written into it.
            not_closed: It did not end by itself: what it answered last may be in force.
        """
        self._last, self.not_closed = last, not_closed
        streams = hasattr(self.link, "stream")  # a path that is streamed begins anew, and nothing is sent before
        self._standing = Standing(last.before) if not_closed and not streams else None

    @property
    def searches(self) -> bool:
        """True while nothing is answered because the correction that stands at the robot is not known."""
        return self._standing is not None

    @property
    def set_back(self) -> int:
        """Number of times that the tracker's clock was set back."""
        return self._senses.set_back

    @property
    def patience_s(self) -> float:
        """Time to wait for the next telegram: until half a cycle after it is due, then a cycle each."""
        period = self.loop.settings.period_s
        return period if self._silent_cycles else 1.5 * period

    def cycle(self, timeout_s: float) -> bool:
        """Wait for a telegram and handle it.

        Args:
            timeout_s: Longest wait.

        Returns:
            False where none came: the loop has then done a cycle without one, and nothing was sent.
        """
        return self.handle_cycle(self.link.wait(timeout_s))

    def handle_cycle(self, received: bool) -> bool:
        """Handle the telegram that :attr:`link` received, or a cycle in which none was; returns ``received``."""
        link, loop, result, senses = self.link, self.loop, self._result, self._senses
        received_ns = self._clock_ns()
        if self._standing is not None and not self._begin(self._standing, received, received_ns):
            return received
        self._another = self._another or (received and link.restarted)
        answer_due = received
        if received and link.empty:  # says nothing of the robot
            if result.state <= _READY:
                link.answer(loop.correction, loop.axes if self._axes else None)
                return True
            received = False  # once something is in force it stays in force, and is no telegram
        soft, hard = self._take_telegram(received, received_ns)
        soft, new = self._read_senses(received, soft)
        if link.clamped and soft in self._yielding:
            soft = _CLAMPED
        soft, hard = self._watch_program(soft, hard, received_ns)
        if soft == 0 and result.state <= _READY:
            soft = senses.lacking(self.watch.now.good, self.cycles, self._silent_cycles)
        self._fill_flags(received, soft, hard, new)
        loop.run()
        self._serve_requests()
        if received:
            self._answered = not result.silent
        self._reply(answer_due)
        sent = self._clock_ns()
        self.compute_ns = sent - received_ns
        self.cycles += int(received)
        if self._record is not None:
            self._record.write(received_ns, sent)
        self._tell(sent, received_ns, received)
        return received

    def _begin(self, standing: Standing, received: bool, now_ns: int) -> bool:
        """Begin with the correction that stands at the robot, as soon as that is known; before, nothing is answered."""
        link, loop, reported = self.link, self.loop, None
        self._silent_cycles = 0 if received else self._silent_cycles + 1
        if not received:
            standing.silent(self.patience_s)
        elif not link.empty:
            link.fill(self._nominal, self._q)
            reported = self._reported if link.fill_reported(self._reported) else None
            standing.see(link.counter, now_ns, self._nominal, reported, restarted=link.restarted)
        if standing.known:
            self._standing = None
            if standing.correction.any() or standing.axes.any():
                begin_held(loop, standing)
                if self.ring is not None:
                    self.ring.states.put(0, now_ns, loop.memory)
        else:
            self.cycles += int(received)
            self._result.cause = _NOT_CLOSED
            self._tell(now_ns, now_ns, received)
        if len(self.control) >= CONTROL:
            self.control[Course.UNANSWERED] = 0 if standing.known else self.cycles
        return standing.known

    def _take_telegram(self, received: bool, received_ns: int) -> tuple[int, int]:
        """Fill the step's inputs from the telegram; causes of a hold and of a fault that the telegrams give."""
        link, hard = self.link, 0
        self._given.is_reported = 0
        if received:
            if self._another:
                hard, self._another = _RESTARTED, False
            link.fill(self._nominal, self._q)
            self._given.is_reported = int(link.fill_reported(self._reported))
        soft, hard = self._watch_telegrams(received, received_ns, hard)
        if received and self._angles is not None:
            soft = self._watch_angles(self._angles) or soft
        return soft, hard

    def _read_senses(self, received: bool, soft: int) -> tuple[int, int]:
        """Read every sensor; cause of a hold or 0, and 1 where the tracker gave a new pose."""
        senses, new = self._senses, 0
        senses.since += self.link.elapsed if received else 0
        try:
            if self._tools is not None:
                changed = self._tools.watch(self._result.state, self._result.cause, self.loop.place, self._tare)
                soft = soft or changed
            soft = senses.read_force(soft, self.watch.now.good)
            new = senses.read_tracker()
            senses.read_currents(received)
        except Exception as fault:  # whatever it is: the robot is told to stop, not left with what stood last
            self._failed(fault)
        return soft, new

    def _tell(self, sent: int, received_ns: int, received: bool) -> None:
        """Of this cycle, whose answer is out: in shared numbers and as a snapshot."""
        if self._teller is not None:
            self._teller.tell(
                sent,
                received=received,
                cycles=self.cycles,
                clock_jumps=self.watch.now.clock_jumps,
                set_back=self.set_back,
                force_age=self._senses.now.force_age,
                tracker_age=self._senses.now.tracker_age,
                spikes=self._senses.spikes,
            )
        if self._publisher is not None:
            self._publisher.show(
                self._clock_ns(),
                received_ns,
                self.compute_ns,
                cycles=self.cycles,
                elapsed=self._given.elapsed,
                trouble=bool(self.trouble),
            )

    def publish(self, path: Path, about: Mapping[str, Any]) -> Publisher:
        """Show every cycle from now on as a snapshot, see :mod:`counterflex.protocols.processes.snapshot`.

        Args:
            about: What the run is, plain values.

        Raises:
            InputError: No such memory, or ``about`` is too long.
        """
        self._publisher = Publisher(path, about, self.loop, self.link.counters, self.control)
        return self._publisher

    def _serve_requests(self) -> None:
        """Serve the operator's requests that the step has now taken."""
        control = self.control
        if self._result.state >= _ARMED:  # served, or overtaken by what happened: it must not arm later by itself
            control[_ARM] = 0
        if control[_RESET]:
            self._reset()
        self._let_go()
        control[_RESET] = 0

    def _fill_flags(self, received: bool, soft: int, hard: int, new: int) -> None:
        """Write what this cycle knows beside numbers into the inputs of the step."""
        link, given, control = self.link, self._given, self.control
        given.elapsed = link.elapsed if received else 0
        self._senses.fill_ages()
        given.tracker_new, given.healthy = new, self._senses.healthy(self.watch.now.good)
        again = self._tools is not None and self._tools.arms and self._tare.accepted
        given.arm, given.stop = int(control[_ARM] or again), int(control[_STOP])
        given.reset = int(control[_RESET])
        given.enable = int(link.enable) if received else given.enable
        given.soft, given.hard = soft, hard

    def _reply(self, due: bool) -> None:
        """Answer the telegram, or repeat a stop where the protocol does that without one."""
        link, loop, result = self.link, self.loop, self._result
        if due and not result.silent:
            if self._last is not None:
                self._last.put(link.counter, self._clock_ns(), loop.correction, loop.axes)
            try:
                link.answer(
                    loop.correction,
                    loop.axes if self._axes else None,
                    stop=bool(result.stop),
                    feed_hold=bool(result.feed_hold),
                    state=_STATES[result.state],
                    override=loop.monitor.speed,
                )
            except Exception as fault:  # a fault in the next cycle; the controller keeps what it has
                self._failed(fault)
        elif self._repeat is not None:
            self._repeat(
                stop=bool(result.stop),
                feed_hold=bool(result.feed_hold),
                override=loop.monitor.speed,
                state=_STATES[result.state],
                silent=bool(result.silent),
            )

    def _watch_telegrams(self, received: bool, received_ns: int, hard: int) -> tuple[int, int]:
        link, watch = self.link, self.watch
        counters = link.counters
        self._silent_cycles = 0 if received else self._silent_cycles + 1
        if received:
            self._next.heard()
        if not received:
            return watch.silent(counters.malformed_in_a_row)
        if hard == _RESTARTED:
            watch.restart()
        soft, fault = watch.received(
            link.elapsed,
            link.counter,
            received_ns,
            counters.late_at_robot,
            counters.malformed_in_a_row,
            answered=self._answered,
            repeated=counters.repeated - self._repeated,
        )
        self._repeated = counters.repeated
        return soft, hard or fault

    def _watch_angles(self, angles: AxisCheck) -> int:
        """Cause of a hold where angles and poses of the telegram disagree: before a sensor is read by the angles."""
        link = self.link
        measured = link.measured_is != ABSENT and link.fill_actual(self._stand)
        return angles(
            self._q,
            self._nominal,
            self.loop.correction,
            learn=self._result.state <= _READY,
            commanded_is=link.commanded_is,
            measured=self._stand if measured else None,
            measured_is=link.measured_is,
        )

    def _watch_program(self, soft: int, hard: int, now_ns: int) -> tuple[int, int]:
        """Watch this side: the loop's own program, the job, the log, the other processes of the run."""
        armed, resetting = self._result.state > _ARMED, bool(self.control[_RESET])
        if self.trouble and hard == 0 and not resetting:
            hard = _INTERNAL
        if self._job is not None and self.link.job not in (0, self._job):
            if armed:
                hard = hard or _WRONG_JOB
            elif soft in self._yielding:
                soft = _WRONG_JOB
        if len(self.control) >= CONTROL:
            soft = self._watch_processes(soft, armed, now_ns)
        if self.not_closed and (armed or (self._result.state <= _READY and not resetting)):
            soft = _NOT_CLOSED  # before what else keeps it from being armed: the robot may be in the cut
        if self._run_lost(now_ns):
            soft = _RUN_LOST  # before all else: nobody may be there to see what else is wrong
        return soft, hard

    def _watch_processes(self, soft: int, armed: bool, now_ns: int) -> int:
        """Cause of a hold where recorder or panel is lost and ``soft`` yields to it, else ``soft``."""
        if soft in self._yielding and self._log_lost(armed):
            soft = _LOG_LOST
        if soft in self._yielding and self._checks.hold_without_panel and panel_state(self.control, now_ns) != THERE:
            soft = _PANEL_LOST
        return soft

    def _run_lost(self, now_ns: int) -> bool:
        if self._teller is None:
            return False
        last_ns, longest = int(self.control[_RUN]), self._run_silent_ns
        return bool(self.control[_GONE]) or (longest is not None and last_ns != 0 and now_ns - last_ns > longest)

    def _log_lost(self, armed: bool) -> bool:
        control, ring = self.control, self.ring
        if ring is None or (armed and not self._checks.hold_without_log):
            return False
        return bool(control[_TROUBLE]) or ring.count - int(control[_TAKEN]) > (record.MOST if armed else _LOG_LATE_ROWS)

    def _failed(self, fault: Exception) -> None:
        self.trouble = self.trouble or f"{type(fault).__name__}: {fault}"

    def _reset(self) -> None:
        """A person's: out of what was latched here; the sensor's zero is taken again where nothing is corrected."""
        state = self._result.state
        if state <= _READY:
            self.trouble, self.not_closed = "", False
            self._tare.again()

    def _let_go(self) -> None:
        """Another session may come from another port of the controller, as soon as nothing is in effect."""
        state, silent = self._result.state, self._silent_cycles
        if (state == _IDLE and silent >= _FORGET_PEER_CYCLES) or (state <= _ARMED and self._next.port(silent) != 0):
            self.link.forget()

    @property
    def another_port(self) -> int:
        """Port of another session that cannot be answered while something is in effect in this one; 0: none."""
        return self._next.port(self._silent_cycles) if self._result.state > _ARMED else 0
