"""Every state that the supervisor can reach, with every input: found breadth-first with the compiled kernel itself.

A state is packed into one whole number, field by field. Inputs are all combinations of the yes-no inputs with no
cause, a cause of a hold by the loop or by process monitoring, and a cause of a fault. Limits in cycles are small, so
that every counter is met below, at and above its limit.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

import numpy as np

from counterflex.core.arrays import Bool, Int
from counterflex.core.records import Records, records
from counterflex.runtime.state import supervisor
from counterflex.runtime.state.chosen import SUPERVISION
from counterflex.runtime.state.memory import SUPERVISED, SUPERVISOR
from counterflex.runtime.state.states import Cause, State
from supervisor_rules import RULES, broken_rules, compiled

Supervise: TypeAlias = Callable[[Any, Any, Any], None]
SMALL: Final = supervisor.SupervisorSettings(hold=3, good=2, rise=2, stop=2, returns=1, calm=3)
FLAGS: Final = ("healthy", "arm", "enable", "stop", "reset", "at_zero", "stands", "away", "in_cut")
SOFT: Final = (Cause.NONE, Cause.FORCE_STALE, Cause.PROCESS_OVERLOAD, Cause.NOT_CLOSED)
HARD: Final = (Cause.NONE, Cause.TELEGRAMS_STOPPED, Cause.NOT_FINITE)
FEATURES: Final = (
    *FLAGS,
    "soft",
    "hard",
    "silence",  # the only fault left is that no telegram comes
    "ending",
    "lasts",  # held as long as it may be
    "settled",  # no cause for long enough
    "watched",  # held by process monitoring
    "spent",  # no return is left
)
"""Input flags, then what else decides: each is 1 or 0."""
STAYS, SEVERAL = 7, 8
"""In place of the next state: never met, and not decided by the features alone."""
_BITS: Final = np.array([3, 6, 4, 4, 4, 1, 4, 3, 4, 5, 1])  # of the fields of SUPERVISOR in order
_SHIFT: Final = np.concatenate([[0], np.cumsum(_BITS)[:-1]])
_STATE, _CAUSE, _CYCLES = 0, 1, 2
_FAULT, _OF_PROCESS, _RUN_LOST = int(State.FAULT), int(Cause.PROCESS_MISSING_CUT), int(Cause.RUN_LOST)
_STOPPED = int(Cause.TELEGRAMS_STOPPED)


def all_inputs() -> Records:
    """(6144,) every input of the supervisor."""
    combinations = list(itertools.product(SOFT, HARD, *[(0, 1)] * len(FLAGS)))
    out = records(SUPERVISED, len(combinations))
    out["telegram"] = 1
    for k, name in enumerate(("soft", "hard", *FLAGS)):
        out[name] = [each[k] for each in combinations]
    return out


@dataclass(frozen=True, eq=False)
class Space:
    """What can be reached.

    Attributes:
        settings: Limits that it was explored with.
        keys: (n,) packed states, in the order in which they were found.
        edges: (m, 3) place of a state, place of one that follows, bits of :data:`LABELS` of the inputs that lead there.
        broken: By rule, an example: state before, input, state after.
        outcome: (8, 2**17) next state by state and bits of :data:`FEATURES`; :data:`STAYS` where never met.
        causes: (8, 8) bits of the causes with which a state was left for another.
    """

    settings: supervisor.SupervisorSettings
    keys: Int
    edges: Int
    broken: Mapping[str, str]
    outcome: Int
    causes: Int

    def fields(self, name: str) -> Int:
        """(n,) a field of every reached state."""
        k = list(SUPERVISOR.names or ()).index(name)
        out: Int = (self.keys >> _SHIFT[k]) & ((1 << _BITS[k]) - 1)
        return out

    def leads(self, label: str, within: Bool) -> Int:
        """(m, 2) edges of inputs with a label, between states that are marked."""
        edges = self.edges[(self.edges[:, 2] & (1 << LABELS.index(label))) > 0]
        out: Int = edges[within[edges[:, 0]] & within[edges[:, 1]], :2]
        return out


LABELS: Final = ("any", "stop", "enable off", "not armed", "not reset")
"""Kinds of inputs."""


@compiled
def _unpack(key: int, at: Any, bits: Int) -> None:
    words = np.empty(11, np.int64)
    for k in range(11):
        words[k] = key & ((1 << bits[k]) - 1)
        key >>= bits[k]
    at.state, at.cause, at.cycles, at.good, at.risen, at.feed_hold = (
        words[0],
        words[1],
        words[2],
        words[3],
        words[4],
        words[5],
    )
    at.stop, at.returns, at.calm, at.held, at.ending = words[6], words[7], words[8], words[9], words[10]


@compiled
def _pack(at: Any, bits: Int, stop: int) -> int:
    # Cycles in a state count for nothing but the silence of a fault.
    cycles = min(at.cycles, stop) if at.state == _FAULT else 0
    words = (
        at.state,
        at.cause,
        cycles,
        at.good,
        at.risen,
        at.feed_hold,
        at.stop,
        at.returns,
        at.calm,
        at.held,
        at.ending,
    )
    key = 0
    for k in range(10, -1, -1):
        if words[k] < 0 or words[k] >= 1 << bits[k]:
            return -1
        key = (key << bits[k]) | words[k]
    return key


@compiled
def _features(at: Any, given: Any, limits: Any) -> int:
    flags = (
        given.healthy, given.arm, given.enable, given.stop, given.reset, given.at_zero, given.stands, given.away,
        given.in_cut, int(given.soft != 0), int(given.hard != 0), int(given.hard == _STOPPED), at.ending,
        int(at.held >= limits.hold), int(at.good >= limits.good), int(_OF_PROCESS <= at.cause < _RUN_LOST),
        int(at.returns >= limits.returns),
    )  # fmt: skip
    out = 0
    for k in range(17):
        out |= flags[k] << k
    return out


@compiled
def _labels(given: Any) -> int:
    flags = (1, given.stop, 1 - given.enable, 1 - given.arm, 1 - given.reset)
    out = 0
    for k in range(5):
        out |= flags[k] << k
    return out


@functools.cache
def _follower(supervise: Supervise) -> Callable[[Int, Records, Records, Int], Int]:
    """Next states, packed, of many states under many inputs each; -1 where a number is out of its range."""

    @compiled
    def follow(keys: Int, given: Any, limits: Any, bits: Int) -> Int:
        ats = np.zeros(1, SUPERVISOR)
        out = np.empty((len(keys), len(given)), np.int64)
        for k in range(len(keys)):
            for j in range(len(given)):
                _unpack(keys[k], ats[0], bits)
                supervise(ats[0], given[j], limits[0])
                out[k, j] = _pack(ats[0], bits, limits[0].stop)
        return out

    return follow


@compiled
def _judge(
    ats: Any, keys: Int, tos: Int, given: Any, limits: Any, bits: Int, outcome: Int, causes: Int, broken: Int
) -> tuple[Int, Int, Int]:
    """Hold every step against the rules, and gather distinct edges with their labels; `ats` is work space."""
    before, after = ats[0], ats[1]
    froms, ends, labels = [np.int64(0)], [np.int64(0)], [np.int64(0)]
    for k in range(len(keys)):
        found = {np.int64(-2): np.int64(0)}
        _unpack(keys[k], before, bits)
        for j in range(len(given)):
            key = tos[k, j]
            _unpack(max(key, 0), after, bits)
            wrong = broken_rules(before, given[j], after, limits[0], key)
            for r in range(64):
                if wrong >> r & 1 and broken[r, 0] < 0:
                    broken[r, 0], broken[r, 1], broken[r, 2] = keys[k], j, key
            if key < 0:
                continue
            place = _features(before, given[j], limits[0])
            last = outcome[before.state, place]
            outcome[before.state, place] = after.state if last in (STAYS, after.state) else SEVERAL
            if after.state != before.state:
                causes[before.state, after.state] |= 1 << after.cause
            found[key] = found.get(key, np.int64(0)) | _labels(given[j])
        for key, label in found.items():
            if key >= 0:
                froms.append(np.int64(k))
                ends.append(key)
                labels.append(label)
    return np.array(froms[1:]), np.array(ends[1:]), np.array(labels[1:])


def explore(
    supervise: Supervise = supervisor.supervise,
    settings: supervisor.SupervisorSettings = SMALL,
    *,
    first: bool = False,
) -> Space:
    """Return all that can be reached from the initial state.

    Args:
        supervise: Kernel of the supervisor; a test gives one with a defect.
        settings: Limits in cycles, each below 16.
        first: End when a rule is broken.
    """
    limits = records(SUPERVISION)
    limits[0] = settings.packed()
    given = all_inputs()
    outcome = np.full((8, 1 << len(FEATURES)), STAYS, np.int64)
    causes, broken = np.zeros((8, 8), np.int64), np.full((64, 3), -1, np.int64)
    follow = _follower(supervise)
    keys, frontier = np.zeros(1, np.int64), np.zeros(1, np.int64)
    pieces = []
    while len(frontier) and not (first and np.any(broken >= 0)):
        nexts = follow(frontier, given, limits, _BITS)
        froms, tos, labels = _judge(
            records(SUPERVISOR, 2), frontier, nexts, given, limits, _BITS, outcome, causes, broken
        )
        pieces.append(np.stack([frontier[froms], tos, labels], axis=1))
        frontier = np.setdiff1d(tos, keys)
        keys = np.concatenate([keys, frontier])
    edges = np.concatenate(pieces)
    edges = edges[np.isin(edges[:, 1], keys)]
    order = np.argsort(keys)
    for column in (0, 1):
        edges[:, column] = order[np.searchsorted(keys, edges[:, column], sorter=order)]
    shown = {RULES[r]: _said(broken[r], given) for r in range(len(RULES)) if broken[r, 0] >= 0}
    return Space(settings, keys, edges, shown, outcome, causes)


def run(keys: Int, settings: supervisor.SupervisorSettings, **flags: int) -> Int:
    """(n,) states after one cycle with the same input.

    Args:
        keys: (n,) packed.
        settings: Limits in cycles.
        flags: Inputs that are not 0.
    """
    limits, given, at = records(SUPERVISION), records(SUPERVISED), records(SUPERVISOR)
    limits[0] = settings.packed()
    given["telegram"] = 1
    for name, value in flags.items():
        given[name] = value
    return np.array([_step(key, at[0], given[0], limits[0]) for key in keys])


def _step(key: int, at: Any, given: Any, limits: Any) -> int:
    _unpack(key, at, _BITS)
    supervisor.supervise(at, given, limits)
    return int(_pack(at, _BITS, limits.stop))


def said(key: int) -> str:
    """Return a packed state in words."""
    if key < 0:
        return "a number out of its range"
    at = records(SUPERVISOR)
    _unpack(key, at[0], _BITS)
    words = {name: int(at[0][name]) for name in SUPERVISOR.names or ()}
    state, cause = State(words.pop("state")), Cause(words.pop("cause"))
    return f"{state.name} {cause.name} " + " ".join(f"{name}={value}" for name, value in words.items() if value)


def _said(example: Int, given: Records) -> str:
    before, number, after = (int(each) for each in example)
    one = given[number]
    told = " ".join(name for name in FLAGS if one[name])
    causes = f"soft={Cause(int(one['soft'])).name} hard={Cause(int(one['hard'])).name}"
    return f"{said(before)} -- {told} {causes} --> {said(after)}"
