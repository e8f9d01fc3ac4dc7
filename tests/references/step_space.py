"""Every state of the supervisor with what the step remembers of Enable, arming and sessions, under every input.

The compiled stage :func:`counterflex.runtime.step.supervise.ask_supervisor` and the compiled report of the step are
run; the correction stands as zero or not zero, moved as the limiter may move it in each state.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

import numpy as np

from counterflex.core.arrays import Int
from counterflex.core.records import Records, record, records
from counterflex.runtime.state.chosen import SETTINGS
from counterflex.runtime.state.cycle import CYCLE
from counterflex.runtime.state.given import GIVEN
from counterflex.runtime.state.memory import STATE
from counterflex.runtime.state.result import RESULT
from counterflex.runtime.state.states import Cause, State
from counterflex.runtime.state.supervisor import SupervisorSettings
from counterflex.runtime.step import supervise as stage
from counterflex.runtime.step.limit import report
from supervisor_rules import compiled

Ask: TypeAlias = Callable[..., int]
LEAST: Final = SupervisorSettings(hold=2, good=1, rise=1, stop=1, returns=1, calm=1)
INPUT: Final = record(
    elapsed=int, healthy=int, arm=int, enable=int, stop=int, reset=int, soft=int, hard=int, standing=int, cuts=int,
    session=int, gone=int,
)  # fmt: skip
"""Of a cycle; `gone`: telegrams are away for as long as a session may go on without them."""
_MEMORY: Final = record(given=GIVEN, state=STATE, cycle=CYCLE, result=RESULT, before=STATE)
"""Work space; owned by the caller, because a compiled function frees an array whose record it still uses."""
RULES: Final = (
    "a flicker of Enable does not end the correction",
    "what is away in the cut is not armed, until a person resets",
    "the output jumps to zero in another session only, or when nobody was heard for one",
    "without a correction in force, but in the states that correct",
    "a fault says stop until it falls silent; nothing else is silent",
    "an armed program that cuts uncorrected is held within the debounce",
    "the ramp moves only where the robot stands, nothing is cut, or the program says so off the plan",
    "the feed is held in the step as in the supervisor, and stop only with it",
    "a session that may be another one is not answered in a fault",
    "a program that is out of the cut and off is not held once it was acknowledged",
    "behind a loop that did not end by itself a program that wants it, or cuts, is held within the debounce",
    "an armed loop, and a correction that acted, are forgotten by a person only, who sees it held, or the program off",
    "each telegram of a cut counts that lacks its correction: armed, or wanted again after it ended",
    "a program that was on is off within the debounce, not before; who is off at first may be armed",
)
_DEBOUNCE: Final = stage.DEBOUNCE
_BITS: Final = np.array([3, 5, 1, 2, 1, 1, 1, 1, 1, 2, 1, 1, 1, 1, 3, 3, 3, 1, 1, 1])
_NAMED: Final = (
    Cause.NONE, Cause.OPERATOR, Cause.PROGRAM, Cause.FORCE_STALE, Cause.NOT_FINITE, Cause.TELEGRAMS_STOPPED,
    Cause.SESSION_RESTARTED, Cause.HELD_TOO_LONG, Cause.ENABLE_LOST, Cause.NOT_CLOSED,
)  # fmt: skip
_CAUSES: Final = np.array([int(cause) for cause in _NAMED])
_IDLE, _READY, _ARMED, _ACTIVE = int(State.IDLE), int(State.READY), int(State.ARMED), int(State.ACTIVE)
_HOLD, _RAMP, _FAULT = int(State.HOLD), int(State.RAMP_OUT), int(State.FAULT)
_SESSION, _NOT_CLOSED = int(Cause.SESSION_RESTARTED), int(Cause.NOT_CLOSED)
_LAST, _NONE, _UNKNOWN = stage.LAST_CORRECTION, stage.NO_CORRECTION, stage.UNKNOWN
_NO_CUT, _CUT, _MAY_CUT = stage.NO_CUT, stage.CUT, stage.MAY_CUT
_LONG = 10_000
_SIZE_M = 1e-3


@dataclass(frozen=True, eq=False)
class StepSpace:
    """What can be reached.

    Attributes:
        keys: (n,) packed states.
        broken: By rule, an example in words.
        inputs: How many each was met with.
    """

    keys: Int
    broken: dict[str, str]
    inputs: int


def all_inputs() -> Records:
    """Every input of the stage: what cannot come together is left out."""
    rows = []
    causes = [(int(soft), 0, _LAST) for soft in (Cause.NONE, Cause.FORCE_STALE, Cause.NOT_CLOSED)]
    causes += [(0, int(hard), _LAST) for hard in (Cause.TELEGRAMS_STOPPED, Cause.NOT_FINITE)]
    causes += [(0, _SESSION, session) for session in (_LAST, _NONE, _UNKNOWN)]
    yes = (0, 1)
    for healthy, arm, enable, stop, reset, standing in itertools.product(yes, repeat=6):
        for elapsed, gone in ((1, 0), (0, 0), (0, 1)):
            for (soft, hard, session), cuts in itertools.product(causes, (_NO_CUT, _CUT, _MAY_CUT)):
                if hard != _SESSION or elapsed:
                    rows.append((elapsed, healthy, arm, enable, stop, reset, soft, hard, standing, cuts, session, gone))
    return np.array(rows, dtype=INPUT).view(np.recarray)


@compiled
def _load(key: int, state: Any, result: Any, bits: Int, causes: Int) -> None:
    words = np.empty(20, np.int64)
    for k in range(20):
        words[k] = key & ((1 << bits[k]) - 1)
        key >>= bits[k]
    at = state.supervisor
    at.state, at.cause, at.cycles, at.good, at.risen = words[0], causes[words[1]], words[2], words[3], words[4]
    at.feed_hold, at.stop, at.returns, at.calm, at.held = words[5], words[6], words[7], words[8], words[9]
    at.ending = words[10]
    state.acted, state.away, state.armed = words[11], words[12], words[13]
    state.disabled, state.enabled, state.uncorrected = words[14], words[15], words[16]
    state.another_session, result.silent = words[17], words[18]
    for k in range(6):
        state.correction[k] = state.correction_rate[k] = 0.0
    state.correction[0] = _SIZE_M * words[19]


@compiled
def _save(state: Any, result: Any, bits: Int, causes: Int, stop: int) -> int:
    at = state.supervisor
    cause = -1
    for k in range(len(causes)):
        if causes[k] == at.cause:
            cause = k
    words = (
        at.state, cause, min(at.cycles, stop) if at.state == _FAULT else 0, at.good, at.risen, at.feed_hold, at.stop,
        at.returns, at.calm, at.held, at.ending, state.acted, state.away, state.armed, min(state.disabled, _DEBOUNCE),
        min(state.enabled, _DEBOUNCE), min(state.uncorrected, _DEBOUNCE), state.another_session, result.silent,
        int(state.correction[0] != 0.0),
    )  # fmt: skip
    key = 0
    for k in range(19, -1, -1):
        if words[k] < 0 or words[k] >= 1 << bits[k]:
            return -1
        key = (key << bits[k]) | words[k]
    return key


@compiled
def _broken(before: Any, given: Any, now: Any, result: Any, had: int, kept: int, silent: int) -> int:
    """Bits of the rules that do not hold; `had` and `kept`: a correction before and behind the stage."""
    was, at, away = before.supervisor, now.supervisor, before.away
    a, b = was.state, at.state
    acts = a in (_ACTIVE, _HOLD)
    is_off = given.enable == 0 and (now.disabled >= _DEBOUNCE or (now.enabled == 0 and not acts))
    seen = given.reset == 1 and a != _ARMED and not acts and (away == 1 or was.feed_hold == 1 or now.enabled == 0)
    left = was.feed_hold == 1 and is_off  # a hold, by its clean off
    again = given.enable == 1 or (before.enabled > 0 and a != _ARMED and not left)
    owed = now.armed == 1 or (now.acted == 1 and again)
    cuts_on = given.elapsed == 1 and given.cuts == _CUT and given.standing == 0
    plain = given.soft == 0 and given.hard == 0 and given.stop == 0
    off = given.enable == 0 and now.disabled >= _DEBOUNCE
    may_ramp = given.standing == 1 or given.cuts == _NO_CUT or (given.cuts == _MAY_CUT and now.inputs.enable == 0)
    fine = (
        not (a == _ACTIVE and plain) or b == _ACTIVE or off,
        not (away == 1 and given.reset == 0 and a <= _READY) or b <= _READY or b == _FAULT,
        had == 0 or kept == 1 or given.session != _LAST or (b == _FAULT and given.gone == 1 and silent == 1),
        b > _ARMED or kept == 0,
        (result.silent == 0 or b == _FAULT) and (b != _FAULT or result.stop == 1 - result.silent),
        now.uncorrected < _DEBOUNCE or b > _ARMED or result.feed_hold == 1 or given.reset == 1,
        b != _RAMP or may_ramp,
        result.feed_hold == at.feed_hold and (result.stop == 0 or result.feed_hold == 1),
        (now.another_session == 0 or (b == _FAULT and result.silent == 1))
        and (
            b != _FAULT or result.silent == 1 or not (given.session == _UNKNOWN or (given.session == _NONE and a == b))
        ),
        not (b <= _ARMED and now.inputs.enable == 0 and given.cuts == _NO_CUT and now.away == 0)
        or result.feed_hold == 0,
        given.soft != _NOT_CLOSED
        or a > _READY
        or given.reset == 1
        or result.feed_hold == 1
        or ((now.enabled < _DEBOUNCE or given.enable == 0) and now.uncorrected < _DEBOUNCE),
        seen or (now.acted >= max(before.acted, int(acts)) and (acts or now.armed >= max(before.armed, a == _ARMED))),
        not (cuts_on and owed and a <= _ARMED) or now.uncorrected > min(before.uncorrected, _DEBOUNCE - 1),
        now.inputs.enable == 1 - int(is_off) and (a != _READY or b != _ARMED or is_off),
    )
    out = 0
    for k in range(len(fine)):
        out |= 0 if fine[k] else 1 << k
    return out


@functools.cache
def _walker(ask: Ask) -> Callable[..., Int]:
    @compiled
    def walk(memory: Any, keys: Int, inputs: Any, settings: Any, bits: Int, causes: Int, broken: Int) -> Int:
        given, state, cycle, result, before = (
            memory[0].given,
            memory[0].state,
            memory[0].cycle,
            memory[0].result,
            memory[0].before,
        )
        found = set([np.int64(-2)])  # noqa: C405 (the compiler knows no literal of a set)
        for k in range(len(keys)):
            _load(keys[k], before, result, bits, causes)
            silent, had = result.silent, int(before.correction[0] != 0.0)
            for j in range(len(inputs)):
                one = inputs[j]
                _load(keys[k], state, result, bits, causes)
                given.elapsed, given.healthy, given.arm, given.enable = one.elapsed, one.healthy, one.arm, one.enable
                given.stop, given.reset = one.stop, one.reset
                cycle.soft, cycle.hard = one.soft, one.hard
                state.telegrams_lost = _LONG if one.gone == 1 else 0
                ask(given, one.standing, one.cuts, one.session, settings[0], state, cycle, result)
                now, kept = state.supervisor.state, int(state.correction[0] != 0.0)
                report(settings[0], state, cycle, result)
                wrong = _broken(before, one, state, result, had, kept, silent)
                key = _save(state, result, bits, causes, settings[0].supervisor.stop)
                found.add(np.int64(key))
                if now == _ACTIVE or (now == _RAMP and kept == 1):  # what the limiter may do
                    state.correction[0] = _SIZE_M if kept == 0 else 0.0
                    found.add(np.int64(_save(state, result, bits, causes, settings[0].supervisor.stop)))
                for r in range(16):
                    if (wrong >> r & 1 or (key < 0 and r == 15)) and broken[r, 0] < 0:
                        broken[r, 0], broken[r, 1], broken[r, 2] = keys[k], j, key
        return np.array(list(found))

    return walk


def explore(ask: Ask = stage.ask_supervisor, *, first: bool = False) -> StepSpace:
    """Return all that can be reached from the start.

    Args:
        ask: Kernel of the stage; a test gives one with a defect.
        first: End when a rule is broken.
    """
    inputs = all_inputs()
    broken = np.full((16, 3), -1, np.int64)
    keys = frontier = np.zeros(1, np.int64)
    while len(frontier) and not (first and np.any(broken >= 0)):
        parts = np.array_split(frontier, max(1, len(frontier) // 64))
        found = [_walker(ask)(records(_MEMORY), part, inputs, _settings(), _BITS, _CAUSES, broken) for part in parts]
        frontier = np.setdiff1d(np.concatenate(found), np.concatenate([keys, [-1, -2]]))
        keys = np.concatenate([keys, frontier])
    names = [*RULES, *[""] * (15 - len(RULES)), "numbers stay within their range"]
    shown = {name: _said(broken[r], inputs) for r, name in enumerate(names) if broken[r, 0] >= 0}
    return StepSpace(keys, shown, len(inputs))


def states_after(keys: Int, **values: int) -> Int:
    """Packed states after a cycle with one input, whatever the limiter does.

    Args:
        keys: (n,) packed.
        values: Of :data:`INPUT`, where they are not 0.
    """
    one = records(INPUT)
    for name, value in values.items():
        one[name] = value
    return np.unique(
        _walker(stage.ask_supervisor)(
            records(_MEMORY), keys, one, _settings(), _BITS, _CAUSES, np.zeros((16, 3), np.int64)
        )
    )[1:]


def named(keys: Int) -> set[State]:
    """Return the states of packed ones."""
    return {State(int(key)) for key in keys & 7}


def is_moved(key: int) -> bool:
    """Return whether a correction is in force in a packed state."""
    return bool(key >> int(np.sum(_BITS[:-1])) & 1)


def _settings() -> Records:
    settings = records(SETTINGS)
    settings[0].period = 4e-3
    settings[0].supervisor = LEAST.packed()
    return settings


def _said(example: Int, inputs: Records) -> str:
    words = []
    for key in (example[0], example[2]):
        state, result = records(STATE), records(RESULT)
        _load(int(max(key, 0)), state[0], result[0], _BITS, _CAUSES)
        at, memory = state[0].supervisor, ("acted", "away", "armed", "disabled", "enabled", "uncorrected")
        told = [f"{name}={at[name]}" for name in at.dtype.names or () if at[name]]
        told += [f"{name}={state[0][name]}" for name in memory if state[0][name]]
        words.append(f"{State(int(at.state)).name} {' '.join(told)} moved={state[0].correction[0] != 0.0}")
    one = inputs[example[1]]
    return " -- ".join([words[0], " ".join(f"{n}={one[n]}" for n in INPUT.names or () if one[n]), words[1]])
