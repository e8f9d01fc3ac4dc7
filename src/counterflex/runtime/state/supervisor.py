"""States of the loop, the events that move between them, and the output allowed in each.

::

    IDLE - healthy -> READY - arm -> ARMED - enable -> ACTIVE - soft cause -> HOLD - good again -> ACTIVE
                      READY <- stop, soft cause - ARMED        (ACTIVE, HOLD) - the end, where it may ramp -> RAMP_OUT
    IDLE, READY <- at zero - RAMP_OUT - in the cut and moving -> HOLD - too long -> RAMP_OUT where it stands, else FAULT
    every state but IDLE - hard cause -> FAULT - reset by a person, at zero -> IDLE

A pure function of one cycle. Correction acts in ACTIVE only. What goes wrong freezes the output in the same cycle
(HOLD) and asks for a feed hold. When it lasts, the correction is ramped out slowly where the robot stands; a robot that
goes on although it is to hold is told to stop with the correction as it is (FAULT), because a program that goes on is
never left without its correction in the cut. A feed hold that was asked for stays so, and the robot is told to stop
behind the ramp, until a person acknowledges it or the program itself has switched the correction off. A stop, and a
program that switches the correction off in the cut, go the same way: held first, ramped out as soon as the robot
stands, stopped with its correction where it does not. Only out of the cut the ramp begins at once; a robot that goes on
in the cut while it lasts is held again, for what is left of the hold's time. What must not happen is a FAULT: the
output is held, the robot is told to stop, and only a person leads out of it, with the correction at zero. There is no
way from FAULT to ACTIVE.
"""

from __future__ import annotations

from dataclasses import dataclass

from counterflex.core.errors import InputError
from counterflex.core.jit import kernel
from counterflex.core.records import Record
from counterflex.runtime.state.chosen import SUPERVISION
from counterflex.runtime.state.memory import SUPERVISED, SUPERVISOR
from counterflex.runtime.state.states import Cause as Cause, State as State


@dataclass(frozen=True)
class SupervisorSettings:
    """Longest durations of conditions, in cycles."""

    # longest HOLD, also in several pieces with ramps that were broken off between them, before the output is ramped
    # out, or the robot stopped that does not hold
    hold: int = 125
    good: int = 50  # clean cycles before HOLD may end
    rise: int = 50  # cycles over which the correction is faded in
    # cycles in FAULT in which the robot is told to stop, before the loop falls silent; also behind a ramp
    stop: int = 125
    returns: int = 3  # how often HOLD may end by itself before it needs a person: stop, do not limp
    calm: int = 2500  # cycles in ACTIVE after which one return is forgotten

    def packed(self) -> tuple[int, ...]:
        """The six numbers, in the order of :data:`counterflex.runtime.state.chosen.SUPERVISION`.

        Raises:
            InputError: A number below 1: zero never means without limit.
        """
        values = (self.hold, self.good, self.rise, self.stop, self.returns, self.calm)
        if min(values) < 1:
            raise InputError("cycles of the supervisor", value=min(values), limit=">= 1")
        return values


_IDLE, _READY, _ARMED, _ACTIVE = int(State.IDLE), int(State.READY), int(State.ARMED), int(State.ACTIVE)
_HOLD, _RAMP_OUT, _FAULT = int(State.HOLD), int(State.RAMP_OUT), int(State.FAULT)
_OPERATOR, _PROGRAM, _TOO_LONG = int(Cause.OPERATOR), int(Cause.PROGRAM), int(Cause.HELD_TOO_LONG)
_STOPPED, _ENABLE_LOST, _NOT_CLOSED = int(Cause.TELEGRAMS_STOPPED), int(Cause.ENABLE_LOST), int(Cause.NOT_CLOSED)
_OF_PROCESS, _RUN_LOST = int(Cause.PROCESS_MISSING_CUT), int(Cause.RUN_LOST)
_TYPES: dict[str, Record] = {"Supervisor": SUPERVISOR, "Supervised": SUPERVISED, "Supervision": SUPERVISION}


@kernel("void(Supervisor, Supervised, Supervision, int64, int64)", **_TYPES)
def _ask_the_robot(at: Record, given: Record, settings: Record, following: int, cause: int) -> None:
    """Feed hold, and Stop behind a ramp: what was asked for stays so until somebody has seen it."""
    # It begins with HOLD and FAULT, and where the operator ends the correction. It ends where the correction acts
    # again, with the operator's acknowledgment outside of HOLD and FAULT, and where the program has switched the
    # correction off and is out of the cut. Where the correction is away in the cut, or wanted again without having been
    # armed, it begins too.
    state, before = at.state, at.feed_hold
    if following in (_HOLD, _FAULT):
        at.feed_hold = 1
    elif following == _ACTIVE or given.reset == 1:
        at.feed_hold = 0
    elif given.away == 1:
        at.feed_hold = 1
    elif given.enable == 0 and given.in_cut == 0:
        at.feed_hold = 0
    elif following == _RAMP_OUT and state == _ACTIVE and cause == _OPERATOR:
        at.feed_hold = 1
    if at.feed_hold == 0 or following > _ARMED:
        at.stop = 0
    elif (state == _RAMP_OUT and following != _RAMP_OUT) or (before == 0 and following <= _ARMED):
        at.stop = settings.stop
    else:
        at.stop = max(0, at.stop - 1)


