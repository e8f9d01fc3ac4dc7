"""Clocks that jump and drift: R20 and R21."""

from __future__ import annotations

import contextlib
import itertools
from functools import partial
from typing import Final
from unittest import mock

import numpy as np

from counterflex.core.units import NS
from counterflex.runtime.state.supervisor import Cause, State
from counterflex_lab.faults.aftermath import Aftermath, described, settled
from counterflex_lab.faults.rig import rigged
from counterflex_lab.faults.scenario import Effort, Outcome, Scenario


def _wall_clock(effort: Effort) -> Outcome:
    """The time of day jumps in every cycle: the same run, bit for bit."""
    jumps = itertools.cycle([0.0, 3600.0, 1e9, 2e9])
    runs = []
    for patched in (False, True):
        with rigged(effort) as rig, contextlib.ExitStack() as stack:
            after = Aftermath(rig.activate())
            if patched:
                stack.enter_context(mock.patch("time.time", side_effect=jumps))
                stack.enter_context(mock.patch("time.time_ns", side_effect=(round(s / NS) for s in jumps)))
            rig.run(effort.pick(1_000, 300))
            runs.append((np.array(rig.seen.correction_m), rig.seen.state))
    same = bool(np.array_equal(runs[0][0], runs[1][0])) and runs[0][1] == runs[1][1]
    return Outcome(same, "corrections and states the same bit for bit" if same else "DIFFERENT", after.step_m)


def _clock_jump(effort: Effort, *, jump_s: float) -> Outcome:
    with rigged(effort) as rig:
        after = settled(rig)
        rig.clock_offset_s = jump_s
        rig.run(300)
    hold, since = after.first(State.HOLD), slice(after.begin, None)
    causes = {c for s, c in zip(rig.seen.state[since], rig.seen.cause[since], strict=True) if s == State.HOLD}
    return after.outcome(
        hold == 1 and rig.session.watch.now.clock_jumps == 1 and causes == {Cause.CLOCK},
        f"hold in the same cycle, counted once; {described(after.path)}",
        safe_s=after.first_s(State.HOLD),
    )


def _clock_rate(effort: Effort, *, rate: float) -> Outcome:
    with rigged(effort) as rig:
        after = settled(rig)
        rig.clock_offset_s, rig.clock_rate = rig.now_s * (1.0 - rate), rate
        rig.run(1_000)
    hold = after.first(State.HOLD)
    drifts = abs(rate - 1.0) * 250 > 2.0
    passed = (hold is not None and hold <= 250 and after.again == 0) if drifts else hold is None
    return after.outcome(passed, described(after.path), safe_s=after.first_s(State.HOLD))


SCENARIOS: Final = (
    Scenario("R20", "time-of-day", "the time of day jumps by hours and years in every cycle", "no effect", _wall_clock),
    Scenario(
        "R21",
        "clock-ahead",
        "the computer's clock jumps 20 ms ahead",
        "hold, counted",
        partial(_clock_jump, jump_s=0.02),
    ),
    Scenario("R21", "clock-back", "it falls 20 ms behind", "hold, counted", partial(_clock_jump, jump_s=-0.02)),
    Scenario(
        "R21",
        "cycle-4.1ms",
        "the controller's cycle is 4.1 ms",
        "stops within 1 s, does not limp",
        partial(_clock_rate, rate=1.025),
    ),
    Scenario("R21", "cycle-3.9ms", "it is 3.9 ms", "the same", partial(_clock_rate, rate=0.975)),
    Scenario("R21", "drift-100ppm", "the clocks drift by 100 ppm", "no effect", partial(_clock_rate, rate=1.0001)),
)
