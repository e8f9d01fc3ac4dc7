"""PID per axis of axis-specific output: the angle that each axis is corrected by comes to where it is wanted. Pure.

The correction that is wanted, as change r of the axis angles, is compared with what the controller reports to be in
effect: the measured pose less the commanded one, as change y of the same angles. With e = r - y an axis is sent
``r + Kp e + sum Ki e T + d``, d the derivative behind a low-pass (Haehn2020 section 2.2: control terms of each axis).
Where the plan is read ahead of time by the robot's answer, e is what the answer should have made of r by now, less y:
then only what the axes do otherwise than identified is corrected.

The sum stands still while the whole is at its limit, while the correction is limited or faded in, and in a hold.
"""

from __future__ import annotations

import math
from typing import Final

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.core.records import Record, Records, record
from counterflex.robot.elasticity.kernels.step import DAMPED, REFUSED, cholesky_inverse, newton_step
from counterflex.runtime.primitives.frames import across, lag, pose_deviation, turn, turn_back
from counterflex.runtime.primitives.hand import BACK, turned_motion
from counterflex.runtime.primitives.history import row_back
from counterflex.runtime.primitives.loop_types import LOOP_TYPES
from counterflex.runtime.state.supervisor import Cause, State, risen

ASKED_MOST: Final = 64
"""Cycles of dead time that can be waited for."""
PID: Final = record(
    proportional=(float, 6),
    integral=(float, 6),  # per cycle
    rate=(float, 6),  # of the derivative, by a change from one cycle to the next
    decay=(float, 6),  # of its low-pass
    most=(float, 6),  # rad
    dead=int,  # cycles until the robot begins to answer
    expected=int,  # 1: compare with what the answer should be by now
)
"""Constants of all axes."""
PID_STATE: Final = record(
    total=(float, 6),  # rad, what is summed up
    slope=(float, 6),  # memory of the derivative
    added=(float, 6),  # rad, by the controller
    wanted=(float, 6),  # rad, work space, as the next
    seen=(float, 6),
    asked=(float, 6 * ASKED_MOST),  # rad, wanted in the last cycles
    answer=(float, 24),  # memory of the robot's answer
    row=int,  # of `asked`, to be written next
)
"""What is remembered."""
_ACTIVE, _HOLD, _FAULT = int(State.ACTIVE), int(State.HOLD), int(State.FAULT)
_NOT_FINITE = int(Cause.NOT_FINITE)


@kernel("void(Given, Settings, ElasticWork, Cycle, float64[::1], float64[::1])", **LOOP_TYPES)
def to_axes(given: Record, settings: Record, work: Record, cycle: Record, motion: Float, axes: Float) -> None:
    """A small motion of the tool as change of the axis angles: one Newton step with the rigid Jacobian, undamped.

    Args:
        given: Inputs of the cycle.
        work: Of the elastic step, which left Jacobian and inverse factor there.
        cycle: With the status of the elastic step, to which CLAMPED is added.
        motion: (6,) m and rotation vector, part axes.
        axes: (6,) rad, written.
    """
    error, R = cycle.load[:], cycle.R_base_part[:]
    for k in range(6):
        error[k] = -motion[k]
    turned_motion(settings, given.nominal[:], error, BACK)
    turn(R, 0, error, 0)
    turn(R, 0, error, 3)
    if cycle.elastic & DAMPED:
        cholesky_inverse(work.jacobian[:], 0.0, work.factor[:], work.inverse[:])
    cycle.elastic |= newton_step(work.jacobian[:], work.inverse[:], error, work.half[:], axes)


@kernel("void(Settings, Pid, PidState, float64[::1])", Pid=PID, PidState=PID_STATE, **LOOP_TYPES)
def _answered(settings: Record, pid: Record, memory: Record, requested: Float) -> None:
    """Expected response of the robot to the angles wanted: dead time, then its second-order lag, in place."""
    here = memory.row
    then = (here - pid.dead + ASKED_MOST) % ASKED_MOST
    for k in range(6):
        memory.asked[6 * here + k] = requested[k]
    for k in range(6):
        requested[k] = memory.asked[6 * then + k]
    memory.row = (here + 1) % ASKED_MOST
    lag(requested, settings.answer[:], memory.answer[:], requested)