@kernel("Tuple((int64, int64))(Supervisor, Supervised)", **_TYPES)
def _until_active(at: Record, given: Record) -> tuple[int, int]:
    """State and cause after IDLE, READY or ARMED."""
    state, cause, soft = at.state, at.cause, given.soft
    if state == _IDLE:
        if given.healthy == 1 and given.hard == 0 and soft == 0 and given.at_zero == 1:
            return _READY, cause if at.feed_hold == 1 else 0
    elif state == _READY:
        if given.healthy == 0:
            return _IDLE, soft if soft != 0 else cause
        free = given.arm == 1 and given.stop == 0 and soft == 0
        if free and given.at_zero == 1 and given.enable == 0 and given.away == 0:
            return _ARMED, 0
    elif given.stop == 1:
        return _READY, _OPERATOR
    elif soft != 0:
        return _READY, soft
    elif given.away == 1:
        return _READY, _ENABLE_LOST
    elif given.enable == 1:
        return _ACTIVE, 0
    return state, cause


@kernel("Tuple((int64, int64))(Supervisor, Supervised, Supervision, boolean)", **_TYPES)
def _from_active(at: Record, given: Record, settings: Record, ends: bool) -> tuple[int, int]:
    """State and cause after ACTIVE, HOLD or RAMP_OUT."""
    state, cause, soft = at.state, at.cause, given.soft
    # The correction moves towards zero only where the robot stands, or where nothing is cut.
    may_ramp = given.in_cut == 0 or given.stands == 1
    if state == _ACTIVE:
        if soft != 0:
            return _HOLD, soft
        if ends:
            following = _RAMP_OUT if may_ramp else _HOLD
            if given.stop == 1:
                return following, _OPERATOR
            return following, _ENABLE_LOST if given.away == 1 else _PROGRAM
    elif state == _HOLD:
        may_return = (cause < _OF_PROCESS or cause >= _RUN_LOST) and at.returns < settings.returns and not ends
        if ends and may_ramp:
            return _RAMP_OUT, cause
        if at.held >= settings.hold:
            return (_RAMP_OUT, cause) if given.stands == 1 else (_FAULT, _TOO_LONG)
        if may_return and at.good >= settings.good and soft == 0:
            return _ACTIVE, 0
    elif given.at_zero == 1:
        return _READY if given.healthy == 1 else _IDLE, cause
    elif not may_ramp:  # it goes on, or has come into the cut: held for what is left of the hold's time
        return (_HOLD, cause) if at.held < settings.hold else (_FAULT, _TOO_LONG)
    return state, cause


@kernel("void(Supervisor, Supervised, Supervision)", **_TYPES)
def supervise(at: Record, given: Record, settings: Record) -> None:
    """Advance the supervisor by one cycle.

    Args:
        at: Its state; changed.
        given: Inputs of the cycle.
        settings: Cycles of :class:`SupervisorSettings`.
    """
    state, following, cause = at.state, at.state, at.cause
    soft, hard = given.soft, given.hard
    ends = at.ending == 1 or given.stop == 1 or given.enable == 0
    if hard != 0 and state != _FAULT and state != _IDLE:
        following, cause = _FAULT, hard
    elif state in (_IDLE, _READY, _ARMED):
        following, cause = _until_active(at, given)
    elif state != _FAULT:
        following, cause = _from_active(at, given, settings, ends)
    elif given.reset == 1 and given.at_zero == 1 and hard in (0, _STOPPED):
        # A controller whose next session nobody answered would not wait for a reset: it may come before.
        following, cause = _IDLE, 0
    if given.away == 1 and following in (_IDLE, _READY, _RAMP_OUT, _HOLD) and cause in (0, _PROGRAM):
        cause = _NOT_CLOSED if soft == _NOT_CLOSED else _ENABLE_LOST
    _ask_the_robot(at, given, settings, following, cause)
    if following not in (_HOLD, _RAMP_OUT):
        at.held = at.ending = 0
    else:
        at.held += 1 if following == _HOLD and state != _ACTIVE else 0
        at.ending = 1 if ends or following == _RAMP_OUT else 0
    at.good = at.good + 1 if following == _HOLD and soft == 0 else 0
    if following == _ACTIVE:
        if state == _ARMED:
            at.risen = at.returns = at.calm = 0
        elif state == _HOLD:
            at.returns += 1
            at.calm = 0
        at.risen = min(at.risen + 1, settings.rise)
        at.calm += 1
        if at.calm >= settings.calm:
            at.returns, at.calm = max(0, at.returns - 1), 0
    elif following != _HOLD:
        at.risen = 0
    at.cycles = at.cycles + 1 if following == state else 0
    at.state, at.cause = following, cause


@kernel("float64(int64, int64)", entry=True)
def risen(cycles: int, rise: int) -> float:
    """Share 0..1 of the correction after some cycles of fading in: ``10 x^3 - 15 x^4 + 6 x^5`` (least jerk)."""
    x = min(1.0, cycles / rise)
    return x * x * x * (10.0 + x * (-15.0 + 6.0 * x))
