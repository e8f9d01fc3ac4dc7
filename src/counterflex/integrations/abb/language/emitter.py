"""Steps as ABB RAPID."""

from __future__ import annotations

from typing import ClassVar

from counterflex.core.arrays import Float
from counterflex.core.units import MM_PER_S
from counterflex.geometry import pose
from counterflex.integrations.abb.language import LIMITS
from counterflex.integrations.abb.language.writer import (
    SUPERVISED,
    UNSUPERVISED,
    RapidSettings,
    SteadyQuaternions,
    rapid_module,
    rapid_part,
    rapid_pose,
    rapid_tool,
)
from counterflex.programs.convert.robot_languages import RobotEmitter
from counterflex.programs.convert.steps import Move
from counterflex.programs.gcode.write.written_line import number
from counterflex.programs.limits import Limits, check_name
from counterflex.programs.program import Program
from counterflex.programs.robot_writer.machine_functions import MachineFunctions


class RapidEmitter(RobotEmitter[RapidSettings]):
    """ABB RAPID: MoveJ, MoveL, MoveC in one module."""

    language: ClassVar[str] = "rapid"
    limits: ClassVar[Limits] = LIMITS
    stop: ClassVar[str] = "Stop;"
    sign: ClassVar[str] = "!"

    def __init__(
        self, program: Program, settings: RapidSettings, functions: MachineFunctions, tolerance_m: float
    ) -> None:  # fmt: skip
        super().__init__(program, settings, functions, tolerance_m)
        self._speeds: dict[str, str] = {}
        self._quaternions = SteadyQuaternions()
        self._own_tool = False

    def program(self, name: str, lines: list[str]) -> dict[str, str]:
        """One module, the main one with what all declare."""
        settings = self.settings
        check_name(f"{name}_m", LIMITS, "RAPID")
        declared: list[str] = []
        if name == self.name:
            declared = [f"  ! {self.origin()}"]
            declared += [f"  {rapid_tool(settings, self._tool_name(0))}"] if self._own_tool else []
            declared += [] if settings.work_object else [f"  {rapid_part(settings, self._wobj)}"]
            declared += [f"  CONST speeddata {speed}:={value};" for value, speed in self._speeds.items()]
        main = name == self.name
        body = [*(UNSUPERVISED if main else ()), *lines, *(SUPERVISED if main else ())]
        return {f"{name}.mod": rapid_module(name, declared, [f"    {line}" for line in body])}

    def call(self, part: str) -> str:
        """A routine of another module."""
        return f"{part};"

    def begin(self) -> None:
        """The module's head says what made it."""

    @property
    def _wobj(self) -> str:
        return self.settings.work_object or f"w_{self.name[:30]}"

    def _tool_name(self, tool: int) -> str:
        return self.settings.tool_data.get(tool, f"t_{self.name[:30]}")

    def frames(self, tool: int) -> None:
        """Every instruction names them."""
        self._own_tool |= tool not in self.settings.tool_data

    def dwell(self, move: Move) -> None:
        """WaitTime."""
        self.lines.append(f"WaitTime {number(move.motion.duration_s, 4)};")

    def _rest(self, speed_m_s: float) -> str:
        value = f"[{number(speed_m_s / MM_PER_S, 5)},{number(self.settings.orientation_deg_s, 3)},5000,1000]"
        name = self._speeds.setdefault(value, f"v_{self.name[:24]}_{len(self._speeds) + 1}")
        zone = "fine" if self.exact or self.first else self.settings.zone
        return f"{name},{zone},{self._tool_name(self.tool)}\\WObj:={self._wobj};"

    def _target(self, T_part_tcp: Float) -> str:
        held = self.settings.external_axes
        external = ",".join(number(held[i], 5) if i in held else "9E9" for i in range(1, 7))
        configuration = ",".join(str(int(c)) for c in self.settings.configuration)
        pose_text = rapid_pose(T_part_tcp, self._quaternions.of(T_part_tcp[:3, :3]))
        return f"[{pose_text},[{configuration}],[{external}]]"

    def point(self, T_part_tcp: Float, speed_m_s: float, *, free: bool) -> None:
        """MoveJ or MoveL."""
        rest = self._rest(speed_m_s)
        self.lines.append(f"{'MoveJ' if free else 'MoveL'} {self._target(T_part_tcp)},{rest}")

    def arc_shares(self, move: Move) -> list[float] | None:
        """Halves at most: MoveC goes less than a turn; a helix becomes straight moves."""
        return self.halves(move)

    def circle(self, move: Move, start_share: float, end_share: float) -> None:
        """MoveC through the middle of a piece."""
        middle, last = (
            self._target(pose.make(self.orientation(move, share), move.at(share)))
            for share in (0.5 * (start_share + end_share), end_share)
        )
        self.lines.append(f"MoveC {middle},{last},{self._rest(self._speed(move))}")
