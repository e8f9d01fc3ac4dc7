"""Sixth stage of the online step: who may act, by what was found in the cycle. Pure."""

from __future__ import annotations

from typing import Final

from counterflex.core.jit import kernel
from counterflex.core.records import Record, Records
from counterflex.runtime.primitives.frames import size_of
from counterflex.runtime.primitives.history import SPAN, STANDS_M, row_back, stands
from counterflex.runtime.primitives.loop_types import LOOP_TYPES
from counterflex.runtime.state.supervisor import Cause, State, risen, supervise

SESSION_S: Final = 1.0
"""How long a session of a controller may go on without a telegram, s; what comes later is another one's."""
DEBOUNCE: Final = 5
"""Telegrams in a row without the program's Enable from which the correction counts as switched off: 20 ms at 4 ms."""
NO_CUT: Final = 0
"""The plan says that nothing is cut here."""
CUT: Final = 1
"""The plan says that material is cut here; without a plan: there is a force."""
MAY_CUT: Final = 2
"""Nothing says whether material is cut here."""
CUTS_N: Final = 50.0
"""Measured force above which a loop without a plan takes the tool to be in the cut, and one with a plan doubts it."""
LAST_CORRECTION: Final = 0
"""The correction that was sent last is in force."""
NO_CORRECTION: Final = 1
UNKNOWN: Final = 2
RESOLVED_M: Final = 0.1e-3
"""Correction below which a reported pose says nothing of it."""
CONTINUES_M: Final = 5e-3
"""How far the commanded point goes at most in the telegrams that pass until a counter that jumped is believed."""
_AT_ZERO_M, _AT_ZERO_RAD = 1e-7, 1e-7
_ARMED, _ACTIVE = int(State.ARMED), int(State.ACTIVE)
_HOLD, _RAMP_OUT, _FAULT = int(State.HOLD), int(State.RAMP_OUT), int(State.FAULT)
_PROGRAM, _SESSION, _NOT_CLOSED = int(Cause.PROGRAM), int(Cause.SESSION_RESTARTED), int(Cause.NOT_CLOSED)


@kernel("int64(Given, Past[::1], int64, State)", **LOOP_TYPES)
def in_force(given: Record, ring: Records, here: int, state: Record) -> int:
    """Correction that stays in force at a controller whose counter jumped, or that began another session.

    A counter can jump while the session goes on, and then the correction that was sent last is in force; in another
    session none is. Where the controller reports its own pose, that shows which: the reported one less the commanded
    one, across the motion (along it the robot trails), lies nearer to one of the two. Without a report, or where so
    little is in force that a report does not tell, a program that
    has the correction switched off is another session's, and one that has it switched on and whose pose goes on within
    :data:`CONTINUES_M` is the same.

    Returns:
        KEPT, NOTHING or UNKNOWN.
    """
    last, first = row_back(here, 1), row_back(here, 1 + SPAN)
    before, earlier = ring[last], ring[first]
    jumped = moved = along = last_along = 0.0
    for k in range(3):
        way = before.nominal[9 + k] - earlier.nominal[9 + k]
        jumped += (given.nominal[9 + k] - before.nominal[9 + k]) ** 2
        moved += way * way
        along += (given.reported[9 + k] - given.nominal[9 + k]) * way
        last_along += state.correction[k] * way
    if given.is_reported == 0 or size_of(state.correction[:], 0) < RESOLVED_M:
        if given.enable == 0:
            return NO_CORRECTION
        return LAST_CORRECTION if jumped <= CONTINUES_M * CONTINUES_M else UNKNOWN
    off_last = off_none = 0.0
    for k in range(3):
        way = before.nominal[9 + k] - earlier.nominal[9 + k]
        shown = given.reported[9 + k] - given.nominal[9 + k]
        last = state.correction[k]
        if moved > STANDS_M * STANDS_M:
            shown -= along * way / moved
            last -= last_along * way / moved
        off_last += (shown - last) ** 2
        off_none += shown * shown
    return LAST_CORRECTION if off_last <= off_none else NO_CORRECTION


