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

from counterflex.core.array_table import ArrayTable
from counterflex.core.arrays import Float, Int
from counterflex.core.entry_calls import address_of
from counterflex.core.jit import compile_stated
from counterflex.core.records import attributes, records
from counterflex.protocols.processes.control_array import CONTROL, REQUESTS, Course
from counterflex.protocols.processes.last_answer import LastAnswer
from counterflex.protocols.robot.link import RobotLink
from counterflex.protocols.session import cycle_kernel as own
from counterflex.protocols.session.publisher import Publisher, RecordWriter
from counterflex.protocols.session.senses import Senses, Sensing
from counterflex.protocols.session.shared_status import Teller
from counterflex.protocols.session.standing import SessionChecks as SessionChecks, Standing, begin_held
from counterflex.protocols.session.tare import Tare
from counterflex.protocols.session.telegram_watch import AnotherSession, TelegramWatch, WatchSettings
from counterflex.protocols.session.whole import WholeCycle, whole_cycle
from counterflex.protocols.session.whole_kernel import ANSWERED
from counterflex.runtime.cycle import cycle
from counterflex.runtime.loop import Loop
from counterflex.runtime.loop_plan import feeds_about
from counterflex.runtime.plausibility.axis_check import ABSENT, AxisCheck
from counterflex.runtime.plausibility.axis_check_kernel import ARRAYS as ANGLES, angles_agree
from counterflex.runtime.record_ring import RecordRing
from counterflex.runtime.sensing.sensor_wrench import SensorWrench
from counterflex.runtime.settings import Output
from counterflex.runtime.state.supervisor import Cause, State

