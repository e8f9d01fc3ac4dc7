"""Rules that hold in every cycle whatever happens, checked at the controller against what is true.

A rule is broken once per story and named with the cycle in which it was.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import MM
from counterflex.protocols.processes.control_array import Kept, Life, Panel
from counterflex.runtime.primitives.causes import can_yield
from counterflex.runtime.state.states import Cause, State
from counterflex.runtime.step.place import FAULT_LOST
from counterflex_lab.composed import bench
from counterflex_lab.composed.controllers import STRANGE_M
from counterflex_lab.composed.kinds import ALWAYS, KINDS
from counterflex_lab.composed.robot import follow
from counterflex_lab.composed.story import Story
from counterflex_lab.composed.world import World

Point: TypeAlias = list[float]
"""Three coordinates in m: numbers of Python, as arrays of three take longer."""
SPEED_M_S: Final = 20.0 * MM
"""Of the correction."""
_MADE_UP: Final = 5
"""Cycles of its motion that a step contains at most, after telegrams or answers were lost."""
LARGEST_M: Final = 2.0 * MM
_ROUNDED_M: Final = 0.4e-6
"""Four decimal places of a millimetre, three coordinates, two values."""
_ROUNDED_AXES_M: Final = 20e-6
"""Four decimal places of a degree, at an arm of two metres, six axes."""
_BRAKED_S: Final = 16e-3
"""Until the correction comes to rest from its largest speed."""
_VISIBLE: Final = 2
_LATE_CYCLES: Final = 5
"""Cycles without a telegram from which the loop must not correct any more: 3 of the watch, and two."""
_DEBOUNCED: Final = 7
_STALE: Final = 10
"""Cycles without a force from which a loop that needs one must not correct any more: 3, and what a slow sensor leaves
out."""
_BRIDGED_S: Final = 80e-3
"""For which it goes on by the plan."""
_RUN_SILENT_NS: Final = 80_000_000
_PANEL_SILENT_NS: Final = 1_000_000_000
_UNCORRECTED: Final = 7
"""Cycles until a program that cuts on uncorrected is held: the debounced Enable."""
_UNCORRECTED_S: Final = 20e-3
"""Until then the robot brakes."""
_UNPLANNED_S: Final = 52e-3
"""Later, where no plan tells of the cut: its filtered force does."""
_MISSING_M: Final = 0.7 * MM
_MISSING_S: Final = 1.2
_LEFT: Final = 0.5
"""Share of the deflection across the path that may remain in a cut without any fault, beside what the cell's
compliances do not have: force alone cannot know of that. Chosen; 0.21 was the most that lag and noise left."""
_SETTLED_S: Final = 1.0
"""From the entry on: the force rises for 0.16 s, the correction takes 0.3 s."""
_CLEAN: Final = 30
"""Cycles from which a line is taken to be without faults again."""
_BELIEVED: Final = 25
"""Cycles until a counter that jumped is believed: 8 telegrams."""
_MOVES_M_S: Final = 1e-3
_RADIUS_M: Final = 15.0 * MM
"""Of the arcs, on which the path frame of EGM turns."""
_OBEYS_RAD_S: Final = 2.0 * np.pi * 4.0
_PLACES: Final = 64
"""Cycles for which the robot's places are known: more than an answer is late."""
_SPOILED: Final = 2
"""Motions that are not the path's, of one pose that is wrong."""
_POSES: Final = frozenset(("message-damaged", "message-short"))
"""Faults whose messages show another pose, or none."""
_PANEL, _GONE, _RUN, _TROUBLE = int(Panel.NS), int(Life.GONE), int(Life.RUN_NS), int(Kept.TROUBLE)
_STATES: Final = tuple(State)
_NAMES: Final = {state: state.name for state in State}
_CAUSES: Final = {int(cause): cause for cause in Cause}


@dataclass(frozen=True)
class Broken:
    """A rule that did not hold.

    Attributes:
        rule: Its name.
        at_s: When.
        words: What was seen against what may be.
    """

    rule: str
    at_s: float
    words: str


