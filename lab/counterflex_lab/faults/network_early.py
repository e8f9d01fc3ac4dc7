"""A bad line before the loop is armed, and others that a good loop only passes over: R3 to R7, R13, R31."""

from __future__ import annotations

import re
from functools import partial
from typing import Final

import numpy as np

from counterflex.core.units import MS
from counterflex.protocols.processes.control_array import Request
from counterflex.runtime.state.supervisor import Cause, State
from counterflex.twin.network.impairment import Delivery, Impairment, Schedule
from counterflex_lab.devices import RsiContext
from counterflex_lab.faults.aftermath import STANDING, Aftermath, settled, steady, words
from counterflex_lab.faults.rig import rigged
from counterflex_lab.faults.scenario import Effort, Outcome, Scenario

_BEFORE: Final = 500


class _Late(Schedule):
    """The first telegrams come late by so much, the others at once."""

    def __init__(self, late_s: tuple[float, ...]) -> None:
        super().__init__(Impairment())
        self._late_s = late_s

    def decide(self, n: int) -> tuple[Delivery, ...]:
        """See :meth:`Schedule.decide`."""
        return (Delivery(self._late_s[n] if n < len(self._late_s) else 0.0),)


def _early(effort: Effort, *, made: Impairment, back: Impairment | None = None, arms: bool = False) -> Outcome:
    """The line is bad from the first telegram on, then good."""
    with rigged(effort, made, back) as rig:
        rig.control[Request.ARM] = 1
        rig.run(_BEFORE)
        bad, cause = set(rig.seen.state), rig.seen.reported[-1]
        rig.ways = (Schedule(Impairment()), Schedule(Impairment()))
        rig.run(300)
        rig.control[Request.RESET] = 1
        rig.run(100)
        rig.control[Request.ARM] = 1
        rig.run(100)
    largest = max(float(np.linalg.norm(c)) for c in rig.seen.correction_m)
    armed = State.ARMED in bad
    happened = f"{'armed' if armed else 'not armed'} ({words(cause)})"
    return Outcome(
        armed == arms and (arms or cause != Cause.NONE) and rig.state == State.ARMED and largest == 0.0,
        f"{happened}; with a good line {rig.state.name.lower()}; nothing but zero was sent",
        largest,
    )


def _malformed_early(effort: Effort) -> Outcome:
    """Telegrams cut in half from the beginning: neither armed nor answered as if they were whole."""
    with rigged(effort) as rig:
        rig.spoil = lambda data: data[: len(data) // 2]
        rig.control[Request.ARM] = 1
        rig.run(100)
        state, telegrams = rig.state, rig.link.counters.telegrams
        rig.spoil = None
        rig.run(300)
    return Outcome(
        state < State.ARMED and telegrams == 0 and rig.state == State.ARMED,
        f"{state.name.lower()}, {telegrams} taken for telegrams; whole ones: {rig.state.name.lower()}",
    )


def _late_in_order(effort: Effort) -> Outcome:
    """Three telegrams 10, 6 and 2 ms late, one behind the other."""
    with rigged(effort, force=steady, context=RsiContext()) as rig:
        after = settled(rig, STANDING)
        rig.ways = (_Late((10.0 * MS, 6.0 * MS, 2.0 * MS)), Schedule(Impairment()))
        rig.restart_numbers()
        rig.run(500)
    return after.safe(rig.state == State.ACTIVE and after.path.count("active") <= 2)


def _nine_lost(effort: Effort) -> Outcome:
    """Nine answers lost in a row: one less than the controller's time-out."""
    with rigged(effort, force=steady, context=RsiContext()) as rig:
        after = settled(rig, STANDING)
        rig.ways = (rig.ways[0], Schedule(Impairment(loss=1.0, end=9)))
        rig.restart_numbers()
        rig.run(500)
    return after.safe(rig.state == State.ACTIVE or bool(after.causes))


def _halves(effort: Effort) -> Outcome:
    """Every third telegram comes as two datagrams, each half of it."""
    with rigged(effort, force=steady) as rig:
        after = settled(rig, STANDING)
        for k in range(300):
            if k % 3 == 0:
                data = rig.next_telegram()
                rig.to_loop(data[: len(data) // 2])
                rig.to_loop(data[len(data) // 2 :])
                rig.spoil = lambda data: data[len(data) // 3 :]
            rig.cycle()
            rig.spoil = None
    return after.safe(rig.link.counters.malformed >= 200 and bool(after.causes))


def _flood(effort: Effort) -> Outcome:
    """From the controller's own address: 40 old telegrams and rubbish in every cycle."""
    cycles = effort.pick(1_000, 200)
    corrections = []
    for disturbed in (False, True):
        with rigged(effort) as rig:
            rig.activate()
            before = rig.next_telegram()
            rig.cycle()  # now it is an old one
            after = Aftermath(rig)
            for _ in range(cycles):
                for k in range(40 * disturbed):
                    rig.to_loop(before if k % 2 else re.sub(rb"</Rob>", b"", before))
                rig.cycle()
            corrections.append(np.array(rig.seen.correction_m))
    old, answered = rig.link.counters.old, int(np.sum(np.array(rig.seen.age[after.begin :]) == 0))
    same = bool(np.array_equal(corrections[0], corrections[1]))
    return Outcome(
        rig.state == State.ACTIVE and old > 0 and answered == cycles and same,
        f"{old} old ones passed over, {answered} of {cycles} telegrams answered in their cycle, corrections "
        f"{'the same bit for bit' if same else 'DIFFERENT'}",
        after.step_m,
    )


SCENARIOS: Final = (
    Scenario(
        "R3",
        "lost-before",
        "30 % of telegrams and answers lost from the first one on, then none",
        "not armed, and why; armed when the line is good; nothing but zero is sent",
        partial(_early, made=Impairment(loss=0.3), back=Impairment(loss=0.3)),
    ),
    Scenario(
        "R6",
        "jitter-before",
        "2 to 12 ms of delay by chance from the first telegram on, then none",
        "the same",
        partial(_early, made=Impairment(delay_s=2.0 * MS, jitter_s=10.0 * MS)),
    ),
    Scenario(
        "R7",
        "copies-before",
        "half of the telegrams come twice from the first one on",
        "armed",
        partial(_early, made=Impairment(duplicate=0.5, reorder_s=9.0 * MS), arms=True),
    ),
    Scenario(
        "R7",
        "overtaken-before",
        "30 % of the telegrams are overtaken by the next from the first one on, then none",
        "not armed, and why; armed when the line is good; nothing but zero is sent",
        partial(_early, made=Impairment(reorder=0.3, reorder_s=6.0 * MS)),
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