@kernel("int64(boolean, boolean, float64, float64, int64)")
def cuts_here(planned: bool, near: bool, cut: float, force_n: float, state: int) -> int:
    """Estimate of whether material is cut here.

    Args:
        planned: There is a plan.
        near: It is believed here: the commanded point is on its path.
        cut: 1 where the plan cuts.
        force_n: Size of the measured force, N; 0 where it is not used.
        state: Of the supervisor; a loop that does not act may be anywhere, and far from the path the plan says nothing.

    Returns:
        NO_CUT, CUT or MAY_CUT.
    """
    if planned and cut > 0.0:
        return CUT if near or state > _ARMED else NO_CUT
    if force_n > CUTS_N and not planned:
        return CUT
    return NO_CUT if near and force_n <= CUTS_N else MAY_CUT


@kernel("int64(Given, int64, int64, State)", **LOOP_TYPES)
def _is_requested(given: Record, cuts: int, standing: int, state: Record) -> int:
    """Test whether the program wants the correction, a flicker of its signal aside; act where it does not."""
    # Once it was on, the signal counts as off from the :data:`DEBOUNCE`-th telegram in a row without it. In the cut the
    # feed is then held: a program that has left the cut has no reason to be held, one in the cut would go on without
    # its correction, also one that comes into the next cut while the correction is still ramped out. The same behind
    # the end of the correction, where nobody has armed again and as many telegrams have the signal, in a row or not:
    # one that flickers is not off. In a cut one telegram since the end is enough. And the same where the program goes
    # through a cut although it was armed and the correction never acted: disarmed by a check, or never switched on.
    now, enable = state.supervisor.state, given.enable
    acts, held = now in (_ACTIVE, _HOLD), state.supervisor.feed_hold == 1
    if acts:
        state.acted, state.armed, state.enabled = 1, 0, 0
    elif now == _ARMED:
        state.armed, state.enabled = 1, 0
    if given.elapsed > 0:
        state.disabled = 0 if enable == 1 else state.disabled + 1
        state.enabled = 0 if held and state.disabled >= DEBOUNCE else state.enabled + enable
    off = state.disabled >= DEBOUNCE or (state.enabled == 0 and not acts)
    requested = 0 if enable == 0 and off else 1
    if given.reset == 1 and (now < _ARMED or now > _HOLD):
        # A person who acknowledges while the program is on its way to the cut has seen no hold of it yet: it has wanted
        # the correction since.
        if state.enabled == 0 or state.away == 1 or held:
            state.acted = state.armed = 0
        state.away = 0
    if given.elapsed > 0:
        demanded = state.armed == 1 or (state.acted == 1 and state.enabled > 0)
        uncorrected = demanded and cuts == CUT and standing == 0 and now <= _ARMED
        state.uncorrected = state.uncorrected + 1 if uncorrected else 0
    # Whatever it ended by: a hold in air that the program has left by its Enable is not asked for any more.
    free = state.supervisor.cause in (0, _PROGRAM) or not held
    ended = state.acted == 1 and (now < _ARMED or now == _RAMP_OUT) and free
    if cuts == CUT and requested == 0 and (acts or (now == _RAMP_OUT and standing == 0)):
        state.away = 1
    if (ended and state.enabled >= DEBOUNCE) or state.uncorrected >= DEBOUNCE:
        state.away = 1
    return requested


@kernel("void(State)", **LOOP_TYPES)
def _forget(state: Record) -> None:
    """The correction is zero: what was summed up belongs to another place of the program."""
    for k in range(6):
        state.tracker_integral[k] = 0.0
    for k in range(3):
        state.integral[k] = 0.0


