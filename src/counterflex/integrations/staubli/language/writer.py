"""Staubli VAL3: a compensated path as movel instructions, with the data of an application."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from counterflex.integrations.staubli.language import LIMITS
from counterflex.integrations.staubli.language.application import Application, Val3Settings
from counterflex.programs.gcode.write.written_line import number
from counterflex.programs.robot_writer.writer import RobotWriter


class Val3Writer(RobotWriter[Val3Settings]):
    """The words of VAL3: every point is a ``movel`` to an element of ``pPath`` in the part frame."""

    dialect, limits, suffix = "val3", LIMITS, "pgx"
    comment, stop, wait = "//", "waitEndMove()\n  get()", "delay({})"

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.application = Application(self.settings)
        self._parts: list[str] = []

    def point(self, index: int) -> list[str]:
        """A point: movel, stopping at the first one and where it must be reached."""
        speed, exact = self.speed_to(index), bool(self.points.exact[index] or index == 0)
        return [self._move(index, speed, exact=exact), *(["waitEndMove()"] if exact else [])]

    def enter(self, tool: int, place: int) -> list[str]:
        """The way back behind a change of tool."""
        self.speed, self.tool = self.settings.rapid_m_s, tool
        return [self._move(place, self.speed, exact=True), "waitEndMove()"]

    def start(self, lead: Sequence[str]) -> list[str]:
        """Where the program comes from, start posture."""
        app = self.application
        move = f"movej(jStart[0],{app.tool(self.first_tool)},{app.speed(0.0, exact=True)})"
        return [*self.origin(), *lead, move, "waitEndMove()"]

    def dwell(self, time_s: float) -> str:
        """Line that waits, at rest: the controller runs ahead of the motion."""
        return f"delay({number(time_s, 3)})"

    def call(self, part: str) -> str:
        """Call of a part."""
        return f"call {part}()"

    def main(self, body: Sequence[str]) -> str:
        """The main program."""
        return self.application.program(self.settings.name, body)[f"{self.settings.name}.pgx"]

    def part(self, name: str, body: Sequence[str]) -> dict[str, str]:
        """The program of a part."""
        self._parts.append(f"{name}.pgx")
        return self.application.program(name, body)

    def data(self) -> dict[str, str]:
        """Points, speeds, project."""
        return self.application.project([f"{self.settings.name}.pgx", *self._parts])

    def _move(self, index: int, speed_m_s: float, *, exact: bool) -> str:
        app = self.application
        point = app.point(self.points.Ts_part_tcp[index])
        return f"movel({point},{app.tool(self.tool)},{app.speed(speed_m_s, exact=exact)})"
