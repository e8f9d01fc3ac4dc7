"""Last stages of the online step: how far and how fast, what the robot makes of it, and what is reported. Pure."""

from __future__ import annotations

import math

from counterflex.core.jit import kernel
from counterflex.core.records import Record, Records
from counterflex.robot.elasticity.kernels.step import REFUSED
from counterflex.runtime.estimator.deflection import answered
from counterflex.runtime.primitives.frames import shorten
from counterflex.runtime.primitives.history import row_back
from counterflex.runtime.primitives.loop_types import LOOP_TYPES
from counterflex.runtime.state.memory import PAST_ROWS
from counterflex.runtime.state.supervisor import Cause, State
from counterflex.runtime.step.axis_pid_kernel import to_axes
from counterflex.signals.limiter import limited_step

_FUSED = 4
_READY, _ACTIVE = int(State.READY), int(State.ACTIVE)
_HOLD, _RAMP_OUT, _FAULT = int(State.HOLD), int(State.RAMP_OUT), int(State.FAULT)
_NOT_FINITE = int(Cause.NOT_FINITE)


@kernel("int64(float64, Settings, State, Cycle, Result)", **LOOP_TYPES)
def limit(share: float, settings: Record, state: Record, cycle: Record, result: Record) -> int:
    """Move the correction towards what is wanted, as far as state and limits allow.

    From HOLD it goes on where it stood, and ramps from there to what is wanted.

    Args:
        share: 0..1, by which the correction is faded in.
        state: Of the step; changed.
        cycle: Whether the last state was HOLD, and cycles to move for.
        result: With the wanted correction; the one to be sent is written.

    Returns:
        Bits of the limiter: translation, then rotation shifted by 4.
    """
    now, elapsed, requested = state.supervisor.state, cycle.elapsed, result.wanted[:]
    period = settings.period
    limits = 0
    target = state.target[:]
    bumpless = state.bumpless[:]
    for k in range(6):
        if now != _ACTIVE:
            bumpless[k] = 0.0
        elif cycle.held == 1:
            bumpless[k] = state.correction[k] - share * requested[k]
    shorten(bumpless, 0, settings.ramp[1] * period * elapsed)
    shorten(bumpless, 3, settings.ramp_rotation[1] * period * elapsed)
    for k in range(6):
        if now == _ACTIVE:
            target[k] = share * requested[k] + bumpless[k]
        elif now in (_HOLD, _FAULT):
            target[k] = math.nan
        else:
            target[k] = 0.0
    # From rest at zero there is nowhere to ramp to: no state but ACTIVE moves the output away from zero.
    translation = settings.ramp[:] if now == _RAMP_OUT else settings.translation[:]
    rotation = settings.ramp_rotation[:] if now == _RAMP_OUT else settings.rotation[:]
    y, v = state.correction[:], state.correction_rate[:]
    # Without a telegram nothing is sent, so nothing moves: the cycles are made up for when the next one comes.
    for _ in range(elapsed):
        limits |= limited_step(y[:3], v[:3], target[:3], translation, period)
        limits |= limited_step(y[3:], v[3:], target[3:6], rotation, period) << 4
    for k in range(6):
        if math.isnan(target[k]):
            target[k] = state.correction[k]
        result.correction[k] = state.correction[k]
    return limits


@kernel("void(Settings, State, Past[::1], Cycle)", **LOOP_TYPES)
def remember(settings: Record, state: Record, ring: Records, cycle: Record) -> None:
    """Write what is sent into the row of the cycle, go on to the next, and compute what the robot makes of it."""
    here = state.ring_row
    now = ring[here]
    if cycle.hard == _NOT_FINITE:  # nothing of it into what is remembered: filters over the past would never forget it
        ring[here] = ring[row_back(here, 1)]
        now.clock = state.clock
    for k in range(6):
        now.sent[k] = state.correction[k]
    if settings.force != _FUSED:
        answered(ring, here, settings.correction_back, settings, state)
    for k in range(6):
        now.in_effect[k] = state.in_effect[k]
    state.ring_row = (here + 1) % PAST_ROWS


@kernel("void(Given, Settings, State, ElasticWork, Cycle, Result)", **LOOP_TYPES)
def as_axes(given: Record, settings: Record, state: Record, work: Record, cycle: Record, result: Record) -> None:
    """The correction as change of the axis angles: one Newton step with the rigid Jacobian, never damped.

    Where axis angles cannot be computed they stay as they were: a fault holds, also in the axes.

    ``work``: of the elastic step, which left Jacobian and inverse factor there; ``cycle``: with the status of the
    elastic step, to which CLAMPED is added.
    """
    axes = result.axes[:]
    for k in range(6):
        axes[k] = state.axes[k]
    if cycle.hard == _NOT_FINITE or cycle.elastic & REFUSED:
        return
    to_axes(given, settings, work, cycle, state.correction[:], axes)
    for k in range(6):
        state.axes[k] = axes[k]


@kernel("void(Settings, State, Cycle, Result)", **LOOP_TYPES)
def report(settings: Record, state: Record, cycle: Record, result: Record) -> None:
    """Write what the cycle found into the result.

    Args:
        cycle: What was found.
        result: Written.
    """
    at, now = state.supervisor, state.supervisor.state
    result.path_distance, result.cut = cycle.path_distance, cycle.cut
    result.sources, result.degraded = cycle.sources, cycle.degraded
    result.state, result.cause, result.feed_hold = now, at.cause, at.feed_hold
    if now <= _READY and cycle.soft != 0 and at.feed_hold == 0:
        result.cause = cycle.soft  # why it cannot be armed now, not what once was
    silent = at.cycles >= settings.supervisor.stop or state.another_session == 1
    result.stop = 1 if (now == _FAULT and not silent) or at.stop > 0 else 0
    result.silent = 1 if now == _FAULT and silent else 0
    result.elastic, result.soft, result.hard = cycle.elastic, cycle.soft, cycle.hard
