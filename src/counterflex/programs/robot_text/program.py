"""A program that was written for a robot: it states how the tool is held."""

from __future__ import annotations

from dataclasses import dataclass

from counterflex.core.arrays import Float
from counterflex.programs.program import Program


@dataclass(frozen=True, slots=True)
class RobotProgram(Program):
    """A program in a language of robots.

    Attributes:
        Rs_part_tcp: (motions, 3, 3) orientation of the cell's TCP frame at the end of each motion, in the part.
        acting: Lines that act on the cell (outputs, waits for inputs, TRIGGER) and are not in the cell file's table.
        left_out: File and line of each motion by axes before the first target or behind the last one: none of the path.
    """

    Rs_part_tcp: Float | None = None
    acting: tuple[int, ...] = ()
    left_out: tuple[str, ...] = ()
