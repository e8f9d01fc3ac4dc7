"""The last part of the online step: who may act, how far and how fast, and what the robot makes of it. Pure.

Supervisor, limits, memory of what was sent, and the same correction as axis angles; called by
:func:`counterflex.runtime.step.step.step` in this order. Part frame, SI.
"""

from __future__ import annotations

import math
from typing import Final

from counterflex.core.arrays import Float, Int
from counterflex.core.jit import kernel
from counterflex.robot.elasticity.kernels.step import DAMPED, cholesky_inverse, newton_step
from counterflex.runtime.estimator.deflection import answered
from counterflex.runtime.primitives.frames import shorten, size_of, turn
from counterflex.runtime.primitives.history import SPAN, STANDS_M
from counterflex.runtime.state import layout as at
from counterflex.runtime.state.supervisor import (
    AT_CAUSE,
    AT_STATE,
    IN_ARM,
    IN_AT_ZERO,
    IN_AWAY,
    IN_CUT,
    IN_ENABLE,
    IN_HARD,
    IN_HEALTHY,
    IN_RESET,
    IN_SOFT,
    IN_STANDS,
    IN_STOP,
    IN_TELEGRAM,
    STATES,
    Cause,
    State,
    supervise,
)
from counterflex.signals.limiter import limited_step

FAULT_LOST: Final = 10
"""Telegrams lost in a row that are a fault."""
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
KEPT: Final = 0
"""The correction that was sent last is in force."""
NOTHING: Final = 1
UNKNOWN: Final = 2
TELLS_M: Final = 0.1e-3
"""Correction below which a reported pose says nothing of it."""
CONTINUES_M: Final = 5e-3
"""How far the commanded point goes at most in the telegrams that pass until a counter that jumped is believed."""
_AT_ZERO_M = 1e-7
_AT_ZERO_RAD = 1e-7
_FUSED = 4
_ARMED, _ACTIVE = int(State.ARMED), int(State.ACTIVE)
_HOLD, _RAMP_OUT, _FAULT = int(State.HOLD), int(State.RAMP_OUT), int(State.FAULT)
_NOT_FINITE, _PROGRAM = int(Cause.NOT_FINITE), int(Cause.PROGRAM)


@kernel("int64(float64[::1], int64[::1], float64[:, ::1], int64, float64[::1])")
def in_force(given: Float, flags: Int, ring: Float, here: int, state: Float) -> int:
    """What the controller goes on with whose counter jumped, or that began another session.

    A counter can jump while the session goes on, and then the correction that was sent last is in force; in another
    session none is. Where the controller reports its own pose, that shows which: the reported one less the commanded
    one, across the motion (along it the robot trails), lies nearer to one of the two. Without a report, or where so
    little is in force that a report does not tell, a program that
    has the correction switched off is another session's, and one that has it switched on and whose pose goes on within
    :data:`CONTINUES_M` is the same.

    Args:
        given: (at.GIVEN,) inputs of the first telegram after the jump.
        flags: (at.FLAGS,) likewise.
        ring: Of the last cycles.
        here: Row of this cycle.
        state: (at.STATE,).

    Returns:
        KEPT, NOTHING or UNKNOWN.
    """
    before = ring[(here - 1 + at.RING_ROWS) % at.RING_ROWS]
    earlier = ring[(here - 1 - SPAN + at.RING_ROWS) % at.RING_ROWS]
    gone = moved = along = kept_along = 0.0
    for k in range(3):
        at_k = at.RING_NOMINAL + 9 + k
        way = before[at_k] - earlier[at_k]
        gone += (given[at.G_NOMINAL + 9 + k] - before[at_k]) ** 2
        moved += way * way
        along += (given[at.G_REPORTED + 9 + k] - given[at.G_NOMINAL + 9 + k]) * way
        kept_along += state[at.S_Y + k] * way
    if flags[at.F_REPORTED] == 0 or size_of(state, at.S_Y) < TELLS_M:
        if flags[at.F_ENABLE] == 0:
            return NOTHING
        return KEPT if gone <= CONTINUES_M * CONTINUES_M else UNKNOWN
    near_kept = near_nothing = 0.0
    for k in range(3):
        way = before[at.RING_NOMINAL + 9 + k] - earlier[at.RING_NOMINAL + 9 + k]
        shown = given[at.G_REPORTED + 9 + k] - given[at.G_NOMINAL + 9 + k]
        kept = state[at.S_Y + k]
        if moved > STANDS_M * STANDS_M:
            shown -= along * way / moved
            kept -= kept_along * way / moved
        near_kept += (shown - kept) ** 2
        near_nothing += shown * shown
    return KEPT if near_kept <= near_nothing else NOTHING


