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

from counterflex.core.arrays import Float, Int
from counterflex.core.jit import kernel
from counterflex.runtime.monitoring import layout as ml
from counterflex.runtime.primitives.frames import size_of
from counterflex.runtime.state import layout as at
from counterflex.runtime.state.supervisor import State
from counterflex.signals.limiter import AT_SPEED

NEAR_REACH: Final = 0.8
NEAR_FORCE: Final = 0.85
_BUSY: Final = 0.05  # share of a cycle in the memory of the limiter: 80 ms at 4 ms
_ACTIVE, _HOLD = int(State.ACTIVE), int(State.HOLD)
_PLAN, _LIMITER = int(ml.Slowed.PLAN), int(ml.Slowed.LIMITER)
_REACH, _FORCE = int(ml.Slowed.REACH), int(ml.Slowed.FORCE)

# Constants.
K_LEAST: Final = 0  # share of the programmed speed; 1 leaves it alone
K_STEP: Final = 1  # largest change per cycle
K_RADIUS: Final = 2  # largest correction, m
OVERRIDE_CONSTANTS: Final = 3
# State.
V_SPEED: Final = 0
V_BUSY: Final = 1
OVERRIDE_STATE: Final = 2


@kernel("float64(float64, float64, float64)")
def falling(value: float, near: float, least: float) -> float:
    """1 up to ``near``, from there linearly down to ``least`` at 1 and beyond."""
    return max(least, 1.0 - (1.0 - least) * min(1.0, max(0.0, (value - near) / (1.0 - near))))


@kernel(
    "void(float64[::1], int64[::1], float64[:, ::1], float64[::1], int64, float64[::1], float64[::1], float64[::1],"
    " int64[::1])"
)
def ask_speed(
    step_results: Float,
    step_outcome: Int,
    plan: Float,
    place: Float,
    planned: int,
    constants: Float,
    state: Float,
    results: Float,
    outcome: Int,
) -> None:
    """One cycle.

    Args:
        step_results: (at.RESULTS,) of the step.
        step_outcome: (at.OUTCOME,) likewise.
        plan: (n, P_COLUMNS) of the monitor.
        place: (2,) on it.
        planned: 1: there is a plan.
        constants: (OVERRIDE_CONSTANTS,).
        state: (OVERRIDE_STATE,); changed.
        results: (RESULTS,) of the monitor; R_SPEED is written.
        outcome: (OUTCOME,) of the monitor; O_SLOWED is written.
    """
    least = constants[K_LEAST]
    now = step_outcome[at.O_STATE]
    held_back = now == _ACTIVE and step_outcome[at.O_LIMITS] & AT_SPEED
    state[V_BUSY] += _BUSY * ((1.0 if held_back else 0.0) - state[V_BUSY])
    wanted, why = 1.0, 0
    if now in (_ACTIVE, _HOLD) and least < 1.0:
        if planned == 1 and place[0] >= 0.0:
            row, u = int(place[0]), place[1]
            speed = (1.0 - u) * plan[row, ml.P_SPEED] + u * plan[min(row + 1, plan.shape[0] - 1), ml.P_SPEED]
            if speed < wanted:
                wanted, why = max(least, speed), _PLAN
        busy = 1.0 - max(0.0, state[V_BUSY] - 0.5) * 2.0 * (1.0 - least)
        if busy < wanted:
            wanted, why = busy, _LIMITER
        reach = falling(size_of(step_results, at.R_WANTED) / constants[K_RADIUS], NEAR_REACH, least)
        if reach < wanted:
            wanted, why = reach, _REACH
        limit = results[ml.R_LIMIT + 1]
        if limit > 0.0:
            force = falling(results[ml.R_VALUE + 1] / limit, NEAR_FORCE, least)
            if force < wanted:
                wanted, why = force, _FORCE
    change = min(constants[K_STEP], max(-constants[K_STEP], wanted - state[V_SPEED]))
    state[V_SPEED] += change
    results[ml.R_SPEED] = state[V_SPEED]
    outcome[ml.O_SLOWED] = why
