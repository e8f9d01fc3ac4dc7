"""The pure step under any sequence of events: what must hold after every cycle, whatever happened before."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, settings, strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from counterflex.core.arrays import Float
from counterflex.geometry import pose, rotation
from counterflex.runtime.cycle_inputs import CycleInputs
from counterflex.runtime.loop import Loop
from counterflex.runtime.state.supervisor import Cause, State
from counterflex.runtime.step.place import MOST_ELAPSED
from counterflex.runtime.step.supervise import SESSION_S
from counterflex_lab.faults.demonstration import demo_cell, force_only

Q = np.radians([0.0, -90.0, 120.0, 0.0, 30.0, 0.0])
LEGAL = {
    State.IDLE: {State.READY},
    State.READY: {State.IDLE, State.ARMED, State.FAULT},
    State.ARMED: {State.READY, State.ACTIVE, State.FAULT},
    State.ACTIVE: {State.HOLD, State.RAMP_OUT, State.FAULT},
    State.HOLD: {State.ACTIVE, State.RAMP_OUT, State.FAULT},
    State.RAMP_OUT: {State.READY, State.IDLE, State.HOLD, State.FAULT},
    State.FAULT: {State.IDLE},
}
SETTINGS = force_only()
LOOP = Loop(demo_cell().chain, SETTINGS, demo_cell().T_base_part)
STEP_M = SETTINGS.translation.speed * SETTINGS.period_s
RADIUS_M = SETTINGS.translation.radius
WORDS = st.sampled_from([Cause.NONE, Cause.FORCE_STALE, Cause.TELEGRAMS_SCATTERED, Cause.CLOCK])
HARD = st.sampled_from([Cause.FOREIGN_PEER, Cause.TELEGRAM_MALFORMED, Cause.SESSION_RESTARTED, Cause.INTERNAL])


class StepMachine(RuleBasedStateMachine):
    """Robot, sensor, operator and network do as they like."""

    @initialize()
    def begin(self) -> None:
        self.loop = LOOP
        self.loop.reset()
        self.enable = False
        self.force = np.zeros(6)
        self.x = 0.0
        self.armed = False
        self.allowed_m = 0.0
        self.zeroed = False
        self.silent = 0
        self.before: Float = np.zeros(3)
        self.state_before = self.state = State.IDLE

    def cycle(self, **inputs: Any) -> None:
        given = {"elapsed": 1, "healthy": True, "enable": self.enable, **inputs}
        if given["elapsed"]:
            self.x = (self.x + 1e-4 * given["elapsed"]) % 0.1
        self.before, self.state_before = self.loop.correction[:3].copy(), self.loop.state
        T = pose.make(rotation.about_x(np.pi), np.array([0.05 + self.x, 0.0, 0.0]))
        w = given.pop("w", self.force)
        self.loop.feed(CycleInputs(T_part_tcp=T, q=Q, w_tcp_part=w, **given))
        self.loop.run()
        self.state = self.loop.state
        self.allowed_m = STEP_M * min(given["elapsed"], MOST_ELAPSED)
        self.silent = 0 if given["elapsed"] else self.silent + 1
        # Nothing is in effect in another session, nor once the old one cannot go on any more.
        over = self.silent * SETTINGS.period_s > SESSION_S and self.state_before == State.FAULT
        self.zeroed = given.get("hard") == Cause.SESSION_RESTARTED or over
        if self.state == State.ARMED:
            self.armed = True
        if self.state in (State.FAULT, State.IDLE, State.READY):
            self.armed = False

    @rule(n=st.integers(1, 60))
    def go_on(self, n: int) -> None:
        for _ in range(n):
            self.cycle()
            self.holds()

    @rule(n=st.integers(2, 14))
    def lose(self, n: int) -> None:
        for _ in range(n - 1):
            self.cycle(elapsed=0)
            self.holds()
        self.cycle(elapsed=n)

    @rule(hard=HARD, n=st.integers(2, 14), reset=st.booleans())
    def lose_in_a_silent_fault(self, hard: Cause, n: int, reset: bool) -> None:
        """Nobody is answered any more, telegrams get lost and come again: the controller goes on with what it has."""
        self.cycle(hard=hard)
        self.holds()
        self.go_on(SETTINGS.supervisor.stop + 1)
        kept = self.loop.correction.copy()
        faulty = self.state == State.FAULT
        self.lose(n)
        self.holds()
        if faulty:
            assert self.state == State.FAULT
            assert np.array_equal(self.loop.correction, kept)
        if reset:
            self.cycle(reset=True)
            assert np.linalg.norm(kept) < 1e-6 or not faulty or self.state == State.FAULT

    @rule(reset=st.booleans())
    def the_controller_is_gone(self, reset: bool) -> None:
        """For longer than a session can go on without an answer: what comes then is another one."""
        for k in range(round(SESSION_S / SETTINGS.period_s) + 140):
            self.cycle(elapsed=0, reset=reset and k % 100 == 99)
            self.holds()
        self.cycle(hard=Cause.SESSION_RESTARTED, elapsed=1)

    @rule(fy=st.floats(-2500.0, 2500.0), fz=st.floats(-2500.0, 2500.0))
    def cut(self, fy: float, fz: float) -> None:
        self.force = np.array([0.0, fy, fz, 0.0, 0.0, 0.0])
        self.cycle()

    @rule()
    def arm_and_enable(self) -> None:
        self.enable = False
        self.cycle(arm=True)
        self.holds()
        self.enable = True
        self.cycle()

    @rule()
    def program_ends(self) -> None:
        self.enable = False
        self.cycle()

    @rule(soft=WORDS, n=st.integers(1, 140))
    def something_is_stale(self, soft: Cause, n: int) -> None:
        for _ in range(n):
            self.cycle(soft=soft)
            self.holds()

    @rule(hard=HARD)
    def something_must_not_be(self, hard: Cause) -> None:
        before = self.state
        self.cycle(hard=hard)
        assert self.state == (State.IDLE if before == State.IDLE else State.FAULT)

    @rule(place=st.integers(0, 5), value=st.sampled_from([np.nan, np.inf, -np.inf]))
    def a_number_is_none(self, place: int, value: float) -> None:
        w = self.force.copy()
        w[place] = value
        self.cycle(w=w)
        assert self.state in (State.IDLE, State.READY, State.HOLD, State.RAMP_OUT, State.FAULT)

    @rule()
    def stop(self) -> None:
        self.cycle(stop=True)
        assert self.state not in (State.ARMED, State.ACTIVE)

    @rule()
    def reset(self) -> None:
        self.cycle(reset=True)

    @rule()
    def sick(self) -> None:
        self.cycle(healthy=False)

    @invariant()
    def holds(self) -> None:
        """Finite, within the limit, within the elapsed cycles' step, by a legal way, and only after arming."""
        if not hasattr(self, "loop"):
            return
        correction = self.loop.correction[:3]
        assert np.all(np.isfinite(self.loop.correction))
        assert np.linalg.norm(correction) <= RADIUS_M * (1.0 + 1e-9)
        if not self.zeroed:
            assert np.linalg.norm(correction - self.before) <= self.allowed_m * (1.0 + 1e-9) + 1e-15
        else:  # a jump of the counter: nothing is in force in another session, what was sent last in the same one
            kept = np.linalg.norm(correction - self.before) <= self.allowed_m * (1.0 + 1e-9) + 1e-15
            assert self.state == State.IDLE or np.all(correction == 0.0) or kept
        assert self.state == self.state_before or self.state in LEGAL[self.state_before]
        assert self.armed or self.state not in (State.ACTIVE, State.HOLD, State.RAMP_OUT)
        if self.state in (State.IDLE, State.READY, State.ARMED):
            assert np.linalg.norm(correction) < 1e-6


