"""Program, feed and force held against the plan in the cut, from the first contact on. Pure kernel.

A plan of another depth, another feed or another material computes forces that do not come. What lasts is judged, by
means over the time in which drives and arm settle: corners and the entry into the cut are shorter.

- *place*: distance of the commanded point from the planned path. Half the limit is told, the limit holds;
- *feed*: speed along the path by the planned one. A lower one is told, as corners and the operator lower it; a higher
  one holds;
- *force*: measured by predicted force. Told: the correction follows the measured one, or the process monitor reacts.
"""

from __future__ import annotations

from typing import Final

from counterflex.core.jit import kernel
from counterflex.core.records import Record
from counterflex.runtime.primitives.loop_types import LOOP_TYPES
from counterflex.runtime.state.states import Cause, State

DOUBT_PLACE: Final = 65536
"""The program lasts off the planned path in the cut."""
DOUBT_FEED: Final = 131072
"""It runs at another feed than planned."""
DOUBT_FORCE: Final = 262144
"""The measured force lasts off the predicted one by more than a stated share."""
REPORTED_SHARE: Final = 0.5
"""Share of the limit of the place from which on it is told."""
_ARMED: Final = int(State.ARMED)
_FAULT: Final = int(State.FAULT)
_OFF_PATH, _FEED = int(Cause.OFF_PATH), int(Cause.FEED_DIFFERS)
_FORCE: Final = int(Cause.FORCE_OFF_PLAN)


@kernel("void(State, Result, float64, float64, Limits, Memory)", **LOOP_TYPES)
def hold_against_plan(state: Record, result: Record, feed: float, ratio: float, limits: Record, memory: Record) -> None:
    """Find what differs from the plan; its doubt and what is degraded go into the result, a hold into the next cycle.

    ``result``: of the step and the tests; written. ``feed``: speed along the path by the one that is asked for.
    ``ratio``: measured by predicted force; 0 where that is too small to be judged.
    """
    acts = _ARMED < state.supervisor.state < _FAULT
    if not acts:
        memory.plan_soft = 0
    elif memory.soft == 0:
        memory.soft = memory.plan_soft  # it does not go away because the robot stands: stop, do not limp
    if not acts or result.cut <= 0.0 or memory.still > 0:
        memory.plan_cycles = 0
        return
    gain = 1.0 if memory.plan_cycles == 0 else limits.settle_gain
    memory.plan_place += gain * (result.path_distance - memory.plan_place)
    memory.plan_feed += gain * (feed - memory.plan_feed)
    memory.plan_force += gain * ((ratio if ratio > 0.0 else 1.0) - memory.plan_force)
    memory.plan_cycles = min(memory.plan_cycles + 1, limits.settle_cycles)
    if memory.plan_cycles < limits.settle_cycles:
        return
    soft = cause = 0
    if memory.plan_place > REPORTED_SHARE * limits.plan_m:
        result.doubt |= DOUBT_PLACE
        cause = _OFF_PATH
        soft = _OFF_PATH if memory.plan_place > limits.plan_m else 0
    elif abs(memory.plan_feed - 1.0) > limits.plan_feed:
        result.doubt |= DOUBT_FEED
        cause = _FEED
        soft = _FEED if memory.plan_feed > 1.0 else 0
    elif abs(memory.plan_force - 1.0) > limits.plan_force:
        result.doubt |= DOUBT_FORCE
        cause = _FORCE
    # A place that is only told must not hide a feed that holds: both differ where the controller runs another program.
    if soft == 0 and memory.plan_feed - 1.0 > limits.plan_feed:
        result.doubt |= DOUBT_FEED
        soft = _FEED
    if cause != 0 and result.degraded == 0:
        result.degraded = cause
    if soft != 0 and memory.soft == 0:
        memory.soft = memory.plan_soft = soft
