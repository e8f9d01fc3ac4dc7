"""The supervisor explored whole: every state that can be reached, with every input, against rules and for its ends."""

from __future__ import annotations

import functools
import inspect
import sys
from types import ModuleType
from typing import Final, cast

import numba
import numpy as np
import pytest

from counterflex.core.arrays import Bool, Int
from counterflex.runtime.state import supervisor
from counterflex.runtime.state.states import State
from supervisor_space import SMALL, Space, Supervise, all_inputs, explore, run, said

LIMITS: Final = (
    SMALL,
    supervisor.SupervisorSettings(hold=1, good=1, rise=1, stop=1, returns=1, calm=1),
    supervisor.SupervisorSettings(hold=2, good=4, rise=3, stop=3, returns=2, calm=5),
)
"""Limits in cycles: a hold that can end by itself, the least there is, a hold that cannot."""
_ENDS: Final = (State.IDLE, State.READY)


@functools.cache
def space(k: int = 0) -> Space:
    return explore(settings=LIMITS[k])


def in_states(found: Space, *states: State) -> Bool:
    return np.isin(found.fields("state"), [int(state) for state in states])


def longest(edges: Int, count: int) -> int:
    """Most edges in a row; fails where they go round."""
    depth = np.zeros(count, np.int64)
    for _ in range(count + 1):
        deeper = depth.copy()
        np.maximum.at(deeper, edges[:, 0], depth[edges[:, 1]] + 1)
        if np.array_equal(deeper, depth):
            return int(depth.max())
        depth = deeper
    pytest.fail("it can go round for ever")


@pytest.mark.long
@pytest.mark.parametrize("k", range(len(LIMITS)))
def test_no_input_in_any_state_breaks_a_rule(k: int) -> None:
    assert not space(k).broken


@pytest.mark.long
def test_every_state_is_reached_and_each_can_be_left() -> None:
    found = space()
    assert set(found.fields("state")) == {int(state) for state in State}
    left = {(int(found.fields("state")[a]), int(found.fields("state")[b])) for a, b, _ in found.edges}
    assert {a for a, b in left if a != b} == {int(state) for state in State}
    assert len(all_inputs()) == 6144


@pytest.mark.long
@pytest.mark.parametrize("k", range(len(LIMITS)))
def test_no_way_leads_from_a_fault_to_the_correction_but_by_a_reset_and_by_arming(k: int) -> None:
    """Without one of them no path exists, however long and whatever happens on it."""
    found = space(k)
    state = found.fields("state")
    for without in ("not reset", "not armed"):
        edges = found.leads(without, np.ones(len(state), bool))
        reached = state == State.FAULT
        while not np.array_equal(
            reached, wider := reached | np.isin(np.arange(len(state)), edges[reached[edges[:, 0]], 1])
        ):
            reached = wider
        assert not np.any(reached & (state == State.ACTIVE)), without
        if without == "not reset":
            assert set(state[reached]) == {State.FAULT}


@pytest.mark.long
@pytest.mark.parametrize("k", range(len(LIMITS)))
@pytest.mark.parametrize("label", ["stop", "enable off"])
def test_who_asks_to_end_comes_to_an_end_in_bounded_cycles_whatever_else_happens(label: str, k: int) -> None:
    """Hold and correction together last no longer than the hold's time and the cycles in which it begins and ends.

    Only the ramp goes on beyond it, which :func:`counterflex.signals.limiter.limited_step` brings to zero.
    """
    found = space(k)
    state = found.fields("state")
    edges = found.leads(label, in_states(found, State.ACTIVE, State.HOLD, State.RAMP_OUT))
    a, b = state[edges[:, 0]], state[edges[:, 1]]
    assert not np.any((a != State.ACTIVE) & (b == State.ACTIVE))
    moving = edges[~((a == State.RAMP_OUT) & (b == State.RAMP_OUT))]
    assert longest(moving, len(state)) <= 2 * LIMITS[k].hold + 2


@pytest.mark.long
@pytest.mark.parametrize("k", range(len(LIMITS)))
def test_a_hold_never_lasts_for_ever(k: int) -> None:
    found = space(k)
    held = found.leads("any", in_states(found, State.HOLD))
    assert longest(held, len(found.keys)) <= LIMITS[k].hold


@pytest.mark.long
@pytest.mark.parametrize("k", range(len(LIMITS)))
@pytest.mark.parametrize("zero", [0, 3])
def test_every_state_comes_to_ready_when_the_robot_stands_and_a_person_resets(k: int, zero: int) -> None:
    """The ramp takes ``zero`` cycles; no state is a trap."""
    keys = space(k).keys
    for cycle in range(2 * LIMITS[k].hold + zero + 6):
        at_zero = int(cycle >= zero)
        keys = np.unique(run(keys, LIMITS[k], healthy=1, stands=1, reset=1, at_zero=at_zero))
    assert {said(int(key)).split()[0] for key in keys} == {"READY", "ARMED"}  # who is armed stays so
    keys = run(keys, LIMITS[k], healthy=1, stop=1, at_zero=1)
    assert {said(int(key)).split()[0] for key in keys} == {"READY"}
    armed = run(keys, LIMITS[k], healthy=1, arm=1, at_zero=1)
    active = run(armed, LIMITS[k], healthy=1, enable=1, at_zero=1, in_cut=1)
    assert {said(int(key)).split()[0] for key in armed} == {"ARMED"}
    assert {said(int(key)).split()[0] for key in active} == {"ACTIVE"}


