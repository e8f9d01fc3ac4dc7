"""Faults of the session: another one, none any more, a loop that stood still, the order of starting: R9 to R11, R34."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.protocols.processes.control_array import Request
from counterflex.runtime.state.supervisor import State
from counterflex_lab.devices import RsiContext
from counterflex_lab.faults.demonstration import PERIOD_S, demo_config
from counterflex_lab.faults.network import LARGEST_STEP_M, described
from counterflex_lab.faults.rig import Rig
from counterflex_lab.faults.scenario import Effort, Outcome, Scenario

SETTLED: Final = 130
"""Cycles before the fault: the correction then moves as fast as it may."""
_ANSWER_CYCLES: Final = 10
_FIRST: Final = 4208163000


def first_cycle(rig: Rig, state: State, begin: int) -> int | None:
    """Cycles from ``begin`` to the end of the one in which a state was first there; None: never."""
    for k, reached in enumerate(rig.seen.state[begin:]):
        if reached == state:
            return k + 1
    return None


def _restart(counter: int) -> Callable[[Effort], Outcome]:
    def run(effort: Effort) -> Outcome:
        with Rig(seed=effort.seed, sensors=effort.sensors) as rig:
            rig.activate().run(SETTLED)
            correction_m = float(np.linalg.norm(rig.robot.correction[:3]))
            begin = rig.cycle_count
            rig.restart_robot(counter)
            rig.enable = False
            rig.run(60)
            decided = first_cycle(rig, State.FAULT, begin)
            largest_m = max(float(np.linalg.norm(c)) for c in rig.seen.correction_m[begin:])
            cause = rig.loop.cause
            stopped = rig.robot.stopped
            rig.control[Request.RESET] = 1
            rig.run(2)
            idle = rig.state
            rig.restart_robot(counter + 10_000)  # a person has started the program again, out of the cut
            rig.feed = False
            rig.run(100)
            rig.control[Request.ARM] = 1
            rig.run(150)
            rig.enable = rig.feed = True
            rig.run(100)
            step = float(rig.seen.steps()[begin - 1 :].max())
            path = rig.seen.path(begin)
            state = rig.state
        passed = (
            decided is not None
            and decided <= _ANSWER_CYCLES
            and largest_m == 0.0
            and correction_m > 0.0
            and stopped == "Stop"
            and idle in (State.IDLE, State.READY)
            and state in (State.ACTIVE, State.HOLD)
            and step <= LARGEST_STEP_M
        )
        return Outcome(
            passed,
            f"{described(path, 8)}; {correction_m * 1e3:.2f} mm were in force, none of it went into the new session, "
            f"which was told to stop; "
            f"fault after {decided} telegrams ({cause.name.lower().replace('_', ' ')})",
            step,
            None if decided is None else decided * PERIOD_S,
        )

    return run


def _wrap(effort: Effort) -> Outcome:
    """The counter of a session that goes on begins again at 0: what is held must not change, nor jump to zero."""
    before = 2**32 - 4 * (SETTLED + 90)
    with Rig(seed=effort.seed, sensors=effort.sensors, context=RsiContext(first_counter=before, timeout=10)) as rig:
        rig.wrap = True
        begin = rig.activate().cycle_count
        rig.run(400)
        wrapped = next(k for k, s in enumerate(rig.seen.state[begin:], begin) if s == State.FAULT)
        step = float(rig.seen.steps()[begin - 1 :].max())
        path, stopped = rig.seen.path(begin), rig.robot.stopped
        after = np.array(rig.seen.correction_m[wrapped:])
        at_zero = rig.wrapped_at
        safe_s = rig.seen.stopped_s(at_zero)
    return _stop_outcome(after, stopped, path, step, safe_s)


def _jump(by_ms: int, *, reports: bool) -> Callable[[Effort], Outcome]:
    """The counter of a session that goes on jumps; with and without the pose that the controller reports."""

    def run(effort: Effort) -> Outcome:
        config = demo_config()
        if not reports:
            config = replace(config, send=tuple(tag for tag in config.send if tag.tag != "DEF_RIst"))
        with Rig(seed=effort.seed, sensors=effort.sensors, config=config) as rig:
            rig.activate().run(SETTLED)
            begin = rig.cycle_count
            rig.robot.counter += by_ms
            rig.run(150)
            fault = first_cycle(rig, State.FAULT, begin)
            step = float(rig.seen.steps()[begin - 1 :].max())
            path, stopped = rig.seen.path(begin), rig.robot.stopped
            after = np.array(rig.seen.correction_m[begin + (fault or 0) :])
            safe_s = rig.seen.stopped_s(begin)
        return _stop_outcome(after, stopped, path, step, safe_s)

    return run


def _stop_outcome(after: Float, stopped: str, path: list[str], step: float, safe_s: float | None) -> Outcome:
    """The correction stays what it was, and the controller is told to stop."""
    steady = bool(np.all(after == after[0])) and float(np.linalg.norm(after[0])) > 0.0
    return Outcome(
        stopped == "Stop" and steady and step <= LARGEST_STEP_M,
        f"{described(path)}; what is in force stays, the controller is told to stop ({stopped or 'went on'})",
        step,
        safe_s,
    )


def _pause(effort: Effort) -> Outcome:
    """Telegrams stop."""
    with Rig(seed=effort.seed, sensors=effort.sensors) as rig:
        rig.activate().run(SETTLED)
        begin = rig.cycle_count
        rig.paused = True
        rig.run(20)
        hold, fault = first_cycle(rig, State.HOLD, begin), first_cycle(rig, State.FAULT, begin)
        rig.paused = False
        rig.robot.counter += 4 * 20
        rig.run(20)
        state = rig.state
        step = float(rig.seen.steps()[begin - 1 :].max())
        path = rig.seen.path(begin)
    passed = hold is not None and hold <= 3 and fault is not None and fault <= 10 and state == State.FAULT
    return Outcome(
        passed and step <= LARGEST_STEP_M,
        f"hold after {hold} cycles, fault after {fault}; still a fault when they come again; {described(path)}",
        step,
        None if hold is None else hold * PERIOD_S,
    )


def _stopped(cycles: int) -> Callable[[Effort], Outcome]:
    def run(effort: Effort) -> Outcome:
        with Rig(seed=effort.seed, sensors=effort.sensors, context=RsiContext(timeout=10)) as rig:
            rig.activate().run(SETTLED)
            begin, sent = rig.cycle_count, rig.link.counters.telegrams
            rig.frozen = True
            rig.run(cycles)
            waiting = rig.robot.counter
            rig.frozen = False
            rig.act()
            answered = rig.link.counter
            drained = rig.link.counters.drained
            rig.run(30)
            replies = rig.link.counters.telegrams - sent
            step = float(rig.seen.steps()[begin - 1 :].max())
            path, ended, late = rig.seen.path(begin), rig.robot.stopped, rig.robot.late
            safe_s = rig.seen.stopped_s(begin)
        passed = answered == waiting and rig.state == State.FAULT and ended != "" and step <= LARGEST_STEP_M
        return Outcome(
            passed,
            f"the newest telegram answered, {drained} passed over, {replies} answers in all; controller: {ended} after "
            f"{late} late; {described(path)}",
            step,
            safe_s,
        )

    return run


def _orders(effort: Effort) -> Outcome:
    """Robot, sensor and loop begin one after the other, in every order."""
    ends, largest = [], 0.0
    for order in itertools.permutations(("robot", "sensor", "loop")):
        with Rig(seed=effort.seed, sensors=effort.sensors) as rig:
            rig.paused, rig.sense, rig.frozen = True, False, True
            for part in order:
                if part == "robot":
                    rig.paused = False
                elif part == "sensor":
                    rig.sense = True
                else:
                    rig.frozen = False
                rig.run(150)
            rig.run(200)
            ends.append(rig.state)
            largest = max(largest, max(float(np.linalg.norm(c)) for c in rig.seen.correction_m))
    return Outcome(
        all(state == State.READY for state in ends) and largest == 0.0,
        f"{sum(state == State.READY for state in ends)} of {len(ends)} orders end in ready, correction "
        f"{largest * 1e3:g} mm throughout",
        largest,
    )


SCENARIOS: Final = (
    Scenario(
        "R9",
        "counter-back",
        "the controller begins another session, its counter 60 s back",
        "fault within 10 telegrams, zero and Stop sent into the new session, armed anew by a person only",
        _restart(_FIRST - 60_000),
    ),
    Scenario(
        "R9",
        "counter-back-near",
        "the same, 0.2 s back: within the range of overtaken telegrams",
        "the same; never passing them over as old for ever",
        _restart(_FIRST + 4 * 190 - 200),
    ),
    Scenario(
        "R9",
        "counter-ahead",
        "the same, 60 s ahead",
        "the same",
        _restart(_FIRST + 60_000),
    ),
    Scenario(
        "R9",
        "counter-wraps",
        "the counter begins again at 0 behind 2^32 - 1 while the session goes on",
        "fault within 10 telegrams; what is in force stays, the controller is told to stop",
        _wrap,
    ),
    Scenario(
        "R9",
        "counter-jumps",
        "the counter of a session that goes on jumps 100 s ahead",
        "the same",
        _jump(100_000, reports=True),
    ),
    Scenario(
        "R9",
        "counter-jumps-unreported",
        "the same 0.2 s back, by a controller that does not report its pose",
        "the same",
        _jump(-200, reports=False),
    ),
    Scenario("R10", "telegrams-stop", "no telegram any more", "hold within 3 cycles, fault within 10", _pause),
    Scenario(
        "R11",
        "stopped-60ms",
        "the loop stands still for 60 ms (virtual clock)",
        "then answers the newest telegram only, fault; the controller has stopped by itself (10 late)",
        _stopped(15),
    ),
    Scenario("R11", "stopped-500ms", "the same for 500 ms (virtual clock)", "the same", _stopped(125)),
    Scenario(
        "R34",
        "orders",
        "robot, sensor and loop started in all six orders",
        "each ends in ready; nothing but zero is sent",
        _orders,
    ),
)
