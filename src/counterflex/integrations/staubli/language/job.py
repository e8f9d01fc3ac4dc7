"""VAL3 programs of a cell: what a program is held against, what is written for one, and what must be set."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

from counterflex.app.compensation.languages import WritingOrder, Written, robot_text, writer_settings
from counterflex.app.compensation.next_steps import against_fixed_tool, tool_frames
from counterflex.app.compensation.robot_program import tool_data
from counterflex.app.conversion import emitter_settings
from counterflex.app.robot_axes import part_in_world, pose_text
from counterflex.app.robot_programs import refuse_held_part, shared_facts
from counterflex.files.cell.cell import Cell
from counterflex.integrations.staubli.language.application import Application, Val3Settings
from counterflex.integrations.staubli.language.read.motions import Val3Cell
from counterflex.programs.convert.emitter import Conversion
from counterflex.programs.convert.robot_languages import RobotEmitter
from counterflex.programs.convert.steps import Move
from counterflex.programs.gcode.write.written_line import number
from counterflex.programs.program import Program
from counterflex.programs.robot_writer.writer import External, Poses, RobotWords, RobotWriter
from counterflex.report.data import Fact
from counterflex.robot.kinematics.inverse_seeds import branch_of


class Val3Words(RobotWords[Val3Settings]):
    """Programs of an application."""

    language, sign, stop = "val3", "//", "waitEndMove()\n  get()"

    @cached_property
    def application(self) -> Application:
        """Its points, speeds and tools."""
        return Application(self.settings)

    def program(self, name: str, lines: Sequence[str]) -> dict[str, str]:
        """A program file."""
        return self.application.program(name, lines)

    def call(self, part: str) -> str:
        """A program of the application."""
        return f"call {part}()"

    def motion(
        self, Ts_part_tcp: Poses, speed_m_s: float, *, exact: bool, free: bool = False, external: External = None
    ) -> list[str]:
        """movej, movel or movec to elements of ``pPath`` in the part frame."""
        del external
        app = self.application
        word = "movej" if free else "movel" if len(Ts_part_tcp) == 1 else "movec"
        points = ",".join(app.point(T) for T in Ts_part_tcp)
        return [f"{word}({points},{app.tool(self.tool)},{app.speed(0.0 if free else speed_m_s, exact=exact)})"]


class Val3Emitter(Val3Words, RobotEmitter[Val3Settings]):
    """A converted program as an application."""

    def end(self) -> dict[str, str]:
        """Programs, data and project."""
        files = super().end()
        return files | self.application.project(list(files))

    def dwell(self, move: Move) -> None:
        """delay, at rest."""
        self.lines += ["waitEndMove()", f"delay({number(move.motion.duration_s, 4)})"]


class Val3Writer(Val3Words, RobotWriter[Val3Settings]):
    """A commanded path as an application."""

    def motion(
        self, Ts_part_tcp: Poses, speed_m_s: float, *, exact: bool, free: bool = False, external: External = None
    ) -> list[str]:
        """The controller runs ahead of the motion: it waits where a point must be reached."""
        lines = super().motion(Ts_part_tcp, speed_m_s, exact=exact, free=free, external=external)
        return [*lines, *(["waitEndMove()"] if exact else [])]

    def start(self, lead: Sequence[str]) -> list[str]:
        """Return origin, start posture."""
        app = self.application
        move = f"movej(jStart[0],{app.tool(self.first_tool)},{app.speed(0.0, exact=True)})"
        return [*self.origin(), *lead, move, "waitEndMove()"]

    def dwell(self, time_s: float) -> str:
        """Line that waits, at rest: the controller runs ahead of the motion."""
        return f"delay({number(time_s, 3)})"

    def data(self, files: list[str]) -> dict[str, str]:
        """Points, speeds, project."""
        return self.application.project(files)


def cell_of(cell: Cell) -> Val3Cell:
    """Return the cell as the reader of VAL3 needs it.

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
