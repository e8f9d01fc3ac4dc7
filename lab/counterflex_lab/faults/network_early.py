"""A bad line before the loop is armed, and others that a good loop only passes over: R3 to R7, R13, R31."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Final

import numpy as np

from counterflex.core.units import MS
from counterflex.protocols.processes.control_array import Request
from counterflex.runtime.state.supervisor import Cause, State
from counterflex.twin.network.impairment import Delivery, Impairment, Schedule
from counterflex_lab.devices import RsiContext
from counterflex_lab.faults.aftermath import aftermath, steady
from counterflex_lab.faults.rig import Rig
from counterflex_lab.faults.scenario import Effort, Outcome, Scenario

_BEFORE: Final = 500
_SETTLED: Final = 250


class _Late(Schedule):
    """The first telegrams come late by so much, the others at once."""

    def __init__(self, late_s: tuple[float, ...]) -> None:
        super().__init__(Impairment())
        self._late_s = late_s

    def decide(self, n: int) -> tuple[Delivery, ...]:
        """See :meth:`Schedule.decide`."""
        return (Delivery(self._late_s[n] if n < len(self._late_s) else 0.0),)


def _early(made: Impairment, back: Impairment | None, *, arms: bool) -> Callable[[Effort], Outcome]:
    """The line is bad from the first telegram on, then good.

    Args:
        made: What it does to telegrams.
        back: And to answers.
        arms: It is good enough: armed all the same.
    """

    def run(effort: Effort) -> Outcome:
        with Rig(made, back, seed=effort.seed, sensors=effort.sensors) as rig:
            rig.control[Request.ARM] = 1
            rig.run(_BEFORE)
            bad, cause = set(rig.seen.state), rig.seen.reported[-1]
            rig.ways = (Schedule(Impairment()), Schedule(Impairment()))
            rig.run(300)
            rig.control[Request.RESET] = 1
            rig.run(100)
            rig.control[Request.ARM] = 1
            rig.run(100)
            good = rig.state
            largest = max(float(np.linalg.norm(c)) for c in rig.seen.correction_m)
        armed = State.ARMED in bad
        happened = f"{'armed' if armed else 'not armed'} ({cause.name.lower().replace('_', ' ')})"
        return Outcome(
            armed == arms and (arms or cause != Cause.NONE) and good == State.ARMED and largest == 0.0,
            f"{happened}; with a good line {good.name.lower()}; nothing but zero was sent",
            largest,
        )

    return run


def _malformed_early(effort: Effort) -> Outcome:
    """Telegrams cut in half from the beginning: neither armed nor answered as if they were whole."""
    with Rig(seed=effort.seed, sensors=effort.sensors) as rig:
        rig.spoil = lambda data: data[: len(data) // 2]
        rig.control[Request.ARM] = 1
        rig.run(100)
        state, telegrams = rig.state, rig.link.counters.telegrams
        rig.spoil = None
        rig.run(300)
        after = rig.state
    return Outcome(
        state < State.ARMED and telegrams == 0 and after == State.ARMED,
        f"{state.name.lower()}, {telegrams} taken for telegrams; whole ones: {after.name.lower()}",
    )


def _late_in_order(effort: Effort) -> Outcome:
    """Three telegrams 10, 6 and 2 ms late, one behind the other."""
    with Rig(seed=effort.seed, sensors=effort.sensors, force=steady, context=RsiContext()) as rig:
        rig.activate().run(_SETTLED)
        begin = rig.cycle_count
        rig.ways = (_Late((10.0 * MS, 6.0 * MS, 2.0 * MS)), Schedule(Impairment()))
        rig.restart_numbers()
        rig.run(500)
        after = aftermath(rig, begin)
        state = rig.state
    return after.outcome(state == State.ACTIVE and after.path.count("active") <= 2)


def _nine_lost(effort: Effort) -> Outcome:
    """Nine answers lost in a row: one less than the controller's time-out."""
    with Rig(seed=effort.seed, sensors=effort.sensors, force=steady, context=RsiContext()) as rig:
        rig.activate().run(_SETTLED)
        begin = rig.cycle_count
        rig.ways = (rig.ways[0], Schedule(Impairment(loss=1.0, end=9)))
        rig.restart_numbers()
        rig.run(500)
        after = aftermath(rig, begin)
    return after.outcome(rig.state == State.ACTIVE or bool(after.causes))


