"""RAPID programs of a cell: what a program is held against, what is written for one, and what must be set."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from counterflex.app.compensation.languages import WritingOrder, Written, payload, robot_text, writer_settings
from counterflex.app.compensation.next_steps import against_fixed_tool, tool_frames
from counterflex.app.compensation.robot_program import tool_data
from counterflex.app.conversion import emitter_settings
from counterflex.app.robot_axes import in_world, part_in_world, pose_text
from counterflex.app.robot_programs import shared_facts
from counterflex.files.cell.cell import Cell
from counterflex.integrations.abb.language.emitter import RapidEmitter
from counterflex.integrations.abb.language.read.frames import RapidCell
from counterflex.integrations.abb.language.writer import RapidSettings, RapidWriter
from counterflex.programs.convert.emitter import Conversion
from counterflex.programs.program import Program
from counterflex.report.data import Fact


def cell_of(cell: Cell) -> RapidCell:
    """What a RAPID program is held against."""
    return RapidCell(
        **shared_facts(cell, "rapid"),
        tool_of_data={t.tooldata.upper(): t.number for t in cell.tables.tools if t.tooldata is not None},
        work_object=cell.tables.controller.work_object or "",
        T_base_tcp=None if cell.T_base_tcp is None else in_world(cell, "rapid", cell.T_base_tcp),
    )


def _settings(program: Program, cell: Cell, common: dict[str, Any]) -> RapidSettings:
    mass, com = payload(cell)
    return RapidSettings(
        **common,
        T_flange_tcp=cell.controller_chain.T_flange_tcp,
        T_base_part=part_in_world(cell, "rapid"),
        work_object=cell.tables.controller.work_object or "",
        T_base_tcp=None if cell.T_base_tcp is None else in_world(cell, "rapid", cell.T_base_tcp),
        tool_mass_kg=mass,
        p_flange_cog=com,
        tool_data=tool_data(program, cell, "rapid"),
    )


def write(order: WritingOrder) -> Written:
    """Write a program of another language in RAPID."""
    settings = _settings(order.job.program, order.cell, writer_settings(order, "rapid"))
    return robot_text(order, RapidWriter, settings, "rapid")


def convert(order: Conversion) -> RapidEmitter:
    """Return the writer of a conversion."""
    settings = _settings(order.program, order.cell, emitter_settings(order))
    return RapidEmitter(order.program, settings, order.cell.machine_functions("rapid"), order.tolerance_m)


def load(files: str, cell: Cell, tools: Sequence[int]) -> tuple[Fact, ...]:
    """Files, part frame and tooldata that a program needs."""
    if cell.holds_part:
        return against_fixed_tool(files, cell, remark="all of them; rapid modules bring their frames")
    frame = pose_text(part_in_world(cell, "rapid"))
    return (
        Fact("Load", files, "", "as a program module; it brings its wobjdata, and tooldata unless the cell names one"),
        Fact("Part frame", frame, "mm, deg about z, y', x''", "in the world of the controller, as planned"),
        *tool_frames(cell, "rapid", tools, frame=pose_text(cell.controller_chain.T_flange_tcp)),
    )
