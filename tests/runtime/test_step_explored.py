"""Supervisor, debounced Enable, arming and sessions explored together, with the compiled stage of the step."""

from __future__ import annotations

import functools
import inspect
import sys
from types import ModuleType
from typing import Final, cast

import numba
import numpy as np
import pytest

from counterflex.runtime.state.states import State
from counterflex.runtime.step import supervise as stage
from step_space import LEAST, Ask, StepSpace, explore, is_moved, named, states_after

DEFECTS: Final = {
    "what is away is armed by a person who has not seen it": (
        "state.away = 1\n    return requested",
        "state.away = 0\n    return requested",
    ),
    "a flicker of Enable ends the correction": (
        "off = state.disabled >= DEBOUNCE or",
        "off = state.disabled >= 2 or",
    ),
    "a jump of the counter takes the correction away": ("if session != LAST_CORRECTION:", "if cycle.hard != 0:"),
    "silence is taken for the end of a session at once": (" and result.silent == 1:", ":"),
    "what flickers again behind the end is an off": (
        "(state.acted == 1 and state.enabled > 0)",
        "(state.acted == 1 and state.enabled > 1)",
    ),
    "who acknowledges in the cycle of the disarming has seen it": (
        "(now < _ARMED or now > _HOLD):",
        "now != _HOLD:",
    ),
    "a person arms in a gap of Enable": ("requested = 0 if enable == 0 and off else 1", "requested = enable"),
    "an uncorrected cut is not seen": (" or state.uncorrected >= DEBOUNCE:", ":"),
    "off the plan a ramp begins while it may cut": (
        "(cuts == MAY_CUT and inputs.enable == 1)",
        "(cuts == MAY_CUT and inputs.enable == 2)",
    ),
    "whose session it is matters to nobody": ("state.another_session = 1", "state.another_session = 0"),
}
"""Defects of the stage by what they would do: its text, and what stands there instead."""


@functools.cache
def space() -> StepSpace:
    return explore()


@pytest.mark.long
def test_no_input_in_any_state_breaks_a_rule() -> None:
    assert not space().broken
    assert named(space().keys) == set(State)


@pytest.mark.long
def test_every_state_comes_to_ready_when_the_session_ends_and_a_person_resets() -> None:
    """The controller falls silent for a session, comes again, stands, has left the cut: no state is a trap."""
    keys = space().keys
    for _ in range(2 * LEAST.hold + LEAST.stop + 4):
        keys = states_after(keys, gone=1, healthy=1, standing=1)
    for _ in range(8):
        keys = states_after(keys, elapsed=1, reset=1, healthy=1, standing=1)
    assert named(keys) == {State.READY, State.ARMED, State.RAMP_OUT}  # who is armed stays so
    ramping = np.array([key for key in keys if named(np.array([key])) == {State.RAMP_OUT} and not is_moved(int(key))])
    after = states_after(ramping, elapsed=1, healthy=1, standing=1)
    assert named(after) == {State.READY}  # once the limiter has brought the correction to zero


def planted(text: str, instead: str, monkeypatch: pytest.MonkeyPatch) -> Ask:
    """The stage with a defect, compiled apart from the cache of the real one."""
    source = inspect.getsource(stage)
    imported = "from counterflex.core.jit import kernel\n"
    assert source.count(text) == 1, text
    assert imported in source
    module = ModuleType("planted_stage")
    vars(module)["kernel"] = lambda *_, **__: numba.njit
    monkeypatch.setitem(sys.modules, module.__name__, module)
    exec(compile(source.replace(imported, "").replace(text, instead), "planted", "exec"), vars(module))
    return cast(Ask, module.ask_supervisor)


@pytest.mark.long
@pytest.mark.parametrize("name", DEFECTS)
def test_a_planted_defect_is_found(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    assert explore(planted(*DEFECTS[name], monkeypatch), first=True).broken