@kernel("int64(boolean, boolean, float64, float64, int64)")
def cuts_here(planned: bool, near: bool, cut: float, force_n: float, state: int) -> int:
    """What is known of whether material is cut here.

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


@kernel("int64(int64[::1], int64, int64, int64[::1])")
def _wanted(flags: Int, cuts: int, standing: int, whole: Int) -> int:
    """Whether the program wants the correction, a flicker of its signal aside, and what follows where it is away.

    While the correction acts the signal counts as off from the :data:`DEBOUNCE`-th telegram in a row without it. In the
    cut the feed is then held: a program that has left the cut has no reason to be held, one in the cut would go on
    without its correction, also one that comes into the next cut while the correction is still ramped out. The same
    where the signal is back for as long, and nobody has armed again; and where the program goes through a cut for as
    long although it was armed and the correction never acted: disarmed by a check, or never switched on.

    Args:
        flags: (at.FLAGS,) inputs.
        cuts: NO_CUT, CUT or MAY_CUT.
        standing: 1: the program stands.
        whole: (at.WHOLE,); changed.
    """
    state, enable = whole[AT_STATE], flags[at.F_ENABLE]
    if flags[at.F_RESET] == 1 and state != _HOLD:
        whole[at.N_ACTED] = whole[at.N_AWAY] = whole[at.N_ARMED] = 0
    acts = state in (_ACTIVE, _HOLD)
    if state == _ARMED:
        whole[at.N_ARMED] = 1
    elif acts:
        whole[at.N_ARMED] = 0
    if flags[at.F_ELAPSED] > 0:
        whole[at.N_DISABLED] = 0 if enable == 1 else whole[at.N_DISABLED] + 1
        whole[at.N_ENABLED] = whole[at.N_ENABLED] + 1 if enable == 1 else 0
        uncorrected = cuts == CUT and standing == 0 and whole[at.N_ARMED] == 1 and state <= _ARMED
        whole[at.N_UNCORRECTED] = whole[at.N_UNCORRECTED] + 1 if uncorrected else 0
    wanted = 1 if enable == 1 or (acts and whole[at.N_DISABLED] < DEBOUNCE) else 0
    ended = whole[at.N_ACTED] == 1 and (state < _ARMED or state == _RAMP_OUT) and whole[AT_CAUSE] in (0, _PROGRAM)
    if cuts == CUT and wanted == 0 and (acts or (state == _RAMP_OUT and standing == 0)):
        whole[at.N_AWAY] = 1
    if (ended and whole[at.N_ENABLED] >= DEBOUNCE) or whole[at.N_UNCORRECTED] >= DEBOUNCE:
        whole[at.N_AWAY] = 1
    return wanted


@kernel(
    "int64(int64[::1], int64, int64, int64, int64, float64, int64, int64[::1], float64[::1], int64[::1], int64[::1])"
)
def ask_supervisor(
    flags: Int,
    soft: int,
    hard: int,
    standing: int,
    cuts: int,
    period: float,
    session: int,
    supervisor_settings: Int,
    state: Float,
    whole: Int,
    outcome: Int,
) -> int:
    """Who may act in this cycle; forgets what belongs to another place or another session.

    Args:
        flags: (at.FLAGS,) inputs.
        soft: Cause of a hold, or 0.
        hard: Cause of a fault, or 0.
        standing: 1: the program stands.
        cuts: NO_CUT, CUT or MAY_CUT.
        period: Of a cycle, s.
        session: What :func:`in_force` says where the controller's counter jumped, else KEPT.
        supervisor_settings: (6,).
        state: (at.STATE,); changed.
        whole: (at.WHOLE,); changed.
        outcome: (at.OUTCOME,) of the last cycle.

    Returns:
        The state of the supervisor.
    """
    inputs = whole[at.N_INPUTS :]
    inputs[IN_TELEGRAM] = 1 if flags[at.F_ELAPSED] > 0 else 0
    inputs[IN_HEALTHY], inputs[IN_ARM] = flags[at.F_HEALTHY], flags[at.F_ARM]
    inputs[IN_ENABLE] = _wanted(flags, cuts, standing, whole)
    # A program that switches the correction off says that it has left the cut, where nothing else tells.
    inputs[IN_CUT] = 1 if cuts == CUT or (cuts == MAY_CUT and inputs[IN_ENABLE] == 1) else 0
    inputs[IN_AWAY] = whole[at.N_AWAY]
    inputs[IN_STOP], inputs[IN_RESET], inputs[IN_SOFT], inputs[IN_HARD] = (
        flags[at.F_STOP],
        flags[at.F_RESET],
        soft,
        hard,
    )
    still = size_of(state, at.S_V) * period < _AT_ZERO_M and size_of(state, at.S_V + 3) * period < _AT_ZERO_RAD
    at_zero = size_of(state, at.S_Y) < _AT_ZERO_M and size_of(state, at.S_Y + 3) < _AT_ZERO_RAD and still
    inputs[IN_AT_ZERO] = 1 if at_zero else 0
    inputs[IN_STANDS] = standing
    before = whole[AT_STATE]
    supervise(whole[:STATES], inputs, supervisor_settings)
    now: int = whole[AT_STATE]
    if now == _ACTIVE:
        whole[at.N_ACTED], whole[at.N_AWAY] = 1, 0
    # Another session of the controller begins with no correction in force: what was held belongs to the one before.
    # Where it cannot be told whether it is another one nothing is said to it, because either answer may be a jump; nor
    # to one that begins in a fault: the robot has been told to stop, and was started again.
    if session == UNKNOWN or (session == NOTHING and before == _FAULT):
        whole[at.N_SESSION] = 1
    if session != KEPT:
        for k in range(6):
            state[at.S_Y + k] = state[at.S_V + k] = 0.0
    if now <= _ARMED:  # the correction is zero: what was summed up belongs to another place of the program
        for k in range(6):
            state[at.S_SUM + k] = 0.0
        for k in range(3):
            state[at.S_INTEGRAL + k] = 0.0
    if now != _FAULT:
        whole[at.N_SESSION] = 0
    elif whole[at.N_LATE] * period > SESSION_S and outcome[at.O_SILENT] == 1:
        for k in range(12):  # nobody asked and nobody was answered until the session was over: nothing is in effect
            state[at.S_Y + k] = 0.0
    return now


@kernel("int64(int64, int64, float64, float64[::1], int64, float64[::1], float64[::1], float64[::1])")
def limit(
    now: int, held: int, share: float, wanted: Float, elapsed: int, constants: Float, state: Float, results: Float
) -> int:
    """Move the correction towards what is wanted, as far as state and limits allow.

    From HOLD it goes on where it stood, and ramps from there to what is wanted.

    Args:
        now: State of the supervisor.
        held: 1: its last state was HOLD.
        share: 0..1, by which the correction is faded in.
        wanted: (6,) m and rotation vector.
        elapsed: Cycles since the last telegram.
        constants: (at.CONSTANTS,).
        state: (at.STATE,); changed.
        results: (at.RESULTS,); R_CORRECTION is written.

    Returns:
        Bits of the limiter: translation, then rotation shifted by 4.
    """
    period = constants[at.C_PERIOD]
    limits = 0
    target = state[at.S_HELD : at.S_HELD + 6]
    bumpless = state[at.S_BUMPLESS : at.S_BUMPLESS + 6]
    for k in range(6):
        if now != _ACTIVE:
            bumpless[k] = 0.0
        elif held == 1:
            bumpless[k] = state[at.S_Y + k] - share * wanted[k]
    shorten(bumpless, 0, constants[at.C_RAMP + 1] * period * elapsed)
    shorten(bumpless, 3, constants[at.C_RAMP_ROTATION + 1] * period * elapsed)
    for k in range(6):
        if now == _ACTIVE:
            target[k] = share * wanted[k] + bumpless[k]
        elif now in (_HOLD, _FAULT):
            target[k] = math.nan
        else:
            target[k] = 0.0
    # From rest at zero there is nowhere to ramp to: no state but ACTIVE moves the output away from zero.
    first = at.C_RAMP if now == _RAMP_OUT else at.C_TRANSLATION
    second = at.C_RAMP_ROTATION if now == _RAMP_OUT else at.C_ROTATION
    y, v = state[at.S_Y : at.S_Y + 6], state[at.S_V : at.S_V + 6]
    # Without a telegram nothing is sent, so nothing moves: the cycles are made up for when the next one comes.
    for _ in range(elapsed):
        limits |= limited_step(y[:3], v[:3], target[:3], constants[first : first + 3], period)
        limits |= limited_step(y[3:], v[3:], target[3:6], constants[second : second + 3], period) << 4
    for k in range(6):
        if math.isnan(target[k]):
            target[k] = state[at.S_Y + k]
        results[at.R_CORRECTION + k] = state[at.S_Y + k]
    return limits


@kernel(
    "void(int64, int64, float64[::1], float64[::1], int64[::1], float64[::1], float64[::1], int64[::1],"
    " float64[:, ::1])"
)
def remember(
    here: int,
    hard: int,
    nominal: Float,
    bent: Float,
    choices: Int,
    constants: Float,
    state: Float,
    whole: Int,
    ring: Float,
) -> None:
    """Write the cycle into the ring of the last ones, and compute what the robot makes of the correction.

    Args:
        here: Row of this cycle.
        hard: Cause of a fault, or 0.
        nominal: (12,) commanded pose without correction.
        bent: (6,) deflection, part axes.
        choices: (at.CHOICES,).
        constants: (at.CONSTANTS,).
        state: (at.STATE,); changed.
        whole: (at.WHOLE,); changed.
        ring: (at.RING_ROWS, at.RING); changed.
    """
    if hard == _NOT_FINITE:  # nothing of it into what is remembered: filters over the past would never forget it
        before = (here - 1 + at.RING_ROWS) % at.RING_ROWS
        for k in range(at.RING):
            ring[here, k] = ring[before, k]
        ring[here, at.RING_CLOCK] = state[at.S_CLOCK]
    else:
        for k in range(12):
            ring[here, at.RING_NOMINAL + k] = nominal[k]
    for k in range(6):
        ring[here, at.RING_SENT + k] = state[at.S_Y + k]
        ring[here, at.RING_DEFLECTION + k] = bent[k] if k < 3 or choices[at.W_ORIENTATION] == 1 else 0.0
    if choices[at.W_FORCE] != _FUSED:
        answered(ring, here, choices[at.W_CORRECTION_BACK], constants, state)
    whole[at.N_RING] = (here + 1) % at.RING_ROWS


@kernel("int64(int64, float64[::1], float64[::1], float64[:, ::1], float64[::1], float64[::1])")
def as_axes(status: int, constants: Float, state: Float, scratch: Float, error: Float, results: Float) -> int:
    """The correction as change of the axis angles: one Newton step with the rigid Jacobian, never damped.

    Args:
        status: DAMPED or 0: of the elastic step, which left Jacobian and inverse factor in ``scratch``.
        constants: (at.CONSTANTS,).
        state: (at.STATE,); changed.
        scratch: (SCRATCH, 36) of the elastic step.
        error: (12,) work space.
        results: (at.RESULTS,); R_AXES is written.

    Returns:
        CLAMPED or 0.
    """
    for k in range(6):
        error[k] = -state[at.S_Y + k]
    turn(constants, at.C_R_BASE_PART, error, 0)
    turn(constants, at.C_R_BASE_PART, error, 3)
    if status & DAMPED:
        cholesky_inverse(scratch[1], 0.0, scratch[2], scratch[3])
    clamped = newton_step(scratch[1], scratch[3], error, scratch[5], results[at.R_AXES : at.R_AXES + 6])
    for k in range(6):
        state[at.S_AXES + k] = results[at.R_AXES + k]
    return clamped
