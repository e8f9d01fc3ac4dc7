"""Who lets the correction act: states, what moves between them, and what the output may do in each.

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

import numpy as np

from counterflex.core.arrays import Int
from counterflex.core.errors import InputError
from counterflex.core.jit import kernel
from counterflex.runtime.state.states import Cause as Cause
from counterflex.runtime.state.states import State as State

# Inputs of a cycle.
IN_TELEGRAM = 0  # 1: a valid telegram came in this cycle
IN_HEALTHY = 1  # 1: telegrams, sensors and self-tests are good enough to be READY
IN_ARM = 2  # 1: the operator's edge
IN_ENABLE = 3  # 1: the robot program wants the correction
IN_STOP = 4  # 1: the operator's or robot's stop
IN_RESET = 5  # 1: the operator's edge: out of FAULT, or a feed hold acknowledged
IN_SOFT = 6  # cause of a hold, or 0
IN_HARD = 7  # cause of a fault, or 0
IN_AT_ZERO = 8  # 1: the output is zero and at rest
IN_STANDS = 9  # 1: the commanded pose, correction aside, does not move
IN_AWAY = 10  # 1: the correction is away although the program is in the cut, or wants it again
IN_CUT = 11  # 1: material is cut here, or it may be
INPUTS = 12

# State of the supervisor.
AT_STATE = 0
AT_CAUSE = 1  # latched until reset, or until ACTIVE is reached again from HOLD
AT_CYCLES = 2  # in the present state
AT_GOOD = 3  # cycles without a soft cause, in HOLD
AT_RISE = 4  # 0 .. rise cycles: how far the correction has been faded in
AT_FEED_HOLD = 5  # 1: the robot is to hold its feed
AT_STOP = 6  # cycles left in which the robot is told to stop behind a ramp
AT_RETURNS = 7  # returns from HOLD to ACTIVE, those long ago forgotten
AT_CALM = 8  # cycles in ACTIVE since one was forgotten
AT_HELD = 9  # cycles in HOLD since the correction acted last, those before a ramp that was broken off included
AT_ENDING = 10  # 1: asked to end: HOLD leads to the ramp or to FAULT, never back
STATES = 11

# Settings.
SET_HOLD_CYCLES = 0
SET_GOOD_CYCLES = 1
SET_RISE_CYCLES = 2
SET_STOP_CYCLES = 3
SET_RETURNS = 4
SET_CALM_CYCLES = 5
SETTINGS = 6


@dataclass(frozen=True)
class SupervisorSettings:
    """How long things may last, in cycles.

    Attributes:
        hold: Longest HOLD, also in several pieces with ramps that were broken off between them, before the output is
            ramped out, or the robot stopped that does not hold.
        good: Clean cycles before HOLD may end.
        rise: Cycles over which the correction is faded in.
        stop: Cycles in FAULT in which the robot is told to stop, before the loop falls silent; also behind a ramp.
        returns: How often HOLD may end by itself before it needs a person: stop, do not limp.
        calm: Cycles in ACTIVE after which one return is forgotten.
    """

    hold: int = 125
    good: int = 50
    rise: int = 50
    stop: int = 125
    returns: int = 3
    calm: int = 2500

    def packed(self) -> Int:
        """(6,) for the kernel.

        Raises:
            InputError: A number below 1: zero never means without limit.
        """
        values = (self.hold, self.good, self.rise, self.stop, self.returns, self.calm)
        if min(values) < 1:
            raise InputError("cycles of the supervisor", value=min(values), limit=">= 1")
        return np.array(values, dtype=np.int64)


_IDLE, _READY, _ARMED, _ACTIVE = int(State.IDLE), int(State.READY), int(State.ARMED), int(State.ACTIVE)
_HOLD, _RAMP_OUT, _FAULT = int(State.HOLD), int(State.RAMP_OUT), int(State.FAULT)
_OPERATOR, _PROGRAM, _TOO_LONG = int(Cause.OPERATOR), int(Cause.PROGRAM), int(Cause.HELD_TOO_LONG)
_STOPPED, _ENABLE_LOST = int(Cause.TELEGRAMS_STOPPED), int(Cause.ENABLE_LOST)
_OF_PROCESS, _RUN_LOST = int(Cause.PROCESS_MISSING_CUT), int(Cause.RUN_LOST)


@kernel("void(int64[::1], int64[::1], int64[::1], int64, int64)")
def _ask_the_robot(at: Int, given: Int, settings: Int, following: int, cause: int) -> None:
    """Feed hold, and Stop behind a ramp: what was asked for stays so until somebody has seen it.

    It begins with HOLD and FAULT, and where the operator ends the correction. It ends where the correction acts again,
    with the operator's acknowledgment outside of HOLD and FAULT, and where the program has switched the correction off
    and is out of the cut. Where the correction is away in the cut, or wanted again without having been armed, it begins
    too.

    Args:
        at: (STATES,) before the change of state; AT_FEED_HOLD and AT_STOP are changed.
        given: (INPUTS,).
        settings: (6,).
        following: The next state.
        cause: Its cause.
    """
    state, before = at[AT_STATE], at[AT_FEED_HOLD]
    if following in (_HOLD, _FAULT):
        at[AT_FEED_HOLD] = 1
    elif following == _ACTIVE or given[IN_RESET] == 1:
        at[AT_FEED_HOLD] = 0
    elif given[IN_AWAY] == 1:
        at[AT_FEED_HOLD] = 1
    elif given[IN_ENABLE] == 0 and given[IN_CUT] == 0:
        at[AT_FEED_HOLD] = 0
    elif following == _RAMP_OUT and state == _ACTIVE and cause == _OPERATOR:
        at[AT_FEED_HOLD] = 1
    if at[AT_FEED_HOLD] == 0 or following > _ARMED:
        at[AT_STOP] = 0
    elif (state == _RAMP_OUT and following != _RAMP_OUT) or (before == 0 and following <= _ARMED):
        at[AT_STOP] = settings[SET_STOP_CYCLES]
    else:
        at[AT_STOP] = max(0, at[AT_STOP] - 1)


@kernel("void(int64[::1], int64[::1], int64[::1])")
def supervise(at: Int, given: Int, settings: Int) -> None:
    """Advance the supervisor by one cycle.

    Args:
        at: (STATES,) its state; changed.
        given: (INPUTS,) inputs of the cycle.
        settings: (6,) of :meth:`SupervisorSettings.packed`.
    """
    state, cause = at[AT_STATE], at[AT_CAUSE]
    soft, hard = given[IN_SOFT], given[IN_HARD]
    following = state
    # The correction moves towards zero only where the robot stands, or where nothing is cut.
    may_ramp = given[IN_CUT] == 0 or given[IN_STANDS] == 1
    ends = at[AT_ENDING] == 1 or given[IN_STOP] == 1 or given[IN_ENABLE] == 0
    if hard != 0 and state != _FAULT and state != _IDLE:
        following, cause = _FAULT, hard
    elif state == _IDLE:
        if given[IN_HEALTHY] == 1 and hard == 0 and soft == 0 and given[IN_AT_ZERO] == 1:
            following = _READY
            cause = cause if at[AT_FEED_HOLD] == 1 else 0
    elif state == _READY:
        if given[IN_HEALTHY] == 0:
            following = _IDLE
            cause = soft if soft != 0 else cause
        elif (
            given[IN_ARM] == 1
            and given[IN_STOP] == 0
            and soft == 0
            and given[IN_AT_ZERO] == 1
            and given[IN_ENABLE] == 0
            and given[IN_AWAY] == 0
        ):
            following, cause = _ARMED, 0
    elif state == _ARMED:
        if given[IN_STOP] == 1:
            following, cause = _READY, _OPERATOR
        elif soft != 0:
            following, cause = _READY, soft
        elif given[IN_AWAY] == 1:
            following, cause = _READY, _ENABLE_LOST
        elif given[IN_ENABLE] == 1:
            following, cause = _ACTIVE, 0
    elif state == _ACTIVE:
        if soft != 0:
            following, cause = _HOLD, soft
        elif ends:
            following = _RAMP_OUT if may_ramp else _HOLD
            if given[IN_STOP] == 1:
                cause = _OPERATOR
            else:
                cause = _ENABLE_LOST if given[IN_AWAY] == 1 else _PROGRAM
    elif state == _HOLD:
        may_return = (cause < _OF_PROCESS or cause >= _RUN_LOST) and at[AT_RETURNS] < settings[SET_RETURNS] and not ends
        if ends and may_ramp:
            following = _RAMP_OUT
        elif at[AT_HELD] >= settings[SET_HOLD_CYCLES]:
            if given[IN_STANDS] == 1:
                following = _RAMP_OUT
            else:
                following, cause = _FAULT, _TOO_LONG
        elif may_return and at[AT_GOOD] >= settings[SET_GOOD_CYCLES] and soft == 0:
            following, cause = _ACTIVE, 0
    elif state == _RAMP_OUT:
        if given[IN_AT_ZERO] == 1:
            following = _READY if given[IN_HEALTHY] == 1 else _IDLE
        elif not may_ramp:  # it goes on, or has come into the cut: held for what is left of the hold's time
            following, cause = (_HOLD, cause) if at[AT_HELD] < settings[SET_HOLD_CYCLES] else (_FAULT, _TOO_LONG)
    elif given[IN_RESET] == 1 and given[IN_AT_ZERO] == 1 and hard in (0, _STOPPED):
        # A controller whose next session nobody answered would not wait for a reset: it may come before.
        following, cause = _IDLE, 0
    if given[IN_AWAY] == 1 and following in (_IDLE, _READY, _RAMP_OUT, _HOLD) and cause in (0, _PROGRAM):
        cause = _ENABLE_LOST
    _ask_the_robot(at, given, settings, following, cause)
    if following not in (_HOLD, _RAMP_OUT):
        at[AT_HELD] = at[AT_ENDING] = 0
    else:
        at[AT_HELD] += 1 if following == _HOLD and state != _ACTIVE else 0
        at[AT_ENDING] = 1 if ends or following == _RAMP_OUT else 0
    at[AT_GOOD] = at[AT_GOOD] + 1 if following == _HOLD and soft == 0 else 0
    if following == _ACTIVE:
        if state == _ARMED:
            at[AT_RISE] = at[AT_RETURNS] = at[AT_CALM] = 0
        elif state == _HOLD:
            at[AT_RETURNS] += 1
            at[AT_CALM] = 0
        at[AT_RISE] = min(at[AT_RISE] + 1, settings[SET_RISE_CYCLES])
        at[AT_CALM] += 1
        if at[AT_CALM] >= settings[SET_CALM_CYCLES]:
            at[AT_RETURNS], at[AT_CALM] = max(0, at[AT_RETURNS] - 1), 0
    elif following != _HOLD:
        at[AT_RISE] = 0
    at[AT_CYCLES] = at[AT_CYCLES] + 1 if following == state else 0
    at[AT_STATE], at[AT_CAUSE] = following, cause


@kernel("float64(int64, int64)")
def risen(cycles: int, rise: int) -> float:
    """Share 0..1 of the correction after some cycles of fading in: ``10 x^3 - 15 x^4 + 6 x^5`` (least jerk)."""
    x = min(1.0, cycles / rise)
    return x * x * x * (10.0 + x * (-15.0 + 6.0 * x))
