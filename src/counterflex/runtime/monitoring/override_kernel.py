"""Speed of the robot program as a second actuator: slower where the correction cannot follow or the force is too large.

What is asked for is the least of

- *plan*: the speed at which the predicted remaining error stays within the tolerance, looked up ahead of time
  (:mod:`counterflex.runtime.monitoring.override_plan`);
- *limiter*: while the correction is held back by its limits of speed and acceleration, ``1 - b (1 - least)``, b its
  share of the last cycles;
- *reach*: from 80 % of the largest correction on, linearly down to the least speed at 100 %;
- *force*: from 85 % of the overload threshold on, likewise.

It changes by no more than a stated rate, and never goes below the least speed: a feed per tooth that rubs instead of
cutting is worse than an error of path.
"""

from __future__ import annotations

from typing import Final

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.core.records import Record, Records
from counterflex.runtime.monitoring.events import Event, Slowed
from counterflex.runtime.monitoring.records import MONITOR_TYPES
from counterflex.runtime.primitives.frames import size_of
from counterflex.runtime.state.supervisor import State
from counterflex.signals.limiter import AT_SPEED

NEAR_REACH: Final = 0.8
NEAR_FORCE: Final = 0.85
_BUSY: Final = 0.05  # share of a cycle in the memory of the limiter: 80 ms at 4 ms
_ACTIVE, _HOLD = int(State.ACTIVE), int(State.HOLD)
_PLAN, _LIMITER = int(Slowed.PLAN), int(Slowed.LIMITER)
_OVERLOAD = int(Event.OVERLOAD)
_REACH, _FORCE = int(Slowed.REACH), int(Slowed.FORCE)


@kernel("float64(float64, float64, float64)")
def falling(value: float, near: float, least: float) -> float:
    """1 up to ``near``, from there linearly down to ``least`` at 1 and beyond."""
    return max(least, 1.0 - (1.0 - least) * min(1.0, max(0.0, (value - near) / (1.0 - near))))


@kernel("void(Result, float64[::1], PlanRow[::1], Settings[::1], Memory[::1])", entry=True, **MONITOR_TYPES)
def ask_speed(result: Record, place: Float, plan: Records, settings: Records, memories: Records) -> None:
    """One cycle.

    Args:
        result: RESULT of the step.
        place: (2,) on the plan.
        plan: (n,) PLAN_ROW.
        settings: (1,) SETTINGS.
        memories: (1,) MEMORY, force and limits of this cycle in it; speed asked for and its reason are written.
    """
    s, m = settings[0], memories[0]
    least = s.least_speed
    now = result.state
    speed_limited = now == _ACTIVE and result.limits & AT_SPEED
    m.busy += _BUSY * ((1.0 if speed_limited else 0.0) - m.busy)
    requested, why = 1.0, 0
    if now in (_ACTIVE, _HOLD) and least < 1.0:
        if s.planned == 1 and place[0] >= 0.0:
            row, u = int(place[0]), place[1]
            speed = (1.0 - u) * plan[row].speed + u * plan[min(row + 1, plan.shape[0] - 1)].speed
            if speed < requested:
                requested, why = max(least, speed), _PLAN
        busy = 1.0 - max(0.0, m.busy - 0.5) * 2.0 * (1.0 - least)
        if busy < requested:
            requested, why = busy, _LIMITER
        reach = falling(size_of(result.wanted[:], 0) / s.largest_correction, NEAR_REACH, least)
        if reach < requested:
            requested, why = reach, _REACH
        limit = m.results.limit[_OVERLOAD]
        if limit > 0.0:
            force = falling(m.results.value[_OVERLOAD] / limit, NEAR_FORCE, least)
            if force < requested:
                requested, why = force, _FORCE
    change = min(s.speed_step, max(-s.speed_step, requested - m.speed))
    m.speed += change
    m.results.speed = m.speed
    m.outcome.slowed = why
