"""Steps as KUKA KRL."""

from __future__ import annotations

from typing import ClassVar, Final

from counterflex.core.arrays import Float
from counterflex.geometry import pose
from counterflex.integrations.kuka.language import LIMITS
from counterflex.integrations.kuka.language.writer import KrlSettings, krl_data, krl_frames, krl_pose, krl_source
from counterflex.programs.convert.emitter import turn_deg
from counterflex.programs.convert.robot_languages import FLAT_M, RobotEmitter
from counterflex.programs.convert.steps import Move
from counterflex.programs.gcode.write.written_line import number
from counterflex.programs.limits import Limits, check_name

_NEARLY_WHOLE_DEG: Final = 340.0


class KrlEmitter(RobotEmitter[KrlSettings]):
    """KUKA KRL: PTP, LIN, CIRC."""

    language: ClassVar[str] = "krl"
    limits: ClassVar[Limits] = LIMITS
    stop: ClassVar[str] = "HALT"
    sign: ClassVar[str] = ";"

    def program(self, name: str, lines: list[str]) -> dict[str, str]:
        """``.src`` and ``.dat``."""
        check_name(name, LIMITS, "KRL")
        return {f"{name}.src": krl_source(name, lines), f"{name}.dat": krl_data(name, [])}

    def call(self, part: str) -> str:
        """A subprogram."""
        return f"{part}( )"

    def frames(self, tool: int) -> None:
        """$TOOL, $BASE, speeds."""
        self.lines += krl_frames(self.settings, tool)
        self._velocity = ""

    def dwell(self, move: Move) -> None:
        """WAIT SEC."""
        self.lines.append(f"WAIT SEC {number(move.motion.duration_s, 4)}")

    def _set(self, speed_m_s: float) -> None:
        text = number(speed_m_s, 8).rstrip("0")
        text = f"{text}0" if text.endswith(".") else text
        if text != self._velocity:
            self._velocity = text
            self.lines.append(f"$VEL.CP={text}")

    def point(self, T_part_tcp: Float, speed_m_s: float, *, free: bool) -> None:
        """PTP or LIN."""
        if not free:
            self._set(speed_m_s)
        self.lines.append(f"{'PTP' if free else 'LIN'} {{{krl_pose(T_part_tcp)}}}{self._behind(free=free)}")

    def _behind(self, *, free: bool = False) -> str:
        return "" if self.exact or self.first else " C_PTP" if free else " C_DIS"

    def arc_shares(self, move: Move) -> list[float] | None:
        """One CIRC; a helix becomes straight moves."""
        return None if abs(move.rise_m) > FLAT_M else [1.0]

    def circle(self, move: Move, start_share: float, end_share: float) -> None:
        """CIRC through the middle, or by CA where the circle is nearly whole."""
        self._set(self._speed(move))
        angle = turn_deg(move) * (end_share - start_share)
        whole = angle > _NEARLY_WHOLE_DEG
        middle, last = (120.0 / angle, 240.0 / angle) if whole else (0.5, 1.0)
        poses = [krl_pose(pose.make(self.orientation(move, 1.0), move.at(share))) for share in (middle, last)]
        turns = f",CA {number(angle, 6)}" if whole else ""
        self.lines.append(f"CIRC {{{poses[0]}}},{{{poses[1]}}}{turns}{self._behind()}")
