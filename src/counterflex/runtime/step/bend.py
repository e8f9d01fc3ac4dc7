"""Third stage of the online step: the deflection under the wrench that is corrected. Pure."""

from __future__ import annotations

from counterflex.core.jit import kernel
from counterflex.core.records import Record, Records
from counterflex.robot.elasticity.kernels.records import ELASTIC, Elastic
from counterflex.robot.elasticity.kernels.step import REFUSED, deflect
from counterflex.runtime.primitives.frames import across, turn, turn_back
from counterflex.runtime.primitives.hand import TO_HAND, TO_TOOL, turned_load, turned_motion
from counterflex.runtime.state.chosen import SETTINGS
from counterflex.runtime.state.cycle import CYCLE
from counterflex.runtime.state.given import GIVEN
from counterflex.runtime.state.planned import PLAN
from counterflex.runtime.state.result import RESULT
from counterflex.runtime.state.supervisor import Cause

_NOT_FINITE, _SINGULAR = int(Cause.NOT_FINITE), int(Cause.SINGULAR)


@kernel(
    "void(Given, Settings, Plan[::1], Cycle, Result, Elastic)",
    Given=GIVEN,
    Settings=SETTINGS,
    Cycle=CYCLE,
    Result=RESULT,
    Elastic=ELASTIC,
    Plan=PLAN,
)
def find_deflection(
    given: Record, settings: Record, plan: Records, cycle: Record, result: Record, elastic: Elastic
) -> None:
    """Deflection under the wrench that is corrected, part axes.

    Args:
        given: Inputs of the cycle.
        settings: Of the loop.
        plan: (n,) PLAN.
        cycle: With the wrench; status of the elastic step is written.
        result: Deflection and smallest singular value are written.
        elastic: Chain and arrays of the elastic step; changed.
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
