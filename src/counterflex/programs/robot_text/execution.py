"""Execution of a program in any language of robots: motions, waits, process words, blocks."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Generic, Protocol, TypeVar

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.core.units import MM, RPM
from counterflex.geometry import rotation
from counterflex.geometry.circle import angle_to, circle
from counterflex.programs.gcode.read.flow import line_end, split_lines
from counterflex.programs.program import TOOL_VECTOR, Block, Modal, Motion, MotionKind, Word
from counterflex.programs.robot_text.process_words import ProcessWord
from counterflex.programs.unknown import Unknown

UPRIGHT_RAD: Final = 5e-5
"""A tool within this of z is along z: posts write three decimals of a degree, the tip is where it is commanded."""


def tilted(Rs_part_tcp: Float) -> bool:
    """Return whether a tool frame (n, 3, 3) leaves the part's z anywhere."""
    axes = -Rs_part_tcp[:, :, 2]
    return bool(np.any(np.linalg.norm(axes[:, :2], axis=1) > UPRIGHT_RAD) or np.any(axes[:, 2] < 0.0))


def with_axes(motions: Sequence[Motion], Rs_part_tcp: Float) -> Iterator[Motion]:
    """The motions with the tool axis at their ends as I J K."""
    axes = -Rs_part_tcp[:, :, 2]
    before = axes[0] if len(axes) else None
    for motion, axis in zip(motions, axes, strict=True):
        if before is None:
            return
        start, end = (tuple(float(value) for value in one) for one in (before, axis))
        yield replace(motion, abc_start=(start[0], start[1], start[2]), abc_end=(end[0], end[1], end[2]))
        before = axis


_LARGEST_RADIUS_M = 100.0
_LEAST_WAY_M: Final = 1e-9
_SAME_TIME: Final = 1e-3  # Share; targets and speeds are written with few digits


class ToolInSpindle(Protocol):
    """Who knows the number of the tool in the spindle."""

    tool: int


class Execution:
    """Motions and blocks of a program as far as it has run."""

    def __init__(self, in_spindle: ToolInSpindle) -> None:
        self._in_spindle = in_spindle
        self.motions: list[Motion] = []  # Each motion, without rotary words
        self.rotations: list[Float] = []  # (3, 3) orientation of the cell's TCP at the end of each motion
        self.acting: list[int] = []  # Lines that act on the cell without the table of the cell file saying what they do
        self.by_axes: list[int] = []  # Indices of the blocks of motions by axes, made or not
        self.axes_deg: dict[int, Sequence[float]] = {}  # By motion, the axes at its end, where its target gives them
        self._blocks: list[Block] = []
        self._rpm = 0.0
        self._words: list[Word] = []

    def blocks(self, tool_centre: int) -> Iterator[Block]:
        """Return the executed statements, with a meaning of the rotary words."""
        for block in self._blocks:
            yield block if tool_centre == 0 else replace(block, modal=replace(block.modal, tool_centre=tool_centre))

    def left_out(self, name: str) -> tuple[str, ...]:
        """Return file and line of each motion by axes that is none of the path, see :class:`RobotProgram`."""
        blocks = [self._blocks[index] for index in self.by_axes if index < len(self._blocks)]
        return tuple(dict.fromkeys(block.where(name) for block in blocks if block.motion_count == 0))

    def fields(self, name: str, text: str) -> dict[str, Any]:
        """Return what every language says of a :class:`~counterflex.programs.robot_text.program.RobotProgram` alike."""
        rotations = np.array(self.rotations).reshape(-1, 3, 3)
        leans = tilted(rotations)
        lines = split_lines(text)
        return {
            "name": name,
            "lines": (*lines, "") if text.endswith(("\n", "\r")) else lines,
            "newline": line_end(text),
            "blocks": tuple(self.blocks(TOOL_VECTOR if leans else 0)),
            "motions": tuple(with_axes(self.motions, rotations) if leans else self.motions),
            "Rs_part_tcp": rotations,
            "acting": tuple(sorted(set(self.acting))),
            "left_out": self.left_out(name),
            "axes_deg": self.axes_deg,
        }

    # ---- motions ---------------------------------------------------------------------------------------------

    def straight(self, block: int, p_end: Float, R_part_tcp: Float, feed_m_s: float) -> Motion:
        """A straight motion to a point; the first one of a program, and one without feed, is a rapid.

        Args:
            block: Index of its block.
            p_end: (3,) m.
            R_part_tcp: (3, 3) orientation of the cell's TCP at its end.
            feed_m_s: 0 of a motion by axes.
        """
        before = self.motions[-1] if self.motions else None
        rapid = before is None or feed_m_s <= 0.0
        motion = Motion(
            block, "rapid" if rapid else "feed", p_end if before is None else before.p_end, p_end,
            0.0 if rapid else feed_m_s, self._rpm * RPM, self._in_spindle.tool,
        )  # fmt: skip
        self.motions.append(motion)
        self.rotations.append(R_part_tcp)
        return motion

    def circle(self, p_auxiliary: Float, fault: Callable[[str, str], ProgramError]) -> None:
        """Make a circle of the last motion, through a point.

        Args:
            p_auxiliary: (3,) m.
            fault: Makes the error of a message and a hint.

        Raises:
            ProgramError: The three points give none.
        """
        motion = self.motions[-1]
        if len(self.motions) > 1:
            self.motions[-1] = arc_through(motion, p_auxiliary, fault)

    def dwell(self, block: int, time_s: float) -> bool:
        """A wait where the robot stands; whether one was made."""
        if time_s <= 0.0 or not self.motions:
            return False
        p = self.motions[-1].p_end
        self.motions.append(Motion(block, "dwell", p, p, 0.0, self._rpm * RPM, self._in_spindle.tool, time_s))
        self.rotations.append(self.rotations[-1])
        return True

    # ---- process words ---------------------------------------------------------------------------------------

    def do(self, function: ProcessWord) -> None:
        """A machine function of the cell file's table."""
        values, words = function.values, [Word("M", float(function.code), 0, 0)]
        if function.code in (3, 4):
            speed = values.get("S", abs(self._rpm))
            self._rpm = speed if function.code == 3 else -speed
        elif function.code == 5:
            self._rpm = 0.0
        elif function.code == 6:
            self.change_tool(values)
        words += [Word(letter, value, 0, 0) for letter, value in values.items() if letter in "SPQER"]
        words += [Word("T", float(self._in_spindle.tool), 0, 0)] if function.code == 6 else []
        self._words = [*self._words, *words]

    def change_tool(self, values: Mapping[str, float]) -> None:
        """A tool change by its words."""
        if "T" in values:
            self._in_spindle.tool = int(values["T"])

    # ---- blocks ----------------------------------------------------------------------------------------------

    def modal(self, motion: str) -> Modal:
        """State of a block whose motion code is given."""
        return Modal(motion, 17, MM, True, False, 94, (0.0, 0.0, 0.0), self._in_spindle.tool, self._rpm)

    def motion_code(self, first: int) -> str:
        """Motion code of the block that made the motions from an index on; G1 where it made none."""
        if len(self.motions) == first:
            return "G1"
        motion = self.motions[first]
        if motion.kind == "arc":
            up = motion.normal is not None and float(motion.normal[2]) * motion.turn_rad >= 0.0
            return "G3" if up else "G2"
        return "G0" if motion.kind == "rapid" else "G1"


