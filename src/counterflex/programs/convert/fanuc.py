"""Steps as a FANUC TP listing."""

from __future__ import annotations

import math
from typing import ClassVar, Final

from counterflex.core.arrays import Float
from counterflex.geometry import pose
from counterflex.programs.convert.emitter import turn_deg
from counterflex.programs.convert.robot_languages import RobotEmitter
from counterflex.programs.convert.steps import Move
from counterflex.programs.fanuc.writer import FanucSettings, fanuc_frames, fanuc_motion, fanuc_program, speed_text
from counterflex.programs.gcode.write.written_line import number
from counterflex.programs.limits import FANUC, Limits, check_name

_FLAT_M: Final = 1e-7
_HALF_DEG: Final = 180.0


class FanucEmitter(RobotEmitter[FanucSettings]):
    """FANUC TP: J, L, C."""

    language: ClassVar[str] = "fanuc"
    limits: ClassVar[Limits] = FANUC
    stop: ClassVar[str] = "PAUSE"
    sign: ClassVar[str] = "!"

    def program(self, name: str, lines: list[str]) -> dict[str, str]:
        """One listing."""
        check_name(name, FANUC, "FANUC")
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
        if abs(move.rise_m) > _FLAT_M:
            return None
        count = max(1, math.ceil(turn_deg(move) / _HALF_DEG - 1e-6))
        return [k / count for k in range(1, count + 1)]

    def circle(self, move: Move, start_share: float, end_share: float) -> None:
        """C through the middle of a piece."""
        Ts = [
            pose.make(self.orientation(move, share), move.at(share))
            for share in (0.5 * (start_share + end_share), end_share)
        ]
        speed = speed_text(self._speed(move))
        self.lines.append(fanuc_motion(self.settings, self.tool, "C", Ts, speed, self._termination))
