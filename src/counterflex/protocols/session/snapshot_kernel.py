"""Fill one snapshot from the loop's memory, in one call without allocation."""

from __future__ import annotations

from typing import Final

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.jit import kernel
from counterflex.core.records import Records
from counterflex.protocols.processes import control_array as shared
from counterflex.protocols.processes.snapshot_layout import HEAD, NUMBERS, SNAPSHOT, TEXT
from counterflex.runtime.monitoring.events import EVENTS
from counterflex.runtime.monitoring.records import MEMORY
from counterflex.runtime.state.loop_record import LOOP
from counterflex.runtime.state.states import Cause, State

NUMBER, TIME, RECEIVED, COMPUTE, TELEGRAMS, ELAPSED, PEER, TROUBLE, PANEL, OWN = range(10)
"""Places of what a cycle hands over beside the loop's memory; the last is their number."""
CAUSE, WORST, BEGAN, OVER, COUNT, LATCHED = range(6)
"""Places of the incident that is latched; the last is their number."""
PANEL_SILENT_S: Final = 1.0
"""A panel that has said nothing for so long counts as lost; it says 20 times a second that it lives."""
NO_PANEL, THERE, LOST = range(3)
"""What a snapshot says of the panel."""
_SILENT_NS: Final = round(PANEL_SILENT_S * 1e9)
_HOLD = int(State.HOLD)
_NONE, _PROGRAM = int(Cause.NONE), int(Cause.PROGRAM)
_TALLY, _TALLIES = int(min(shared.Tally)), len(shared.Tally)
_KEPT, _KEPTS = int(min(shared.Kept)), len(shared.Kept)
_MAY_ARM = int(shared.Life.MAY_ARM)
_ROBOT, _FORCE, _TRACKER = int(shared.Shown.ROBOT_NS), int(shared.Shown.FORCE_NS), int(shared.Shown.TRACKER_NS)
_FIRST = HEAD + TEXT


@kernel("int64(int64, int64)", entry=True)
def panel_state(spoken_ns: int, now_ns: int) -> int:
    """State of the panel: none has come or it has left, it lives, or it has fallen silent.

    Args:
        spoken_ns: When it last said that it lives, monotonic; 0: there is none.
        now_ns: Monotonic.
    """
    if spoken_ns == 0:
        return NO_PANEL
    return THERE if now_ns - spoken_ns <= _SILENT_NS else LOST


@kernel("void(int64, int64, boolean, int64, int64[::1])")
def latch(state: int, cause: int, reset: bool, now_ns: int, incident: Int) -> None:
    """Follow holds and faults: the first cause of the last one stays until a person acknowledges it, or another begins.

    Args:
        reset: A person acknowledges in this cycle.
        now_ns: Monotonic.
        incident: (LATCHED,) changed.
    """
    on = state >= _HOLD and cause not in (_NONE, _PROGRAM)
    going = incident[CAUSE] != _NONE and incident[OVER] == 0
    if on and not going:
        incident[CAUSE], incident[WORST], incident[BEGAN], incident[OVER] = cause, state, now_ns, 0
        incident[COUNT] += 1
    elif on:
        incident[WORST] = max(incident[WORST], state)
    elif going:
        incident[OVER] = now_ns
    if reset and state < _HOLD:
        incident[CAUSE] = incident[WORST] = incident[BEGAN] = incident[OVER] = 0


@kernel("float64(float64[::1], float64, float64)")
def share_of(lengths: Float, row: float, fraction: float) -> float:
    """Share of the path length at a place on the plan; -1 where the place is not known.

    Args:
        lengths: (n,) share of the length at each row, 0 .. 1; fewer than two: no plan.
        row: Of the plan; below zero unknown.
        fraction: Of the segment behind it.
    """
    if row < 0.0 or len(lengths) < 2:
        return -1.0
    at = min(int(row), len(lengths) - 2)
    within = min(max(row - at + fraction, 0.0), 1.0)
    share: float = lengths[at] + within * (lengths[at + 1] - lengths[at])
    return share