class Invariants:
    """Looks at a world, cycle by cycle.

    Args:
        story: Told in it.

    Attributes:
        broken: Rules that did not hold, each once.
        states: Cycles in each state.
        incidents: Cause by which the correction ended, how often.
    """

    def __init__(self, story: Story) -> None:
        period = self._period_s = story.period_s
        self._rounded = _ROUNDED_AXES_M if story.mode.endswith("axes") else _ROUNDED_M
        self._step_m = SPEED_M_S * period
        self._braked = 3 + math.ceil(_BRAKED_S / period)
        uncorrected_s = _UNCORRECTED_S + (0.0 if story.planned else _UNPLANNED_S)
        self._most_uncorrected = _UNCORRECTED + math.ceil(uncorrected_s / period)
        self._most_missing = round(_MISSING_S / period)
        self._stale = _STALE + round(_BRIDGED_S / period)
        slow = story.mode == "integrator"  # which goes on by a share per cycle
        self._settled = round(_SETTLED_S / (4e-3 if slow else period))
        self._sent = self._told = 0
        self.broken: dict[str, Broken] = {}
        self.states: dict[str, int] = {}
        self.incidents: dict[str, int] = {}
        self._places: deque[int] = deque(maxlen=_PLACES)
        self._shows = self._old = 0
        self._base_off = False
        self._before: Point = [0.0, 0.0, 0.0]
        self._own: Point = [0.0, 0.0, 0.0]
        self._nominal: Float = np.zeros(12)
        self._cycles = 0
        self._number = 0
        self._state = State.IDLE
        self._cause = 0
        self._in_state = 0
        self._runs = 0
        self._since: dict[str, int] = {}
        self._cycle = 0
        self._uncorrected = self._missing = self._clean = self._silent = self._cutting = 0
        self._model: Point = [0.0, 0.0, 0.0]
        self._rate: Point = [0.0, 0.0, 0.0]
        self._stand: Float = np.zeros(12)
        self._last_active_s = 0.0
        self._acted = False
        self._yielding = frozenset({0})
        # What depends on the story alone.
        self._by_rsi, self._by_path = story.link == "rsi", story.link == "egm-path"
        self._planned, self._forced = story.planned, story.forced
        self._needs_force = story.mode.startswith(("measured", "pilot", "scale"))
        self._log_holds, self._panel_holds = story.without_log == "hold", story.without_panel == "hold"

    def __call__(self, world: World) -> None:
        """Look at the end of a cycle of the controller."""
        correction: Point = world.correction_m.tolist()
        self._watch_frame(world)
        self._step(world, correction)
        session = world.session
        if session is None:
            self._state, self._in_state = State.IDLE, 0
            self._before = correction
            self._number = world.number
            return
        if world.runs != self._runs:
            self._runs, self._since, self._state, self._in_state = world.runs, {}, State.IDLE, 0
            settings = session.loop.records[0]["settings"][0]
            self._yielding = frozenset({0, *(int(cause) for cause in Cause if can_yield(settings, int(cause)))})
            self._nominal = session.loop.given.nominal
            self._acted = False
        result = session.loop.quick_result
        state = _STATES[result.state]
        name = _NAMES[state]
        self.states[name] = self.states.get(name, 0) + 1
        self._in_state = self._in_state + 1 if state == self._state else 0
        self._by_state(world, state, correction)
        self._causes(world, state)
        self._visible(world, state)
        self._senders(world)
        unarmed = not self._by_rsi and (result.stop == 1 or state < State.ARMED)  # EGM stops by silence
        self._answers(world, result.silent == 1 or unarmed or session.searches)
        self._in_the_cut(world, state)
        self._obeyed(world, state, correction)
        self._corrects(world, state)
        if session.trouble:
            self._break("no exception", world, session.trouble)
        difference = world.log.replay.difference
        if difference is not None:
            self._break("replays bit for bit", world, f"{difference}")
        if state == State.ACTIVE:
            self._last_active_s, self._acted = world.now_s, True
        self._state, self._cause = state, int(result.cause)
        self._before = correction
        self._number = world.number

    def end(self, world: World) -> None:
        """Look at the end of the story."""
        for rule, problems in (
            ("no exception", world.failed),
            ("what is written can be read", world.unread),
            ("replays bit for bit", world.differences),
        ):
            if problems:
                self._break(rule, world, problems[0])
        faults = world.story.faults
        for_ever = any(fault.kind == "plan-deeper" for fault in faults)
        end_s = min(world.now_s, world.story.length_s)  # earlier where it was interrupted
        quiet_s = end_s - max((fault.end_s for fault in faults), default=0.0)
        again_s = world.story.quiet_s
        if not for_ever and quiet_s > again_s - 0.1 and self._last_active_s < end_s - again_s:
            self._break(
                "corrects again",
                world,
                f"last active at {self._last_active_s:.2f} s, no fault in the last {quiet_s:.2f} s",
            )

    def _break(self, rule: str, world: World, words: str) -> None:
        if rule not in self.broken:
            self.broken[rule] = Broken(rule, round(world.now_s, 4), words)

    def _step(self, world: World, correction: Point) -> None:
        """At the controller: no step from one answer of the loop to its next beyond the limiter's; no size.

        Answers of another program between them are not the loop's: it neither sees nor continues them.
        """
        size = _size(correction)
        if size > LARGEST_M + self._rounded:
            self._break("within its limit", world, f"{size / MM:.4f} mm > {LARGEST_M / MM:g} mm")
        self._cycles += 1
        if world.number != self._number:
            self._before, self._own, self._cycles, self._sent = [0.0, 0.0, 0.0], correction, 0, 0
            return
        if not world.side.corrects:
            self._own, self._cycles = correction, 0
            return
        if world.obeyed_other or world.age > 0:
            return
        cycles = min(_MADE_UP, self._cycles)
        if not self._by_rsi:  # it takes any answer, however late: what may have changed since that was sent
            sent = world.side.accepted.cycle if world.side.accepted is not None else 0
            cycles, self._sent = max(1, abs(sent - self._sent)), sent
        step = math.dist(correction, self._own)
        most = self._step_m * cycles + self._turns(world, size, max(cycles, self._cycles)) + self._rounded
        self._own, self._cycles = correction, 0
        if step > most:
            self._break("no step", world, f"{step / MM:.4f} mm > {most / MM:.4f} mm")

    def _watch_frame(self, world: World) -> None:
        """Count the cycles by which the sender's path frame may be older than the controller's.

        A message that is lost shows no motion, one whose pose is wrong shows two that are; the frame follows behind
        them in one answer.
        """
        self._places.append(int(world.robot.place))
        before, self._base_off = self._base_off, "base-off" in world.active.now
        whole = world.age == 0 and _POSES.isdisjoint(world.active.now) and before == self._base_off
        self._shows = self._shows + 1 if whole else 0
        self._old = 0 if self._shows > _SPOILED else min(FAULT_LOST, self._old + (not whole))

    def _turns(self, world: World, size: float, cycles: int) -> float:
        """By how much a correction turns in some cycles with the path frame of EGM, the controller's and the sender's.

        Sent is what of the whole correction c lies square to the path, ``y (c . y)``. Where the path turns by a, and x
        along it with y, this changes by ``x (c . y) + y (c . x)`` times a: by ``|c| a``, even where nothing of c lies
        across. The tangent is that between two messages, so a is that of the program from one motion before the oldest
        message to here. Of a guided robot the part across the path is seen, segment by segment, from where it was sent.
        """
        if self._by_rsi or (not self._by_path and world.robot.cuts):  # the cuts are straight, and begin behind the arcs
            return 0.0
        whole = size if world.session is None else max(size, _size(world.session.loop.correction[:3].tolist()))
        if self._by_path:
            back = max(cycles, 1 + self._old) + 2
            first, here = self._places[max(0, len(self._places) - back)] - 1, self._places[-1] + 1
            one, other = bench.feeds()[[max(0, first), min(here, world.robot.last)]]
            return whole * math.acos(min(1.0, float(one @ other)))
        way = world.robot.speed * self._period_s
        return whole * (way + bench.SPACING_M) / _RADIUS_M * cycles if way > 0.0 else 0.0

    def _by_state(self, world: World, state: State, correction: Point) -> None:
        """What is sent in each state: zero, at rest, or towards zero."""
        if world.age > 0 or world.controller.stopped or not world.sends or world.obeyed_other:
            self._in_state = 0
            return
        told, self._told = self._told, world.side.reported_state
        if told != int(state) or self._told != int(state):
            return
        size, before = _size(correction), _size(self._before)
        rounded = self._rounded + self._turns(world, size, 1)
        if state <= State.ARMED and size > rounded:
            self._break("zero unless it acts", world, f"{size / MM:.4f} mm in {state.name}")
        if self._in_state < self._braked or world.number != self._number:
            return
        moved = math.dist(correction, self._before)
        if state in (State.HOLD, State.FAULT) and moved > rounded:
            self._break("at rest in hold", world, f"moved by {moved / MM:.4f} mm in {state.name}")
        if state == State.RAMP_OUT and size > before + rounded:
            self._break("ramp goes to zero", world, f"{before / MM:.4f} to {size / MM:.4f} mm")

    def _causes(self, world: World, state: State) -> None:
        """One cause, and one that is true."""
        session = world.session
        if session is None:
            return
        cause = _CAUSES[session.loop.quick_result.cause]
        if state in (State.HOLD, State.RAMP_OUT, State.FAULT):
            if cause == Cause.NONE:
                self._break("a cause is told", world, f"{state.name} without a cause")
            if state != self._state and self._state == State.ACTIVE:
                key = cause.name.lower()
                self.incidents[key] = self.incidents.get(key, 0) + 1
            goes_on = self._state in (State.HOLD, State.RAMP_OUT, State.FAULT) and int(cause) == self._cause
            if not goes_on and cause not in self._true(world):
                kinds = ", ".join(world.active.begun) or "nothing"
                self._break("the true cause", world, f"{state.name} by {cause.name} after {kinds}")
            held = self._cause != int(Cause.PROGRAM)  # the ordinary end of a program is no hold, and may become one
            if held and int(cause) != self._cause and self._state == state and state != State.FAULT:
                self._break("one cause", world, f"{Cause(self._cause).name} became {cause.name} in {state.name}")

    def _true(self, world: World) -> frozenset[Cause]:
        cannot_hold = {"ignores-hold"} if self._by_path else set()
        causes = set(_allowed(frozenset(world.active.begun) | cannot_hold))
        causes.update(*(KINDS[kind].acting for kind in world.active.now))
        if world.story.tracked:
            causes.update(*(KINDS[kind].tracked for kind in world.active.begun))
        return frozenset(causes)

    def _visible(self, world: World, state: State) -> None:
        """Out of ACTIVE within two cycles of what the loop can see."""
        session = world.session
        if session is None:
            return
        control, clock, since, line = world.control, world.clock_ns(), self._since, "no telegrams"
        given = session.loop.quick_given
        late = world.now_s - world.received_at > _LATE_CYCLES * self._period_s
        panel_silent = clock - int(control[_PANEL]) > _PANEL_SILENT_NS
        seen = (
            ("a stop", world.stop_asked and given.elapsed > 0, _VISIBLE),
            ("a dead process", bool(control[_GONE]), _VISIBLE),
            ("a silent run", clock - int(control[_RUN]) > _RUN_SILENT_NS, _VISIBLE),
            ("a lost log", self._log_holds and bool(control[_TROUBLE]), _VISIBLE),
            ("a lost panel", self._panel_holds and panel_silent, _VISIBLE),
            ("a cause", given.hard != 0 or given.soft not in self._yielding, _VISIBLE),
            (line, late, _VISIBLE),
            ("no Enable", world.disabled > 0 and given.elapsed > 0, _DEBOUNCED),
            ("no force", self._needs_force and not _SILENT.isdisjoint(world.active.now), self._stale),
        )
        cycle = session.cycles
        if world.frozen:
            since.pop(line, None)
        elif late:
            self._silent = world.cycles if line not in since else self._silent
            silent = world.cycles - self._silent
            if state == State.ACTIVE and silent > _VISIBLE:
                self._break("reacts to no telegrams", world, f"ACTIVE {silent} cycles after it, {_VISIBLE} may be")
        for what, there, within in seen:
            if not there:
                if what in since:
                    del since[what]
                continue
            first = since.setdefault(what, cycle)
            if state == State.ACTIVE and cycle - first > within:
                self._break(f"reacts to {what}", world, f"ACTIVE {cycle - first} cycles after it, {within} may be")
        if state in (State.ARMED, State.ACTIVE) and self._state < State.ARMED and control[_TROUBLE]:
            self._break("not armed without a log", world, f"{state.name} with trouble {int(control[_TROUBLE])}")

    def _senders(self, world: World) -> None:
        """Never two senders obeyed, and only the controller answered."""
        session = world.session
        if session is None:
            return
        if world.misdirected:
            self._break("one sender", world, f"answered {world.misdirected[0]}")
            world.misdirected.clear()
        session.link.fill_actual(self._stand)
        own = "message-damaged" not in world.active.begun  # which may stand for any number
        if own and max(self._nominal[9], self._stand[9]) > STRANGE_M / 2.0:
            self._break("one sender", world, "a stranger's pose came into the loop")

    def _answers(self, world: World, silent: bool) -> None:
        """Over a line without faults every telegram is answered in its cycle, also where old ones come in between."""
        disturbed = not _UNDISTURBED.issuperset(world.active.now) or bool(world.people.off_s) or silent
        disturbed |= world.now_s - world.active.begun.get("counter-jump", -1.0) < _BELIEVED * self._period_s
        at_work = (
            world.sends and not world.controller.stopped and world.session is not None and world.session.cycles > 9
        )
        self._clean = 0 if disturbed or not at_work else self._clean + 1
        if self._clean > _CLEAN and world.age > 1:
            self._break("every telegram is answered", world, f"{world.age} cycles without an answer in time")

    def _in_the_cut(self, world: World, state: State) -> None:
        """A program that goes on in the cut is corrected, or it is held or stopped."""
        if not world.talks:  # no answer reaches it: neither counted nor forgotten
            return
        robot = world.robot
        goes_on = robot.speed > _MOVES_M_S and robot.cuts and world.people.running and world.age == 0
        if (
            goes_on
            and self._tells(world)
            and not world.side.held
            and state not in (State.ACTIVE, State.HOLD, State.FAULT)
        ):
            self._uncorrected += 1
            if self._uncorrected > self._most_uncorrected:
                self._break("no cut without its correction", world, f"{state.name} for {self._uncorrected} cycles")
        else:
            self._uncorrected = 0

    def _tells(self, world: World) -> bool:
        """Return whether plan or force says that material is cut."""
        if self._planned or not self._forced:
            return self._planned
        return not any(kind.startswith(("force-", "strain-")) for kind in world.active.now)

    def _obeyed(self, world: World, state: State, sent: Point) -> None:
        """A robot that makes far less of the correction for long is not corrected on, and it is told."""
        robot = world.robot
        follow(self._model, self._rate, sent, _OBEYS_RAD_S, 0.8, self._period_s)
        missing = math.dist(self._model, robot.made_m.tolist())
        told = not self._by_path  # whether its planned pose contains the correction is not documented
        if told and state == State.ACTIVE and missing > _MISSING_M and robot.speed > _MOVES_M_S:
            self._missing += 1
            if self._missing > self._most_missing:
                self._break("obedience is checked", world, f"{missing / MM:.2f} mm missing for {self._missing} cycles")
        else:
            self._missing = 0

    def _corrects(self, world: World, state: State) -> None:
        """Without any fault the tool is nearer to its path than it would be without the correction."""
        robot = world.robot
        cuts = robot.cuts and state == State.ACTIVE and not world.active.begun
        self._cutting = self._cutting + 1 if cuts else 0
        if self._cutting < self._settled or not robot.cuts_fully:
            return
        left, bent = _size((robot.made_m + robot.bent_m)[1:].tolist()), _size(robot.bent_m[1:].tolist())
        if left > _LEFT * bent + _size(robot.unmodelled_m[1:].tolist()):
            self._break("corrects", world, f"{left / MM:.3f} mm of {bent / MM:.3f} mm remain")


def _size(v: Point) -> float:
    return math.hypot(*v)


def _allowed(kinds: frozenset[str]) -> frozenset[Cause]:
    """Causes that may be told after these kinds of faults."""
    if kinds not in _ALLOWED:
        _ALLOWED[kinds] = frozenset(ALWAYS).union(*(KINDS[kind].causes for kind in kinds))
    return _ALLOWED[kinds]


_SILENT: Final = frozenset(("force-silent", "strain-silent"))
_DISTURBING: Final = (
    *("late", "lost", "answers-lost", "reordered", "damaged", "two-senders", "loop-stopped", "loop-starved"),
    *("controller-pauses", "cycle-drift", "clock-drift", "message-damaged", "message-short", "sequence-stuck"),
    "force-short",
)
_UNDISTURBED: Final = frozenset(KINDS) - frozenset(_DISTURBING)
_ALLOWED: dict[frozenset[str], frozenset[Cause]] = {}