def active() -> StepMachine:
    """A machine that has corrected 74 um and more."""
    machine = StepMachine()
    machine.begin()
    machine.go_on(3)
    machine.arm_and_enable()
    machine.cut(600.0, -300.0)
    machine.go_on(60)
    machine.go_on(60)
    assert machine.state == State.ACTIVE
    assert np.linalg.norm(machine.loop.correction[:3]) > 74e-6
    return machine


@pytest.mark.parametrize("n", range(2, 15))
@pytest.mark.parametrize("hard", [Cause.FOREIGN_PEER, Cause.INTERNAL])
def test_telegrams_lost_in_a_fault_leave_the_correction_as_it_is(hard: Cause, n: int) -> None:
    """Whose telegrams are lost for less than a second goes on with what it has: zero would be a jump for it.

    From the eleventh on the correction fell from 74 um to 0, and a reset then let the loop answer with zero.
    """
    active().lose_in_a_silent_fault(hard=hard, n=n, reset=True)


def test_a_controller_that_is_gone_is_reset_before_it_comes_again() -> None:
    """A second without telegrams ends its session: nothing is in effect, and a person's reset is taken."""
    machine = active()
    machine.something_must_not_be(hard=Cause.INTERNAL)
    machine.cycle(reset=True)
    assert int(machine.loop.state) == State.FAULT
    machine.the_controller_is_gone(reset=True)
    machine.holds()
    assert machine.loop.state == State.IDLE
    assert not np.any(machine.loop.correction)


StepMachine.TestCase.settings = settings(
    max_examples=20, stateful_step_count=25, deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
TestStepMachine = StepMachine.TestCase
