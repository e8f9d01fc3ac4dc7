"""Steps in languages of robots: what all share, KUKA KRL, ABB RAPID; process words by the cell file's table."""

from __future__ import annotations

import itertools
import math
from abc import abstractmethod
from typing import ClassVar, Final, Generic, TypeVar

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.core.units import MM_PER_S
from counterflex.geometry import pose
from counterflex.programs.convert.emitter import Emitter, turn_deg
from counterflex.programs.convert.steps import Move, Process
from counterflex.programs.gcode.write.written_line import number
from counterflex.programs.krl.writer import KrlSettings, krl_data, krl_frames, krl_pose, krl_source
from counterflex.programs.limits import KRL, RAPID, Limits, check_name
from counterflex.programs.program import Program
from counterflex.programs.rapid.writer import (
    SUPERVISED,
    UNSUPERVISED,
    RapidSettings,
    SteadyQuaternions,
    rapid_module,
    rapid_part,
    rapid_pose,
    rapid_tool,
)
from counterflex.programs.robot_writer.machine_functions import MachineFunctions
from counterflex.programs.robot_writer.writer import RobotSettings

S = TypeVar("S", bound=RobotSettings)
_NEARLY_WHOLE_DEG: Final = 340.0
_FLAT_M: Final = 1e-7
_HALF_DEG: Final = 180.0
_STEM: Final = 20
"""Characters of a name before the number of a part."""


class RobotEmitter(Emitter, Generic[S]):
    """What languages of robots share.

    Args:
        program: That is converted.
        settings: Names, frames and speeds, as compensated programs are written with.
        functions: ``[controller.spindle]`` of the language.
        tolerance_m: See :class:`Emitter`.
    """

    limits: ClassVar[Limits]
    stop: ClassVar[str]
    sign: ClassVar[str]

    def __init__(self, program: Program, settings: S, functions: MachineFunctions, tolerance_m: float) -> None:
        super().__init__(program.name, settings.name, tolerance_m)
        self.settings, self.functions = settings, functions
        self.robot_source = self._is_robot(program)
        self.tool = next((motion.tool for motion in program.motions if motion.tool), 0)
        self.points = self._in_part = 0
        self._cuts: list[int] = []
        self._entered: int | None = None

    @staticmethod
    def _is_robot(program: Program) -> bool:
        from counterflex.programs.robot_text.program import RobotProgram

        return isinstance(program, RobotProgram)

    def begin(self) -> None:
        """What made the program."""
        self.comment(self.origin())

    def comment(self, text: str) -> None:
        """A comment on a line of its own."""
        self.lines.append(f"{self.sign} {text}")

    def process(self, step: Process) -> None:
        """Statements of the table, or a stop."""
        if step.code in (0, 1):
            self.lines.append(self.stop)
            return
        try:
            self.lines += self.functions.lines(step.block)
        except ProgramError as fault:
            raise ProgramError(
                fault.what, where=f"{self.source}:{step.line}", value=fault.value, limit=fault.limit, hint=fault.hint
            ) from fault
        if step.code == 6:
            self.tool, self._entered = step.block.modal.tool or self.tool, None

    def straight(self, move: Move, share: float) -> None:
        """A point: by axes first and for rapids of robots, else straight."""
        self._count()
        self._enter(move)
        T = pose.make(self.orientation(move, share), move.at(share))
        free = self.first or (self.robot_source and move.motion.kind == "rapid")
        self.point(T, self._speed(move), free=free)

    def _speed(self, move: Move) -> float:
        return move.motion.feed_m_s if move.motion.feed_m_s > 0.0 else self.settings.rapid_m_s

    def arc(self, move: Move, start_share: float, end_share: float) -> None:
        """A circle."""
        self._count()
        self._enter(move)
        self.circle(move, start_share, end_share)

    def _enter(self, move: Move) -> None:
        """Frames, before the first point and behind a change of tool."""
        tool = move.motion.tool or self.tool
        if tool != self._entered:
            self._entered = self.tool = tool
            self.frames(tool)

    def refuse_turn(self, move: Move) -> None:
        """Robots turn in place at a speed of their own."""

    def end(self) -> dict[str, str]:
        """One file, or a main program and parts where there are more points than a file of the controller may have."""
        cuts = [0, *self._cuts, len(self.lines)]
        parts = [self.lines[a:b] for a, b in itertools.pairwise(cuts)]
        if len(parts) == 1:
            return self.program(self.name, self.lines)
        names = [f"{self.name[:_STEM]}_{index:03d}" for index in range(1, len(parts) + 1)]
        files = self.program(self.name, [self.call(name) for name in names])
        for name, lines in zip(names, parts, strict=True):
            files |= self.program(name, lines)
        self.warnings.append(
            f"{self.points} points: a main program calls {len(parts)} parts of at most "
            f"{self.settings.points_per_file} points"
        )
        return files

    def _count(self) -> None:
        """Begin a part before a motion, where the file would get too long."""
        if self._in_part == self.settings.points_per_file:
            self._cuts.append(len(self.lines))
            self._in_part = 0
        self.points += 1
        self._in_part += 1

    @abstractmethod
    def program(self, name: str, lines: list[str]) -> dict[str, str]:
        """Files of a program: the main one, or a part that it calls."""

    @abstractmethod
    def call(self, part: str) -> str:
        """Statement that calls a part."""

    @abstractmethod
    def frames(self, tool: int) -> None:
        """Lines that set the frames of a tool."""

    @abstractmethod
    def point(self, T_part_tcp: Float, speed_m_s: float, *, free: bool) -> None:
        """A point; ``free``: the robot takes its own way there."""

    @abstractmethod
    def circle(self, move: Move, start_share: float, end_share: float) -> None:
        """A piece of a circle."""


