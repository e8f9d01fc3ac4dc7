"""VAL3 programs of a cell: what a program is held against, what is written for one, and what must be set."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from counterflex.app.compensation.languages import WritingOrder, Written, robot_text, writer_settings
from counterflex.app.compensation.next_steps import against_fixed_tool, tool_frames
from counterflex.app.compensation.robot_program import tool_data
from counterflex.app.conversion import emitter_settings
from counterflex.app.robot_axes import part_in_world, pose_text
from counterflex.app.robot_programs import refuse_held_part, shared_facts
from counterflex.files.cell.cell import Cell
from counterflex.integrations.staubli.language.application import Val3Settings
from counterflex.integrations.staubli.language.emitter import Val3Emitter
from counterflex.integrations.staubli.language.read.motions import Val3Cell
from counterflex.integrations.staubli.language.writer import Val3Writer
from counterflex.programs.convert.emitter import Conversion
from counterflex.programs.program import Program
from counterflex.report.data import Fact
from counterflex.robot.kinematics.inverse_seeds import branch_of


def cell_of(cell: Cell) -> Val3Cell:
    """What a VAL3 program is held against.

    Raises:
        InputError: The robot holds the part: such programs are not read.
    """
    refuse_held_part(cell, "VAL3")
    tools = cell.tables.tools
    return Val3Cell(
        **shared_facts(cell, "val3"),
        tool_of_data={tool.tooldata: tool.number for tool in tools if tool.tooldata is not None},
    )


def configuration(branch: str) -> tuple[str, str, str]:
    """Shoulder, elbow and wrist of VAL3 points in a posture: by the side of the arm and the signs of J3 and J5."""
    arm, elbow, wrist = branch.split()
    bent = (elbow == "up") == (arm == "front")
    return (
        "righty" if arm == "front" else "lefty",
        "epositive" if bent else "enegative",
        "wpositive" if wrist == "noflip" else "wnegative",
    )


def _settings(program: Program, cell: Cell, common: dict[str, Any], branch: str) -> Val3Settings:
    refuse_held_part(cell, "VAL3")
    return Val3Settings(
        **common,
        configuration=configuration(branch),
        T_flange_tcp=cell.controller_chain.T_flange_tcp,
        T_world_part=part_in_world(cell, "val3"),
        blend_m=cell.tables.controller.blending_m,
        tool_data=tool_data(program, cell, "val3"),
    )


def write(order: WritingOrder) -> Written:
    """Write a program of another language as an application."""
    cell = order.cell
    refuse_held_part(cell, "VAL3")
    branch = branch_of(cell.controller_chain, order.plan.q[0])
    settings = _settings(order.job.program, cell, writer_settings(order, "val3", moving=False), branch)
    return robot_text(order, Val3Writer, settings, "val3")


def convert(order: Conversion) -> Val3Emitter:
    """Return the writer of a conversion."""
    settings = _settings(order.program, order.cell, emitter_settings(order), order.cell.tables.posture.branch)
    settings.check()
    return Val3Emitter(order.program, settings, order.cell.machine_functions("val3"), order.tolerance_m)


def load(files: str, cell: Cell, tools: Sequence[int]) -> tuple[Fact, ...]:
    """Files and tool that a program needs."""
    if cell.holds_part:
        return against_fixed_tool(files, cell)
    return (
        Fact("Load", files, "", "as an application; it brings its frame, and its tool unless the cell names one"),
        *tool_frames(cell, "val3", tools, frame=pose_text(cell.controller_chain.T_flange_tcp)),
    )
