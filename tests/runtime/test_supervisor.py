"""The supervisor against its rules, from every state and for every input."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import pytest
from hypothesis import given, settings, strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from counterflex.core.errors import InputError
from counterflex.core.records import Records, records
from counterflex.runtime.state.chosen import SUPERVISION
from counterflex.runtime.state.memory import SUPERVISED, SUPERVISOR
from counterflex.runtime.state.supervisor import (
    Cause,
    State,
    SupervisorSettings,
    risen,
    supervise,
)

SETTINGS = records(SUPERVISION)
SETTINGS[0] = SupervisorSettings(hold=5, good=3, rise=4, stop=2, returns=2, calm=10).packed()
LEGAL = {
    State.IDLE: {State.READY},
    State.READY: {State.IDLE, State.ARMED, State.FAULT},
    State.ARMED: {State.READY, State.ACTIVE, State.FAULT},
    State.ACTIVE: {State.HOLD, State.RAMP_OUT, State.FAULT},
    State.HOLD: {State.ACTIVE, State.RAMP_OUT, State.FAULT},
    State.RAMP_OUT: {State.READY, State.IDLE, State.HOLD, State.FAULT},
    State.FAULT: {State.IDLE},
}


def inputs(**values: int) -> Records:
    out = records(SUPERVISED)
    out[0].telegram = 1
    for name, value in values.items():
        out[0][{"zero": "at_zero", "cut": "in_cut"}.get(name, name)] = value
    return out


def after(state: State, **values: int) -> tuple[State, Cause]:
    at = records(SUPERVISOR)
    at[0].state = state
    supervise(at[0], inputs(**values)[0], SETTINGS[0])
    return State(int(at[0].state)), Cause(int(at[0].cause))


def test_the_way_in_is_deliberate() -> None:
    at = records(SUPERVISOR)
    expected = [
        ({"healthy": 1, "zero": 1}, State.READY),
        ({"healthy": 1, "zero": 1, "enable": 1}, State.READY),
        ({"healthy": 1, "zero": 1, "enable": 1, "arm": 1}, State.READY),
        ({"healthy": 1, "zero": 1, "arm": 1}, State.ARMED),
        ({"healthy": 1, "zero": 1}, State.ARMED),
        ({"healthy": 1, "zero": 1, "enable": 1}, State.ACTIVE),
    ]
    for values, state in expected:
        supervise(at[0], inputs(**values)[0], SETTINGS[0])
        assert State(int(at[0].state)) == state


ALL = [
    dict(zip(("healthy", "arm", "enable", "stop", "reset", "zero", "stands"), bits, strict=True))
    for bits in itertools.product((0, 1), repeat=7)
]


@pytest.mark.parametrize("state", list(State))
def test_every_transition_is_a_legal_one(state: State) -> None:
    for values in ALL:
        for soft, hard in (
            (0, 0),
            (Cause.FORCE_STALE, 0),
            (0, Cause.NOT_FINITE),
            (Cause.FORCE_STALE, Cause.NOT_FINITE),
        ):
            found, _ = after(state, **values, soft=soft, hard=hard)
            assert found == state or found in LEGAL[state]


@pytest.mark.parametrize("state", [State.READY, State.ARMED, State.ACTIVE, State.HOLD, State.RAMP_OUT])
def test_a_hard_cause_is_a_fault_in_the_same_cycle_whatever_else_happens(state: State) -> None:
    for values in ALL:
        assert after(state, **values, hard=Cause.DIVERGENCE) == (State.FAULT, Cause.DIVERGENCE)


def test_a_soft_cause_freezes_in_the_same_cycle() -> None:
    for values in ALL:
        assert after(State.ACTIVE, **values, soft=Cause.FORCE_STALE) == (State.HOLD, Cause.FORCE_STALE)


def test_only_a_person_leads_out_of_a_fault_and_only_at_zero() -> None:
    for values in ALL:
        found, _ = after(State.FAULT, **values)
        assert found == (State.IDLE if values["reset"] and values["zero"] else State.FAULT)


def test_a_reset_may_come_before_the_next_session_of_the_controller() -> None:
    """In a fault its telegrams are not answered: it would not wait for the reset."""
    for zero, state in ((1, State.IDLE), (0, State.FAULT)):
        assert after(State.FAULT, reset=1, zero=zero, hard=Cause.TELEGRAMS_STOPPED)[0] == state


@given(
    st.lists(
        st.tuples(st.sampled_from(ALL), st.sampled_from([0, 0, 0, 8]), st.sampled_from([0] * 9 + [15])), max_size=80
    )
)
def test_nothing_acts_that_was_not_armed_since_the_last_fault(
    cycles: list[tuple[dict[str, int], int, int]],
) -> None:
    at, armed = records(SUPERVISOR), False
    for values, soft, hard in cycles:
        supervise(at[0], inputs(**values, soft=soft, hard=hard)[0], SETTINGS[0])
        state = State(int(at[0].state))
        if state == State.FAULT:
            armed = False
        if state == State.ARMED:
            armed = True
        assert armed or state != State.ACTIVE


@dataclass(frozen=True)
class Row:
    """A transition: from, to, cause (None: as before), and what it needs; what is not named may be anything.

    ``lasts``: HOLD has lasted as long as it may; ``calm``: nothing wrong for long enough, and a return is left;
    ``process``: it was held by the process monitor; ``ending``: it was asked to end before; ``away``: the correction is
    away in the cut; ``cut``: material is or may be cut.
    """

    before: State
    after: State
    cause: Cause | None
    needs: str = ""

    def fits(self, values: dict[str, int]) -> bool:
        for word in self.needs.split():
            if values[word.removeprefix("not-")] != (0 if word.startswith("not-") else 1):
                return False
        return True


SOFT, HARD, BEFORE = Cause.FORCE_STALE, Cause.NOT_FINITE, Cause.TRACKER_LOST
# The first row that fits holds; where none does, nothing changes.
TABLE = [
    Row(State.IDLE, State.READY, Cause.ENABLE_LOST, "not-hard not-soft healthy zero not-held away"),
    Row(State.IDLE, State.READY, Cause.NONE, "not-hard not-soft healthy zero not-held"),
    Row(State.IDLE, State.READY, None, "not-hard not-soft healthy zero held"),
    Row(State.READY, State.FAULT, HARD, "hard"),
    Row(State.READY, State.IDLE, SOFT, "not-healthy soft"),
    Row(State.READY, State.IDLE, None, "not-healthy"),
    Row(State.READY, State.ARMED, Cause.NONE, "arm not-stop not-soft zero not-enable not-away"),
    Row(State.ARMED, State.FAULT, HARD, "hard"),
    Row(State.ARMED, State.READY, Cause.OPERATOR, "stop"),
    Row(State.ARMED, State.READY, SOFT, "soft"),
    Row(State.ARMED, State.READY, Cause.ENABLE_LOST, "away"),
    Row(State.ARMED, State.ACTIVE, Cause.NONE, "enable"),
    Row(State.ACTIVE, State.FAULT, HARD, "hard"),
    Row(State.ACTIVE, State.HOLD, SOFT, "soft"),
    Row(State.ACTIVE, State.HOLD, Cause.OPERATOR, "stop cut not-stands"),
    Row(State.ACTIVE, State.RAMP_OUT, Cause.OPERATOR, "stop"),
    Row(State.ACTIVE, State.HOLD, Cause.ENABLE_LOST, "not-enable away cut not-stands"),
    Row(State.ACTIVE, State.RAMP_OUT, Cause.ENABLE_LOST, "not-enable away"),
    Row(State.ACTIVE, State.HOLD, Cause.PROGRAM, "not-enable cut not-stands"),
    Row(State.ACTIVE, State.RAMP_OUT, Cause.PROGRAM, "not-enable"),
    Row(State.HOLD, State.FAULT, HARD, "hard"),
    Row(State.HOLD, State.RAMP_OUT, None, "stop not-cut"),
    Row(State.HOLD, State.RAMP_OUT, None, "stop stands"),
    Row(State.HOLD, State.RAMP_OUT, None, "not-enable not-cut"),
    Row(State.HOLD, State.RAMP_OUT, None, "not-enable stands"),
    Row(State.HOLD, State.RAMP_OUT, None, "ending not-cut"),
    Row(State.HOLD, State.RAMP_OUT, None, "ending stands"),
    Row(State.HOLD, State.RAMP_OUT, None, "lasts stands"),
    Row(State.HOLD, State.FAULT, Cause.HELD_TOO_LONG, "lasts not-stands"),
    Row(State.HOLD, State.ACTIVE, Cause.NONE, "calm not-soft not-process not-stop enable not-ending"),
    Row(State.RAMP_OUT, State.FAULT, HARD, "hard"),
    Row(State.RAMP_OUT, State.READY, None, "zero healthy"),
    Row(State.RAMP_OUT, State.IDLE, None, "zero not-healthy"),
    Row(State.RAMP_OUT, State.FAULT, Cause.HELD_TOO_LONG, "cut not-stands lasts"),
    Row(State.RAMP_OUT, State.HOLD, None, "cut not-stands"),
    Row(State.FAULT, State.IDLE, Cause.ENABLE_LOST, "reset zero not-hard away"),
    Row(State.FAULT, State.IDLE, Cause.NONE, "reset zero not-hard"),
]


def expected(state: State, before: Cause, values: dict[str, int]) -> tuple[State, Cause]:
    for row in TABLE:
        if row.before == state and row.fits(values):
            return row.after, before if row.cause is None else row.cause
    return state, before


@pytest.mark.parametrize("state", list(State))
def test_every_transition_stands_in_the_table_and_every_row_is_met(state: State) -> None:
    """Every state with every input: the supervisor does what the table says, and no row is idle."""
    met = set()
    of_hold, of_others = {"calm", "process", "ending"}, {"arm", "reset", "held"}
    told = ("healthy", "arm", "enable", "stop", "reset", "zero", "stands", "away", "cut")
    names = (*told, "soft", "hard", "lasts", "calm", "process", "held", "ending")
    without = of_others if state == State.HOLD else of_hold
    varied = [name for name in names if name not in without]
    for bits in itertools.product((0, 1), repeat=len(varied)):
        everything = dict.fromkeys(names, 0) | dict(zip(varied, bits, strict=True))
        before = Cause.PROCESS_OVERLOAD if everything["process"] else BEFORE
        at = records(SUPERVISOR)
        at[0].state, at[0].cause, at[0].feed_hold = state, before, everything["held"]
        at[0].held, at[0].good = 5 * everything["lasts"], 3 * everything["calm"]
        at[0].ending = everything["ending"]
        values = {name: everything[name] for name in told}
        given_now = inputs(**values, soft=SOFT * everything["soft"], hard=HARD * everything["hard"])
        supervise(at[0], given_now[0], SETTINGS[0])
        found = State(int(at[0].state)), Cause(int(at[0].cause))
        assert found == expected(state, before, everything), everything
        met |= {k for k, row in enumerate(TABLE) if row.before == state and row.fits(everything)}
    assert met == {k for k, row in enumerate(TABLE) if row.before == state}


def started(state: State, **places: int) -> Records:
    at = records(SUPERVISOR)
    at[0].state, at[0].risen = state, 4
    for name, value in places.items():
        at[0][name] = value
    return at


def run(at: Records, cycles: int, **values: int) -> list[tuple[State, int, int]]:
    """States, feed hold and Stop of some cycles with the same inputs."""
    out = []
    for _ in range(cycles):
        supervise(at[0], inputs(**values)[0], SETTINGS[0])
        out.append((State(int(at[0].state)), int(at[0].feed_hold), int(at[0].stop > 0)))
    return out


def test_hold_ends_when_all_is_well_for_long_enough_and_the_feed_goes_on() -> None:
    at = started(State.ACTIVE)
    run(at, 1, enable=1, soft=8)
    found = run(at, 4, enable=1, stands=1)
    assert [state for state, _, _ in found] == [State.HOLD, State.HOLD, State.HOLD, State.ACTIVE]
    assert [hold for _, hold, _ in found] == [1, 1, 1, 0]
    assert at[0].cause == Cause.NONE
    assert at[0].risen == 4
    assert at[0].good == 0


def test_hold_does_not_limp() -> None:
    """After two returns the third hold is left by a person only; with time one return is forgotten."""
    for calm, last in ((0, State.HOLD), (11, State.ACTIVE)):
        at = started(State.ACTIVE)
        for _ in range(2):
            run(at, 1, enable=1, soft=8)
            assert run(at, 4, enable=1)[-1][0] == State.ACTIVE
        run(at, calm, enable=1)
        run(at, 1, enable=1, soft=8)
        assert run(at, 4, enable=1)[-1][0] == last


def test_a_robot_that_stands_is_ramped_out_with_its_feed_held_then_stopped() -> None:
    at = started(State.ACTIVE)
    held = run(at, 8, enable=1, soft=8, stands=1)
    assert [state for state, _, _ in held].index(State.RAMP_OUT) == 6
    assert at[0].cause == Cause.FORCE_STALE
    assert all(hold == 1 for _, hold, _ in held)
    assert all(stop == 0 for _, _, stop in held)
    behind = run(at, 5, enable=1, zero=1)
    assert [state for state, _, _ in behind] == [State.IDLE] * 5
    assert [stop for _, _, stop in behind] == [1, 1, 0, 0, 0]
    assert all(hold == 1 for _, hold, _ in behind)
    assert run(at, 1, enable=1, zero=1, healthy=1) == [(State.READY, 1, 0)]
    assert at[0].cause == Cause.FORCE_STALE
    assert run(at, 2, enable=1, zero=1, healthy=1, reset=1)[-1] == (State.READY, 0, 0)


def test_a_robot_that_goes_on_is_stopped_with_its_correction() -> None:
    """No feed hold wired, or not obeyed: never uncorrected in the cut."""
    at = started(State.ACTIVE)
    found = run(at, 12, enable=1, soft=8)
    states = [state for state, _, _ in found]
    assert State.RAMP_OUT not in states
    assert states.index(State.FAULT) == 6
    assert at[0].cause == Cause.HELD_TOO_LONG


def test_a_robot_that_stands_and_goes_on_in_turn_is_stopped_after_the_same_time() -> None:
    """Each ramp that is broken off would begin the hold anew: the stop would come to no end."""
    at = started(State.ACTIVE)
    run(at, 1, enable=1, stop=1, cut=1)
    found = []
    for _ in range(10):
        found += run(at, 2, enable=1, stop=1, cut=1, stands=1) + run(at, 1, enable=1, stop=1, cut=1)
    states = [state for state, _, _ in found]
    assert states.count(State.RAMP_OUT) > 4
    assert states[-1] == State.FAULT
    assert at[0].cause == Cause.HELD_TOO_LONG


def test_a_feed_that_is_held_is_not_let_go_by_a_program_that_switches_off_in_the_cut() -> None:
    at = started(State.READY, feed_hold=1, cause=Cause.OPERATOR)
    assert run(at, 3, healthy=1, zero=1, cut=1)[-1][1] == 1
    assert run(at, 1, healthy=1, zero=1)[-1][1] == 0


@pytest.mark.parametrize("who", ["program", "operator"])
def test_who_ends_the_correction_decides_about_the_feed(who: str) -> None:
    """The program that switches the correction off has left the cut; the operator may be anywhere."""
    at = started(State.ACTIVE)
    values = {"enable": 0} if who == "program" else {"enable": 1, "stop": 1}
    found = run(at, 3, **values) + run(at, 2, **values, zero=1)
    held = int(who == "operator")
    assert [hold for _, hold, _ in found] == [held] * 5
    assert found[-1][2] == held
    assert run(at, 1, enable=0, zero=1)[0][1:] == (0, 0)


def test_fading_in_is_smooth_and_whole() -> None:
    share = [risen(k, 50) for k in range(60)]
    assert share[0] == 0.0
    assert share[50] == share[59] == 1.0
    assert all(b >= a for a, b in itertools.pairwise(share))
    assert share[1] < 1e-4


def test_zero_cycles_are_no_setting() -> None:
    with pytest.raises(InputError):
        SupervisorSettings(hold=0).packed()


class Operation(RuleBasedStateMachine):
    """Any sequence of events, with the rules that hold throughout."""

    def __init__(self) -> None:
        super().__init__()
        self.at = records(SUPERVISOR)
        self.armed = self.asked = self.asked_to_end = False
        self.enable = self.cut = 0
        self.held = 0

    @property
    def state(self) -> State:
        return State(int(self.at[0].state))

    def step(self, **values: int) -> None:
        before = self.state
        supervise(self.at[0], inputs(enable=self.enable, cut=self.cut, **values)[0], SETTINGS[0])
        after = self.state
        if before in (State.ACTIVE, State.HOLD, State.RAMP_OUT) and (values.get("stop") or not self.enable):
            self.asked_to_end = True
        if after in (State.IDLE, State.READY, State.ARMED, State.FAULT):
            self.asked_to_end = False
        assert not self.asked_to_end or after in (State.HOLD, State.RAMP_OUT)
        if after == State.RAMP_OUT and before != State.RAMP_OUT:
            assert values.get("stands") or not self.cut
        if before == State.RAMP_OUT and self.cut and not values.get("stands"):
            assert after != State.RAMP_OUT
        self.held = self.held + 1 if after == State.HOLD else 0 if after != State.RAMP_OUT else self.held
        assert self.held <= 5 + 2  # cycles of the setting, and those in which it begins
        assert after == before or after in LEGAL[before]
        if after == State.ARMED:
            self.armed = True
        if after == State.FAULT:
            self.armed = False
        if after in (State.HOLD, State.FAULT):
            self.asked = True
        elif after == State.ACTIVE or values.get("reset") or not (self.enable or self.cut):
            self.asked = False

    @rule(cycles=st.integers(1, 9), healthy=st.booleans(), stands=st.booleans(), zero=st.booleans())
    def well(self, cycles: int, healthy: bool, stands: bool, zero: bool) -> None:
        for _ in range(cycles):
            self.step(healthy=int(healthy), stands=int(stands), zero=int(zero or self.state <= State.ARMED))

    @rule(cause=st.sampled_from([Cause.FORCE_STALE, Cause.PROCESS_OVERLOAD]), stands=st.booleans())
    def soft(self, cause: Cause, stands: bool) -> None:
        self.step(soft=cause, stands=int(stands))

    @rule()
    def hard(self) -> None:
        self.step(hard=Cause.DIVERGENCE)

    @rule(cut=st.integers(0, 1))
    def material(self, cut: int) -> None:
        self.cut = cut

    @rule(on=st.integers(0, 1))
    def program(self, on: int) -> None:
        self.enable = on
        self.step(healthy=1, zero=int(self.state <= State.ARMED))

    @rule()
    def arm(self) -> None:
        self.step(arm=1, healthy=1, zero=int(self.state <= State.ARMED))

    @rule(zero=st.booleans())
    def reset(self, zero: bool) -> None:
        self.step(reset=1, healthy=1, zero=int(zero or self.state <= State.ARMED))

    @precondition(lambda self: self.state not in (State.IDLE, State.READY))
    @rule()
    def stop(self) -> None:
        self.step(stop=1, healthy=1, zero=int(self.state <= State.ARMED))

    @invariant()
    def acts_only_when_armed(self) -> None:
        assert self.armed or self.state != State.ACTIVE

    @invariant()
    def a_feed_hold_stays(self) -> None:
        if self.asked:
            assert self.at[0].feed_hold == 1

    @invariant()
    def stop_goes_with_a_held_feed(self) -> None:
        assert self.at[0].stop == 0 or (self.at[0].feed_hold == 1 and self.state <= State.READY)


TestOperation = Operation.TestCase
TestOperation.settings = settings(max_examples=60, stateful_step_count=60, deadline=None)
