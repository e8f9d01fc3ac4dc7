"""Motions by axes: rapids of the path between Cartesian motions, none before the first and behind the last of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.core.units import RPM
from counterflex.programs.program import Motion, MotionKind
from counterflex.programs.robot_text.execution import Execution, ToolInSpindle
from counterflex.programs.unknown import Unknown

Move = TypeVar("Move")
"""Record of a motion in the language."""


@dataclass(frozen=True, slots=True)
class Away(Generic[Move]):
    """A motion by axes that the program has made since the last Cartesian one, or a wait behind it."""

    block: int  # Index of its block
    move: Move  # Its record in the language
    T_part_tcp: Float | None  # (4, 4) m, where it ends; None of a wait, and where that is not known
    spindle_rad_s: float  # Speed of the spindle
    tool: int  # Number of the tool
    time_s: float = 0.0  # Of a wait; 0 of a motion
    where: str = ""  # File and line
    unknown: Unknown | None = None  # Why its end is not known, where its value is not
    # Refuses axes beside those of the robot that stand elsewhere than in the cell file
    check: Callable[[], None] | None = None
    axes_deg: Sequence[float] = ()  # (6,) axes at its end as the controller shows them; empty where they are not known

    def motion(self, before: Motion) -> Motion:
        """Return its motion from the end of the one before."""
        start = before.p_end
        end = start if self.T_part_tcp is None else self.T_part_tcp[:3, 3].copy()
        kind: MotionKind = "dwell" if self.T_part_tcp is None else "rapid"
        return Motion(self.block, kind, start, end, 0.0, self.spindle_rad_s, self.tool, self.time_s)


class ExecutionByAxes(Execution, Generic[Move]):
    """Execution of a language that sends the robot to places by axes, too."""

    def __init__(self, in_spindle: ToolInSpindle) -> None:
        super().__init__(in_spindle)
        self.moves: list[Move] = []  # What stands behind each motion in the text
        self.away: list[Away[Move]] = []  # Motions by axes since the last Cartesian one, and waits there

    def leave(
        self, move: Move, T_part_tcp: Float | None, where: str, unknown: Unknown | None = None,
        check: Callable[[], None] | None = None, axes_deg: Sequence[float] = (),
    ) -> None:  # fmt: skip
        """Remember a motion by axes; :meth:`arrive` makes it where the path goes on.

        Args:
            T_part_tcp: (4, 4) m, where it ends; None where that is not known.
            where: File and line.
            unknown: Why it is not known.
            check: Called before it is made, see :class:`Away`.
            axes_deg: See :class:`Away`.
        """
        self.by_axes.append(len(self._blocks) - 1)
        self.away.append(Away(
            len(self._blocks) - 1, move, T_part_tcp, self._rpm * RPM, self._in_spindle.tool, 0.0, where, unknown, check,
            axes_deg,
        ))  # fmt: skip

    def rest(self, move: Move, time_s: float) -> bool:
        """Wait where the robot stands; returns whether there is a wait now."""
        if self.away:
            self.away.append(Away(
                len(self._blocks) - 1, move, None, self._rpm * RPM, self._in_spindle.tool, time_s
            ))  # fmt: skip
            return True
        if not self.dwell(len(self._blocks) - 1, time_s):
            return False
        self.moves.append(move)
        return True

    def arrive(self, refuse: Callable[[Away[Move]], ProgramError]) -> None:
        """Make the motions by axes before a Cartesian motion, where others came before them.

        Raises:
            ProgramError: The robot goes to such a place between Cartesian motions.
        """
        away, self.away = self.away, []
        if not away or not self.motions:
            return
        for one in away:
            if one.T_part_tcp is None and one.time_s <= 0.0:
                raise refuse(one)
            if one.check is not None:
                one.check()
        made = {one.block: one for one in away}
        for index in range(away[0].block, len(self._blocks)):
            block = replace(self._blocks[index], first_motion=len(self.motions))
            one_here = made.get(index)
            if one_here is not None:
                if len(one_here.axes_deg):
                    self.axes_deg[len(self.motions)] = tuple(one_here.axes_deg)
                self.motions.append(one_here.motion(self.motions[-1]))
                T = one_here.T_part_tcp
                self.rotations.append(self.rotations[-1] if T is None else T[:3, :3].copy())
                self.moves.append(one_here.move)
                code = "G0" if T is not None else "G1"
                block = replace(block, motion_count=1, modal=replace(block.modal, motion=code))
            self._blocks[index] = block