class KrlEmitter(RobotEmitter[KrlSettings]):
    """KUKA KRL: PTP, LIN, CIRC."""

    language: ClassVar[str] = "krl"
    limits: ClassVar[Limits] = KRL
    stop: ClassVar[str] = "HALT"
    sign: ClassVar[str] = ";"

    def program(self, name: str, lines: list[str]) -> dict[str, str]:
        """``.src`` and ``.dat``."""
        check_name(name, KRL, "KRL")
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
        return None if abs(move.rise_m) > _FLAT_M else [1.0]

    def circle(self, move: Move, start_share: float, end_share: float) -> None:
        """CIRC through the middle, or by CA where the circle is nearly whole."""
        self._set(self._speed(move))
        angle = turn_deg(move) * (end_share - start_share)
        whole = angle > _NEARLY_WHOLE_DEG
        middle, last = (120.0 / angle, 240.0 / angle) if whole else (0.5, 1.0)
        poses = [krl_pose(pose.make(self.orientation(move, 1.0), move.at(share))) for share in (middle, last)]
        turns = f",CA {number(angle, 6)}" if whole else ""
        self.lines.append(f"CIRC {{{poses[0]}}},{{{poses[1]}}}{turns}{self._behind()}")


class RapidEmitter(RobotEmitter[RapidSettings]):
    """ABB RAPID: MoveJ, MoveL, MoveC in one module.

    Args:
        program: See :class:`RobotEmitter`.
        settings: See there.
        functions: See there.
        tolerance_m: See there.
    """

    language: ClassVar[str] = "rapid"
    limits: ClassVar[Limits] = RAPID
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
        check_name(f"{name}_m", RAPID, "RAPID")
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
        if abs(move.rise_m) > _FLAT_M:
            return None
        count = max(1, math.ceil(turn_deg(move) / _HALF_DEG - 1e-6))
        return [k / count for k in range(1, count + 1)]

    def circle(self, move: Move, start_share: float, end_share: float) -> None:
        """MoveC through the middle of a piece."""
        middle, last = (
            self._target(pose.make(self.orientation(move, share), move.at(share)))
            for share in (0.5 * (start_share + end_share), end_share)
        )
        self.lines.append(f"MoveC {middle},{last},{self._rest(self._speed(move))}")