@pytest.mark.long
def test_holds_that_end_by_themselves_are_counted_until_it_is_calm() -> None:
    """Stop, do not limp: without `calm` cycles of correction in between a hold returns `returns` times at most."""
    for k, limits in enumerate(LIMITS):
        found = space(k)
        returns, calm, state = found.fields("returns"), found.fields("calm"), found.fields("state")
        edges = found.leads("any", in_states(found, State.ACTIVE, State.HOLD))
        back = edges[(state[edges[:, 0]] == State.HOLD) & (state[edges[:, 1]] == State.ACTIVE)]
        if limits.good >= limits.hold:
            assert len(back) == 0
            continue
        assert len(back) > 0
        assert np.all(returns[back[:, 0]] < limits.returns)
        forgot = edges[returns[edges[:, 1]] < returns[edges[:, 0]]]
        assert np.all(calm[forgot[:, 0]] == limits.calm - 1)


@pytest.mark.long
def test_only_inputs_that_decide_are_inputs() -> None:
    """Each changes what follows in some state; `telegram` alone decides nothing, and is kept for the log's layout."""
    found = space()
    idle = ("telegram",)
    given = all_inputs()
    for name in given.dtype.names or ():
        told = dict.fromkeys(("healthy", "at_zero"), 1)
        value = {"soft": 8, "hard": 15}.get(name, 1)
        changed = any(
            not np.array_equal(run(found.keys, SMALL, **base), run(found.keys, SMALL, **(base | {name: value})))
            for base in (
                told | {name: 0},
                told | {"enable": 1, "stands": 0, name: 0},
                {"reset": 1, name: 0},
                {name: 0, "in_cut": 1},
            )
        )
        assert changed == (name not in idle) or name == "telegram", name


DEFECTS: Final = {
    "a fault is left without a reset": (
        "given.reset == 1 and given.at_zero == 1 and hard",
        "given.at_zero == 1 and hard",
    ),
    "a cause of a fault is taken while correcting only": (
        "if hard != 0 and state != _FAULT and state != _IDLE:",
        "if hard != 0 and state == _ACTIVE:",
    ),
    "armed while the program wants it": (
        "given.at_zero == 1 and given.enable == 0 and given.away == 0",
        "given.at_zero == 1 and given.away == 0",
    ),
    "the ramp begins in the cut": ("may_ramp = given.in_cut == 0 or given.stands == 1", "may_ramp = True"),
    "a stop is forgotten in a hold": ("at.ending = 1 if ends or following == _RAMP_OUT else 0", "at.ending = 0"),
    "a hold has no end": ("if at.held >= settings.hold:", "if at.held >= settings.hold and given.stands == 1:"),
    "each broken ramp begins the hold anew": (
        "if following not in (_HOLD, _RAMP_OUT):\n        at.held",
        "if following != _HOLD:\n        at.held",
    ),
    "returns are not counted": ("at.returns += 1", "at.returns += 0"),
    "a hold by process monitoring ends by itself": ("(cause < _OF_PROCESS or cause >= _RUN_LOST) and ", ""),
    "a hold does not ask for a held feed": (
        "if following in (_HOLD, _FAULT):\n        at.feed_hold",
        "if following == _FAULT:\n        at.feed_hold",
    ),
    "a held feed is let go when the ramp is over": (
        "elif given.enable == 0 and given.in_cut == 0:",
        "elif given.enable == 0 or following == _READY:",
    ),
    "the correction is not faded in after a ramp": (
        "elif following != _HOLD:\n        at.risen = 0",
        "elif following == _FAULT:\n        at.risen = 0",
    ),
    "no stop behind the ramp": ("(state == _RAMP_OUT and following != _RAMP_OUT) or ", ""),
}
"""Defects of the supervisor by what they would do: text of its module, and what stands there instead."""


def planted(text: str, instead: str, monkeypatch: pytest.MonkeyPatch) -> Supervise:
    """The supervisor with a defect, compiled apart from the cache of the real one."""
    source = inspect.getsource(supervisor)
    assert source.count(text) == 1, text
    imported = "from counterflex.core.jit import kernel\n"
    assert imported in source
    module = ModuleType("planted_supervisor")
    vars(module)["kernel"] = lambda *_, **__: numba.njit
    monkeypatch.setitem(sys.modules, module.__name__, module)
    exec(compile(source.replace(imported, "").replace(text, instead), "planted", "exec"), vars(module))
    return cast(Supervise, module.supervise)


def broken_by(found: Space) -> set[str]:
    """Rules that do not hold, and ends that are not come to."""
    out = set(found.broken)
    for label, states, bound in (
        ("any", (State.HOLD,), SMALL.hold),
        ("stop", (State.ACTIVE, State.HOLD), SMALL.hold + 1),
    ):
        edges = found.leads(label, in_states(found, *states))
        try:
            fine = longest(edges, len(found.keys)) <= bound
        except pytest.fail.Exception:
            fine = False
        out |= set() if fine else {f"{label}: no end"}
    return out


@pytest.mark.long
@pytest.mark.parametrize("name", DEFECTS)
def test_a_planted_defect_is_found(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    assert broken_by(explore(planted(*DEFECTS[name], monkeypatch), first=True))


@pytest.mark.long
def test_the_real_one_comes_to_its_ends() -> None:
    assert not broken_by(space())
