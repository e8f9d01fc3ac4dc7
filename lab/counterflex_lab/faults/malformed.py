"""Datagrams that are no telegrams: R13."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Final

import numpy as np

from counterflex.runtime.state.supervisor import State
from counterflex.twin.network.impairment import Impairment
from counterflex_lab.faults.demonstration import PERIOD_S
from counterflex_lab.faults.network import LARGEST_STEP_M, described
from counterflex_lab.faults.rig import Rig
from counterflex_lab.faults.scenario import Effort, Outcome, Scenario
from counterflex_lab.faults.sessions import SETTLED, first_cycle


def _rubbish(effort: Effort) -> Outcome:
    """Instead of telegrams: garbage, cut ones, huge ones, none that is text; then between good ones."""
    rng = np.random.default_rng([effort.seed, 7])
    counts = []
    with Rig(seed=effort.seed, sensors=effort.sensors) as rig:
        rig.activate().run(SETTLED)
        begin = rig.cycle_count
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
            counts.append(rig.link.counters.malformed_in_a_row)
        hold, fault = first_cycle(rig, State.HOLD, begin), first_cycle(rig, State.FAULT, begin)
        step = float(rig.seen.steps()[begin - 1 :].max())
        path, malformed = rig.seen.path(begin), rig.link.counters.malformed
    with Rig(seed=effort.seed, sensors=effort.sensors) as rig:
        rig.activate().run(SETTLED)
        between = rig.cycle_count
        for k in range(60):
            rig.to_loop(kinds[k % len(kinds)])
            rig.run(1)
        undisturbed = rig.state == State.ACTIVE
        step = max(step, float(rig.seen.steps()[between - 1 :].max()))
    passed = hold is not None and hold <= 3 and fault is not None and fault <= 10 and undisturbed and malformed == 12
    return Outcome(
        passed and step <= LARGEST_STEP_M,
        f"hold after {hold}, fault after {fault} in a row; between good telegrams counted only; {described(path)}",
        step,
        None if hold is None else hold * PERIOD_S,
    )


def _flips(effort: Effort) -> Outcome:
    """Damage that the checksum of UDP would catch: bits and ends of telegrams and answers."""
    steps, ends, runs = [], [], effort.pick(12, 5)
    for k in range(runs):
        made = Impairment(flip=0.02, truncate=0.01, garbage=0.01)
        with Rig(made, seed=1000 * effort.seed + k, sensors=effort.sensors) as rig:
            begin = rig.activate().cycle_count
            rig.run(effort.pick(1_000, 400))
            steps.append(float(rig.seen.steps()[begin - 1 :].max()))
            ends.append(rig.seen.path(begin))
    stopped = sum(path[-1] != "active" for path in ends)
    accused = any("foreign" in part for path in ends for part in path)
    return Outcome(
        max(steps) <= LARGEST_STEP_M and not accused,
        f"{runs} runs, no exception; {stopped} had stopped; e.g. {described(ends[0], 4)}",
        max(steps),
        None,
        {"runs": float(runs), "stopped": float(stopped)},
    )


def _unreadable(number: bytes) -> Callable[[Effort], Outcome]:
    """Telegrams whose numbers cannot be read, without end; their counter can."""

    def run(effort: Effort) -> Outcome:
        with Rig(seed=effort.seed, sensors=effort.sensors) as rig:
            rig.activate().run(SETTLED)
            begin = rig.cycle_count
            rig.spoil = lambda data: re.sub(rb'X="[^"]*"', b'X="' + number + b'"', data)
            rig.run(150)
            hold, fault = first_cycle(rig, State.HOLD, begin), first_cycle(rig, State.FAULT, begin)
            step = float(rig.seen.steps()[begin - 1 :].max())
            path, stopped = rig.seen.path(begin), rig.robot.stopped
            safe_s, feed_held = rig.seen.stopped_s(begin), rig.robot.feed_hold
            after = np.array(rig.seen.correction_m[begin + (fault or 0) :])
        steady = bool(np.all(after == after[0])) and float(np.linalg.norm(after[0])) > 0.0
        passed = hold is not None and hold <= 3 and stopped == "Stop" and feed_held and steady
        return Outcome(
            passed and step <= LARGEST_STEP_M,
            f"hold after {hold}, fault after {fault}; told to stop ({stopped or 'went on'}); {described(path)}",
            step,
            safe_s,
        )

    return run


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
            _unreadable(number),
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
