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
from counterflex.core.units import MM_PER_S
from counterflex.files.cell.cell import Cell
from counterflex.integrations.abb.language.read.frames import RapidCell
from counterflex.integrations.abb.language.writer import (
    SUPERVISED,
    UNSUPERVISED,
    RapidSettings,
    RapidWords,
    RapidWriter,
)
from counterflex.programs.convert.emitter import Conversion
from counterflex.programs.convert.robot_languages import RobotEmitter
from counterflex.programs.gcode.write.written_line import number
from counterflex.programs.program import Program
from counterflex.programs.robot_writer.machine_functions import MachineFunctions
from counterflex.report.data import Fact


class RapidEmitter(RapidWords, RobotEmitter[RapidSettings]):
    """A converted program in RAPID."""

    def __init__(
        self, program: Program, settings: RapidSettings, functions: MachineFunctions, tolerance_m: float
    ) -> None:  # fmt: skip
        super().__init__(program, settings, functions, tolerance_m)
        self._speeds: dict[str, str] = {}
        self._own_tool = False

    def declared(self) -> tuple[list[str], bool, list[tuple[str, str]]]:
        """Return comments about the origin, tool and speeds."""
        return [f"! {self.origin()}"], self._own_tool, [(name, value) for value, name in self._speeds.items()]

    def program(self, name: str, lines: Sequence[str]) -> dict[str, str]:
        """One module; the main one without supervision of the configuration."""
        return super().program(name, [*UNSUPERVISED, *lines, *SUPERVISED] if name == self.name else lines)

    def begin(self) -> None:
        """The module's head says what made it."""

    def frames(self, tool: int) -> list[str]:
        """Every instruction names them."""
        self._own_tool |= tool not in self.settings.tool_data
        return []

    def speed_name(self, speed_m_s: float) -> str:
        """Name by its first use."""
        value = f"[{number(speed_m_s / MM_PER_S, 5)},{number(self.settings.orientation_deg_s, 3)},5000,1000]"
        return self._speeds.setdefault(value, f"v_{self.name[:24]}_{len(self._speeds) + 1}")


def cell_of(cell: Cell) -> RapidCell:
    """Return the cell as the reader of RAPID needs it."""
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
