"""TP listings of a cell: what a program is held against, what is written for one, and what must be set."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from counterflex.app.compensation.languages import WritingOrder, Written, robot_text, writer_settings
from counterflex.app.compensation.next_steps import against_fixed_tool, tool_frames
from counterflex.app.compensation.robot_program import tool_data
from counterflex.app.conversion import emitter_settings
from counterflex.app.robot_axes import part_in_world
from counterflex.app.robot_programs import numbered_facts, refuse_held_part
from counterflex.files.cell.cell import Cell
from counterflex.integrations.fanuc.language.program import values_text
from counterflex.integrations.fanuc.language.writer import FanucSettings, FanucWords, FanucWriter
from counterflex.programs.convert.emitter import Conversion
from counterflex.programs.convert.robot_languages import RobotEmitter
from counterflex.programs.program import Program
from counterflex.programs.robot_text.cell import NumberedCell
from counterflex.report.data import Fact
from counterflex.robot.kinematics.inverse_seeds import branch_of
from counterflex.robot.model.opw import TURN


class FanucEmitter(FanucWords, RobotEmitter[FanucSettings]):
    """A converted program as a listing."""


def cell_of(cell: Cell) -> NumberedCell:
    """Return the cell as the reader of FANUC programs needs it; refuse a cell whose robot holds the part."""
    return NumberedCell(**numbered_facts(cell, "fanuc", "FANUC"))


def configuration(branch: str, axes_rad: Sequence[float] | None = None) -> str:
    """CONFIG of FANUC positions in a posture: wrist N F, elbow U D, arm T B, turns of J1, J4 and J6.

    Args:
        branch: Such as ``front up noflip``.
        axes_rad: (6,) axes as the controller shows them; None is no turn.
    """
    arm, elbow, wrist = branch.split()
    letters = ("N" if wrist == "noflip" else "F", "U" if elbow == "up" else "D", "T" if arm == "front" else "B")
    turns = [0, 0, 0] if axes_rad is None else [round(axes_rad[axis] / TURN) for axis in (0, 3, 5)]
    return f"{' '.join(letters)}, {', '.join(str(turn) for turn in turns)}"


def _settings(program: Program, cell: Cell, common: dict[str, Any], config: str) -> FanucSettings:
    refuse_held_part(cell, "FANUC")
    return FanucSettings(
        **common,
        configuration=config,
        T_world_part=part_in_world(cell, "fanuc"),
        T_flange_tcp=cell.controller_chain.T_flange_tcp,
        tool=cell.tables.controller.tool_number,
        base=cell.tables.controller.base_number,
        tool_data={tool: int(value) for tool, value in tool_data(program, cell, "fanuc").items()},
    )


def write(order: WritingOrder) -> Written:
    """Write a program of another language as a listing."""
    cell = order.cell
    refuse_held_part(cell, "FANUC")
    common = writer_settings(order, "fanuc")
    config = configuration(branch_of(cell.controller_chain, order.plan.q[0]), common["start_axes_rad"])
    return robot_text(order, FanucWriter, _settings(order.job.program, cell, common, config), "fanuc")


def convert(order: Conversion) -> FanucEmitter:
    """Return the writer of a conversion."""
    config = configuration(order.cell.tables.posture.branch)
    settings = _settings(order.program, order.cell, emitter_settings(order), config)
    return FanucEmitter(order.program, settings, order.cell.machine_functions("fanuc"), order.tolerance_m)


def load(files: str, cell: Cell, tools: Sequence[int]) -> tuple[Fact, ...]:
    """Files, UFRAME, UTOOL and CONFIG that a program needs."""
    if cell.holds_part:
        return against_fixed_tool(files, cell)
    frames = (part_in_world(cell, "fanuc"), cell.controller_chain.T_flange_tcp)
    part, tip = (values_text(T).replace("\n\t", " ").strip() for T in frames)
    letters = configuration(cell.tables.posture.branch).partition(",")[0]
    controller = cell.tables.controller
    other = f"UTOOL[{controller.tool_number}]"
    return (
        Fact("Load", files, "", "as ASCII listings, all of them"),
        Fact(f"UFRAME[{controller.base_number}]", part, "mm, deg", "the part frame that was planned with"),
        *tool_frames(cell, "fanuc", tools, frame=tip, other=other, form="UTOOL[{}]"),
        Fact("CONFIG", letters, "", "of every position, by [posture]; the turns behind it are those of the start"),
    )