def _halves(effort: Effort) -> Outcome:
    """Every third telegram comes as two datagrams, each half of it."""
    with Rig(seed=effort.seed, sensors=effort.sensors, force=steady) as rig:
        rig.activate().run(_SETTLED)
        begin = rig.cycle_count
        for k in range(300):
            if k % 3 == 0:
                data = rig.next_telegram()
                rig.to_loop(data[: len(data) // 2])
                rig.to_loop(data[len(data) // 2 :])
                rig.spoil = lambda data: data[len(data) // 3 :]
            rig.cycle()
            rig.spoil = None
        after, malformed = aftermath(rig, begin), rig.link.counters.malformed
    return after.outcome(malformed >= 200 and bool(after.causes))


def _flood(effort: Effort) -> Outcome:
    """From the controller's own address: 40 old telegrams and rubbish in every cycle."""
    cycles = effort.pick(1_000, 200)
    corrections, old = [], 0
    for disturbed in (False, True):
        with Rig(seed=effort.seed, sensors=effort.sensors) as rig:
            rig.activate()
            before = rig.next_telegram()
            rig.cycle()  # now it is an old one
            begin = rig.cycle_count
            for _ in range(cycles):
                if disturbed:
                    for k in range(40):
                        rig.to_loop(before if k % 2 else re.sub(rb"</Rob>", b"", before))
                rig.cycle()
            corrections.append(np.array(rig.seen.correction_m))
            old = rig.link.counters.old
            answered = int(np.sum(np.array(rig.seen.age[begin:]) == 0))
            step = float(rig.seen.steps()[begin - 1 :].max())
            state = rig.state
    same = bool(np.array_equal(corrections[0], corrections[1]))
    return Outcome(
        state == State.ACTIVE and old > 0 and answered == cycles and same,
        f"{old} old ones passed over, {answered} of {cycles} telegrams answered in their cycle, corrections "
        f"{'the same bit for bit' if same else 'DIFFERENT'}",
        step,
    )


SCENARIOS: Final = (
    Scenario(
        "R3",
        "lost-before",
        "30 % of telegrams and answers lost from the first one on, then none",
        "not armed, and why; armed when the line is good; nothing but zero is sent",
        _early(Impairment(loss=0.3), Impairment(loss=0.3), arms=False),
    ),
    Scenario(
        "R6",
        "jitter-before",
        "2 to 12 ms of delay by chance from the first telegram on, then none",
        "the same",
        _early(Impairment(delay_s=2.0 * MS, jitter_s=10.0 * MS), None, arms=False),
    ),
    Scenario(
        "R7",
        "copies-before",
        "half of the telegrams come twice from the first one on",
        "armed",
        _early(Impairment(duplicate=0.5, reorder_s=9.0 * MS), None, arms=True),
    ),
    Scenario(
        "R7",
        "overtaken-before",
        "30 % of the telegrams are overtaken by the next from the first one on, then none",
        "not armed, and why; armed when the line is good; nothing but zero is sent",
        _early(Impairment(reorder=0.3, reorder_s=6.0 * MS), None, arms=False),
    ),
    Scenario(
        "R13",
        "halves-before",
        "every telegram is cut in half, then whole ones",
        "not armed; then armed",
        _malformed_early,
    ),
    Scenario(
        "R6",
        "late-in-order",
        "three telegrams come 10, 6 and 2 ms late, in order",
        "a short hold at most, then the cut goes on",
        _late_in_order,
    ),
    Scenario(
        "R4", "nine-lost", "nine answers lost in a row", "goes on, or holds the feed and says why; no step", _nine_lost
    ),
    Scenario(
        "R13",
        "halves",
        "every third telegram comes as two datagrams, half of it each",
        "counted, named; holds the feed; no step",
        _halves,
    ),
    Scenario(
        "R31",
        "flood",
        "10 000 old and broken telegrams a second from the controller's own address",
        "passed over, counted; every telegram answered, output unchanged",
        _flood,
    ),
)