def arc_through(motion: Motion, p_auxiliary: Float, fault: Callable[[str, str], ProgramError]) -> Motion:
    """A straight motion as the circle through a point.

    Args:
        motion: From start to end.
        p_auxiliary: (3,) m.
        fault: Makes the error of a message and a hint.

    Raises:
        ProgramError: The three points give no circle that a robot can go.
    """
    parts = circle(np.asarray(motion.p_start), p_auxiliary, np.asarray(motion.p_end))
    if parts is None:
        raise fault("the three points of a circle lie on a line", "Write a straight motion")
    centre, normal = parts
    if float(np.linalg.norm(np.asarray(motion.p_start) - centre)) > _LARGEST_RADIUS_M:
        raise fault("the radius of a circle is beyond every robot", "Write a straight motion")
    turn = angle_to(np.asarray(motion.p_start), np.asarray(motion.p_end), centre, normal)
    return replace(motion, kind="arc", p_centre=centre, normal=normal, turn_rad=turn)


def slowed_by_turning(motion: Motion, Rs_part_tcp: Sequence[Float], turning_rad_s: Sequence[float]) -> Motion:
    """The motion at the speed that its turn leaves: controllers end the way and the turn at the same time.

    Args:
        motion: At its programmed speed; without way or speed it stays as it is.
        Rs_part_tcp: Two of (3, 3), orientation of the TCP at its start and its end.
        turning_rad_s: Largest speed of the whole turn; or two, of the tool axis and about it.
    """
    R_part_start, R_part_end = Rs_part_tcp
    if motion.feed_m_s <= 0.0 or R_part_start is R_part_end or not any(math.isfinite(speed) for speed in turning_rad_s):
        return motion
    w, x, y, z = rotation.quat_wxyz(R_part_start.T @ R_part_end)
    both = math.hypot(x, y), abs(z)
    halves = (
        [math.atan2(math.hypot(*both), abs(w))]
        if len(turning_rad_s) == 1
        else [math.atan2(both[0], math.hypot(w, z)), math.atan2(both[1], abs(w))]
    )
    time_s = max(2.0 * half / speed for half, speed in zip(halves, turning_rad_s, strict=True))
    length = motion.length_m
    if length <= _LEAST_WAY_M or time_s <= length / motion.feed_m_s * (1.0 + _SAME_TIME):
        return motion
    return replace(motion, feed_m_s=length / time_s)


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
