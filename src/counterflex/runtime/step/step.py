"""The online step: one cycle from what robot, force sensor and tracker say to a correction within its limits. Pure.

Order, fixed: counters, place on the plan, force, deflection, tracker, correction wanted, causes, supervisor, limits,
finite check. Everything in the part frame, SI. The same inputs give the same outputs bit for bit.
"""

from __future__ import annotations

from typing import Any

from counterflex.core.jit import kernel
from counterflex.core.records import Record, Records
from counterflex.robot.elasticity.kernels.records import ELASTIC, Elastic
from counterflex.runtime.state.chosen import SETTINGS
from counterflex.runtime.state.cycle import CYCLE
from counterflex.runtime.state.given import GIVEN
from counterflex.runtime.state.memory import PAST, STATE
from counterflex.runtime.state.planned import PLAN
from counterflex.runtime.state.result import RESULT
from counterflex.runtime.step.axis_pid_kernel import PID, PID_STATE, control_axes
from counterflex.runtime.step.bend import find_deflection
from counterflex.runtime.step.deviation import find_deviation
from counterflex.runtime.step.limit import as_axes, limit, remember, report
from counterflex.runtime.step.load import FILTER, find_load
from counterflex.runtime.step.place import begin, localize
from counterflex.runtime.step.request import check_reach, request_correction
from counterflex.runtime.step.supervise import supervise_cycle


@kernel(
    f"void(Given, Settings, State, Past[::1], Plan[::1], Cycle, Result, Elastic, {FILTER}, {FILTER}, "
    "Pid[::1], Kept[::1])",
    Given=GIVEN,
    Settings=SETTINGS,
    State=STATE,
    Past=PAST,
    Cycle=CYCLE,
    Result=RESULT,
    Elastic=ELASTIC,
    Plan=PLAN,
    Pid=PID,
    Kept=PID_STATE,
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
        settings: Of the loop.
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
    remember(given, settings, state, ring, cycle, result)
    as_axes(given, settings, state, work, cycle, result)
    report(settings, state, cycle, result)