@kernel(
    "void(Loop[::1], Memory[::1], float64[::1], int64[::1], int64[::1], int64[::1], Snapshot[::1], int64[::1], int64)",
    Loop=LOOP,
    Memory=MEMORY,
    Snapshot=SNAPSHOT,
    entry=True,
)
def fill(
    loops: Records,
    monitors: Records,
    lengths: Float,
    control: Int,
    own: Int,
    incident: Int,
    slots: Records,
    numbers: Int,
    place: int,
) -> None:
    """Fill a slot; its number is put by the caller, before and after.

    Args:
        loops: (1,) LOOP as the cycle left it.
        monitors: (1,) MEMORY of process monitoring.
        lengths: See :func:`share_of`.
        control: Shared, see :mod:`counterflex.protocols.processes.control_array`.
        own: (OWN,) what the cycle hands over.
        incident: (LATCHED,) see :func:`latch`; changed.
        slots: (SLOTS,) SNAPSHOT; one is written.
        numbers: The same memory as whole numbers, from its head on.
    """
    loop, monitor, slot = loops[0], monitors[0], slots[place]
    given, result, state = loop.given, loop.result, loop.state
    for k in range(12):
        slot.nominal[k] = given.nominal[k]
    for k in range(6):
        slot.q[k] = given.q[k]
        slot.correction[k] = result.correction[k]
        slot.in_effect[k] = state.in_effect[k]
        slot.contained[k] = loop.cycle.contained[k]
        slot.deflection[k] = result.deflection[k]
        slot.deviation[k] = result.deviation[k]
        slot.measured[k] = result.measured[k]
        slot.planned[k] = state.predicted_before[k]
    for k in range(3):
        slot.force[k] = monitor.results.force[k]
        slot.expected[k] = monitor.results.expected[k]
        slot.factor[k] = result.factor[k]
    slot.share = share_of(lengths, state.place[0], state.place[1])
    slot.speed, slot.rate = monitor.results.speed, monitor.results.rate
    slot.ratio, slot.cut, slot.rise = monitor.results.ratio, monitor.results.cut, monitor.results.rise
    for k in range(EVENTS):
        slot.value[k] = monitor.results.value[k]
        slot.limit[k] = monitor.results.limit[k]
    slot.time_ns, slot.received_ns, slot.compute_ns = own[TIME], own[RECEIVED], own[COMPUTE]
    slot.cycle, slot.telegrams, slot.elapsed = state.cycles, own[TELEGRAMS], own[ELAPSED]
    slot.state, slot.cause, slot.soft, slot.hard = result.state, result.cause, result.soft, result.hard
    slot.feed_hold, slot.stop, slot.silent = result.feed_hold, result.stop, result.silent
    slot.limits, slot.sources, slot.degraded = result.limits, result.sources, result.degraded
    slot.doubt, slot.rejected = result.doubt, result.rejected
    slot.cuts = 1 if result.cut > 0.5 else 0
    slot.events, slot.slowed = monitor.outcome.on, monitor.outcome.slowed
    slot.enable, slot.tool = given.enable, monitor.tool
    slot.robot_ns, slot.force_ns, slot.tracker_ns = control[_ROBOT], control[_FORCE], control[_TRACKER]
    slot.peer, slot.trouble, slot.panel = own[PEER], own[TROUBLE], own[PANEL]
    latch(result.state, result.cause, given.reset == 1, own[TIME], incident)
    slot.incident_cause, slot.incident_state = incident[CAUSE], incident[WORST]
    slot.incident_ns, slot.incident_end_ns, slot.incidents = incident[BEGAN], incident[OVER], incident[COUNT]
    slot.may_arm = control[_MAY_ARM]
    for k in range(_TALLIES):
        slot.tally[k] = control[_TALLY + k]
    for k in range(_KEPTS):
        slot.kept[k] = control[_KEPT + k]
    first = _FIRST + place * NUMBERS
    total = own[NUMBER]
    for k in range(1, NUMBERS - 1):
        total += (2 * k + 1) * numbers[first + k]
    slot.check = total


def lengths_of(points: Float) -> Float:
    """(n,) share of the length of a path at each of its points; none where it has no length.

    Args:
        points: (n, 3) m.
    """
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    total = float(np.sum(steps))
    if not (np.isfinite(total) and total > 0.0):
        return np.zeros(0)
    out: Float = np.concatenate([[0.0], np.cumsum(steps)]) / total
    return out
