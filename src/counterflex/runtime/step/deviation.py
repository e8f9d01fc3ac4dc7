"""Fourth stage of the online step: what a tracker's sample says, by the mode of force and tracker. Pure."""

from __future__ import annotations

import math

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.core.records import Record, Records
from counterflex.runtime.estimator.deflection import answered, estimate_deviation
from counterflex.runtime.primitives.frames import across, pose_deviation, size_of
from counterflex.runtime.primitives.history import row_at, row_back
from counterflex.runtime.primitives.loop_types import LOOP_TYPES
from counterflex.runtime.state.supervisor import Cause
from counterflex.runtime.step.feed_forward import known_ahead
from counterflex.runtime.step.load import FUSED
from counterflex.runtime.step.tracker import compare, designed, observe, sum_up

INTEGRATOR, OBSERVER, DESIGNED = 1, 2, 3
"""TrackerMode."""
_TRACKER_LOST, _NOT_FINITE = int(Cause.TRACKER_LOST), int(Cause.NOT_FINITE)


@kernel("void(Given, Settings, Plan[::1], float64[::1], Cycle)", **LOOP_TYPES)
def _deviate(given: Record, settings: Record, plan: Records, nominal: Float, cycle: Record) -> None:
    """Deviation of the measured pose from the commanded one that it belongs to."""
    pose_deviation(given.actual[:], 0, nominal, cycle.contained[:], cycle.deviation[:])
    if settings.normal_only == 1 and cycle.planned == 1:
        across(cycle.deviation[:], 0, plan, cycle.row)


@kernel("void(Given, Settings, State, Past[::1], Plan[::1], Cycle)", **LOOP_TYPES)
def _designed_stage(
    given: Record, settings: Record, state: Record, ring: Records, plan: Records, cycle: Record
) -> None:
    """Designed controller: what is known ahead, then the sample by the pose of its own time."""
    here = state.ring_row
    ring[here].clock = state.clock
    for k in range(6):
        cycle.zero[k] = 0.0
    planned = cycle.planned == 1 and cycle.soft == 0
    cycle.forward_share = known_ahead(
        plan, ring, given.nominal[:], settings, planned, state, cycle.rows[:], cycle.zero[:]
    )
    if given.tracker_new != 1:
        return
    late = given.tracker_late if given.tracker_late >= 0.0 else settings.tracker_late
    if not row_at(ring, here, state.clock - late / settings.period, state.past):
        return
    _deviate(given, settings, plan, state.past.nominal[:], cycle)
    if size_of(cycle.deviation[:], 0) <= settings.largest_jump or cycle.active == 0:
        designed(cycle.deviation[:], cycle.active == 1 and cycle.forward_share == 1.0, settings, state)
    elif cycle.soft == 0:
        cycle.soft = _TRACKER_LOST


@kernel("void(Given, Settings, State, Past[::1], Plan[::1], Cycle)", **LOOP_TYPES)
def _delayed_stage(given: Record, settings: Record, state: Record, ring: Records, plan: Records, cycle: Record) -> None:
    """Published integrator and observer: the sample by the pose that belongs to it by the delays of the cell."""
    here = state.ring_row
    _deviate(given, settings, plan, ring[row_back(here, settings.nominal_back)].nominal[:], cycle)
    if settings.tracker == INTEGRATOR:
        if cycle.active == 1:
            sum_up(cycle.deviation[:], settings.gain, settings.saturation[:], state)
        return
    then = ring[row_back(here, settings.deflection_back)]
    largest = settings.largest_jump if cycle.active == 1 else math.inf
    only_across = settings.normal_only == 1 and cycle.planned == 1
    if only_across:  # what was across the feed of another moment may lie along it now: not seen, not corrected
        across(state.offset[:], 0, plan, cycle.row)
    compare(cycle, then.deflection[:], state)
    if only_across:
        across(cycle.innovation[:], 0, plan, cycle.row)
    if not observe(cycle, settings.noise[:], largest, state) and cycle.soft == 0:
        cycle.soft = _TRACKER_LOST


@kernel("void(Given, Settings, State, Past[::1], Result)", **LOOP_TYPES)
def _enter(given: Record, settings: Record, state: Record, ring: Records, result: Record) -> None:
    """Write pose and deflection of this cycle into its row: a delay of no cycle means now, not a whole ring ago."""
    now = ring[state.ring_row]
    for k in range(12):
        now.nominal[k] = given.nominal[k]
    for k in range(6):
        now.deflection[k] = result.deflection[k] if k < 3 or settings.orientation == 1 else 0.0


@kernel("void(Given, Settings, State, Past[::1], Plan[::1], float64[::1], Cycle, Result)", **LOOP_TYPES)
def find_deviation(
    given: Record,
    settings: Record,
    state: Record,
    ring: Records,
    plan: Records,
    C: Float,
    cycle: Record,
    result: Record,
) -> None:
    """Deviation that the tracker shows, and what it changes.

    ``C``: (36,) compliance of the arm at the tip, base axes.
    """
    finite, fused = cycle.hard != _NOT_FINITE, settings.force == FUSED
    if finite:
        _enter(given, settings, state, ring, result)
    if fused:
        answered(ring, state.ring_row, max(1, settings.correction_back), settings, state)
        if finite:
            estimate_deviation(given, settings, C, state, ring, cycle, result)
    if finite and settings.tracker == DESIGNED:
        _designed_stage(given, settings, state, ring, plan, cycle)
    elif finite and settings.tracker != 0 and given.tracker_new == 1:
        _delayed_stage(given, settings, state, ring, plan, cycle)
    if settings.tracker == OBSERVER:
        for part in range(2):
            state.offset_variance[part] += settings.drift[part]
    unseen = settings.tracker != 0 and settings.force == 0 and given.tracker_age >= settings.stale
    if unseen and cycle.soft == 0:
        cycle.soft = _TRACKER_LOST
    for k in range(6):
        result.deviation[k] = cycle.deviation[k]
