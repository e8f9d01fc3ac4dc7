"""Steps as a Staubli VAL3 application."""

from __future__ import annotations

from typing import ClassVar

from counterflex.core.arrays import Float
from counterflex.geometry import pose
from counterflex.integrations.staubli.language import LIMITS
from counterflex.integrations.staubli.language.application import Application, Val3Settings
from counterflex.programs.convert.robot_languages import RobotEmitter
from counterflex.programs.convert.steps import Move
from counterflex.programs.gcode.write.written_line import number
from counterflex.programs.limits import Limits
from counterflex.programs.program import Program
from counterflex.programs.robot_writer.machine_functions import MachineFunctions


class Val3Emitter(RobotEmitter[Val3Settings]):
    """Staubli VAL3: movej, movel, movec; the points in the data file."""

    language: ClassVar[str] = "val3"
    limits: ClassVar[Limits] = LIMITS
    stop: ClassVar[str] = "waitEndMove()\n  get()"
    sign: ClassVar[str] = "//"

    def __init__(
        self, program: Program, settings: Val3Settings, functions: MachineFunctions, tolerance_m: float
    ) -> None:
        super().__init__(program, settings, functions, tolerance_m)
        self.application = Application(settings)

    def end(self) -> dict[str, str]:
        """Programs, data and project."""
        files = super().end()
        return files | self.application.project(list(files))

    def program(self, name: str, lines: list[str]) -> dict[str, str]:
        """A program file."""
        return self.application.program(name, lines)

    def call(self, part: str) -> str:
        """A program of the application."""
        return f"call {part}()"

    def frames(self, tool: int) -> None:
        """Every statement names its tool, every point its frame."""

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

    def arc_shares(self, move: Move) -> list[float] | None:
        """Halves at most: movec goes less than a turn; a helix becomes straight moves."""
        return self.halves(move)

    def circle(self, move: Move, start_share: float, end_share: float) -> None:
        """Movec through the middle of a piece."""
        middle, last = (
            self.application.point(pose.make(self.orientation(move, share), move.at(share)))
            for share in (0.5 * (start_share + end_share), end_share)
        )
        self.lines.append(f"movec({middle},{last},{self._behind(self._speed(move))}")
