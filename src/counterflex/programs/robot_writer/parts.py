"""A robot program cut into parts: a new one for every tool, and where a file would get too long."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, Protocol

from counterflex.programs.program import Block, Program
from counterflex.programs.robot_writer.points import RobotPoints, steps

_CHANGES: Final = (6.0, 61.0)


class RobotLanguage(Protocol):
    """Words of a language that a part needs."""

    def block(self, block: Block) -> list[str]:
        """Lines for what a block does beside moving, its comment included."""

    def dwell(self, time_s: float) -> str:
        """Line that waits."""

    def point(self, index: int) -> list[str]:
        """Lines that lead to a point."""

    def enter(self, tool: int, place: int) -> list[str]:
        """Lines behind a change of tool: its frame, and the way back to the point at which it was changed."""


@dataclass
class RobotParts:
    """Lines of a robot program.

    What stands before the first point and behind the last one belongs to the main file also where the path is cut into
    parts: there nothing moves, and a person may be asked for something.
    """

    # Lines before the move to the start posture: they end with the first change of tool, so that the robot goes there
    # with the tool that it works with
    lead: list[str] = field(default_factory=list)
    opening: list[str] = field(default_factory=list)  # Lines between that move and the first point
    # Lines of each part, in order, from its first point to its last; a change of tool begins one
    parts: list[list[str]] = field(default_factory=lambda: [[]])
    ending: list[str] = field(default_factory=list)  # Lines behind the last point
    changes: int = 0  # Number of parts that begin with a change of tool

    def warnings(self, points_per_file: int) -> tuple[str, ...]:
        """Warnings about the cut into parts."""
        if len(self.parts) == 1:
            return ()
        tools = f", {self.changes} of them for a change of tool" if self.changes else ""
        return (f"split into {len(self.parts)} parts of at most {points_per_file} points{tools}",)


def first_tool(program: Program) -> int:
    """Number of the tool that the first motion with a tool is made with; 0 where there is none."""
    return next((motion.tool for motion in program.motions if motion.tool), 0)


def changes_tool(block: Block) -> bool:
    """Return whether a block puts a tool into the spindle, or takes it out (T0)."""
    return any(word.letter == "M" and word.value in _CHANGES for word in block.words)


def robot_parts(program: Program, points: RobotPoints, language: RobotLanguage, points_per_file: int) -> RobotParts:
    """Cut a program into parts.

    Args:
        points: Its points.
        language: How a block, a dwell, a point and a change of tool are said.
        points_per_file: Largest number of points of a part.
    """
    out = RobotParts()
    count, place, moved = 0, -1, 0
    tool, last = first_tool(program), len(points.row) - 1
    for step in steps(program, points):
        if isinstance(step, Block):
            lines = language.block(step)
            changes = changes_tool(step)
            tool = step.modal.tool or tool  # an empty spindle is led as the last tool was
            if changes and place < 0:
                out.lead += [*out.parts[-1], *lines]
                out.parts[-1] = []
            elif not changes or place == last:  # behind the last point nothing has to be led back
                out.parts[-1] += lines
            else:
                out.parts.append([*lines, *language.enter(tool, place)])
                out.changes += 1
                count, moved = 0, len(out.parts[-1])
        elif isinstance(step, float):
            out.parts[-1].append(language.dwell(step))
        else:
            if place < 0:
                out.opening, out.parts[-1] = out.parts[-1], []
            if count == points_per_file:
                out.parts.append([])
                count = 0
            count += 1
            place = step
            out.parts[-1] += language.point(step)
            moved = len(out.parts[-1])
    out.ending = out.parts[-1][moved:]
    del out.parts[-1][moved:]
    return out