@kernel("boolean(Settings, State)", **LOOP_TYPES)
def _at_zero(settings: Record, state: Record) -> bool:
    """Return whether the correction is zero and at rest."""
    y, v, period = state.correction[:], state.correction_rate[:], settings.period
    still = size_of(v, 0) * period < _AT_ZERO_M and size_of(v, 3) * period < _AT_ZERO_RAD
    return size_of(y, 0) < _AT_ZERO_M and size_of(y, 3) < _AT_ZERO_RAD and still


@kernel("int64(Given, int64, int64, int64, Settings, State, Cycle, Result)", **LOOP_TYPES)
def ask_supervisor(
    given: Record,
    standing: int,
    cuts: int,
    session: int,
    settings: Record,
    state: Record,
    cycle: Record,
    result: Record,
) -> int:
    """Ask the supervisor for this cycle; forget the state that belongs to another place or another session.

    ``standing``: 1: the program stands; ``cuts``: NO_CUT, CUT or MAY_CUT; ``session``: what :func:`in_force` says where
    the controller's counter jumped, else KEPT.

    Returns:
        The state of the supervisor.
    """
    inputs = state.inputs
    inputs.telegram = 1 if given.elapsed > 0 else 0
    inputs.healthy, inputs.arm = given.healthy, given.arm
    if cycle.soft == _NOT_CLOSED:  # the loop before this one may have been armed, and have corrected
        state.acted = state.armed = 1
    inputs.enable = _is_requested(given, cuts, standing, state)
    # A program that switches the correction off says that it has left the cut, where nothing else tells.
    inputs.in_cut = 1 if cuts == CUT or (cuts == MAY_CUT and inputs.enable == 1) else 0
    inputs.away = state.away
    inputs.stop, inputs.reset, inputs.soft, inputs.hard = given.stop, given.reset, cycle.soft, cycle.hard
    inputs.at_zero = 1 if _at_zero(settings, state) else 0
    inputs.stands = standing
    before = state.supervisor.state
    supervise(state.supervisor, inputs, settings.supervisor)
    now: int = state.supervisor.state
    if now == _ACTIVE:
        state.away = 0
    # Another session of the controller begins with no correction in force: what was held belongs to the one before.
    # Where it cannot be told whether it is another one nothing is said to it, because either answer may be a jump; nor
    # to one that begins in a fault: the robot has been told to stop, and was started again.
    if session == UNKNOWN or (session == NO_CORRECTION and before == _FAULT):
        state.another_session = 1
    if session != LAST_CORRECTION:
        for k in range(6):
            state.correction[k] = state.correction_rate[k] = 0.0
    if now <= _ARMED:
        _forget(state)
    if now != _FAULT:
        state.another_session = 0
    elif state.telegrams_lost * settings.period > SESSION_S and result.silent == 1:
        for k in range(6):  # nobody asked and nobody was answered until the session was over: nothing is in effect
            state.correction[k] = state.correction_rate[k] = 0.0
    return now


@kernel("float64(Given, Settings, State, Past[::1], Cycle, Result)", **LOOP_TYPES)
def supervise_cycle(
    given: Record, settings: Record, state: Record, ring: Records, cycle: Record, result: Record
) -> float:
    """Run the supervisor on the findings of this cycle.

    Returns:
        Share 0..1 by which the correction is faded in.
    """
    share, now = risen(state.supervisor.risen, settings.supervisor.rise), state.supervisor.state
    standing = 1 if stands(ring, state.ring_row, given.nominal[:]) else 0
    session = LAST_CORRECTION
    if given.hard == _SESSION:
        session = in_force(given, ring, state.ring_row, state) if now > _ARMED else NO_CORRECTION
    planned = cycle.planned == 1
    near = planned and cycle.path_distance <= settings.off_path
    force_n = size_of(result.measured[:], 0) if settings.force != 0 else 0.0
    cuts = cuts_here(planned, near, cycle.cut, force_n, now)
    ask_supervisor(given, standing, cuts, session, settings, state, cycle, result)
    return float(share)