@kernel("void(Pid, PidState, boolean)", Pid=PID, PidState=PID_STATE)
def pid_step(pid: Record, memory: Record, summing: bool) -> None:
    """One sample of all axes; ``wanted`` and ``seen`` are read, ``added`` is written.

    ``summing``: whether the sum goes on.
    """
    for k in range(6):
        e = memory.wanted[k] - memory.seen[k]
        d = pid.rate[k] * e + memory.slope[k]
        memory.slope[k] = pid.decay[k] * d - pid.rate[k] * e
        step = pid.integral[k] * e if summing else 0.0
        u = pid.proportional[k] * e + memory.total[k] + step + d
        most = pid.most[k]
        if (u > most and step > 0.0) or (u < -most and step < 0.0):
            step = 0.0
        memory.total[k] += step
        memory.added[k] = min(max(u, -most), most)


@kernel(
    "void(Given, Settings, State, Past[::1], Plan[::1], ElasticWork, Cycle, Result, Pid[::1], PidState[::1])",
    Pid=PID,
    PidState=PID_STATE,
    **LOOP_TYPES,
)
def control_axes(
    given: Record,
    settings: Record,
    state: Record,
    ring: Records,
    plan: Records,
    work: Record,
    cycle: Record,
    result: Record,
    pids: Records,
    memories: Records,
) -> None:
    """Add to the wanted correction what the controllers of the axes ask for; nothing where there are none.

    ``result``: of the last cycle, with the wanted correction of this one; that is changed. ``pids``: (1,) PID, or none.
    ``memories``: (1,) PID_STATE; changed.
    """
    if pids.shape[0] == 0 or cycle.hard == _NOT_FINITE or cycle.elastic & REFUSED:
        return
    pid, memory, now = pids[0], memories[0], state.supervisor.state
    acts = now in (_ACTIVE, _HOLD, _FAULT)
    if not acts:
        for k in range(6):
            memory.total[k] = memory.slope[k] = memory.added[k] = 0.0
    share = risen(state.supervisor.risen, settings.supervisor.rise)
    requested, seen, motion = memory.wanted[:], memory.seen[:], cycle.vector[:]
    for k in range(6):
        motion[k] = share * result.wanted[k] if acts else 0.0
    to_axes(given, settings, work, cycle, motion, requested)
    if pid.expected == 1:
        _answered(settings, pid, memory, requested)
    if given.is_reported == 1 and given.elapsed > 0 and acts:
        back = settings.reported_back
        past = ring[row_back(state.ring_row, max(1, back))].nominal[:]
        nominal = given.nominal[:] if back == 0 else past
        pose_deviation(given.reported[:], 0, nominal, cycle.zero[:], motion)
        if settings.normal_only == 1 and cycle.planned == 1:
            across(motion, 0, plan, cycle.row)
        to_axes(given, settings, work, cycle, motion, seen)
        pid_step(pid, memory, now == _ACTIVE and share >= 1.0 and result.limits == 0)
    _add(memory.added[:], work.jacobian[:], cycle, result.wanted[:])


@kernel("void(float64[::1], float64[::1], Cycle, float64[::1])", **LOOP_TYPES)
def _add(axes: Float, jac: Float, cycle: Record, requested: Float) -> None:
    """Add the motion of the tool by a change of the axis angles to a correction, part axes."""
    motion, R = cycle.vector[:], cycle.R_base_part[:]
    for i in range(6):
        motion[i] = 0.0
        for j in range(6):
            motion[i] += jac[6 * i + j] * axes[j]
    turn_back(R, 0, motion, 0)
    turn_back(R, 0, motion, 3)
    for k in range(6):
        requested[k] += motion[k]
        if not math.isfinite(requested[k]) and cycle.hard == 0:
            cycle.hard = _NOT_FINITE
