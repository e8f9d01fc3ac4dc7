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
from counterflex.core.arrays import Float
from counterflex.files.cell.cell import Cell
from counterflex.integrations.staubli.language.application import Application, Val3Settings
from counterflex.integrations.staubli.language.read.motions import Val3Cell
from counterflex.programs.convert.emitter import Conversion
from counterflex.programs.convert.robot_languages import RobotEmitter
from counterflex.programs.convert.steps import Move
from counterflex.programs.gcode.write.written_line import number
from counterflex.programs.program import Program
from counterflex.programs.robot_writer.writer import RobotWords, RobotWriter
from counterflex.report.data import Fact
from counterflex.robot.kinematics.inverse_seeds import branch_of


class Val3Words(RobotWords[Val3Settings]):
    """Programs of an application."""

    language, sign, stop, wait = "val3", "//", "waitEndMove()\n  get()", "delay({})"

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


class Val3Emitter(Val3Words, RobotEmitter[Val3Settings]):
    """Staubli VAL3: movej, movel, movec; the points in the data file."""

    def end(self) -> dict[str, str]:
        """Programs, data and project."""
        files = super().end()
        return files | self.application.project(list(files))

    def dwell(self, move: Move) -> None:
        """delay, at rest."""
        self.lines += ["waitEndMove()", f"delay({number(move.motion.duration_s, 4)})"]

    def _behind(self, speed_m_s: float) -> str:
        exact = self.exact or self.first
        return f"{self.application.tool(self.tool)},{self.application.speed(speed_m_s, exact=exact)})"

    def point(self, T_part_tcp: Float, speed_m_s: float, *, free: bool) -> None:
        """Movej or movel."""
        word = "movej" if free else "movel"
        self.lines.append(f"{word}({self.application.point(T_part_tcp)},{self._behind(0.0 if free else speed_m_s)}")

    def circle(self, move: Move, start_share: float, end_share: float) -> None:
        """Movec through the middle of a piece."""
        middle, last = (self.application.point(T) for T in self.through(move, start_share, end_share))
        self.lines.append(f"movec({middle},{last},{self._behind(self._speed(move))}")


class Val3Writer(Val3Words, RobotWriter[Val3Settings]):
    """The words of VAL3: every point is a ``movel`` to an element of ``pPath`` in the part frame."""

    def point(self, index: int) -> list[str]:
        """A point: movel, stopping at the first one and where it must be reached."""
        speed, exact = self.speed_to(index), bool(self.points.exact[index] or index == 0)
        return [self._move(index, speed, exact=exact), *(["waitEndMove()"] if exact else [])]

    def enter(self, tool: int, place: int) -> list[str]:
        """The way back behind a change of tool."""
        self.speed, self.tool = self.settings.rapid_m_s, tool
        return [self._move(place, self.speed, exact=True), "waitEndMove()"]

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

    def _move(self, index: int, speed_m_s: float, *, exact: bool) -> str:
        app = self.application
        point = app.point(self.points.Ts_part_tcp[index])
        return f"movel({point},{app.tool(self.tool)},{app.speed(speed_m_s, exact=exact)})"


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
