"""The supervisor against its rules, from every state and for every input."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from counterflex.core.arrays import Int
from counterflex.core.errors import InputError
from counterflex.runtime.supervisor import (
    AT_CAUSE,
    AT_CYCLES,
    AT_GOOD,
    AT_RISE,
    AT_STATE,
    IN_ARM,
    IN_AT_ZERO,
    IN_ENABLE,
    IN_HARD,
    IN_HEALTHY,
    IN_NEAR,
    IN_RESET,
    IN_SOFT,
    IN_STOP,
    IN_TELEGRAM,
    INPUTS,
    STATES,
    Cause,
    State,
    SupervisorSettings,
    risen,
    supervise,
)

SETTINGS = SupervisorSettings(hold=5, good=3, rise=4, stop=2).packed()
LEGAL = {
    State.IDLE: {State.READY},
    State.READY: {State.IDLE, State.ARMED, State.FAULT},
    State.ARMED: {State.READY, State.ACTIVE, State.FAULT},
    State.ACTIVE: {State.HOLD, State.RAMP_OUT, State.FAULT},
    State.HOLD: {State.ACTIVE, State.RAMP_OUT, State.FAULT},
    State.RAMP_OUT: {State.READY, State.IDLE, State.FAULT},
    State.FAULT: {State.IDLE},
}


def inputs(**values: int) -> Int:
    names = {
        "telegram": IN_TELEGRAM,
        "healthy": IN_HEALTHY,
        "arm": IN_ARM,
        "enable": IN_ENABLE,
        "stop": IN_STOP,
        "reset": IN_RESET,
        "soft": IN_SOFT,
        "hard": IN_HARD,
        "zero": IN_AT_ZERO,
        "near": IN_NEAR,
    }
    out = np.zeros(INPUTS, dtype=np.int64)
    out[IN_TELEGRAM] = 1
    for name, value in values.items():
        out[names[name]] = value
    return out


def after(state: State, **values: int) -> tuple[State, Cause]:
    at = np.zeros(STATES, dtype=np.int64)
    at[AT_STATE] = state
    supervise(at, inputs(**values), SETTINGS)
    return State(int(at[AT_STATE])), Cause(int(at[AT_CAUSE]))


def test_the_way_in_is_deliberate() -> None:
    at = np.zeros(STATES, dtype=np.int64)
    expected = [
        ({"healthy": 1, "zero": 1}, State.READY),
        ({"healthy": 1, "zero": 1, "enable": 1}, State.READY),
        ({"healthy": 1, "zero": 1, "enable": 1, "arm": 1}, State.READY),
        ({"healthy": 1, "zero": 1, "arm": 1}, State.ARMED),
        ({"healthy": 1, "zero": 1}, State.ARMED),
        ({"healthy": 1, "zero": 1, "enable": 1}, State.ACTIVE),
    ]
    for values, state in expected:
        supervise(at, inputs(**values), SETTINGS)
        assert State(int(at[AT_STATE])) == state


ALL = [
    dict(zip(("healthy", "arm", "enable", "stop", "reset", "zero", "near"), bits, strict=True))
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


@given(
    st.lists(
        st.tuples(st.sampled_from(ALL), st.sampled_from([0, 0, 0, 8]), st.sampled_from([0] * 9 + [15])), max_size=80
    )
)
def test_nothing_acts_that_was_not_armed_since_the_last_fault(
    cycles: list[tuple[dict[str, int], int, int]],
) -> None:
    at, armed = np.zeros(STATES, dtype=np.int64), False
    for values, soft, hard in cycles:
        supervise(at, inputs(**values, soft=soft, hard=hard), SETTINGS)
        state = State(int(at[AT_STATE]))
        if state == State.FAULT:
            armed = False
        if state == State.ARMED:
            armed = True
        assert armed or state != State.ACTIVE


def test_hold_ends_when_all_is_well_for_long_enough_and_bumpless() -> None:
    at = np.zeros(STATES, dtype=np.int64)
    at[AT_STATE] = State.ACTIVE
    at[AT_RISE] = 4
    supervise(at, inputs(enable=1, soft=8), SETTINGS)
    states = []
    for _ in range(4):
        supervise(at, inputs(enable=1, near=1), SETTINGS)
        states.append(State(int(at[AT_STATE])))
    assert states == [State.HOLD, State.HOLD, State.HOLD, State.ACTIVE]
    assert at[AT_CAUSE] == Cause.NONE
    assert at[AT_RISE] == 4
    assert at[AT_GOOD] == 0


def test_hold_that_lasts_ramps_out_and_keeps_its_cause() -> None:
    at = np.zeros(STATES, dtype=np.int64)
    at[AT_STATE] = State.ACTIVE
    states = []
    for _ in range(8):
        supervise(at, inputs(enable=1, soft=8, near=1), SETTINGS)
        states.append(State(int(at[AT_STATE])))
    assert states.index(State.RAMP_OUT) == 6
    assert at[AT_CAUSE] == Cause.FORCE_STALE
    supervise(at, inputs(zero=1), SETTINGS)
    assert at[AT_STATE] == State.IDLE
    assert at[AT_CYCLES] == 0


def test_fading_in_is_smooth_and_whole() -> None:
    share = [risen(k, 50) for k in range(60)]
    assert share[0] == 0.0
    assert share[50] == share[59] == 1.0
    assert all(b >= a for a, b in itertools.pairwise(share))
    assert share[1] < 1e-4


def test_zero_cycles_are_no_setting() -> None:
    with pytest.raises(InputError):
        SupervisorSettings(hold=0).packed()