_FORGET_PEER_CYCLES = 250
_IDLE, _READY, _ARMED = int(State.IDLE), int(State.READY), int(State.ARMED)
_STATES = tuple(State)
_NOT_CLOSED = int(Cause.NOT_CLOSED)
_AS_BEFORE = _NO_LOG = _NOT_TESTED = -1
"""For a kernel: Enable of the telegram before; there is no log; a job or a silence that is not tested."""

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
        self.watch = TelegramWatch(loop.settings.period_s, watch)
        self._clock_ns = clock_ns
        self._tare = sensing.tare or Tare(self._checks.force_n, self._checks.moment_nm, keep=self._checks.tare)
        self._senses = Senses(sensing, link, loop, self._tare, self._checks.settle_cycles, clock_ns)
        self._tools = sensing.tools
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
        self._repeated = 0
        self._sessions = records(own.SESSION)
        self._now: Any = attributes(self._sessions)
        self._begin_numbers()
        table = self._table()
        self._rows = table.rows
        tables = [table, self._senses.table, loop.table]
        tables += [one.table for one in (self._angles, sensing.wrench) if isinstance(one, AxisCheck | SensorWrench)]
        self._whole = whole_cycle(link, sensing, tables, clock_ns, direct=self._senses.at_once, axes=self._axes)
        self._next = AnotherSession(link.counters)
        self._another, self._answered = False, True
        self._repeat = getattr(link, "repeat", None)  # a link that cannot do it leaves it out
        _show_plan(link, loop)
        self.compute_ns = 0

    def _begin_numbers(self) -> None:
        """Write what the kernels of a cycle are set to."""
        now, checks, senses = self._now, self._checks, self._senses
        now.settle, now.tracker_stale = checks.settle_cycles, senses.tracker_stale
        now.needs_tracker, now.angles = int(senses.needs_tracker), int(self._angles is not None)
        now.job = _NOT_TESTED if checks.job is None else checks.job
        now.run_silent_ns = _NOT_TESTED if checks.run_silent_s is None else round(checks.run_silent_s * 1e9)
        now.hold_without_log, now.hold_without_panel = int(checks.hold_without_log), int(checks.hold_without_panel)
        now.shared = int(len(self.control) >= CONTROL)
        now.run, now.agree = address_of(cycle), address_of(angles_agree)

    def _table(self) -> ArrayTable:
        """Arrays of the kernels of a cycle."""
        loops, loop_rows = self.loop.rows
        return ArrayTable(
            own.ARRAYS,
            session=self._sessions,
            senses=self._senses.records,
            watch=self.watch.records,
            loop=loops,
            loop_table=loop_rows,
            axes=records(ANGLES) if self._angles is None else self._angles.table.rows,
            stand=self._stand,
            control=self.control,
        )

    @property
    def cycles(self) -> int:
        """Telegrams answered or passed over in silence."""
        return int(self._now.cycles)

    def follow(self, last: LastAnswer, *, not_closed: bool) -> None:
        """Go on behind another loop of this robot; before the first cycle.

        Args:
            last: What it answered last; what this one answers is written into it.
            not_closed: It did not end by itself: what it answered last may be in force.
        """
        self._last, self.not_closed = last, not_closed
        if self._whole is not None:
            self._whole.keep(last)
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
        return period if self._now.silent_cycles else 1.5 * period

    def cycle(self, timeout_s: float) -> bool:
        """Wait for a telegram and handle it.

        Returns:
            False where none came: the loop has then done a cycle without one, and nothing was sent.
        """
        whole = self._whole
        if whole is None or not self._usual():
            return self.handle_cycle(self.link.wait(timeout_s))
        end_ns = self._clock_ns() + int(timeout_s * 1e9)
        self._prepare(whole.now)
        count = whole.run(timeout_s)
        if count == ANSWERED:
            self._take_over(whole)
            return True
        return self.handle_cycle(whole.link.wait(max(0, end_ns - self._clock_ns()) * 1e-9, count))

    def _usual(self) -> bool:
        """Return whether nothing but a telegram of the session is awaited that Python would have to look at."""
        taken = self.force is None or self._tare.accepted
        return taken and self._standing is None and not self._another and not self.trouble

    def _prepare(self, now: Any) -> None:
        """Write what the one call of a cycle is to know before it."""
        counters, tare = self.link.counters, self._tare
        now.written = _NO_LOG if self.ring is None else self.ring.count
        now.repeated, now.answered = counters.repeated - self._repeated, int(self._answered)
        now.not_closed, now.zero_known, now.refusals = int(self.not_closed), int(tare.accepted), tare.refusals
        now.zero_ns = self._senses.time_zero_ns

    def _take_over(self, whole: WholeCycle) -> None:
        """Go on behind the one call of a cycle, whose answer is out, as behind the same cycle in steps."""
        link, now, result, drained = whole.link, whole.now, self._result, whole.drained
        link.elapsed, link.restarted = 0, False
        link.take()
        self._next.heard()
        self._repeated = link.counters.repeated
        self._senses.since += link.elapsed
        if self.force is not None:
            whole.force.take(drained.good, drained.first, bool(drained.saturated), bool(drained.frozen))
        self._serve_requests(bool(now.reset))
        self._answered = not result.silent
        if result.silent:
            self._reply(False)
        else:
            link.answered(self.loop.correction, self.loop.axes if self._axes else None, **self._words())
        self.compute_ns = now.sent_ns - now.received_ns
        self._hand_over(now.received_ns, now.sent_ns, True)

    def handle_cycle(self, received: bool) -> bool:
        """Handle the telegram that :attr:`link` received, or a cycle in which none was; returns ``received``."""
        link, loop, result = self.link, self.loop, self._result
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
        self._take_telegram(received, received_ns)
        self._read_senses(received)
        self._serve_requests(self._decide(received, received_ns))
        if received:
            self._answered = not result.silent
        self._reply(answer_due)
        sent = self._clock_ns()
        self.compute_ns = sent - received_ns
        self._hand_over(received_ns, sent, received)
        return received

    def _hand_over(self, received_ns: int, sent: int, received: bool) -> None:
        """Record and tell a cycle whose answer is out."""
        self._now.cycles += int(received)
        if self._record is not None:
            self._record.write(received_ns, sent)
        self._tell(sent, received_ns, received)

    def _begin(self, standing: Standing, received: bool, now_ns: int) -> bool:
        """Begin with the correction that stands at the robot, as soon as that is known; before, nothing is answered."""
        link, loop, reported = self.link, self.loop, None
        self._now.silent_cycles = 0 if received else self._now.silent_cycles + 1
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
            self._now.cycles += int(received)
            self._result.cause = _NOT_CLOSED
            self._tell(now_ns, now_ns, received)
        if len(self.control) >= CONTROL:
            self.control[Course.UNANSWERED] = 0 if standing.known else self.cycles
        return standing.known

    def _take_telegram(self, received: bool, received_ns: int) -> None:
        """Fill the step's inputs from the telegram, and judge it; causes of a hold and of a fault are written."""
        link, counters = self.link, self.link.counters
        self._given.is_reported = 0
        if not received:
            own.judge_silence(self._rows, counters.malformed_in_a_row)
            return
        self._next.heard()
        link.fill(self._nominal, self._q)
        self._given.is_reported = int(link.fill_reported(self._reported))
        another, self._another = self._another, False
        measured_is = ABSENT if self._angles is None else link.measured_is
        if measured_is != ABSENT and not link.fill_actual(self._stand):
            measured_is = ABSENT
        own.judge(
            self._rows,
            another,
            link.elapsed,
            received_ns - link.counter * 1_000_000,
            counters.late_at_robot,
            counters.malformed_in_a_row,
            counters.repeated - self._repeated,
            self._answered,
            link.commanded_is,
            measured_is,
        )
        self._repeated = counters.repeated

    def _read_senses(self, received: bool) -> None:
        """Read every sensor; causes of a hold are written."""
        senses = self._senses
        senses.since += self.link.elapsed if received else 0
        self._given.tracker_new = 0
        try:
            if self._tools is not None:
                changed = self._tools.watch(self._result.state, self._result.cause, self.loop.place, self._tare)
                senses.now.soft = senses.now.soft or changed
            senses.read_force(self.watch.now.good)
            self._given.tracker_new = senses.read_tracker()
            senses.read_currents(received)
        except Exception as fault:  # whatever it is: the robot is told to stop, not left with what stood last
            self._failed(fault)

    def _decide(self, received: bool, received_ns: int) -> bool:
        """Take what was found together, and do the step; returns whether a person has asked to reset."""
        link, ring, tare = self.link, self.ring, self._tare
        return own.decide(
            self._rows,
            received_ns,
            _NO_LOG if ring is None else ring.count,
            link.elapsed if received else 0,
            int(link.enable) if received else _AS_BEFORE,
            link.job,
            link.clamped,
            bool(self.trouble),
            self.not_closed,
            tare.accepted,
            self._tools is not None and self._tools.arms and tare.accepted,
        )

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

    def _serve_requests(self, reset: bool) -> None:
        """Serve the operator's requests that the step has now taken."""
        if reset:
            self._reset()
        if self._now.silent_cycles:
            self._let_go()

    def _reply(self, due: bool) -> None:
        """Answer the telegram, or repeat a stop where the protocol does that without one."""
        link, loop, result = self.link, self.loop, self._result
        if due and not result.silent:
            if self._last is not None:
                self._last.put(link.counter, self._clock_ns(), loop.correction, loop.axes)
            try:
                link.answer(loop.correction, loop.axes if self._axes else None, **self._words())
            except Exception as fault:  # a fault in the next cycle; the controller keeps what it has
                self._failed(fault)
        elif self._repeat is not None:
            self._repeat(**self._words(), silent=bool(result.silent))

    def _words(self) -> dict[str, Any]:
        """Words of an answer beside the correction."""
        result = self._result
        return {
            "stop": bool(result.stop),
            "feed_hold": bool(result.feed_hold),
            "override": self.loop.monitor.speed,
            "state": _STATES[result.state],
        }

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
        state, silent = self._result.state, self._now.silent_cycles
        if (state == _IDLE and silent >= _FORGET_PEER_CYCLES) or (state <= _ARMED and self._next.port(silent) != 0):
            self.link.forget()

    @property
    def another_port(self) -> int:
        """Port of another session that cannot be answered while something is in effect in this one; 0: none."""
        return self._next.port(self._now.silent_cycles) if self._result.state > _ARMED else 0
