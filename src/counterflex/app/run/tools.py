"""Tools of a plan with several: what the loop takes from the cell file at each change."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import MM
from counterflex.files.cell.cell import Cell
from counterflex.geometry import pose
from counterflex.plan.plan import Plan
from counterflex.protocols.session.senses import ProcessWrench
from counterflex.protocols.session.tool_change import ToolChange
from counterflex.runtime.sensing.pair_wrench import PairWrench
from counterflex.runtime.sensing.strain_wrench import StrainWrench
from counterflex.sensing.carrier import carrier_to_tcp
from counterflex.sensing.flange_sensor import FlangeSensor


def tool_tips(cell: Cell, sensor: FlangeSensor) -> dict[int, Float]:
    """Tip (3,) m of each tool in the frame of what measures the force: that of the cell, ``longer_mm`` further out.

    Args:
        cell: Its ``[[tools]]``.
        sensor: Flange sensor, or what hangs behind the holder.
    """
    T = pose.inverse(sensor.T_seg_sensor) @ carrier_to_tcp(cell.chain, sensor.segment)
    return {tool.number: T[:3, 3] + tool.longer_mm * MM * T[:3, 2] for tool in cell.tables.tools}


def tool_loads(cell: Cell, sensor: FlangeSensor) -> Mapping[int, tuple[float, Float]]:
    """Mass and centre of gravity (3,) m behind the sensor with each tool: ``heavier_kg`` more, at its tip.

    Args:
        cell: Its ``[[tools]]``.
        sensor: Load that was identified, with the usual tool.
    """
    tips = tool_tips(cell, sensor)
    loads = {}
    for tool in cell.tables.tools:
        mass = sensor.mass_kg + tool.heavier_kg
        moment = sensor.mass_kg * sensor.p_sensor_com + tool.heavier_kg * tips[tool.number]
        loads[tool.number] = (mass, moment / mass if mass > 0.0 else np.zeros(3))
    return loads


def tools_of(
    plan: Plan | None, cell: Cell, sensor: FlangeSensor | None, wrench: ProcessWrench | None
) -> ToolChange | None:
    """Return the follower of the tools of a plan that cuts with several; None where one cuts all.

    Args:
        plan: Of the program, or None.
        cell: Its ``[[tools]]``.
        sensor: What measures the force, or None.
        wrench: What makes a process wrench of it, or None.
    """
    if plan is None or len(np.unique(plan.path.tool[plan.cutting])) < 2:
        return None
    return ToolChange(plan.path.tool.astype(np.int64), plan.cutting, user(cell, sensor, wrench))


def user(cell: Cell, sensor: FlangeSensor | None, wrench: ProcessWrench | None) -> Callable[[int], None]:
    """User of the constants of a tool by its number: weight, and with the holder its matrix and lever."""
    loads = {} if sensor is None else tool_loads(cell, sensor)

    def use(number: int) -> None:
        if wrench is None or isinstance(wrench, PairWrench) or number not in loads:
            return
        wrench.carry(*loads[number])
        if isinstance(wrench, StrainWrench):
            wrench.use(number)

    return use
