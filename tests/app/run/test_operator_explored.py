"""Requests of an operator explored: each in every state, whatever the loop then does, against what must hold of it."""

from __future__ import annotations

import itertools
from typing import Final, SupportsIndex

import pytest

from counterflex.app.run.operator_requests import ACTIONS, BEAT_S, SILENT_S, WAIT_S, Clock, ask
from counterflex.core.errors import OutputError
from counterflex.protocols.processes.control_array import CONTROL, Life, Request, Shown
from counterflex.runtime.state.states import Cause, State

BEGIN_NS: Final = 10**12
YES: Final = (False, True)


class Loop:
    """Stands for a loop that does something while the operator's side waits."""

    def __init__(self, before: State, *, may_arm: bool, alive: bool, stopped: bool) -> None:
        self.words = [0] * CONTROL
        self.words[Shown.STATE] = before
        self.words[Life.MAY_ARM] = int(may_arm)
        self.words[Life.LOOP_NS] = BEGIN_NS - (0 if alive else round((SILENT_S + 0.1) * 1e9))
        self.words[Request.STOP] = int(stopped)
        self.now_ns = BEGIN_NS
        self.after: State | None = None
        self.speaks = self.serves = False
        self.asked: list[int] = []

    def wait(self, seconds: float) -> None:
        self.now_ns += round(seconds * 1e9)
        self.asked = self.asked or self.words[:4]
        if self.after is not None:
            self.words[Shown.STATE] = self.after
        if self.speaks:
            self.words[Life.LOOP_NS] = self.now_ns
        if self.serves:
            self.words[Request.RESET] = 0

    @property
    def clock(self) -> Clock:
        return Clock(lambda: self.now_ns, self.wait)


def _cases() -> list[tuple[State, bool, bool, bool, State, bool, bool, int, int]]:
    return list(itertools.product(State, YES, YES, YES, State, YES, YES, (0, 1), (0, 50_000)))


@pytest.mark.parametrize("action", ACTIONS)
def test_a_request_does_what_it_says_or_says_why_not_whatever_the_loop_does(action: str) -> None:
    for before, may_arm, alive, stopped, after, speaks, serves, held, correction in _cases():
        loop = Loop(before, may_arm=may_arm, alive=alive, stopped=stopped)
        loop.after, loop.speaks, loop.serves = after, speaks, serves
        loop.words[Shown.FEED_HOLD], loop.words[Shown.CORRECTION_NM] = held, correction
        loop.words[Shown.CAUSE] = Cause.FORCE_STALE
        words = loop.words
        try:
            answer = ask(words, action, where="log", clock=loop.clock)
        except OutputError:
            assert not alive
            assert words[Request.STOP] == int(stopped or action == "stop")  # a stop stays asked for
            assert words[Request.ARM] == words[Request.RESET] == 0
            continue
        assert alive
        assert answer["done"] == (not answer["refused"])
        assert loop.now_ns - BEGIN_NS <= round((WAIT_S + BEAT_S + 0.01) * 1e9)
        # Who asks for a stop gets it kept; nobody else takes it away but a person who arms a loop that is ready.
        if action == "stop":
            assert words[Request.STOP] == 1
        elif action == "arm" and may_arm and before == State.READY:
            assert words[Request.STOP] == 0
        else:
            assert words[Request.STOP] == int(stopped)
        # To arm is asked of a ready loop of a run that corrects only, and is taken back where it is refused.
        if loop.asked and loop.asked[Request.ARM]:
            assert action == "arm"
            assert may_arm
            assert before == State.READY
        assert "_" not in answer["refused"]
        if answer["refused"]:
            assert action != "arm" or not alive or answer["state"] not in ("armed", "active") or before != State.READY
            assert words[Request.ARM] == 0
            assert words[Request.RESET] == 0
        elif action == "arm":
            assert State(words[Shown.STATE]) in (State.ARMED, State.ACTIVE)
        elif action == "stop":
            assert State(words[Shown.STATE]) not in (State.ARMED, State.ACTIVE)
        elif action == "reset":
            assert State(words[Shown.STATE]) != State.FAULT
            assert words[Request.RESET] == 0
        if action == "status":
            assert not loop.asked
            assert answer["done"]
        if action in ("stop", "reset") and not speaks:
            assert answer["refused"]


class _Words(list[int]):
    """Numbers of a loop that takes a request in the very moment in which it is taken back."""

    def __setitem__(self, place: SupportsIndex, value: int) -> None:  # type: ignore[override]
        super().__setitem__(place, value)
        if place == Request.ARM and value == 0:
            super().__setitem__(Shown.STATE, State.ARMED)


def test_what_was_armed_in_the_last_moment_is_not_called_refused() -> None:
    """The panel showed `refused: a check fails`, and the loop was armed."""
    loop = Loop(State.READY, may_arm=True, alive=True, stopped=False)
    loop.words, loop.speaks = _Words(loop.words), True
    answer = ask(loop.words, "arm", clock=loop.clock)
    assert answer["state"] == "armed"
    assert answer["done"]
