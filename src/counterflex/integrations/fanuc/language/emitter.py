"""Steps as a FANUC TP listing."""

from __future__ import annotations

from typing import ClassVar

from counterflex.core.arrays import Float
from counterflex.geometry import pose
from counterflex.integrations.fanuc.language import LIMITS
from counterflex.integrations.fanuc.language.writer import (
    FanucSettings,
    fanuc_frames,
    fanuc_motion,
    fanuc_program,
    speed_text,
)
from counterflex.programs.convert.robot_languages import RobotEmitter
from counterflex.programs.convert.steps import Move
from counterflex.programs.gcode.write.written_line import number
from counterflex.programs.limits import Limits, check_name


class FanucEmitter(RobotEmitter[FanucSettings]):
    """FANUC TP: J, L, C."""

    language: ClassVar[str] = "fanuc"
    limits: ClassVar[Limits] = LIMITS
    stop: ClassVar[str] = "PAUSE"
    sign: ClassVar[str] = "!"

    def program(self, name: str, lines: list[str]) -> dict[str, str]:
        """One listing."""
        check_name(name, LIMITS, "FANUC")
        return {f"{name}.ls": fanuc_program(name, lines)}

    def call(self, part: str) -> str:
        """CALL."""
        return f"CALL {part.upper()}"

    def frames(self, tool: int) -> None:
        """UFRAME_NUM, UTOOL_NUM."""
        self.lines += fanuc_frames(self.settings, tool)

    def dwell(self, move: Move) -> None:
        """WAIT."""
        self.lines.append(f"WAIT {number(move.motion.duration_s, 4)}(sec)")

    @property
    def _termination(self) -> str:
        return "FINE" if self.exact or self.first else f"CNT{self.settings.blend}"

    def point(self, T_part_tcp: Float, speed_m_s: float, *, free: bool) -> None:
        """J or L."""
        word, speed = ("J", f"{self.settings.axis_percent}%") if free else ("L", speed_text(speed_m_s))
        self.lines.append(fanuc_motion(self.settings, self.tool, word, [T_part_tcp], speed, self._termination))

    def arc_shares(self, move: Move) -> list[float] | None:
        """Halves at most: C goes less than a turn; a helix becomes straight moves."""
        return self.halves(move)

    def circle(self, move: Move, start_share: float, end_share: float) -> None:
        """C through the middle of a piece."""
        Ts = [
            pose.make(self.orientation(move, share), move.at(share))
            for share in (0.5 * (start_share + end_share), end_share)
        ]
        speed = speed_text(self._speed(move))
        self.lines.append(fanuc_motion(self.settings, self.tool, "C", Ts, speed, self._termination))
