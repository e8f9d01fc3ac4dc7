"""Clocks that jump and drift: R20 and R21."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Final
from unittest import mock

import numpy as np

from counterflex.core.units import NS
from counterflex.runtime.state.supervisor import Cause, State
from counterflex_lab.faults.demonstration import PERIOD_S
from counterflex_lab.faults.network import LARGEST_STEP_M, described
from counterflex_lab.faults.rig import Rig
from counterflex_lab.faults.scenario import Effort, Outcome, Scenario
from counterflex_lab.faults.sessions import SETTLED, first_cycle


def _wall_clock(effort: Effort) -> Outcome:
    """The time of day jumps in every cycle: the same run, bit for bit."""
    cycles = effort.pick(1_000, 300)
    jumps = itertools.cycle([0.0, 3600.0, 1e9, 2e9])

    def seconds() -> float:
        return next(jumps)

    def nanoseconds() -> int:
        return round(next(jumps) / NS)

    def once(patched: bool) -> tuple[np.ndarray, list[State], float]:
        with Rig(seed=effort.seed, sensors=effort.sensors) as rig:
            begin = rig.activate().cycle_count
            if patched:
                with mock.patch("time.time", seconds), mock.patch("time.time_ns", nanoseconds):
                    rig.run(cycles)
            else:
                rig.run(cycles)
            return (
                np.array(rig.seen.correction_m),
                rig.seen.state,
                float(rig.seen.steps()[begin - 1 :].max()),
            )

    plain, jumping = once(False), once(True)
    same = bool(np.array_equal(plain[0], jumping[0])) and plain[1] == jumping[1]
    return Outcome(same, "corrections and states the same bit for bit" if same else "DIFFERENT", jumping[2])


def _clock_jump(jump_s: float) -> Callable[[Effort], Outcome]:
    def run(effort: Effort) -> Outcome:
        with Rig(seed=effort.seed, sensors=effort.sensors) as rig:
            rig.activate().run(SETTLED)
            begin = rig.cycle_count
            rig.clock_offset_s = jump_s
            rig.run(300)
            hold = first_cycle(rig, State.HOLD, begin)
            step = float(rig.seen.steps()[begin - 1 :].max())
            path, jumps = rig.seen.path(begin), rig.session.watch.clock_jumps
            causes = {c for s, c in zip(rig.seen.state[begin:], rig.seen.cause[begin:], strict=True) if s == State.HOLD}
        return Outcome(
            hold == 1 and jumps == 1 and causes == {Cause.CLOCK} and step <= LARGEST_STEP_M,
            f"hold in the same cycle, counted once; {described(path)}",
            step,
            None if hold is None else hold * PERIOD_S,
        )

    return run


def _clock_rate(rate: float) -> Callable[[Effort], Outcome]:
    def run(effort: Effort) -> Outcome:
        with Rig(seed=effort.seed, sensors=effort.sensors) as rig:
            rig.activate().run(SETTLED)
            begin = rig.cycle_count
            rig.clock_offset_s, rig.clock_rate = rig.now_s * (1.0 - rate), rate
            rig.run(1_000)
            hold = first_cycle(rig, State.HOLD, begin)
            again = sum(part == "active" for part in rig.seen.path(begin)) - 1
            step = float(rig.seen.steps()[begin - 1 :].max())
            path = rig.seen.path(begin)
        drifts = abs(rate - 1.0) * 250 > 2.0
        passed = (hold is not None and hold <= 250 and again == 0) if drifts else hold is None
        return Outcome(
            passed and step <= LARGEST_STEP_M, described(path), step, None if hold is None else hold * PERIOD_S
        )

    return run


SCENARIOS: Final = (
    Scenario("R20", "time-of-day", "the time of day jumps by hours and years in every cycle", "no effect", _wall_clock),
    Scenario("R21", "clock-ahead", "the computer's clock jumps 20 ms ahead", "hold, counted", _clock_jump(0.02)),
    Scenario("R21", "clock-back", "it falls 20 ms behind", "hold, counted", _clock_jump(-0.02)),
    Scenario(
        "R21", "cycle-4.1ms", "the controller's cycle is 4.1 ms", "stops within 1 s, does not limp", _clock_rate(1.025)
    ),
    Scenario("R21", "cycle-3.9ms", "it is 3.9 ms", "the same", _clock_rate(0.975)),
    Scenario("R21", "drift-100ppm", "the clocks drift by 100 ppm", "no effect", _clock_rate(1.0001)),
)
