"""First stages of the online step: what the inputs are worth, and where on the plan the robot is. Pure."""

from __future__ import annotations

from typing import Final

from counterflex.core.jit import kernel
from counterflex.core.records import Record, Records
from counterflex.runtime.primitives.causes import next_cause
from counterflex.runtime.primitives.finite import is_finite
from counterflex.runtime.primitives.hand import part_axes
from counterflex.runtime.primitives.localize import contained_at, follow, seek, wrench_at
from counterflex.runtime.primitives.loop_types import LOOP_TYPES
from counterflex.runtime.state.supervisor import Cause, State

FAULT_LOST: Final = 10
"""Telegrams lost in a row that are a fault."""
MOST_ELAPSED: Final = 4
"""Cycles that are made up for at most after telegrams were lost."""
_READY, _ACTIVE, _HOLD = int(State.READY), int(State.ACTIVE), int(State.HOLD)
_LATE, _STOPPED = int(Cause.TELEGRAMS_LATE), int(Cause.TELEGRAMS_STOPPED)
_SESSION = int(Cause.SESSION_RESTARTED)
_NOT_FINITE, _OFF_PATH = int(Cause.NOT_FINITE), int(Cause.OFF_PATH)


@kernel("void(Given, Settings, State, Cycle)", **LOOP_TYPES)
def begin(given: Record, settings: Record, state: Record, cycle: Record) -> None:
    """Count, and take over the causes that were found before the step.

    Args:
        given: Inputs of the cycle.
        state: Of the step; changed.
        cycle: Begun.
    """
    lost = given.elapsed - 1 if given.elapsed > 0 else state.telegrams_lost + 1
    state.telegrams_lost = 0 if given.elapsed > 0 else lost
    state.cycles += 1
    state.clock += given.elapsed
    cycle.elapsed = min(max(given.elapsed, 0), MOST_ELAPSED)
    cycle.soft, cycle.hard = given.soft, given.hard
    # The longer loss first: behind the hold it would never be reached.
    if lost >= FAULT_LOST and cycle.hard == 0:
        cycle.hard = _STOPPED
    elif lost >= settings.lost:
        cycle.soft = next_cause(settings, cycle.soft, _LATE)
    if cycle.hard == 0 and not is_finite(given):
        cycle.hard = _NOT_FINITE
    cycle.active = 1 if state.supervisor.state == _ACTIVE else 0
    cycle.held = 1 if state.supervisor.state == _HOLD else 0
    cycle.planned = 1 if settings.has_plan == 1 and cycle.hard != _NOT_FINITE else 0
    cycle.sources = cycle.degraded = cycle.elastic = cycle.row = 0
    cycle.path_distance, cycle.cut, cycle.forward_share = 0.0, 0.0, 1.0
    part_axes(settings, given.nominal[:], cycle.R_base_part[:])
    for k in range(6):
        cycle.predicted[k] = cycle.ahead[k] = cycle.behind[k] = cycle.late[k] = 0.0
        cycle.used[k] = cycle.contained[k] = cycle.deviation[k] = 0.0


@kernel("void(Given, Settings, State, Plan[::1], Cycle)", **LOOP_TYPES)
def localize(given: Record, settings: Record, state: Record, plan: Records, cycle: Record) -> None:
    """Find the place on the plan, and read there what it expects.

    ``state``: of the step; its place is changed. ``cycle``: predicted forces, contained correction, row and distance
    are written.
    """
    if cycle.planned == 0:
        return
    place, p = state.place[:], given.nominal[9:]
    if given.hard == _SESSION:
        state.sweep[0] = 0.0  # what was nearest to the place of another session is no candidate
    if state.supervisor.state <= _READY and place[0] >= 0.0 and state.clock > 0.0:
        seek(plan, place, state.sweep[:], p[0], p[1], p[2])
    cycle.path_distance = follow(plan, place, p[0], p[1], p[2], settings.window)
    cycle.row = int(place[0])
    # The plan's time runs slower where less speed is asked for, and its forces are smaller.
    speed = state.speed
    predicted, ahead, behind, preview = cycle.predicted[:], cycle.ahead[:], cycle.behind[:], state.preview[:]
    cycle.cut = wrench_at(plan, place, 0.0, False, predicted)
    wrench_at(plan, place, speed * (settings.lead - settings.follow), settings.reads_ahead == 1, ahead)
    wrench_at(plan, place, -speed * settings.follow, False, behind)
    wrench_at(plan, place, speed * settings.preview, False, preview)
    for k in range(6):
        # Force by feed per tooth to a power below 1 (the monitor's exponent): at half speed more than half is left.
        preview[k] *= state.force_at_speed
        predicted[k] *= state.force_at_speed
        ahead[k] *= state.force_at_speed
        behind[k] *= state.force_at_speed
    contained_at(plan, place, cycle.contained[:])
    if cycle.path_distance > settings.off_path:
        cycle.soft = next_cause(settings, cycle.soft, _OFF_PATH)
