"""Rules of one cycle of the supervisor, written without regard to how it decides: before, input, after."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, TypeVar, cast

import numba

from counterflex.runtime.state.states import Cause, State

F = TypeVar("F", bound=Callable[..., Any])
compiled = cast(Callable[[F], F], numba.njit)
"""Compile for this process alone, without the cache of the kernels."""
RULES: Final = (
    "counters stay within their range",
    "a state is left for a neighbour only",
    "a fault is left for idle only, by a reset, at zero, without a cause but silence",
    "a cause of a fault is a fault in the same cycle, but in idle, which goes nowhere",
    "the correction begins from armed only, with the program's consent and nothing against it",
    "the correction goes on after a hold only when calm, wanted, not watched, with a return left",
    "ready is armed by a person only, at zero, before the program wants it, with nothing against it",
    "a cause ends correcting in the same cycle",
    "who asks to end ends correcting in the same cycle",
    "the ramp moves only where the robot stands or nothing is cut",
    "a hold ends in its time",
    "an end that was asked for is not forgotten",
    "the feed is held in hold and fault, free while correcting",
    "a feed hold is let go by a person, by correcting, or by a program that is out of the cut only",
    "a correction that is away holds the feed",
    "stop is asked with a held feed, out of the correcting states",
    "a ramp with a held feed ends in a stop",
    "an incident keeps its first cause",
    "a hold, a ramp and a fault have a cause",
    "the correction is faded in from nothing after arming, and kept over a hold",
    "each return from a hold is counted, one is forgotten in time",
    "an operator who ends the correction has the feed held",
    "what is not healthy is not ready",
)

_IDLE, _READY, _ARMED, _ACTIVE = int(State.IDLE), int(State.READY), int(State.ARMED), int(State.ACTIVE)
_HOLD, _RAMP, _FAULT = int(State.HOLD), int(State.RAMP_OUT), int(State.FAULT)
_PROGRAM, _ENABLE_LOST, _OPERATOR = int(Cause.PROGRAM), int(Cause.ENABLE_LOST), int(Cause.OPERATOR)
_NOT_CLOSED = int(Cause.NOT_CLOSED)
_STOPPED, _TOO_LONG = int(Cause.TELEGRAMS_STOPPED), int(Cause.HELD_TOO_LONG)
_PROCESS, _RUN_LOST = int(Cause.PROCESS_MISSING_CUT), int(Cause.RUN_LOST)
_NEIGHBOURS: Final = (
    (_READY,),
    (_IDLE, _ARMED, _FAULT),
    (_READY, _ACTIVE, _FAULT),
    (_HOLD, _RAMP, _FAULT),
    (_ACTIVE, _RAMP, _FAULT),
    (_READY, _IDLE, _HOLD, _FAULT),
    (_IDLE,),
)
_TABLE: Final = sum(1 << (8 * a + b) for a, row in enumerate(_NEIGHBOURS) for b in row)


@compiled
def broken_rules(before: Any, given: Any, after: Any, limits: Any, key: int) -> int:
    """Return a bit for each of :data:`RULES` that does not hold.

    Args:
        before: State of the supervisor.
        given: Its input.
        after: Its next state.
        limits: Cycles.
        key: The next state packed, below 0 where a number is out of its range.
    """
    a, b = before.state, after.state
    soft, hard, ends = given.soft != 0, given.hard != 0, given.stop == 1 or given.enable == 0
    may_ramp = given.in_cut == 0 or given.stands == 1
    watched = before.cause >= _PROCESS and before.cause < _RUN_LOST
    correcting = a in (_ACTIVE, _HOLD, _RAMP)
    fine = (
        key >= 0 and after.risen <= limits.rise and after.returns <= limits.returns + 1
            and after.held <= limits.hold + 1 and after.stop <= limits.stop and after.calm < limits.calm,
        a == b or (_TABLE >> (8 * a + b)) & 1 == 1,
        a != _FAULT or b == _FAULT or (given.reset == 1 and given.at_zero == 1 and given.hard in (0, _STOPPED)),
        not hard or a == _FAULT or (b == _IDLE if a == _IDLE else b == _FAULT and after.cause == given.hard),
        not (a == _ARMED and b == _ACTIVE) or not (ends or soft or hard or given.away == 1),
        not (a == _HOLD and b == _ACTIVE) or not (ends or soft or hard or watched or before.ending == 1
            or before.good < limits.good or before.returns >= limits.returns),
        b != _ARMED or a == _ARMED or (given.arm == 1 and given.stop == 0 and not soft and not hard
            and given.at_zero == 1 and given.enable == 0 and given.away == 0 and given.healthy == 1),
        not soft or hard or a not in (_ARMED, _ACTIVE) or (b == (_READY if a == _ARMED else _HOLD)),
        b != _ACTIVE or not ends,
        b != _RAMP or may_ramp,
        b not in (_HOLD, _RAMP) or after.held <= limits.hold,
        not (correcting and (ends or before.ending == 1))
            or (after.ending == 1 if b in (_HOLD, _RAMP) else b != _ACTIVE),
        after.feed_hold == (1 if b in (_HOLD, _FAULT) else 0) or b not in (_HOLD, _FAULT, _ACTIVE),
        before.feed_hold == 0 or after.feed_hold == 1 or b == _ACTIVE or given.reset == 1
            or (given.enable == 0 and given.in_cut == 0 and given.away == 0),
        given.away == 0 or given.reset == 1 or b == _ACTIVE or after.feed_hold == 1,
        after.stop == 0 or (after.feed_hold == 1 and b <= _ARMED),
        not (a == _RAMP and b <= _READY and after.feed_hold == 1) or after.stop == limits.stop,
        not (a in (_HOLD, _RAMP) and b in (_HOLD, _RAMP, _READY, _IDLE)) or after.cause == before.cause
            or (before.cause in (0, _PROGRAM)
                and after.cause == (_NOT_CLOSED if given.soft == _NOT_CLOSED else _ENABLE_LOST)),
        b not in (_HOLD, _RAMP, _FAULT) or after.cause != 0,
        (after.risen == (min(before.risen, limits.rise - 1) + 1 if a != _ARMED else 1)) if b == _ACTIVE
            else after.risen == (before.risen if b == _HOLD and correcting and a != _RAMP else 0),
        after.returns == (0 if b == _ACTIVE and a == _ARMED else before.returns + int(a == _HOLD and b == _ACTIVE))
            or (b == _ACTIVE and after.calm == 0 and before.calm == limits.calm - 1)
            or (limits.calm == 1 and b == _ACTIVE),
        not (a == _ACTIVE and b == _RAMP and given.stop == 1) or (after.cause == _OPERATOR
            and (after.feed_hold == 1 or given.reset == 1 or (given.enable == 0 and given.in_cut == 0))),
        not (a == _READY and given.healthy == 0 and not hard) or b == _IDLE,
    )  # fmt: skip
    out = 0
    for k in range(len(fine)):
        out |= 0 if fine[k] else 1 << k
    return out
