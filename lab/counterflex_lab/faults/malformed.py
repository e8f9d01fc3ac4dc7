"""Datagrams that are no telegrams: R13."""

from __future__ import annotations

import re
from functools import partial
from typing import Final

import numpy as np

from counterflex.runtime.state.supervisor import State
from counterflex.twin.network.impairment import Impairment
from counterflex_lab.faults.aftermath import LARGEST_STEP_M, Aftermath, described, settled
from counterflex_lab.faults.rig import rigged
from counterflex_lab.faults.scenario import Effort, Outcome, Scenario


def _rubbish(effort: Effort) -> Outcome:
    """Instead of telegrams: garbage, cut ones, huge ones, none that is text; then between good ones."""
    rng = np.random.default_rng([effort.seed, 7])
    with rigged(effort) as rig:
        after = settled(rig)
        good = rig.next_telegram()
        kinds = [
            rng.bytes(600),
            good[: len(good) // 2],
            good.replace(b"RSol", b"\xff\xfe\x80\x00"),
            re.sub(rb'X="[^"]*"', b'X="-"', good),
            b"<" * 60_000,
            b"",
        ]
        rig.paused = True
        for k in range(12):
            rig.to_loop(kinds[k % len(kinds)])
            rig.run(1)
        malformed = rig.link.counters.malformed
    with rigged(effort) as rig:
        between = settled(rig)
        for k in range(60):
            rig.to_loop(kinds[k % len(kinds)])
            rig.run(1)
    hold, fault, step = after.first(State.HOLD), after.first(State.FAULT), max(after.step_m, between.step_m)
    passed = hold is not None and hold <= 3 and fault is not None and fault <= 10 and malformed == 12
    happened = f"hold after {hold}, fault after {fault} in a row; between good telegrams counted only"
    return Outcome(
        passed and rig.state == State.ACTIVE and step <= LARGEST_STEP_M,
        f"{happened}; {described(after.path)}",
        step,
        after.first_s(State.HOLD),
    )


def _flips(effort: Effort) -> Outcome:
    """Damage that the checksum of UDP would catch: bits and ends of telegrams and answers."""
    made, runs = Impairment(flip=0.02, truncate=0.01, garbage=0.01), effort.pick(12, 5)
    seen = []
    for k in range(runs):
        with rigged(effort, made, seed=1000 * effort.seed + k) as rig:
            seen.append(Aftermath(rig.activate()))
            rig.run(effort.pick(1_000, 400))
    ends, step = [after.path for after in seen], max(after.step_m for after in seen)
    stopped = sum(path[-1] != "active" for path in ends)
    accused = any("foreign" in part for path in ends for part in path)
    return Outcome(
        step <= LARGEST_STEP_M and not accused,
        f"{runs} runs, no exception; {stopped} had stopped; e.g. {described(ends[0], 4)}",
        step,
        None,
        {"runs": float(runs), "stopped": float(stopped)},
    )


def _unreadable(effort: Effort, *, number: bytes) -> Outcome:
    """Telegrams whose numbers cannot be read, without end; their counter can."""
    with rigged(effort) as rig:
        after = settled(rig)
        rig.spoil = lambda data: re.sub(rb'X="[^"]*"', b'X="' + number + b'"', data)
        rig.run(150)
    hold, fault, stopped = after.first(State.HOLD), after.first(State.FAULT), rig.robot.stopped
    passed = hold is not None and hold <= 3 and stopped == "Stop" and rig.robot.feed_hold and after.kept(fault or 0)
    happened = f"hold after {hold}, fault after {fault}; told to stop ({stopped or 'went on'}); {described(after.path)}"
    return after.outcome(passed, happened, safe_s=after.stopped_s)


SCENARIOS: Final = (
    Scenario(
        "R13",
        "rubbish",
        "garbage, cut, huge, empty, not UTF-8 instead of telegrams, and between them",
        "counted; hold after 3 in a row, fault after 10; no exception",
        _rubbish,
    ),
    *(
        Scenario(
            "R13",
            f"unreadable-{name}",
            f"from now on every telegram says {number.decode()} where a number should be; its counter can be read",
            "hold within 3 cycles with the feed held, then told to stop; the correction stays",
            partial(_unreadable, number=number),
        )
        for name, number in (("text", b"-"), ("nan", b"nan"), ("huge", b"1e999"))
    ),
    Scenario(
        "R13",
        "damaged",
        "2 % of the telegrams with a bit turned over, 1 % cut, 1 % replaced by garbage",
        "no exception, no step above the limit, nobody else accused",
        _flips,
    ),
)
