"""Faults of the session: another one, none any more, a loop that stood still, the order of starting: R9 to R11, R34."""

from __future__ import annotations

import itertools
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from counterflex.protocols.processes.control_array import Request
from counterflex.runtime.state.supervisor import State
from counterflex_lab.devices import RsiContext
from counterflex_lab.faults.aftermath import MOVING, Aftermath, described, settled, words
from counterflex_lab.faults.demonstration import PERIOD_S, demo_config
from counterflex_lab.faults.rig import rigged
from counterflex_lab.faults.scenario import Effort, Outcome, Scenario

_ANSWER_CYCLES: Final = 10
_FIRST: Final = 4208163000


def _restart(effort: Effort, *, counter: int) -> Outcome:
    with rigged(effort) as rig:
        after = settled(rig)
        correction_m = float(np.linalg.norm(rig.robot.correction[:3]))
        rig.restart_robot(counter)
        rig.enable = False
        rig.run(60)
        decided = after.first(State.FAULT)
        largest_m = max(float(np.linalg.norm(c)) for c in rig.seen.correction_m[after.begin :])
        cause, stopped = rig.loop.cause, rig.robot.stopped
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
    passed = decided is not None and decided <= _ANSWER_CYCLES and stopped == "Stop"
    passed = passed and largest_m == 0.0 < correction_m
    return after.outcome(
        passed and idle in (State.IDLE, State.READY) and rig.state in (State.ACTIVE, State.HOLD),
        f"{described(after.path, 8)}; {correction_m * 1e3:.2f} mm were in force, none of it went into the new session, "
        f"which was told to stop; fault after {decided} telegrams ({words(cause)})",
        safe_s=None if decided is None else decided * PERIOD_S,
    )


def _wrap(effort: Effort) -> Outcome:
    """The counter of a session that goes on begins again at 0: what is held must not change, nor jump to zero."""
    before = 2**32 - 4 * (MOVING + 90)
    with rigged(effort, context=RsiContext(first_counter=before, timeout=10)) as rig:
        rig.wrap = True
        after = Aftermath(rig.activate())
        rig.run(400)
    fault = (after.first(State.FAULT) or 1) - 1
    return _told_to_stop(after, fault, rig.robot.stopped, rig.seen.stopped_s(rig.wrapped_at))


def _jump(effort: Effort, *, by_ms: int, reports: bool) -> Outcome:
    """The counter of a session that goes on jumps; with and without the pose that the controller reports."""
    config = demo_config()
    if not reports:
        config = replace(config, send=tuple(tag for tag in config.send if tag.tag != "DEF_RIst"))
    with rigged(effort, config=config) as rig:
        after = settled(rig)
        rig.robot.counter += by_ms
        rig.run(150)
    return _told_to_stop(after, after.first(State.FAULT) or 0, rig.robot.stopped, after.stopped_s)


def _told_to_stop(after: Aftermath, fault: int, stopped: str, safe_s: float | None) -> Outcome:
    """The correction stays what it was, and the controller is told to stop."""
    happened = f"what is in force stays, the controller is told to stop ({stopped or 'went on'})"
    passed = stopped == "Stop" and after.kept(fault)
    return after.outcome(passed, f"{described(after.path)}; {happened}", safe_s=safe_s)


def _pause(effort: Effort) -> Outcome:
    """Telegrams stop."""
    with rigged(effort) as rig:
        after = settled(rig)
        rig.paused = True
        rig.run(20)
        hold, fault = after.first(State.HOLD), after.first(State.FAULT)
        rig.paused = False
        rig.robot.counter += 4 * 20
        rig.run(20)
    passed = hold is not None and hold <= 3 and fault is not None and fault <= 10 and rig.state == State.FAULT
    return after.outcome(
        passed,
        f"hold after {hold} cycles, fault after {fault}; still a fault when they come again; {described(after.path)}",
        safe_s=after.first_s(State.HOLD),
    )


def _stood_still(effort: Effort, *, cycles: int) -> Outcome:
    with rigged(effort, context=RsiContext(timeout=10)) as rig:
        after = settled(rig)
        sent = rig.link.counters.telegrams
        rig.frozen = True
        rig.run(cycles)
        waiting = rig.robot.counter
        rig.frozen = False
        rig.act()
        answered, drained = rig.link.counter, rig.link.counters.drained
        rig.run(30)
        replies = rig.link.counters.telegrams - sent
    return after.outcome(
        answered == waiting and rig.state == State.FAULT and rig.robot.stopped != "",
        f"the newest telegram answered, {drained} passed over, {replies} answers in all; controller: "
        f"{rig.robot.stopped} after {rig.robot.late} late; {described(after.path)}",
        safe_s=after.stopped_s,
    )


def _orders(effort: Effort) -> Outcome:
    """Robot, sensor and loop begin one after the other, in every order."""
    ends, largest = [], 0.0
    for order in itertools.permutations(("robot", "sensor", "loop")):
        with rigged(effort) as rig:
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
        partial(_restart, counter=_FIRST - 60_000),
    ),
    Scenario(
        "R9",
        "counter-back-near",
        "the same, 0.2 s back: within the range of overtaken telegrams",
        "the same; never passing them over as old for ever",
        partial(_restart, counter=_FIRST + 4 * 190 - 200),
    ),
    Scenario("R9", "counter-ahead", "the same, 60 s ahead", "the same", partial(_restart, counter=_FIRST + 60_000)),
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
        partial(_jump, by_ms=100_000, reports=True),
    ),
    Scenario(
        "R9",
        "counter-jumps-unreported",
        "the same 0.2 s back, by a controller that does not report its pose",
        "the same",
        partial(_jump, by_ms=-200, reports=False),
    ),
    Scenario("R10", "telegrams-stop", "no telegram any more", "hold within 3 cycles, fault within 10", _pause),
    Scenario(
        "R11",
        "stopped-60ms",
        "the loop stands still for 60 ms (virtual clock)",
        "then answers the newest telegram only, fault; the controller has stopped by itself (10 late)",
        partial(_stood_still, cycles=15),
    ),
    Scenario(
        "R11", "stopped-500ms", "the same for 500 ms (virtual clock)", "the same", partial(_stood_still, cycles=125)
    ),
    Scenario(
        "R34",
        "orders",
        "robot, sensor and loop started in all six orders",
        "each ends in ready; nothing but zero is sent",
        _orders,
    ),
)
