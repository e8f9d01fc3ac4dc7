"""Steps in languages of robots: what all share; process words by the cell file's table."""

from __future__ import annotations

import itertools
import math
from typing import ClassVar, Final, Generic, TypeVar

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.geometry import pose
from counterflex.programs.convert.emitter import ProgramEmitter, turn_deg
from counterflex.programs.convert.steps import MachineFunction, Move
from counterflex.programs.gcode.write.written_line import number
from counterflex.programs.program import Program
from counterflex.programs.robot_text.program import RobotProgram
from counterflex.programs.robot_writer.machine_functions import MachineFunctions
from counterflex.programs.robot_writer.writer import RobotSettings, RobotWords, require_language

S = TypeVar("S", bound=RobotSettings)
FLAT_M: Final = 1e-7
"""Rise of a circle, m, up to which it is no helix."""
_HALF_DEG: Final = 180.0
_STEM: Final = 20  # Characters of a name before the number of a part


class RobotEmitter(RobotWords[S], ProgramEmitter, Generic[S]):
    """Writer of steps, common to languages of robots.

    Args:
        program: That is converted.
        settings: Names, frames and speeds, as compensated programs are written with.
        functions: ``[controller.spindle]`` of the language.
        tolerance_m: See :class:`ProgramEmitter`.
    """

    dwell_decimals: ClassVar[int] = 4
    """Of the time of a dwell, s."""

    def __init__(self, program: Program, settings: S, functions: MachineFunctions, tolerance_m: float) -> None:
        super().__init__(program.name, settings.name, tolerance_m)
        settings.check()
        require_language(self.language, functions.language)
        self.settings, self.functions = settings, functions
        self.robot_source = isinstance(program, RobotProgram)
        self.tool = next((motion.tool for motion in program.motions if motion.tool), 0)
        self.points = self._in_part = 0
        self._cuts: list[int] = []
        self._entered: int | None = None

    def begin(self) -> None:
        """Say the origin of the program."""
        self.comment(self.origin())

    def comment(self, text: str) -> None:
        """A comment on a line of its own."""
        self.lines.append(f"{self.sign} {text}")

    def process(self, step: MachineFunction) -> None:
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
        self.lines += self.motion([T], self._speed(move), exact=self.exact or self.first, free=free)

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
            self.lines += self.frames(tool)

    def dwell(self, move: Move) -> None:
        """Wait."""
        self.lines.append(self.wait.format(number(move.motion.duration_s, self.dwell_decimals)))

    def arc_shares(self, move: Move) -> list[float] | None:
        """Halves at most: a circle through a point goes less than a turn; a helix becomes straight moves."""
        return self.halves(move)

    def through(self, move: Move, start_share: float, end_share: float) -> list[Float]:
        """Poses (4, 4) m in the middle and at the end of a piece of a circle."""
        shares = (0.5 * (start_share + end_share), end_share)
        return [pose.make(self.orientation(move, share), move.at(share)) for share in shares]

    def halves(self, move: Move) -> list[float] | None:
        """Shares of a circle in halves at most, for a statement that goes less than a turn; None of a helix."""
        if abs(move.rise_m) > FLAT_M:
            return None
        count = max(1, math.ceil(turn_deg(move) / _HALF_DEG - 1e-6))
        return [k / count for k in range(1, count + 1)]

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

    def circle(self, move: Move, start_share: float, end_share: float) -> None:
        """Write a piece of a circle."""
        poses = self.through(move, start_share, end_share)
        self.lines += self.motion(poses, self._speed(move), exact=self.exact or self.first)
