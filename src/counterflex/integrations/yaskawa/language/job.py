"""INFORM jobs of a cell: what a job is held against, what is written for one, and what must be set."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from counterflex.app.compensation.languages import WritingOrder, Written, robot_text, writer_settings
from counterflex.app.compensation.next_steps import against_fixed_tool, tool_frames
from counterflex.app.compensation.robot_program import tool_data
from counterflex.app.conversion import emitter_settings
from counterflex.app.robot_axes import axes_in, part_in_world
from counterflex.app.robot_programs import numbered_facts, refuse_held_part
from counterflex.core.arrays import Float
from counterflex.files.cell.cell import Cell
from counterflex.integrations.yaskawa.language.emitter import InformEmitter
from counterflex.integrations.yaskawa.language.frames import InformCell
from counterflex.integrations.yaskawa.language.program import DIALECT, values_of
from counterflex.integrations.yaskawa.language.spelling import rconf
from counterflex.integrations.yaskawa.language.writer import InformSettings, InformWriter
from counterflex.programs.convert.emitter import Conversion
from counterflex.programs.program import Program
from counterflex.report.data import Fact
from counterflex.robot.kinematics.inverse import inverse
from counterflex.robot.kinematics.inverse_seeds import branch_of


def cell_of(cell: Cell) -> InformCell:
    """What a job is held against; a cell whose robot holds the part is refused."""
    own = cell.tables.robot.controller_axes
    pulses = () if own is None or own.pulses_per_deg is None else own.pulses_per_deg
    return InformCell(**numbered_facts(cell, DIALECT, "INFORM"), pulses_per_deg=pulses)


def configurations(cell: Cell, start: str | Float) -> Callable[[Float], str]:
    """Return RCONF of tool poses (4, 4) m in the part frame that follow each other.

    Args:
        cell: The cell.
        start: Posture of the first one, such as ``front up noflip``, or (6,) rad, angles of the model near it.

    Raises:
        InputError: Nothing says how the controller counts the axes of this robot.
    """
    axes, _ = axes_in(cell, DIALECT)
    chain, near = cell.controller_chain, [start]

    def configuration(T_part_tcp: Float) -> str:
        q = inverse(chain, cell.T_base_part @ T_part_tcp, near[0], sigma_floor=0.0).q
        near[0] = q
        return rconf(branch_of(chain, q), np.asarray(axes.shown(q)).tolist())

    return configuration


def _settings(program: Program, cell: Cell, common: dict[str, Any], start: str | Float) -> InformSettings:
    refuse_held_part(cell, "INFORM")
    return InformSettings(
        **common,
        configuration=configurations(cell, start),
        T_world_part=part_in_world(cell, DIALECT),
        T_flange_tcp=cell.controller_chain.T_flange_tcp,
        tool=cell.tables.controller.tool_number,
        base=cell.tables.controller.base_number,
        tool_data={tool: int(value) for tool, value in tool_data(program, cell, DIALECT).items()},
    )


def write(order: WritingOrder) -> Written:
    """Write a program of another language as a job."""
    refuse_held_part(order.cell, "INFORM")
    common = writer_settings(order, DIALECT, moving=False)
    settings = _settings(order.job.program, order.cell, common, np.asarray(order.plan.q[0]))
    return robot_text(order, InformWriter, settings, DIALECT)


def convert(order: Conversion) -> InformEmitter:
    """Return the writer of a conversion."""
    start = order.cell.tables.posture.branch
    settings = _settings(order.program, order.cell, emitter_settings(order), start)
    settings.check()
    return InformEmitter(order.program, settings, order.cell.machine_functions(DIALECT), order.tolerance_m)


def load(files: str, cell: Cell, tools: Sequence[int]) -> tuple[Fact, ...]:
    """Files, user frame and tool file that a job needs."""
    if cell.holds_part:
        return against_fixed_tool(files, cell)
    part, tip = (_shown(T) for T in (part_in_world(cell, DIALECT), cell.controller_chain.T_flange_tcp))
    controller = cell.tables.controller
    return (
        Fact("Load", files, "", "as jobs (JBI), all of them"),
        Fact(f"UF#({controller.base_number})", part, "mm, deg", "X Y Z Rx Ry Rz, the part frame that was planned with"),
        *tool_frames(cell, DIALECT, tools, frame=tip, other=f"TOOL {controller.tool_number}", form="TOOL {}"),
    )


def _shown(T: Float) -> str:
    return ", ".join(f"{value:.{3 if k < 3 else 4}f}" for k, value in enumerate(values_of(T)))
