"""Which tool a run uses where, when its zero is taken anew, and when it may arm itself again."""

from __future__ import annotations

import numpy as np
import pytest

from counterflex.core.errors import InputError
from counterflex.protocols.session.tare import CYCLES, Tare
from counterflex.protocols.session.tool_change import ToolChange, next_tools
from counterflex.runtime.state.states import Cause, State

TOOLS = np.array([0, 0, 1, 1, 1, 1, 2, 2, 2, 2])
CUTTING = np.array([0, 0, 0, 1, 1, 0, 0, 0, 1, 0], dtype=bool)


def tared() -> Tare:
    tare = Tare(15.0, 5.0)
    for _ in range(CYCLES):
        tare.take(np.zeros(6))
    assert tare.accepted
    return tare


def test_the_tool_is_that_of_the_next_cut() -> None:
    assert next_tools(TOOLS, CUTTING).tolist() == [1, 1, 1, 1, 1, 2, 2, 2, 2, 2]
    assert next_tools(TOOLS, np.zeros(10, dtype=bool)).tolist() == [2] * 10


def test_a_change_that_the_program_made_room_for() -> None:
    """Ramped out by the program, the next tool's constants, a new zero, armed again; the first tool is no change."""
    used: list[int] = []
    change, tare = ToolChange(TOOLS, CUTTING, used.append), tared()

    def cycle(state: State, place: float, cause: Cause = Cause.NONE) -> int:
        return change.watch(int(state), int(cause), place, tare)

    assert cycle(State.IDLE, -1.0) == Cause.NONE
    assert (used, tare.accepted, change.changes) == ([1], True, 0)
    for state, place in ((State.READY, 0.0), (State.ARMED, 1.0), (State.ACTIVE, 3.5)):
        assert cycle(state, place) == Cause.NONE
        assert not change.arms
    cycle(State.RAMP_OUT, 5.2, Cause.PROGRAM)
    assert used == [1]
    cycle(State.READY, 5.2, Cause.PROGRAM)
    assert (used, tare.accepted, change.changes, change.arms) == ([1, 2], False, 1, True)
    cycle(State.IDLE, 5.2, Cause.PROGRAM)
    assert change.arms
    cycle(State.ARMED, 5.2)
    assert not change.arms
    assert cycle(State.ACTIVE, 8.1) == Cause.NONE


@pytest.mark.parametrize("cause", [Cause.OPERATOR, Cause.FORCE_INVALID, Cause.ENABLE_LOST])
def test_what_ended_otherwise_is_armed_by_a_person(cause: Cause) -> None:
    change, tare = ToolChange(TOOLS, CUTTING, lambda _: None), tared()
    for state, place, why in (
        (State.IDLE, 0.0, Cause.NONE),
        (State.ACTIVE, 4.0, Cause.NONE),
        (State.RAMP_OUT, 5.5, cause),
        (State.READY, 5.5, cause),
    ):
        change.watch(int(state), int(why), place, tare)
    assert change.changes == 1
    assert not change.arms


def test_a_cut_with_the_wrong_tool_is_held() -> None:
    """A program that goes on through its change with the correction active."""
    change, tare = ToolChange(TOOLS, CUTTING, lambda _: None), tared()
    change.watch(int(State.IDLE), 0, 0.0, tare)
    assert change.watch(int(State.ACTIVE), 0, 7.0, tare) == Cause.NONE
    assert change.watch(int(State.ACTIVE), 0, 8.0, tare) == Cause.FORCE_INVALID


def test_rows_that_do_not_match_are_refused() -> None:
    with pytest.raises(InputError, match="tools of a plan"):
        ToolChange(TOOLS, CUTTING[:5], lambda _: None)
