"""The online step: one cycle from what robot, force sensor and tracker say to a correction within its limits. Pure.

Order, fixed: counters, place on the plan, force, deflection, tracker, correction wanted, causes, supervisor, limits,
finite check. Everything in the part frame, SI. The same inputs give the same outputs bit for bit.
"""

from __future__ import annotations

from typing import Any

from counterflex.core.jit import kernel
from counterflex.core.records import Record, Records
from counterflex.robot.elasticity.kernels.records import Elastic
from counterflex.robot.elasticity.kernels.step import REFUSED, deflect
from counterflex.runtime.primitives.frames import across, turn, turn_back
from counterflex.runtime.primitives.hand import TO_HAND, TO_TOOL, turned_load, turned_motion
from counterflex.runtime.primitives.loop_types import LOOP_TYPES
from counterflex.runtime.state.supervisor import Cause
from counterflex.runtime.step.axis_pid_kernel import PID, PID_STATE, control_axes
from counterflex.runtime.step.deviation import find_deviation
from counterflex.runtime.step.limit import as_axes, limit, remember, report
from counterflex.runtime.step.load import FILTER, find_load
from counterflex.runtime.step.place import begin, localize
from counterflex.runtime.step.request import check_reach, request_correction
from counterflex.runtime.step.supervise import supervise_cycle

_NOT_FINITE, _SINGULAR = int(Cause.NOT_FINITE), int(Cause.SINGULAR)


@kernel("void(Given, Settings, Plan[::1], Cycle, Result, Elastic)", **LOOP_TYPES)
def find_deflection(
    given: Record, settings: Record, plan: Records, cycle: Record, result: Record, elastic: Elastic
) -> None:
    """Deflection under the wrench that is corrected, part axes.

    ``elastic``: chain and arrays of the elastic step; changed.
    """
    bending = elastic.results[0]
    load, bent, R = cycle.load[:], result.deflection[:], cycle.R_base_part[:]
    for k in range(6):
        load[k] = given.q[k]
        load[6 + k] = cycle.used[k]
        bent[k] = 0.0
    if cycle.hard != _NOT_FINITE:
        turned_load(settings, given.nominal[:], load, 6, TO_HAND)
        turn(R, 0, load, 6)
        turn(R, 0, load, 9)
        cycle.elastic = deflect(elastic, load, 0)
        for k in range(6):
            bent[k] = bending.deflection[k]
        turn_back(R, 0, bent, 0)
        turn_back(R, 0, bent, 3)
        turned_motion(settings, given.nominal[:], bent, TO_TOOL)
    if cycle.elastic & REFUSED and cycle.soft == 0:
        cycle.soft = _SINGULAR
    if settings.normal_only == 1 and cycle.planned == 1:
        across(bent, 0, plan, cycle.row)
    result.sigma = bending.sigma


@kernel(
    f"void(Given, Settings, State, Past[::1], Plan[::1], Cycle, Result, Elastic, {FILTER}, {FILTER}, "
    "Pid[::1], Kept[::1])",
    Pid=PID,
    Kept=PID_STATE,
    **LOOP_TYPES,
)
def step(
    given: Record,
    settings: Record,
    state: Record,
    ring: Records,
    plan: Records,
    cycle: Record,
    result: Record,
    elastic: Elastic,
    measured: Any,
    predicted: Any,
    pids: Records,
    pid_states: Records,
) -> None:
    """One cycle; see the module and :class:`counterflex.runtime.loop.Loop`, which owns the records.

    Args:
        given: Inputs of the cycle.
        state: What the step remembers; changed.
        ring: Past cycles; changed.
        plan: (n,) PLAN, or two rows that mean nothing without a plan.
        cycle: What the stages hand to each other; written.
        result: Written.
        elastic: Chain and arrays of the elastic step; changed.
        measured: Filter of the measured force, :data:`counterflex.runtime.step.load.FILTER`; changed.
        predicted: Likewise of the predicted force.
        pids: Constants of the controllers of the axes, or none.
        pid_states: What they remember; changed.
    """
    bending, work = elastic.results[0], elastic.works[0]
    begin(given, settings, state, cycle)
    localize(given, settings, state, plan, cycle)
    find_load(given, settings, state, ring, plan, work, cycle, result, measured, predicted)
    find_deflection(given, settings, plan, cycle, result, elastic)
    find_deviation(given, settings, state, ring, plan, bending.compliance[:], cycle, result)
    request_correction(settings, state, plan, cycle, result)
    check_reach(settings, result.wanted[:], cycle)
    control_axes(given, settings, state, ring, plan, work, cycle, result, pids, pid_states)
    share = supervise_cycle(given, settings, state, ring, cycle, result)
    result.limits = limit(share, settings, state, cycle, result)
    remember(settings, state, ring, cycle)
    as_axes(given, settings, state, work, cycle, result)
    report(settings, state, cycle, result)
